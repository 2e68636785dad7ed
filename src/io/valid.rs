//! Valid pixels of an image, one bit per pixel.

use super::{Grid2, Window};
use crate::frame::{CenterPx, Pixel};

/// Number of bits of a word.
const BITS: usize = u64::BITS as usize;

/// The set of valid pixels of an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ValidPixels {
    width: usize,
    height: usize,
    /// Number of words per row.
    stride: usize,
    words: Vec<u64>,
}

impl ValidPixels {
    /// An image whose pixels are all valid, or all not valid.
    #[must_use]
    pub fn filled(width: usize, height: usize, valid: bool) -> Self {
        let stride = width.div_ceil(BITS);
        Self { width, height, stride, words: vec![if valid { u64::MAX } else { 0 }; stride * height] }
    }

    /// The pixels that are not NaN in any band; `None` if all pixels are valid. All bands have the same size.
    #[must_use]
    pub fn of_bands(bands: &[Grid2]) -> Option<Self> {
        let first = bands.first()?;
        let mut out: Option<Self> = None;
        for i in 0..first.data.len() {
            if bands.iter().any(|p| p.data[i].is_nan()) {
                let valid = out.get_or_insert_with(|| Self::filled(first.width, first.height, true));
                valid.set(i % first.width, i / first.width, false);
            }
        }
        out
    }

    /// Number of columns and rows.
    #[must_use]
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Whether a pixel is valid.
    ///
    /// # Panics
    /// Panics if the pixel is outside of the image.
    #[must_use]
    pub fn at(&self, col: usize, row: usize) -> bool {
        self.words[row * self.stride + col / BITS] >> (col % BITS) & 1 == 1
    }

    /// Sets whether a pixel is valid.
    ///
    /// # Panics
    /// Panics if the pixel is outside of the image.
    pub fn set(&mut self, col: usize, row: usize, valid: bool) {
        let (word, bit) = (&mut self.words[row * self.stride + col / BITS], 1 << (col % BITS));
        *word = if valid { *word | bit } else { *word & !bit };
    }

    /// Whether a bilinear sample at a position depends on valid pixels only; false outside of the image.
    #[must_use]
    pub fn surround(&self, p: Pixel<CenterPx>) -> bool {
        let inside = |v: f64, n: usize| v >= 0.0 && v <= n as f64 - 1.0;
        if !(inside(p.col, self.width) && inside(p.row, self.height)) {
            return false;
        }
        // At the centre of a pixel, its neighbours have weight zero.
        let (cols, rows) = ([p.col.floor(), p.col.ceil()], [p.row.floor(), p.row.ceil()]);
        rows.iter().all(|row| cols.iter().all(|col| self.at(*col as usize, *row as usize)))
    }

    /// Number of valid pixels.
    #[must_use]
    pub fn count(&self) -> usize {
        self.rows().map(|row| row.filter(|valid| *valid).count()).sum()
    }

    /// The smallest window that contains all valid pixels; `None` if there are none.
    #[must_use]
    pub fn bounds(&self) -> Option<Window> {
        let (mut cols, mut rows) = ((usize::MAX, 0), (usize::MAX, 0));
        for row in 0..self.height {
            let mut valid = (0..self.width).filter(|col| self.at(*col, row));
            let Some(first) = valid.next() else { continue };
            let last = (0..self.width).rev().find(|col| self.at(*col, row)).unwrap_or(first);
            cols = (cols.0.min(first), cols.1.max(last));
            rows = (rows.0.min(row), row);
        }
        let (width, height) = (cols.1.checked_sub(cols.0)? + 1, rows.1.checked_sub(rows.0)? + 1);
        Some(Window { col: cols.0, row: rows.0, width, height })
    }

    /// Sets the pixels of `raster` that are not valid to NaN. `raster` shows a window of the image, possibly downsampled; then
    /// the pixel at the centre of each of its pixels counts.
    pub fn clear(&self, raster: &mut Grid2, window: Window) {
        let middle = |i: usize, first: usize, from: usize, to: usize| first + (2 * i + 1) * from / (2 * to);
        let (width, height) = (raster.width, raster.height);
        for (row, line) in raster.data.chunks_mut(width.max(1)).enumerate() {
            let row = middle(row, window.row, window.height, height);
            for (col, v) in line.iter_mut().enumerate() {
                if !self.at(middle(col, window.col, window.width, width), row) {
                    *v = f32::NAN;
                }
            }
        }
    }

