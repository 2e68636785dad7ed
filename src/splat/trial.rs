//! Short trainings that try out a device or measure how fast it is, and a small satellite scene with splats at random places for
//! them.

use crate::affine::{TrainingView, ViewCamera};
use crate::io::Grid2;
use crate::random::CounterRng;
use crate::splat::appearance::AppearanceKind;
use crate::splat::appearance::satgs::Cube;
use crate::splat::loss::TermInputs;
use crate::splat::recipe::{Recipe, RecipeKind};
use crate::splat::satellite::SatelliteScene;
use crate::splat::splats::Splats;
use crate::splat::state::TrainingState;
use crate::splat::train::Schedule;
use std::sync::Arc;

/// Pixels a metre of the view.
const PIXELS_PER_M: f64 = 8.0;

/// A built-in recipe for so many iterations; satellite views have shadows and virtual views from the first on. None if there is no such
/// recipe.
#[must_use]
pub fn trial_recipe(name: &str, iterations: u32) -> Option<Recipe> {
    let mut recipe = Recipe::named(name)?.with_iterations(iterations);
    if let RecipeKind::Satellite(satellite) = &mut recipe.kind {
        satellite.shadows_from = 0;
    }
    Some(recipe)
}

/// The training of one view by a recipe, from so many splats.
#[must_use]
pub fn trial_schedule(recipe: &Recipe, splats: u64) -> Schedule<'_> {
    Schedule {
        recipe,
        views: 1,
        half_side_m: 3.0,
        pixel_m: 0.0,
        splats_at_start: splats as usize,
        is_gray: false,
        seed: 0,
    }
}

/// A view of the ground from the south, of `size` columns and rows, with a sun in the west.
#[must_use]
pub fn trial_scene(size: (usize, usize)) -> SatelliteScene {
    let center = [size.0, size.1].map(|n| 0.5 * (n as f64 - 1.0));
    let rays = [[PIXELS_PER_M, 0.0, 1.0], [0.0, -PIXELS_PER_M, 3.0]];
    let plane = |k: usize| {
        Grid2::from_fn(size.0, size.1, |col, row| ((col * (k + 2) + row * 3) % 29) as f32 / 40.0 + 0.1)
    };
    let half_side = 1.5 * size.0.max(size.1) as f64 / PIXELS_PER_M;
    let area = (-half_side, -half_side, half_side, half_side);
    let (camera, bands) = (ViewCamera::affine(rays, center), [0, 1, 2].map(plane));
    let view = TrainingView::new("pattern".into(), camera, Some([4.0, -1.0]), &bands, area, (0.0, 0.0));
    SatelliteScene {
        views: Arc::new(vec![view]),
        altitudes: (-2.0, 2.0),
        inputs: TermInputs::default(),
        appearance: AppearanceKind::Affine,
        cube: Cube::default(),
        visibility: None,
    }
}

/// The start of a training of [`trial_scene`]: so many splats of several colours near the ground, most of which its view shows.
#[must_use]
pub fn trial_start(size: (usize, usize), splats: u64) -> TrainingState {
    let [across, along] = [size.0, size.1].map(|n| n as f64 / PIXELS_PER_M / 3.0);
    let mut start = Splats::default();
    for i in 0..splats {
        let mut draw = CounterRng::new(2, 0, 0, i);
        let [x, y, z] = [across, along, 0.3].map(|by| (by * draw.normal()) as f32);
        let color = [0; 3].map(|_| draw.uniform() as f32);
        start.push([x, y, z], 0.1 + 0.3 * draw.uniform() as f32, 0.2 + 0.7 * draw.uniform() as f32, color);
    }
    TrainingState::start(start, AppearanceKind::Affine, 1, 0)
}
