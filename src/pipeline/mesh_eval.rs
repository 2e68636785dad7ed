//! Scores of a mesh against a reference: `satgs mesh-eval`.

use super::PipelineError;
use super::depth_views::DepthViews;
use crate::frame::SiteGrid;
use crate::io::{check_writable, replaces_georeference};
use crate::mesh::{
    DepthCamera, DepthMap, FuseOptions, KeptPieces, MeshError, MeshFormat, TriangleMesh, fuse, render_depth,
};
use crate::metrics::{MeshScores, MetricsError, error_mesh, mesh_scores};
use crate::mvs::DSM_CELL_M;
use crate::perspective::{DirectionPair, PointPair, SimilarityFit, SimilarityTransform};
use crate::progress::{Event, Progress};
use crate::stats::{FitQuality, MAD_TO_SIGMA, median};
use glam::{DMat3, DQuat, DVec3};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Voxel, truncation distance and greatest depth with which meshes are cut to what pinhole cameras see, metres (the evaluation
/// of Manhattan-SDF).
const ROOM: (f64, f64, Option<f64>) = (0.04, 0.12, Some(5.0));
/// The same for views of satellites, with a voxel of two cells of the surface model.
const SATELLITE: (f64, f64, Option<f64>) = (2.0 * DSM_CELL_M, 6.0 * DSM_CELL_M, None);

/// Attitudes of one camera in two reconstructions agree no better than this, degrees; those that differ by more standard
/// deviations from most others are left out.
const LEAST_ATTITUDE_DEG: f64 = 0.02;
const MOST_ATTITUDE_SIGMAS: f64 = 3.0;

/// How a mesh is scored.
#[derive(Clone, Debug)]
pub struct MeshEvalOptions {
    /// Distance up to which a point counts as correct, metres.
    pub threshold_m: f64,
    /// A run or scene in the frame of the reference: both meshes are cut to what its views see.
    pub views: Option<PathBuf>,
    /// A run or scene in the frame of the mesh, with images of the same names as `views`: the mesh is moved by the similarity
    /// between their camera centres.
    pub align: Option<PathBuf>,
    /// Where to write the mesh coloured by its errors.
    pub error_mesh: Option<PathBuf>,
    /// Replace an existing file.
    pub overwrite: bool,
}

impl Default for MeshEvalOptions {
    fn default() -> Self {
        Self { threshold_m: 0.05, views: None, align: None, error_mesh: None, overwrite: false }
    }
}

/// Scores of a mesh, and what was done to it before.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeshEvaluation {
    /// The scores.
    #[serde(flatten)]
    pub scores: MeshScores,
    /// Number of views that both meshes were cut to; none if they were not.
    pub views: Option<usize>,
    /// The similarity that brought the mesh to the reference; none if it was not moved.
    pub alignment: Option<MeshAlignment>,
}

/// A similarity between camera centres.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeshAlignment {
    /// Number of images in both scenes.
    pub images: usize,
    /// Units of the reference for one of the mesh.
    pub scale: f64,
    /// Agreement of the camera centres after it.
    #[serde(flatten)]
    pub quality: FitQuality,
    /// Whether the attitudes of the cameras had to complete it, because the centres lie near a line.
    pub by_attitudes: bool,
}

