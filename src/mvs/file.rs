//! A swept surface on disk, so that no later stage sweeps again.

use super::MatchedSurface;
use crate::frame::SiteGrid;
use crate::io::{Cog, ImageFile, RasterError, VerticalReference, WriteError};
use std::path::Path;

impl MatchedSurface {
    /// Writes ellipsoidal heights in metres and scores as the bands of a Cloud-Optimized GeoTIFF.
    ///
    /// # Errors
    /// [`WriteError`].
    pub fn write(&self, path: &Path) -> Result<(), WriteError> {
        let mut height = self.altitude.clone();
        height.data.iter_mut().for_each(|z| *z += self.site.origin.z() as f32);
        let cog = Cog { grid: self.grid, metadata: &[], heights_from: Some(&VerticalReference::Ellipsoid) };
        cog.write_f32(
            path,
            &[("height", "m", &height), ("score", "", &self.score), ("prior_weight", "", &self.prior_weight)],
        )
    }

    /// Reads what [`MatchedSurface::write`] wrote, into the frame of `site`.
    ///
    /// # Errors
    /// [`RasterError`] when it cannot be read or has no map grid or no second band.
    pub fn read(path: &Path, site: &SiteGrid) -> Result<Self, RasterError> {
        let file = ImageFile::open(path)?;
        let mut altitude = file.read(1)?;
        altitude.data.iter_mut().for_each(|z| *z -= site.origin.z() as f32);
        Ok(Self {
            site: *site,
            grid: file.map_grid()?,
            altitude,
            score: file.read(2)?,
            prior_weight: file.read(3)?,
        })
    }
}
