//! The backend that trains on photographs on a device.
//!
//! Whole iterations run on the device, several of them ahead of the reports that the host reads. Growth and pruning, every 100
//! iterations, are those of the processor: the splats are read back, changed and written again.
//!
//! The lists of an iteration have room for a number of pairs of splats and tiles that the host guesses. An iteration that needs more
//! marks itself; it and those behind it change nothing. The host hears of it, makes room, and runs them again: the result is the same.

use super::arrays::{Arrays, Kernels, Measured};
use super::constants::SLOT;
use super::device::GpuDevice;
use super::frames::Frames;
use super::photographs::DevicePhotograph;
use super::photometric::REPORT;
use super::plan_uniform::{PlanUniform, TrainingNumbers};
use super::splats::DeviceSplats;
use crate::nn::adam::AdamStep;
use crate::splat::adam::RULE;
use crate::splat::backend::{BackendError, GpuError, StepPlan, StepReport, TrainingBackend, Wait};
use crate::splat::harmonics::coefficients_used;
use crate::splat::loss::photometric::{SSIM_WEIGHT, Similarity};
use crate::splat::loss::{Losses, column_names};
use crate::splat::pinhole::{NEAREST, PinholePicture, PinholeView};
use crate::splat::raster::TILE;
use crate::splat::state::TrainingState;
use crate::splat::stopwatch::Stopwatch;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};

/// Iterations that may wait for the device.
const AHEAD: usize = 4;
/// Pairs of splats and tiles for which there is room at first, for each splat.
const PAIRS_OF_SPLAT: u64 = 12;
/// Room that is made for splats and pairs, as a multiple of what is needed.
const ROOM: f64 = 1.5;

/// Trains on photographs on a device.
pub struct GpuBackend {
    gpu: GpuDevice,
    kernels: Kernels,
    frames: Frames,
    views: Arc<Vec<PinholeView>>,
    photographs: Vec<DevicePhotograph>,
    arrays: Arrays,
    /// The state as it was when it was last read; its splats have the right number.
    state: TrainingState,
    /// Whether the device has changed the splats since.
    is_stale: bool,
    /// Steps of the optimiser that were submitted.
    steps: u32,
    pending: VecDeque<Pending>,
    reports: Vec<StepReport>,
    watch: Stopwatch,
}

/// An iteration that was submitted.
struct Pending {
    plan: StepPlan,
    /// Number of its step of the optimiser.
    step: u32,
    submission: wgpu::SubmissionIndex,
    report: wgpu::Buffer,
    mapped: Receiver<Result<(), wgpu::BufferAsyncError>>,
}

impl GpuBackend {
    /// A training on these views that starts from this state.
    ///
    /// # Errors
    /// [`GpuError`] if the device has too little memory.
    pub fn new(gpu: GpuDevice, views: Arc<Vec<PinholeView>>, state: TrainingState) -> Result<Self, GpuError> {
        Self::with_room(gpu, views, state, None)
    }

    /// As [`GpuBackend::new`], with room for so many pairs of splats and tiles at first.
    pub(super) fn with_room(
        gpu: GpuDevice,
        views: Arc<Vec<PinholeView>>,
        state: TrainingState,
        pairs: Option<u32>,
    ) -> Result<Self, GpuError> {
        let kernels = Kernels::new(&gpu);
        let largest =
            |of: fn((usize, usize)) -> usize| views.iter().map(|v| of(v.camera.size)).max().unwrap_or(0);
        let pixels = largest(|(width, height)| width * height);
        let tiles = largest(|(width, height)| width.div_ceil(TILE) * height.div_ceil(TILE));
        let frames = Frames::new(&gpu, pixels as u64, tiles as u64)?;
        let photographs =
            views.iter().map(|v| DevicePhotograph::new(&gpu, v)).collect::<Result<Vec<_>, _>>()?;
        let splats = DeviceSplats::new(&gpu, state.splats.len(), !state.splats.f_rest.is_empty())?;
        let guess = pairs.map_or(PAIRS_OF_SPLAT * state.splats.len() as u64, u64::from);
        let pairs = pairs_within(&gpu, guess);
        let arrays = Arrays::new(&gpu, &kernels, (&frames, &photographs), splats, pairs)?;
        let steps = state.adam.steps;
        let backend = Self {
            gpu,
            kernels,
            frames,
            views,
            photographs,
            arrays,
            state,
            is_stale: false,
            steps,
            pending: VecDeque::new(),
            reports: Vec::new(),
            watch: Stopwatch::default(),
        };
        backend.write_state();
        backend.gpu.wait()?;
        Ok(backend)
    }

    fn write_state(&self) {
        self.arrays.splats.write(&self.gpu, &self.state);
        self.arrays.raster.write_count(&self.gpu, self.state.splats.len());
    }

