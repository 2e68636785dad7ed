//! Disk of the machine, where the system tells it.

use std::path::Path;

const MEGABYTE: f64 = 1e6;

/// Free disk space for files in a folder that exists or can be made, megabytes.
pub fn free_disk_mb(folder: &Path) -> Option<f64> {
    let existing = folder.ancestors().find(|path| path.exists())?;
    crate::io::free_disk_bytes(existing).map(|bytes| bytes as f64 / MEGABYTE)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn free_disk_space_is_that_of_the_nearest_folder_that_exists() {
        let folder = tempfile::tempdir().unwrap();
        let free = free_disk_mb(&folder.path().join("a/b")).unwrap();
        assert!(free > 0.0);
    }
}
