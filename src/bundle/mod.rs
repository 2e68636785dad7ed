//! Bundle adjustment: features, matches, tracks, and the solver that corrects the RPCs.
//!
//! A correction is a shift in the image (`corrected = rpc + shift`), which on crops stands for every small error of
//! attitude and is written exactly into the RPC's offsets. Matching runs twice: first with the delivered cameras
//! and a wide margin, then with the corrected ones and a narrow one. In the end patches around the points, sought in
//! all views, take the place of keypoints.

mod adjust;
mod error;
mod features;
mod matching;
mod output;
mod patches;
mod problem;
mod report;
mod scale_space;
mod solver;
mod tracks;

pub use adjust::{Options, adjust};
pub use error::BundleError;
pub use features::{Keypoint, detect};
pub use output::{Adjustment, SparsePoint};
pub use report::{Report, ViewReport};
