//! What a `transforms.json` holds, and which of its keys have no effect here.

use super::intrinsics::Intrinsics;
use serde::Deserialize;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// Keys that do not change what is read: they are about the box and the axes in which other programs train, about how the
/// file was made, or numbers that programs keep for themselves.
const WITHOUT_EFFECT: [&str; 24] = [
    "aabb",
    "aabb_scale",
    "applied_scale",
    "auto_scale_poses_override",
    "colmap_im_id",
    "enable_depth_loading",
    "enable_ray_loading",
    "from_na",
    "id",
    "image_id",
    "is_keyframe",
    "motion_blur_score",
    "n_extra_learnable_dims",
    "offset",
    "orientation_override",
    "render_aabb",
    "rotation",
    "scale",
    "sharpness",
    "sharpness_discard_threshold",
    "timestamp",
    "up",
    "z_far",
    "z_near",
];

/// One image.
#[derive(Clone, Debug, Deserialize)]
pub(super) struct Frame {
    pub file_path: String,
    /// Numbers that are not finite are none.
    pub transform_matrix: Vec<[Option<f64>; 4]>,
    pub mask_path: Option<String>,
    /// Of nerfstudio.
    pub depth_file_path: Option<String>,
    /// Of instant-ngp.
    pub depth_path: Option<String>,
    #[serde(flatten)]
    pub intrinsics: Intrinsics,
    #[serde(flatten)]
    others: BTreeMap<String, Value>,
}

#[derive(Clone, Debug, Deserialize)]
pub(super) struct Transforms {
    #[serde(default)]
    pub frames: Vec<Frame>,
    /// Unit of the file that a stored 1 of `depth_file_path` is (nerfstudio).
    pub depth_unit_scale_factor: Option<f64>,
    /// The same of `depth_path` (instant-ngp).
    pub integer_depth_scale: Option<f64>,
    pub ply_file_path: Option<String>,
    /// From the frame of the COLMAP model to that of the poses (nerfstudio).
    pub applied_transform: Option<Vec<[f64; 4]>>,
    pub train_filenames: Option<Vec<String>>,
    pub val_filenames: Option<Vec<String>>,
    pub test_filenames: Option<Vec<String>>,
    #[serde(flatten)]
    pub intrinsics: Intrinsics,
    #[serde(flatten)]
    others: BTreeMap<String, Value>,
}

impl Transforms {
    /// The keys that are not understood.
    pub fn unknown_keys(&self) -> Vec<String> {
        let is_unknown = |key: &&String| !WITHOUT_EFFECT.contains(&key.as_str());
        let of_frames: BTreeSet<&String> =
            self.frames.iter().flat_map(|frame| frame.others.keys()).filter(is_unknown).collect();
        let own = self.others.keys().filter(is_unknown).cloned();
        own.chain(of_frames.into_iter().map(|key| format!("{key} of frames"))).collect()
    }
}
