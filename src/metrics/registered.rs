//! Heights after a registration.

use super::MetricsError;
use super::registration::Registration;
use super::resample::onto_grid;
use crate::io::{Grid2, MapGrid};
use rayon::prelude::*;

/// Resamples heights on the grid `from` to the grid `to` of the truth after a registration; as [`onto_grid`].
///
/// # Errors
/// As [`onto_grid`].
pub fn registered(
    heights: &Grid2,
    from: &MapGrid,
    to: &MapGrid,
    by: &Registration,
) -> Result<Grid2, MetricsError> {
    let moved =
        MapGrid { west: to.west + by.dx_cells * to.cell, north: to.north - by.dy_cells * to.cell, ..*to };
    let (mut raster, _) = onto_grid(heights, from, &moved)?;
    raster.data.par_iter_mut().for_each(|v| *v = (f64::from(*v) + by.dz_m) as f32);
    Ok(raster)
}
