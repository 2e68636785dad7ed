//! The rational polynomial camera (RPC00B): projection, derivatives, localisation, files.
//!
//! Pixel (0, 0) is the centre of the first pixel; heights are metres above the WGS 84 ellipsoid.

mod localize;
mod model;

pub mod formats;

pub use localize::LocalizeError;
pub use model::{Axis, Jacobian, Rpc, RpcCoefficients, RpcError};

/// A made-up camera for the tests of other modules.
#[cfg(test)]
pub(crate) fn test_camera() -> Rpc {
    model::tests::synthetic()
}