/// Scores a mesh (.ply, .obj) against a reference (.ply, .obj).
///
/// # Errors
/// [`PipelineError`]: a file cannot be read, holds no triangles or is in another CRS, the meshes do not overlap or are not
/// seen by the views, the cameras for an alignment are missing, the output exists or cannot be written, the caller asked to stop.
pub fn mesh_eval(
    mesh: &Path,
    reference: &Path,
    options: &MeshEvalOptions,
    progress: &dyn Progress,
) -> Result<MeshEvaluation, PipelineError> {
    if !(options.threshold_m.is_finite() && options.threshold_m > 0.0) {
        let (option, found) = ("--threshold", options.threshold_m.to_string());
        return Err(PipelineError::Option { option, found, expected: "metres above 0" });
    }
    if let Some(path) = &options.error_mesh {
        MeshFormat::of_output(path)?;
        if path.exists() && !options.overwrite {
            return Err(PipelineError::Exists { path: path.clone() });
        }
        check_writable(path)?;
    }
    let mut ours = TriangleMesh::read(mesh)?;
    let mut theirs = TriangleMesh::read(reference)?;
    let views = options.views.as_deref().map(DepthViews::read).transpose()?;
    let alignment = match (&options.align, &views) {
        (Some(path), Some(views)) => Some(align(&mut ours, path, views)?),
        (Some(_), None) => return Err(MetricsError::AlignNeedsViews.into()),
        (None, _) => None,
    };
    let frame = views.as_ref().and_then(|v| v.site).or(theirs.site).or(ours.site);
    for (path, mesh) in [(mesh, &mut ours), (reference, &mut theirs)] {
        move_into(mesh, frame, path, progress)?;
    }
    require_overlap((mesh, &ours), (reference, &theirs), options.threshold_m)?;
    if let Some(views) = &views {
        ours = cut_to_views(&ours, mesh, views, progress)?;
        theirs = cut_to_views(&theirs, reference, views, progress)?;
    }
    progress.check()?;
    let scores = mesh_scores(&ours, &theirs, options.threshold_m)?;
    if let Some(path) = &options.error_mesh {
        let colored = error_mesh(&ours, &theirs, options.threshold_m)?;
        if !options.overwrite && replaces_georeference(path, colored.site.as_ref()) {
            return Err(PipelineError::Exists { path: path.with_extension("georef.json") });
        }
        colored.write(path)?;
    }
    Ok(MeshEvaluation { scores, views: views.map(|v| v.cameras.len()), alignment })
}

/// Moves a mesh by the similarity from the camera centres of its run or scene to those of the views.
fn align(mesh: &mut TriangleMesh, path: &Path, views: &DepthViews) -> Result<MeshAlignment, PipelineError> {
    let own = DepthViews::read(path)?;
    let failed = |reason: String| MetricsError::Alignment { path: path.into(), reason };
    let pinhole = |camera: &DepthCamera| match camera {
        DepthCamera::Pinhole(camera) => Ok(*camera),
        DepthCamera::Parallel { .. } => Err(failed("views of satellites have no camera centres".into())),
    };
    let mut pairs: Vec<PointPair> = Vec::new();
    let mut turns: Vec<DMat3> = Vec::new();
    for (name, camera) in &own.cameras {
        if let Some((_, other)) = views.cameras.iter().find(|(other, _)| other == name) {
            let (from, to) = (pinhole(camera)?, pinhole(other)?);
            let name = name.clone();
            pairs.push(PointPair { name, from: from.center, to: to.center, sigma_m: None });
            turns.push(to.cam_from_site.transpose() * from.cam_from_site);
        }
    }
    if pairs.len() < 3 {
        let found = pairs.len();
        return Err(failed(format!("{found} of its images are among those of --views, 3 are needed")).into());
    }
    let mut fitted = SimilarityFit::new(&pairs, &[]).map_err(failed)?;
    let by_attitudes = !fitted.is_determined();
    if by_attitudes {
        fitted = SimilarityFit::new(&pairs, &common_turn(&turns)).map_err(failed)?;
    }
    if !fitted.is_determined() {
        let sigma = fitted.tilt_sigma_deg().max(fitted.heading_sigma_deg());
        let reason = format!("its cameras leave the turn open by {sigma:.1}° ({})", fitted.quality);
        return Err(failed(reason).into());
    }
    let SimilarityTransform { scale, rotation, translation } = fitted.transform;
    mesh.transform(scale, rotation, translation);
    mesh.site = views.site;
    Ok(MeshAlignment { images: pairs.len(), scale, quality: fitted.quality, by_attitudes })
}

