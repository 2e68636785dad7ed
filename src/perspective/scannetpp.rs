//! Scenes of ScanNet++ (Yeshwanth et al., ScanNet++: a high-fidelity dataset of 3D indoor scenes, 2023), their part that a DSLR has
//! photographed: `dslr/colmap`, a COLMAP model in metres whose images have the distortion of the lens,
//! `dslr/resized_images`, and, where they exist, `dslr/resized_anon_masks`, `dslr/render_depth` (millimetres, which the
//! toolbox of the dataset renders from the laser scan) and `dslr/train_test_lists.json`.

use super::colmap;
use super::draft::Drafts;
use super::error::PerspectiveError;
use super::scene_parts::Layout;
use super::view::DepthFile;
use crate::io::{read_json, vsi};
use crate::scene::Role;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// The part of a scene that is read, and its files and folders.
const PART: &str = "dslr";
const MODEL: &str = "colmap";
const IMAGES: &str = "resized_images";
const MASKS: &str = "resized_anon_masks";
const DEPTHS: &str = "render_depth";
const SPLIT: &str = "train_test_lists.json";
/// Metres of a stored 1 of the depths.
const DEPTH_UNIT_M: f64 = 1e-3;

/// The images to train on and those to hold back.
#[derive(Deserialize)]
struct Split {
    train: Vec<String>,
    test: Vec<String>,
}

/// The folder `dslr` of a scene, given as the scene or itself; none if there is no model in it.
pub(super) fn part_of(path: &Path) -> Option<PathBuf> {
    let folders = [path.join(PART), path.to_path_buf()];
    folders.into_iter().find(|p| colmap::is_model(&p.join(MODEL)) && vsi::is_dir(&p.join(IMAGES)))
}

/// Reads the views and points of a scene. Images that do not exist are left out, as are those that neither list of the split
/// names.
pub(super) fn read(part: &Path) -> Result<Drafts, PerspectiveError> {
    let model = colmap::read(&part.join(MODEL))?;
    let masks = Some(part.join(MASKS)).filter(|m| vsi::is_dir(m));
    let mut drafts = colmap::drafts(&model, &part.join(IMAGES), masks.as_deref());
    drafts.layout = Layout::ScanNetPp;
    let split = split(part)?;
    let mut skipped = Vec::new();
    drafts.views.retain_mut(|view| {
        view.role = split.as_ref().and_then(|s| s.role(&view.name));
        let reason = if !vsi::exists(&view.image) {
            "its image does not exist"
        } else if split.is_some() && view.role.is_none() {
            "train_test_lists.json does not name it"
        } else {
            let path = part.join(DEPTHS).join(&view.name).with_extension("png");
            view.depth = vsi::exists(&path).then_some(DepthFile::new(path, DEPTH_UNIT_M));
            return true;
        };
        skipped.push((view.name.clone(), reason.to_owned()));
        false
    });
    if drafts.views.is_empty() {
        let hint =
            "a view is an image of dslr/resized_images that dslr/colmap and train_test_lists.json name";
        return Err(PerspectiveError::NoViews { path: part.into(), hint });
    }
    drafts.skipped.extend(skipped);
    Ok(drafts)
}

impl Split {
    fn role(&self, name: &str) -> Option<Role> {
        let is_in = |list: &[String]| list.iter().any(|n| n == name);
        if is_in(&self.test) { Some(Role::Test) } else { is_in(&self.train).then_some(Role::Train) }
    }
}

fn split(part: &Path) -> Result<Option<Split>, PerspectiveError> {
    let path = part.join(SPLIT);
    if !vsi::exists(&path) {
        return Ok(None);
    }
    Ok(Some(read_json(&path)?))
}
