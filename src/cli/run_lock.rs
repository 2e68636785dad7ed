//! One command at a time works in a run's folder.

use super::Failure;
use crate::io::WriteError;
use crate::run_files::LOCK;
use std::fs::{File, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// How often a lock is tried that whoever held it has removed.
const TRIES: usize = 16;

/// Folders that this process has locked. The system unlocks them when it ends, however it does.
static HELD: Mutex<Vec<Held>> = Mutex::new(Vec::new());

struct Held {
    folder: PathBuf,
    /// Open, and so locked.
    file: File,
    /// Folders that were made for it, the innermost first.
    made: Vec<PathBuf>,
}

/// Locks a run's folder until [`release`], and makes it if it is missing; a second time does nothing.
///
/// # Errors
/// When another process holds it, or the folder cannot be made.
pub(super) fn make_and_lock(run: &Path) -> Result<(), Failure> {
    let is_missing = |folder: &&Path| !folder.as_os_str().is_empty() && !folder.exists();
    let made: Vec<PathBuf> = run.ancestors().take_while(is_missing).map(Path::to_path_buf).collect();
    std::fs::create_dir_all(run).map_err(|e| refused(run, e))?;
    hold(run, made)
}

/// Locks a run's folder as [`make_and_lock`], if it is there. One that cannot be written needs no lock.
pub(super) fn lock(run: &Path) -> Result<(), Failure> {
    hold(run, Vec::new())
}

/// Unlocks all, and removes the folders that were made and have stayed empty.
pub(super) fn release() {
    for held in HELD.lock().unwrap_or_else(PoisonError::into_inner).drain(..) {
        // What cannot be removed does no harm.
        let _ = std::fs::remove_file(held.folder.join(LOCK));
        drop(held.file);
        let _ = held.made.iter().try_for_each(std::fs::remove_dir);
    }
}

fn hold(run: &Path, made: Vec<PathBuf>) -> Result<(), Failure> {
    let Ok(folder) = std::fs::canonicalize(run) else { return Ok(()) };
    let mut held = HELD.lock().unwrap_or_else(PoisonError::into_inner);
    if !folder.is_dir() || held.iter().any(|h| h.folder == folder) {
        return Ok(());
    }
    let path = folder.join(LOCK);
    for _ in 0..TRIES {
        let file = match File::options().create(true).truncate(false).write(true).open(&path) {
            Ok(file) => file,
            Err(e) if matches!(e.kind(), ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem) => {
                return Ok(());
            }
            Err(e) => return Err(refused(run, e)),
        };
        match file.try_lock() {
            // Whoever held it may have removed it since it was opened here.
            Ok(()) if !is_at(&file, &path) => {}
            Ok(()) => {
                held.push(Held { folder, file, made });
                return Ok(());
            }
            Err(TryLockError::WouldBlock) => {
                return Err(Failure::input(
                    format!("another satgs is at work in `{}`", run.display()),
                    "wait until it is done, or give this one another folder",
                ));
            }
            // Some network file systems have no locks.
            Err(TryLockError::Error(e)) => {
                tracing::debug!("`{}` cannot be locked: {e}", run.display());
                return Ok(());
            }
        }
    }
    tracing::debug!("`{}` does not stay the file that it was: no lock", path.display());
    Ok(())
}

/// Whether an open file is the one at a path.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let identity = |m: std::fs::Metadata| (m.dev(), m.ino());
    let (open, named) = (file.metadata().map(identity), std::fs::metadata(path).map(identity));
    open.ok().is_some_and(|open| named.is_ok_and(|named| named == open))
}

/// Elsewhere an open file cannot be removed.
#[cfg(not(unix))]
fn is_at(_: &File, _: &Path) -> bool {
    true
}

fn refused(run: &Path, error: std::io::Error) -> Failure {
    WriteError::new(run, error).into()
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

        let deep = folder.path().join("made/for/nothing");
        make_and_lock(&deep).unwrap();
        std::fs::write(run.join("result"), "").unwrap();
        release();
        assert!(!folder.path().join("made").exists(), "nothing was written there");
        assert!(run.join("result").exists() && !run.join(LOCK).exists());
        assert!(taken.exists(), "it was there before");
    }
}
