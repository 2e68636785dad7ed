//! Priors in the files of a folder, one for each image.

use super::error::PriorError;
use super::map::{DepthKind, DepthPrior, NormalPrior, PriorContent};
use super::normal_axes::NormalAxes;
use crate::io::{Grid2, Planes, RasterError, read_json, vsi};
use crate::perspective::PerspectiveView;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Ends of the names of files, in the order in which they are looked for.
pub(super) const ENDS: [&str; 4] = ["npy", "png", "tif", "tiff"];
/// Name of the file that says what the values of a folder are.
pub(super) const DESCRIPTION: &str = "prior.json";
/// Largest difference between the ratio of the sides of a map and that of its image, as a share.
const SHAPE_TOLERANCE: f64 = 0.01;
/// Shortest and longest normal that counts as one.
const LENGTHS: (f32, f32) = (0.5, 1.5);

/// What `prior.json` says of the values of a folder.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PriorDescription {
    /// What the values of depths are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kind: Option<DepthKind>,
    /// Unit of the scene that a stored 1 is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
}

/// A folder of maps: `.npy`, or `.png` and `.tif` rasters, each called as its image.
///
/// Depths are arrays of rows x columns; 0 and, in files of 16 bits, 65535 are pixels without a depth. Normals are arrays of
/// rows x columns x 3 or 3 x rows x columns, rasters of three bands, or 8-bit or 16-bit pictures of `(n + 1) / 2`, which numbers
/// that are not whole may be too.
#[derive(Debug)]
pub struct PriorFolder {
    path: PathBuf,
    description: PriorDescription,
}

impl PriorFolder {
    /// Opens a folder, and reads its `prior.json` if there is one.
    ///
    /// # Errors
    /// [`PriorError::NoFolder`], [`PriorError::Read`].
    pub fn open(path: &Path) -> Result<Self, PriorError> {
        if !vsi::is_dir(path) {
            return Err(PriorError::NoFolder { path: path.into() });
        }
        let description = path.join(DESCRIPTION);
        let description =
            if vsi::exists(&description) { read_json(&description)? } else { Default::default() };
        Ok(Self { path: path.into(), description })
    }

    /// The folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What its `prior.json` says of the values.
    #[must_use]
    pub fn description(&self) -> &PriorDescription {
        &self.description
    }

    /// The file of a view, if there is one: called as the view, or as its image with the folders that this lies in, with or without
    /// the extension of the image.
    #[must_use]
    pub fn file(&self, view: &PerspectiveView) -> Option<PathBuf> {
        let image = &view.path_in_scene;
        let (stem, image) = (image.with_extension(""), image.to_string_lossy());
        let names = [view.name.as_str(), &stem.to_string_lossy(), &image].map(str::to_owned);
        let paths = names.iter().flat_map(|name| ENDS.map(|end| self.path.join(format!("{name}.{end}"))));
        paths.into_iter().find(|path| vsi::exists(path))
    }

    /// The depths of a view for its camera, undistorted and downsampled as its image.
    ///
    /// # Errors
    /// [`PriorError`] if the file cannot be read, has another shape than the image, or has no two different values.
    pub fn depth(
        &self,
        file: &Path,
        view: &PerspectiveView,
        kind: DepthKind,
    ) -> Result<DepthPrior, PriorError> {
        let map = read_planes(file)?;
        let count = map.planes.len();
        let mut plane = map.into_depths().ok_or_else(|| {
            let (found, expected) = (format!("of {count} values a pixel"), "one depth a pixel".into());
            PriorError::Shape { path: file.into(), found, expected }
        })?;
        let scale = self.description.scale.unwrap_or(1.0) as f32;
        plane.data.iter_mut().for_each(|value| *value *= scale);
        let values = view.undistorted_values(&fitted(plane, view, file)?);
        let empty = |fault| PriorError::Empty { path: file.into(), fault };
        let first = values.valid().next().ok_or_else(|| empty("has no depth"))?;
        if values.valid().all(|value| value == first) {
            return Err(empty("has the same depth everywhere"));
        }
        Ok(DepthPrior { values, kind })
    }

