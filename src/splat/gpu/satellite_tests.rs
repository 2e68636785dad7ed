//! Trainings of satellite scenes on a device, beside those of the processor. As learning rates of zero leave everything but the moments
//! as it was, the first moments after one iteration are a tenth of the gradient on both.

use super::backend::GpuBackend;
use super::satellites::DeviceSatellites;
use super::submission::submit;
use super::tests::{device, plan};
use super::views::DeviceViews;
use crate::affine::{TrainingView, ViewCamera};
use crate::frame::{Point, SiteGrid};
use crate::io::{Grid2, MapGrid};
use crate::mvs::MatchedSurface;
use crate::progress::NoProgress;
use crate::random::CounterRng;
use crate::scene::TransferFunction;
use crate::splat::anchored::{Anchoring, StartSplats};
use crate::splat::appearance::AppearanceKind;
use crate::splat::appearance::satgs::Cube;
use crate::splat::backend::{BackendError, CpuBackend, StepPlan, StepReport, TrainingBackend, Wait};
use crate::splat::loss::{LossWeights, Prior, TermInputs, column_names};
use crate::splat::recipe::{Densification, Recipe, RecipeKind};
use crate::splat::satellite::{NovelView, SatelliteScene, SatelliteViews};
use crate::splat::splats::{GROUP_INFO, Splats};
use crate::splat::state::TrainingState;
use crate::splat::train::{LogLine, Schedule, train};
use std::sync::Arc;

const ALTITUDES: (f64, f64) = (-3.0, 12.0);
/// Sun of all views, pixels per metre of altitude.
const SUN: [f64; 2] = [1.1, -0.8];
/// Half of the side of the town, metres, and its pixels.
const HALF_SIDE_M: f64 = 16.0;
const PIXEL_M: f64 = 0.5;
const VIEWS: usize = 4;
/// Pixels of a side: the second size is no multiple of a tile.
const SIDES: [usize; 2] = [64, 57];
/// Largest difference of a group of first moments in norm, relative to its length.
const GRADIENT_TOLERANCE: f64 = 1e-3;
/// Largest relative difference of a term of the loss.
const LOSS_TOLERANCE: f64 = 1e-4;
/// Largest difference of the mean errors of heights.
const HEIGHT_TOLERANCE_M: f64 = 0.02;
/// What ends a training early.
const STOP: BackendError = BackendError::NoView { view: 0, views: 0 };

/// Height of the town: two flat roofs on level ground.
fn height(x: f64, y: f64) -> f64 {
    match (x, y) {
        (-10.0..-3.0, -7.0..6.0) => 6.0,
        (2.0..10.0, -9.0..-1.0) => 3.5,
        _ => 0.0,
    }
}

fn color(x: f64, y: f64) -> [f32; 3] {
    let wave = |k: f64| (0.35 + 0.2 * (0.9 * x + k).sin() * (0.7 * y - k).cos()) as f32;
    [wave(0.0), wave(1.0), wave(2.0)]
}

/// Splats on the town, whose distance is a part of the tile of a pixel.
fn town(spacing: f64, each: impl Fn(f64, f64, &mut CounterRng) -> ([f32; 3], f32, f32, [f32; 3])) -> Splats {
    let (mut out, count) = (Splats::default(), (2.0 * HALF_SIDE_M / spacing) as usize);
    for k in 0..count * count {
        let mut draw = CounterRng::new(3, 0, 0, k as u64);
        let [x, y] = [k % count, k / count].map(|i| (i as f64 + 0.5) * spacing - HALF_SIDE_M);
        let (position, scale, opacity, color) = each(x, y, &mut draw);
        out.push(position, scale, opacity, color);
    }
    out
}

fn truth() -> Splats {
    town(0.45, |x, y, _| ([x as f32, y as f32, height(x, y) as f32], 0.3, 0.95, color(x, y)))
}

