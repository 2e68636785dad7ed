//! The views of a satellite scene on a device: three renders of one order, the pixels of a view, and what the loss asks of splats.

use super::anchors::Anchors;
use super::arrays::{Common, CommonKernels};
use super::camera_kind::CameraKind;
use super::constants::GROUP;
use super::device::GpuDevice;
use super::frames::{Extent, ImageArrays, LossArrays};
use super::kernel::{Bound, Dispatch, Groups, Kernel};
use super::photometric::{Photometric, PhotometricKernels};
use super::plan_uniform::{PlanUniform, TrainingNumbers, parallel};
use super::raster::{Raster, RasterKernels, SortedOrder};
use super::satellite_image::SatelliteImage;
use super::shader;
use super::shading_uniform::ShadingUniform;
use super::sort::groups_for;
use super::splats::DeviceSplats;
use super::views::{DeviceViews, Sums, set, training_numbers};
use crate::camera::QuadraticKernel;
use crate::nn::adam::{AdamRule, AdamStep};
use crate::splat::backend::{GpuError, StepPlan};
use crate::splat::loss::{Losses, Prior};
use crate::splat::raster::FrameCamera;
use crate::splat::satellite::{NovelView, Picture, SatelliteScene, StepCameras};
use crate::splat::sheared_camera::SunView;
use crate::splat::state::TrainingState;
use std::sync::Arc;

/// The views of a satellite scene.
pub struct DeviceSatellites {
    scene: SatelliteScene,
    prior: Option<(Arc<Prior>, wgpu::Buffer)>,
    images: Vec<SatelliteImage>,
    /// Steps of each view's colour model that were submitted.
    appearance_steps: Vec<u32>,
    view: ImageArrays,
    sun: ImageArrays,
    virtual_view: ImageArrays,
    pixels: PixelArrays,
    losses: LossArrays,
    anchors: Anchors,
    kernels: Kernels,
}

/// What a view's pixels need beside its renders.
struct PixelArrays {
    shading: wgpu::Buffer,
    /// What the picture is compared with: linear colours, and 1 where there are data.
    target: wgpu::Buffer,
    /// The picture, and the share of sunlight.
    picture: wgpu::Buffer,
    entropy_sums: wgpu::Buffer,
    parameter_sums: wgpu::Buffer,
    /// Derivatives by the pixels of the sun's image and of the virtual view, as integers.
    by_sun: wgpu::Buffer,
    by_virtual: wgpu::Buffer,
    /// Derivatives of the comparison with the virtual view by the view's pixels.
    by_view: wgpu::Buffer,
    difference_sums: wgpu::Buffer,
    compared: wgpu::Buffer,
}

struct Kernels {
    common: CommonKernels,
    raster: RasterKernels,
    photometric: PhotometricKernels,
    target: Kernel,
    shade: Kernel,
    shade_backward: Kernel,
    sun_backward: Kernel,
    compare: Kernel,
    compare_sums: Kernel,
    compare_backward: Kernel,
    surface_prior: Kernel,
    step_appearance: Kernel,
    report_terms: Kernel,
}

/// The arrays of a training.
pub struct SatelliteArrays {
    common: Common,
    view: Raster,
    sun: Raster,
    virtual_view: Raster,
    of_images: Vec<OfImage>,
    photometric: Photometric,
    sun_backward: Bound,
    compare: Bound,
    compare_sums: Bound,
    compare_backward: Bound,
    surface_prior: Option<Bound>,
    report_terms: Bound,
    anchors: [Bound; 2],
}

/// The kernels that need the image or the colour model of a view.
struct OfImage {
    target: Bound,
    shade: Bound,
    shade_backward: Bound,
    step_appearance: Bound,
}

/// What the kernels of an iteration are told.
pub struct SatelliteUniform {
    view: usize,
    render: PlanUniform,
    sun: Option<PlanUniform>,
    virtual_view: Option<PlanUniform>,
    shading: ShadingUniform,
}

