//! What a perspective scene is, to be compared with what a stage was made from.

use super::super::PipelineError;
use super::perspective_cameras::TrainedPhoto;
use super::stage::{Fingerprint, hash, hash_file};
use crate::perspective::PerspectiveScene;
use crate::scene::Role;

/// What a scene is: its cameras, points and images.
pub fn perspective_fingerprint(scene: &PerspectiveScene) -> Result<Fingerprint, PipelineError> {
    let cameras: Vec<_> = scene.views.iter().map(TrainedPhoto::new).collect();
    let place = scene.georeference.as_ref().map(|g| (g.grid, g.scale, g.rotation, g.translation));
    let cameras = serde_json::to_string(&(cameras, place))
        .map_err(|source| PipelineError::Json { what: "the cameras", source })?;
    let roles = scene.views.iter().filter(|v| v.role == Role::Test).map(|v| v.name.as_str());
    let points: Vec<u8> = scene
        .points
        .iter()
        .flat_map(|p| p.position.xyz().into_iter().flat_map(f64::to_le_bytes).chain(p.rgb))
        .collect();
    // The cameras above are those of undistorted images.
    let lenses: Vec<_> =
        scene.views.iter().map(|v| (v.lens_camera, v.depth.as_ref().map(|d| d.metres_per_unit))).collect();
    let downsampling = scene.views.first().map_or(1, |v| v.downsampling);
    let mut out = Fingerprint::from([
        ("cameras".into(), hash(cameras.as_bytes())),
        ("lenses".into(), hash(format!("{lenses:?}").as_bytes())),
        ("points".into(), hash(&points)),
        ("--downsampling".into(), downsampling.to_string()),
        ("--test-views".into(), roles.collect::<Vec<_>>().join(", ")),
    ]);
    if let Some((_, meaning)) = scene.transparency() {
        out.insert("--transparent".into(), format!("{meaning:?}"));
    }
    for view in scene.training() {
        out.insert(format!("image {}", view.name), hash_file(&view.image));
        for mask in &view.masks {
            let use_of_marked = if mask.marks_used { "mask" } else { "mask of what is not used" };
            let file = mask.path.file_name().unwrap_or_default().to_string_lossy();
            out.insert(format!("{use_of_marked} {} {file}", view.name), hash_file(&mask.path));
        }
        if let Some(depth) = view.depth.as_ref().filter(|_| scene.points.is_empty()) {
            out.insert(format!("depth map {}", view.name), hash_file(&depth.path));
        }
    }
    Ok(out)
}
