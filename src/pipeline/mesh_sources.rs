//! The depth maps that a mesh is fused from: a scene's own, or those that a trained run shows.

use super::PerspectiveCameras;
use super::depth_views::{read_perspective, seen_part, trained_box};
use super::{PipelineError, TrainedCameras, relocation};
use crate::affine::ViewCamera;
use crate::dsm::{nadir_camera, view_altitudes};
use crate::io::{Grid2, MapGrid};
use crate::mesh::{DepthCamera, DepthMap, FuseOptions, FusedMesh, fuse};
use crate::perspective::{PerspectiveError, PerspectiveScene, PerspectiveView, PinholeCamera};
use crate::progress::Progress;
use crate::scene::Role;
use crate::splat::pinhole::PinholePicture;
use crate::splat::primitive::PrimitiveKind;
use crate::splat::satellite::NovelView;
use crate::splat::splats::Splats;
use crate::stats::quantile;
use glam::DVec3;
use std::path::Path;

/// Weight of the view from straight above, in which most of a satellite scene's surface is seen best, against one of a view.
const NADIR_WEIGHT: f32 = 4.0;

/// The depth maps of a scene's own files.
pub(super) fn of_scene(
    path: &Path,
    options: &FuseOptions,
    progress: &dyn Progress,
) -> Result<FusedMesh, PipelineError> {
    let scene = read_perspective(path)?;
    let views: Vec<&PerspectiveView> = scene.views.iter().filter(|v| v.depth.is_some()).collect();
    if views.is_empty() {
        let view = scene.views.first().map(|v| v.name.clone()).unwrap_or_default();
        return Err(PerspectiveError::NoDepth { view }.into());
    }
    let read = |view: &&PerspectiveView| -> Result<DepthMap, PipelineError> {
        let (image, mut depth) = (view.read_image()?, view.read_depth()?);
        for (i, depth) in depth.data.iter_mut().enumerate() {
            *depth = if image.is_empty_at(i) { f32::NAN } else { *depth };
        }
        Ok(DepthMap { color: Some(image.planes), ..DepthMap::new(DepthCamera::Pinhole(view.camera), depth) })
    };
    let mut fused = fuse(views.iter().map(read), options, progress)?;
    match &scene.georeference {
        Some(georeference) => fused.mesh.site = Some(georeference.grid),
        None => fused.mesh.up = mean_up(scene.views.iter().map(|v| v.camera)),
    }
    Ok(fused)
}

/// The upward direction of a scene without georeference: the mean of that of its images.
fn mean_up(cameras: impl Iterator<Item = PinholeCamera>) -> [f64; 3] {
    let up = cameras.map(|camera| -camera.cam_from_site.row(1)).sum::<DVec3>();
    up.try_normalize().unwrap_or(DVec3::Z).to_array()
}

/// Numbers of views, and of pixels of a view, whose depths are sampled.
const SAMPLED_VIEWS: usize = 8;
const SAMPLED_PIXELS: usize = 100_000;
/// The same of depth maps of scenes, which cost less than renders.
const SAMPLED_MAPS: usize = 64;

/// Depths that a training view of a perspective run shows.
pub(super) struct ViewDepths {
    /// Its camera.
    pub camera: PinholeCamera,
    /// A sample of them, metres.
    pub depths: Vec<f64>,
    /// Their median in the middle of the image, a third of its width and height; none where there are none.
    pub in_the_middle: Option<f64>,
}

/// The depths of some of the training views of a perspective run.
pub(super) fn sampled_depths(
    run: &Path,
    training: &[PinholeCamera],
) -> Result<Vec<ViewDepths>, PipelineError> {
    let (run, splats) = (PerspectiveCameras::read(run)?, PerspectiveCameras::read_splats(run)?);
    let step = training.len().div_ceil(SAMPLED_VIEWS).max(1);
    let views = training.iter().step_by(step);
    Ok(views.map(|camera| view_depths(*camera, &shown(&run, &splats, camera).depth)).collect())
}

/// The depths of some of the maps of a scene.
pub(super) fn depths_of_scene(scene: &PerspectiveScene) -> Result<Vec<ViewDepths>, PipelineError> {
    let views: Vec<&PerspectiveView> = scene.views.iter().filter(|v| v.depth.is_some()).collect();
    let step = views.len().div_ceil(SAMPLED_MAPS).max(1);
    let some = views.into_iter().step_by(step);
    some.map(|view| Ok(view_depths(view.camera, &view.read_depth()?))).collect()
}

