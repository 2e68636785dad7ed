//! The surface of a run or of a scene with depth maps as a mesh: `satgs mesh`.

use super::depth_views::{is_run, read_perspective, seen_part, trained_box};
use super::{
    PerspectiveCameras, PerspectiveManifest, PipelineError, TrainedCameras, TrainedPhoto, perspective,
    relocation,
};
use crate::affine::ViewCamera;
use crate::dsm::{nadir_camera, view_altitudes};
use crate::io::{MapGrid, check_writable};
use crate::mesh::{DepthCamera, DepthMap, FuseOptions, FusedMesh, KeptPieces, MeshFormat, fuse};
use crate::mvs::DSM_CELL_M;
use crate::perspective::{Layout, PerspectiveError, PerspectiveScene, PerspectiveView, PinholeCamera};
use crate::progress::Progress;
use crate::scene::Role;
use crate::splat::novel_view::NovelView;
use crate::splat::pinhole::PinholePicture;
use crate::splat::splats::Splats;
use glam::DVec3;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Voxels of satellite runs, and of scenes with depth maps (IndoorSplat's rooms), metres.
const SATELLITE_VOXEL_M: f64 = DSM_CELL_M;
const ROOM_VOXEL_M: f64 = 0.02;
/// Greatest depth in runs of other photographs, as a multiple of the extent of their cameras, and voxels along it (the authors'
/// code of 2D Gaussian splatting).
const DEPTH_EXTENTS: f64 = 2.0;
const VOXELS_OF_DEPTH: f64 = 1024.0;
/// Truncation distance in voxels (the scripts of 2D Gaussian splatting for DTU), and the fewest that leave no holes.
const TRUNCATION_VOXELS: f64 = 4.0;
const LEAST_TRUNCATION_VOXELS: f64 = 2.0;
/// Greatest depth that is used in scenes with depth maps, metres (IndoorSplat).
const ROOM_DEPTH_M: f64 = 5.0;
/// Weight of the view from straight above, in which most of a satellite scene's surface is seen best, against one of a view.
const NADIR_WEIGHT: f32 = 4.0;

/// How a mesh is made.
#[derive(Clone, Debug, Default)]
pub struct MeshOptions {
    /// Side of a voxel, metres; by default 0.5 for satellite runs, 0.02 for RGB-D scenes, and 1/1024 of the greatest depth for
    /// other photographs.
    pub voxel_m: Option<f64>,
    /// Distance from a surface up to which a depth map tells of it, metres; by default four voxels.
    pub truncation_m: Option<f64>,
    /// Depths beyond this are not used, metres; by default 5 for RGB-D scenes, twice the extent of the cameras for other
    /// photographs. Not for satellite runs.
    pub depth_max_m: Option<f64>,
    /// Replace an existing file.
    pub overwrite: bool,
}

/// What a mesh holds and how it was made.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeshSummary {
    /// The file.
    pub output: PathBuf,
    /// Number of vertices.
    pub vertices: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Connected pieces that are kept.
    pub pieces: usize,
    /// Connected pieces that were too small.
    pub pieces_left_out: usize,
    /// Number of depth maps.
    pub depth_maps: usize,
    /// Side of a voxel, metres.
    pub voxel_m: f64,
    /// Truncation distance, metres.
    pub truncation_m: f64,
    /// Greatest depth that was used, metres.
    pub depth_max_m: Option<f64>,
    /// Memory of the voxels, megabytes.
    pub volume_mb: f64,
    /// EPSG code of the map on which the mesh lies, if it is georeferenced.
    pub epsg: Option<u32>,
}

/// Fuses depth maps to a mesh (.ply, .obj, .glb) of the largest pieces, with colours: the altitudes that a trained satellite
/// run shows in its views and from straight above, the depths that a run of photographs shows in its training views, or the
/// depth maps of a scene.
///
/// # Errors
/// [`PipelineError`]: the input is neither a trained run nor a scene with depth maps, an option is out of its range, the output
/// exists or cannot be written, the voxels need too much memory, there is no surface, the caller asked to stop.
pub fn mesh(
    input: &Path,
    output: &Path,
    options: &MeshOptions,
    progress: &dyn Progress,
) -> Result<MeshSummary, PipelineError> {
    MeshFormat::of_output(output)?;
    if output.exists() && !options.overwrite {
        return Err(PipelineError::Exists { path: output.into() });
    }
    check_writable(output)?;
    let source = Source::of(input)?;
    let fuse_options = fuse_options(options, &source)?;
    let FusedMesh { mesh, maps, pieces, volume_bytes } = match source {
        Source::Scene => of_scene(input, &fuse_options, progress)?,
        Source::Photographs { cameras, .. } => of_photographs(input, &cameras, &fuse_options, progress)?,
        Source::Satellites => of_satellite_run(input, fuse_options, progress)?,
    };
    mesh.write(output)?;
    Ok(MeshSummary {
        output: output.into(),
        vertices: mesh.vertices.len(),
        triangles: mesh.triangles.len(),
        pieces: pieces.0,
        pieces_left_out: pieces.1 - pieces.0,
        depth_maps: maps,
        voxel_m: fuse_options.voxel_m,
        truncation_m: fuse_options.truncation_m,
        depth_max_m: fuse_options.depth_max_m,
        volume_mb: volume_bytes as f64 / 1e6,
        epsg: mesh.site.map(|site| site.epsg),
    })
}

