//! A view of a perspective scene, and its pixels and depths.

use super::error::PerspectiveError;
use super::jpeg;
use super::lens::LensCamera;
use super::mask_file::MaskFile;
use super::orientation::Orientation;
use super::pinhole::PinholeCamera;
use super::transparency::Transparency;
use super::undistort::Undistortion;
use crate::io::{Grid2, ImageFile, Planes, ReadError, Window, vsi};
use crate::scene::Role;
use glam::{DVec2, DVec3};
use std::path::{Path, PathBuf};

/// Largest difference between the ratio of the sides of a mask or a depth map and that of its image, as a share.
const SHAPE_TOLERANCE: f64 = 0.01;
/// Opacity below which a pixel counts as transparent where only the whole pixel can be used or not.
const HALF: f32 = 0.5;

/// A depth map: distances along the optical axis.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthFile {
    /// A raster or an array (`.npy`) of the shape of the image; it may be smaller or larger.
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
    /// Path of the image in the scene's folder of images, with slashes.
    pub path_in_scene: PathBuf,
    /// The image file.
    pub image: PathBuf,
    /// Whether the view is trained on.
    pub role: Role,
    /// How the image file is stored, if the camera is of the image as displayed.
    pub turned: Option<Orientation>,
    /// The camera of the image file, with its lens.
    pub lens_camera: LensCamera,
    /// The camera of the image that [`PerspectiveView::read_image`] returns: undistorted, downsampled.
    pub camera: PinholeCamera,
    /// Pixels of the image file over a side of a pixel that is read: 1, 2, 4 or 8.
    pub downsampling: u32,
    /// Masks of the image.
    pub masks: Vec<MaskFile>,
    /// What transparent pixels mean; none if the image file has none.
    pub transparency: Option<Transparency>,
    /// The depth map of the image, if there is one.
    pub depth: Option<DepthFile>,
    /// Indices of the scene's points that the image is known to show, as tracks of COLMAP models say; empty if nothing says so.
    pub observed: Vec<u32>,
}

/// An undistorted, downsampled image.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewImage {
    /// Red, green and blue from 0 to 1 as displayed, without linearisation, on black where pixels are empty; NaN where the image
    /// has no data.
    pub planes: [Grid2; 3],
    /// How much of a pixel is not empty, 0 to 1; NaN where the image has no data. None if no pixel is empty.
    pub opacity: Option<Grid2>,
}

impl ViewImage {
    /// Whether nothing, or only a smaller part of something, is at a pixel, by its index.
    #[must_use]
    pub fn is_empty_at(&self, index: usize) -> bool {
        self.opacity.as_ref().and_then(|o| o.data.get(index)).is_some_and(|o| *o < HALF)
    }

    /// Whether there is a surface at a pixel, by its index: it has data and is not empty.
    #[must_use]
    pub fn shows_surface(&self, index: usize) -> bool {
        let has_data = self.planes.iter().all(|plane| plane.data.get(index).is_some_and(|v| !v.is_nan()));
        has_data && !self.is_empty_at(index)
    }
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
    /// [`PerspectiveError`] if the image or its masks cannot be read, have another shape than the camera, or leave no pixel.
    pub fn read_image(&self) -> Result<ViewImage, PerspectiveError> {
        let (mut planes, opacity) = self.file_on_black()?;
        for mask in &self.masks {
            self.hide_masked(&mut planes, mask)?;
        }
        let image = match opacity {
            None => ViewImage { planes: self.undistorted_planes(&planes), opacity: None },
            Some(mut opacity) => {
                let hidden = opacity.data.iter_mut().zip(&planes[0].data).filter(|(_, v)| v.is_nan());
                hidden.for_each(|(opacity, _)| *opacity = f32::NAN);
                let [red, green, blue] = planes;
                let undistortion = Undistortion::new(&self.lens_camera, self.downsampling);
                let [red, green, blue, opacity] = undistortion.colors(&[red, green, blue, opacity]);
                ViewImage { planes: [red, green, blue], opacity: Some(opacity) }
            }
        };
        let has_data = |i: usize| image.planes.iter().all(|plane| !plane.data[i].is_nan());
        if (0..image.planes[0].data.len()).any(has_data) {
            return Ok(image);
        }
        Err(PerspectiveError::NoPixels { image: self.image.clone(), reason: self.what_hides() })
    }

    /// What hides pixels of the image.
    fn what_hides(&self) -> String {
        let masks = self.masks.iter().map(|mask| format!("mask `{}`", mask.path.display()));
        let transparent = self.transparency.map(|_| "the transparency of the image".to_owned());
        let all: Vec<String> = masks.chain(transparent).collect();
        match all.is_empty() {
            true => "all are outside of the image, or without data".into(),
            false => format!("nothing is left by {}", all.join(" and ")),
        }
    }

