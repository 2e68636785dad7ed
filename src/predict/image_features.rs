//! Image features that need no weights: brightness, texture and tint of the surroundings of a pixel, at two scales.
//!
//! Point2GS averages features of DINOv2 over the images (equation 4); these take their place where no such network is at hand.
//! Brightness is relative to the median of the image, so that exposure does not matter.

use crate::stats::quantile;

/// Number of features of a pixel.
pub const FEATURE_MAPS: usize = 6;
/// Number of features of a key point: mean and standard deviation over the images.
pub const FEATURES: usize = 2 * FEATURE_MAPS;
/// Half sides of the two windows, pixels.
const RADII: [usize; 2] = [2, 5];

/// The features of every pixel of an image.
pub struct FeatureMaps {
    width: usize,
    height: usize,
    data: Vec<[f32; FEATURE_MAPS]>,
}

/// Sums over all pixels above and to the left: weight, brightness, its square, and two tints.
type Sums = [f64; 5];

impl FeatureMaps {
    /// The features of an image of linear colours, none where masked.
    #[must_use]
    pub fn of(width: usize, height: usize, color: impl Fn(usize, usize) -> Option<[f32; 3]>) -> Self {
        let pixels: Vec<Option<[f32; 3]>> =
            (0..width * height).map(|i| color(i % width, i / width)).collect();
        let gray = |[r, g, b]: [f32; 3]| f64::from(r + g + b) / 3.0;
        let median = quantile(pixels.iter().step_by(7).flatten().map(|rgb| gray(*rgb)).collect(), 0.5);
        let scale = 1.0 / median.unwrap_or(1.0).max(1e-3);
        let own = |rgb: [f32; 3]| -> Sums {
            let brightness = (gray(rgb) * scale).max(0.0).sqrt();
            let sum = f64::from(rgb[0] + rgb[1] + rgb[2]).max(1e-3);
            let tint = |k: usize| f64::from(rgb[k] - rgb[0]) / sum;
            [1.0, brightness, brightness * brightness, tint(1), tint(2)]
        };
        let stride = width + 1;
        let mut sums: Vec<Sums> = vec![[0.0; 5]; stride * (height + 1)];
        for row in 0..height {
            let mut line = [0.0; 5];
            for col in 0..width {
                let value = pixels[row * width + col].map_or([0.0; 5], own);
                (0..5).for_each(|k| line[k] += value[k]);
                let above = sums[row * stride + col + 1];
                sums[(row + 1) * stride + col + 1] = std::array::from_fn(|k| above[k] + line[k]);
            }
        }
        let window = |col: usize, row: usize, radius: usize| -> Sums {
            let (left, right) = (col.saturating_sub(radius), (col + radius + 1).min(width));
            let (top, bottom) = (row.saturating_sub(radius), (row + radius + 1).min(height));
            let at = |c: usize, r: usize| sums[r * stride + c];
            let (a, b, c, d) = (at(right, bottom), at(left, bottom), at(right, top), at(left, top));
            let total: Sums = std::array::from_fn(|k| a[k] - b[k] - c[k] + d[k]);
            let weight = total[0].max(1.0);
            std::array::from_fn(|k| total[k] / weight)
        };
        let features = |i: usize| {
            let [near, far] = RADII.map(|radius| window(i % width, i / width, radius));
            let spread = |w: Sums| (w[2] - w[1] * w[1]).max(0.0).sqrt();
            [near[1], far[1], spread(near), spread(far), near[3], near[4]].map(|v| v as f32)
        };
        Self { width, height, data: (0..width * height).map(features).collect() }
    }

    /// The features of the pixel nearest to a position; none outside of the image.
    #[must_use]
    pub fn at(&self, col: f64, row: f64) -> Option<[f32; FEATURE_MAPS]> {
        let (col, row) = (col.round(), row.round());
        let is_inside = col >= 0.0 && row >= 0.0 && col < self.width as f64 && row < self.height as f64;
        is_inside.then(|| self.data[row as usize * self.width + col as usize])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exposure_changes_no_feature_and_texture_does() {
        let stripes = |gain: f32| {
            FeatureMaps::of(40, 30, |col, row| {
                let level = if col < 20 || row % 2 == 0 { 0.2 } else { 0.4 };
                (row > 0).then_some([gain * level, gain * level, 0.5 * gain * level])
            })
        };
        let (a, b) = (stripes(1.0), stripes(2.0));
        let [smooth, rough] = [5.0, 34.0].map(|col| a.at(col, 15.0).unwrap());
        assert!(a.data.iter().flatten().zip(b.data.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-4));
        assert!(smooth[2] < 1e-3 && rough[2] > 0.1 && smooth[5] < -0.1);
        assert!(a.at(-1.0, 3.0).is_none() && a.at(3.0, 30.0).is_none());
    }
}
