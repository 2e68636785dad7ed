//! `transforms.json` of instant-ngp and nerfstudio, and the three files of a scene of Blender (NeRF): poses from camera to world,
//! camera axes right, up, backward; (0.5, 0.5) is the centre of the first pixel.
//!
//! Alpha 0 means that nothing is there. Frames are trained on or held back as the lists `train_filenames`, `val_filenames` and
//! `test_filenames` say, or as the files `transforms_train.json` and `transforms_test.json`.

mod content;
mod intrinsics;

use super::colmap;
use super::draft::{Draft, Drafts};
use super::error::PerspectiveError;
use super::mask_file::MaskFile;
use super::pose::{LOST_POSE, Pose};
use super::scene_parts::{Layout, ScenePoint};
use super::view::DepthFile;
use crate::frame::Point;
use crate::io::{PlyContent, ReadError, read_python_json, vsi};
use crate::scene::Role;
use content::Transforms;
use glam::{DMat3, DVec3};
use std::path::{Path, PathBuf};

/// Name of the file in a scene's folder.
const NAME: &str = "transforms.json";
/// The files of a scene of Blender, in the order in which they are read.
const TRAIN: &str = "transforms_train.json";
const TEST: &str = "transforms_test.json";
const VAL: &str = "transforms_val.json";
/// Extensions that are tried for a frame whose path has none.
const EXTENSIONS: [&str; 4] = ["png", "jpg", "jpeg", "JPG"];
/// Unit of the file that a stored 1 is in depth maps, unless the file says otherwise: of `depth_file_path` (nerfstudio), and of
/// `depth_path` (instant-ngp).
const DEPTH_FILE_UNIT: f64 = 1e-3;
const DEPTH_UNIT: f64 = 1.0 / 65535.0;
/// Begins the name of a mask beside an image, which is not black where something moves (instant-ngp).
const DYNAMIC_MASK: &str = "dynamic_mask_";
/// The model from which nerfstudio has made the file.
const COLMAP_MODEL: &str = "colmap/sparse/0";
/// Colour of points without one.
const GRAY: [u8; 3] = [128; 3];

/// The file of a scene, given as its folder or itself. Of a scene of Blender any of its files stands for all.
pub(super) fn file_of(path: &Path) -> Option<PathBuf> {
    let is_it = |p: &Path| {
        let name = p.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        name.starts_with("transforms") && name.ends_with(".json") && vsi::exists(p)
    };
    let inside = [NAME, TRAIN, TEST, VAL].map(|name| path.join(name));
    [path.to_path_buf()].into_iter().chain(inside).find(|p| is_it(p))
}

/// The files that are read with one, each with the role of its frames.
fn files_with(path: &Path) -> Vec<(PathBuf, Option<Role>)> {
    let beside = |name: &str| path.with_file_name(name);
    let is_of_blender = [TRAIN, TEST, VAL].iter().any(|name| path.file_name().is_some_and(|n| n == *name));
    if !is_of_blender || !vsi::exists(&beside(TRAIN)) {
        return vec![(path.into(), None)];
    }
    // Validation views are for the choice of settings: published scores are of the test views.
    let held_back = [TEST, VAL].map(beside).into_iter().find(|p| vsi::exists(p));
    let held_back = held_back.map(|p| (p, Some(Role::Test)));
    [(beside(TRAIN), held_back.is_some().then_some(Role::Train))].into_iter().chain(held_back).collect()
}

/// Reads the views of a scene. Frames without an image file or a pose are left out.
pub(super) fn read(path: &Path) -> Result<Drafts, PerspectiveError> {
    let mut drafts = Drafts::of(Layout::Transforms);
    let mut first_missing = None;
    for (file, role) in files_with(path) {
        add_file(&file, role, &mut drafts, &mut first_missing)?;
        drafts.sources.push(file);
    }
    if let (true, Some(first)) = (drafts.views.is_empty(), first_missing) {
        let (missing, hint) =
            (drafts.skipped.len(), "paths of frames are relative to the folder of the file");
        return Err(PerspectiveError::NoImages { missing, of: missing, first, hint });
    }
    Ok(drafts)
}

