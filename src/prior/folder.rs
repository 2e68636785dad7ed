//! Priors in the files of a folder, one for each image.

use super::error::PriorError;
use super::map::{DepthKind, DepthPrior, NormalPrior, PriorContent};
use crate::io::{Grid2, ImageFile, NpyArray, read_json, vsi};
use crate::perspective::PerspectiveView;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Ends of the names of files, in the order in which they are looked for.
pub(super) const ENDS: [&str; 4] = ["npy", "png", "tif", "tiff"];
/// Name of the file that says what the values of a folder are.
pub(super) const DESCRIPTION: &str = "prior.json";
/// Largest value of a 16-bit integer: together with 0 it marks pixels without a depth.
const NO_DEPTH: f32 = 65535.0;
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
/// Depths are arrays of rows x columns; in files of whole numbers 0 and 65535 are pixels without a depth. Normals are arrays of
/// rows x columns x 3 or 3 x rows x columns, rasters of three bands, or 8-bit or 16-bit pictures of `(n + 1) / 2`.
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

    /// The file of a view, if there is one.
    #[must_use]
    pub fn file(&self, view: &PerspectiveView) -> Option<PathBuf> {
        let paths = ENDS.iter().map(|end| self.path.join(format!("{}.{end}", view.name)));
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
        let Stored { planes, is_integer } = Stored::read(file)?;
        let [mut plane] = <[Grid2; 1]>::try_from(planes).map_err(|planes| {
            let (found, expected) =
                (format!("of {} values a pixel", planes.len()), "one depth a pixel".into());
            PriorError::Shape { path: file.into(), found, expected }
        })?;
        let scale = self.description.scale.unwrap_or(1.0) as f32;
        for value in &mut plane.data {
            let is_depth = value.is_finite() && *value > 0.0 && !(is_integer && *value >= NO_DEPTH);
            *value = if is_depth { *value * scale } else { f32::NAN };
        }
        let values = view.undistorted_values(&fitted(plane, view, file)?);
        let empty = |fault| PriorError::Empty { path: file.into(), fault };
        let first = values.valid().next().ok_or_else(|| empty("has no depth"))?;
        if values.valid().all(|value| value == first) {
            return Err(empty("has the same depth everywhere"));
        }
        Ok(DepthPrior { values, kind })
    }

    /// The normals of a view for its camera, with the components multiplied by these signs.
    ///
    /// # Errors
    /// [`PriorError`] if the file cannot be read, has another shape than the image, or has no normal.
    pub fn normal(
        &self,
        file: &Path,
        view: &PerspectiveView,
        signs: [f32; 3],
    ) -> Result<NormalPrior, PriorError> {
        let Stored { planes, is_integer } = Stored::read(file)?;
        let [mut x, mut y, mut z] = <[Grid2; 3]>::try_from(planes).map_err(|planes| {
            let (found, expected) = (format!("of {} values a pixel", planes.len()), "three a pixel".into());
            PriorError::Shape { path: file.into(), found, expected }
        })?;
        if is_integer {
            let most = [&x, &y, &z].into_iter().flat_map(Grid2::valid).fold(0.0, f32::max);
            let half = if most > 255.0 { 32767.5 } else { 127.5 };
            [&mut x, &mut y, &mut z]
                .into_iter()
                .flat_map(|plane| &mut plane.data)
                .for_each(|v| *v = *v / half - 1.0);
        }
        let fitted = [fitted(x, view, file)?, fitted(y, view, file)?, fitted(z, view, file)?];
        let mut planes = view.undistorted_planes(&fitted);
        let [x, y, z] = &mut planes;
        let mut known = 0;
        for ((x, y), z) in x.data.iter_mut().zip(&mut y.data).zip(&mut z.data) {
            let length = (*x * *x + *y * *y + *z * *z).sqrt();
            let is_normal = (LENGTHS.0..=LENGTHS.1).contains(&length);
            known += usize::from(is_normal);
            for (value, sign) in [x, y, z].into_iter().zip(signs) {
                *value = if is_normal { *value * sign / length } else { f32::NAN };
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
            PriorContent::Normals => self.normal(file, view, [1.0; 3]).map(drop),
        }
    }
}

/// What a file holds.
struct Stored {
    planes: Vec<Grid2>,
    is_integer: bool,
}

impl Stored {
    fn read(path: &Path) -> Result<Self, PriorError> {
        if path.extension().is_some_and(|end| end == "npy") {
            return of_array(NpyArray::read(path)?, path);
        }
        let file = ImageFile::open(path)?;
        let is_integer = file.band(1)?.is_integer;
        let colors = (1..=file.bands()).filter(|band| !file.is_alpha(*band));
        let planes = colors.map(|band| file.read(band)).collect::<Result<_, _>>()?;
        Ok(Self { planes, is_integer })
    }
}

fn of_array(array: NpyArray, path: &Path) -> Result<Stored, PriorError> {
    let NpyArray { shape, values, is_integer } = array;
    let plane = |width, height, data| Grid2 { width, height, data };
    let planes = match *shape.as_slice() {
        [height, width] | [height, width, 1] | [1, height, width] => vec![plane(width, height, values)],
        [height, width, 3] => {
            let of = |k| values.iter().skip(k).step_by(3).copied().collect();
            (0..3).map(|k| plane(width, height, of(k))).collect()
        }
        [3, height, width] => {
            values.chunks_exact((width * height).max(1)).map(|v| plane(width, height, v.to_vec())).collect()
        }
        _ => {
            let expected = "rows x columns, rows x columns x 3 or 3 x rows x columns".into();
            return Err(PriorError::Shape {
                path: path.into(),
                found: format!("an array of {shape:?}"),
                expected,
            });
        }
    };
    Ok(Stored { planes, is_integer })
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
