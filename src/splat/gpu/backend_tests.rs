//! Whole trainings on a device, beside those of the processor.

use super::backend::GpuBackend;
use super::photographs::DevicePhotographs;
use super::tests::{camera, device, scene};
use crate::io::Grid2;
use crate::progress::NoProgress;
use crate::random::CounterRng;
use crate::splat::backend::{BackendError, CpuBackend, TrainingBackend};
use crate::splat::pinhole::{NEAREST, PinholePicture, PinholeView, PinholeViews};
use crate::splat::recipe::Recipe;
use crate::splat::splats::Splats;
use crate::splat::state::TrainingState;
use crate::splat::train::{LogLine, Schedule, train};
use std::sync::Arc;

const SIZE: (usize, usize) = (48, 40);
/// PSNR of trainings on different devices differs by less, dB: without growth, and with it, where differences of rounding grow into other
/// populations.
const PSNR_TOLERANCE: [f64; 2] = [0.1, 0.5];
/// What ends a training early.
const STOP: BackendError = BackendError::NoView { view: 0, views: 0 };

/// Views of random splats, of which some pixels are empty.
fn views() -> Arc<Vec<PinholeView>> {
    let splats = scene(400, 1.0);
    let view = |k: usize| {
        let camera = camera(SIZE, 0.3 * k as f64);
        let picture = PinholePicture::render(&splats, &camera, NEAREST);
        PinholeView::new(format!("view {k}"), camera, &picture.colors)
    };
    Arc::new((0..5).map(view).collect())
}

/// Gray splats near the ones that the views show.
fn start() -> TrainingState {
    let mut splats = Splats::default();
    for (i, [x, y, z]) in scene(400, 1.0).position.into_iter().enumerate() {
        let mut draw = CounterRng::new(11, 0, 0, i as u64);
        let mut near = |v: f32| v + 0.2 * draw.normal() as f32;
        splats.push([near(x), near(y), near(z)], 0.4, 0.2, [0.5; 3]);
    }
    splats.f_rest.resize(splats.len(), [0.0; 45]);
    TrainingState::start(splats, Default::default(), 0, 0)
}

/// The recipe in so many iterations, with growth every few ones.
fn recipe(iterations: u32) -> Recipe {
    let recipe = Recipe::named("3dgs").unwrap().with_iterations(iterations);
    Recipe { check_every: 50, ..recipe }
}

/// Trains up to an iteration.
fn run<B: TrainingBackend>(backend: &mut B, recipe: &Recipe, until: u32, log: &mut Vec<LogLine>) {
    let schedule = Schedule {
        recipe,
        views: 5,
        half_side_m: 6.0,
        pixel_m: 0.0,
        splats_at_start: 400,
        is_gray: false,
        seed: 3,
    };
    let ended = train(
        backend,
        &schedule,
        log,
        &NoProgress,
        |done| done == until,
        |_, log| {
            if log.len() as u32 == until { Err(STOP) } else { Ok(()) }
        },
    );
    assert!(log.len() as u32 == until, "{ended:?}");
}

fn processor(views: &Arc<Vec<PinholeView>>, state: TrainingState) -> CpuBackend<PinholeViews> {
    CpuBackend::new(PinholeViews::new(views.clone(), &state), state).unwrap()
}

/// Mean PSNR over the views, dB.
fn psnr(splats: &Splats, views: &[PinholeView]) -> f64 {
    let of_view = |view: &PinholeView| {
        let picture = PinholePicture::render(splats, &view.camera, NEAREST);
        let truth = |k: usize| {
            Grid2::from_fn(SIZE.0, SIZE.1, |col, row| view.color(col, row).map_or(f32::NAN, |c| c[k]))
        };
        let squares = (0..3).flat_map(|k| {
            let pairs = picture.colors[k].data.clone().into_iter().zip(truth(k).data);
            pairs.map(|(a, b)| f64::from(a - b).powi(2)).collect::<Vec<_>>()
        });
        let squares: Vec<f64> = squares.filter(|v| v.is_finite()).collect();
        -10.0 * (squares.iter().sum::<f64>() / squares.len() as f64).log10()
    };
    views.iter().map(of_view).sum::<f64>() / views.len() as f64
}

#[test]
fn the_device_passes_its_self_test() {
    let Some(gpu) = device() else { return };
    gpu.self_test().unwrap();
}

#[test]
fn twenty_iterations_have_the_losses_of_the_processor() {
    let Some(gpu) = device() else { return };
    let (views, recipe) = (views(), recipe(300));
    let (mut found, mut expected) = (Vec::new(), Vec::new());
    run(&mut GpuBackend::new(gpu, views.clone(), start()).unwrap(), &recipe, 20, &mut found);
    run(&mut processor(&views, start()), &recipe, 20, &mut expected);
    for (a, b) in found.iter().zip(&expected) {
        assert!((a.loss - b.loss).abs() < 1e-4 * b.loss, "{}: {} {}", a.iteration, a.loss, b.loss);
        assert!((a.column("opacity") - b.column("opacity")).abs() < 1e-5, "{}", a.iteration);
    }
}

#[test]
fn a_training_is_as_good_as_that_of_the_processor() {
    if device().is_none() {
        return;
    }
    let views = views();
    let before = psnr(&start().splats, &views);
    for (grows, tolerance) in [false, true].into_iter().zip(PSNR_TOLERANCE) {
        let recipe = recipe(300);
        let recipe = Recipe { densification: recipe.densification.filter(|_| grows), ..recipe };
        let (mut log, mut of_processor) = (Vec::new(), Vec::new());
        let mut device = GpuBackend::new(device().unwrap(), views.clone(), start()).unwrap();
        let mut processor = processor(&views, start());
        run(&mut device, &recipe, 300, &mut log);
        run(&mut processor, &recipe, 300, &mut of_processor);
        let (a, b) = (device.snapshot().unwrap(), processor.snapshot().unwrap());
        let (found, expected) = (psnr(&a.splats, &views), psnr(&b.splats, &views));
        assert!((found - expected).abs() < tolerance, "growth {grows}: {found} dB, {expected} dB");
        assert!(found > before + 5.0 && a.fits(0) && a.adam.steps == 300);
        assert!(a.splats.len() > 400 || !grows);
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_also_when_lists_turn_out_too_long_and_after_a_checkpoint() {
    if device().is_none() {
        return;
    }
    let (views, recipe) = (views(), recipe(120));
    let trained = |pairs: Option<u32>, stop: Option<u32>| {
        let mut log = Vec::new();
        let gpu = device().unwrap();
        let photographs = DevicePhotographs::new(&gpu, views.clone()).unwrap();
        let mut backend = GpuBackend::with_room(gpu, photographs, start(), pairs).unwrap();
        if let Some(stop) = stop {
            run(&mut backend, &recipe, stop, &mut log);
            let state = backend.snapshot().unwrap().clone();
            backend = GpuBackend::new(device().unwrap(), views.clone(), state).unwrap();
        }
        run(&mut backend, &recipe, 120, &mut log);
        let losses: Vec<f64> = log.iter().map(|line| line.loss).collect();
        (backend.snapshot().unwrap().clone(), losses)
    };
    let expected = trained(None, None);
    assert!(trained(None, None) == expected, "a second time");
    assert!(trained(Some(64), None) == expected, "with little room");
    assert!(trained(None, Some(67)) == expected, "after a checkpoint");
}
