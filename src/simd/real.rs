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
}
