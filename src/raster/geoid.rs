//! Geoid undulations from a grid in longitude and latitude: PROJ's `.gtx` and GeoTIFF grids, EGM96 and others.

use super::{ImageFile, Plane, RasterError};
use std::path::Path;

/// The height of a geoid above the ellipsoid, on a grid.
pub struct Geoid {
    /// Longitude and latitude of the first cell's centre, degrees.
    origin: (f64, f64),
    /// From one column, one row to the next, degrees.
    step: (f64, f64),
    undulation: Plane,
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
            reason: "it is no geoid grid: a north-up raster in degrees is expected".into(),
        };
        let t = file.degrees_grid().ok_or_else(not)?;
        let origin = (t[0] + 0.5 * t[1], t[3] + 0.5 * t[5]);
        Ok(Self { origin, step: (t[1], t[5]), undulation: file.read(1)? })
    }

    /// Undulation at a place in degrees, metres, bilinear; NaN outside of the grid.
    ///
    /// `ellipsoidal height = orthometric height + undulation`.
    #[must_use]
    pub fn undulation_m(&self, lon_deg: f64, lat_deg: f64) -> f64 {
        let (width, height) = (self.undulation.width, self.undulation.height);
        // Grids may begin at -180 or at 0.
        let east = (lon_deg - self.origin.0).rem_euclid(360.0);
        let (x, y) = (east / self.step.0, (lat_deg - self.origin.1) / self.step.1);
        let around = (width as f64 * self.step.0 - 360.0).abs() < 0.5 * self.step.0;
        let last = if around { width as f64 } else { width as f64 - 1.0 };
        if !(x >= 0.0 && x <= last && y >= 0.0 && y <= height as f64 - 1.0) {
            return f64::NAN;
        }
        let (col, row) = (x.floor() as usize, (y.floor() as usize).min(height.saturating_sub(2)));
        let (fx, fy) = (x - col as f64, y - row as f64);
        let at = |c: usize, r: usize| {
            let c = if around { c % width } else { c.min(width - 1) };
            f64::from(self.undulation.data[r.min(height - 1) * width + c])
        };
        let along = |r: usize| at(col, r) * (1.0 - fx) + at(col + 1, r) * fx;
        along(row) * (1.0 - fy) + along(row + 1) * fy
    }
}