impl PixelArrays {
    fn new(gpu: &GpuDevice, view: Extent, sun: Extent) -> Result<Self, GpuError> {
        Ok(Self {
            shading: gpu.uniform("shading", ShadingUniform::WORDS as u64)?,
            target: gpu.array("linear image", 4 * view.pixels)?,
            picture: gpu.array("picture", 4 * view.pixels)?,
            entropy_sums: gpu.array("sums of entropies", view.tiles)?,
            parameter_sums: gpu.array("sums of derivatives by colour models", 16 * view.tiles)?,
            by_sun: gpu.array("derivatives by the sun's image", sun.pixels)?,
            by_virtual: gpu.array("derivatives by the virtual view", 4 * view.pixels)?,
            by_view: gpu.array("derivatives of the comparison", 4 * view.pixels)?,
            difference_sums: gpu.array("sums of the comparison", 4 * view.tiles)?,
            compared: gpu.array("sum of the comparison", 4)?,
        })
    }
}

impl DeviceSatellites {
    /// Copies the images to the device.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`].
    pub fn new(gpu: &GpuDevice, mut scene: SatelliteScene) -> Result<Self, GpuError> {
        let extent = Extent::largest(scene.views.iter().map(|v| (v.width, v.height)));
        let with_sun = scene.views.iter().filter_map(|v| v.sun_shear.map(|shear| (v, shear)));
        let of_sun = Extent::largest(with_sun.map(|(v, shear)| {
            let sun = SunView::<f32>::new(&v.camera, (v.width, v.height), shear, scene.altitudes);
            (sun.image.camera.width, sun.image.camera.height)
        }));
        let prior = scene.inputs.prior.take().map(|prior| {
            let cells = prior.cells().cells.as_flattened();
            let array = gpu.array("surface of the prior", cells.len() as u64)?;
            gpu.write_numbers(&array, cells);
            Ok((prior, array))
        });
        let kernel = |shader| Kernel::new(gpu, shader, &[]);
        let image = |extent| ImageArrays::new(gpu, Self::KIND, extent);
        Ok(Self {
            prior: prior.transpose()?,
            images: scene.views.iter().map(|v| SatelliteImage::new(gpu, v)).collect::<Result<_, _>>()?,
            appearance_steps: vec![0; scene.views.len()],
            view: image(extent)?,
            sun: image(of_sun)?,
            virtual_view: image(extent)?,
            pixels: PixelArrays::new(gpu, extent, of_sun)?,
            losses: LossArrays::new(gpu, extent)?,
            anchors: Anchors::new(gpu)?,
            kernels: Kernels {
                common: CommonKernels::new(gpu),
                raster: RasterKernels::new(gpu, Self::KIND),
                photometric: PhotometricKernels::new(gpu, Self::KIND),
                target: kernel(shader::TARGET),
                shade: kernel(shader::SHADE),
                shade_backward: kernel(shader::SHADE_BACKWARD),
                sun_backward: kernel(shader::SUN_BACKWARD),
                compare: kernel(shader::COMPARE),
                compare_sums: kernel(shader::COMPARE_SUMS),
                compare_backward: kernel(shader::COMPARE_BACKWARD),
                surface_prior: kernel(shader::SURFACE_PRIOR),
                step_appearance: kernel(shader::STEP_APPEARANCE),
                report_terms: kernel(shader::REPORT_TERMS),
            },
            scene,
        })
    }

    /// The kernels of a view, given the uniform of its render.
    fn of_image(&self, gpu: &GpuDevice, plan: &wgpu::Buffer, status: &wgpu::Buffer, k: usize) -> OfImage {
        let Self { kernels, view, sun, pixels, .. } = self;
        let PixelArrays { shading, target, picture, .. } = pixels;
        let SatelliteImage { colors, linear, appearance, .. } = &self.images[k];
        let shade =
            [plan, shading, target, &view.frame, &sun.frame, appearance, picture, &pixels.entropy_sums];
        let backward = [
            plan,
            shading,
            &view.frame,
            picture,
            &sun.frame,
            appearance,
            &view.by_pixel,
            &pixels.by_sun,
            &pixels.parameter_sums,
        ];
        let step = [plan, shading, &pixels.parameter_sums, status, appearance];
        OfImage {
            target: kernels.target.bind(gpu, &[plan, shading, colors, linear, target]),
            shade: kernels.shade.bind(gpu, &shade),
            shade_backward: kernels.shade_backward.bind(gpu, &backward),
            step_appearance: kernels.step_appearance.bind(gpu, &step),
        }
    }

