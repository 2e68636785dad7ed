//! Satellite images, their cameras and metadata, heights, tiles.

pub const FOLDERS: &[&str] = &[];
