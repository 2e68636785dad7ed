//! Images of several channels, laid out so that a band of rows is one piece of memory.

use crate::simd::Real;

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

    /// Values of a row of pixels, channel after channel.
    pub fn rows(&self) -> std::slice::ChunksExact<'_, T> {
        self.data.chunks_exact(self.width * self.channels)
    }

    /// One channel of one row.
    #[must_use]
    pub fn row(&self, channel: usize, row: usize) -> &[T] {
        let start = (row * self.channels + channel) * self.width;
        &self.data[start..start + self.width]
    }

    /// One channel of one row, to be written.
    pub fn row_mut(&mut self, channel: usize, row: usize) -> &mut [T] {
        let start = (row * self.channels + channel) * self.width;
        &mut self.data[start..start + self.width]
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
    pub fn plane(&self, channel: usize) -> crate::io::Plane {
        let data = (0..self.height).flat_map(|r| self.row(channel, r)).map(|v| v.as_f64() as f32).collect();
        crate::io::Plane { width: self.width, height: self.height, data }
    }
}
