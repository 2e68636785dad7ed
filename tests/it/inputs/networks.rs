//! Networks that users bring.

pub const FOLDERS: &[&str] = &[];
