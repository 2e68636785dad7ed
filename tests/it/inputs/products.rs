//! What a run writes, prints and keeps.

pub const FOLDERS: &[&str] = &[];
