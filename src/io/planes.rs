//! Maps of depths and normals: arrays in `.npy` files, or rasters.

use super::{Grid2, ImageFile, NpyArray, NumberKind, RasterError};
use std::path::Path;

/// The planes of a file: of an array of rows x columns one, of rows x columns x 3 or 3 x rows x columns three; of a raster
/// its bands without the alpha band.
#[derive(Clone, Debug, PartialEq)]
pub struct Planes {
    /// The values; NaN where the file declares that there are none.
    pub planes: Vec<Grid2>,
    /// The type of the stored numbers.
    pub kind: NumberKind,
}

impl Planes {
    /// Reads a file; the end of its name tells an array from a raster.
    ///
    /// # Errors
    /// [`RasterError`] if the file cannot be read, is damaged, or holds an array of another shape.
    pub fn read(path: &Path) -> Result<Self, RasterError> {
        if path.extension().is_some_and(|end| end.eq_ignore_ascii_case("npy")) {
            return of_array(NpyArray::read(path)?)
                .map_err(|reason| RasterError::Array { path: path.into(), reason });
        }
        let file = ImageFile::open(path)?;
        let kind = file.band(1)?.kind;
        let bands = (1..=file.bands()).filter(|band| !file.is_alpha(*band));
        let planes = bands.map(|band| file.read(band)).collect::<Result<_, _>>()?;
        Ok(Self { planes, kind })
    }

    /// The depths of a map of one plane, as stored: NaN where there is none ([`NumberKind::depth`]); none for other maps.
    #[must_use]
    pub fn into_depths(self) -> Option<Grid2> {
        let Self { planes, kind } = self;
        let [mut plane] = <[Grid2; 1]>::try_from(planes).ok()?;
        plane.data.iter_mut().for_each(|value| *value = kind.depth(*value));
        Some(plane)
    }
}

fn of_array(array: NpyArray) -> Result<Planes, String> {
    let NpyArray { shape, values, kind } = array;
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
            return Err(format!(
                "an array of {shape:?}, expected rows x columns, rows x columns x 3 or 3 x rows x columns"
            ));
        }
    };
    Ok(Planes { planes, kind })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_number_marks_no_depth_in_files_of_16_bits_only() {
        let values = vec![0.0, -1.0, 65534.0, 65535.0, 65536.0, f32::INFINITY];
        let depths = |kind| {
            let array = NpyArray { shape: vec![1, 6], values: values.clone(), kind };
            let depths = of_array(array).unwrap().into_depths().unwrap();
            depths.data.iter().map(|v| !v.is_nan()).collect::<Vec<_>>()
        };
        assert_eq!(depths(NumberKind::U16), [false, false, true, false, true, false]);
        for kind in [NumberKind::Integer, NumberKind::Float] {
            assert_eq!(depths(kind), [false, false, true, true, true, false], "{kind:?}");
        }
    }
}