/// Directions that say the turn of most cameras: the axes of the target frame, with the standard deviation of their mean.
fn common_turn(turns: &[DMat3]) -> Vec<DirectionPair> {
    let turns: Vec<DQuat> = turns.iter().map(|turn| DQuat::from_mat3(turn).normalize()).collect();
    let from_others =
        |turn: &DQuat| median(turns.iter().map(|other| turn.angle_between(*other)).collect()).unwrap_or(0.0);
    let middle = turns.iter().map(|turn| (from_others(turn), *turn)).min_by(|a, b| a.0.total_cmp(&b.0));
    let Some((spread, middle)) = middle else { return Vec::new() };
    let sigma = MAD_TO_SIGMA * spread;
    let near: Vec<DQuat> = turns
        .into_iter()
        .filter(|turn| turn.angle_between(middle) <= MOST_ATTITUDE_SIGMAS * sigma)
        .map(|turn| if turn.dot(middle) < 0.0 { -turn } else { turn })
        .collect();
    let sigma_deg = (sigma.to_degrees() / (near.len() as f64).sqrt()).max(LEAST_ATTITUDE_DEG);
    // Quaternions of like turns are averaged as vectors.
    let mean = near.into_iter().fold(middle, |sum, turn| sum + turn).normalize();
    DVec3::AXES.map(|to| DirectionPair { from: mean.inverse() * to, to, sigma_deg }).to_vec()
}

/// Moves a georeferenced mesh into a site frame on the same map. A mesh without georeference is taken to be in the frame.
fn move_into(
    mesh: &mut TriangleMesh,
    frame: Option<SiteGrid>,
    path: &Path,
    progress: &dyn Progress,
) -> Result<(), PipelineError> {
    match (mesh.site, frame) {
        (Some(own), Some(frame)) if own.epsg != frame.epsg => {
            let (path, found, expected) = (path.into(), own.epsg, frame.epsg);
            return Err(MetricsError::MeshCrs { path, found, expected }.into());
        }
        (Some(own), Some(frame)) => {
            let shift = DVec3::from_array((own.origin - frame.origin).xyz());
            mesh.transform(1.0, glam::DMat3::IDENTITY, shift);
        }
        (None, Some(_)) => progress.event(Event::Note(format!(
            "`{}` has no georeference (.georef.json beside it): it is taken to be in the same frame",
            path.display()
        ))),
        _ => {}
    }
    mesh.site = frame;
    Ok(())
}

/// Refuses meshes whose bounding boxes are farther from each other than a distance.
fn require_overlap(
    (mesh, ours): (&Path, &TriangleMesh),
    (reference, theirs): (&Path, &TriangleMesh),
    distance_m: f64,
) -> Result<(), PipelineError> {
    let (Some(a), Some(b)) = (ours.bounds(), theirs.bounds()) else { return Ok(()) };
    let is_apart = |k: usize| a[0][k] > b[1][k] + distance_m || b[0][k] > a[1][k] + distance_m;
    if !(0..3).any(is_apart) {
        return Ok(());
    }
    let text = |[low, high]: [[f64; 3]; 2]| {
        let range = |k: usize| format!("{:.2} to {:.2}", low[k], high[k]);
        format!("x {}, y {}, z {}", range(0), range(1), range(2))
    };
    let extents = format!("{}; {}", text(a), text(b));
    Err(MetricsError::MeshesApart { mesh: mesh.into(), reference: reference.into(), extents }.into())
}

/// What the views see of a mesh: it is rendered to their depths and fused again.
fn cut_to_views(
    mesh: &TriangleMesh,
    path: &Path,
    views: &DepthViews,
    progress: &dyn Progress,
) -> Result<TriangleMesh, PipelineError> {
    let is_pinhole = views.cameras.iter().any(|(_, c)| matches!(c, DepthCamera::Pinhole(_)));
    let (voxel_m, truncation_m, depth_max_m) = if is_pinhole { ROOM } else { SATELLITE };
    let options = FuseOptions { voxel_m, truncation_m, depth_max_m, bounds: None, kept: KeptPieces::ALL };
    let maps = views.cameras.iter().map(|(_, c)| Ok(DepthMap::new(*c, render_depth(mesh, c))));
    match fuse::<PipelineError>(maps, &options, progress) {
        Ok(fused) => Ok(TriangleMesh { site: mesh.site, up: mesh.up, ..fused.mesh }),
        Err(PipelineError::Mesh(MeshError::NoSurface { maps, .. })) => {
            Err(MetricsError::NotSeen { path: path.into(), views: maps }.into())
        }
        Err(e) => Err(e),
    }
}
