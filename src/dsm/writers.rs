//! The raster files of a DSM.

use super::{Confidence, Dsm, Heights, bare_ground, height_style, hillshade};
use crate::io::{Cog, Grid2, WriteError, write_file};
use std::path::Path;

impl Dsm {
    /// Writes heights in metres as a Cloud-Optimized GeoTIFF (float32, nodata NaN), and a QGIS style beside it.
    ///
    /// # Errors
    /// [`WriteError`] if a file cannot be written.
    pub fn write_dsm(&self, path: &Path, heights: &Heights) -> Result<(), WriteError> {
        let cog = Cog { heights_from: Some(heights.above), ..self.cog() };
        cog.write_f32(path, &[("height", "m", &heights.raster)])?;
        write_file(&path.with_extension("qml"), height_style(&heights.raster))
    }

    /// Writes the bare ground in metres as [`Dsm::write_dsm`] writes the surface, and the heights of the surface above it; beside
    /// each a QGIS style.
    ///
    /// # Errors
    /// [`WriteError`] if a file cannot be written.
    pub fn write_ground(
        &self,
        ground: &Path,
        above_ground: &Path,
        heights: &Heights,
    ) -> Result<(), WriteError> {
        let surface = &heights.raster;
        let bare = Heights { raster: bare_ground(surface, self.grid.cell), above: heights.above };
        self.write_dsm(ground, &bare)?;
        let above = Grid2::from_rows(surface.width, surface.height, |row, line| {
            let both = surface.row(row).iter().zip(bare.raster.row(row));
            line.iter_mut().zip(both).for_each(|(out, (top, bottom))| *out = top - bottom);
        });
        self.cog().write_f32(above_ground, &[("height above ground", "m", &above)])?;
        write_file(&above_ground.with_extension("qml"), height_style(&above))
    }

    /// Writes a hillshade lit from the north-west as an 8-bit Cloud-Optimized GeoTIFF; 255 is nodata.
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written.
    pub fn write_hillshade(&self, path: &Path) -> Result<(), WriteError> {
        self.cog().write_u8(path, vec![hillshade(&self.height, self.grid.cell)], Some(255.0))
    }

    /// Writes the colours as an 8-bit Cloud-Optimized GeoTIFF of three bands; 0 is nodata.
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written.
    pub fn write_ortho(&self, path: &Path) -> Result<(), WriteError> {
        let byte = |v: &f32| if v.is_nan() { 0 } else { (v.clamp(0.0, 1.0) * 254.0).round() as u8 + 1 };
        let bands = self.colors.iter().map(|p| p.data.iter().map(byte).collect()).collect();
        self.cog().write_u8(path, bands, Some(0.0))
    }

    /// Writes the confidence as a Cloud-Optimized GeoTIFF of four float32 bands: opacity (0 to 1), standard deviation of the
    /// altitudes in metres, number of views, expected error in metres ([`Dsm::expected_error`]).
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written.
    pub fn write_confidence(&self, path: &Path) -> Result<(), WriteError> {
        let Confidence { opacity, spread, views, .. } = &self.confidence;
        let expected_error = self.expected_error();
        let bands = [
            ("opacity", "", opacity),
            ("altitude spread", "m", spread),
            ("views", "", views),
            ("expected error", "m", &expected_error),
        ];
        self.cog().write_f32(path, &bands)
    }

    fn cog(&self) -> Cog<'_> {
        Cog { grid: self.grid, metadata: &self.metadata, heights_from: None }
    }
}
