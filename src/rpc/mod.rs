//! The rational polynomial camera (RPC00B): projection, derivatives, localisation, files.
//!
//! Pixel (0, 0) is the centre of the first pixel; heights are metres above the WGS 84 ellipsoid.

mod batch;
mod compare;
mod fit;
mod kernel;
mod localize;
mod model;

pub mod formats;

pub use batch::{GroundBatch, PixelBatch};
pub use compare::Difference;
pub use fit::{Volume, fit};
pub use localize::LocalizeError;
pub(crate) use model::polynomial;
pub use model::{Axis, Jacobian, Rpc, RpcCoefficients, RpcError};

/// A synthetic camera for the tests of other modules.
#[cfg(test)]
pub(crate) fn test_camera() -> Rpc {
    model::tests::synthetic()
}
