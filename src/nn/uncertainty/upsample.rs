//! From values of patches to values of pixels.

use crate::io::Grid2;

/// A value for each pixel of a picture of `width` x `height` pixels, interpolated bilinearly between the centres of patches of
/// `patch_px` pixels; beyond the outermost centres their values continue.
///
/// For a picture of whole patches this is PyTorch's `interpolate(mode="bilinear", align_corners=False)`.
///
/// # Panics
/// Panics if `patches` or `patch_px` is empty but the picture is not.
#[must_use]
pub fn upsample(patches: &Grid2, patch_px: usize, width: usize, height: usize) -> Grid2 {
    let columns: Vec<Between> = (0..width).map(|col| Between::of(col, patch_px, patches.width)).collect();
    Grid2::from_rows(width, height, |row, line| {
        let rows = Between::of(row, patch_px, patches.height);
        let (above, below) = (patches.row(rows.first), patches.row(rows.second));
        for (value, columns) in line.iter_mut().zip(&columns) {
            *value = rows.mix(columns.pick(above), columns.pick(below));
        }
    })
}

/// The two patches between whose centres a pixel lies, and the share of the second.
struct Between {
    first: usize,
    second: usize,
    share: f32,
}

impl Between {
    fn of(pixel: usize, patch_px: usize, patches: usize) -> Self {
        let last = patches - 1;
        let at = ((pixel as f64 + 0.5) / patch_px as f64 - 0.5).clamp(0.0, last as f64);
        let first = at as usize;
        Self { first, second: (first + 1).min(last), share: (at - first as f64) as f32 }
    }

    fn pick(&self, line: &[f32]) -> f32 {
        self.mix(line[self.first], line[self.second])
    }

    fn mix(&self, first: f32, second: f32) -> f32 {
        first + (second - first) * self.share
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_of_patches_is_a_ramp_of_pixels_between_the_outermost_centres() {
        // The centre of patch k is at pixel 4 k + 1.5, and the last column and row of patches are cut.
        let patches = Grid2::from_fn(5, 4, |col, row| col as f32 + 10.0 * row as f32);
        let pixels = upsample(&patches, 4, 18, 15);
        for (col, row) in [(0usize, 0usize), (1, 2), (2, 5), (9, 13), (17, 14), (7, 3)] {
            let at = |pixel: usize, last: f32| ((pixel as f32 - 1.5) / 4.0).clamp(0.0, last);
            let expected = at(col, 4.0) + 10.0 * at(row, 3.0);
            assert!((pixels.at(col, row) - expected).abs() < 1e-5, "({col}, {row}): {}", pixels.at(col, row));
        }
    }
}