/// Splats near the town's surface; one in nine is anchored to the one before it.
fn start() -> StartSplats {
    let mut splats = town(0.8, |x, y, draw| {
        let mut near = |v: f64, by: f64| (v + by * draw.normal()) as f32;
        ([near(x, 0.1), near(y, 0.1), near(height(x, y), 0.5)], 0.45, 0.6, [0.4; 3])
    });
    let shapes = splats.log_scale.iter_mut().zip(&mut splats.rotation).zip(&mut splats.f_dc);
    for (i, ((log_scale, rotation), f_dc)) in shapes.enumerate() {
        let mut draw = CounterRng::new(8, 0, 0, i as u64);
        *log_scale = log_scale.map(|v| v + 0.3 * draw.normal() as f32);
        *rotation = rotation.map(|_| draw.normal() as f32);
        // Where all splats have one colour, the sign of a difference is that of rounding.
        *f_dc = f_dc.map(|v| v + 0.2 * draw.normal() as f32);
    }
    let anchoring = |splat: u32| Anchoring { splat, anchor: splat - 1 - splat % 2 };
    let anchorings = (9..splats.len() as u32).step_by(9).map(anchoring);
    let is_anchored = |i: u32| i >= 9 && i.is_multiple_of(9);
    let anchorings = anchorings.filter(|a| !is_anchored(a.anchor)).collect();
    StartSplats { splats, anchorings }
}

fn camera(k: usize, side: usize) -> ViewCamera {
    let (tilt, scale) = (0.25 * (k as f64 - 1.2), 1.0 / PIXEL_M);
    let linear = [[scale, 0.02, scale * tilt], [0.01, -scale, 0.3 - 0.5 * tilt]];
    let bend = 2e-4 * (k as f64 + 1.0);
    let quadratic = [[bend, -bend, 0.5 * bend, 0.0, bend, bend], [0.0, bend, -bend, 0.5 * bend, bend, -bend]];
    let middle = 0.5 * (side as f64 - 1.0);
    ViewCamera { quadratic, ..ViewCamera::affine(linear, [middle, middle]) }
}

/// Views of the town with shadows, of which some pixels have no data; the last has no sun.
fn views(side: usize) -> Arc<Vec<TrainingView>> {
    let splats = truth();
    let view = |k: usize| {
        let (camera, sun_shear) = (camera(k, side), (k + 1 < VIEWS).then_some(SUN));
        let appearance = crate::splat::appearance::Appearance::start(AppearanceKind::Affine, 0, k as u64);
        let from = NovelView { camera, size: (side, side), sun_shear };
        let picture = from.picture(&splats, &appearance, ALTITUDES);
        let transfer_function = TransferFunction::new(2.2).unwrap();
        let stored = |band: &Grid2| {
            Grid2::from_fn(side, side, |col, row| match (5 * col + 3 * row + k) % 61 {
                0 => f32::NAN,
                _ => transfer_function.encoded(band.at(col, row).clamp(0.0, 1.0)),
            })
        };
        let bands = picture.colors.each_ref().map(stored);
        let half = HALF_SIDE_M + 4.0;
        let area = (-half, -half, half, half);
        TrainingView::new(format!("view {k}"), camera, sun_shear, &bands, area, (0.0, 6.0))
            .with_transfer_function(transfer_function)
    };
    Arc::new((0..VIEWS).map(view).collect())
}

/// The town's surface, whose weight is zero in a part of it.
fn prior() -> Arc<Prior> {
    let site = SiteGrid { epsg: 32617, origin: Point::new(1000.0, 2000.0, 10.0) };
    let (cells, cell) = (30, 1.0);
    let (west, north) = (site.origin.x() - 15.0, site.origin.y() + 15.0);
    let grid = MapGrid { epsg: 32617, west, north, cell, width: cells, height: cells };
    let at = |col: usize, row: usize| (col as f64 - 14.5, 14.5 - row as f64);
    let altitude = Grid2::from_fn(cells, cells, |col, row| {
        let (x, y) = at(col, row);
        height(x, y) as f32
    });
    let prior_weight =
        Grid2::from_fn(cells, cells, |col, row| if col < 4 { 0.0 } else { 0.1 * (row % 10) as f32 });
    Arc::new(Prior::new(&MatchedSurface { site, grid, score: altitude.clone(), altitude, prior_weight }))
}

fn scene(views: &Arc<Vec<TrainingView>>) -> SatelliteScene {
    SatelliteScene {
        views: views.clone(),
        altitudes: ALTITUDES,
        inputs: TermInputs { prior: Some(prior()), lpips: None },
        appearance: AppearanceKind::Affine,
        cube: Cube::default(),
        visibility: None,
    }
}

fn state() -> TrainingState {
    let mut state = TrainingState::start(start(), AppearanceKind::Affine, VIEWS, 0);
    for (k, (appearance, _)) in state.appearances.iter_mut().enumerate() {
        let mut draw = CounterRng::new(5, 0, 0, k as u64);
        appearance.values.iter_mut().for_each(|v| *v += 0.1 * draw.uniform() as f32);
    }
    state
}

