//! One command at a time works in a run's folder.

use super::Failure;
use crate::raster::RasterError;
use crate::run_files::LOCK;
use std::fs::{File, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Folders that this process has locked. The system unlocks them when it ends, however it does.
static HELD: Mutex<Vec<(PathBuf, File)>> = Mutex::new(Vec::new());

/// Locks a run's folder until the process ends, and makes it if it is missing; a second time does nothing.
///
/// # Errors
/// When another process holds it, or the folder cannot be made.
pub(super) fn make_and_lock(run: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(run).map_err(|e| refused(run, &e))?;
    lock(run)
}

/// Locks a run's folder as [`make_and_lock`], if it is there. One that cannot be written needs no lock.
pub(super) fn lock(run: &Path) -> Result<(), Failure> {
    let Ok(folder) = std::fs::canonicalize(run) else { return Ok(()) };
    let mut held = HELD.lock().unwrap_or_else(PoisonError::into_inner);
    if !folder.is_dir() || held.iter().any(|(path, _)| *path == folder) {
        return Ok(());
    }
    let file = match File::options().create(true).truncate(false).write(true).open(folder.join(LOCK)) {
        Ok(file) => file,
        Err(e) if matches!(e.kind(), ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem) => {
            return Ok(());
        }
        Err(e) => return Err(refused(run, &e)),
    };
    match file.try_lock() {
        Ok(()) => held.push((folder, file)),
        Err(TryLockError::WouldBlock) => {
            return Err(Failure::input(
                format!("another satgs is at work in `{}`", run.display()),
                "wait until it is done, or give this one another folder",
            ));
        }
        // Some network file systems have no locks.
        Err(TryLockError::Error(e)) => tracing::debug!("`{}` cannot be locked: {e}", run.display()),
    }
    Ok(())
}

fn refused(run: &Path, error: &std::io::Error) -> Failure {
    RasterError::Write { path: run.into(), reason: error.to_string() }.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_locked_for_others_and_not_for_oneself() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().join("run");
        lock(&run).unwrap();
        assert!(!run.exists(), "only what makes a run makes its folder");
        make_and_lock(&run).unwrap();
        lock(&run).unwrap();
        // A second opening of the file stands for another process.
        let other = File::open(run.join(LOCK)).unwrap();
        assert!(matches!(other.try_lock(), Err(TryLockError::WouldBlock)));

        let taken = folder.path().join("taken");
        std::fs::create_dir(&taken).unwrap();
        let other = File::create(taken.join(LOCK)).unwrap();
        other.lock().unwrap();
        let refusal = lock(&taken).unwrap_err();
        assert!(refusal.message.contains("another satgs is at work in"), "{}", refusal.message);
        assert_eq!(refusal.exit_code, 2);
        drop(other);
        lock(&taken).unwrap();
    }
}
