//! Free space of file systems.

use std::ffi::CString;
use std::path::Path;

/// Free bytes of the file system that holds a folder; `None` if the system does not tell.
#[must_use]
pub fn free_disk_bytes(folder: &Path) -> Option<u64> {
    let path = CString::new(folder.to_string_lossy().as_bytes()).ok()?;
    // SAFETY: GDAL only reads the path, which ends with a zero byte and lives until the call returns.
    #[allow(unsafe_code)]
    let bytes = unsafe { gdal_sys::VSIGetDiskFreeSpace(path.as_ptr()) };
    u64::try_from(bytes).ok()
}
