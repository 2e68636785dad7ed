//! The surface of a run or of a scene with depth maps as a mesh: `satgs mesh`.

use super::PipelineError;
use super::depth_views::{is_run, read_perspective};
use super::mesh_sources::{
    ViewDepths, depths_of_scene, of_perspective_run, of_satellite_run, of_scene, sampled_depths,
};
use super::run_folder::perspective_manifest;
use super::{PerspectiveCameras, PerspectiveManifest};
use crate::io::{check_writable, replaces_georeference};
use crate::mesh::{FuseOptions, FusedMesh, KeptPieces, MeshFormat};
use crate::mvs::DSM_CELL_M;
use crate::perspective::{Layout, PerspectiveScene, PinholeCamera};
use crate::progress::Progress;
use crate::splat::pinhole::focus;
use crate::stats::quantile;
use glam::DVec3;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Voxels of satellite runs, and of RGB-D scenes (IndoorSplat's rooms), metres.
const SATELLITE_VOXEL_M: f64 = DSM_CELL_M;
const ROOM_VOXEL_M: f64 = 0.02;
/// Truncation distance in voxels (the scripts of 2D Gaussian splatting for DTU), and the fewest that leave no holes.
const TRUNCATION_VOXELS: f64 = 4.0;
const LEAST_TRUNCATION_VOXELS: f64 = 2.0;
/// Memory and time grow with the truncation distance in voxels: this is far beyond what a depth map can tell.
const MOST_TRUNCATION_VOXELS: f64 = 64.0;
/// Greatest depth that is used in RGB-D scenes, metres (IndoorSplat).
const ROOM_DEPTH_M: f64 = 5.0;
/// Greatest depth of other perspective scenes as a multiple of the least distance of a camera from the place that all
/// look at, and the number of voxels in it (2D Gaussian splatting, for scenes of any unit).
const PHOTOGRAPH_DEPTH: f64 = 2.0;
const PHOTOGRAPH_VOXELS: f64 = 1024.0;
/// The depth of scenes from inside to which their voxels refer, a quantile of the depths, and the number of voxels in it: 2 cm of
/// 5 m.
const INSIDE_DEPTH: f64 = 0.95;
const INSIDE_VOXELS: f64 = 250.0;
/// Greatest depth that is used of scenes from inside, a quantile: splats float beyond the walls, a sensor is seldom wrong.
const RENDERED_DEPTH: f64 = INSIDE_DEPTH;
const MEASURED_DEPTH: f64 = 0.999;

/// How a mesh is made.
#[derive(Clone, Debug, Default)]
pub struct MeshOptions {
    /// Side of a voxel, metres. The default for a scene, or a run of it: 0.5 for satellite images, 0.02 for RGB-D frames and ScanNet++,
    /// a 250th of the 95 % quantile of the depths for other photographs from inside (as of a room), else a 1024th of `depth_max_m`.
    pub voxel_m: Option<f64>,
    /// Truncation distance of the TSDF, metres; by default four voxels.
    pub truncation_m: Option<f64>,
    /// Greater depths are not used, metres; not for satellite runs. The default for a scene, or a run of it: 5 for RGB-D frames and
    /// ScanNet++, for other photographs from inside the 99.9 % quantile of the depths (of a run 95 %), else twice the distance of the
    /// nearest camera from the point that all cameras look at.
    pub depth_max_m: Option<f64>,
    /// Replace an existing file.
    pub overwrite: bool,
}

impl MeshOptions {
    /// Whether voxel and greatest depth are given.
    fn has_limits(&self) -> bool {
        self.voxel_m.is_some() && self.depth_max_m.is_some()
    }
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
    /// Share of the depths that lie beyond it, 0 to 1; none without a limit.
    pub depths_beyond: Option<f64>,
    /// Memory of the voxels, megabytes.
    pub volume_mb: f64,
    /// EPSG code of the map on which the mesh lies, if it is georeferenced.
    pub epsg: Option<u32>,
}

/// Fuses depth maps to a mesh (.ply, .obj, .glb) of the largest pieces, with colours: the altitudes that a trained satellite
/// run shows in its views and from straight above, the depths that a trained perspective run shows, or the depth maps of a scene.
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
    let source = Source::of(input, options)?;
    let fuse_options = fuse_options(options, &source)?;
    let FusedMesh { mesh, maps, pieces, volume_bytes, beyond } = match source {
        Source::Scene(_) => of_scene(input, &fuse_options, progress)?,
        Source::PerspectiveRun(_) => of_perspective_run(input, &fuse_options, progress)?,
        Source::SatelliteRun => of_satellite_run(input, fuse_options, progress)?,
    };
    if !options.overwrite && replaces_georeference(output, mesh.site.as_ref()) {
        return Err(PipelineError::Exists { path: output.with_extension("georef.json") });
    }
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
        depths_beyond: fuse_options.depth_max_m.map(|_| beyond),
        volume_mb: volume_bytes as f64 / 1e6,
        epsg: mesh.site.map(|site| site.epsg),
    })
}

