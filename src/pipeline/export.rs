//! A run in the forms that other programs read: `satgs export`.

use super::cameras::require_image;
use super::{PipelineError, TrainedCameras, read_scene, relocation};
use crate::affine::SiteScene;
use crate::bundle::{Adjustment, TiePointObservation};
use crate::export::{ColmapBuilder, ExportError, Fitted, LocalPinhole, PlyVariant, Resampled};
use crate::io::{WriteError, check_writable, write_file, write_json, write_png_gray};
use crate::perspective::colmap::{self, Format};
use crate::progress::{Event, Progress};
use crate::run_files::{ADJUSTMENT, CAMERAS, SPLATS};
use crate::scene::{Role, Scene, View};
use crate::splat::ply;
use serde::Serialize;
use std::fs;
use std::path::{Path, PathBuf};

/// What [`export_colmap`] writes into its folder.
const IMAGES: &str = "images";
const MASKS: &str = "masks";
const SPARSE: &str = "sparse";
const GEOREFERENCE: &str = "georef.json";
/// The model, and the images that were held back from training, where 3DGS looks for them.
const MODEL: &str = "sparse/0";
const TEST_LIST: &str = "test.txt";

/// Views that were exported.
#[derive(Clone, Debug, Serialize)]
pub struct ExportedViews {
    /// The folder.
    pub folder: PathBuf,
    /// The views.
    pub views: Vec<ExportedView>,
    /// Views that do not show the area, and were left out.
    pub left_out: Vec<String>,
    /// Number of points.
    pub points: usize,
    /// Mean distance of the points' observations from their projections, pixels.
    pub reprojection_px: Option<f64>,
}

/// A view that was exported.
#[derive(Clone, Debug, Serialize)]
pub struct ExportedView {
    /// Name of the image file.
    pub image: String,
    /// Columns and rows.
    pub size: (usize, usize),
    /// Whether the view was held back from training.
    pub is_test: bool,
    /// Distance of the camera from the middle of the area, metres.
    pub distance_m: f64,
    /// Root mean square distance in the image between the run's camera of the view and the pinhole camera of the resampled
    /// image, pixels.
    pub rms_px: f64,
    /// The largest of these distances.
    pub max_px: f64,
}

/// Exports the views of a run as a COLMAP project: images resampled for local pinhole cameras, the model with tie points, in
/// the site frame, whose place on the map is in `georef.json`. The adjustment (`satgs ba`) is enough. The folder appears when
/// it is complete; `overwrite` replaces what an earlier export wrote into it.
///
/// # Errors
/// [`PipelineError`]: the run is not adjusted, an image is gone, the folder is not empty or cannot be written, no view shows
/// the area, the caller asked to stop.
pub fn export_colmap(
    run: &Path,
    folder: &Path,
    format: Format,
    overwrite: bool,
    progress: &dyn Progress,
) -> Result<ExportedViews, PipelineError> {
    require_room(folder, overwrite)?;
    relocation::finish(run)?;
    let scene = read_scene(run)?;
    let adjustment = Adjustment::read_with_observations(&run.join(ADJUSTMENT))?;
    let setup = if run.join(CAMERAS).exists() {
        TrainedCameras::read(run)?.setup
    } else {
        SiteScene::new(&scene, &adjustment.cameras_of(&scene)?, &adjustment.positions())?
    };
    let staging = Staging::beside(folder)?;
    let positions = adjustment.positions().into_iter().map(|p| setup.site.site_from_geodetic(p)).collect();
    let mut builder = ColmapBuilder::new(positions);
    let (mut views, mut left_out) = (Vec::new(), Vec::new());
    progress.event(Event::Started { stage: "resampling images", total: setup.views.len() as u64 });
    for (i, view) in setup.views.iter().enumerate() {
        progress.check()?;
        let source = source_of(&scene, run, &view.name)?;
        match LocalPinhole::fit(&view.camera, view.size, setup.area, setup.altitudes) {
            Fitted::Degenerate => return Err(ExportError::NoPinhole { view: view.name.clone() }.into()),
            Fitted::OutsideOfImage => left_out.push(view.name.clone()),
            Fitted::Pinhole(pinhole) => {
                require_image(source)?;
                let image = Resampled::new(&source.read_colors()?, &pinhole.map, pinhole.camera.size);
                let file = format!("{}.png", view.name);
                image.colors.write(&staging.path(IMAGES).join(&file))?;
                if let Some(mask) = &image.mask {
                    let (width, height) = pinhole.camera.size;
                    // The name that COLMAP looks for.
                    write_png_gray(&staging.path(MASKS).join(format!("{file}.png")), width, height, mask)?;
                }
                builder.add_view(file.clone(), &pinhole, &image, seen_in(&adjustment, source));
                views.push(ExportedView {
                    image: file,
                    size: pinhole.camera.size,
                    is_test: view.role == Role::Test,
                    distance_m: pinhole.camera.center.length(),
                    rms_px: pinhole.rms_px,
                    max_px: pinhole.max_px,
                });
            }
        }
        progress.event(Event::Advanced { done: i as u64 + 1, status: view.name.clone() });
    }
    progress.event(Event::Finished);
    if views.is_empty() {
        return Err(ExportError::NoView { run: run.into() }.into());
    }
    let model = builder.finish();
    colmap::write(&staging.path(MODEL), &model, format)?;
    let test: Vec<&str> = views.iter().filter(|v| v.is_test).map(|v| v.image.as_str()).collect();
    if !test.is_empty() {
        write_file(&staging.path(MODEL).join(TEST_LIST), test.join("\n") + "\n")?;
    }
    write_json(&staging.path(GEOREFERENCE), &ply::georeference(&setup.site))?;
    let reprojection_px = model.reprojection().map(|r| r.mean_px);
    staging.publish(folder)?;
    Ok(ExportedViews { folder: folder.into(), views, left_out, points: model.points.len(), reprojection_px })
}