fn on_processor(views: &Arc<Vec<TrainingView>>, state: TrainingState) -> CpuBackend<SatelliteViews> {
    CpuBackend::new(SatelliteViews::new(scene(views), &state), state).unwrap()
}

fn on_device(views: &Arc<Vec<TrainingView>>, state: TrainingState) -> GpuBackend<DeviceSatellites> {
    GpuBackend::of_satellites(device().unwrap(), scene(views), state).unwrap()
}

/// The iteration of a plan: its report, and the state after it.
fn after(backend: &mut impl TrainingBackend, plan: &StepPlan) -> (StepReport, TrainingState) {
    let mut reports = Vec::new();
    backend.submit(plan).unwrap();
    backend.reports(Wait::ForAll, &mut reports).unwrap();
    (reports[0], backend.snapshot().unwrap().clone())
}

/// Difference of two vectors, relative to the second.
fn difference(found: &[f32], expected: &[f32]) -> f64 {
    let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>().sqrt();
    let off = norm(&mut found.iter().zip(expected).map(|(a, b)| f64::from(a - b)));
    off / norm(&mut expected.iter().map(|v| f64::from(*v))).max(1e-30)
}

fn weights() -> LossWeights {
    let named = [
        ("opacity", 0.1),
        ("consistency_altitude", 0.3),
        ("consistency_color", 0.4),
        ("shadow_entropy", 0.2),
        ("surface_prior", 0.5),
    ];
    LossWeights::of(&named).unwrap()
}

#[test]
fn losses_and_gradients_of_satellite_views_are_those_of_the_processor() {
    if device().is_none() {
        return;
    }
    let eogs = LossWeights::of(&[("opacity", 0.1)]).unwrap();
    let shaded = LossWeights::of(&[("opacity", 0.1), ("shadow_entropy", 0.2)]).unwrap();
    let virtual_shear = Some([0.011, -0.008]);
    let base = StepPlan { opacity_divisor: Some(1000), ..plan(eogs) };
    let plans = [
        ("view", base.clone()),
        ("half resolution", StepPlan { level: 1, view: 1, ..base.clone() }),
        ("sun", StepPlan { shadows: true, weights: shaded, ..base.clone() }),
        ("no sun known", StepPlan { shadows: true, view: VIEWS - 1, weights: shaded, ..base.clone() }),
        ("all", StepPlan { shadows: true, virtual_shear, weights: weights(), view: 2, ..base.clone() }),
        (
            "all at half resolution",
            StepPlan { shadows: true, virtual_shear, weights: weights(), level: 1, ..base },
        ),
    ];
    for side in SIDES {
        let views = views(side);
        for (name, plan) in &plans {
            let (expected, of_processor) = after(&mut on_processor(&views, state()), plan);
            let (found, of_device) = after(&mut on_device(&views, state()), plan);
            let (a, b) = (found.losses, expected.losses);
            let near = |a: f64, b: f64| (a - b).abs() <= LOSS_TOLERANCE * b.abs().max(1e-3);
            assert!(near(a.total, b.total), "{name}, {side}: {} {}", a.total, b.total);
            for ((a, b), column) in a.columns.iter().zip(b.columns).zip(column_names()) {
                assert!(near(*a, b), "{name}, {side}: {column} {a} {b}");
            }
            let groups = of_device.adam.first.groups().into_iter().zip(of_processor.adam.first.groups());
            for ((found, expected), info) in groups.zip(GROUP_INFO) {
                let off = difference(found, expected);
                assert!(off <= GRADIENT_TOLERANCE, "{name}, {side}: {} {off:e}", info.name);
            }
            let colors = |state: &TrainingState| state.appearances[plan.view].1.parts().0.to_vec();
            let off = difference(&colors(&of_device), &colors(&of_processor));
            assert!(off <= GRADIENT_TOLERANCE, "{name}, {side}: colour model {off:e}");
            let sums =
                |state: &TrainingState| state.statistics.sums().map(|(sum, _)| sum).collect::<Vec<_>>();
            let off = difference(&sums(&of_device), &sums(&of_processor));
            assert!(off <= GRADIENT_TOLERANCE, "{name}, {side}: statistics {off:e}");
            let seen = |state: &TrainingState| state.statistics.sums().map(|(_, views)| views).sum::<u32>();
            // Where an ellipse passes between pixels at the border, the processor may count it.
            let (a, b) = (seen(&of_device), seen(&of_processor));
            assert!(100 * a.abs_diff(b) <= b, "{name}, {side}: {a} {b}");
        }
    }
}

