//! Georeferences, control, alignment and comparison with meshes and surfaces.

pub const FOLDERS: &[&str] = &[];
