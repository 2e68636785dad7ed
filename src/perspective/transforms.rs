//! `transforms.json` of instant-ngp and nerfstudio: poses from camera to world, camera axes right, up, backward;
//! (0.5, 0.5) is the centre of the first pixel.

use super::draft::{Draft, Drafts};
use super::error::PerspectiveError;
use super::lens::{LensCamera, LensModel};
use super::pose::Pose;
use super::scene_parts::Layout;
use super::view::DepthFile;
use crate::io::{ImageFile, ReadError, vsi};
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Name of the file in a scene's folder.
const NAME: &str = "transforms.json";
/// Extensions that are tried for a frame whose path has none.
const EXTENSIONS: [&str; 4] = ["png", "jpg", "jpeg", "JPG"];
/// Metres of a stored 1 in integer depth maps, unless the file says otherwise (nerfstudio).
const DEPTH_UNIT: f64 = 1e-3;

/// Intrinsic parameters, of all frames or of one.
#[derive(Clone, Debug, Default, Deserialize)]
struct Intrinsics {
    camera_model: Option<String>,
    is_fisheye: Option<bool>,
    w: Option<f64>,
    h: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
}

/// One image.
#[derive(Clone, Debug, Deserialize)]
struct Frame {
    file_path: String,
    transform_matrix: Vec<[Option<f64>; 4]>,
    mask_path: Option<String>,
    depth_file_path: Option<String>,
    #[serde(flatten)]
    intrinsics: Intrinsics,
}

#[derive(Clone, Debug, Deserialize)]
struct Transforms {
    #[serde(default)]
    frames: Vec<Frame>,
    depth_unit_scale_factor: Option<f64>,
    #[serde(flatten)]
    intrinsics: Intrinsics,
}

/// The file of a scene, given as its folder or itself.
pub(super) fn file_of(path: &Path) -> Option<PathBuf> {
    let is_it = |p: &Path| {
        let name = p.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        name.starts_with("transforms") && name.ends_with(".json") && vsi::exists(p)
    };
    let inside = path.join(NAME);
    [path.to_path_buf(), inside].into_iter().find(|p| is_it(p))
}

/// Reads the views of a file. Frames without an image file are left out.
pub(super) fn read(path: &Path) -> Result<Drafts, PerspectiveError> {
    let bytes = vsi::read(path).map_err(|e| ReadError::new(path, e))?;
    let file: Transforms = serde_json::from_slice(&bytes).map_err(|e| ReadError::new(path, e))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    if file.frames.is_empty() {
        return Err(PerspectiveError::field(path, "`frames`", "empty", "a list of images with their poses"));
    }
    let (mut views, mut skipped) = (Vec::new(), Vec::new());
    let mut first_missing = None;
    for (i, frame) in file.frames.iter().enumerate() {
        let Some(image) = image_of(folder, &frame.file_path) else {
            first_missing.get_or_insert_with(|| vsi::join(folder, Path::new(&frame.file_path)));
            skipped.push((frame.file_path.clone(), "its image does not exist".to_owned()));
            continue;
        };
        let rows: Vec<[f64; 4]> =
            frame.transform_matrix.iter().map(|r| r.map(|v| v.unwrap_or(f64::NAN))).collect();
        let pose = Pose::from_opengl_to_world(&rows).map_err(|(found, expected)| {
            PerspectiveError::field(path, format!("`transform_matrix` of frame {i}"), found, expected)
        })?;
        let (lens, size) = lens(path, i, &image, &frame.intrinsics.over(&file.intrinsics))?;
        let beside = |p: &Option<String>| p.as_ref().map(|p| vsi::join(folder, Path::new(p)));
        views.push(Draft {
            name: frame.file_path.trim_start_matches("./").into(),
            image,
            size: Some(size),
            lens,
            pose,
            mask: beside(&frame.mask_path),
            depth: beside(&frame.depth_file_path)
                .map(|path| DepthFile::new(path, file.depth_unit_scale_factor.unwrap_or(DEPTH_UNIT))),
            role: None,
            observed: Vec::new(),
        });
    }
    if let (true, Some(first)) = (views.is_empty(), first_missing) {
        let (missing, hint) = (skipped.len(), "paths of frames are relative to the folder of the file");
        return Err(PerspectiveError::NoImages { missing, of: missing, first, hint });
    }
    Ok(Drafts { layout: Layout::Transforms, views, points: Vec::new(), skipped })
}

/// The image of a frame, if it exists.
fn image_of(folder: &Path, path: &str) -> Option<PathBuf> {
    let image = vsi::join(folder, Path::new(path));
    let guesses = EXTENSIONS.map(|e| PathBuf::from(format!("{}.{e}", image.display())));
    let is_bare = image.extension().is_none();
    [image].into_iter().chain(guesses.into_iter().filter(|_| is_bare)).find(|p| vsi::size(p).is_ok())
}

