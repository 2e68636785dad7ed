//! Random numbers that are addressed by keys instead of drawn in sequence, so that the number of threads has no influence.

use crate::random::{box_muller, mix, unit_interval};

/// A random number with an address: a seed followed by any number of keys.
#[derive(Clone, Copy, Debug)]
pub(super) struct KeyedRng(u64);

impl KeyedRng {
    /// The root of all addresses of a seed.
    pub(super) const fn new(seed: u64) -> Self {
        Self(mix(seed))
    }

    /// The address with one more key.
    pub(super) const fn key(self, key: i64) -> Self {
        Self(mix(self.0 ^ (key as u64).wrapping_mul(0xd6e8_feb8_6659_fd93)))
    }

    /// The number at this address, uniform in [0, 1).
    pub(super) fn uniform(self) -> f64 {
        unit_interval(mix(self.0))
    }

    /// Uniform in [lo, hi).
    pub(super) fn uniform_in(self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * self.uniform()
    }

    /// Normal with mean 0 and standard deviation 1.
    pub(super) fn normal(self) -> f64 {
        box_muller(self.key(1).uniform(), self.key(2).uniform())
    }

    /// Value noise of unit wavelength, in [0, 1).
    pub(super) fn value_noise(self, x: f64, y: f64) -> f64 {
        let (i, j) = (x.floor(), y.floor());
        let smooth = |t: f64| t * t * (3.0 - 2.0 * t);
        let (u, v) = (smooth(x - i), smooth(y - j));
        let (i, j) = (i as i64, j as i64);
        let at = |di: i64, dj: i64| self.key(i + di).key(j + dj).uniform();
        let line = |dj| at(0, dj) + (at(1, dj) - at(0, dj)) * u;
        let (low, high) = (line(0), line(1));
        low + (high - low) * v
    }

    /// Sum of `count` octaves of value noise, within ±1 around 0. The first octave has the given wavelength in metres, and
    /// each further octave half the wavelength and 0.65 of the amplitude of the one before.
    pub(super) fn fractal_noise(self, x_m: f64, y_m: f64, wavelength_m: f64, count: i64) -> f64 {
        let (mut sum, mut weights, mut weight, mut scale) = (0.0, 0.0, 1.0, 1.0 / wavelength_m);
        for octave in 0..count {
            sum += weight * (2.0 * self.key(octave).value_noise(x_m * scale, y_m * scale) - 1.0);
            weights += weight;
            weight *= 0.65;
            scale *= 2.0;
        }
        sum / weights
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_numbers_have_mean_0_and_standard_deviation_1() {
        let n = 20_000;
        let draws: Vec<f64> = (0..n).map(|i| KeyedRng::new(7).key(i).normal()).collect();
        let mean = draws.iter().sum::<f64>() / n as f64;
        let variance = draws.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / n as f64;
        assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.05, "{mean} {variance}");
    }

    #[test]
    fn noise_is_continuous_across_its_lattice() {
        let rng = KeyedRng::new(3);
        for k in -5..5 {
            let x = f64::from(k);
            assert!((rng.value_noise(x - 1e-9, 0.3) - rng.value_noise(x + 1e-9, 0.3)).abs() < 1e-6);
        }
    }
}
