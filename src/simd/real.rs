//! The scalars that kernels compute with: f32 in training, f64 where tests check the gradients of the same code.

use num_traits::Float;
use std::iter::Sum;

/// A scalar: f32 or f64.
pub trait Real: Float + Default + Sum + Send + Sync + std::fmt::Debug + 'static {
    /// Rounds an f64.
    fn from_f64(value: f64) -> Self;
    /// Converts to f64 without loss.
    fn as_f64(self) -> f64;
    /// The whole part of a value of at least 0 and below 2^31.
    fn as_u32(self) -> u32;
}

impl Real for f64 {
    fn from_f64(value: f64) -> Self {
        value
    }
    fn as_f64(self) -> f64 {
        self
    }
    fn as_u32(self) -> u32 {
        self as i32 as u32
    }
}

impl Real for f32 {
    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        value as f32
    }
    #[inline(always)]
    fn as_f64(self) -> f64 {
        f64::from(self)
    }
    #[inline(always)]
    fn as_u32(self) -> u32 {
        self as i32 as u32
    }
}
