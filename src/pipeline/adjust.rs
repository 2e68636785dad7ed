//! Bundle adjustment of a scene into a run folder: `satgs ba`.

use super::datum::warn_of_shift;
use super::report::renew_report;
use super::run_folder::scene_fingerprint::scene_fingerprint;
use super::run_folder::stage::{Fingerprint, Stage, hash, hash_file, or_none};
use super::run_folder::tiled::require_no_tile;
use super::{PipelineError, RunLock, outdated, read_scene, relocation};
use crate::bundle::{
    self, Adjustment, BundleOptions, ControlPoint, CorrectionModel, HeightPrior, LeftOut, Report,
    SparsePoint, check_control, delivered_control_pairs, read_control, stated_accuracy_m,
};
use crate::checkpoint::PartStore;
use crate::coregister::{CoregisterError, Shift, to_control};
use crate::fault::ErrorKind;
use crate::frame::SiteGrid;
use crate::io::{VerticalReference, write_json};
use crate::progress::{Event, Progress};
use crate::run_files::{ADJUSTMENT, ADJUSTMENT_REPORT, MATCHING, SCENE, SPARSE_POINTS};
use crate::scene::{self, HeightSource, Scene, SearchedHeights};
use crate::stats::quantile;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// How to adjust.
#[derive(Clone, Debug, Default)]
pub struct AdjustOptions {
    /// What is corrected in each camera.
    pub model: CorrectionModel,
    /// Do not correct the cameras: compute tie points, and report how well the cameras agree.
    pub fixed: bool,
    /// Lowest and highest height to search, metres above the ellipsoid; by default from the metadata of the images, else from the RPCs.
    pub height_range: Option<(f64, f64)>,
    /// An elevation model that gives the heights to search, instead of `height_range`.
    pub dem: Option<DemOptions>,
    /// A CSV file of ground control points, which then define the datum.
    pub gcps: Option<PathBuf>,
    /// Names of reference views: their cameras are not corrected and define the datum.
    pub reference_views: Vec<String>,
    /// Adjust again, and replace results in the run folder.
    pub overwrite: bool,
}

/// An elevation model for an adjustment.
#[derive(Clone, Debug)]
pub struct DemOptions {
    /// The raster.
    pub path: PathBuf,
    /// Vertical reference of its heights: `ellipsoid`, a geoid model or a geoid's grid; by default what the file says.
    pub vertical: Option<String>,
    /// Standard deviation, metres, with which it constrains the height of the scene; without one it only gives the height range.
    pub sigma_m: Option<f64>,
}

/// Result of an adjustment.
#[derive(Clone, Debug, Serialize)]
pub struct Adjusted {
    /// Residuals, shifts and views left out.
    #[serde(flatten)]
    pub report: Report,
    /// Display gamma of the images: light = value^gamma.
    pub gamma: f64,
    /// Time of the adjustment, seconds; none if its record is missing.
    pub seconds: Option<f64>,
    /// Whether the run folder was adjusted already.
    #[serde(skip)]
    pub was_complete: bool,
}

impl Adjusted {
    /// Views that could not be adjusted, with the reason: with any the result is partial.
    #[must_use]
    pub fn left_out(&self) -> &[LeftOut] {
        &self.report.left_out
    }
}

/// The part of the figures that is not in the adjustment's own report.
#[derive(Serialize, Deserialize)]
struct Timing {
    seconds: f64,
}

/// Adjusts a scene into a run folder, unless that was done with the same input and options.
///
/// Writes `RUN/scene.json` and `RUN/ba`.
///
/// # Errors
/// [`PipelineError`]: the folder is in use or was made from something else, the scene or an option is wrong, a file
/// cannot be written, the caller asked to stop.
pub fn adjust(
    scene: &Scene,
    options: &AdjustOptions,
    run: &Path,
    progress: &dyn Progress,
) -> Result<Adjusted, PipelineError> {
    let _lock = RunLock::make(run)?;
    require_no_tile(run)?;
    let adjusted = adjust_locked(scene, options, run, progress)?;
    if !adjusted.was_complete {
        outdated::after_adjustment(run, progress)?;
        renew_report(run)?;
    }
    Ok(adjusted)
}