fn add_file(
    path: &Path,
    role: Option<Role>,
    drafts: &mut Drafts,
    first_missing: &mut Option<PathBuf>,
) -> Result<(), PerspectiveError> {
    let file: Transforms = read_python_json(path)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    if file.frames.is_empty() {
        return Err(PerspectiveError::field(path, "`frames`", "empty", "a list of images with their poses"));
    }
    let lists = Lists::of(path, &file)?;
    let units = [
        (file.depth_unit_scale_factor, file.integer_depth_scale, DEPTH_FILE_UNIT),
        (file.integer_depth_scale, file.depth_unit_scale_factor, DEPTH_UNIT),
    ];
    let [file_unit, unit] = units.map(|(own, other, usual)| own.or(other).unwrap_or(usual));
    if let Some(unit) = [file_unit, unit].into_iter().find(|unit| !(unit.is_finite() && *unit > 0.0)) {
        let field = "`depth_unit_scale_factor` or `integer_depth_scale`";
        return Err(PerspectiveError::field(path, field, unit.to_string(), "a number above zero"));
    }
    for (i, frame) in file.frames.iter().enumerate() {
        let name = frame_name(&frame.file_path);
        let mut skip = |reason: &str| drafts.skipped.push((name.clone(), reason.to_owned()));
        let Some(image) = image_of(folder, &frame.file_path) else {
            first_missing.get_or_insert_with(|| vsi::join(folder, Path::new(&frame.file_path)));
            skip("its image does not exist");
            continue;
        };
        let role = match lists.as_ref().map(|lists| lists.role(&name)) {
            Some(None) => {
                skip("none of the lists of training, validation and test images names it");
                continue;
            }
            of_lists => role.or(of_lists.flatten()),
        };
        let rows: Vec<[f64; 4]> =
            frame.transform_matrix.iter().map(|r| r.map(|v| v.unwrap_or(f64::NAN))).collect();
        if Pose::is_lost(&rows) {
            skip(LOST_POSE);
            continue;
        }
        let pose = Pose::from_opengl_to_world(&rows).map_err(|(found, expected)| {
            PerspectiveError::field(path, format!("`transform_matrix` of frame {i}"), found, expected)
        })?;
        let (lens, size) = intrinsics::lens(path, i, &image, &frame.intrinsics.over(&file.intrinsics))?;
        let beside = |p: &Option<String>| p.as_ref().map(|p| vsi::join(folder, Path::new(p)));
        let depth = beside(&frame.depth_file_path).map(|path| DepthFile::new(path, file_unit));
        let depth = depth.or_else(|| beside(&frame.depth_path).map(|path| DepthFile::new(path, unit)));
        let masks = beside(&frame.mask_path).map(MaskFile::of_used).into_iter();
        drafts.views.push(Draft {
            masks: masks.chain(dynamic_mask(&image)).collect(),
            name,
            image,
            size: Some(size),
            lens,
            pose,
            depth,
            role,
            observed: Vec::new(),
        });
    }
    let source = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let unknown = file.unknown_keys().into_iter();
    drafts.unused.extend(unknown.map(|key| (key, format!("a key of {source} that is not known"))));
    if drafts.points.is_empty() {
        drafts.points = points(folder, &file, drafts)?;
    }
    Ok(())
}

/// The name of a frame's image in the scene: with slashes, from the folder of the file.
fn frame_name(path: &str) -> String {
    let path = path.replace('\\', "/");
    path.strip_prefix("./").unwrap_or(&path).to_owned()
}

/// The image of a frame, if it exists.
fn image_of(folder: &Path, path: &str) -> Option<PathBuf> {
    let image = vsi::join(folder, Path::new(path));
    let guesses = EXTENSIONS.map(|e| PathBuf::from(format!("{}.{e}", image.display())));
    [image].into_iter().chain(guesses).find(|p| vsi::size(p).is_ok())
}

