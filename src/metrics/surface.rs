//! A height raster in memory, with its place on the map.

use super::MetricsError;
use crate::raster::{ImageFile, MapGrid, Plane};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Heights at or below this are the nodata value that many lidar products do not declare.
const UNDECLARED_NODATA_M: f32 = -9999.0;

/// A surface model: heights in metres on a map grid; NaN is no data.
#[derive(Clone, Debug)]
pub struct Surface {
    /// The file it came from, for messages.
    pub path: PathBuf,
    /// Its place on the map.
    pub grid: MapGrid,
    /// Heights in metres.
    pub height: Plane,
    /// What the file says about its vertical reference, e.g. `ellipsoid`.
    pub vertical: Option<String>,
    /// Cells that held a nodata value the file does not declare.
    pub undeclared_nodata: usize,
    /// The unit that heights were converted from, if they were not in metres.
    pub converted_from: Option<String>,
}

impl Surface {
    /// Reads the first band of a georeferenced raster.
    ///
    /// # Errors
    /// [`MetricsError::Raster`] when it cannot be read or has no north-up grid in metres, [`MetricsError::Unit`].
    pub fn read(path: &Path) -> Result<Self, MetricsError> {
        let file = ImageFile::open(path)?;
        let grid = file.map_grid()?;
        Self::on_grid(&file, grid)
    }

    /// Reads the first band of `file`, whose place is known from elsewhere.
    pub(super) fn on_grid(file: &ImageFile, grid: MapGrid) -> Result<Self, MetricsError> {
        let mut height = file.read(1)?;
        let undeclared_nodata = drop_undeclared_nodata(&mut height);
        let (unit, metres) = unit_of(file)?;
        let converted_from = (metres != 1.0).then_some(unit);
        if converted_from.is_some() {
            height.data.iter_mut().for_each(|v| *v *= metres);
        }
        let told = file.metadata("VERTICAL_REFERENCE", "");
        let vertical = told.map(|v| if v.ends_with("ellipsoid") { "ellipsoid".into() } else { v });
        Ok(Self { path: file.path().into(), grid, height, vertical, undeclared_nodata, converted_from })
    }
}

/// The unit of a file's heights, and the metres in it.
pub(super) fn unit_of(file: &ImageFile) -> Result<(String, f32), MetricsError> {
    let unit = file.unit(1)?;
    match metres_of(&unit) {
        Some(metres) => Ok((unit, metres)),
        None => Err(MetricsError::Unit { path: file.path().into(), unit }),
    }
}

/// Metres in a unit that GDAL names; an unnamed one is taken for metres.
fn metres_of(unit: &str) -> Option<f32> {
    match unit.to_ascii_lowercase().as_str() {
        "" | "m" | "metre" | "meter" | "metres" | "meters" => Some(1.0),
        "ft" | "foot" | "feet" | "international foot" => Some(0.3048),
        "us survey foot" | "us_survey_foot" | "us survey feet" | "us-ft" | "ftus" => Some(1200.0 / 3937.0),
        _ => None,
    }
}

/// Infinite heights and -9999 or less become NaN; returns how many.
fn drop_undeclared_nodata(height: &mut Plane) -> usize {
    let nodata = height.data.par_iter_mut().filter(|v| v.is_infinite() || **v <= UNDECLARED_NODATA_M);
    nodata.map(|v| *v = f32::NAN).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn minus_9999_is_no_height() {
        let mut p = Plane { width: 4, height: 1, data: vec![-9999.0, 3.0, f32::INFINITY, -32767.0] };
        assert_eq!(drop_undeclared_nodata(&mut p), 3);
        assert_eq!(p.valid().collect::<Vec<_>>(), [3.0]);
    }
}
