//! The ground truth: any georeferenced raster, DFC2019's `X_DSM.tif` with `X_DSM.txt`, or lidar points (LAS, LAZ); with
//! its classes `X_CLS.tif` and a mask.
//!
//! `X_DSM.txt` holds four numbers: easting and northing of the lower-left corner in metres, size in cells (the raster
//! is square) and resolution in metres. Its UTM zone is that of the prediction.

use super::{HeightRaster, MetricsError, cloud};
use crate::io::{
    HeightSystem, ImageFile, MapGrid, RasterError, VerticalReference, inside_polygons, read_text, vsi,
};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Class of water in DFC2019 and LAS.
pub const WATER: u8 = 9;
/// Largest offset of a raster from the truth's grid with which it still counts as the same grid, cells.
const SAME_GRID: f64 = 0.02;

/// Name of a class of DFC2019 or LAS.
#[must_use]
pub fn class_name(class: u8) -> &'static str {
    match class {
        0 | 1 => "unclassified",
        2 => "ground",
        3 => "low vegetation",
        4 => "medium vegetation",
        5 => "trees",
        6 => "building",
        WATER => "water",
        17 => "bridge",
        65 => "unlabelled",
        _ => "other",
    }
}

/// The class codes that occur, in ascending order.
pub(super) fn class_codes(classes: &[u8]) -> Vec<u8> {
    let mut occurs = [false; 256];
    classes.iter().for_each(|code| occurs[usize::from(*code)] = true);
    (0..=u8::MAX).filter(|code| occurs[usize::from(*code)]).collect()
}

/// The ground truth of an evaluation.
#[derive(Clone, Debug)]
pub struct Truth {
    /// Heights with their map grid.
    pub surface: HeightRaster,
    /// Class of every cell; none without classes.
    pub classes: Option<Vec<u8>>,
    /// Whether each cell is inside the mask; none without a mask.
    pub mask: Option<Vec<bool>>,
    /// Conversions that were made while reading, one sentence each.
    pub notes: Vec<String>,
}

/// Options of reading a truth.
#[derive(Default)]
pub struct TruthOptions<'a> {
    /// Class raster on the truth's grid; by default `X_CLS.tif` beside `X_DSM.tif`.
    pub classes: Option<&'a Path>,
    /// Polygons, or a raster on the truth's grid, non-zero inside.
    pub mask: Option<&'a Path>,
    /// Vertical reference of the heights; by default the one that the file states.
    pub vertical: Option<VerticalReference>,
    /// EPSG code of lidar points whose file states none.
    pub epsg: Option<u32>,
}

impl Truth {
    /// Checks the truth without reading its heights, so that errors are known before a long run. The CRS of the
    /// prediction is not needed.
    ///
    /// # Errors
    /// [`MetricsError`] if the file is not a raster or point cloud, has no map grid or an unknown unit, or is
    /// cut short.
    pub fn check(path: &Path, options: &TruthOptions) -> Result<(), MetricsError> {
        for file in [options.classes, options.mask].into_iter().flatten() {
            vsi::size(file).map_err(|e| RasterError::Open { path: file.into(), cause: e.into() })?;
        }
        if cloud::is_cloud(path) {
            cloud::open(path, options.epsg)?;
        } else {
            let (file, _) = open_raster(path, None)?;
            HeightSystem::of_raster(&file)?;
            file.check_complete()?;
        }
        Ok(())
    }

    /// Reads the truth, its classes and the mask.
    ///
    /// `grid` is the prediction's: its CRS is that of DFC2019's text file, and points are put into its cells.
    ///
    /// # Errors
    /// [`MetricsError`] if a file cannot be read, has no map grid, or has another grid than the truth.
    pub fn read(path: &Path, options: &TruthOptions, grid: &MapGrid) -> Result<Self, MetricsError> {
        let mut notes = Vec::new();
        let (mut surface, mut classes) = if cloud::is_cloud(path) {
            let (surface, classes) = cloud::read(path, options.epsg, *grid)?;
            notes.extend(cloud::stray_note(&surface));
            (surface, classes)
        } else {
            let (file, grid) = open_raster(path, Some(grid.epsg))?;
            (HeightRaster::on_grid(&file, grid)?, None)
        };
        if cloud::is_cloud(path) {
            let n = surface.height.valid().count();
            notes.push(format!(
                "the truth is rasterised to the highest point of every cell of the prediction's grid; {n} cells have points"
            ));
        }
        if let Some(vertical) = &options.vertical {
            let stated = surface.vertical.replace(VerticalReference::ELLIPSOID.into());
            if let Some(stated) =
                stated.filter(|stated| *stated != VerticalReference::known_name(vertical.name()))
            {
                notes.push(format!(
                    "the truth states the vertical reference {stated}, which is replaced by the given one"
                ));
            }
            if let VerticalReference::Geoid { name, .. } = vertical {
                let (low, high) = surface.lift(vertical)?;
                notes.push(format!(
                    "the heights of the truth are converted from the geoid ({name}) to the ellipsoid, by {low:+.2} to {high:+.2} m"
                ));
            }
        }
        if let Some(path) = options.classes.map(Path::to_path_buf).or_else(|| classes_beside(path)) {
            let codes = read_on_grid(&path, &surface, "classes")?;
            // A declared nodata value is NaN, which the cast turns into class 0.
            classes = Some(codes.into_par_iter().map(|v| v as u8).collect());
        }
        if let Some(classes) = &classes {
            let codes = class_codes(classes);
            let unknown: Vec<String> =
                codes.iter().filter(|c| class_name(**c) == "other").map(u8::to_string).collect();
            if !unknown.is_empty() {
                notes.push(format!(
                    "class codes {} are unknown in DFC2019; only {WATER} counts as water",
                    unknown.join(", ")
                ));
            }
        }
        let mask = options.mask.map(|m| read_mask(m, &surface)).transpose()?;
        Ok(Self { surface, classes, mask, notes })
    }

