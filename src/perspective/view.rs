//! A view of a perspective scene, and its pixels and depths.

use super::error::PerspectiveError;
use super::jpeg;
use super::lens::LensCamera;
use super::pinhole::PinholeCamera;
use super::undistort::Undistortion;
use crate::io::{Grid2, ImageFile, ReadError, Window, vsi};
use crate::scene::Role;
use glam::{DVec2, DVec3};
use std::path::{Path, PathBuf};

/// Largest value of a 16-bit integer: in depth maps it marks pixels without a depth, as 0 does (7-Scenes).
const NO_DEPTH: f32 = 65535.0;

/// A depth map: distances along the optical axis.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthFile {
    /// The raster, of the size of the image.
    pub path: PathBuf,
    /// Metres, or units of the scene, of a stored 1.
    pub metres_per_unit: f64,
    /// The camera of the depth map, if that is not the one of the image.
    pub camera: Option<SensorCamera>,
}

impl DepthFile {
    /// A depth map of the image's camera.
    #[must_use]
    pub fn new(path: PathBuf, metres_per_unit: f64) -> Self {
        Self { path, metres_per_unit, camera: None }
    }
}

/// The camera of a depth map beside that of its image, with the same axes and without distortion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorCamera {
    /// Focal lengths, pixels.
    pub focal: DVec2,
    /// Principal point, pixels.
    pub principal: DVec2,
    /// Its centre in the axes (right, down, forward) of the image's camera, metres.
    pub center: DVec3,
}

impl SensorCamera {
    /// The depths of a map at the nearest pixels of the image's camera: of several the least, NaN where there is none.
    pub(super) fn seen_by(&self, lens: &LensCamera, depth: &Grid2) -> Grid2 {
        let mut out = Grid2::filled(depth.width, depth.height, f32::NAN);
        for (i, z) in depth.data.iter().enumerate().filter(|(_, z)| !z.is_nan()) {
            let pixel = DVec2::new((i % depth.width) as f64, (i / depth.width) as f64);
            let from_here = f64::from(*z) * ((pixel - self.principal) / self.focal).extend(1.0);
            let point = from_here + self.center;
            let at = lens.focal * point.truncate() / point.z + lens.principal;
            let (col, row) = (at.x.round(), at.y.round());
            if col >= 0.0 && row >= 0.0 && col < out.width as f64 && row < out.height as f64 {
                let nearest = &mut out.data[row as usize * depth.width + col as usize];
                *nearest = nearest.min(point.z as f32);
            }
        }
        out
    }
}

/// One image of a perspective scene with its camera.
#[derive(Clone, Debug, PartialEq)]
pub struct PerspectiveView {
    /// Name of the image without its extension.
    pub name: String,
    /// The image file.
    pub image: PathBuf,
    /// Whether the view is trained on.
    pub role: Role,
    /// The camera of the image file, with its lens.
    pub lens_camera: LensCamera,
    /// The camera of the image that [`PerspectiveView::read_image`] returns: undistorted, downsampled.
    pub camera: PinholeCamera,
    /// Pixels of the image file over a side of a pixel that is read: 1, 2, 4 or 8.
    pub downsampling: u32,
    /// Raster of the size of the image, 0 at pixels that are not to be used.
    pub mask: Option<PathBuf>,
    /// The depth map of the image, if there is one.
    pub depth: Option<DepthFile>,
    /// Indices of the scene's points that the image is known to show, as tracks of COLMAP models say; empty if nothing says so.
    pub observed: Vec<u32>,
}

/// An undistorted, downsampled image.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewImage {
    /// Red, green and blue from 0 to 1 as displayed, without linearisation; NaN where the image has no data.
    pub planes: [Grid2; 3],
}

impl PerspectiveView {
    /// The pinhole camera of a lens without its distortion, downsampled.
    #[must_use]
    pub fn undistorted_camera(
        lens: &LensCamera,
        cam_from_site: glam::DMat3,
        center: glam::DVec3,
        downsampling: u32,
    ) -> PinholeCamera {
        let factor = f64::from(downsampling.max(1));
        PinholeCamera {
            cam_from_site,
            center,
            focal: lens.focal / factor,
            principal: (lens.principal + 0.5) / factor - 0.5,
            size: Undistortion::new(lens, downsampling).size(),
        }
    }

    /// Reads the image, undistorted and downsampled to the size of [`PerspectiveView::camera`].
    ///
    /// # Errors
    /// [`PerspectiveError`] if the image or its mask cannot be read, or is not of the size of the camera.
    pub fn read_image(&self) -> Result<ViewImage, PerspectiveError> {
        let file = self.open(&self.image)?;
        let mut planes = self.colors(&file)?;
        if let Some(alpha) = (1..=file.bands()).find(|b| file.is_alpha(*b)) {
            hide(&mut planes, &stored(&file, alpha)?);
        }
        if let Some(mask) = &self.mask {
            hide(&mut planes, &stored(&self.open(mask)?, 1)?);
        }
        Ok(ViewImage { planes: self.undistorted_planes(&planes) })
    }