fn view_depths(camera: PinholeCamera, map: &Grid2) -> ViewDepths {
    let Grid2 { width, height, .. } = *map;
    let known = |depths: Vec<f32>| depths.into_iter().filter(|d| !d.is_nan()).map(f64::from).collect();
    let rows = height / 3..height - height / 3;
    let middle = rows.flat_map(|row| &map.data[row * width..][width / 3..width - width / 3]);
    let in_the_middle = quantile(known(middle.copied().collect()), 0.5);
    let step = map.data.len().div_ceil(SAMPLED_PIXELS).max(1);
    ViewDepths { camera, depths: known(map.data.iter().copied().step_by(step).collect()), in_the_middle }
}

/// The depths that a view of splats shows: of discs those at which the transmittance falls to one half, of ellipsoids the mean.
fn shown(run: &PerspectiveCameras, splats: &Splats, camera: &PinholeCamera) -> DepthMap {
    let PinholePicture { colors, depth, discs, .. } = run.picture(splats, camera);
    let depth = discs.map_or(depth, |discs| discs.median_depth);
    DepthMap { color: Some(colors), ..DepthMap::new(DepthCamera::Pinhole(*camera), depth) }
}

/// The depths that the training views of a perspective run show.
pub(super) fn of_perspective_run(
    run: &Path,
    options: &FuseOptions,
    progress: &dyn Progress,
) -> Result<FusedMesh, PipelineError> {
    let (cameras, splats) = (PerspectiveCameras::read(run)?, PerspectiveCameras::read_splats(run)?);
    let training: Vec<PinholeCamera> = cameras.training_cameras();
    let maps = training.iter().map(|camera| Ok::<_, PipelineError>(shown(&cameras, &splats, camera)));
    let mut fused = fuse(maps, options, progress)?;
    match cameras.site {
        Some(site) => fused.mesh.site = Some(site),
        None => fused.mesh.up = mean_up(training.iter().copied()),
    }
    Ok(fused)
}

/// The altitudes of the trained splats: in each training view, where their transmittance falls to one half, and seen from
/// straight above.
pub(super) fn of_satellite_run(
    run: &Path,
    options: FuseOptions,
    progress: &dyn Progress,
) -> Result<FusedMesh, PipelineError> {
    relocation::finish(run)?;
    let cameras = TrainedCameras::read(run)?;
    let splats = cameras.read_splats(run)?;
    let setup = &cameras.setup;
    let ((west, south, east, north), [x, y, _]) = (setup.area, setup.site.origin.xyz());
    let map_box = (x + west, y + south, x + east, y + north);
    // Finer cells than pixels of the images would only cost time.
    let gsd_m = setup.views.get(setup.reference).map_or(0.0, |v| v.camera.gsd_m());
    let cell_m = options.voxel_m.max(gsd_m);
    let grid = MapGrid::covering(setup.site.epsg, map_box, cell_m);
    let nadir = (nadir_camera(&grid, &setup.site), (grid.width, grid.height), NADIR_WEIGHT);
    let training = setup.views.iter().filter(|v| v.role == Role::Train);
    let mut views: Vec<_> =
        training.filter_map(|v| seen_part(v, setup).map(|(camera, size)| (camera, size, 1.0))).collect();
    views.push(nadir);
    let render = |(camera, size, weight): &(ViewCamera, (usize, usize), f32)| -> Result<_, PipelineError> {
        let view = NovelView { camera: *camera, size: *size, sun_shear: None };
        Ok(DepthMap { weight: *weight, ..rendered(&cameras, &splats, &view) })
    };
    let options = FuseOptions { bounds: Some(trained_box(setup)), ..options };
    let mut fused = fuse(views.iter().map(render), &options, progress)?;
    fused.mesh.site = Some(setup.site);
    Ok(fused)
}

/// Altitudes and colours of a view, without shadows and in the radiometry of the reference view.
fn rendered(cameras: &TrainedCameras, splats: &Splats, view: &NovelView) -> DepthMap {
    let setup = &cameras.setup;
    let mut colors = view.picture(splats, &cameras.reference_appearance(), setup.altitudes).colors;
    setup.transfer_function.encode(&mut colors);
    let depth = view_altitudes(splats, &view.camera, view.size);
    let camera = DepthCamera::Parallel { camera: view.camera, size: view.size };
    let mut map = DepthMap { color: Some(colors), ..DepthMap::new(camera, depth) };
    match splats.primitive() {
        PrimitiveKind::Disc => map.normal = Some(view.normals(splats)),
        PrimitiveKind::Ellipsoid => map.estimate_normals(),
    }
    map
}
