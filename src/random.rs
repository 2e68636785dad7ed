//! A counter-based random number generator (as in Salmon et al. 2011): random numbers depend on a key, not on
//! which numbers were drawn before. Results therefore do not depend on the order of parallel work.

/// A stream of random numbers for one key: seed, purpose, step and item.
#[derive(Clone, Copy, Debug)]
pub struct CounterRng {
    state: u64,
}

/// A step of SplitMix64 (Steele, Lea and Flood 2014): maps an integer to pseudorandom bits.
#[must_use]
pub const fn mix(seed: u64) -> u64 {
    let z = seed.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// A uniform number in [0, 1) from the upper 53 of 64 random bits.
#[must_use]
pub fn unit_interval(bits: u64) -> f64 {
    (bits >> 11) as f64 / (1u64 << 53) as f64
}

/// A standard normal number from two uniform numbers in [0, 1) (Box and Muller 1958).
#[must_use]
pub fn box_muller(u: f64, v: f64) -> f64 {
    (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

impl CounterRng {
    /// The stream of numbers for one purpose, step and item. Streams with different keys are independent.
    #[must_use]
    pub fn new(seed: u64, purpose: u64, step: u64, item: u64) -> Self {
        Self { state: mix(mix(mix(mix(seed) ^ purpose) ^ step) ^ item) }
    }

    /// The next number, uniform in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        unit_interval(mix(self.state))
    }

    /// The next number, normal with mean 0 and standard deviation 1.
    pub fn normal(&mut self) -> f64 {
        box_muller(self.uniform(), self.uniform())
    }

    /// The next whole number, uniform from 0 to below `n`; 0 if `n` is 0.
    pub fn below(&mut self, n: usize) -> usize {
        ((self.uniform() * n as f64) as usize).min(n.saturating_sub(1))
    }

    /// The next unit vector, uniform on the sphere.
    pub fn direction(&mut self) -> [f64; 3] {
        let z = 2.0 * self.uniform() - 1.0;
        let (sin, cos) = (std::f64::consts::TAU * self.uniform()).sin_cos();
        let level = (1.0 - z * z).sqrt();
        [level * cos, level * sin, z]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_numbers_have_mean_0_and_standard_deviation_1() {
        let n = 20_000;
        let (mut mean, mut square) = (0.0, 0.0);
        for i in 0..n {
            let v = CounterRng::new(1, 2, 3, i).normal();
            mean += v / n as f64;
            square += v * v / n as f64;
        }
        assert!(mean.abs() < 0.02 && (square - 1.0).abs() < 0.03, "{mean} {square}");
    }
}