    /// The pixels of this set that are connected with the border of the image (4-connectivity).
    #[must_use]
    pub fn connected_with_border(&self) -> Self {
        let (width, height) = self.size();
        let mut out = Self::filled(width, height, false);
        let on_border =
            |col: usize, row: usize| col == 0 || row == 0 || col + 1 == width || row + 1 == height;
        // Passes down and up over the rows until no pixel is added. A queue of pixels could need more memory than the image.
        let mut is_down = true;
        loop {
            let mut added = false;
            for k in 0..height {
                let row = if is_down { k } else { height - 1 - k };
                let beside = if is_down { row.checked_sub(1) } else { Some(row + 1).filter(|r| *r < height) };
                let mut col = 0;
                while col < width {
                    let first = col;
                    while col < width && self.at(col, row) {
                        col += 1;
                    }
                    let hangs = |c: usize| {
                        out.at(c, row) || on_border(c, row) || beside.is_some_and(|b| out.at(c, b))
                    };
                    if (first..col).any(hangs) && !(first..col).all(|c| out.at(c, row)) {
                        (first..col).for_each(|c| out.set(c, row, true));
                        added = true;
                    }
                    col += 1;
                }
            }
            if !added && !is_down {
                return out;
            }
            is_down = !is_down;
        }
    }

    /// A hash of size and pixels, as text.
    #[must_use]
    pub fn digest(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        for number in [self.width, self.height] {
            hasher.update(&(number as u64).to_le_bytes());
        }
        for row in self.rows() {
            let bytes: Vec<u8> = row.map(u8::from).collect();
            hasher.update(&bytes);
        }
        hasher.finalize().to_hex().to_string()
    }

    fn rows(&self) -> impl Iterator<Item = impl Iterator<Item = bool>> {
        (0..self.height).map(move |row| (0..self.width).map(move |col| self.at(col, row)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The set drawn by lines of text, in which `#` is valid.
    fn drawn(lines: &[&str]) -> ValidPixels {
        let mut out = ValidPixels::filled(lines[0].len(), lines.len(), false);
        for (row, line) in lines.iter().enumerate() {
            line.bytes().enumerate().for_each(|(col, c)| out.set(col, row, c == b'#'));
        }
        out
    }

    #[test]
    fn pixels_connected_with_the_border_are_found_around_corners() {
        // The first figure winds up and down from the right border; the dot in the middle is not connected with it.
        let all = drawn(&[
            "..........",
            ".###.####.",
            ".#.#.#..#.",
            ".#.###..#.",
            ".#.....##.",
            ".##..#...#",
            "........##",
        ]);
        let hanging = drawn(&[
            "..........",
            "..........",
            "..........",
            "..........",
            "..........",
            ".........#",
            "........##",
        ]);
        assert_eq!(all.connected_with_border(), hanging);
        let spiral = drawn(&[".......", ".#####.", ".#...#.", ".#.#.#.", ".#.###.", ".#.....", ".######"]);
        assert_eq!(spiral.connected_with_border(), spiral);
        assert_eq!(spiral.bounds(), Some(Window { col: 1, row: 1, width: 6, height: 6 }));
        assert_eq!(spiral.count(), 5 + 2 + 3 + 4 + 1 + 6);
    }

    #[test]
    fn a_sample_is_valid_if_all_pixels_with_weight_are() {
        let mut valid = ValidPixels::filled(70, 3, true);
        valid.set(66, 1, false);
        let at = |col: f64, row: f64| valid.surround(Pixel::new(col, row));
        assert!(at(65.0, 1.0) && !at(65.01, 1.0) && at(65.5, 0.0) && !at(66.0, 0.5) && at(67.0, 1.0));
        assert!(at(69.0, 2.0) && !at(69.1, 2.0) && !at(-0.1, 0.0) && !at(f64::NAN, 0.0));
        assert_eq!(valid.count(), 209);
        assert!(ValidPixels::filled(70, 3, false).bounds().is_none());
        assert_ne!(valid.digest(), ValidPixels::filled(70, 3, true).digest());
    }

    #[test]
    fn pixels_are_valid_if_no_band_is_nan() {
        let known = Grid2::filled(3, 2, 0.5);
        assert!(ValidPixels::of_bands(std::slice::from_ref(&known)).is_none());
        let mut holed = known.clone();
        holed.data[4] = f32::NAN;
        let valid = ValidPixels::of_bands(&[known, holed]).unwrap();
        assert!(!valid.at(1, 1) && valid.count() == 5);
    }
}
