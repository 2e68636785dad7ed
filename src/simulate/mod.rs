//! Simulation of satellite images of a deterministic town or mountain, with true and disturbed RPCs and the exact DSM; of
//! photographs of a room and of the town from the air, with exact depths, normals and meshes.
//!
//! Images are rendered by casting rays through the RPCs onto a height field; the sun direction comes from the simulator's
//! own geodesy. Affine cameras, splats and shadow models of the reconstruction are not used, so that a wrong convention
//! there becomes visible as an error against the truth.

mod aerial;
mod appearance;
mod calendar;
mod cars;
mod export;
mod keyed_rng;
mod erosion;
mod error;
mod field;
mod folder;
mod geodesy;
mod imaging;
mod landscape;
mod mountains;
mod options;
mod texture;
mod plan;
mod perspective;
mod radiometry;
mod rays;
mod room;
mod vegetation;
mod render;
mod season;
mod sensor;
mod summary;
mod surface;
mod survey;
mod terrain;
mod town;
mod truth;
mod view;

use crate::io::write_json;
use crate::progress::{Event, Progress};
use crate::rpc::Axis;
use crate::scene::Role;
pub use aerial::{AerialOptions, simulate_aerial};
use calendar::Calendar;
pub use error::SimulateError;
use keyed_rng::KeyedRng;
use landscape::Landscape;
pub use options::{BitDepth, PlannedView, SimulateOptions};
pub use perspective::{DisparityMap, StatedCamera, TestSetSummary, TestSetView};
pub use plan::Relief;
pub use room::{RoomOptions, simulate_room};
use sensor::{Acquisition, LineScanner};
use std::path::Path;
pub use summary::{AppearanceFigures, SceneFigures, Summary, SurfaceFigures, ViewFigures};
pub use survey::covering_px;
pub use terrain::{SurfaceFiles, Terrain};
use view::SimulatedView;

/// Lowest elevation of the sun of an image, degrees.
const LOWEST_SUN_DEG: f64 = 5.0;
/// Smallest half height range of an RPC, metres.
const RPC_HALF_HEIGHT_M: f64 = 80.0;

/// Simulates a scene and writes it to the folder `out`: images `VIEW_nn.tif`, held-out images `TEST_nn.tif` that `test.txt`
/// lists, and the ground truth in `truth/`.
///
/// The same options give the same bytes for any number of threads.
///
/// # Errors
/// [`SimulateError`] if an option is outside of its range, the folder is not empty, a file cannot be written, or
/// `progress` asks to stop.
pub fn simulate(
    out: &Path,
    options: &SimulateOptions,
    progress: &dyn Progress,
) -> Result<Summary, SimulateError> {
    options.check()?;
    folder::prepare(out, options.overwrite)?;
    let truth_folder = out.join("truth");

    progress.event(Event::Started { stage: "building the ground", total: 0 });
    let (landscape, surface) = Landscape::new(options)?;
    let views = plan_views(options, &landscape)?;
    progress.event(Event::Finished);

    progress.event(Event::Started { stage: "taking images", total: views.len() as u64 });
    let studio = imaging::Studio { options, landscape: &landscape };
    let mut figures = Vec::new();
    for (i, view) in views.iter().enumerate() {
        progress.check()?;
        figures.push(studio.take(out, &truth_folder, view)?);
        progress.event(Event::Advanced { done: i as u64 + 1, status: view.plan.name.clone() });
    }
    progress.event(Event::Finished);

    let held_out: Vec<_> = figures.iter().filter(|v| v.role == Role::Test).map(|v| v.name.as_str()).collect();
    export::write_test_list(out, &held_out)?;
    let truth = truth::ExactDsm::sample(&landscape, &views, options.size_px, options.gsd_m);
    let truth_name = options.terrain.truth_name();
    truth.write(&truth_folder, truth_name, options.terrain.has_classes())?;
    write_json(&truth_folder.join("shifts.json"), &shifts(&figures))?;
    if options.has_appearance_truth() {
        appearance::write_list(&truth_folder.join(folder::APPEARANCE), &figures)?;
    }
    Ok(Summary {
        scene: truth.figures(&landscape),
        surface,
        views: figures,
        truth: truth_folder.join(format!("{truth_name}_DSM.tif")),
    })
}

/// Plans the acquisitions and fits their RPCs; held-out views come last.
fn plan_views(options: &SimulateOptions, landscape: &Landscape) -> Result<Vec<SimulatedView>, SimulateError> {
    let target = landscape.center.at_height(landscape.ground_m(0.0, 0.0));
    let (low, high) = landscape.field.height_range();
    let height = Axis {
        offset: (0.5 * (low + high)).round(),
        scale: (0.5 * (high - low) + 20.0).ceil().max(RPC_HALF_HEIGHT_M),
    };
    let rng = KeyedRng::new(options.seed);
    let calendar = if options.seasons { Calendar::Seasons } else { Calendar::Mild };
    let training = match options.planned.as_slice() {
        [] => sensor::acquisitions(rng.key(1000), calendar, options.views, target),
        planned => sensor::planned(rng.key(1000), calendar, planned, target)?,
    };
    if let Some(dark) = training.iter().find(|view| view.sun.elevation_deg < LOWEST_SUN_DEG) {
        let Acquisition { acquired, sun, .. } = dark.clone();
        return Err(SimulateError::Night { acquired, elevation_deg: sun.elevation_deg });
    }
    let held_out = sensor::held_out(rng.key(1001), calendar, &training, options.held_out, target);
    let view = |plan: Acquisition, role, rng| {
        let scanner = LineScanner::new(target, &plan, options.size_px, options.gsd_m);
        let fitted = scanner.rpc(target, height);
        let true_rpc = fitted.map_err(|source| SimulateError::Rpc { view: plan.name.clone(), source })?;
        Ok(SimulatedView { plan, role, true_rpc, rng })
    };
    let numbered =
        |(i, plan): (usize, Acquisition), role, key: i64| view(plan, role, rng.key(key).key(i as i64));
    let training = training.into_iter().enumerate().map(|plan| numbered(plan, Role::Train, 2000));
    let held_out = held_out.into_iter().enumerate().map(|plan| numbered(plan, Role::Test, 2001));
    training.chain(held_out).collect()
}

/// Content of `shifts.json`: for each view, the shift of the delivered RPC, (column, row) in pixels.
fn shifts(views: &[ViewFigures]) -> std::collections::BTreeMap<&str, [f64; 2]> {
    views.iter().map(|v| (v.name.as_str(), [v.d_col, v.d_row])).collect()
}

#[cfg(test)]
mod tests;
