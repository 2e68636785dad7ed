//! The views of a run as other programs read them: `satgs export --colmap`.

use super::colmap_folder::ColmapFolder;
use super::exported::{ExportedView, ExportedViews, PinholeFit};
use super::run_folder::perspective_manifest;
use super::run_folder::satellite_cameras::require_image;
use super::{PerspectiveCameras, PerspectiveManifest, PipelineError, TrainedCameras, read_scene, relocation};
use crate::affine::SiteScene;
use crate::bundle::{Adjustment, TiePointObservation};
use crate::export::{ColmapBuilder, ExportError, Fitted, LocalPinhole, Resampled};
use crate::frame::{CenterPx, Pixel};
use crate::perspective::colmap::{ColmapModel, Format};
use crate::progress::{Event, Progress};
use crate::run_files::{ADJUSTMENT, CAMERAS};
use crate::scene::{Role, View};
use std::path::Path;

/// Exports the views of a run as a COLMAP project, which appears when it is complete; `overwrite` replaces what an earlier
/// export wrote into the folder.
///
/// Of a satellite run, images are resampled for local pinhole cameras, and the tie points become the points of the model; the
/// adjustment (`satgs ba`) is enough. Of a perspective run, images and cameras are those that were trained on. Positions
/// are in the site frame, whose place on the map is in `georef.json`.
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
    let target = ColmapFolder::new(folder, overwrite)?;
    let is_perspective = perspective_manifest::is_run(run);
    let export = if is_perspective { photographs } else { satellites };
    let Parts { model, views, left_out, site } = export(run, &target, progress)?;
    if views.is_empty() {
        return Err(ExportError::NoView { run: run.into() }.into());
    }
    target.finish(&model, format, &views, site.as_ref())?;
    let (points, reprojection_px) = (model.points.len(), model.reprojection().map(|r| r.mean_px));
    Ok(ExportedViews { folder: folder.into(), views, left_out, points, reprojection_px })
}

/// What is in a project beside its images.
struct Parts {
    model: ColmapModel,
    views: Vec<ExportedView>,
    left_out: Vec<String>,
    site: Option<crate::frame::SiteGrid>,
}

/// Writes the resampled images of a satellite run.
fn satellites(run: &Path, target: &ColmapFolder, progress: &dyn Progress) -> Result<Parts, PipelineError> {
    relocation::finish(run)?;
    let scene = read_scene(run)?;
    let adjustment = Adjustment::read_with_observations(&run.join(ADJUSTMENT))?;
    let setup = if run.join(CAMERAS).exists() {
        TrainedCameras::read(run)?.setup
    } else {
        SiteScene::new(&scene, &adjustment.cameras_of(&scene)?, &adjustment.positions())?
    };
    let positions = adjustment.positions().into_iter().map(|p| setup.site.site_from_geodetic(p)).collect();
    let mut builder = ColmapBuilder::new(positions);
    let (mut views, mut left_out) = (Vec::new(), Vec::new());
    progress.event(Event::Started { stage: "resampling images", total: setup.views.len() as u64 });
    for (i, view) in setup.views.iter().enumerate() {
        progress.check()?;
        let missing = || PipelineError::ViewNotInScene { run: run.into(), name: view.name.clone() };
        let source = scene.views.iter().find(|v| v.name == view.name).ok_or_else(missing)?;
        match LocalPinhole::fit(&view.camera, view.size, setup.area, setup.altitudes) {
            Fitted::Degenerate => return Err(ExportError::NoPinhole { view: view.name.clone() }.into()),
            Fitted::OutsideOfImage => left_out.push(view.name.clone()),
            Fitted::Pinhole(pinhole) => {
                require_image(source)?;
                target.require_other_than(&source.image)?;
                let size = pinhole.camera.size;
                let image = Resampled::new(&source.read_colors()?, &pinhole.map, size);
                let name = format!("{}.png", view.name);
                target.write_image(&name, &image)?;
                builder.add_view(name.clone(), &pinhole, &image, seen_in(&adjustment, source));
                let LocalPinhole { rms_px, max_px, .. } = *pinhole;
                let fit = Some(PinholeFit { distance_m: pinhole.camera.center.length(), rms_px, max_px });
                views.push(ExportedView { image: name, size, is_test: view.role == Role::Test, fit });
            }
        }
        progress.event(Event::Advanced { done: i as u64 + 1, status: view.name.clone() });
    }
    progress.event(Event::Finished);
    Ok(Parts { model: builder.finish(), views, left_out, site: Some(setup.site) })
}

/// The points that a view sees, and where in its used part.
fn seen_in<'a>(
    adjustment: &'a Adjustment,
    view: &'a View,
) -> impl Iterator<Item = (usize, Pixel<CenterPx>)> + 'a {
    let index = adjustment.cameras.iter().position(|(name, _)| *name == view.name);
    let of_view = move |t: &&TiePointObservation| Some(t.view) == index;
    adjustment.observations.iter().filter(of_view).map(|t| (t.point, view.px_of_window(t.px)))
}

/// Writes the images of a perspective run, without distortion and in the size of training.
fn photographs(run: &Path, target: &ColmapFolder, progress: &dyn Progress) -> Result<Parts, PipelineError> {
    let cameras = PerspectiveCameras::read(run)?;
    let scene = PerspectiveManifest::read(run)?.read_scene()?;
    let mut views = Vec::new();
    progress.event(Event::Started { stage: "writing images", total: cameras.views.len() as u64 });
    for view in &cameras.views {
        progress.check()?;
        let source = view.view_of(&scene, run)?;
        target.require_other_than(&source.image)?;
        let image = Resampled::unchanged(&source.read_image()?.planes);
        // Names of views may hold folders.
        let name = format!("{}.png", view.name.replace(['/', '\\'], "_"));
        target.write_image(&name, &image)?;
        views.push(ExportedView {
            image: name,
            size: view.size,
            is_test: view.role == Role::Test,
            fit: None,
        });
        progress.event(Event::Advanced { done: views.len() as u64, status: view.name.clone() });
    }
    progress.event(Event::Finished);
    let photographs =
        views.iter().zip(&cameras.views).map(|(v, trained)| (v.image.as_str(), trained.camera()));
    let model = ColmapModel::of_photographs(photographs, &scene.points);
    Ok(Parts { model, views, left_out: Vec::new(), site: cameras.site })
}
