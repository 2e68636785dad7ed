//! One command at a time works in a run folder.

use super::super::PipelineError;
use crate::io::WriteError;
use crate::run_files::LOCK;
use std::fs::{File, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// How long a lock is tried that another holds.
const PATIENCE: Duration = Duration::from_millis(200);
/// How often a lock is tried whose file the previous holder has removed.
const TRIES: usize = 32;

/// The lock of a run folder, held until it is dropped. The system releases it when the process ends, however it ends.
///
/// It keeps out other processes and other calls of this process. A folder that does not exist, that is read-only, or
/// whose file system has no locks is not locked.
#[must_use]
#[derive(Debug)]
pub struct RunLock {
    held: Option<Held>,
}

#[derive(Debug)]
struct Held {
    folder: PathBuf,
    /// Open, and so locked; none where the file system has no locks.
    file: Option<File>,
    /// Folders that were made for the run, the innermost first.
    made: Vec<PathBuf>,
}

impl RunLock {
    /// Makes a run folder if it is missing, and locks it. Folders that were made and have stayed empty are removed when
    /// the lock is dropped.
    ///
    /// # Errors
    /// [`PipelineError::Locked`], or [`PipelineError::Write`] when the folder cannot be made.
    pub fn make(run: &Path) -> Result<Self, PipelineError> {
        let is_missing = |folder: &&Path| !folder.as_os_str().is_empty() && !folder.exists();
        let made: Vec<PathBuf> = run.ancestors().take_while(is_missing).map(Path::to_path_buf).collect();
        std::fs::create_dir_all(run).map_err(|e| WriteError::new(run, e))?;
        Self::hold(run, made)
    }

    /// Locks a run folder, if it exists.
    ///
    /// # Errors
    /// [`PipelineError::Locked`], or [`PipelineError::Write`] when the lock's file cannot be made.
    pub fn existing(run: &Path) -> Result<Self, PipelineError> {
        Self::hold(run, Vec::new())
    }

    /// Whether a call or process holds the lock of a run folder now.
    #[must_use]
    pub fn is_held(run: &Path) -> bool {
        let file = File::options().write(true).open(run.join(LOCK));
        file.is_ok_and(|file| matches!(file.try_lock(), Err(TryLockError::WouldBlock)))
    }

    fn hold(run: &Path, made: Vec<PathBuf>) -> Result<Self, PipelineError> {
        let unlocked = Self { held: None };
        let Ok(folder) = std::fs::canonicalize(run) else { return Ok(unlocked) };
        if !folder.is_dir() {
            return Ok(unlocked);
        }
        let path = folder.join(LOCK);
        let began = Instant::now();
        for _ in 0..TRIES {
            let file = match File::options().create(true).truncate(false).write(true).open(&path) {
                Ok(file) => file,
                Err(e) if matches!(e.kind(), ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem) => {
                    return Ok(unlocked);
                }
                Err(e) => return Err(WriteError::new(run, e).into()),
            };
            match file.try_lock() {
                // The previous holder may have removed the file since it was opened here.
                Ok(()) if !is_at(&file, &path) => {}
                Ok(()) => return Ok(Self { held: Some(Held { folder, file: Some(file), made }) }),
                // A call of `is_held` holds the lock for a moment.
                Err(TryLockError::WouldBlock) if began.elapsed() < PATIENCE => {
                    std::thread::sleep(PATIENCE / 10)
                }
                Err(TryLockError::WouldBlock) => return Err(PipelineError::Locked { run: run.into() }),
                // Some network file systems have no locks.
                Err(TryLockError::Error(e)) => {
                    tracing::debug!("`{}` cannot be locked: {e}", run.display());
                    return Ok(Self { held: Some(Held { folder, file: None, made }) });
                }
            }
        }
        tracing::debug!("`{}` is replaced again and again: no lock", path.display());
        Ok(unlocked)
    }
}

impl Drop for RunLock {
    fn drop(&mut self) {
        let Some(held) = self.held.take() else { return };
        // A file or folder that cannot be removed does no harm.
        let _ = std::fs::remove_file(held.folder.join(LOCK));
        drop(held.file);
        let _ = held.made.iter().try_for_each(std::fs::remove_dir);
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::ErrorKind::Input;

    #[test]
    fn a_folder_is_locked_until_the_lock_is_dropped() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().join("run");
        let none = RunLock::existing(&run).unwrap();
        assert!(!run.exists(), "only what makes a run makes its folder");
        drop(none);
        let lock = RunLock::make(&run).unwrap();
        // A second opening of the file stands for another process.
        let other = File::open(run.join(LOCK)).unwrap();
        assert!(matches!(other.try_lock(), Err(TryLockError::WouldBlock)));
        let refusal = RunLock::existing(&run).unwrap_err();
        assert!(matches!(refusal, PipelineError::Locked { .. }), "{refusal}");
        assert_eq!(refusal.kind(), Input);
        std::fs::write(run.join("result"), "").unwrap();
        drop(lock);
        assert!(run.join("result").exists() && !run.join(LOCK).exists());
        drop(RunLock::existing(&run).unwrap());
    }

    #[test]
    fn a_folder_that_another_process_has_locked_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let other = File::create(folder.path().join(LOCK)).unwrap();
        other.lock().unwrap();
        assert!(matches!(RunLock::existing(folder.path()), Err(PipelineError::Locked { .. })));
        drop(other);
        drop(RunLock::existing(folder.path()).unwrap());
        assert!(folder.path().exists(), "it was there before");
    }

    #[test]
    fn folders_that_were_made_and_stayed_empty_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        drop(RunLock::make(&folder.path().join("made/for/nothing")).unwrap());
        assert!(!folder.path().join("made").exists());
    }
}
