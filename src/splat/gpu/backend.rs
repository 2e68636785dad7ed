//! The backend that trains on a device.
//!
//! Whole iterations run on the device, several of them ahead of the reports that the host reads. Growth and pruning, every 100
//! iterations, are those of the processor: the splats are read back, changed and written again.
//!
//! The lists of an iteration have room for a number of pairs of splats and tiles that the host guesses. An iteration that needs more
//! marks itself; it and those behind it change nothing. The host hears of it, makes room, and runs them again: the result is the same.

use super::arrays::REPORT;
use super::device::GpuDevice;
use super::photographs::DevicePhotographs;
use super::satellites::DeviceSatellites;
use super::splats::DeviceSplats;
use super::submission::{Measured, measure, submit};
use super::views::{DeviceViews, Sums};
use crate::splat::backend::{BackendError, GpuError, StepPlan, StepReport, TrainingBackend, Wait};
use crate::splat::pinhole::PinholeView;
use crate::splat::satellite::SatelliteScene;
use crate::splat::state::TrainingState;
use crate::splat::stopwatch::Stopwatch;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};

/// Iterations that may wait for the device.
const AHEAD: usize = 4;
/// Room that is made for splats and pairs, as a multiple of what is needed.
const ROOM: f64 = 1.5;

/// Trains on a device.
pub struct GpuBackend<V: DeviceViews> {
    gpu: GpuDevice,
    views: V,
    arrays: V::Arrays,
    /// The state as it was when it was last read; its splats have the right number.
    state: TrainingState,
    /// Whether the device has changed the splats since.
    is_stale: bool,
    /// Steps of the optimiser that were submitted.
    steps: u32,
    pending: VecDeque<Pending<V::Uniform>>,
    reports: Vec<StepReport>,
    watch: Stopwatch,
}

/// An iteration that was submitted.
struct Pending<U> {
    plan: StepPlan,
    uniform: U,
    submission: wgpu::SubmissionIndex,
    report: wgpu::Buffer,
    mapped: Receiver<Result<(), wgpu::BufferAsyncError>>,
}

impl GpuBackend<DevicePhotographs> {
    /// A training on these photographs that starts from this state.
    ///
    /// # Errors
    /// [`GpuError`] if the device has too little memory.
    pub fn new(gpu: GpuDevice, views: Arc<Vec<PinholeView>>, state: TrainingState) -> Result<Self, GpuError> {
        let views = DevicePhotographs::new(&gpu, views)?;
        Self::with_room(gpu, views, state, None)
    }
}

impl GpuBackend<DeviceSatellites> {
    /// A training of this satellite scene that starts from this state, whose colour models are those of EOGS.
    ///
    /// # Errors
    /// [`GpuError`] if the device has too little memory; [`BackendError::OtherAppearances`].
    pub fn of_satellites(
        gpu: GpuDevice,
        scene: SatelliteScene,
        state: TrainingState,
    ) -> Result<Self, BackendError> {
        let (found, expected) = (state.appearances.len(), scene.views.len());
        if found != expected {
            return Err(BackendError::OtherAppearances { found, expected });
        }
        let views = DeviceSatellites::new(&gpu, scene)?;
        Ok(Self::with_room(gpu, views, state, None)?)
    }
}

impl<V: DeviceViews> GpuBackend<V> {
    /// A training with room for so many pairs of splats and tiles at first.
    pub(super) fn with_room(
        gpu: GpuDevice,
        views: V,
        state: TrainingState,
        pairs: Option<u32>,
    ) -> Result<Self, GpuError> {
        let splats = DeviceSplats::new(&gpu, state.splats.len(), !state.splats.f_rest.is_empty())?;
        let guess = pairs.map_or(V::PAIRS_OF_SPLAT * state.splats.len() as u64, u64::from);
        let arrays = views.arrays(&gpu, splats, pairs_within::<V>(&gpu, guess))?;
        let steps = state.adam.steps;
        let mut backend = Self {
            gpu,
            views,
            arrays,
            state,
            is_stale: false,
            steps,
            pending: VecDeque::new(),
            reports: Vec::new(),
            watch: Stopwatch::default(),
        };
        backend.write_state()?;
        backend.gpu.wait()?;
        Ok(backend)
    }

    fn write_state(&mut self) -> Result<(), GpuError> {
        let Self { gpu, views, arrays, state, .. } = self;
        let common = V::common(arrays);
        common.splats.write(gpu, state);
        common.order.write_count(gpu, state.splats.len());
        views.write_state(gpu, arrays, state)
    }

    /// Submits an iteration.
    fn enqueue(&mut self, plan: StepPlan, uniform: V::Uniform) {
        let report = self.gpu.staging(REPORT as u64);
        let submission = submit(&self.gpu, &self.views, (&self.arrays, &uniform), &report);
        let (sender, mapped) = channel();
        report.map_async(wgpu::MapMode::Read, .., move |result| {
            let _ = sender.send(result);
        });
        self.is_stale = true;
        self.pending.push_back(Pending { plan, uniform, submission, report, mapped });
    }

