//! The constants of the base-2 exponential.

use super::{Real, Simd};
use num_traits::Zero;

/// The constants of [`Simd::exp2`]: 1.5 * 2^23, whose addition rounds to whole numbers, and the coefficients
/// of the polynomial that interpolates 2^f at the Chebyshev nodes of [-1/2, 1/2], from the constant term up.
const CONSTANTS: [f32; 7] = [
    12_582_912.0,
    1.000_000_1,
    std::f32::consts::LN_2,
    0.240_221_07,
    0.055_503_57,
    0.009_676_032,
    0.001_339_086_3,
];

/// The constants of [`SimdVec::exp2_with`](super::SimdVec::exp2_with), broadcast once for a whole kernel.
pub struct Exp2<S: Simd> {
    pub(super) constants: [S::Vector; 7],
}

impl<S: Simd> Exp2<S> {
    /// Broadcasts the constants.
    #[inline(always)]
    pub fn new(simd: S) -> Self {
        let mut constants = [simd.broadcast(S::Scalar::zero()); 7];
        for k in 0..7 {
            constants[k] = simd.broadcast(S::Scalar::from_f64(f64::from(CONSTANTS[k])));
        }
        Self { constants }
    }
}
