//! Bundle adjustment: features, matches, tracks, and the solver that corrects the RPCs.
//!
//! A correction is a shift in the image (`corrected = rpc + shift`), which on crops stands for every small error of
//! attitude and is written exactly into the RPC's offsets; larger images may scale and shear. Matching runs twice:
//! first with the delivered cameras and a wide margin, then with the corrected ones and a narrow one. In the end
//! patches around the points, sought in all views, take the place of keypoints. Surveyed points, if there are any,
//! fix the datum; else the mean of the delivered cameras does, its height that of an elevation model if one is given.

mod adjust;
mod adjuster;
mod control;
mod control_check;
mod correction;
mod error;
mod features;
mod figures;
mod height_prior;
mod keypoint_file;
mod matching;
mod network;
mod output;
mod patches;
mod precision;
mod problem;
mod report;
mod result;
mod scale_space;
mod solver;
mod tie_point_refinement;
mod tracks;
mod view_pairs;
mod view_rejection;

pub use adjust::{Options, adjust};
pub use control::{ControlPoint, control_pairs, read_control};
pub use control_check::check_control;
pub use correction::{Model, Parameters};
pub use error::BundleError;
pub use features::{Keypoint, detect};
pub use height_prior::HeightPrior;
pub use output::{Adjustment, PointQuality, SparsePoint, TiePointObservation};
pub use report::{ControlReport, LeftOut, Report, ViewReport};