    /// Removes the heights of water, which is not scored; returns the number of cells.
    pub(super) fn drop_water(&mut self) -> usize {
        let Some(classes) = &self.classes else { return 0 };
        let cells = self.surface.height.data.par_iter_mut().zip(classes);
        let water = cells.filter(|(v, class)| **class == WATER && !v.is_nan());
        water.map(|(v, _)| *v = f32::NAN).count()
    }
}

/// Opens a raster with its map grid; `epsg` is the prediction's CRS, which is that of DFC2019's text file.
fn open_raster(path: &Path, epsg: Option<u32>) -> Result<(ImageFile, MapGrid), MetricsError> {
    let file = ImageFile::open(path)?;
    let grid = if file.has_geotransform() {
        file.map_grid().map_err(|e| match e {
            RasterError::NotAMap { reason, .. } => MetricsError::TruthGrid {
                path: path.into(),
                reason,
                crs: epsg.map_or("EPSG:UTM_ZONE".into(), |epsg| format!("EPSG:{epsg}")),
            },
            other => other.into(),
        })?
    } else {
        grid_of_txt(&file, epsg.unwrap_or_default())?
    };
    Ok((file, grid))
}

/// `X_CLS.tif` beside `X_DSM.tif`, if it exists.
fn classes_beside(path: &Path) -> Option<PathBuf> {
    let scene = path.file_stem()?.to_str()?.strip_suffix("_DSM")?;
    let found = path.with_file_name(format!("{scene}_CLS.tif"));
    vsi::exists(&found).then_some(found)
}

/// Values of a raster that has the truth's grid, or the truth's size and no georeference.
fn read_on_grid(path: &Path, truth: &HeightRaster, what: &'static str) -> Result<Vec<f32>, MetricsError> {
    let file = ImageFile::open(path)?;
    let expected = (truth.grid.width, truth.grid.height);
    let is_elsewhere = file.has_geotransform() && !file.map_grid()?.is_same(&truth.grid, SAME_GRID);
    if file.size() != expected || is_elsewhere {
        return Err(MetricsError::OtherGrid {
            path: path.into(),
            what,
            truth: truth.path.clone(),
            found: file.size(),
            expected,
        });
    }
    Ok(file.read(1)?.data)
}

fn read_mask(path: &Path, truth: &HeightRaster) -> Result<Vec<bool>, MetricsError> {
    let inside = match inside_polygons(path, &truth.grid)? {
        Some(inside) => inside,
        None => read_on_grid(path, truth, "mask")?.into_iter().map(|v| v != 0.0 && !v.is_nan()).collect(),
    };
    if !inside.iter().any(|i| *i) {
        return Err(MetricsError::EmptyMask { mask: path.into(), truth: truth.path.clone() });
    }
    Ok(inside)
}

fn grid_of_txt(file: &ImageFile, epsg: u32) -> Result<MapGrid, MetricsError> {
    let txt = file.path().with_extension("txt");
    if !vsi::exists(&txt) {
        return Err(MetricsError::NoPlace { path: file.path().into(), txt });
    }
    let wrong = |reason: String| MetricsError::Txt { txt: txt.clone(), reason };
    let text = read_text(&txt).map_err(|e| wrong(e.cause.to_string()))?;
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
        return Err(format!("({west}, {south}) is not a UTM easting and northing"));
    }
    if !(cell > 0.0 && cell < 1000.0) {
        return Err(format!("a resolution of {cell} m is not plausible"));
    }
    if (size - width as f64).abs() > 1e-6 || width != height {
        return Err(format!("states {size} x {size} cells, the raster has {width} x {height}"));
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
    fn errors_of_text_files_name_the_cause() {
        let reason = |text: &str| parse_txt(text, (512, 512), 32617).unwrap_err();
        assert!(reason("1 2 3").contains("holds 3 numbers"));
        assert!(reason("436078 x 512 0.5").contains("`x`"));
        assert!(reason("3357495 436078 512 0.5").contains("easting"));
        assert!(reason("436078 3357495 510 0.5").contains("510 x 510"));
        assert!(reason("436078 3357495 512 -0.5").contains("resolution"));
        assert!(reason("436078 3357495 512 NaN").contains("resolution"));
    }
}