    /// Reads red, green and blue of the whole image file as displayed, from 0 to 1, with the distortion of its lens, without mask
    /// and transparency; NaN where the file has no data.
    ///
    /// # Errors
    /// [`PerspectiveError`] if the image cannot be read, or is not of the size of the camera.
    pub fn read_file(&self) -> Result<[Grid2; 3], PerspectiveError> {
        self.colors(&self.open(&self.image)?)
    }

    fn colors(&self, file: &ImageFile) -> Result<[Grid2; 3], PerspectiveError> {
        if !jpeg::is_complete(&vsi::read(&self.image).map_err(|e| ReadError::new(&self.image, e))?) {
            let cause = "the file ends before its picture does";
            return Err(ReadError::new(&self.image, cause).into());
        }
        let colors = file.default_bands();
        if colors.iter().any(|b| file.is_palette(*b)) {
            let found = "an index into a colour table";
            return Err(PerspectiveError::field(
                &self.image,
                "the image's band",
                found,
                "colours or grey values",
            ));
        }
        let read = |band: usize| -> Result<Grid2, PerspectiveError> {
            let info = file.band(band)?;
            let scale = match (info.is_byte, info.is_integer) {
                (true, _) => 1.0 / 255.0,
                (false, true) => 1.0 / 65535.0,
                (false, false) => 1.0,
            };
            let mut plane = file.read(band)?;
            plane.data.iter_mut().for_each(|v| *v *= scale);
            Ok(plane)
        };
        Ok(match *colors.as_slice() {
            [red, green, blue, ..] => [read(red)?, read(green)?, read(blue)?],
            [gray, ..] => {
                let gray = read(gray)?;
                [gray.clone(), gray.clone(), gray]
            }
            [] => {
                let found = "missing";
                return Err(PerspectiveError::field(
                    &self.image,
                    "the image's band",
                    found,
                    "colours or grey values",
                ));
            }
        })
    }

    /// Reads the depth map for [`PerspectiveView::camera`]: metres (units of the scene, if it has no metres) along the
    /// optical axis, NaN where there is no depth. Values are not mixed: undistortion takes the nearest one, downsampling
    /// the median.
    ///
    /// # Errors
    /// [`PerspectiveError::NoDepth`] if the view has none, otherwise as [`PerspectiveView::read_image`].
    pub fn read_depth(&self) -> Result<Grid2, PerspectiveError> {
        let depth = self.depth_of_file()?;
        let registered =
            self.depth.as_ref().and_then(|d| d.camera).map(|c| c.seen_by(&self.lens_camera, &depth));
        Ok(self.undistorted_values(&registered.unwrap_or(depth)))
    }

    /// The whole depth map as its own camera sees it: metres, NaN where there is no depth.
    pub(super) fn depth_of_file(&self) -> Result<Grid2, PerspectiveError> {
        let depth =
            self.depth.as_ref().ok_or_else(|| PerspectiveError::NoDepth { view: self.name.clone() })?;
        let file = self.open(&depth.path)?;
        let is_integer = file.band(1)?.is_integer;
        let mut plane = stored(&file, 1)?;
        for value in &mut plane.data {
            let is_depth = value.is_finite() && *value > 0.0 && !(is_integer && *value >= NO_DEPTH);
            *value = if is_depth { (f64::from(*value) * depth.metres_per_unit) as f32 } else { f32::NAN };
        }
        Ok(plane)
    }

    /// The values of a plane of the size of the image file that must not be mixed, such as depths, at the pixels of
    /// [`PerspectiveView::camera`]: undistortion takes the nearest one, downsampling the median.
    #[must_use]
    pub fn undistorted_values(&self, plane: &Grid2) -> Grid2 {
        Undistortion::new(&self.lens_camera, self.downsampling).nearest(plane)
    }

    /// The planes of an image of the size of the image file at the pixels of [`PerspectiveView::camera`], sampled bilinearly
    /// and averaged.
    #[must_use]
    pub fn undistorted_planes(&self, planes: &[Grid2; 3]) -> [Grid2; 3] {
        Undistortion::new(&self.lens_camera, self.downsampling).colors(planes)
    }

    /// Opens a raster that must have the size of the image.
    fn open(&self, path: &Path) -> Result<ImageFile, PerspectiveError> {
        let file = ImageFile::open(path)?;
        let ((width, height), expected) = (file.size(), self.lens_camera.size);
        if (width, height) == expected {
            return Ok(file);
        }
        let (expected_width, expected_height) = expected;
        Err(PerspectiveError::Size {
            path: path.into(),
            width,
            height,
            of: "its image",
            expected_width,
            expected_height,
            hint: "an image, its mask and its depth map have the same size",
        })
    }
}

/// Stored values of a whole band, counted from 1.
fn stored(file: &ImageFile, band: usize) -> Result<Grid2, PerspectiveError> {
    let (width, height) = file.size();
    Ok(file.read_stored(band, Window { col: 0, row: 0, width, height }, (width, height))?)
}

/// Sets pixels to NaN where a mask is 0.
fn hide(planes: &mut [Grid2; 3], mask: &Grid2) {
    for plane in planes {
        for (value, mask) in plane.data.iter_mut().zip(&mask.data) {
            if *mask == 0.0 {
                *value = f32::NAN;
            }
        }
    }
}