    /// Reads red, green and blue of the whole image file as displayed, from 0 to 1, with the distortion of its lens, on black
    /// where pixels are empty, without masks; NaN where the file has no data.
    ///
    /// # Errors
    /// [`PerspectiveError`] if the image cannot be read, or is not of the size of the camera.
    pub fn read_file(&self) -> Result<[Grid2; 3], PerspectiveError> {
        Ok(self.file_on_black()?.0)
    }

    /// The colours of the file on black, and how much of a pixel is not empty if some are; NaN where nothing is known.
    fn file_on_black(&self) -> Result<([Grid2; 3], Option<Grid2>), PerspectiveError> {
        let file = self.open(&self.image)?;
        let displayed = |grid: Grid2| match self.turned {
            Some(turned) => turned.displayed(&grid),
            None => grid,
        };
        let mut planes = self.colors(&file)?.map(displayed);
        let Some(meaning) = self.transparency else { return Ok((planes, None)) };
        let Some(opacity) = file.opacity(&file.default_bands())?.map(displayed) else {
            return Ok((planes, None));
        };
        for plane in &mut planes {
            for (value, opacity) in plane.data.iter_mut().zip(&opacity.data) {
                match meaning {
                    Transparency::Empty => *value *= *opacity,
                    Transparency::Unknown if *opacity < HALF => *value = f32::NAN,
                    Transparency::Unknown => {}
                }
            }
        }
        Ok((planes, (meaning == Transparency::Empty).then_some(opacity)))
    }

    /// Sets pixels of the image file to NaN that a mask does not let be used.
    fn hide_masked(&self, planes: &mut [Grid2; 3], mask: &MaskFile) -> Result<(), PerspectiveError> {
        let file = ImageFile::open(&mask.path)?;
        let (width, height) = file.size();
        self.require_shape((width, height), &mask.path)?;
        let marked = file.marked(Window { col: 0, row: 0, width, height })?;
        let of_image = self.nearest_in((width, height));
        for plane in planes {
            for (i, value) in plane.data.iter_mut().enumerate() {
                if marked[of_image(i)] != mask.marks_used {
                    *value = f32::NAN;
                }
            }
        }
        Ok(())
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
            let scale = match (info.is_byte, info.kind.is_integer()) {
                (true, _) => 1.0 / 255.0,
                (false, true) => 1.0 / 65535.0,
                (false, false) => 1.0,
            };
            let mut plane = file.read_stored_band(band)?;
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
        let plane = Planes::read(&depth.path)?.into_depths().ok_or_else(|| {
            let (found, expected) = ("of several", "one depth a pixel");
            PerspectiveError::field(&depth.path, "the values of a pixel", found, expected)
        })?;
        let size = (plane.width, plane.height);
        self.require_shape(size, &depth.path)?;
        let (width, height) = self.lens_camera.size;
        let of_image = self.nearest_in(size);
        let metres = |i: usize| (f64::from(plane.data[of_image(i)]) * depth.metres_per_unit) as f32;
        Ok(Grid2 { width, height, data: (0..width * height).map(metres).collect() })
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

    /// Opens a raster that must have the size of the camera.
    fn open(&self, path: &Path) -> Result<ImageFile, PerspectiveError> {
        let file = ImageFile::open(path)?;
        let (width, height) = self.lens_camera.size;
        let stored = if self.turned.is_some() { (height, width) } else { (width, height) };
        if file.size() == stored {
            return Ok(file);
        }
        Err(self.other_size(file.size(), path, "an image keeps its size while it is used"))
    }

    /// Refuses a map whose sides have another ratio than those of the image.
    fn require_shape(&self, (width, height): (usize, usize), path: &Path) -> Result<(), PerspectiveError> {
        let of = self.lens_camera.size;
        let ratio = (width as f64 / of.0 as f64) / (height as f64 / of.1 as f64);
        if (ratio - 1.0).abs() <= SHAPE_TOLERANCE {
            return Ok(());
        }
        let hint = "a mask or a depth map may be smaller or larger than its image, but shows all of it";
        Err(self.other_size((width, height), path, hint))
    }

    fn other_size(
        &self,
        (width, height): (usize, usize),
        path: &Path,
        hint: &'static str,
    ) -> PerspectiveError {
        let (expected_width, expected_height) = self.lens_camera.size;
        PerspectiveError::Size {
            path: path.into(),
            width,
            height,
            of: "its image",
            expected_width,
            expected_height,
            hint,
        }
    }

    /// For each pixel of the image, by its index, the index of the pixel of a map of this size that lies nearest. The borders of map
    /// and image are the same.
    fn nearest_in(&self, (width, height): (usize, usize)) -> impl Fn(usize) -> usize {
        let (of_width, of_height) = self.lens_camera.size;
        let is_same = (width, height) == (of_width, of_height);
        let nearest = |i: usize, of: usize, n: usize| ((2 * i + 1) * n / (2 * of)).min(n.saturating_sub(1));
        move |i| match is_same {
            true => i,
            false => {
                nearest(i / of_width, of_height, height) * width + nearest(i % of_width, of_width, width)
            }
        }
    }
}
