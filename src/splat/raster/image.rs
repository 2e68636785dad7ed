//! Images of several channels, laid out so that a band of rows is one piece of memory.

use crate::simd::Real;

/// Channels of a render of the splats' colours and altitudes.
pub mod channel {
    /// Altitude, metres above the site's origin, after the three channels of colour.
    pub const ALTITUDE: usize = 3;
    /// Transmittance: the share of light that no splat stopped.
    pub const TRANSMITTANCE: usize = 4;
    /// Channels that derivatives are taken by: colour and altitude.
    pub const TRAINED: usize = 4;
}

/// Most runs of rows that an image is worked on in; fixed, so that sums over them do not depend on the threads.
pub(in crate::splat) const STRIPES: usize = 8;

/// Rows of such a run in an image of this height.
pub(in crate::splat) fn stripe_rows(height: usize) -> usize {
    height.div_ceil(STRIPES)
}

/// `channels` values a pixel, row by row, within a row channel by channel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Image<T> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Channels.
    pub channels: usize,
    /// The values.
    pub data: Vec<T>,
}

impl<T: Real> Image<T> {
    /// Zeros of this size.
    #[must_use]
    pub fn zeros(width: usize, height: usize, channels: usize) -> Self {
        Self { width, height, channels, data: vec![T::zero(); width * height * channels] }
    }

    /// Takes this size; the values are whatever was there.
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

    /// One value, to be changed.
    pub fn at_mut(&mut self, channel: usize, col: usize, row: usize) -> &mut T {
        &mut self.data[(row * self.channels + channel) * self.width + col]
    }

    /// One channel as a plane.
    #[must_use]
    pub fn plane(&self, channel: usize) -> crate::io::Grid2 {
        let data = (0..self.height).flat_map(|r| self.row(channel, r)).map(|v| v.as_f64() as f32).collect();
        crate::io::Grid2 { width: self.width, height: self.height, data }
    }
}
