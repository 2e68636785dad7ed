//! The matched surface, and its file.

use crate::frame::{Point, Site, SiteGrid};
use crate::io::{Cog, Grid2, ImageFile, MapGrid, RasterError, VerticalReference, WriteError};
use std::path::Path;

/// Score from which the altitude of a cell counts as confident.
pub(super) const CONFIDENT: f32 = 0.4;

/// Score below which an altitude may be noise, anywhere in the range that is searched.
const LEAST_AGREEMENT: f32 = 0.1;

/// Altitudes on a map grid, found by matching.
#[derive(Clone, Debug)]
pub struct MatchedSurface {
    /// The site whose origin the altitudes are relative to.
    pub site: SiteGrid,
    /// The map grid of the three rasters below.
    pub grid: MapGrid,
    /// Altitudes in metres above the origin of the site; NaN where no pair of views sees the cell.
    pub altitude: Grid2,
    /// How well the views agree at that altitude, from 0 to 1. It is 0 where the altitude was not matched but
    /// filled in from its surroundings.
    ///
    /// The plane sweep gives the mean cube of the pairs' correlations, reduced where few images reach the cell.
    pub score: Grid2,
    /// Weight, from 0 to 1, of the loss term that keeps trained splats near this surface: 1 where a
    /// textureless surface is interpolated from confident cells around it.
    pub prior_weight: Grid2,
}

impl MatchedSurface {
    /// Centre of a cell on the surface, in site coordinates; its altitude is NaN where the surface has none.
    #[must_use]
    pub fn point(&self, col: usize, row: usize) -> Point<Site> {
        let p = self.site.site_from_utm(self.grid.cell_center(col, row));
        Point::new(p.x(), p.y(), f64::from(self.altitude.at(col, row)))
    }

    /// Lowest and highest altitude, site metres, of the cells on which views agree at all; none if there are none.
    #[must_use]
    pub fn altitudes(&self) -> Option<(f64, f64)> {
        let cells = self.altitude.data.iter().zip(&self.score.data);
        let agreed = cells.filter(|(z, score)| !z.is_nan() && **score >= LEAST_AGREEMENT);
        agreed.map(|(z, _)| (f64::from(*z), f64::from(*z))).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
    }

    /// The altitudes, NaN where the score is below [`CONFIDENT`].
    pub(super) fn confident(&self) -> Grid2 {
        let mut out = self.altitude.clone();
        for (z, score) in out.data.iter_mut().zip(&self.score.data) {
            if *score < CONFIDENT {
                *z = f32::NAN;
            }
        }
        out
    }

    /// Writes ellipsoidal heights in metres, scores and prior weights as the three bands of a Cloud-Optimized
    /// GeoTIFF.
    ///
    /// # Errors
    /// [`WriteError`] when the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), WriteError> {
        let mut height = self.altitude.clone();
        height.data.iter_mut().for_each(|z| *z += self.site.origin.z() as f32);
        let cog = Cog { grid: self.grid, metadata: &[], heights_from: Some(&VerticalReference::Ellipsoid) };
        cog.write_f32(
            path,
            &[("height", "m", &height), ("score", "", &self.score), ("prior_weight", "", &self.prior_weight)],
        )
    }

    /// Reads what [`MatchedSurface::write`] wrote. Altitudes become relative to the origin of `site`.
    ///
    /// # Errors
    /// [`RasterError`] when the file cannot be read, has no map grid, or has fewer than three bands.
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
