//! RGB-D frames, as a sensor takes them that is carried along a path.

use super::{PinholeCamera, Scenery};
use crate::frame::Pixel;
use crate::io::{WriteError, write_file, write_png_gray16, write_png_rgb};
use crate::progress::{Event, Progress};
use crate::simulate::error::SimulateError;
use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Folder of the frames.
pub(in crate::simulate) const FRAMES: &str = "frames";
/// The file of the stated intrinsic parameters.
const INTRINSICS: &str = "camera-intrinsics.txt";
/// Ends of the names of files of a frame.
const ENDS: [&str; 3] = [".color.png", ".depth.png", ".pose.txt"];
/// Focal length of a depth camera over that of the colour camera, and its place in the colour camera's axes (right, down,
/// forward), metres: much as in the first Kinect.
const DEPTH_FOCAL: f64 = 1.1;
const DEPTH_OFFSET_M: DVec3 = DVec3::new(-0.025, 0.004, 0.0);
/// Stored numbers of a metre of depth.
const PER_METRE: f64 = 1000.0;

/// Which camera the intrinsic parameters and poses of RGB-D frames state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StatedCamera {
    /// The one camera of colours and depths, which are registered.
    Registered,
    /// The depth camera; the colour camera stands beside it and has a shorter focal length.
    Depth,
    /// The colour camera; the depth camera stands beside it and has a longer focal length.
    Color,
}

/// Writes frames of these colour cameras to the folder [`FRAMES`].
pub(in crate::simulate) fn write_frames(
    out: &Path,
    scenery: &dyn Scenery,
    cameras: &[PinholeCamera],
    stated: StatedCamera,
    progress: &dyn Progress,
) -> Result<(), SimulateError> {
    let folder = out.join(FRAMES);
    progress.event(Event::Started { stage: "taking RGB-D frames", total: cameras.len() as u64 });
    for (i, color) in cameras.iter().enumerate() {
        progress.check()?;
        let depth = if stated == StatedCamera::Registered { color.clone() } else { depth_camera(color) };
        let named = if stated == StatedCamera::Depth { &depth } else { color };
        if i == 0 {
            write_file(&folder.join(INTRINSICS), intrinsics(named))?;
        }
        write_frame(&folder, i, scenery, [color, &depth, named])?;
        progress.event(Event::Advanced { done: i as u64 + 1, status: String::new() });
    }
    progress.event(Event::Finished);
    Ok(())
}

/// The depth camera beside a colour camera.
fn depth_camera(color: &PinholeCamera) -> PinholeCamera {
    let [right, down, forward] = color.axes;
    let DVec3 { x, y, z } = DEPTH_OFFSET_M;
    let center = color.center + right * x + down * y + forward * z;
    PinholeCamera { center, focal_px: DEPTH_FOCAL * color.focal_px, ..color.clone() }
}

fn write_frame(
    folder: &Path,
    i: usize,
    scenery: &dyn Scenery,
    [color, depth, named]: [&PinholeCamera; 3],
) -> Result<(), WriteError> {
    let size = color.size_px;
    let [color_file, depth_file, pose_file] = ENDS.map(|end| folder.join(format!("frame-{i:06}{end}")));
    write_png_rgb(&color_file, size, size, &scenery.picture(color))?;
    let stored = |k: usize| {
        let along = depth.direction(Pixel::new((k % size) as f64, (k / size) as f64));
        scenery.first_hit(depth.center, along).map_or(0, |hit| (PER_METRE * hit.distance).round() as u16)
    };
    let depths: Vec<u16> = (0..size * size).into_par_iter().map(stored).collect();
    write_png_gray16(&depth_file, size, size, &depths)?;
    write_file(&pose_file, pose(named))
}

fn intrinsics(camera: &PinholeCamera) -> String {
    let (focal, middle) = (camera.focal_px, 0.5 * (camera.size_px as f64 - 1.0));
    format!("{focal} 0 {middle}\n0 {focal} {middle}\n0 0 1\n")
}

/// The matrix from camera to world, row by row.
fn pose(camera: &PinholeCamera) -> String {
    let [right, down, forward] = camera.axes;
    let row = |k: usize| format!("{} {} {} {}\n", right[k], down[k], forward[k], camera.center[k]);
    format!("{}{}{}0 0 0 1\n", row(0), row(1), row(2))
}

/// The files of frames in a folder of an earlier simulation.
pub(in crate::simulate) fn frame_files(out: &Path) -> Vec<PathBuf> {
    let folder = out.join(FRAMES);
    let is_one = |name: &str| {
        name == INTRINSICS || (name.starts_with("frame-") && ENDS.iter().any(|end| name.ends_with(end)))
    };
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter(|e| is_one(&e.file_name().to_string_lossy())).map(|e| e.path()).collect()
}
