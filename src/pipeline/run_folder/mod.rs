//! What a run folder holds for later stages: the scene, the cameras, the splats and their colours, what each stage was made
//! from, and the lock.

pub mod colors;
pub mod lock;
pub mod perspective_cameras;
pub mod perspective_fingerprint;
pub mod perspective_manifest;
pub mod satellite_cameras;
pub mod scene_fingerprint;
pub mod stage;
pub mod tiled;
