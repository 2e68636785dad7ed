//! The numbers the splatting core computes with: f32 to train, f64 to check every gradient of the same code.

use num_traits::Float;
use std::iter::Sum;

/// f32 or f64.
pub trait Real: Float + Default + Sum + Send + Sync + std::fmt::Debug + 'static {
    /// Nearest number to an f64.
    fn of(value: f64) -> Self;
    /// As f64.
    fn wide(self) -> f64;
    /// The whole part of a number between 0 and 2^31.
    fn small(self) -> u32;
    /// Two to a power between -126 and 126; vectorises. `FMA`: the code around is compiled for fused
    /// multiplication and addition.
    fn exp2_lane<const FMA: bool>(self) -> Self;
    /// e to a power between -87 and 87; vectorises.
    fn exp_lane(self) -> Self {
        (self * Self::of(std::f64::consts::LOG2_E)).exp2_lane::<false>()
    }
    /// `self * b + c`, in one instruction where there is one.
    #[inline(always)]
    fn madd<const FMA: bool>(self, b: Self, c: Self) -> Self {
        if FMA { self.mul_add(b, c) } else { self * b + c }
    }
}

impl Real for f64 {
    fn of(value: f64) -> Self {
        value
    }
    fn wide(self) -> f64 {
        self
    }
    fn small(self) -> u32 {
        self as i32 as u32
    }
    fn exp2_lane<const FMA: bool>(self) -> Self {
        self.exp2()
    }
}

impl Real for f32 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value as f32
    }
    #[inline(always)]
    fn wide(self) -> f64 {
        f64::from(self)
    }
    #[inline(always)]
    fn small(self) -> u32 {
        self as i32 as u32
    }
    /// Relative error below 3e-7 (tested): the nearest whole power by the exponent bits, the rest by a polynomial.
    #[inline(always)]
    fn exp2_lane<const FMA: bool>(self) -> Self {
        // Adding 1.5 * 2^23 rounds to a whole number, which then stands in the low bits.
        const ROUND: f32 = 12_582_912.0;
        // Taylor coefficients of 2^f, f in [-1/2, 1/2]: (ln 2)^k / k!.
        const C: [f32; 7] = [
            1.0,
            std::f32::consts::LN_2,
            0.240_226_5,
            0.055_504_11,
            0.009_618_129,
            0.001_333_355_8,
            0.000_154_035_3,
        ];
        let shifted = self + ROUND;
        let f = self - (shifted - ROUND);
        let mut p = C[6];
        for c in C[..6].iter().rev() {
            p = p.madd::<FMA>(f, *c);
        }
        f32::from_bits(p.to_bits().wrapping_add(shifted.to_bits() << 23))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polynomial_exp_is_within_3e7() {
        let worst = (-1200..=1200)
            .map(|i| {
                let x = i as f32 * 0.01;
                let exact = f64::from(x).exp2();
                (f64::from(x.exp2_lane::<false>()) - exact).abs() / exact
            })
            .fold(0.0, f64::max);
        assert!(worst < 3e-7, "{worst:e}");
    }
}