    /// Runs an iteration after all that were submitted, and measures it. It moves the splats, but counts as no iteration of the
    /// training.
    ///
    /// # Errors
    /// [`GpuError::Lacks`] if the device does not measure times; [`GpuError::Failed`].
    pub fn measure(&mut self, plan: &StepPlan) -> Result<Measured, GpuError> {
        self.finish()?;
        let uniform = self.views.uniform(&mut self.state, plan, self.steps + 1);
        measure(&self.gpu, &self.views, (&self.arrays, &uniform))
    }

    /// Waits for the oldest iteration and takes its report; if it has halted, makes room and submits it and those behind it again.
    fn collect(&mut self) -> Result<(), GpuError> {
        let Some(oldest) = self.pending.pop_front() else { return Ok(()) };
        let report = oldest.wait(&self.gpu)?;
        let [halted, pairs, ..] = report;
        if halted == 0 {
            self.report(&oldest.plan, &Sums::new(&report));
            return Ok(());
        }
        self.gpu.wait()?;
        let again: Vec<_> = std::iter::once(oldest).chain(self.pending.drain(..)).collect();
        self.make_room(V::common(&self.arrays).splats.capacity, pairs.into())?;
        again.into_iter().for_each(|Pending { plan, uniform, .. }| self.enqueue(plan, uniform));
        Ok(())
    }

    fn report(&mut self, plan: &StepPlan, sums: &Sums) {
        let splats = self.state.splats.len();
        let losses = self.views.losses(plan, splats, sums);
        let (iteration, active) = (plan.iteration, self.state.active.count());
        self.reports.push(StepReport { iteration, losses, splats, active, ..StepReport::default() });
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
        let Self { gpu, views, arrays, state, .. } = self;
        let common = V::common(arrays);
        let pairs = pairs_within::<V>(gpu, (ROOM * pairs as f64) as u64).max(common.pair_capacity);
        let kept = if splats <= common.splats.capacity {
            common.splats.clone()
        } else {
            DeviceSplats::new(gpu, (ROOM * splats as f64) as usize, common.splats.has_rest)?
        };
        *arrays = views.arrays(gpu, kept, pairs)?;
        V::common(arrays).order.write_count(gpu, state.splats.len());
        gpu.check()
    }

    /// Reads the state if the device has changed it.
    fn read_state(&mut self) -> Result<(), GpuError> {
        self.finish()?;
        if self.is_stale {
            V::common(&self.arrays).splats.read(&self.gpu, &mut self.state)?;
            self.views.read_state(&self.gpu, &self.arrays, &mut self.state)?;
            self.state.adam.steps = self.steps;
            self.is_stale = false;
        }
        Ok(())
    }

    /// Grows, prunes and resets the splats after an iteration.
    fn edit(&mut self, plan: &StepPlan) -> Result<(), GpuError> {
        self.read_state()?;
        let counts = plan.densify.apply(&mut self.state, plan.iteration, self.views.altitudes());
        let n = self.state.splats.len();
        if n > V::common(&self.arrays).splats.capacity {
            self.make_room(n, V::PAIRS_OF_SPLAT * n as u64)?;
        }
        self.write_state()?;
        if let Some(report) = self.reports.last_mut() {
            *report = StepReport { splats: n, active: self.state.active.count(), counts, ..*report };
        }
        Ok(())
    }
}

impl<U> Pending<U> {
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
fn pairs_within<V: DeviceViews>(gpu: &GpuDevice, pairs: u64) -> u32 {
    let most = gpu.info.largest_binding.min(gpu.info.largest_buffer) / (4 * V::KIND.slot_words());
    pairs.clamp(1, most).min(u32::MAX.into()) as u32
}

impl<V: DeviceViews> TrainingBackend for GpuBackend<V> {
    type Viewpoint = V::Viewpoint;
    type Picture = V::Picture;

    fn submit(&mut self, plan: &StepPlan) -> Result<(), BackendError> {
        let views = self.views.views();
        if plan.view >= views {
            return Err(BackendError::NoView { view: plan.view, views });
        }
        self.watch.begin();
        while self.pending.len() >= AHEAD {
            self.collect()?;
        }
        self.steps += 1;
        let uniform = self.views.uniform(&mut self.state, plan, self.steps);
        self.enqueue(plan.clone(), uniform);
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

    fn render(&mut self, from: &Self::Viewpoint, view: usize) -> Result<V::Picture, BackendError> {
        let views = self.views.views();
        if view >= views {
            return Err(BackendError::NoView { view, views });
        }
        self.read_state()?;
        Ok(self.views.picture(&self.state, from, view))
    }

    fn snapshot(&mut self) -> Result<&TrainingState, BackendError> {
        self.read_state()?;
        Ok(&self.state)
    }

    fn times(&self) -> &Stopwatch {
        &self.watch
    }
}
