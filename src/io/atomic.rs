//! Files that appear whole or not at all, and whether they could.

use super::WriteError;
use std::io::Write;
use std::path::Path;

/// What is written to see whether a disk takes it: more than file systems keep in an inode.
const TRIAL_BYTES: usize = 16 << 10;

/// Runs `write` on a temporary name beside `path`, then renames: `path` is the old file or the whole new one.
///
/// # Errors
/// What `write` returns, or [`WriteError`] with the system's error.
pub fn write_atomically<E: From<WriteError>>(
    path: &Path,
    write: impl FnOnce(&Path) -> Result<(), E>,
) -> Result<(), E> {
    let failed = |e: std::io::Error| WriteError::new(path, e);
    refuse_what_is_no_file(path)?;
    let folder = folder_of(path);
    std::fs::create_dir_all(folder).map_err(failed)?;
    let suffix = path.file_name().map_or_else(String::new, |n| format!("-{}", n.to_string_lossy()));
    let temporary =
        tempfile::Builder::new().prefix(".satgs-").suffix(&suffix).tempfile_in(folder).map_err(failed)?;
    write(temporary.path())?;
    // A full disk shows at the latest when the data must reach it.
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

/// Devices and folders would be replaced by the file.
fn refuse_what_is_no_file(path: &Path) -> Result<(), WriteError> {
    match std::fs::metadata(path) {
        Ok(there) if !there.is_file() => Err(WriteError::new(path, "it exists and is not a regular file")),
        _ => Ok(()),
    }
}

/// Asks whether a file could be written, for that to be known before long work. Leaves nothing behind.
///
/// # Errors
/// [`WriteError`].
pub fn check_writable(path: &Path) -> Result<(), WriteError> {
    refuse_what_is_no_file(path)?;
    // The folders that are missing are made when the file is.
    let folder = folder_of(path).ancestors().find(|f| f.exists()).unwrap_or(Path::new("."));
    if !folder.is_dir() {
        return Err(WriteError::new(path, format!("`{}` is not a folder", folder.display())));
    }
    let try_it = || -> std::io::Result<()> {
        let mut file = tempfile::Builder::new().prefix(".satgs-").tempfile_in(folder)?;
        file.write_all(&[0; TRIAL_BYTES])?;
        // A full disk shows at the latest when the data must reach it.
        file.as_file().sync_all()
    };
    try_it().map_err(|e| WriteError::new(path, e))
}

/// Writes a file as a whole or not at all.
///
/// # Errors
/// [`WriteError`].
pub fn write_file(path: &Path, content: impl AsRef<[u8]>) -> Result<(), WriteError> {
    write_atomically(path, |temporary| {
        std::fs::write(temporary, content).map_err(|e| WriteError::new(path, e))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_written_is_told_before_and_nothing_is_left() {
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

    /// Root may replace `/dev/null` by a file, after which nothing on the machine works.
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
    fn a_failed_write_leaves_the_old_file_and_no_other() {
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
