//! Lenses of the images of a `transforms.json`.

use super::super::error::PerspectiveError;
use super::super::lens::{LensCamera, LensModel};
use crate::io::ImageFile;
use serde::Deserialize;
use std::path::Path;

/// Intrinsic parameters, of all frames or of one.
#[derive(Clone, Debug, Default, Deserialize)]
pub(super) struct Intrinsics {
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

impl Intrinsics {
    /// These values, and those of all frames where there are none.
    pub fn over(&self, all: &Self) -> Self {
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
pub fn lens(
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
