//! Whether cameras are those of their photographs: features that match between views lie on the epipolar lines of their poses.
//!
//! Images are reduced, keypoints are found and matched between views that see the same by their poses, and matches are kept that
//! fit one rigid scene, whatever the poses. So what is left tells about the poses and focal lengths, not about the matches.

mod check;
mod consensus;
mod convention;
mod features;
mod matched_pair;
mod motion;
mod pairs;
mod strangers;

pub use check::{PoseCheck, ViewResidual};
pub(super) use features::{RigidMatches, ViewFeatures};
pub(super) use motion::Motion;
pub(super) use pairs::neighbours;
