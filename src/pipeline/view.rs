//! The page that shows a run: `satgs view`.

use super::page_layers::{add_mesh, add_points, add_relief, add_splats, add_tie_points, grouped};
use super::page_splats::PageSplats;
use super::run_folder::perspective_manifest;
use super::run_folder::tiled::require_one_area;
use super::{
    PerspectiveCameras, PerspectiveManifest, PipelineError, TrainedCameras, TrainedPhoto, relocation,
};
use crate::affine::{SiteScene, SiteView};
use crate::frame::SiteGrid;
use crate::io::{check_writable, write_file};
use crate::progress::Progress;
use crate::run_files::SPLATS;
use crate::scene::Role;
use crate::splat::ply::{self, ScaleColumns};
use crate::splat::splats::Splats;
use crate::stats::quantile;
use crate::viewer::{CameraMark, PageLayer, PageScope, ShownLayer, ViewerError, ViewerPage, bind, serve};
use glam::DVec3;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Distance at which satellites are drawn, in half diagonals of the area.
const SATELLITE_DISTANCE: f64 = 1.0;
/// Depth of the pyramid of a photograph, in radii of the scene.
const PHOTOGRAPH_DEPTH: f64 = 0.08;
/// The page looks at this many times the distance from the middle within which this share of the splats of a perspective
/// scene lies; the others belong to the background.
const MARGIN: f64 = 1.5;
const LOOKED_AT: f64 = 0.8;

/// A page that was written.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WrittenPage {
    /// The HTML file.
    pub page: PathBuf,
    /// Its size.
    pub bytes: u64,
    /// Names of its layers.
    pub layers: Vec<&'static str>,
}

/// Writes the page of a run as one HTML file, which opens without a network connection. It compares with the `other` run, if there
/// is one.
///
/// # Errors
/// [`PipelineError`] as [`view_page`]; the file exists and `overwrite` is not set, it cannot be written, or would be too
/// large for browsers; the runs are on different maps.
pub fn write_page(
    run: &Path,
    other: Option<&Path>,
    file: &Path,
    overwrite: bool,
) -> Result<WrittenPage, PipelineError> {
    if file.exists() && !overwrite {
        return Err(PipelineError::Exists { path: file.into() });
    }
    check_writable(file)?;
    let page = compared(run, other)?;
    let html = page.html()?;
    write_file(file, &html)?;
    let layers = page.layers.iter().map(|l| l.label).collect();
    Ok(WrittenPage { page: file.into(), bytes: html.len() as u64, layers })
}

/// Serves the page of a run to the browser of this machine, on a port or a free one, until `progress` asks to stop. It compares
/// with the `other` run, if there is one. `started` gets the address of the page.
///
/// # Errors
/// [`PipelineError`] as [`view_page`]; the port is in use; the runs are on different maps. [`PipelineError::Interrupted`] at the
/// end.
pub fn serve_page(
    run: &Path,
    other: Option<&Path>,
    port: Option<u16>,
    started: impl FnOnce(&str) -> Result<(), PipelineError>,
    progress: &dyn Progress,
) -> Result<(), PipelineError> {
    // A port in use is reported before the files are read.
    let (listener, address) = bind(port)?;
    let page = Arc::new(compared(run, other)?);
    started(&address)?;
    Ok(serve(&listener, &|| page.clone(), progress)?)
}

fn compared(run: &Path, other: Option<&Path>) -> Result<ViewerPage, PipelineError> {
    let mut page = view_page(run)?;
    if let Some(other) = other {
        page.compare(view_page(other)?)?;
    }
    Ok(page)
}

/// The page of a run, with a layer for each of its results that exists.
///
/// # Errors
/// [`PipelineError`]: the run has no splats or has several tiles, a file is damaged.
pub fn view_page(run: &Path) -> Result<ViewerPage, PipelineError> {
    require_one_area(run)?;
    if !run.join(SPLATS).exists() {
        return Err(ViewerError::NoSplats { run: run.into() }.into());
    }
    if perspective_manifest::is_run(run) { perspective_page(run) } else { satellite_page(run) }
}