/// The mask of what moves in an image, if there is one beside it.
fn dynamic_mask(image: &Path) -> Option<MaskFile> {
    let stem = image.file_stem()?.to_string_lossy();
    let mask = image.with_file_name(format!("{DYNAMIC_MASK}{stem}.png"));
    vsi::exists(&mask).then(|| MaskFile::of_unused(mask))
}

/// The images to train on and those to hold back, as a file lists them.
struct Lists {
    train: Vec<String>,
    held_back: Vec<String>,
}

impl Lists {
    /// The lists of a file; none if it has none.
    ///
    /// # Errors
    /// [`PerspectiveError::UnknownView`] for a name that no frame has.
    fn of(path: &Path, file: &Transforms) -> Result<Option<Self>, PerspectiveError> {
        let Transforms { train_filenames, val_filenames, test_filenames, frames, .. } = file;
        let all = [train_filenames, val_filenames, test_filenames];
        if all.iter().all(|list| list.is_none()) {
            return Ok(None);
        }
        let names: Vec<String> = frames.iter().map(|frame| frame_name(&frame.file_path)).collect();
        let [train, val, test] = all.map(|list| {
            let listed = list.iter().flatten().map(|name| frame_name(name));
            listed.collect::<Vec<String>>()
        });
        if let Some(name) = [&train, &val, &test].into_iter().flatten().find(|name| !names.contains(name)) {
            let first = names.first().cloned().unwrap_or_default();
            return Err(PerspectiveError::UnknownView { path: path.into(), name: name.clone(), first });
        }
        Ok(Some(Self { train, held_back: [val, test].concat() }))
    }

    /// What is done with an image: what a list holds back is not trained on, even if another list names it for training.
    fn role(&self, name: &str) -> Option<Role> {
        let is_in = |list: &[String]| list.iter().any(|n| n == name);
        if is_in(&self.held_back) { Some(Role::Test) } else { is_in(&self.train).then_some(Role::Train) }
    }
}

/// The points that belong to a file: those of `ply_file_path`, in the frame of the poses, else those of the COLMAP model that
/// nerfstudio has kept, brought to it by `applied_transform`.
fn points(
    folder: &Path,
    file: &Transforms,
    drafts: &mut Drafts,
) -> Result<Vec<ScenePoint>, PerspectiveError> {
    if let Some(name) = &file.ply_file_path {
        let path = vsi::join(folder, Path::new(name));
        drafts.sources.push(path.clone());
        if !vsi::exists(&path) {
            drafts.unused.push((name.clone(), "`ply_file_path` names it, but it does not exist".into()));
            return Ok(Vec::new());
        }
        let bytes = vsi::read(&path).map_err(|e| ReadError::new(&path, e))?;
        let PlyContent { vertices, colors, .. } =
            PlyContent::parse(&bytes).map_err(|reason| ReadError::new(&path, reason))?;
        let colored =
            vertices.into_iter().enumerate().map(|(i, p)| (p, colors.get(i).copied().unwrap_or(GRAY)));
        return Ok(colored.filter(|(p, _)| p.iter().all(|v| v.is_finite())).map(scene_point).collect());
    }
    let model = folder.join(COLMAP_MODEL);
    let Some([a, b, c, ..]) = file.applied_transform.as_deref().filter(|_| colmap::is_model(&model)) else {
        return Ok(Vec::new());
    };
    let linear = DMat3::from_cols_array(&[a[0], b[0], c[0], a[1], b[1], c[1], a[2], b[2], c[2]]);
    let moved = |p: [f64; 3]| (linear * DVec3::from_array(p) + DVec3::new(a[3], b[3], c[3])).to_array();
    Ok(colmap::read(&model)?.points.iter().map(|p| scene_point((moved(p.position), p.rgb))).collect())
}

fn scene_point(([x, y, z], rgb): ([f64; 3], [u8; 3])) -> ScenePoint {
    ScenePoint { position: Point::new(x, y, z), rgb }
}
