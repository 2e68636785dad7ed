//! Atomic writing of files, and checks that a file can be written.

use super::WriteError;
use std::io::Write;
use std::path::Path;

/// Content that is written to check for free space; larger than what file systems store in an inode.
const TRIAL_BYTES: usize = 16 << 10;

/// Calls `write` with a temporary path in the folder of `path`, then renames that file to `path`. At any time, `path` is
/// the complete old file or the complete new file. Missing folders are created.
///
/// # Errors
/// The error of `write`, or [`WriteError`] with the error of the file system.
pub fn write_atomically<E: From<WriteError>>(
    path: &Path,
    write: impl FnOnce(&Path) -> Result<(), E>,
) -> Result<(), E> {
    let failed = |e: std::io::Error| WriteError::new(path, e);
    require_regular_file(path)?;
    let folder = folder_of(path);
    std::fs::create_dir_all(folder).map_err(failed)?;
    let suffix = path.file_name().map_or_else(String::new, |n| format!("-{}", n.to_string_lossy()));
    let temporary =
        tempfile::Builder::new().prefix(".satgs-").suffix(&suffix).tempfile_in(folder).map_err(failed)?;
    write(temporary.path())?;
    // Errors of a full disk may be reported only when the data are flushed to it.
    std::fs::File::open(temporary.path()).and_then(|f| f.sync_all()).map_err(failed)?;
    let file = temporary.persist(path).map_err(|e| failed(e.error))?;
    let mut permissions = file.metadata().map_err(failed)?.permissions();
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        permissions.set_mode(0o644);
    }
    Ok(std::fs::set_permissions(path, permissions).map_err(failed)?)
}

/// The folder in which a file lies.
fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Returns an error if the path exists and is not a regular file, because renaming would replace a device.
fn require_regular_file(path: &Path) -> Result<(), WriteError> {
    match std::fs::metadata(path) {
        Ok(there) if !there.is_file() => Err(WriteError::new(path, "it exists and is not a regular file")),
        _ => Ok(()),
    }
}

/// Removes a file, if there is one.
///
/// # Errors
/// [`WriteError`] if the file is there and cannot be removed.
pub fn remove_if_there(path: &Path) -> Result<(), WriteError> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(WriteError::new(path, e)),
        _ => Ok(()),
    }
}

/// Checks that a file can be written, so that the error occurs before a long computation. No file is left behind.
///
/// # Errors
/// [`WriteError`] if the file cannot be written.
pub fn check_writable(path: &Path) -> Result<(), WriteError> {
    require_regular_file(path)?;
    // Missing folders are created when the file is written.
    let folder = folder_of(path).ancestors().find(|f| f.exists()).unwrap_or(Path::new("."));
    if !folder.is_dir() {
        return Err(WriteError::new(path, format!("`{}` is not a folder", folder.display())));
    }
    let try_it = || -> std::io::Result<()> {
        let mut file = tempfile::Builder::new().prefix(".satgs-").tempfile_in(folder)?;
        file.write_all(&[0; TRIAL_BYTES])?;
        // Errors of a full disk may be reported only when the data are flushed to it.
        file.as_file().sync_all()
    };
    try_it().map_err(|e| WriteError::new(path, e))
}

/// Writes a file atomically: `path` is the complete old file or the complete new file. Missing folders are created.
///
/// # Errors
/// [`WriteError`] if the file cannot be written; an old file is unchanged then.
pub fn write_file(path: &Path, content: impl AsRef<[u8]>) -> Result<(), WriteError> {
    write_atomically(path, |temporary| {
        std::fs::write(temporary, content).map_err(|e| WriteError::new(path, e))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_check_refuses_unwritable_paths_and_leaves_no_file() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("file");
        std::fs::write(&file, "old").unwrap();
        check_writable(&file).unwrap();
        check_writable(&dir.path().join("run/ba/report.json")).unwrap();
        for (path, says) in [
            (file.join("ba/report.json"), "file` is not a folder"),
            (dir.path().to_path_buf(), "not a regular file"),
            ("/proc/run/report.json".into(), "/proc/run/report.json"),
            ("/sys/report.json".into(), "/sys/report.json"),
        ] {
            let refused = check_writable(&path).unwrap_err().to_string();
            assert!(refused.contains(says), "{}: {refused}", path.display());
        }
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "old");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    /// Without the check, a process of the user root would replace `/dev/null` by a file.
    #[cfg(unix)]
    #[test]
    fn a_device_is_not_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let socket = dir.path().join("socket");
        let _listening = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        assert!(write_file(&socket, "x").unwrap_err().to_string().contains("not a regular file"));
        assert!(check_writable(Path::new("/dev/full")).is_err());
    }

    #[test]
    fn a_failed_write_leaves_only_the_old_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("x.txt");
        std::fs::write(&path, "old").unwrap();
        let result = write_atomically(&path, |t| {
            std::fs::write(t, "half").unwrap();
            Err(WriteError::new(&path, "disk full"))
        });
        assert!(result.is_err());
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }
}