    /// The normals of a view for its camera, from the axes of the file.
    ///
    /// # Errors
    /// [`PriorError`] if the file cannot be read, has another shape than the image, or has no normal.
    pub fn normal(
        &self,
        file: &Path,
        view: &PerspectiveView,
        axes: &NormalAxes,
    ) -> Result<NormalPrior, PriorError> {
        let Planes { planes, kind } = read_planes(file)?;
        let [mut x, mut y, mut z] = <[Grid2; 3]>::try_from(planes).map_err(|planes| {
            let (found, expected) = (format!("of {} values a pixel", planes.len()), "three a pixel".into());
            PriorError::Shape { path: file.into(), found, expected }
        })?;
        if kind.is_integer() {
            let most = [&x, &y, &z].into_iter().flat_map(Grid2::valid).fold(0.0, f32::max);
            let half = if most > 255.0 { 32767.5 } else { 127.5 };
            [&mut x, &mut y, &mut z]
                .into_iter()
                .flat_map(|plane| &mut plane.data)
                .for_each(|v| *v = *v / half - 1.0);
        } else if is_half_of_range([&x, &y, &z]) {
            [&mut x, &mut y, &mut z]
                .into_iter()
                .flat_map(|plane| &mut plane.data)
                .for_each(|v| *v = 2.0 * *v - 1.0);
        }
        let fitted = [fitted(x, view, file)?, fitted(y, view, file)?, fitted(z, view, file)?];
        let mut planes = view.undistorted_planes(&fitted);
        let [x, y, z] = &mut planes;
        let mut known = 0;
        for ((x, y), z) in x.data.iter_mut().zip(&mut y.data).zip(&mut z.data) {
            let length = (*x * *x + *y * *y + *z * *z).sqrt();
            let is_normal = (LENGTHS.0..=LENGTHS.1).contains(&length);
            known += usize::from(is_normal);
            let unit = [*x, *y, *z].map(|v| f64::from(if is_normal { v / length } else { f32::NAN }));
            let own = axes.in_camera(unit, &view.camera.cam_from_site);
            for (value, own) in [x, y, z].into_iter().zip(own.to_array()) {
                *value = own as f32;
            }
        }
        if known == 0 {
            return Err(PriorError::Empty {
                path: file.into(),
                fault: "has no normals: no vector is about one long",
            });
        }
        Ok(NormalPrior { planes })
    }
}

impl PriorFolder {
    /// Checks that a file can be used as the map of a view.
    ///
    /// # Errors
    /// As [`PriorFolder::depth`] and [`PriorFolder::normal`].
    pub(super) fn check(
        &self,
        file: &Path,
        view: &PerspectiveView,
        content: PriorContent,
    ) -> Result<(), PriorError> {
        match content {
            PriorContent::Depths => self.depth(file, view, DepthKind::Relative).map(drop),
            PriorContent::Normals => self.normal(file, view, &NormalAxes::USUAL).map(drop),
        }
    }
}

fn read_planes(path: &Path) -> Result<Planes, PriorError> {
    Planes::read(path).map_err(|error| match error {
        RasterError::Array { path, reason } => {
            let expected = "depths or normals of the shape of the image".into();
            PriorError::Shape { path, found: reason, expected }
        }
        RasterError::Numbers(error) => error.into(),
        error => error.into(),
    })
}

/// Whether components from 0 to 1 stand for those from -1 to 1: none is below zero, and vectors are nearer to a length of one when
/// they are taken so.
fn is_half_of_range(planes: [&Grid2; 3]) -> bool {
    if planes.iter().flat_map(|plane| plane.valid()).any(|v| !(0.0..=1.0).contains(&v)) {
        return false;
    }
    let [x, y, z] = planes;
    let (mut as_given, mut as_half) = (0.0, 0.0);
    for ((x, y), z) in x.data.iter().zip(&y.data).zip(&z.data) {
        let off = |v: [f32; 3]| (v.iter().map(|v| v * v).sum::<f32>().sqrt() - 1.0).abs().min(1.0);
        let (given, half) = (off([*x, *y, *z]), off([*x, *y, *z].map(|v| 2.0 * v - 1.0)));
        if given.is_finite() {
            as_given += f64::from(given);
            as_half += f64::from(half);
        }
    }
    as_half < as_given
}

/// A plane at the size of the image file.
fn fitted(plane: Grid2, view: &PerspectiveView, path: &Path) -> Result<Grid2, PriorError> {
    let (width, height) = view.lens_camera.size;
    let factors = [plane.width as f64 / width as f64, plane.height as f64 / height as f64];
    if !(factors[0] > 0.0 && (factors[1] / factors[0] - 1.0).abs() <= SHAPE_TOLERANCE) {
        let found = format!("of {} x {} pixels", plane.width, plane.height);
        return Err(PriorError::Shape {
            path: path.into(),
            found,
            expected: format!("the shape of {width} x {height}"),
        });
    }
    if (plane.width, plane.height) == (width, height) {
        return Ok(plane);
    }
    // The borders of map and image are the same; beyond the centres of the outermost pixels there are none to mix.
    let most = [plane.width, plane.height].map(|n| (n - 1) as f64);
    let at = |i: usize, k: usize| ((i as f64 + 0.5) * factors[k] - 0.5).clamp(0.0, most[k]);
    Ok(Grid2::from_rows(width, height, |row, line| {
        for (col, out) in line.iter_mut().enumerate() {
            *out = plane.bilinear(at(col, 0), at(row, 1));
        }
    }))
}