    /// The weight of the surface prior in an iteration; zero without one.
    fn prior_weight(&self, plan: &StepPlan) -> f64 {
        self.prior.as_ref().map_or(0.0, |_| plan.weights.get("surface_prior"))
    }

    fn bind_anchors(&self, gpu: &GpuDevice, common: &Common) -> [Bound; 2] {
        self.anchors.bind(gpu, &self.pixels.shading, common)
    }

    /// Renders of the view, of the sun's image and of the virtual view, and the picture, of the last iteration.
    #[cfg(test)]
    pub fn frames(&self) -> [&wgpu::Buffer; 4] {
        [&self.view.frame, &self.sun.frame, &self.virtual_view.frame, &self.pixels.picture]
    }
}

impl DeviceViews for DeviceSatellites {
    type Viewpoint = NovelView;
    type Picture = Picture;
    type Arrays = SatelliteArrays;
    type Uniform = SatelliteUniform;
    const KIND: CameraKind = CameraKind::Parallel;
    const PAIRS_OF_SPLAT: u64 = 4;

    fn views(&self) -> usize {
        self.scene.views.len()
    }

    fn altitudes(&self) -> Option<(f64, f64)> {
        Some(self.scene.altitudes)
    }

    fn arrays(&self, gpu: &GpuDevice, splats: DeviceSplats, pairs: u32) -> Result<SatelliteArrays, GpuError> {
        let Self { kernels, losses, pixels, .. } = self;
        let order = SortedOrder::new(gpu, &kernels.raster, splats.capacity)?;
        let raster = |image: &ImageArrays| Raster::new(gpu, &kernels.raster, (&order, image), &splats, pairs);
        let [view, sun, virtual_view] = [&self.view, &self.sun, &self.virtual_view].map(raster);
        let (view, sun, virtual_view) = (view?, sun?, virtual_view?);
        let plan = &view.plan;
        let PixelArrays { shading, target, picture, by_view, by_virtual, compared, .. } = pixels;
        let images = [picture, target, &self.view.by_pixel];
        let (frame, by_pixel) = (&self.view.frame, &self.view.by_pixel);
        let distance_sums =
            gpu.array("sums of distances", (splats.capacity as u64).div_ceil(GROUP.into()))?;
        let common_of = (&view.plan, losses);
        let surface_prior = self.prior.as_ref().map(|(_, cells)| {
            let core = &splats.values.core;
            let arrays = [plan, shading, core, cells, &order.status, &order.gradient, &distance_sums];
            kernels.surface_prior.bind(gpu, &arrays)
        });
        let compare =
            [plan, shading, frame, &self.virtual_view.frame, by_virtual, by_view, &pixels.difference_sums];
        let compare_backward =
            [plan, shading, compared, by_view, by_virtual, by_pixel, &self.virtual_view.by_pixel];
        let sun_backward = [&sun.plan, plan, &pixels.by_sun, &self.sun.by_pixel];
        let of_images = (0..self.images.len()).map(|k| self.of_image(gpu, plan, &order.status, k)).collect();
        let photometric = Photometric::new(gpu, &kernels.photometric, plan, images, losses);
        let compare_sums = kernels.compare_sums.bind(gpu, &[plan, &pixels.difference_sums, compared]);
        let common = Common::new(gpu, &kernels.common, common_of, (order, splats), pairs)?;
        let report = [plan, shading, &pixels.entropy_sums, compared, &distance_sums, &common.report_words];
        Ok(SatelliteArrays {
            of_images,
            photometric,
            sun_backward: kernels.sun_backward.bind(gpu, &sun_backward),
            compare: kernels.compare.bind(gpu, &compare),
            compare_sums,
            compare_backward: kernels.compare_backward.bind(gpu, &compare_backward),
            surface_prior,
            report_terms: kernels.report_terms.bind(gpu, &report),
            anchors: self.bind_anchors(gpu, &common),
            common,
            view,
            sun,
            virtual_view,
        })
    }