/// As [`adjust`]; the caller holds the lock.
pub(crate) fn adjust_locked(
    scene: &Scene,
    options: &AdjustOptions,
    run: &Path,
    progress: &dyn Progress,
) -> Result<Adjusted, PipelineError> {
    let dem = options.dem.as_ref().map(|dem| read_dem(dem, scene)).transpose()?;
    let of_dem = dem.as_ref().map(|dem| (dem.heights_to_search(), HeightSource::ElevationModel));
    let stated = of_dem.or(options.height_range.map(|range| (range, HeightSource::Option)));
    let heights = stated.map(|(range, _)| range);
    let folder = run.join(ADJUSTMENT);
    let outputs = vec![run.join(SCENE), folder.join(ADJUSTMENT_REPORT), folder.join(SPARSE_POINTS)];
    let gamma = scene.transfer_function.gamma();
    let of_scene = scene_fingerprint(scene)?;
    let scene_hash = hash(format!("{of_scene:?}").as_bytes());
    let stage = Stage::new(run, ADJUSTMENT, outputs, fingerprint(of_scene, options, heights));
    if stage.is_done(options.overwrite)? {
        update_image_paths(run, scene)?;
        progress.event(Event::Note(format!("`{}` is adjusted already", run.display())));
        let report = Adjustment::read(&folder)?.report;
        let seconds = stage.summary::<Timing>()?.map(|t| t.seconds);
        return Ok(Adjusted { report, gamma, seconds, was_complete: true });
    }
    stage.require_writable()?;
    let started = std::time::Instant::now();
    let control = options.gcps.as_deref().map(read_control).transpose()?.unwrap_or_default();
    if let Some(path) = &options.gcps {
        check_control(path, &control, scene)?;
        tell_of_control(path, &control, scene, progress)?;
    }
    let store = PartStore::new(&folder, scene_hash);
    let sigma_m = options.dem.as_ref().and_then(|dem| dem.sigma_m);
    let choices = BundleOptions {
        fixed: options.fixed,
        model: options.model,
        height_range: heights,
        control,
        reference: options.reference_views.clone(),
        height_prior: dem.zip(sigma_m).map(|(dem, sigma_m)| HeightPrior { dem, sigma_m }),
        cell_m: None,
        store: Some(store.clone()),
    };
    let adjustment = bundle::adjust(scene, &choices, progress).inspect_err(|e| {
        // What wrong input gave so far is of no use; an empty folder goes.
        if e.kind() == ErrorKind::Input {
            store.within(MATCHING).remove();
            let _ = std::fs::remove_dir(&folder);
        }
    })?;
    if let Some(heights) = heights {
        warn_of_heights(&adjustment.points, heights, progress);
    }
    let is_used = |name: &String| adjustment.cameras.iter().any(|c| c.0 == *name);
    let mut used = scene.clone();
    used.views.retain(|v| is_used(&v.name));
    used.heights = stated.map(|((low_m, high_m), source)| SearchedHeights { low_m, high_m, source });
    adjustment.write(&folder, &used)?;
    relocation::forget(run)?;
    write_json(&run.join(SCENE), &used)?;
    let seconds = started.elapsed().as_secs_f64();
    // The other figures are in the report, which alignment changes.
    stage.complete(&Timing { seconds })?;
    store.within(MATCHING).remove();
    Ok(Adjusted { report: adjustment.report, gamma, seconds: Some(seconds), was_complete: false })
}

