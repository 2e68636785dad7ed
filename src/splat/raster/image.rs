//! Images of several channels, stored so that a band of rows is contiguous in memory.

use crate::simd::Real;

/// Channels of a render of the splats' colours and altitudes.
pub mod channel {
    /// Depth as the camera orders splats by: altitude above the site's origin or distance along the axis of a perspective
    /// camera, metres. The three channels before it are colour.
    pub const DEPTH: usize = 3;
    /// Altitude, metres above the site's origin: the depth of parallel projections.
    pub const ALTITUDE: usize = DEPTH;
    /// First of the three components of the normal of discs, in site axes.
    pub const NORMAL: usize = 4;
    /// Transmittance, 0 to 1: the fraction of light that passes all splats.
    pub const TRANSMITTANCE: usize = 4;
    /// Number of channels with derivatives: colour and altitude.
    pub const TRAINED: usize = 4;
}

/// Planes of a render of discs with all planes: colours, depth, normals ([`channel`]), then these.
pub mod disc_plane {
    /// Number of features: colours, depth, normals.
    pub const FEATURES: usize = 7;
    /// First moment of the mapped depths about the reference of the tile.
    pub const FIRST_MOMENT: usize = FEATURES;
    /// Second moment of the mapped depths about the reference of the tile.
    pub const SECOND_MOMENT: usize = FEATURES + 1;
    /// Transmittance, 0 to 1.
    pub const TRANSMITTANCE: usize = FEATURES + 2;
    /// Depth of the disc at which the transmittance falls to one half; zero where it does not.
    pub const MEDIAN_DEPTH: usize = FEATURES + 3;
}

/// Largest number of stripes (runs of successive rows) that an image is processed in; fixed, so that sums do not depend on
/// the number of threads.
pub(in crate::splat) const STRIPES: usize = 8;

/// Number of rows of a stripe in an image of this height.
pub(in crate::splat) fn stripe_rows(height: usize) -> usize {
    height.div_ceil(STRIPES)
}

/// An image with the value of channel `c` at (col, row) in `data[(row * channels + c) * width + col]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Image<T> {
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Number of channels.
    pub channels: usize,
    /// The values.
    pub data: Vec<T>,
}

impl<T: Real> Image<T> {
    /// An image of this size whose values are zero.
    #[must_use]
    pub fn zeros(width: usize, height: usize, channels: usize) -> Self {
        Self { width, height, channels, data: vec![T::zero(); width * height * channels] }
    }

    /// Changes the size; the values are unspecified.
    pub fn resize(&mut self, width: usize, height: usize, channels: usize) {
        (self.width, self.height, self.channels) = (width, height, channels);
        self.data.resize(width * height * channels, T::zero());
    }

    /// One channel of one row.
    #[must_use]
    pub fn row(&self, channel: usize, row: usize) -> &[T] {
        let start = (row * self.channels + channel) * self.width;
        &self.data[start..start + self.width]
    }

    /// One value.
    #[must_use]
    pub fn at(&self, channel: usize, col: usize, row: usize) -> T {
        self.data[(row * self.channels + channel) * self.width + col]
    }

    /// One value, mutable.
    pub fn at_mut(&mut self, channel: usize, col: usize, row: usize) -> &mut T {
        &mut self.data[(row * self.channels + channel) * self.width + col]
    }

    /// One channel as a grid.
    #[must_use]
    pub fn plane(&self, channel: usize) -> crate::io::Grid2 {
        let data = (0..self.height).flat_map(|r| self.row(channel, r)).map(|v| v.as_f64() as f32).collect();
        crate::io::Grid2 { width: self.width, height: self.height, data }
    }
}
