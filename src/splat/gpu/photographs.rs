//! Photographs on a device.

use super::arrays::{Common, CommonKernels};
use super::camera_kind::CameraKind;
use super::constants::NO_DATA;
use super::device::GpuDevice;
use super::frames::{Extent, ImageArrays, LossArrays};
use super::kernel::Dispatch;
use super::photometric::{Photometric, PhotometricKernels};
use super::plan_uniform::{PlanUniform, pinhole};
use super::raster::{Raster, RasterKernels, SortedOrder};
use super::splats::DeviceSplats;
use super::views::{DeviceViews, Sums, training_numbers};
use crate::perspective::PinholeCamera;
use crate::splat::backend::{GpuError, StepPlan};
use crate::splat::harmonics::coefficients_used;
use crate::splat::loss::Losses;
use crate::splat::pinhole::{NEAREST, PinholePicture, PinholeView};
use crate::splat::state::TrainingState;
use std::sync::Arc;

/// The photographs of a scene.
pub struct DevicePhotographs {
    views: Arc<Vec<PinholeView>>,
    photographs: Vec<DevicePhotograph>,
    image: ImageArrays,
    losses: LossArrays,
    kernels: Kernels,
}

struct Kernels {
    common: CommonKernels,
    raster: RasterKernels,
    photometric: PhotometricKernels,
}

/// The arrays of a training.
pub struct PhotographArrays {
    common: Common,
    raster: Raster,
    losses: Vec<Photometric>,
}

/// What the kernels of an iteration are told.
pub struct PhotographUniform {
    /// Index of the view.
    pub view: usize,
    /// Of its render.
    pub render: PlanUniform,
}

/// A photograph: four bytes of each pixel, red, green and blue on black and the opacity.
struct DevicePhotograph {
    /// The pixels, row by row.
    pixels: wgpu::Buffer,
    /// Share of the pixels that have data.
    valid_share: f64,
}

impl DevicePhotograph {
    /// Copies the photograph of a view.
    fn new(gpu: &GpuDevice, view: &PinholeView) -> Result<Self, GpuError> {
        let (width, height) = view.camera.size;
        let places = (0..height).flat_map(|row| (0..width).map(move |col| (col, row)));
        let words: Vec<u32> = places.map(|(col, row)| view.pixel(col, row).map_or(NO_DATA, pack)).collect();
        let valid = words.iter().filter(|word| **word != NO_DATA).count();
        let pixels = gpu.array("photograph", words.len() as u64)?;
        gpu.write(&pixels, &words);
        Ok(Self { pixels, valid_share: valid as f64 / words.len().max(1) as f64 })
    }
}

/// The bytes of a pixel with data.
fn pack(([red, green, blue], opacity): ([u8; 3], u8)) -> u32 {
    let word = u32::from_le_bytes([red, green, blue, opacity]);
    // Colours on black are not white where nothing is; a file that says so differs by one level.
    if word == NO_DATA { word - 1 } else { word }
}

impl DevicePhotographs {
    /// Copies the photographs to the device.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`].
    pub fn new(gpu: &GpuDevice, views: Arc<Vec<PinholeView>>) -> Result<Self, GpuError> {
        let extent = Extent::largest(views.iter().map(|v| v.camera.size));
        let photographs = views.iter().map(|v| DevicePhotograph::new(gpu, v)).collect::<Result<_, _>>()?;
        Ok(Self {
            photographs,
            image: ImageArrays::new(gpu, Self::KIND, extent)?,
            losses: LossArrays::new(gpu, extent)?,
            kernels: Kernels {
                common: CommonKernels::new(gpu),
                raster: RasterKernels::new(gpu, Self::KIND),
                photometric: PhotometricKernels::new(gpu, Self::KIND),
            },
            views,
        })
    }

    /// The render of the last iteration.
    #[cfg(test)]
    pub fn frame(&self) -> &wgpu::Buffer {
        &self.image.frame
    }
}

