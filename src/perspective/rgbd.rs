//! Frames with depth maps in the form of 7-Scenes: `camera-intrinsics.txt` (3 x 3), `frame-*.color.jpg` or `.png`,
//! `frame-*.depth.png` (16-bit, millimetres), `frame-*.pose.txt` (4 x 4, camera to world, camera axes right, down,
//! forward). Pixel (0, 0) is the centre of the first one.

use super::draft::{Draft, Drafts};
use super::error::PerspectiveError;
use super::lens::LensCamera;
use super::pose::{LOST_POSE, Pose};
use super::scene_parts::Layout;
use super::view::DepthFile;
use super::words::{numbers, rows, words_of};
use crate::io::{ReadError, vsi};
use glam::DVec2;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// The file that tells such a folder.
const INTRINSICS: &str = "camera-intrinsics.txt";
/// Ends of the names of colour images.
const COLORS: [&str; 3] = [".color.jpg", ".color.png", ".color.jpeg"];
/// Metres of a stored 1 in a depth map.
const MILLIMETRE: f64 = 1e-3;

/// Whether a folder holds such frames.
pub(super) fn is_one(path: &Path) -> bool {
    vsi::exists(&path.join(INTRINSICS))
}

/// The camera of a 3 x 3 matrix of intrinsic parameters.
pub(super) fn pinhole_of(path: &Path, k: &[f64; 9]) -> Result<LensCamera, PerspectiveError> {
    let [fx, _, cx, _, fy, cy, ..] = *k;
    if k.iter().any(|v| !v.is_finite()) || fx <= 0.0 || fy <= 0.0 {
        let found = format!("{k:?}");
        return Err(PerspectiveError::field(
            path,
            "the intrinsic matrix",
            found,
            "finite, with focal lengths above zero",
        ));
    }
    Ok(LensCamera::pinhole(DVec2::new(fx, fy), DVec2::new(cx, cy), (0, 0)))
}

/// Reads the frames of a folder. Frames without a pose are left out.
pub(super) fn read(folder: &Path) -> Result<Drafts, PerspectiveError> {
    let intrinsics = folder.join(INTRINSICS);
    let lens =
        pinhole_of(&intrinsics, &numbers(&intrinsics, "the intrinsic matrix", &words_of(&intrinsics)?)?)?;
    let files = vsi::list(folder).map_err(|e| ReadError::new(folder, e))?;
    let files: BTreeSet<PathBuf> = files.into_iter().collect();
    let (mut views, mut skipped) = (Vec::new(), Vec::new());
    for image in &files {
        let name = image.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let Some(stem) = COLORS.iter().find_map(|end| name.strip_suffix(end)) else { continue };
        let pose_file = folder.join(format!("{stem}.pose.txt"));
        if !files.contains(&pose_file) {
            skipped.push((name, "it has no file of its pose".to_owned()));
            continue;
        }
        let matrix = numbers(&pose_file, "the pose", &words_of(&pose_file)?)?;
        if Pose::is_lost(&rows(&matrix)) {
            skipped.push((name, LOST_POSE.to_owned()));
            continue;
        }
        let pose = Pose::from_camera_to_world(&rows(&matrix))
            .map_err(|(found, expected)| PerspectiveError::field(&pose_file, "the pose", found, expected))?;
        let depth = folder.join(format!("{stem}.depth.png"));
        views.push(Draft {
            // What follows the last point of a name is its extension.
            name: format!("{stem}.color"),
            image: image.clone(),
            size: None,
            lens,
            pose,
            masks: Vec::new(),
            depth: files.contains(&depth).then_some(DepthFile::new(depth, MILLIMETRE)),
            role: None,
            observed: Vec::new(),
        });
    }
    if views.is_empty() && skipped.is_empty() {
        let hint = "a frame is NAME.color.jpg (or .png), NAME.depth.png and NAME.pose.txt";
        return Err(PerspectiveError::NoViews { path: folder.into(), hint });
    }
    Ok(Drafts { views, skipped, ..Drafts::of(Layout::RgbD) })
}