impl Intrinsics {
    /// These values, and those of all frames where there are none.
    fn over(&self, all: &Self) -> Self {
        // A frame's own focal length replaces a common angle of view, and the other way round.
        let own_x = self.fl_x.is_some() || self.camera_angle_x.is_some();
        let own_y = own_x || self.fl_y.is_some() || self.camera_angle_y.is_some();
        let unless = |own: bool, value: Option<f64>| value.filter(|_| !own);
        Self {
            camera_model: self.camera_model.clone().or_else(|| all.camera_model.clone()),
            is_fisheye: self.is_fisheye.or(all.is_fisheye),
            w: self.w.or(all.w),
            h: self.h.or(all.h),
            fl_x: self.fl_x.or(unless(own_x, all.fl_x)),
            fl_y: self.fl_y.or(unless(own_y, all.fl_y)),
            camera_angle_x: self.camera_angle_x.or(unless(own_x, all.camera_angle_x)),
            camera_angle_y: self.camera_angle_y.or(unless(own_y, all.camera_angle_y)),
            cx: self.cx.or(all.cx),
            cy: self.cy.or(all.cy),
            k1: self.k1.or(all.k1),
            k2: self.k2.or(all.k2),
            k3: self.k3.or(all.k3),
            k4: self.k4.or(all.k4),
            p1: self.p1.or(all.p1),
            p2: self.p2.or(all.p2),
        }
    }
}

/// The camera of a frame, and the size of the image for which it is.
fn lens(
    path: &Path,
    frame: usize,
    image: &Path,
    given: &Intrinsics,
) -> Result<(LensCamera, (usize, usize)), PerspectiveError> {
    let field = |name: &str| format!("`{name}` of frame {frame}");
    let size = match (given.w, given.h) {
        (Some(w), Some(h)) if w >= 1.0 && h >= 1.0 && w < 1e6 && h < 1e6 => (w as usize, h as usize),
        (None, _) | (_, None) => ImageFile::open(image)?.size(),
        (Some(w), Some(h)) => {
            return Err(PerspectiveError::field(
                path,
                field("w, h"),
                format!("{w}, {h}"),
                "a size in pixels",
            ));
        }
    };
    let of_angle = |angle: Option<f64>, pixels: usize| angle.map(|a| 0.5 * pixels as f64 / (0.5 * a).tan());
    let fx = given.fl_x.or_else(|| of_angle(given.camera_angle_x, size.0));
    let fx = fx.ok_or_else(|| {
        PerspectiveError::field(path, field("fl_x"), "missing", "a focal length, or `camera_angle_x`")
    })?;
    let fy = given.fl_y.or_else(|| of_angle(given.camera_angle_y, size.1)).unwrap_or(fx);
    let (cx, cy) = (given.cx.unwrap_or(0.5 * size.0 as f64), given.cy.unwrap_or(0.5 * size.1 as f64));
    let k = [given.k1, given.k2, given.k3, given.k4].map(|k| k.unwrap_or(0.0));
    let [p1, p2] = [given.p1, given.p2].map(|p| p.unwrap_or(0.0));
    let name = given.camera_model.as_deref().unwrap_or("OPENCV");
    let is_fisheye = given.is_fisheye == Some(true) || name == "OPENCV_FISHEYE";
    let (model, distortion) = if is_fisheye {
        (LensModel::OpenCvFisheye, k.to_vec())
    } else if !["OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "FULL_OPENCV"]
        .contains(&name)
    {
        return Err(PerspectiveError::Model {
            path: path.into(),
            field: format!("frame {frame}"),
            found: name.into(),
        });
    } else if k[3] != 0.0 {
        let expected = "0: only fisheye lenses have four radial terms";
        return Err(PerspectiveError::field(path, field("k4"), k[3].to_string(), expected));
    } else if k[2] != 0.0 {
        (LensModel::FullOpenCv, vec![k[0], k[1], p1, p2, k[2], 0.0, 0.0, 0.0])
    } else if [k[0], k[1], p1, p2] == [0.0; 4] {
        (LensModel::Pinhole, Vec::new())
    } else {
        (LensModel::OpenCv, vec![k[0], k[1], p1, p2])
    };
    let parameters = [&[fx, fy, cx, cy], distortion.as_slice()].concat();
    let lens = LensCamera::from_colmap(model, &parameters, size).ok_or_else(|| {
        let expected = "finite, the focal lengths above zero";
        PerspectiveError::field(
            path,
            format!("the camera of frame {frame}"),
            format!("{parameters:?}"),
            expected,
        )
    })?;
    Ok((lens, size))
}