/// Where depth maps come from.
enum Source {
    /// The depth maps of a scene's own files.
    Scene,
    /// Renders of a run of photographs; those of RGB-D frames are of a room.
    Photographs { cameras: Box<PerspectiveCameras>, is_room: bool },
    /// Renders of a satellite run.
    Satellites,
}

impl Source {
    fn of(input: &Path) -> Result<Self, PipelineError> {
        if perspective::is_run(input) {
            let is_room = PerspectiveManifest::read(input)?.layout == Layout::RgbD;
            return Ok(Self::Photographs { cameras: Box::new(PerspectiveCameras::read(input)?), is_room });
        }
        Ok(if !is_run(input) && PerspectiveScene::is_one(input) { Self::Scene } else { Self::Satellites })
    }

    /// Voxel and greatest depth by default, metres.
    fn defaults(&self) -> (f64, Option<f64>) {
        match self {
            Self::Satellites => (SATELLITE_VOXEL_M, None),
            Self::Photographs { cameras, is_room: false } => {
                let depth_max_m = DEPTH_EXTENTS * cameras.extent_m;
                (depth_max_m / VOXELS_OF_DEPTH, Some(depth_max_m))
            }
            Self::Scene | Self::Photographs { .. } => (ROOM_VOXEL_M, Some(ROOM_DEPTH_M)),
        }
    }
}

fn fuse_options(options: &MeshOptions, source: &Source) -> Result<FuseOptions, PipelineError> {
    let checked = |option, value: f64, least: f64, expected| {
        let found = value.to_string();
        if value.is_finite() && value > 0.0 && value >= least {
            return Ok(value);
        }
        Err(PipelineError::Option { option, found, expected })
    };
    let (default_voxel_m, default_depth_m) = source.defaults();
    let voxel_m = checked("--voxel", options.voxel_m.unwrap_or(default_voxel_m), 0.0, "metres above 0")?;
    let truncation_m = options.truncation_m.unwrap_or(TRUNCATION_VOXELS * voxel_m);
    let least = LEAST_TRUNCATION_VOXELS * voxel_m;
    let truncation_m = checked("--truncation", truncation_m, least, "two voxels or more, in metres")?;
    if let (Some(given), Source::Satellites) = (options.depth_max_m, source) {
        let expected = "no limit: views of satellites have altitudes, not depths";
        return Err(PipelineError::Option { option: "--depth-max", found: given.to_string(), expected });
    }
    let depth_max_m = options.depth_max_m.or(default_depth_m);
    let depth_max_m = depth_max_m.map(|depth| checked("--depth-max", depth, 0.0, "metres above 0"));
    Ok(FuseOptions {
        voxel_m,
        truncation_m,
        depth_max_m: depth_max_m.transpose()?,
        bounds: None,
        kept: KeptPieces::LARGEST,
    })
}

/// The depth maps of a scene's own files.
fn of_scene(path: &Path, options: &FuseOptions, progress: &dyn Progress) -> Result<FusedMesh, PipelineError> {
    let scene = read_perspective(path)?;
    let views: Vec<&PerspectiveView> = scene.views.iter().filter(|v| v.depth.is_some()).collect();
    if views.is_empty() {
        let view = scene.views.first().map(|v| v.name.clone()).unwrap_or_default();
        return Err(PerspectiveError::NoDepth { view }.into());
    }
    let read = |view: &&PerspectiveView| -> Result<DepthMap, PipelineError> {
        let color = Some(view.read_image()?.planes);
        Ok(DepthMap { color, ..DepthMap::new(DepthCamera::Pinhole(view.camera), view.read_depth()?) })
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
    let up = cameras.map(|c| -c.cam_from_site.row(1)).sum::<DVec3>();
    up.try_normalize().unwrap_or(DVec3::Z).to_array()
}

/// The depths of the trained splats in each training view.
fn of_photographs(
    run: &Path,
    cameras: &PerspectiveCameras,
    options: &FuseOptions,
    progress: &dyn Progress,
) -> Result<FusedMesh, PipelineError> {
    let splats = PerspectiveCameras::read_splats(run)?;
    let views: Vec<&TrainedPhoto> = cameras.views.iter().filter(|v| v.role == Role::Train).collect();
    let render = |view: &&TrainedPhoto| -> Result<DepthMap, PipelineError> {
        let camera = view.camera();
        let picture = PinholePicture::render(&splats, &camera);
        let color = Some(picture.colors);
        Ok(DepthMap { color, ..DepthMap::new(DepthCamera::Pinhole(camera), picture.depth) })
    };
    let mut fused = fuse(views.iter().map(render), options, progress)?;
    fused.mesh.site = cameras.site;
    if cameras.site.is_none() {
        fused.mesh.up = mean_up(views.iter().map(|v| v.camera()));
    }
    Ok(fused)
}

/// The altitudes of the trained splats: in each training view, where their transmittance falls to one half, and seen from
/// straight above.
fn of_satellite_run(
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
    map.estimate_normals();
    map
}