/// The view of a scene with this name.
fn source_of<'a>(scene: &'a Scene, run: &Path, name: &str) -> Result<&'a View, PipelineError> {
    let found = scene.views.iter().find(|v| v.name == name);
    found.ok_or_else(|| PipelineError::ViewNotInScene { run: run.into(), name: name.into() })
}

/// The points that a view sees, and where in its used part.
fn seen_in<'a>(
    adjustment: &'a Adjustment,
    view: &'a View,
) -> impl Iterator<Item = (usize, crate::frame::Pixel<crate::frame::CenterPx>)> + 'a {
    let index = adjustment.cameras.iter().position(|(name, _)| *name == view.name);
    let of_view = move |t: &&TiePointObservation| Some(t.view) == index;
    adjustment.observations.iter().filter(of_view).map(|t| (t.point, view.px_of_window(t.px)))
}

/// An error if a folder holds something that may not be replaced.
fn require_room(folder: &Path, overwrite: bool) -> Result<(), PipelineError> {
    let first = match fs::read_dir(folder) {
        Ok(mut entries) => entries.next(),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => None,
        Err(e) => return Err(WriteError::new(folder, e).into()),
    };
    if first.is_some() && !overwrite {
        return Err(ExportError::NotEmpty { folder: folder.into() }.into());
    }
    Ok(())
}

/// A folder beside the final one in which files are written until all are complete.
struct Staging(tempfile::TempDir);

impl Staging {
    fn beside(folder: &Path) -> Result<Self, PipelineError> {
        let parent = folder.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        fs::create_dir_all(parent).map_err(|e| WriteError::new(folder, e))?;
        let made = tempfile::Builder::new().prefix(".satgs-").tempdir_in(parent);
        Ok(Self(made.map_err(|e| WriteError::new(folder, e))?))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Moves the files to their place; what an earlier export left there is removed, other files stay.
    fn publish(self, folder: &Path) -> Result<(), PipelineError> {
        let moved = || -> std::io::Result<()> {
            fs::create_dir_all(folder)?;
            for name in [IMAGES, MASKS, SPARSE] {
                let (from, to) = (self.path(name), folder.join(name));
                if to.exists() {
                    fs::remove_dir_all(&to)?;
                }
                if from.exists() {
                    fs::rename(from, to)?;
                }
            }
            fs::rename(self.path(GEOREFERENCE), folder.join(GEOREFERENCE))
        };
        Ok(moved().map_err(|e| WriteError::new(folder, e))?)
    }
}

/// Splats that were exported.
#[derive(Clone, Debug, Serialize)]
pub struct ExportedPly {
    /// The PLY file.
    pub file: PathBuf,
    /// Number of splats.
    pub splats: usize,
    /// Size of the file.
    pub bytes: u64,
}

/// Exports the splats of a run, in the colours of the orthophoto, with `NAME.georef.json` beside them.
///
/// # Errors
/// [`PipelineError`]: the run is not trained, the file exists and `overwrite` is not set, or it cannot be written.
pub fn export_ply(
    run: &Path,
    file: &Path,
    variant: PlyVariant,
    overwrite: bool,
) -> Result<ExportedPly, PipelineError> {
    let is_own = match (file.canonicalize(), run.join(SPLATS).canonicalize()) {
        (Ok(file), Ok(own)) => file == own,
        _ => false,
    };
    if is_own {
        return Err(ExportError::OwnFile { path: file.into() }.into());
    }
    let georeference = file.with_extension("georef.json");
    for path in [file, &georeference] {
        if path.exists() && !overwrite {
            return Err(PipelineError::Exists { path: path.into() });
        }
    }
    check_writable(file)?;
    relocation::finish(run)?;
    let cameras = TrainedCameras::read(run)?;
    let site = &cameras.setup.site;
    let splats = cameras.read_shown_splats(run)?;
    let bytes = variant.encode(&splats, site)?;
    write_file(file, &bytes)?;
    let mut place = ply::georeference(site);
    place["axes"] = serde_json::json!(variant.axes());
    write_json(&georeference, &place)?;
    Ok(ExportedPly { file: file.into(), splats: splats.len(), bytes: bytes.len() as u64 })
}
