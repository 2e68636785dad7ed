//! Geoid undulations from a grid in longitude and latitude: PROJ's `.gtx` and GeoTIFF grids, EGM96 and others.

use super::{Grid2, ImageFile, RasterError};
use std::path::Path;

/// The height of a geoid above the ellipsoid, on a grid.
pub struct Geoid {
    /// Longitude and latitude of the first cell's centre, degrees.
    origin: (f64, f64),
    /// From one column, one row to the next, degrees.
    step: (f64, f64),
    undulation: Grid2,
}

impl Geoid {
    /// Reads a grid; values are metres.
    ///
    /// # Errors
    /// [`RasterError::NotAMap`] for a raster that is not in degrees.
    pub fn read(path: &Path) -> Result<Self, RasterError> {
        let file = ImageFile::open(path)?;
        let not = || RasterError::NotAMap {
            path: path.into(),
            reason: "it is no geoid grid: a north-up raster in degrees is expected",
        };
        let t = file.degrees_grid().ok_or_else(not)?;
        let origin = (t[0] + 0.5 * t[1], t[3] + 0.5 * t[5]);
        let mut undulation = file.read(1)?;
        let width = undulation.width;
        if (width as f64 * t[1] - 360.0).abs() < 0.5 * t[1] {
            // All around the Earth: the first column follows the last.
            undulation =
                Grid2::from_fn(width + 1, undulation.height, |col, row| undulation.at(col % width, row));
        }
        Ok(Self { origin, step: (t[1], t[5]), undulation })
    }

    /// Undulation at a place in degrees, metres, bilinear; NaN outside of the grid.
    ///
    /// `ellipsoidal height = orthometric height + undulation`.
    #[must_use]
    pub fn undulation_m(&self, lon_deg: f64, lat_deg: f64) -> f64 {
        // Grids may begin at -180 or at 0.
        let east = (lon_deg - self.origin.0).rem_euclid(360.0);
        let (col, row) = (east / self.step.0, (lat_deg - self.origin.1) / self.step.1);
        f64::from(self.undulation.bilinear(col, row))
    }
}