/// A recipe of so many iterations with shadows, virtual views and checks among them; half resolution at first.
fn recipe(name: &str, iterations: u32, shadows_from: u32) -> Recipe {
    let mut recipe = Recipe::named(name).unwrap().with_iterations(iterations);
    let RecipeKind::Satellite(satellite) = &mut recipe.kind else { unreachable!() };
    (satellite.shadows_from, satellite.half_resolution_until) = (shadows_from, 10);
    let densification = recipe.densification.map(|g| Densification { from: 20, max_splats: 2400, ..g });
    Recipe { check_every: 25, densification, ..recipe }
}

/// Trains up to an iteration.
fn run<B: TrainingBackend>(backend: &mut B, recipe: &Recipe, until: u32, log: &mut Vec<LogLine>) {
    let schedule = Schedule {
        recipe,
        views: VIEWS,
        half_side_m: HALF_SIDE_M,
        pixel_m: 0.4,
        splats_at_start: 1600,
        is_gray: false,
        seed: 3,
    };
    let ended = train(
        backend,
        &schedule,
        log,
        &NoProgress,
        |done| done == until,
        |_, log| if log.len() as u32 == until { Err(STOP) } else { Ok(()) },
    );
    assert!(log.len() as u32 == until, "{ended:?}");
}

#[test]
fn twenty_iterations_of_every_satellite_recipe_have_the_losses_of_the_processor() {
    if device().is_none() {
        return;
    }
    let views = views(SIDES[1]);
    for name in ["eogs", "baeogs", "best"] {
        let recipe = recipe(name, 300, 12);
        let (mut found, mut expected) = (Vec::new(), Vec::new());
        run(&mut on_device(&views, state()), &recipe, 20, &mut found);
        run(&mut on_processor(&views, state()), &recipe, 20, &mut expected);
        for (a, b) in found.iter().zip(&expected) {
            assert!((a.loss - b.loss).abs() < 1e-3 * b.loss, "{name} {}: {} {}", a.iteration, a.loss, b.loss);
        }
    }
}

/// Mean error of the heights that splats show from above, metres.
fn height_error(splats: &Splats) -> f64 {
    let side = SIDES[0];
    let middle = 0.5 * (side as f64 - 1.0);
    let above = ViewCamera::affine([[1.0 / PIXEL_M, 0.0, 0.0], [0.0, -1.0 / PIXEL_M, 0.0]], [middle; 2]);
    let from = NovelView { camera: above, size: (side, side), sun_shear: None };
    let altitude = from.picture(splats, &Default::default(), ALTITUDES).altitude;
    let inner = 4..side - 4;
    let cells = inner.clone().flat_map(|row| inner.clone().map(move |col| (col, row)));
    let errors = cells.map(|(col, row)| {
        let (x, y) = ((col as f64 - middle) * PIXEL_M, (middle - row as f64) * PIXEL_M);
        (f64::from(altitude.at(col, row)) - height(x, y)).abs()
    });
    let errors: Vec<f64> = errors.filter(|e| e.is_finite()).collect();
    errors.iter().sum::<f64>() / errors.len() as f64
}

#[test]
fn a_town_is_as_accurate_as_that_of_the_processor() {
    if device().is_none() {
        return;
    }
    let views = views(SIDES[0]);
    let before = height_error(&state().splats);
    let recipe = recipe("best", 300, 60);
    let (mut device, mut processor) = (on_device(&views, state()), on_processor(&views, state()));
    let (mut log, mut of_processor) = (Vec::new(), Vec::new());
    run(&mut device, &recipe, 300, &mut log);
    run(&mut processor, &recipe, 300, &mut of_processor);
    let (a, b) = (device.snapshot().unwrap(), processor.snapshot().unwrap());
    let (found, expected) = (height_error(&a.splats), height_error(&b.splats));
    assert!((found - expected).abs() < HEIGHT_TOLERANCE_M, "{found} m, {expected} m");
    assert!(found < 0.9 * before && a.fits(VIEWS) && a.adam.steps == 300, "{before} m, {found} m");
    assert!(a.splats.len() != state().splats.len(), "splats have grown or were pruned");
}

