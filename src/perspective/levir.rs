//! Scenes of LEVIR-NVS (Wu et al., Remote sensing novel view synthesis with implicit multiplane representations, 2022):
//! `Images/000.png`, `Cams/000.txt` (world to camera,
//! camera axes right, down, forward), `Depths/000.tiff` (metres along the optical axis), and beside the scenes
//! `view_split.txt` with the training and the test views. Pixel (0, 0) is the centre of the first one.

use super::draft::{Draft, Drafts};
use super::error::PerspectiveError;
use super::pose::{LOST_POSE, Pose};
use super::rgbd::pinhole_of;
use super::scene_parts::Layout;
use super::view::DepthFile;
use super::words::{numbers, rows, words_of};
use crate::io::{ReadError, vsi};
use crate::scene::Role;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Folders of a scene.
const IMAGES: &str = "Images";
const CAMERAS: &str = "Cams";
const DEPTHS: &str = "Depths";
/// The file of the training and test views, beside the scenes or in one.
const SPLIT: &str = "view_split.txt";

/// Whether a folder is such a scene.
pub(super) fn is_one(path: &Path) -> bool {
    vsi::is_dir(&path.join(CAMERAS)) && vsi::is_dir(&path.join(IMAGES))
}

/// Reads the views of a scene. Images without a camera are left out.
pub(super) fn read(folder: &Path) -> Result<Drafts, PerspectiveError> {
    let list = |name: &str| -> Result<BTreeSet<PathBuf>, PerspectiveError> {
        let folder = folder.join(name);
        Ok(vsi::list(&folder).map_err(|e| ReadError::new(&folder, e))?.into_iter().collect())
    };
    let (images, cameras) = (list(IMAGES)?, list(CAMERAS)?);
    let depths = list(DEPTHS).unwrap_or_default();
    let tests = test_views(folder)?;
    let (mut views, mut skipped) = (Vec::new(), Vec::new());
    for image in &images {
        let stem = image.file_stem().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let camera = folder.join(CAMERAS).join(format!("{stem}.txt"));
        if !cameras.contains(&camera) {
            skipped.push((format!("{IMAGES}/{stem}"), format!("`{CAMERAS}` has no camera for it")));
            continue;
        }
        let words = words_of(&camera)?;
        let after = |title: &str| {
            let start = words.iter().position(|w| w.trim_end_matches(':').eq_ignore_ascii_case(title));
            let start = start.ok_or_else(|| {
                PerspectiveError::field(&camera, format!("the line `{title}`"), "missing", "a title line")
            })?;
            Ok::<_, PerspectiveError>(words.get(start + 1..).unwrap_or_default())
        };
        let extrinsic = numbers(&camera, "the extrinsic matrix", after("extrinsic")?)?;
        if Pose::is_lost(&rows(&extrinsic)) {
            skipped.push((format!("{IMAGES}/{stem}"), LOST_POSE.to_owned()));
            continue;
        }
        let pose = Pose::from_world_to_camera(&rows(&extrinsic)).map_err(|(found, expected)| {
            PerspectiveError::field(&camera, "the extrinsic matrix", found, expected)
        })?;
        let lens = pinhole_of(&camera, &numbers(&camera, "the intrinsic matrix", after("intrinsic")?)?)?;
        let depth = ["tiff", "tif"].map(|e| folder.join(DEPTHS).join(format!("{stem}.{e}")));
        let depth = depth.into_iter().find(|d| depths.contains(d));
        let number: Option<usize> = stem.parse().ok();
        let role = |tests: &BTreeSet<usize>| {
            if number.is_some_and(|n| tests.contains(&n)) { Role::Test } else { Role::Train }
        };
        views.push(Draft {
            name: stem,
            image: image.clone(),
            size: None,
            lens,
            pose,
            masks: Vec::new(),
            depth: depth.map(|path| DepthFile::new(path, 1.0)),
            role: tests.as_ref().map(role),
            observed: Vec::new(),
        });
    }
    if views.is_empty() && skipped.is_empty() {
        let hint = "a view is Images/NAME.png with Cams/NAME.txt";
        return Err(PerspectiveError::NoViews { path: folder.into(), hint });
    }
    Ok(Drafts { views, skipped, ..Drafts::of(Layout::Levir) })
}

/// Numbers of the test views according to the file of the split; none if there is no such file.
fn test_views(folder: &Path) -> Result<Option<BTreeSet<usize>>, PerspectiveError> {
    let beside = folder.parent().map(|p| p.join(SPLIT));
    let Some(path) = [Some(folder.join(SPLIT)), beside].into_iter().flatten().find(|p| vsi::exists(p)) else {
        return Ok(None);
    };
    let words = words_of(&path)?;
    let number = |word: &String| {
        let wrong =
            || PerspectiveError::field(&path, "a number", format!("`{word}`"), "the number of a view");
        word.parse::<usize>().map_err(|_| wrong())
    };
    let numbers = words.iter().map(number).collect::<Result<Vec<_>, _>>()?;
    let list = |from: usize| {
        let count = numbers.get(from)?;
        numbers.get(from + 1..from.checked_add(1)?.checked_add(*count)?)
    };
    let tests = list(0).and_then(|train| list(train.len() + 1));
    let tests = tests.ok_or_else(|| {
        let expected = "the number of training views, their numbers, and the same for the test views";
        PerspectiveError::field(&path, "the split", format!("{} numbers", numbers.len()), expected)
    })?;
    Ok(Some(tests.iter().copied().collect()))
}
