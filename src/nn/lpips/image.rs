//! The images that LPIPS compares.

use super::error::LpipsError;
use crate::io::Grid2;

/// A colour image in memory: red, green and blue planes, row by row from the top, with values in [0, 1] as they are
/// displayed (sRGB).
#[derive(Clone, Copy, Debug)]
pub struct PlanarRgb<'a, T> {
    width: usize,
    height: usize,
    planes: [&'a [T]; 3],
}

impl<'a, T> PlanarRgb<'a, T> {
    /// An image of `width` columns and `height` rows.
    ///
    /// # Errors
    /// [`LpipsError::Plane`] if a plane does not have `width * height` values.
    pub fn new(width: usize, height: usize, planes: [&'a [T]; 3]) -> Result<Self, LpipsError> {
        match planes.iter().position(|plane| plane.len() != width * height) {
            Some(channel) => Err(LpipsError::Plane { channel, width, height, found: planes[channel].len() }),
            None => Ok(Self { width, height, planes }),
        }
    }

    /// Number of columns.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of rows.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Red, green and blue: `width * height` values each, row by row.
    #[must_use]
    pub fn planes(&self) -> [&'a [T]; 3] {
        self.planes
    }
}

impl<'a> PlanarRgb<'a, f32> {
    /// An image of three grids of equal size.
    ///
    /// # Errors
    /// [`LpipsError::Plane`] if the grids differ in size.
    pub fn of_grids(grids: &'a [Grid2; 3]) -> Result<Self, LpipsError> {
        let Grid2 { width, height, .. } = grids[0];
        Self::new(width, height, [&grids[0].data, &grids[1].data, &grids[2].data])
    }
}