#[test]
fn the_same_seed_gives_the_same_satellite_scene_also_with_little_room_and_after_a_checkpoint() {
    if device().is_none() {
        return;
    }
    let (views, recipe) = (views(SIDES[1]), recipe("best", 60, 12));
    let trained = |pairs: Option<u32>, stop: Option<u32>| {
        let (gpu, mut log) = (device().unwrap(), Vec::new());
        let satellites = DeviceSatellites::new(&gpu, scene(&views)).unwrap();
        let mut backend = GpuBackend::with_room(gpu, satellites, state(), pairs).unwrap();
        if let Some(stop) = stop {
            run(&mut backend, &recipe, stop, &mut log);
            let state = backend.snapshot().unwrap().clone();
            backend = on_device(&views, state);
        }
        run(&mut backend, &recipe, 60, &mut log);
        let losses: Vec<f64> = log.iter().map(|line| line.loss).collect();
        (backend.snapshot().unwrap().clone(), losses)
    };
    let expected = trained(None, None);
    assert!(trained(None, None) == expected, "a second time");
    assert!(trained(Some(64), None) == expected, "with little room");
    assert!(trained(None, Some(37)) == expected, "after a checkpoint");
}

#[test]
fn a_device_goes_on_where_the_processor_stopped_and_the_other_way_round() {
    if device().is_none() {
        return;
    }
    let (views, recipe) = (views(SIDES[1]), recipe("best", 100, 20));
    let mut expected = Vec::new();
    run(&mut on_processor(&views, state()), &recipe, 40, &mut expected);
    let (mut first, mut second) = (Vec::new(), Vec::new());
    let mut processor = on_processor(&views, state());
    run(&mut processor, &recipe, 20, &mut first);
    run(&mut on_device(&views, processor.snapshot().unwrap().clone()), &recipe, 40, &mut first);
    let mut device = on_device(&views, state());
    run(&mut device, &recipe, 20, &mut second);
    run(&mut on_processor(&views, device.snapshot().unwrap().clone()), &recipe, 40, &mut second);
    for log in [first, second] {
        for (a, b) in log.iter().zip(&expected) {
            assert!((a.loss - b.loss).abs() < 5e-3 * b.loss, "{}: {} {}", a.iteration, a.loss, b.loss);
        }
    }
}

#[test]
fn values_that_are_not_finite_reach_no_other_splat_of_a_satellite_scene() {
    let Some(gpu) = device() else { return };
    let views = views(SIDES[1]);
    let mut broken = state();
    let sick = [30, 500, 801, 1200];
    broken.splats.position[sick[0]] = [f32::NAN; 3];
    broken.splats.log_scale[sick[1]] = [f32::INFINITY; 3];
    broken.splats.rotation[sick[2]] = [f32::NAN; 4];
    broken.splats.opacity_logit[sick[3]] = [f32::NAN];
    broken.anchored = Default::default();
    let plan =
        StepPlan { shadows: true, virtual_shear: Some([0.01, 0.01]), weights: weights(), ..plan(weights()) };
    let mut satellites = DeviceSatellites::new(&gpu, scene(&views)).unwrap();
    let step = super::tests::step(&gpu, &mut satellites, &mut broken, &plan, 100_000);
    let sound = (0..step.gradient.len()).filter(|i| !sick.contains(i));
    assert!(sound.clone().all(|i| step.gradient.position[i].iter().all(|v| v.is_finite())));
    for frame in satellites.frames() {
        let pixels = gpu.read_numbers(frame, 4 * SIDES[1] * SIDES[1]).unwrap();
        assert!(pixels.iter().all(|v| v.is_finite()));
    }
}

#[test]
fn scenes_without_splats_train() {
    let Some(gpu) = device() else { return };
    let views = views(SIDES[1]);
    let mut nothing = TrainingState::start(Splats::default(), AppearanceKind::Affine, VIEWS, 0);
    let plan =
        StepPlan { shadows: true, virtual_shear: Some([0.01, 0.01]), weights: weights(), ..plan(weights()) };
    let mut satellites = DeviceSatellites::new(&gpu, scene(&views)).unwrap();
    let arrays =
        satellites.arrays(&gpu, super::splats::DeviceSplats::new(&gpu, 0, false).unwrap(), 1).unwrap();
    let uniform = satellites.uniform(&mut nothing, &plan, 1);
    let report = gpu.staging(super::arrays::REPORT as u64);
    submit(&gpu, &satellites, (&arrays, &uniform), &report);
    gpu.wait().unwrap();
    let floor = gpu.read_numbers(satellites.frames()[0], 4 * SIDES[1] * SIDES[1]).unwrap();
    assert!(floor.as_chunks::<4>().0.iter().all(|pixel| pixel[3] == ALTITUDES.0 as f32));
}
