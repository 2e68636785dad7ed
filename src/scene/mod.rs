//! Input scenes: views (image, RPC, sun, date), and the readers of all scene layouts.

mod aoi;
mod camera_choice;
mod checks;
mod chip;
mod crop;
mod dem;
mod dfc2019;
mod error;
mod files;
mod folder;
mod footprint;
mod manifest;
mod map_fit;
mod pixels;
mod read;
mod read_cost;
mod roles;
mod sidecar;
mod skyplot;
mod source;
mod sun;
mod transfer_function;
mod validity;
mod view;

pub use aoi::{Aoi, UtmBox};
pub use checks::{FARTHEST_OFF_NADIR_DEG, LOWEST_SUN_DEG};
pub use dem::Dem;
pub use error::SceneError;
pub use footprint::{Overlap, default_aoi, footprint, ground_seen, views_needed};
pub use pixels::{GrayImage, ValueRange};
pub use read::{ReadOptions, read};
pub use read_cost::{ReadCost, require_tiled_images};
pub use sidecar::ORDER as RPC_ORDER;
pub use source::{read_camera, sources_of};
pub use transfer_function::TransferFunction;
pub use view::{Role, Scene, Sun, View, angle_between_deg};