/// What a mesh is made from.
enum Source {
    /// The depth maps of a scene.
    Scene(DepthDefaults),
    /// A trained perspective scene.
    PerspectiveRun(DepthDefaults),
    /// A trained satellite scene.
    SatelliteRun,
}

/// Voxel and greatest depth of perspective scenes unless others are asked for, metres or units of the scene.
#[derive(Clone, Copy)]
struct DepthDefaults {
    voxel_m: f64,
    depth_max_m: f64,
}

impl DepthDefaults {
    const OF_ROOMS: Self = Self { voxel_m: ROOM_VOXEL_M, depth_max_m: ROOM_DEPTH_M };

    fn of(layout: Layout, cameras: &[PinholeCamera]) -> Self {
        if is_room(layout) {
            return Self::OF_ROOMS;
        }
        let depth_max_m = PHOTOGRAPH_DEPTH * distance_to_focus(cameras);
        Self { voxel_m: depth_max_m / PHOTOGRAPH_VOXELS, depth_max_m }
    }

    fn of_run(run: &Path, options: &MeshOptions) -> Result<Self, PipelineError> {
        let training = PerspectiveCameras::read(run)?.training_cameras();
        let layout = PerspectiveManifest::read(run)?.layout;
        let outside = Self::of(layout, &training);
        if is_room(layout) || options.has_limits() {
            return Ok(outside);
        }
        let views = sampled_depths(run, &training)?;
        let looks_at_focus = look_at(focus(&training), &views);
        let inside = Self::of_inside(&views, RENDERED_DEPTH).filter(|_| !looks_at_focus);
        Ok(inside.unwrap_or(outside))
    }

    /// Of a scene, whose depths are known: it is seen from inside if many lie beyond the limit of scenes that are not.
    fn of_scene(scene: &PerspectiveScene, options: &MeshOptions) -> Result<Self, PipelineError> {
        let cameras: Vec<PinholeCamera> = scene.views.iter().map(|v| v.camera).collect();
        let outside = Self::of(scene.layout, &cameras);
        if is_room(scene.layout) || options.has_limits() {
            return Ok(outside);
        }
        let views = depths_of_scene(scene)?;
        let reaches = |own: &Self| own.voxel_m * INSIDE_VOXELS > outside.depth_max_m;
        Ok(Self::of_inside(&views, MEASURED_DEPTH).filter(reaches).unwrap_or(outside))
    }

    /// Of scenes that are seen from inside, with depths up to a quantile; none without depths.
    fn of_inside(views: &[ViewDepths], used: f64) -> Option<Self> {
        let depths = || views.iter().flat_map(|view| view.depths.iter().copied()).collect();
        let voxel_m = quantile(depths(), INSIDE_DEPTH)? / INSIDE_VOXELS;
        Some(Self { voxel_m, depth_max_m: quantile(depths(), used)? })
    }
}

impl Source {
    fn of(input: &Path, options: &MeshOptions) -> Result<Self, PipelineError> {
        if !is_run(input) {
            if !PerspectiveScene::is_one(input) {
                return Ok(Self::SatelliteRun);
            }
            return Ok(Self::Scene(DepthDefaults::of_scene(&read_perspective(input)?, options)?));
        }
        if !perspective_manifest::is_run(input) {
            return Ok(Self::SatelliteRun);
        }
        Ok(Self::PerspectiveRun(DepthDefaults::of_run(input, options)?))
    }

    /// Default voxel and greatest depth, metres.
    fn defaults(&self) -> (f64, Option<f64>) {
        match *self {
            Self::Scene(own) | Self::PerspectiveRun(own) => (own.voxel_m, Some(own.depth_max_m)),
            Self::SatelliteRun => (SATELLITE_VOXEL_M, None),
        }
    }
}

/// Whether scenes of a layout are rooms in metres.
fn is_room(layout: Layout) -> bool {
    matches!(layout, Layout::RgbD | Layout::ScanNetPp)
}

