//! The anchored splats of a training on a device.

use super::arrays::Common;
use super::device::GpuDevice;
use super::kernel::{Bound, Kernel};
use super::shader;
use super::splats::{CORE, pack, unpack};
use crate::splat::anchored::{AnchoredSplats, Anchoring};
use crate::splat::backend::GpuError;
use crate::splat::splats::Splats;

/// The anchored splats, in the order of their anchors.
pub struct Anchors {
    begin: Kernel,
    end: Kernel,
    anchorings: wgpu::Buffer,
    residuals: wgpu::Buffer,
    /// The place of each of them in the order of [`AnchoredSplats::anchorings`].
    places: Vec<u32>,
}

impl Anchors {
    /// None yet.
    pub fn new(gpu: &GpuDevice) -> Result<Self, GpuError> {
        Ok(Self {
            begin: Kernel::new(gpu, shader::ANCHOR_BEGIN, &[]),
            end: Kernel::new(gpu, shader::ANCHOR_END, &[]),
            anchorings: gpu.array("anchors", 0)?,
            residuals: gpu.array("residuals", 0)?,
            places: Vec::new(),
        })
    }

    /// The kernels before and after the step of the splats.
    pub fn bind(&self, gpu: &GpuDevice, shading: &wgpu::Buffer, common: &Common) -> [Bound; 2] {
        let (core, order) = (&common.splats.values.core, &common.order);
        let Self { anchorings, residuals, .. } = self;
        let begin = [shading, anchorings, residuals, &order.status, core, &order.gradient];
        let end = [shading, anchorings, &order.status, residuals, core];
        [self.begin.bind(gpu, &begin), self.end.bind(gpu, &end)]
    }

    /// Writes the anchored splats of a state; what was bound before does not know them.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`].
    pub fn write(&mut self, gpu: &GpuDevice, anchored: &AnchoredSplats) -> Result<(), GpuError> {
        let all = anchored.anchorings();
        self.places = (0..all.len() as u32).collect();
        self.places.sort_by_key(|k| all[*k as usize].anchor);
        let words = self.places.iter().flat_map(|k| {
            let Anchoring { splat, anchor } = all[*k as usize];
            [splat, anchor]
        });
        let words: Vec<u32> = words.collect();
        let mut residuals = Splats::default();
        residuals.take_from(anchored.residuals(), &self.places);
        self.anchorings = gpu.array("anchors", words.len() as u64)?;
        self.residuals = gpu.array("residuals", (all.len() * CORE) as u64)?;
        gpu.write(&self.anchorings, &words);
        gpu.write_numbers(&self.residuals, &pack(&residuals));
        Ok(())
    }

    /// Reads the residuals back into the state that was written.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn read(&self, gpu: &GpuDevice, anchored: &mut AnchoredSplats) -> Result<(), GpuError> {
        let n = self.places.len();
        let mut sorted = Splats::zeros(n);
        unpack(&gpu.read_numbers(&self.residuals, n * CORE)?, &mut sorted);
        let mut back = vec![0; n];
        (0..).zip(&self.places).for_each(|(at, place)| back[*place as usize] = at);
        let mut residuals = Splats::default();
        residuals.take_from(&sorted, &back);
        anchored.set_residuals(residuals);
        Ok(())
    }
}
