//! What differs between the trainings of photographs and of satellite images on a device.

use super::arrays::{Common, REPORT};
use super::camera_kind::CameraKind;
use super::device::GpuDevice;
use super::kernel::Dispatch;
use super::plan_uniform::{PlanUniform, TrainingNumbers};
use super::raster::Raster;
use super::splats::DeviceSplats;
use crate::nn::adam::AdamStep;
use crate::splat::adam::RULE;
use crate::splat::backend::{GpuError, StepPlan};
use crate::splat::loss::photometric::{SSIM_WEIGHT, Similarity};
use crate::splat::loss::{Losses, column_names};
use crate::splat::state::TrainingState;

/// The views of a scene on a device: of which kernels an iteration on one consists.
pub trait DeviceViews {
    /// What a picture is rendered from.
    type Viewpoint;
    /// A rendered picture.
    type Picture;
    /// The arrays of a training, and its kernels with them.
    type Arrays;
    /// What the kernels of an iteration are told.
    type Uniform;
    /// What cameras the views have.
    const KIND: CameraKind;
    /// Pairs of splats and tiles in each render for which there is room at first, for each splat.
    const PAIRS_OF_SPLAT: u64;

    /// Number of views.
    fn views(&self) -> usize;

    /// [`ViewModel::altitudes`](crate::splat::backend::ViewModel::altitudes).
    fn altitudes(&self) -> Option<(f64, f64)>;

    /// Arrays for these splats, with room for so many pairs of splats and tiles in each render.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`].
    fn arrays(&self, gpu: &GpuDevice, splats: DeviceSplats, pairs: u32) -> Result<Self::Arrays, GpuError>;

    /// What all kinds of views have of them.
    fn common(arrays: &Self::Arrays) -> &Common;

    /// Writes to the device what a state has beside its splats.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`].
    fn write_state(
        &mut self,
        gpu: &GpuDevice,
        arrays: &mut Self::Arrays,
        state: &TrainingState,
    ) -> Result<(), GpuError>;

    /// Reads it back.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    fn read_state(
        &self,
        gpu: &GpuDevice,
        arrays: &Self::Arrays,
        state: &mut TrainingState,
    ) -> Result<(), GpuError>;

    /// What the kernels of an iteration are told that is the step of the optimiser of this number, after those before it. The view
    /// of the plan exists.
    fn uniform(&mut self, state: &mut TrainingState, plan: &StepPlan, step: u32) -> Self::Uniform;

    /// Writes to the device what the uniform has beside the plans of its renders.
    fn write_uniform(&self, gpu: &GpuDevice, arrays: &Self::Arrays, uniform: &Self::Uniform);

    /// The renders of an iteration.
    fn renders<'a>(
        arrays: &'a Self::Arrays,
        uniform: &'a Self::Uniform,
    ) -> Vec<(&'a Raster, &'a PlanUniform)>;

    /// The dispatches of an iteration.
    fn iteration<'a>(&'a self, arrays: &'a Self::Arrays, uniform: &Self::Uniform) -> Vec<Dispatch<'a>>;

    /// The losses of an iteration with so many splats.
    fn losses(&self, plan: &StepPlan, splats: usize, sums: &Sums) -> Losses;

    /// Renders a picture on the processor, with the colour model of a view if there are colour models.
    fn picture(&self, state: &TrainingState, from: &Self::Viewpoint, view: usize) -> Self::Picture;
}

/// The sums of an iteration, as the device reports them.
#[derive(Clone, Copy, Debug)]
pub struct Sums {
    /// Of opacities.
    pub opacity: f64,
    /// Of SSIM and of absolute differences, over pixels and channels.
    pub ssim: f64,
    /// See [`Sums::ssim`].
    pub l1: f64,
    /// Of the entropy of the share of sunlight, bits.
    pub entropy: f64,
    /// Number of pixels that are compared with a virtual view, and the differences of altitudes (metres) and colours.
    pub compared: [f64; 3],
    /// Of the splats' robust distances from the prior's surface.
    pub distance: f64,
}

impl Sums {
    /// From the words of a report.
    pub fn new(report: &[u32; REPORT]) -> Self {
        let [_, _, opacity, ssim, l1, entropy, pixels, altitude, color, distance] =
            report.map(|word| f64::from(f32::from_bits(word)));
        Self { opacity, ssim, l1, entropy, compared: [pixels, altitude, color], distance }
    }

    /// The terms that all kinds of views have, with the mean opacity and the loss of opacities.
    pub fn common_terms(&self, plan: &StepPlan, splats: usize, (width, height): (usize, usize)) -> Losses {
        let (values, count) = ((3 * width * height) as f64, splats.max(1) as f64);
        let similarity = Similarity { l1: self.l1 / values, ssim: self.ssim / values };
        let mut losses = Losses::default();
        set(&mut losses, "l1", similarity.l1);
        set(&mut losses, "ssim", similarity.ssim);
        set(&mut losses, "opacity", self.opacity / count);
        losses.total = similarity.loss() + by_opacity(plan, splats) * self.opacity;
        losses
    }
}

/// Sets a column of the losses.
pub fn set(losses: &mut Losses, name: &str, value: f64) {
    if let Some(k) = column_names().position(|column| column == name) {
        losses.columns[k] = value;
    }
}

/// Derivative of the loss by the opacity of each of so many splats.
fn by_opacity(plan: &StepPlan, splats: usize) -> f64 {
    let divisor = plan.opacity_divisor.unwrap_or(splats).max(1);
    plan.weights.get("opacity") / divisor as f64 + plan.weights.get("opacity_sum")
}

/// The numbers of the gradient for a view of so many columns and rows.
pub fn training_numbers(
    plan: &StepPlan,
    step: u32,
    splats: usize,
    (width, height): (usize, usize),
) -> TrainingNumbers {
    let values = (3 * width * height) as f64;
    let step = |rate: f64| AdamStep::new(RULE, rate, step);
    TrainingNumbers {
        iteration: plan.iteration,
        rates: plan.rates.map(|rate| step(rate).rate()),
        root_second: step(0.0).root_second(),
        by_opacity: by_opacity(plan, splats) as f32,
        by_ssim: (-SSIM_WEIGHT / values) as f32,
        by_l1: ((1.0 - SSIM_WEIGHT) / values) as f32,
    }
}