/// Distance from the place that all cameras look at to the nearest camera.
fn distance_to_focus(cameras: &[PinholeCamera]) -> f64 {
    let focus = focus(cameras);
    cameras.iter().map(|c| c.center.distance(focus)).fold(f64::INFINITY, f64::min)
}

/// Whether views show a place that is nearest to their optical axes: what most of them have in their middle is not farther than the
/// greatest depth allows. Views from inside a scene, as of a room, do not: their axes pass close to each other near the cameras.
fn look_at(place: DVec3, views: &[ViewDepths]) -> bool {
    let ratio = |view: &ViewDepths| Some(view.in_the_middle? / view.camera.center.distance(place));
    quantile(views.iter().filter_map(ratio).collect(), 0.5).is_none_or(|ratio| ratio <= PHOTOGRAPH_DEPTH)
}

fn fuse_options(options: &MeshOptions, source: &Source) -> Result<FuseOptions, PipelineError> {
    let checked = |option, value: f64, least: f64, expected| {
        let found = value.to_string();
        if value.is_finite() && value > 0.0 && value >= least {
            return Ok(value);
        }
        Err(PipelineError::Option { option, found, expected })
    };
    let (default_voxel_m, default_depth_max_m) = source.defaults();
    let voxel_m = checked("--voxel", options.voxel_m.unwrap_or(default_voxel_m), 0.0, "metres above 0")?;
    let truncation_m = options.truncation_m.unwrap_or(TRUNCATION_VOXELS * voxel_m);
    let least = LEAST_TRUNCATION_VOXELS * voxel_m;
    let truncation_m = checked("--truncation", truncation_m, least, "two voxels or more, in metres")?;
    if truncation_m > MOST_TRUNCATION_VOXELS * voxel_m {
        let (found, expected) = (truncation_m.to_string(), "64 voxels or fewer, in metres");
        return Err(PipelineError::Option { option: "--truncation", found, expected });
    }
    if let (Some(given), None) = (options.depth_max_m, default_depth_max_m) {
        let expected = "no limit: views of satellites have altitudes, not depths";
        return Err(PipelineError::Option { option: "--depth-max", found: given.to_string(), expected });
    }
    let depth_max_m = options.depth_max_m.or(default_depth_max_m);
    let depth_max_m = depth_max_m.map(|given| checked("--depth-max", given, 0.0, "metres above 0"));
    Ok(FuseOptions {
        voxel_m,
        truncation_m,
        depth_max_m: depth_max_m.transpose()?,
        bounds: None,
        kept: KeptPieces::LARGEST,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec2};

    /// A camera at a place that looks along an axis.
    fn camera(center: DVec3, axis: DVec3) -> PinholeCamera {
        let forward = axis.normalize();
        let right = forward.any_orthonormal_vector();
        let cam_from_site = DMat3::from_cols(right, forward.cross(right), forward).transpose();
        let principal = DVec2::splat(31.5);
        PinholeCamera { cam_from_site, center, focal: DVec2::splat(60.0), principal, size: (64, 64) }
    }

    /// Whether cameras that have a depth in their middle look at one place.
    fn look_at_one_place(views: impl Iterator<Item = (PinholeCamera, f64)>) -> bool {
        let view = |(camera, depth)| ViewDepths { camera, depths: Vec::new(), in_the_middle: Some(depth) };
        let views: Vec<_> = views.map(view).collect();
        let cameras: Vec<_> = views.iter().map(|view| view.camera).collect();
        look_at(focus(&cameras), &views)
    }

    #[test]
    fn cameras_of_a_room_look_at_no_place_and_those_around_or_above_one_do() {
        let around = |k: u32| DVec3::new(f64::from(k).cos(), f64::from(k).sin(), 0.1 * f64::from(k % 3));
        let room = (0..60).map(|k| (camera(0.8 * around(k), around(k + 20)), 3.0));
        assert!(!look_at_one_place(room));
        // Most of a room, from one of its corners.
        let turned = |k: u32| DVec3::new(1.0, 0.8 * f64::from(k).sin(), 0.3 * f64::from(k).cos());
        let corner = (0..40).map(|k| (camera(0.3 * around(k), turned(3 * k)), 3.0));
        assert!(!look_at_one_place(corner));
        let orbit = (0..40).map(|k| (camera(4.0 * around(k), -around(k)), 3.8));
        assert!(look_at_one_place(orbit));
        let place = |k: u32| DVec3::new(f64::from(k % 8), f64::from(k / 8), 9.0);
        let block = (0..64).map(|k| (camera(place(k), DVec3::new(3.5, 3.5, 0.0) - place(k)), 9.0));
        assert!(look_at_one_place(block));
    }
}
