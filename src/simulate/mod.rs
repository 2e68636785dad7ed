//! Simulation of satellite images of a deterministic town, with true and disturbed RPCs and the exact DSM.
//!
//! Images are rendered by casting rays through the RPCs onto a height field; the sun direction comes from the simulator's
//! own geodesy. Affine cameras, splats and shadow models of the reconstruction are not used, so that a wrong convention
//! there becomes visible as an error against the truth.

mod cars;
mod export;
mod keyed_rng;
mod error;
mod field;
mod geodesy;
mod texture;
mod plan;
mod vegetation;
mod render;
mod sensor;
mod town;
mod truth;

use crate::frame::{Geodetic, Point, SiteGrid};
use crate::io::write_json;
use crate::progress::{Event, Progress};
use crate::rpc::{Axis, Rpc};
pub use error::SimulateError;
use keyed_rng::KeyedRng;
pub use plan::Relief;
use sensor::{Acquisition, LineScanner};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use town::Town;

/// Position of the town, east of the central meridian of its UTM zone, so that grid north and true north differ by 1.7°.
const PLACE: Point<Geodetic> = Point::new(5.5, 43.3, 150.0);
/// Name of the files of the ground truth.
const TRUTH_NAME: &str = "TOWN";
/// Smallest half height range of an RPC, metres.
const RPC_HALF_HEIGHT_M: f64 = 80.0;

/// Options of [`simulate`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SimulateOptions {
    /// Seed of the random numbers; another seed gives another town.
    pub seed: u64,
    /// Number of images.
    pub views: usize,
    /// Columns and rows of every image.
    pub size_px: usize,
    /// Ground sampling distance at nadir, metres; also the cell of the exact DSM.
    pub gsd_m: f64,
    /// Height differences of the terrain.
    pub relief: Relief,
    /// Whether files of an earlier simulation in the folder are replaced.
    pub overwrite: bool,
}

impl Default for SimulateOptions {
    fn default() -> Self {
        Self { seed: 0, views: 10, size_px: 400, gsd_m: 0.5, relief: Relief::Rolling, overwrite: false }
    }
}

/// Statistics of the exact DSM.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneFigures {
    /// Mean absolute deviation of the heights from their mean, metres: the MAE of a flat prediction.
    pub mean_absolute_deviation_m: f64,
    /// Fraction of the cells that are roofs.
    pub roofs_share: f64,
    /// Fraction of the cells that are trees.
    pub trees_share: f64,
    /// Fraction of the cells that are water.
    pub water_share: f64,
    /// Height of the tallest building above the ground, metres.
    pub tallest_building_m: f64,
    /// Difference between the highest and the lowest ground, metres.
    pub relief_m: f64,
}

/// Acquisition of one simulated image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewFigures {
    /// File name without extension.
    pub name: String,
    /// Angle between the vertical and the line of sight at the ground, degrees.
    pub off_nadir_deg: f64,
    /// True azimuth of the satellite, degrees.
    pub azimuth_deg: f64,
    /// True azimuth of the sun, degrees.
    pub sun_azimuth_deg: f64,
    /// Elevation of the sun, degrees.
    pub sun_elevation_deg: f64,
    /// Acquisition time, ISO 8601 in UTC.
    pub acquired: String,
    /// Column of the delivered RPC minus that of the true RPC, pixels.
    pub d_col: f64,
    /// Row of the delivered RPC minus that of the true RPC, pixels.
    pub d_row: f64,
}

/// Result of [`simulate`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Statistics of the scene.
    pub scene: SceneFigures,
    /// The images, ordered by name.
    pub views: Vec<ViewFigures>,
    /// Path of the exact DSM.
    pub truth: PathBuf,
}

/// One acquisition and its camera.
struct SimulatedView {
    plan: Acquisition,
    true_rpc: Rpc,
}

impl SimulatedView {
    /// The camera with its pointing error, as delivered.
    fn delivered_rpc(&self) -> Rpc {
        let (d_col, d_row) = self.plan.pointing_error;
        self.true_rpc.shifted(d_col, d_row)
    }
}

/// Simulates a scene and writes it to the folder `out`: images `VIEW_nn.tif`, and the ground truth in `truth/`.
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
    check(options)?;
    prepare_folder(out, options.overwrite)?;
    let truth_folder = out.join("truth");

    progress.event(Event::Started { stage: "building the town", total: 0 });
    let map = SiteGrid::at(PLACE)?;
    let [e, n, _] = map.origin.xyz();
    let grid = SiteGrid { epsg: map.epsg, origin: Point::new(e.round(), n.round(), 0.0) };
    let extent_m = options.size_px as f64 * options.gsd_m;
    let step_m = 0.5 * options.gsd_m;
    // The margin covers the corners of oblique images, the parallax of the highest roofs, and shadows from outside.
    let half_m = ((0.82 * extent_m + 50.0) / step_m).ceil() * step_m;
    let town = Town::new(options.seed, half_m, step_m, 0.5 * extent_m, options.relief);
    let views = plan_views(options, &town, &grid)?;
    progress.event(Event::Finished);

    progress.event(Event::Started { stage: "taking images", total: views.len() as u64 });
    for (i, view) in views.iter().enumerate() {
        progress.check()?;
        let image = render_view(view, i, options, &town, &grid)?;
        let path = out.join(format!("{}.tif", view.plan.name));
        export::write_view(&path, view, options.size_px, image)?;
        let path = truth_folder.join("rpcs").join(format!("{}.json", view.plan.name));
        truth::write_rpc(&path, view, options.size_px, town.field.height_range())?;
        progress.event(Event::Advanced { done: i as u64 + 1, status: view.plan.name.clone() });
    }
    progress.event(Event::Finished);

    let truth = truth::ExactDsm::sample(&town.field, &grid, &views, options.size_px, options.gsd_m);
    truth.write(&truth_folder, TRUTH_NAME)?;
    let views: Vec<ViewFigures> = views.iter().map(view_figures).collect();
    write_json(&truth_folder.join("shifts.json"), &shifts(&views))?;
    Ok(Summary {
        scene: truth.figures(&town.plan, &grid),
        views,
        truth: truth_folder.join(format!("{TRUTH_NAME}_DSM.tif")),
    })
}