    fn common(arrays: &SatelliteArrays) -> &Common {
        &arrays.common
    }

    fn write_state(
        &mut self,
        gpu: &GpuDevice,
        arrays: &mut SatelliteArrays,
        state: &TrainingState,
    ) -> Result<(), GpuError> {
        let views = self.images.iter().zip(&state.appearances).zip(&mut self.appearance_steps);
        for ((image, (appearance, adam)), steps) in views {
            let (first, second, taken) = adam.parts();
            image.write_appearance(gpu, [&appearance.values, first, second]);
            *steps = taken;
        }
        self.anchors.write(gpu, &state.anchored)?;
        arrays.anchors = self.bind_anchors(gpu, &arrays.common);
        Ok(())
    }

    fn read_state(
        &self,
        gpu: &GpuDevice,
        _: &SatelliteArrays,
        state: &mut TrainingState,
    ) -> Result<(), GpuError> {
        let views = self.images.iter().zip(&mut state.appearances).zip(&self.appearance_steps);
        for ((image, (appearance, adam)), steps) in views.filter(|(_, steps)| **steps > 0) {
            image.read_appearance(gpu, appearance, adam, *steps)?;
        }
        self.anchors.read(gpu, &mut state.anchored)
    }

    fn uniform(&mut self, state: &mut TrainingState, plan: &StepPlan, step: u32) -> SatelliteUniform {
        let (image, n) = (&self.scene.views[plan.view], state.splats.len());
        let cameras @ StepCameras { camera, size, sun, virtual_view } =
            StepCameras::new(image, plan, self.scene.altitudes);
        let (pixels_per_m, longer_side) = cameras.scale();
        state.statistics.magnify(pixels_per_m, longer_side);
        let [r, g, b] = plan.background;
        let render = |frame: FrameCamera<QuadraticKernel<f32>>, training| PlanUniform {
            camera: parallel(&frame.kernel),
            size: (frame.width, frame.height),
            background: [r, g, b, self.scene.altitudes.0 as f32],
            splats: n,
            coefficients: 0,
            adds_gradient: false,
            training,
        };
        let added = |frame| {
            let training = TrainingNumbers { iteration: plan.iteration, ..TrainingNumbers::default() };
            PlanUniform { adds_gradient: true, ..render(frame, training) }
        };
        let of_view =
            render(FrameCamera::new(&camera, size.0, size.1), training_numbers(plan, step, n, size));
        let steps = &mut self.appearance_steps[plan.view];
        *steps += 1;
        let appearance = AdamStep::new(AdamRule::DEFAULT, plan.appearance_rate, *steps);
        let pixels = (size.0 * size.1) as f64;
        let shading = ShadingUniform {
            sun: sun.map(|sun| {
                let FrameCamera { width, height, .. } = sun.image.camera;
                (sun.image.warp, [width, height])
            }),
            virtual_view: virtual_view.map(|v| v.warp),
            level: plan.level,
            photograph_columns: image.width,
            by_entropy: plan.weights.get("shadow_entropy") / pixels,
            by_color: plan.weights.get("consistency_color"),
            by_altitude: plan.weights.get("consistency_altitude"),
            by_distance: self.prior_weight(plan) / n.max(1) as f64,
            prior: self.prior.as_ref().map(|(prior, _)| prior.clone()),
            appearance,
            anchored: state.anchored.anchorings().len(),
        };
        SatelliteUniform {
            view: plan.view,
            render: of_view,
            sun: sun.map(|sun| added(sun.image.camera)),
            virtual_view: virtual_view.map(|v| added(v.camera)),
            shading,
        }
    }

    fn write_uniform(&self, gpu: &GpuDevice, _: &SatelliteArrays, uniform: &SatelliteUniform) {
        gpu.write(&self.pixels.shading, &uniform.shading.words());
    }

