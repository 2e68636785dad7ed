//! Bundle adjustment of RPC cameras: features, matches, tracks, and the solver that corrects the RPCs.
//!
//! The default correction is a shift in the image (`corrected = rpc + shift`). For crops it accounts for all small
//! errors of attitude, and the offsets of the RPC express it exactly; for larger images a scale and a shear can be added. Matching runs twice: first with the delivered cameras and a large epipolar tolerance, then with the corrected
//! cameras and a small one. Finally the tie points are measured again by least-squares matching in all views, which
//! replaces the positions of the keypoints. Surveyed points define the datum if there are any; otherwise the mean of
//! the delivered cameras does, with the heights of an elevation model if one is given.
//!
//! A scene of more than a square kilometre is cut into cells of ground. Each is cropped, matched and adjusted as if it were
//! a scene of its own, and keeps some hundred tracks that are spread over it; all cells' tracks together are then
//! adjusted at once. Memory is needed for one cell at a time, and finished cells are stored.
//!
//! The words of this module, in the order of processing: a *keypoint* is a feature of one image; a *match* is a pair of
//! keypoints of two views; a *track* is a set of keypoints (its *track elements*), at most one per view, that are taken
//! for one point on the ground; an *observation* is the position of that point in a view, with a weight; a *tie point*
//! or *sparse point* is the triangulated point itself.

mod adjust;
mod adjuster;
mod cell;
mod cell_grid;
mod cell_tracks;
mod control;
mod control_check;
mod correction;
mod duplicates;
mod error;
mod features;
mod figures;
mod height_prior;
mod matching;
mod network;
mod options;
mod output;
mod pair_matches;
mod patches;
mod point_heights;
mod precision;
mod problem;
mod report;
mod result;
mod scale_space;
mod solver;
mod stages;
mod stored_keypoint;
mod tie_point_refinement;
mod track_choice;
mod tracks;
mod used_view;
mod view_pairs;
mod view_rejection;
mod whole_scene;

pub use adjust::adjust;
pub use control::{
    ControlPair, ControlPoint, control_pairs, delivered_control_pairs, read_control, stated_accuracy_m,
};
pub use control_check::check_control;
pub use correction::{CorrectionModel, Parameters};
pub use error::BundleError;
pub use features::{Keypoint, detect};
pub use figures::ADJUSTMENT_FIGURES;
pub use height_prior::HeightPrior;
pub use options::BundleOptions;
pub use output::{Adjustment, PointQuality, SparsePoint, TiePointObservation};
pub use pair_matches::pair_matches;
pub use report::{CellReport, ControlReport, LeftOut, Report, ViewReport};
