//! Constants of alpha compositing, as 3DGS has them.

/// Low-pass filter: variance in px² that is added to the diagonal of every projected covariance (3DGS).
pub const LOW_PASS_PX2: f64 = 0.3;
/// Smallest alpha that is composited; a splat with less does not touch the pixel (3DGS).
pub const ALPHA_CUT: f64 = 1.0 / 255.0;
/// Largest alpha; larger ones are clamped (3DGS: 0.99).
pub const ALPHA_MAX: f64 = 0.99;
/// Early-termination threshold: a block of pixels is complete when the transmittance of all its pixels is below this
/// (3DGS). It is checked once for as many splats as a vector has lanes.
pub const MIN_TRANSMITTANCE: f64 = 1e-4;
