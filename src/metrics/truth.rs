//! The truth: any georeferenced raster, or DFC2019's `X_DSM.tif` with `X_DSM.txt`, and its classes `X_CLS.tif`.
//!
//! `X_DSM.txt` holds four numbers: easting and northing of the lower-left corner in metres, size in cells (the
//! raster is square), resolution in metres; the UTM zone is the prediction's.

use super::{MetricsError, Surface};
use crate::raster::{ImageFile, MapGrid, Plane};
use std::path::{Path, PathBuf};

/// DFC2019's class of water (2 ground, 5 trees, 6 building, 65 unlabelled).
pub const WATER: u8 = 9;

/// Name of a DFC2019 class.
#[must_use]
pub fn class_name(class: u8) -> &'static str {
    match class {
        2 => "ground",
        5 => "trees",
        6 => "building",
        WATER => "water",
        17 => "bridge",
        65 => "unlabelled",
        _ => "other",
    }
}

/// What a surface model is compared with.
#[derive(Clone, Debug)]
pub struct Truth {
    /// Heights and their place.
    pub surface: Surface,
    /// Class of every cell, if there is a class raster.
    pub classes: Option<Vec<u8>>,
    /// The class raster.
    pub classes_path: Option<PathBuf>,
}

impl Truth {
    /// Reads the truth and its classes: those of `classes`, or of `X_CLS.tif` beside `X_DSM.tif`.
    ///
    /// `epsg` is the prediction's CRS, in which DFC2019's text file counts.
    ///
    /// # Errors
    /// [`MetricsError`] when a file cannot be read, has no place on the map, or the class raster has another size.
    pub fn read(path: &Path, classes: Option<&Path>, epsg: u32) -> Result<Self, MetricsError> {
        let file = ImageFile::open(path)?;
        let grid = if file.has_geotransform() {
            file.map_grid().map_err(|e| MetricsError::TruthGrid {
                path: path.into(),
                reason: e.to_string().rsplit("`: ").next().unwrap_or_default().to_owned(),
                epsg,
            })?
        } else {
            grid_of_txt(&file, epsg)?
        };
        let surface = Surface::on_grid(&file, grid)?;
        let classes_path = classes.map(Path::to_path_buf).or_else(|| classes_beside(path));
        let classes = classes_path.as_deref().map(|c| read_classes(c, &surface)).transpose()?;
        Ok(Self { surface, classes, classes_path })
    }

    /// Heights where the truth is valid and not water, NaN elsewhere: the cells that are scored.
    #[must_use]
    pub fn land(&self) -> Plane {
        let mut land = self.surface.height.clone();
        if let Some(classes) = &self.classes {
            for (v, c) in land.data.iter_mut().zip(classes) {
                if *c == WATER {
                    *v = f32::NAN;
                }
            }
        }
        land
    }
}

/// `X_CLS.tif` beside `X_DSM.tif`, if it exists.
fn classes_beside(path: &Path) -> Option<PathBuf> {
    let scene = path.file_stem()?.to_str()?.strip_suffix("_DSM")?;
    let found = path.with_file_name(format!("{scene}_CLS.tif"));
    found.exists().then_some(found)
}

fn read_classes(path: &Path, truth: &Surface) -> Result<Vec<u8>, MetricsError> {
    let file = ImageFile::open(path)?;
    let expected = (truth.height.width, truth.height.height);
    if file.size() != expected {
        return Err(MetricsError::ClassSize {
            classes: path.into(),
            truth: truth.path.clone(),
            found: file.size(),
            expected,
        });
    }
    // A declared nodata value comes back as NaN, which the cast turns into class 0.
    Ok(file.read(1)?.data.into_iter().map(|v| v as u8).collect())
}

fn grid_of_txt(file: &ImageFile, epsg: u32) -> Result<MapGrid, MetricsError> {
    let txt = file.path().with_extension("txt");
    if !txt.exists() {
        return Err(MetricsError::NoPlace { path: file.path().into(), txt });
    }
    let wrong = |reason: String| MetricsError::Txt { txt: txt.clone(), reason };
    let text = std::fs::read_to_string(&txt).map_err(|e| wrong(e.to_string()))?;
    parse_txt(&text, file.size(), epsg).map_err(wrong)
}

fn parse_txt(text: &str, (width, height): (usize, usize), epsg: u32) -> Result<MapGrid, String> {
    let numbers: Vec<f64> = text
        .split(|c: char| c.is_whitespace() || c == ',')
        .filter(|word| !word.is_empty())
        .map(|word| word.parse::<f64>().map_err(|_| format!("`{word}` is not a number")))
        .collect::<Result<_, _>>()?;
    let &[west, south, size, cell] = numbers.as_slice() else {
        return Err(format!("holds {} numbers", numbers.len()));
    };
    if !(100_000.0..=900_000.0).contains(&west) || !(0.0..=10_000_000.0).contains(&south) {
        return Err(format!("({west}, {south}) is no UTM easting and northing"));
    }
    if !(cell > 0.0 && cell < 1000.0) {
        return Err(format!("a resolution of {cell} m is not believed"));
    }
    if (size - width as f64).abs() > 1e-6 || width != height {
        return Err(format!("says {size} x {size} cells, the raster is {width} x {height}"));
    }
    Ok(MapGrid { epsg, west, north: south + size * cell, cell, width, height })
}

#[cfg(test)]
mod tests {
    use super::*;

    const JAX_068: &str = "436078.995946\n3357495.999923\n512.000000\n0.500000\n";

    #[test]
    fn the_text_file_gives_the_lower_left_corner() {
        let g = parse_txt(JAX_068, (512, 512), 32617).unwrap();
        assert_eq!((g.west, g.north, g.cell), (436_078.995_946, 3_357_751.999_923, 0.5));
    }

    #[test]
    fn wrong_text_files_are_told_apart() {
        let reason = |text: &str| parse_txt(text, (512, 512), 32617).unwrap_err();
        assert!(reason("1 2 3").contains("holds 3 numbers"));
        assert!(reason("436078 x 512 0.5").contains("`x`"));
        assert!(reason("3357495 436078 512 0.5").contains("easting"));
        assert!(reason("436078 3357495 510 0.5").contains("510 x 510"));
        assert!(reason("436078 3357495 512 -0.5").contains("resolution"));
        assert!(reason("436078 3357495 512 NaN").contains("resolution"));
    }
}
