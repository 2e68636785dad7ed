//! Photographs: layouts of scenes, masks, depths, priors, units.

pub const FOLDERS: &[&str] = &[];