    /// What the kernels are told of an iteration.
    fn uniform(&self, plan: &StepPlan, step: u32) -> PlanUniform {
        let (view, n) = (&self.views[plan.view], self.state.splats.len());
        let background = if view.has_empty_pixels() { plan.random_background } else { plan.background };
        let (width, height) = view.camera.size;
        let values = (3 * width * height) as f64;
        let step = |rate: f64| AdamStep::new(RULE, rate, step);
        let has_rest = self.arrays.splats.has_rest;
        PlanUniform {
            camera: view.camera.kernel(NEAREST),
            center: view.camera.center.to_array().map(|v| v as f32),
            size: view.camera.size,
            background,
            splats: n,
            coefficients: if has_rest { coefficients_used(plan.sh_degree) as u32 } else { 0 },
            pair_capacity: self.arrays.raster.pair_capacity,
            training: TrainingNumbers {
                iteration: plan.iteration,
                rates: plan.rates.map(|rate| step(rate).rate()),
                root_second: step(0.0).root_second(),
                by_opacity: by_opacity(plan, n) as f32,
                by_ssim: (-SSIM_WEIGHT / values) as f32,
                by_l1: ((1.0 - SSIM_WEIGHT) / values) as f32,
            },
        }
    }

    /// Submits an iteration as the step of the optimiser of this number.
    fn enqueue(&mut self, plan: StepPlan, step: u32) {
        let uniform = self.uniform(&plan, step);
        let report = self.gpu.staging(REPORT as u64);
        let submission = self.arrays.submit(&self.gpu, &self.frames, (&uniform, plan.view), &report);
        let (sender, mapped) = channel();
        report.map_async(wgpu::MapMode::Read, .., move |result| {
            let _ = sender.send(result);
        });
        self.is_stale = true;
        self.pending.push_back(Pending { plan, step, submission, report, mapped });
    }

    /// Runs an iteration after all that were submitted, and measures it. It moves the splats, but counts as no iteration of the
    /// training.
    ///
    /// # Errors
    /// [`GpuError::Lacks`] if the device does not measure times; [`GpuError::Failed`].
    pub fn measure(&mut self, plan: &StepPlan) -> Result<Measured, GpuError> {
        self.finish()?;
        let uniform = self.uniform(plan, self.steps + 1);
        self.arrays.measure(&self.gpu, &self.frames, (&uniform, plan.view))
    }

    /// Waits for the oldest iteration and takes its report; if it has halted, makes room and submits it and those behind it again.
    fn collect(&mut self) -> Result<(), GpuError> {
        let Some(oldest) = self.pending.pop_front() else { return Ok(()) };
        let [halted, pairs, sums @ ..] = oldest.wait(&self.gpu)?;
        if halted == 0 {
            self.report(&oldest.plan, sums.map(f32::from_bits));
            return Ok(());
        }
        self.gpu.wait()?;
        let again: Vec<_> = std::iter::once(oldest).chain(self.pending.drain(..)).collect();
        self.make_room(self.arrays.splats.capacity, pairs.into())?;
        again.into_iter().for_each(|Pending { plan, step, .. }| self.enqueue(plan, step));
        Ok(())
    }

    fn report(&mut self, plan: &StepPlan, [opacity, ssim, l1]: [f32; 3]) {
        let ((width, height), n) = (self.views[plan.view].camera.size, self.state.splats.len());
        let mean = |sum: f32, count: usize| f64::from(sum) / count.max(1) as f64;
        let values = 3 * width * height;
        let similarity = Similarity { l1: mean(l1, values), ssim: mean(ssim, values) };
        let opacity = mean(opacity, n);
        let mut losses = Losses::default();
        for (column, name) in losses.columns.iter_mut().zip(column_names()) {
            *column = match name {
                "l1" => similarity.l1,
                "ssim" => similarity.ssim,
                "opacity" => opacity,
                _ => 0.0,
            };
        }
        losses.total = similarity.loss() + by_opacity(plan, n) * n as f64 * opacity;
        losses.average_over(self.photographs[plan.view].valid_share);
        let (iteration, active) = (plan.iteration, self.state.active.count());
        self.reports.push(StepReport { iteration, losses, splats: n, active, ..StepReport::default() });
    }

    /// Waits for all iterations.
    fn finish(&mut self) -> Result<(), GpuError> {
        while !self.pending.is_empty() {
            self.collect()?;
        }
        Ok(())
    }

