//! COLMAP projects: a model and the images it was made from.

use super::super::draft::{Draft, Drafts};
use super::super::error::PerspectiveError;
use super::super::mask_file::mask_in;
use super::super::scene_parts::{Layout, ScenePoint};
use super::{ColmapModel, format_of, read};
use crate::frame::Point;
use crate::io::vsi;
use std::path::{Path, PathBuf};

/// Where a model may lie in a project, and where images may lie relative to the model's folder.
const MODELS: [&str; 4] = ["sparse/0", "sparse", "0", ""];
const IMAGES: [&str; 5] = ["images", "../images", "../../images", "", "../.."];
/// Folder of masks beside that of images.
const MASKS: &str = "masks";

/// Folders of a COLMAP project.
pub(in super::super) struct Project {
    /// The folder of the model.
    pub model: PathBuf,
}

/// The model of a project; none if the folder holds no COLMAP model.
pub(in super::super) fn project(path: &Path) -> Option<Project> {
    let model = MODELS.iter().map(|m| if m.is_empty() { path.into() } else { path.join(m) });
    model.into_iter().find(|m: &PathBuf| format_of(m).is_some()).map(|model| Project { model })
}

/// Whether a folder holds a COLMAP model.
pub(in super::super) fn is_project(path: &Path) -> bool {
    project(path).is_some()
}

/// Whether a folder is a COLMAP model.
pub(in super::super) fn is_model(folder: &Path) -> bool {
    format_of(folder).is_some()
}

/// Reads the views and points of a project.
pub(in super::super) fn read_project(project: &Project) -> Result<Drafts, PerspectiveError> {
    let model = read(&project.model)?;
    let root = image_root(&model, &project.model)?;
    let masks = root.parent().map(|p| p.join(MASKS)).filter(|m| vsi::is_dir(m));
    let mut drafts = drafts(&model, &root, masks.as_deref());
    let (folder, name) = (project.model.parent(), project.model.file_name());
    if let Some(folder) = folder.filter(|f| name.is_some_and(|n| n == "0") && f.ends_with("sparse")) {
        let others = vsi::list(folder).unwrap_or_default().into_iter();
        let mut others: Vec<PathBuf> =
            others.filter(|o| *o != project.model && format_of(o).is_some()).collect();
        others.sort();
        let reason = "another model of the project; only sparse/0 is read";
        drafts.skipped.extend(others.iter().map(|o| (o.display().to_string(), reason.to_owned())));
    }
    Ok(drafts)
}

/// The views and points of a model whose images are in the folder `root`.
pub(in super::super) fn drafts(model: &ColmapModel, root: &Path, masks: Option<&Path>) -> Drafts {
    let cameras: std::collections::BTreeMap<u32, _> =
        model.cameras.iter().map(|c| (c.id, c.lens())).collect();
    let mut observed: std::collections::BTreeMap<u32, Vec<u32>> = Default::default();
    for (i, point) in model.points.iter().enumerate() {
        for (image, _) in &point.track {
            observed.entry(*image).or_default().push(i as u32);
        }
    }
    // A track may name an image twice.
    observed.values_mut().for_each(Vec::dedup);
    let mut views = Vec::with_capacity(model.images.len());
    for image in &model.images {
        // `read` has checked that the camera and the pose are right.
        if let (Some(Some(lens)), Ok(pose)) = (cameras.get(&image.camera), image.pose()) {
            let name = image.name.replace('\\', "/");
            views.push(Draft {
                image: vsi::join(root, Path::new(&image.name)),
                masks: masks.and_then(|folder| mask_in(folder, &name)).into_iter().collect(),
                name,
                size: Some(lens.size),
                lens: *lens,
                pose,
                depth: None,
                role: None,
                observed: observed.remove(&image.id).unwrap_or_default(),
            });
        }
    }
    let points = model.points.iter().map(|p| {
        let [x, y, z] = p.position;
        ScenePoint { position: Point::new(x, y, z), rgb: p.rgb }
    });
    let mut drafts = Drafts { views, points: points.collect(), ..Drafts::of(Layout::Colmap) };
    if let Some(folder) = masks {
        drafts.say_which_lack_masks(folder);
    }
    drafts
}

/// The folder of the images: the one that holds most of them.
fn image_root(model: &ColmapModel, folder: &Path) -> Result<PathBuf, PerspectiveError> {
    const HINT: &str = "images are looked for in `images` beside the model or one or two folders above it; copy them all, or remove \
         the images from the model";
    let candidates = IMAGES.map(|i| if i.is_empty() { folder.to_path_buf() } else { vsi_join(folder, i) });
    let file = |root: &Path, name: &str| vsi::join(root, Path::new(name));
    let is_missing = |path: &PathBuf| !vsi::exists(path);
    let missing =
        |root: &PathBuf| model.images.iter().map(|i| file(root, &i.name)).filter(is_missing).count();
    let of = model.images.len();
    let mut best: Option<(usize, PathBuf)> = None;
    for root in candidates {
        let missing = missing(&root);
        if missing == 0 {
            return Ok(root);
        }
        if best.as_ref().is_none_or(|b| missing < b.0) {
            best = Some((missing, root));
        }
    }
    let (missing, root) = best.unwrap_or((of, folder.join("images")));
    let root = if missing == of {
        vsi_join(folder, if folder.ends_with("0") { "../../images" } else { "images" })
    } else {
        root
    };
    let first = model.images.iter().map(|i| file(&root, &i.name)).find(is_missing).unwrap_or(root.clone());
    Err(PerspectiveError::NoImages { missing, of, first, hint: HINT })
}

/// A path relative to a folder with `..` resolved by name.
fn vsi_join(folder: &Path, relative: &str) -> PathBuf {
    let mut out = folder.to_path_buf();
    let mut rest = relative;
    while let Some(up) = rest.strip_prefix("..") {
        // A folder that is given by a short relative path has no name to remove.
        if out.file_name().is_none() || !out.pop() {
            return folder.join(relative);
        }
        rest = up.trim_start_matches('/');
    }
    if rest.is_empty() { out } else { out.join(rest) }
}
