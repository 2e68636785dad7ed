//! How a view sees a colour: its own linear radiometry, and its own dimming in shadow (EOGS).
//!
//! `pixel = (s + (1 - s) κ) ⊙ (W rgb + t)` with `s` the share of sunlight; `W`, `t`, `κ` belong to the view.

use crate::simd::Arithmetic;
use crate::simd::Real;

/// One view's radiometry.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Appearance<T = f32> {
    /// `W`, row by row, then `t`, then `κ`.
    pub values: [T; 15],
}

impl<T: Real> Default for Appearance<T> {
    /// The colour as it is; a twentieth of it in full shadow (EOGS's start).
    fn default() -> Self {
        let (o, z, k) = (T::one(), T::zero(), T::from_f64(0.05));
        Self { values: [o, z, z, z, o, z, z, z, o, z, z, z, k, k, k] }
    }
}

/// For a pixel, or for several with a row of lanes as the number.
impl<T: Arithmetic> Appearance<T> {
    /// `W rgb + t`.
    #[inline(always)]
    pub fn sunlit(&self, rgb: [T; 3]) -> [T; 3] {
        let v = &self.values;
        let mut out = rgb;
        for i in 0..3 {
            out[i] = v[3 * i] * rgb[0] + v[3 * i + 1] * rgb[1] + v[3 * i + 2] * rgb[2] + v[9 + i];
        }
        out
    }

    /// The share of the sunlit colour that is left at sunlight `s`.
    #[inline(always)]
    pub fn dimming(&self, s: T) -> [T; 3] {
        let mut out = [s; 3];
        for i in 0..3 {
            out[i] = s + self.values[12 + i] - s * self.values[12 + i];
        }
        out
    }

    /// Derivatives by `rgb` and `s` from those by the pixel; adds those by the radiometry to `by_values`.
    #[inline(always)]
    pub fn backward(&self, rgb: [T; 3], s: T, by_pixel: [T; 3], by_values: &mut [T; 15]) -> ([T; 3], T) {
        let (sunlit, dimming) = (self.sunlit(rgb), self.dimming(s));
        let v = &self.values;
        let (mut by_sunlit, mut by_lit_share) = (by_pixel, by_pixel);
        for i in 0..3 {
            by_sunlit[i] = by_pixel[i] * dimming[i];
            let by_dimming = by_pixel[i] * sunlit[i];
            by_lit_share[i] = by_dimming - by_dimming * v[12 + i];
            by_values[12 + i] = by_values[12 + i] + by_dimming - by_dimming * s;
            by_values[9 + i] = by_values[9 + i] + by_sunlit[i];
            for k in 0..3 {
                by_values[3 * i + k] = by_values[3 * i + k] + by_sunlit[i] * rgb[k];
            }
        }
        let mut by_rgb = rgb;
        for k in 0..3 {
            by_rgb[k] = by_sunlit[0] * v[k] + by_sunlit[1] * v[3 + k] + by_sunlit[2] * v[6 + k];
        }
        (by_rgb, by_lit_share[0] + by_lit_share[1] + by_lit_share[2])
    }
}