    /// Makes room for so many splats and pairs; the splats on the device stay if they have room.
    fn make_room(&mut self, splats: usize, pairs: u64) -> Result<(), GpuError> {
        let Self { gpu, kernels, frames, photographs, arrays, .. } = self;
        let has_room = splats <= arrays.splats.capacity;
        let pairs = pairs_within(gpu, (ROOM * pairs as f64) as u64).max(arrays.raster.pair_capacity);
        let kept = if has_room {
            arrays.splats.clone()
        } else {
            DeviceSplats::new(gpu, (ROOM * splats as f64) as usize, arrays.splats.has_rest)?
        };
        *arrays = Arrays::new(gpu, kernels, (frames, photographs), kept, pairs)?;
        arrays.raster.write_count(gpu, self.state.splats.len());
        self.gpu.check()
    }

    /// Reads the state if the device has changed it.
    fn read_state(&mut self) -> Result<(), GpuError> {
        self.finish()?;
        if self.is_stale {
            self.arrays.splats.read(&self.gpu, &mut self.state)?;
            self.state.adam.steps = self.steps;
            self.is_stale = false;
        }
        Ok(())
    }

    /// Grows, prunes and resets the splats after an iteration.
    fn edit(&mut self, plan: &StepPlan) -> Result<(), GpuError> {
        self.read_state()?;
        let counts = plan.densify.apply(&mut self.state, plan.iteration, None);
        let n = self.state.splats.len();
        if n > self.arrays.splats.capacity {
            self.make_room(n, PAIRS_OF_SPLAT * n as u64)?;
        }
        self.write_state();
        if let Some(report) = self.reports.last_mut() {
            *report = StepReport { splats: n, active: self.state.active.count(), counts, ..*report };
        }
        Ok(())
    }
}

impl Pending {
    /// The words of the report, as soon as the iteration is done.
    fn wait(&self, gpu: &GpuDevice) -> Result<[u32; REPORT], GpuError> {
        let failed = |reason: String| GpuError::Failed { device: gpu.info.name.clone(), reason };
        let poll = wgpu::PollType::Wait { submission_index: Some(self.submission.clone()), timeout: None };
        gpu.device.poll(poll).map_err(|e| failed(e.to_string()))?;
        gpu.check()?;
        let mapped = self.mapped.recv().map_err(|e| failed(e.to_string()))?;
        mapped.map_err(|e| failed(e.to_string()))?;
        let view =
            self.report.slice(..4 * REPORT as u64).get_mapped_range().map_err(|e| failed(e.to_string()))?;
        let mut out = [0; REPORT];
        out.iter_mut().zip(view.as_chunks().0).for_each(|(word, bytes)| *word = u32::from_le_bytes(*bytes));
        Ok(out)
    }
}

/// As many of these pairs as the device's largest array has room for.
fn pairs_within(gpu: &GpuDevice, pairs: u64) -> u32 {
    let most = gpu.info.largest_binding.min(gpu.info.largest_buffer) / (4 * u64::from(SLOT));
    pairs.clamp(1, most).min(u32::MAX.into()) as u32
}

/// Derivative of the loss by the opacity of each of `n` splats.
fn by_opacity(plan: &StepPlan, n: usize) -> f64 {
    plan.weights.get("opacity") / n.max(1) as f64 + plan.weights.get("opacity_sum")
}

impl TrainingBackend for GpuBackend {
    type Viewpoint = crate::perspective::PinholeCamera;
    type Picture = PinholePicture;

    fn submit(&mut self, plan: &StepPlan) -> Result<(), BackendError> {
        let views = self.views.len();
        if plan.view >= views {
            return Err(BackendError::NoView { view: plan.view, views });
        }
        self.watch.begin();
        while self.pending.len() >= AHEAD {
            self.collect()?;
        }
        self.steps += 1;
        self.enqueue(plan.clone(), self.steps);
        self.watch.lap("device", "iterations");
        if !plan.densify.is_empty() {
            self.edit(plan)?;
            self.watch.lap("splats", "densification and pruning");
        }
        Ok(())
    }

    fn reports(&mut self, wait: Wait, into: &mut Vec<StepReport>) -> Result<(), BackendError> {
        if wait == Wait::ForAll {
            self.watch.begin();
            self.finish()?;
            self.watch.lap("device", "iterations");
        }
        into.append(&mut self.reports);
        Ok(())
    }

    fn render(&mut self, from: &Self::Viewpoint, view: usize) -> Result<PinholePicture, BackendError> {
        let views = self.views.len();
        if view >= views {
            return Err(BackendError::NoView { view, views });
        }
        Ok(PinholePicture::render(&self.snapshot()?.splats, from, NEAREST))
    }

    fn snapshot(&mut self) -> Result<&TrainingState, BackendError> {
        self.read_state()?;
        Ok(&self.state)
    }

    fn times(&self) -> &Stopwatch {
        &self.watch
    }
}