/// Says how far ground control lies from where the delivered cameras see it, and warns of what no camera is off.
fn tell_of_control(
    path: &Path,
    control: &[ControlPoint],
    scene: &Scene,
    progress: &dyn Progress,
) -> Result<(), PipelineError> {
    let pairs = delivered_control_pairs(control, scene)?;
    let Some((_, [_, at])) = pairs.first() else { return Ok(()) };
    let found = match to_control(&pairs, stated_accuracy_m(control), &SiteGrid::at(*at)?, path) {
        // Delivered cameras may each point elsewhere; the adjustment tells.
        Err(CoregisterError::ControlDisagrees { .. }) => return Ok(()),
        found => found?,
    };
    warn_of_shift("the ground control", &found.shift, *at, progress);
    let Shift { east_m, north_m, up_m } = found.shift;
    let Some(fit) = &found.fit else { return Ok(()) };
    progress.event(Event::Note(format!(
        "the ground control lies {east_m:+.2} m east, {north_m:+.2} m north, {up_m:+.2} m up of where the delivered cameras see it: {fit}"
    )));
    if let Some(names) = fit.left_out_text() {
        progress.event(Event::Warning(format!(
            "points of `{}` lie elsewhere than the others, as seen by the delivered cameras: {names}",
            path.display()
        )));
    }
    Ok(())
}

/// Warns if most tie points lie outside of the heights that were to be searched: matching allows for errors of the cameras, and so
/// finds them there.
fn warn_of_heights(points: &[SparsePoint], (low, high): (f64, f64), progress: &dyn Progress) {
    let found: Vec<f64> = points.iter().map(|point| point.position.height_m()).collect();
    let outside = found.iter().filter(|height| !(low..=high).contains(*height)).count();
    if 2 * outside <= found.len() {
        return;
    }
    let middle = quantile(found, 0.5).unwrap_or(f64::NAN);
    progress.event(Event::Warning(format!(
        "{outside} of {} tie points lie outside of the heights to search, {low:.0} to {high:.0} m above the ellipsoid; their \
         median is {middle:.0} m: is --height-range, or the vertical reference of --dem, that of another place?",
        points.len()
    )));
}

fn read_dem(dem: &DemOptions, scene: &Scene) -> Result<scene::Dem, PipelineError> {
    let vertical = dem.vertical.as_deref().map(VerticalReference::read).transpose()?;
    Ok(scene.dem(&dem.path, vertical.as_ref())?)
}

/// What an adjustment is made from, the scene and the options; the keys are the names of options on the command line.
fn fingerprint(mut out: Fingerprint, options: &AdjustOptions, heights: Option<(f64, f64)>) -> Fingerprint {
    out.insert("--height-range".into(), or_none(heights.map(|(low, high)| format!("{low},{high}"))));
    out.insert("--fixed".into(), options.fixed.to_string());
    out.insert("--model".into(), format!("{:?}", options.model));
    if !options.reference_views.is_empty() {
        out.insert("--reference".into(), options.reference_views.join(", "));
    }
    if let Some(DemOptions { path, vertical, sigma_m: Some(sigma_m) }) = &options.dem {
        out.insert("--dem".into(), hash_file(path));
        out.insert("--dem-sigma".into(), sigma_m.to_string());
        out.insert("--dem-vertical".into(), or_none(vertical.as_ref()));
    }
    if let Some(gcps) = &options.gcps {
        out.insert("--gcps".into(), hash_file(gcps));
    }
    out
}

/// Stores where the scene's images are now: they may have moved since the run was adjusted.
fn update_image_paths(run: &Path, scene: &Scene) -> Result<(), PipelineError> {
    let before = read_scene(run)?;
    let mut used = before.clone();
    for view in &mut used.views {
        if let Some(now) = scene.views.iter().find(|v| v.name == view.name) {
            (view.image, view.mask) = (now.image.clone(), now.mask.clone());
        }
    }
    if used == before { Ok(()) } else { Ok(write_json(&run.join(SCENE), &used)?) }
}
