//! Random numbers by counting: a draw depends on what it is for, not on what was drawn before.

/// Seed, purpose, time and place of a draw.
#[derive(Clone, Copy, Debug)]
pub struct CounterRng {
    state: u64,
}

fn mix(mut z: u64) -> u64 {
    z = z.wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

impl CounterRng {
    /// The stream of draws for one purpose, step and item.
    #[must_use]
    pub fn new(seed: u64, purpose: u64, step: u64, item: u64) -> Self {
        Self { state: mix(mix(mix(mix(seed) ^ purpose) ^ step) ^ item) }
    }

    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        (mix(self.state) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Normal with mean 0 and deviation 1 (Box and Muller).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }

    /// A whole number below `n`.
    pub fn below(&mut self, n: usize) -> usize {
        ((self.uniform() * n as f64) as usize).min(n.saturating_sub(1))
    }

    /// A direction, uniform on the sphere.
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
    fn draws_have_the_moments_they_should() {
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