/// The name of a run's folder.
pub(super) fn title_of(run: &Path) -> String {
    let folder = run.canonicalize().unwrap_or_else(|_| run.into());
    folder.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

/// The PLY file of splats, on the map if there is a site.
pub(super) fn encoded(splats: &Splats, site: Option<&SiteGrid>) -> Vec<u8> {
    match site {
        Some(site) => ply::encode(splats, site, ScaleColumns::Three),
        None => ply::encode_local(splats, ScaleColumns::Three),
    }
}

fn satellite_page(run: &Path) -> Result<ViewerPage, PipelineError> {
    relocation::finish(run)?;
    let cameras = TrainedCameras::read(run)?;
    let setup = &cameras.setup;
    let scope = PageScope::of_area(setup.area);
    let mut page = ViewerPage::new(title_of(run), Some(&setup.site), scope);
    let read = || Ok((cameras.read_shown_splats(run)?, scope));
    add_splats(&mut page, PageSplats::of_run(run, read, |splats| encoded(splats, Some(&setup.site)))?);
    add_mesh(&mut page, run, Some(&setup.site))?;
    add_relief(&mut page, run, &setup.site)?;
    add_tie_points(&mut page, run, setup)?;
    add_satellites(&mut page, setup);
    Ok(page)
}

fn perspective_page(run: &Path) -> Result<ViewerPage, PipelineError> {
    let cameras = PerspectiveCameras::read(run)?;
    let site = cameras.site.as_ref();
    let read = || {
        let splats = PerspectiveCameras::read_splats(run)?;
        let scope = scope_of(&splats, &cameras);
        Ok((splats, scope))
    };
    let splats = PageSplats::of_run(run, read, |splats| encoded(splats, site))?;
    let scope = splats.scope;
    let mut page = ViewerPage::new(title_of(run), site, scope);
    add_splats(&mut page, splats);
    add_mesh(&mut page, run, site)?;
    if let Some(site) = site {
        add_relief(&mut page, run, site)?;
    }
    // The points are in the files of the scene; if these have gone or changed, the page is without them.
    if let Ok(scene) = PerspectiveManifest::read(run)?.read_scene()
        && !scene.points.is_empty()
        && cameras.views.iter().all(|v| v.view_of(&scene, run).is_ok())
    {
        let points: Vec<_> = scene.points.iter().map(|p| (p.position, p.rgb)).collect();
        add_points(&mut page, &points);
    }
    add_photographs(&mut page, &cameras, scope);
    Ok(page)
}

/// The ball around the median of the splats that holds most of them. Without a map, up is the mean of the upward directions
/// of the images.
pub(super) fn scope_of(splats: &Splats, cameras: &PerspectiveCameras) -> PageScope {
    let axis = |k: usize| quantile(splats.position.iter().map(|p| f64::from(p[k])).collect(), 0.5);
    let middle = DVec3::from_array([0, 1, 2].map(|k| axis(k).unwrap_or_default()));
    let distance = |p: &[f32; 3]| DVec3::from_array(p.map(f64::from)).distance(middle);
    let radius = quantile(splats.position.iter().map(distance).collect(), LOOKED_AT);
    let up: DVec3 = cameras.views.iter().map(|v| -v.camera().cam_from_site.row(1)).sum();
    let up = if cameras.site.is_some() { DVec3::Z } else { up.try_normalize().unwrap_or(DVec3::Z) };
    PageScope {
        middle: middle.to_array(),
        radius: MARGIN * radius.filter(|r| *r > 0.0).unwrap_or(1.0),
        up: up.to_array(),
    }
}

fn add_cameras(page: &mut ViewerPage, views: Vec<CameraMark>) {
    let (note, layer) = (grouped(views.len()), PageLayer::Cameras { views });
    page.layers.push(ShownLayer { layer, label: "Cameras", note, is_shown: true });
}

/// Adds photographs.
pub(super) fn add_photographs(page: &mut ViewerPage, cameras: &PerspectiveCameras, scope: PageScope) {
    let depth = PHOTOGRAPH_DEPTH * scope.radius;
    let mark = |v: &TrainedPhoto| CameraMark::of_pinhole(&v.name, v.role == Role::Test, &v.camera(), depth);
    add_cameras(page, cameras.views.iter().map(mark).collect());
}

/// Adds the views of a satellite run, whose lines of sight end in the middle of the area.
pub(super) fn add_satellites(page: &mut ViewerPage, setup: &SiteScene) {
    let (west, south, east, north) = setup.area;
    let middle = [0.5 * (west + east), 0.5 * (south + north), 0.0];
    let distance = SATELLITE_DISTANCE * 0.5 * (east - west).hypot(north - south);
    let mark =
        |v: &SiteView| CameraMark::of_satellite(&v.name, v.role == Role::Test, &v.camera, middle, distance);
    add_cameras(page, setup.views.iter().map(mark).collect());
}
