//! Training by recipe `indoor` on a level floor without texture that four cameras see.

use super::{PinholeView, PinholeViews};
use crate::io::Grid2;
use crate::perspective::PinholeCamera;
use crate::prior::{DepthKind, DepthPrior, NormalPrior, ViewPriors};
use crate::progress::NoProgress;
use crate::random::CounterRng;
use crate::splat::backend::{BackendError, CpuBackend, TrainingBackend};
use crate::splat::recipe::{Densification, PerspectiveRecipe, Recipe};
use crate::splat::splats::Splats;
use crate::splat::state::TrainingState;
use crate::splat::train::{LogLine, Schedule, train};
use glam::{DMat3, DVec2, DVec3};

const SIZE: (usize, usize) = (20, 16);

/// A camera 2 m above the floor that looks at the origin.
fn camera(x: f64, y: f64) -> PinholeCamera {
    let center = DVec3::new(x, y, 2.0);
    let forward = -center.normalize();
    let right = forward.cross(DVec3::Y).normalize();
    let cam_from_site = DMat3::from_cols(right, forward.cross(right), forward).transpose();
    let principal = DVec2::new(9.5, 7.5);
    PinholeCamera { cam_from_site, center, focal: DVec2::splat(20.0), principal, size: SIZE }
}

/// The disparities and normals of the floor.
fn priors(camera: &PinholeCamera) -> ViewPriors {
    let site_from_cam = camera.cam_from_site.transpose();
    let disparity = |col: usize, row: usize| {
        let at = (DVec2::new(col as f64, row as f64) - camera.principal) / camera.focal;
        let sight = site_from_cam * at.extend(1.0);
        (3.0 - 5.0 * sight.z / camera.center.z) as f32
    };
    let depth = DepthPrior { values: Grid2::from_fn(SIZE.0, SIZE.1, disparity), kind: DepthKind::Disparity };
    let up = camera.cam_from_site * DVec3::Z;
    let planes = up.to_array().map(|v| Grid2::from_fn(SIZE.0, SIZE.1, |_, _| v as f32));
    ViewPriors { depth: Some(depth), normal: Some(NormalPrior { planes }) }
}

/// Discs in the floor, each up to 10 cm above or below it, and one behind the cameras.
fn discs() -> Splats {
    let mut splats = Splats::default();
    for i in 0..121 {
        let [x, y] = [i % 11, i / 11].map(|k| 0.24 * (k as f32 - 5.0));
        let z = 0.2 * CounterRng::new(4, 0, 0, i as u64).uniform() as f32 - 0.1;
        splats.push([x, y, z], 0.13, 0.9, [0.5; 3]);
    }
    splats.push([0.0, 0.0, 10.0], 0.13, 0.9, [0.5; 3]);
    splats.flatten();
    splats.f_rest.resize(splats.len(), [0.0; 45]);
    splats
}

/// Trains from the discs; returns the final state and the log.
fn trained(recipe: &Recipe, threads: usize) -> (TrainingState, Vec<LogLine>) {
    let gray = Grid2::from_fn(SIZE.0, SIZE.1, |_, _| 0.5);
    let gray = [gray.clone(), gray.clone(), gray];
    let cameras = [camera(0.7, 0.6), camera(-0.6, 0.5), camera(0.4, -0.8), camera(-0.5, -0.6)];
    let view =
        |camera: PinholeCamera| PinholeView::new("v".into(), camera, &gray).with_priors(priors(&camera));
    let state = TrainingState::start(discs(), Default::default(), 0, 0);
    let views = PinholeViews::new(cameras.map(view).to_vec().into(), &state);
    let mut backend = CpuBackend::new(views, state).unwrap();
    let schedule = Schedule {
        recipe,
        views: cameras.len(),
        half_side_m: 1.0,
        pixel_m: 0.1,
        splats_at_start: discs().len(),
        is_gray: false,
        seed: 3,
    };
    let mut log = Vec::new();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let no_callback = |_: &mut CpuBackend<PinholeViews>, _: &[LogLine]| Ok::<_, BackendError>(());
        train(&mut backend, &schedule, &mut log, &NoProgress, |_| false, no_callback)
    })
    .unwrap();
    (backend.snapshot().unwrap().clone(), log)
}

/// The recipe with fast positions and priors from the start.
fn recipe(iterations: u32) -> Recipe {
    let indoor = Recipe::named("indoor").unwrap().of_kind::<PerspectiveRecipe>().unwrap();
    let kind = PerspectiveRecipe { last_position_rate: 3e-3, priors_from: 0, normals_from: 0, ..indoor.kind };
    let mut recipe = Recipe { iterations, kind, ..indoor };
    recipe.rates.position = 3e-3;
    recipe.of_any()
}

#[test]
fn discs_of_a_floor_without_texture_move_towards_the_priors() {
    let (state, log) = trained(&recipe(60), 2);
    let disagreement = |lines: &[LogLine]| {
        lines.iter().map(|line| line.column("depth_prior")).sum::<f64>() / lines.len() as f64
    };
    let [before, after] = [&log[..4], &log[56..]].map(disagreement);
    assert!(before > 0.0 && after < 0.5 * before, "{before} and {after}");
    let unevenness = |splats: &Splats| {
        let of_floor = splats.position.iter().filter(|p| p[2] < 5.0 && p[0].abs().max(p[1].abs()) < 0.8);
        let (count, sum) = of_floor.fold((0, 0.0), |(n, sum), p| (n + 1, sum + f64::from(p[2]).powi(2)));
        (sum / f64::from(count)).sqrt()
    };
    let [before, after] = [&discs(), &state.splats].map(unevenness);
    assert!(after < 0.7 * before, "{before} and {after} m");
}

#[test]
fn a_disc_that_no_view_shows_loses_opacity_at_the_full_learning_rate() {
    // The sum of opacities begins after two rounds of the four views.
    let (iterations, before) = (28, 8);
    let recipe = recipe(iterations);
    let (state, _) = trained(&recipe, 2);
    let hidden = state.splats.position.iter().position(|p| p[2] > 5.0).unwrap();
    let lost = discs().opacity_logit[121][0] - state.splats.opacity_logit[hidden][0];
    let expected = f64::from(iterations - before) * recipe.rates.opacity_logit;
    assert!((f64::from(lost) - expected).abs() < 0.1 * expected, "{lost} of {expected}");
}

#[test]
fn training_with_priors_and_active_growth_gives_the_same_with_1_and_2_threads() {
    let mut recipe = Recipe { check_every: 10, ..recipe(40) };
    recipe.densification = recipe.densification.map(|g| Densification {
        from: 10,
        until: 40,
        gradient: 1e-5,
        max_splats: 1000,
        ..g
    });
    let [(one, log), (two, _)] = [1, 2].map(|threads| trained(&recipe, threads));
    // `assert_eq` would print much.
    assert!(one == two, "1 and 2 threads give different states");
    let active: Vec<usize> = log.iter().map(|line| line.active).collect();
    assert!(active[8] == 0 && active[9] > 0 && active[39] > active[9], "{active:?}");
    assert!(log.iter().any(|line| line.splats > 2 * discs().len()));
}