    fn renders<'a>(
        arrays: &'a SatelliteArrays,
        uniform: &'a SatelliteUniform,
    ) -> Vec<(&'a Raster, &'a PlanUniform)> {
        let sun = uniform.sun.as_ref().map(|plan| (&arrays.sun, plan));
        let virtual_view = uniform.virtual_view.as_ref().map(|plan| (&arrays.virtual_view, plan));
        [(&arrays.view, &uniform.render)].into_iter().chain(sun).chain(virtual_view).collect()
    }

    fn iteration<'a>(&'a self, arrays: &'a SatelliteArrays, uniform: &SatelliteUniform) -> Vec<Dispatch<'a>> {
        let SatelliteArrays { common, .. } = arrays;
        let SatelliteUniform { view, render, sun, virtual_view, shading } = uniform;
        let (of_image, splats) = (&arrays.of_images[*view], render.splats);
        let in_tiles = |plan: &PlanUniform| {
            let [across, down] = plan.tiles();
            Groups::Box([across, down, 1])
        };
        let of_pixels = in_tiles(render);
        let sun = sun.as_ref().map(|plan| (&arrays.sun, plan));
        let virtual_view = virtual_view.as_ref().map(|plan| (&arrays.virtual_view, plan));
        // The view comes first: it begins the gradient.
        let renders = || [(&arrays.view, render)].into_iter().chain(sun).chain(virtual_view);
        let mut list = Vec::new();
        renders().for_each(|(raster, plan)| raster.project(&mut list, plan));
        common.order.sort(&mut list, splats);
        renders().for_each(|(raster, plan)| raster.forward(&mut list, plan));
        list.extend([of_image.target.on(of_pixels), of_image.shade.on(of_pixels)]);
        list.extend(arrays.photometric.on(render));
        list.push(of_image.shade_backward.on(of_pixels));
        if let Some((_, plan)) = sun {
            list.push(arrays.sun_backward.on(in_tiles(plan)));
        }
        if virtual_view.is_some() {
            list.extend([arrays.compare.on(of_pixels), arrays.compare_sums.on(Groups::Row(1))]);
            list.push(arrays.compare_backward.on(of_pixels));
        }
        renders().for_each(|(raster, plan)| raster.backward(&mut list, plan));
        if let Some(prior) = arrays.surface_prior.as_ref().filter(|_| shading.by_distance != 0.0) {
            list.push(prior.on(groups_for(splats as u64)));
        }
        let [begin, end] = &arrays.anchors;
        let anchored = (shading.anchored > 0).then(|| groups_for(shading.anchored as u64));
        list.extend(anchored.map(|groups| begin.on(groups)));
        common.step(&mut list, splats);
        list.extend(anchored.map(|groups| end.on(groups)));
        list.push(of_image.step_appearance.on(Groups::Row(1)));
        common.report(&mut list);
        list.push(arrays.report_terms.on(Groups::Row(1)));
        list
    }

    fn losses(&self, plan: &StepPlan, splats: usize, sums: &Sums) -> Losses {
        let cameras = StepCameras::new(&self.scene.views[plan.view], plan, self.scene.altitudes);
        let mut losses = sums.common_terms(plan, splats, cameras.size);
        let weight = |name| plan.weights.get(name);
        if cameras.sun.is_some() {
            let entropy = sums.entropy / (cameras.size.0 * cameras.size.1) as f64;
            set(&mut losses, "shadow_entropy", entropy);
            losses.total += weight("shadow_entropy") * entropy;
        }
        if cameras.virtual_view.is_some() {
            let [pixels, altitude, color] = sums.compared;
            let [altitude, color] = [altitude, color].map(|sum| sum / pixels.max(1.0));
            set(&mut losses, "consistency_altitude_m", altitude);
            set(&mut losses, "consistency_color", color);
            losses.total += weight("consistency_altitude") * altitude + weight("consistency_color") * color;
        }
        if self.prior_weight(plan) != 0.0 {
            let distance = sums.distance / splats.max(1) as f64;
            set(&mut losses, "surface_prior", distance);
            losses.total += self.prior_weight(plan) * distance;
        }
        losses.average_over(self.images[plan.view].valid_share(plan.level));
        losses
    }

    fn picture(&self, state: &TrainingState, from: &NovelView, view: usize) -> Picture {
        from.picture(&state.splats, &state.appearances[view].0, self.scene.altitudes)
    }
}