fn check(options: &SimulateOptions) -> Result<(), SimulateError> {
    let wrong = |option, found: String, expected| Err(SimulateError::Option { option, found, expected });
    if !(3..=99).contains(&options.views) {
        return wrong("--views", options.views.to_string(), "3 to 99");
    }
    if !(64..=2048).contains(&options.size_px) {
        return wrong("--size", options.size_px.to_string(), "64 to 2048 pixels");
    }
    if !(0.2..=2.0).contains(&options.gsd_m) {
        return wrong("--gsd", options.gsd_m.to_string(), "0.2 to 2 metres");
    }
    Ok(())
}

/// Creates the folder, or removes the files of an earlier simulation from it; other files are kept.
fn prepare_folder(out: &Path, overwrite: bool) -> Result<(), SimulateError> {
    let failed = |path: &Path, cause: std::io::Error| SimulateError::Folder { path: path.into(), cause };
    std::fs::create_dir_all(out).map_err(|e| failed(out, e))?;
    let entries = std::fs::read_dir(out).and_then(Iterator::collect::<Result<Vec<_>, _>>);
    let entries = entries.map_err(|e| failed(out, e))?;
    if entries.is_empty() {
        return Ok(());
    }
    if !overwrite {
        return Err(SimulateError::NotEmpty { path: out.into() });
    }
    let is_view = |name: &str, extension: &str| name.starts_with("VIEW_") && name.ends_with(extension);
    for (folder, extension) in [(out.to_path_buf(), ".tif"), (out.join("truth/rpcs"), ".json")] {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            if is_view(&entry.file_name().to_string_lossy(), extension) {
                std::fs::remove_file(entry.path()).map_err(|e| failed(&entry.path(), e))?;
            }
        }
    }
    Ok(())
}

/// Plans the acquisitions and fits their RPCs.
fn plan_views(
    options: &SimulateOptions,
    town: &Town,
    grid: &SiteGrid,
) -> Result<Vec<SimulatedView>, SimulateError> {
    let center = grid.geodetic_from_utm(grid.origin);
    let target = center.at_height(town.plan.ground_m(0.0, 0.0));
    let (low, high) = town.field.height_range();
    let height = Axis {
        offset: (0.5 * (low + high)).round(),
        scale: (0.5 * (high - low) + 20.0).ceil().max(RPC_HALF_HEIGHT_M),
    };
    let plans = sensor::acquisitions(KeyedRng::new(options.seed).key(1000), options.views, target);
    plans
        .into_iter()
        .map(|plan| {
            let scanner = LineScanner::new(target, &plan, options.size_px, options.gsd_m);
            let fitted = scanner.rpc(target, height);
            let true_rpc = fitted.map_err(|source| SimulateError::Rpc { view: plan.name.clone(), source })?;
            Ok(SimulatedView { plan, true_rpc })
        })
        .collect()
}

fn render_view(
    view: &SimulatedView,
    index: usize,
    options: &SimulateOptions,
    town: &Town,
    grid: &SiteGrid,
) -> Result<Vec<Vec<u8>>, SimulateError> {
    let rng = KeyedRng::new(options.seed).key(2000).key(index as i64);
    let sun = geodesy::sun_on_map(
        grid,
        grid.geodetic_from_utm(grid.origin).at_height(PLACE.height_m()),
        view.plan.sun,
    );
    let radiometry = render::Radiometry::new(rng.key(1), sun, view.plan.day_of_year);
    let (low, high) = town.field.height_range();
    let rays = render::ViewRays::new(&view.true_rpc, grid, options.size_px, (low - 1.0, high + 1.0))
        .map_err(|source| SimulateError::Ray { view: view.plan.name.clone(), source })?;
    let cars = cars::Cars::new(&town.plan, rng.key(2), sun);
    let colors = KeyedRng::new(options.seed).key(7);
    Ok(render::render(&town.field, &rays, Some(&cars), &radiometry, colors, rng.key(3), options.size_px))
}

fn view_figures(view: &SimulatedView) -> ViewFigures {
    let plan = &view.plan;
    ViewFigures {
        name: plan.name.clone(),
        off_nadir_deg: plan.off_nadir_deg,
        azimuth_deg: plan.azimuth_deg,
        sun_azimuth_deg: plan.sun.azimuth_deg,
        sun_elevation_deg: plan.sun.elevation_deg,
        acquired: plan.acquired.clone(),
        d_col: plan.pointing_error.0,
        d_row: plan.pointing_error.1,
    }
}

/// Content of `shifts.json`: for each view, the shift of the delivered RPC, (column, row) in pixels.
fn shifts(views: &[ViewFigures]) -> std::collections::BTreeMap<&str, [f64; 2]> {
    views.iter().map(|v| (v.name.as_str(), [v.d_col, v.d_row])).collect()
}

#[cfg(test)]
mod tests;
