//! Chance without state: numbers that depend on a seed and on indices alone, so threads cannot matter.
//!
//! The mixer is SplitMix64 (Steele, Lea and Flood, 2014).

/// A place in an endless table of random numbers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Dice(u64);

impl Dice {
    /// The table of a seed.
    pub(super) const fn new(seed: u64) -> Self {
        Self(mix(seed))
    }

    /// The place `index` steps into a new dimension of the table.
    pub(super) const fn on(self, index: i64) -> Self {
        Self(mix(self.0 ^ (index as u64).wrapping_mul(0xd6e8_feb8_6659_fd93)))
    }

    /// Uniform in [0, 1).
    pub(super) fn unit(self) -> f64 {
        (mix(self.0) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in [lo, hi).
    pub(super) fn between(self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * self.unit()
    }

    /// Normal with mean 0 and standard deviation 1 (Box and Muller).
    pub(super) fn gauss(self) -> f64 {
        let radius = (-2.0 * (1.0 - self.on(1).unit()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.on(2).unit()).cos()
    }

    /// Value noise of unit wavelength, in [0, 1).
    pub(super) fn noise(self, x: f64, y: f64) -> f64 {
        let (i, j) = (x.floor(), y.floor());
        let smooth = |t: f64| t * t * (3.0 - 2.0 * t);
        let (u, v) = (smooth(x - i), smooth(y - j));
        let (i, j) = (i as i64, j as i64);
        let at = |di: i64, dj: i64| self.on(i + di).on(j + dj).unit();
        let line = |dj| at(0, dj) + (at(1, dj) - at(0, dj)) * u;
        let (low, high) = (line(0), line(1));
        low + (high - low) * v
    }

    /// Octaves of value noise from a wavelength in metres downwards, each half as long and 0.65 as strong; around
    /// 0, within ±1.
    pub(super) fn octaves(self, x_m: f64, y_m: f64, wavelength_m: f64, count: i64) -> f64 {
        let (mut sum, mut weights, mut weight, mut scale) = (0.0, 0.0, 1.0, 1.0 / wavelength_m);
        for octave in 0..count {
            sum += weight * (2.0 * self.on(octave).noise(x_m * scale, y_m * scale) - 1.0);
            weights += weight;
            weight *= 0.65;
            scale *= 2.0;
        }
        sum / weights
    }
}

const fn mix(seed: u64) -> u64 {
    let z = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gauss_has_mean_zero_and_deviation_one() {
        let n = 20_000;
        let draws: Vec<f64> = (0..n).map(|i| Dice::new(7).on(i).gauss()).collect();
        let mean = draws.iter().sum::<f64>() / n as f64;
        let variance = draws.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / n as f64;
        assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.05, "{mean} {variance}");
    }

    #[test]
    fn noise_is_continuous_across_its_lattice() {
        let dice = Dice::new(3);
        for k in -5..5 {
            let x = f64::from(k);
            assert!((dice.noise(x - 1e-9, 0.3) - dice.noise(x + 1e-9, 0.3)).abs() < 1e-6);
        }
    }
}
