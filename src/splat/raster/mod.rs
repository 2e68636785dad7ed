//! Rasterisation of splats with EWA projection and alpha compositing (3DGS), and its gradient.
//!
//! In a parallel projection from above, of two points on a ray the higher one is nearer to the camera. Splats are therefore
//! sorted once by the altitude of their centres for all such cameras of an iteration ([`SortedSplats`]). A camera projects
//! them in chunks of successive ranks; each band of sixteen pixel rows is binned into tiles of 16 x 16 pixels and rendered
//! by one thread ([`Rasterizer`]). The gradient of a splat is summed tile by tile into a slot for each band, then over the
//! bands in a fixed order: there are no atomic sums, and results are identical for any number of threads.

mod backward;
mod bands;
mod batch;
mod block;
mod constants;
mod covariance;
mod depth_sort;
mod disc;
mod footprint;
mod forward;
mod gather;
mod gradient_slot;
mod image;
mod kernel_constants;
mod primitive;
mod project;
mod rasterizer;
mod renderer;
mod scaled;
mod slope;
mod sorted;
mod splat_block;
#[cfg(test)]
mod disc_tests;
#[cfg(test)]
mod tests;

pub use block::TILE;
pub use constants::{ALPHA_CUT, ALPHA_MAX, LOW_PASS_PX2, MIN_TRANSMITTANCE};
pub use image::{Image, channel, disc_plane};
pub(in crate::splat) use image::{STRIPES, stripe_rows};
pub use primitive::{Disc, DiscWithMoments, Ellipsoid, EllipsoidWithTransmittance, Primitive};
pub use project::FrameCamera;
pub use rasterizer::{MAX_SIDE, Rasterizer};
pub use renderer::{Renderer, renderer};
pub use scaled::Scaled;
pub use slope::{MAX_TILT, parallel_slope};
pub use sorted::SortedSplats;
pub use splat_block::SplatGradient;
