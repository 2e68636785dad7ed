//! The terms that keep shadows out of the toned colours (SatGS, L_AS of equations 9 to 13).
//!
//! - `sun_visibility`: the mean of `(s - T)²` over the splats, with `s` a splat's share of sunlight in the colour model and `T`
//!   the visibility of the sun from it. The paper does not say along which ray `T` is; here it is that of the sun. `T` is a
//!   constant.
//! - `dark_tones`: the mean of `(1 - min(t, τ) / τ)²` over the splats' toned colours `t`: darkness is for shadows.
//! - `bright_shadows`: the sum of `(a / η - 1)²` over the channels of the ambient light `a` above η.

use super::term::{LossTerm, Rendered, TermInfo, TermScope};
use super::terms::TermInputs;
use crate::simd::{Real, SimdReal};
use crate::splat::appearance::SplatLight;
use rayon::prelude::*;

/// The weights of the three terms, and their columns.
pub const INFO: TermInfo = TermInfo {
    weights: &["sun_visibility", "dark_tones", "bright_shadows"],
    columns: &NAMES,
    scope: TermScope::Any,
};
const NAMES: [&str; 3] = ["sun_visibility", "dark_tones", "bright_shadows"];
/// The value τ below which toned colours are dark (paper, §3.3.3).
const DARK: f64 = 0.23;
/// The ambient light η that shadows may have (paper, §3.3.3).
const BRIGHT: f64 = 0.5;
/// Number of splats whose values are summed together; fixed, so that sums do not depend on the threads.
const PIECE: usize = 4096;

/// The term; keeps its buffers between calls.
pub struct LightSeparation<T> {
    by_light: SplatLight<T>,
    is_used: bool,
}

impl<T: Real> LightSeparation<T> {
    /// The term; it does not need the prior.
    #[must_use]
    pub fn new(_: &mut TermInputs<T>) -> Self {
        Self { by_light: SplatLight::default(), is_used: false }
    }
}

/// The penalty of a toned colour, and its derivative.
fn dark_tone<T: Real>(toned: T) -> (T, T) {
    let dark = T::from_f64(DARK);
    let missing = (T::one() - toned / dark).max(T::zero());
    (missing * missing, -(missing + missing) / dark)
}

/// The penalty of a channel of the ambient light, and its derivative.
fn bright_shadow<T: Real>(ambient: T) -> (T, T) {
    let bright = T::from_f64(BRIGHT);
    let excess = (ambient / bright - T::one()).max(T::zero());
    (excess * excess, (excess + excess) / bright)
}

impl<T: SimdReal> LossTerm<T> for LightSeparation<T> {
    fn evaluate(&mut self, rendered: &Rendered<T>, weights: &[f64], columns: &mut [f64]) -> f64 {
        self.is_used = rendered.light.is_some() && weights.iter().any(|w| *w > 0.0);
        let Some((light, visible)) = rendered.light.filter(|_| self.is_used) else {
            columns.fill(0.0);
            return 0.0;
        };
        let n = visible.len();
        let SplatLight { toned: by_toned, sunlit: by_sunlit, ambient: by_ambient } = &mut self.by_light;
        by_toned.resize(n, [T::zero(); 3]);
        by_sunlit.resize(n, T::zero());
        let [to_sunlit, to_toned, to_ambient] =
            [weights[0] / n.max(1) as f64, weights[1] / (3 * n.max(1)) as f64, weights[2]];
        let outputs = by_sunlit.par_chunks_mut(PIECE).zip(by_toned.par_chunks_mut(PIECE));
        let inputs = light.sunlit.par_chunks(PIECE).zip(visible.par_chunks(PIECE));
        let pieces = inputs.zip(light.toned.par_chunks(PIECE)).zip(outputs);
        let sums: Vec<[f64; 2]> = pieces
            .map(|(((sunlit, visible), toned), (by_sunlit, by_toned))| {
                let mut sums = [0.0; 2];
                for ((s, v), by) in sunlit.iter().zip(visible).zip(by_sunlit) {
                    let difference = *s - *v;
                    *by = T::from_f64(2.0 * to_sunlit) * difference;
                    sums[0] += difference.as_f64().powi(2);
                }
                for (toned, by) in toned.iter().zip(by_toned) {
                    for (t, by) in toned.iter().zip(by) {
                        let (value, slope) = dark_tone(*t);
                        *by = T::from_f64(to_toned) * slope;
                        sums[1] += value.as_f64();
                    }
                }
                sums
            })
            .collect();
        let [squares, tones] = sums.iter().fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
        let ambient = light.ambient.map(bright_shadow);
        *by_ambient = ambient.map(|(_, slope)| T::from_f64(to_ambient) * slope);
        columns[0] = squares / n.max(1) as f64;
        columns[1] = tones / (3 * n.max(1)) as f64;
        columns[2] = ambient.iter().map(|(value, _)| value.as_f64()).sum();
        columns.iter().zip(weights).map(|(value, weight)| value * weight).sum()
    }

    fn by_light(&self) -> Option<&SplatLight<T>> {
        self.is_used.then_some(&self.by_light)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn penalties_vanish_at_their_limits_and_have_the_stated_slopes() {
        assert_eq!(dark_tone(DARK), (0.0, -0.0));
        assert_eq!(dark_tone(0.0), (1.0, -2.0 / DARK));
        assert_eq!((bright_shadow(0.4), bright_shadow(1.0)), ((0.0, 0.0), (1.0, 4.0)));
    }
}