impl DeviceViews for DevicePhotographs {
    type Viewpoint = PinholeCamera;
    type Picture = PinholePicture;
    type Arrays = PhotographArrays;
    type Uniform = PhotographUniform;
    const KIND: CameraKind = CameraKind::Pinhole;
    const PAIRS_OF_SPLAT: u64 = 12;

    fn views(&self) -> usize {
        self.views.len()
    }

    fn altitudes(&self) -> Option<(f64, f64)> {
        None
    }

    fn arrays(
        &self,
        gpu: &GpuDevice,
        splats: DeviceSplats,
        pairs: u32,
    ) -> Result<PhotographArrays, GpuError> {
        let Self { kernels, image, losses, .. } = self;
        let order = SortedOrder::new(gpu, &kernels.raster, splats.capacity)?;
        let raster = Raster::new(gpu, &kernels.raster, (&order, image), &splats, pairs)?;
        let of_photograph = |p: &DevicePhotograph| {
            let images = [&image.frame, &p.pixels, &image.by_pixel];
            Photometric::new(gpu, &kernels.photometric, &raster.plan, images, losses)
        };
        Ok(PhotographArrays {
            losses: self.photographs.iter().map(of_photograph).collect(),
            common: Common::new(gpu, &kernels.common, (&raster.plan, losses), (order, splats), pairs)?,
            raster,
        })
    }

    fn common(arrays: &PhotographArrays) -> &Common {
        &arrays.common
    }

    fn write_state(
        &mut self,
        _: &GpuDevice,
        _: &mut PhotographArrays,
        _: &TrainingState,
    ) -> Result<(), GpuError> {
        Ok(())
    }

    fn read_state(&self, _: &GpuDevice, _: &PhotographArrays, _: &mut TrainingState) -> Result<(), GpuError> {
        Ok(())
    }

    fn uniform(&mut self, state: &mut TrainingState, plan: &StepPlan, step: u32) -> PhotographUniform {
        let (view, splats) = (&self.views[plan.view], &state.splats);
        let [r, g, b] = if view.has_empty_pixels() { plan.random_background } else { plan.background };
        let center = view.camera.center.to_array().map(|v| v as f32);
        let coefficients =
            if splats.f_rest.is_empty() { 0 } else { coefficients_used(plan.sh_degree) as u32 };
        let render = PlanUniform {
            camera: pinhole(&view.camera.kernel(NEAREST), center),
            size: view.camera.size,
            background: [r, g, b, 0.0],
            splats: splats.len(),
            coefficients,
            adds_gradient: false,
            training: training_numbers(plan, step, splats.len(), view.camera.size),
        };
        PhotographUniform { view: plan.view, render }
    }

    fn write_uniform(&self, _: &GpuDevice, _: &PhotographArrays, _: &PhotographUniform) {}

    fn renders<'a>(
        arrays: &'a PhotographArrays,
        uniform: &'a PhotographUniform,
    ) -> Vec<(&'a Raster, &'a PlanUniform)> {
        vec![(&arrays.raster, &uniform.render)]
    }

    fn iteration<'a>(
        &'a self,
        arrays: &'a PhotographArrays,
        uniform: &PhotographUniform,
    ) -> Vec<Dispatch<'a>> {
        let PhotographArrays { common, raster, losses } = arrays;
        let (mut list, PhotographUniform { view, render }) = (Vec::new(), uniform);
        raster.project(&mut list, render);
        common.order.sort(&mut list, render.splats);
        raster.forward(&mut list, render);
        list.extend(losses[*view].on(render));
        raster.backward(&mut list, render);
        common.step(&mut list, render.splats);
        common.report(&mut list);
        list
    }

    fn losses(&self, plan: &StepPlan, splats: usize, sums: &Sums) -> Losses {
        let mut losses = sums.common_terms(plan, splats, self.views[plan.view].camera.size);
        losses.average_over(self.photographs[plan.view].valid_share);
        losses
    }

    fn picture(&self, state: &TrainingState, from: &PinholeCamera, _: usize) -> PinholePicture {
        PinholePicture::render(&state.splats, from, NEAREST)
    }
}
