//! Training iterations allocate no memory, and training stays within a limit; measured by an allocator that counts.

#![allow(clippy::print_stdout, clippy::unwrap_used, unsafe_code)]

#[path = "../benches/splat/scene.rs"]
mod scene;

use satgs::affine::TrainingView;
use satgs::io::Grid2;
use satgs::splat::appearance::AppearanceKind;
use satgs::splat::appearance::satgs::Cube;
use satgs::splat::backend::{CpuBackend, DensifyPlan, StepPlan, StepReport, TrainingBackend, Wait};
use satgs::splat::loss::{LossWeights, SurfaceDepth, TermInputs};
use satgs::splat::recipe::NetworkRates;
use satgs::splat::satellite::{SatelliteScene, SatelliteViews};
use satgs::splat::splats::PerGroup;
use satgs::splat::state::TrainingState;
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};

/// Bytes that training may use for each splat, for each pixel of the largest view, and for each pixel of all views.
const BYTES_PER_SPLAT: usize = 1500;
const BYTES_PER_RENDERED_PIXEL: usize = 400;
const BYTES_PER_STORED_PIXEL: usize = 3;

const SPLATS: usize = 100_000;
const PIXELS: f64 = 0.64e6;
const VIEWS: usize = 3;

/// The system's allocator with counters.
struct Counting;

/// Number of allocations, bytes that are allocated, and the largest number of them so far.
static ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);
static HELD: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

impl Counting {
    fn grew(bytes: usize) {
        ALLOCATIONS.fetch_add(1, SeqCst);
        PEAK.fetch_max(HELD.fetch_add(bytes, SeqCst) + bytes, SeqCst);
    }
}

// SAFETY: every call is passed to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        Self::grew(layout.size());
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), SeqCst);
        unsafe { System.dealloc(memory, layout) }
    }

    // During a reallocation the old and the new memory may both be allocated.
    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        Self::grew(size);
        HELD.fetch_sub(layout.size(), SeqCst);
        unsafe { System.realloc(memory, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn backend() -> CpuBackend<SatelliteViews> {
    let side = scene::side(PIXELS);
    let half_m = side as f64;
    let views: Vec<TrainingView> = (0..VIEWS)
        .map(|v| {
            let raster = Grid2::from_fn(side, side, |c, r| {
                0.5 + 0.4 * ((c * (v + 1)) as f32 * 0.1).sin() * (r as f32 * 0.2).cos()
            });
            let area = (-half_m, -half_m, half_m, half_m);
            TrainingView::new(
                format!("v{v}"),
                scene::camera(PIXELS),
                Some([1.7, -2.1]),
                &[raster],
                area,
                (0.0, 0.0),
            )
        })
        .collect();
    let appearance = AppearanceKind::Affine;
    let state = TrainingState::start(scene::town(SPLATS, PIXELS, 1), appearance, VIEWS, 0);
    let scene = SatelliteScene {
        views: views.into(),
        altitudes: (-3.0, 30.0),
        inputs: TermInputs::default(),
        appearance,
        cube: Cube::default(),
        visibility: None,
    };
    CpuBackend::new(SatelliteViews::new(scene, &state), state).unwrap()
}

/// An iteration with three renders and learning rates of zero, so that every iteration does the same work.
fn plan(iteration: u32) -> StepPlan {
    StepPlan {
        iteration,
        view: iteration as usize % VIEWS,
        level: 0,
        shadows: true,
        virtual_shear: Some([0.001, 0.001]),
        random_background: [0.0; 3],
        background: [0.3; 3],
        weights: LossWeights::of(&[
            ("opacity", 0.01),
            ("consistency_altitude", 0.1),
            ("consistency_color", 0.1),
            ("shadow_entropy", 0.01),
        ])
        .unwrap(),
        opacity_divisor: None,
        sh_degree: 0,
        surface: SurfaceDepth::Mean,
        rates: PerGroup::default(),
        appearance_rate: 0.0,
        network_rates: NetworkRates::default(),
        densify: DensifyPlan::default(),
        visibility: None,
        crop: None,
        seed: 0,
    }
}

// There is only one test, as the counters are those of the whole process.
#[test]
fn an_iteration_allocates_nothing_and_training_stays_within_its_memory() {
    // The test runs inside the pool, as work that is handed to a pool from outside is put into a list, which allocates.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        let before = HELD.load(SeqCst);
        let mut backend = backend();
        PEAK.store(HELD.load(SeqCst), SeqCst);
        let mut reports: Vec<StepReport> = Vec::new();
        let mut run = |i: u32| {
            backend.submit(&plan(i)).unwrap();
            backend.reports(Wait::ForAll, &mut reports).unwrap();
            reports.clear();
        };
        (1..=3).for_each(&mut run);

        let peak = PEAK.load(SeqCst) - before;
        let pixels = scene::side(PIXELS).pow(2);
        let limit = BYTES_PER_SPLAT * SPLATS
            + BYTES_PER_RENDERED_PIXEL * pixels
            + BYTES_PER_STORED_PIXEL * pixels * VIEWS;
        let pixels_part = (BYTES_PER_RENDERED_PIXEL + BYTES_PER_STORED_PIXEL * VIEWS) * pixels;
        println!("{} bytes at most for {SPLATS} splats, of {limit} allowed", peak);
        assert!(peak < limit, "{peak} bytes at most, {limit} are allowed ({pixels_part} of them for pixels)");

        let allocations = ALLOCATIONS.load(SeqCst);
        (4..=6).for_each(&mut run);
        assert_eq!(ALLOCATIONS.load(SeqCst) - allocations, 0, "allocations in three iterations");
    });
}
