//! Programs that a user names, run with a time limit and without a shell.

use super::error::PriorError;
use crate::io::WriteError;
use crate::progress::Progress;
use std::ffi::OsString;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Longest time that a program may take for an image.
pub(super) const LIMIT: Duration = Duration::from_secs(600);
/// How often a running program is looked at.
const POLL: Duration = Duration::from_millis(20);
/// How many bytes at the end of its standard error are read, and how many lines are quoted.
const SAID_BYTES: u64 = 4096;
const SAID_LINES: usize = 4;

/// A call of a program for an image.
pub(super) struct Call<'a> {
    /// The command as the user gave it.
    pub text: &'a str,
    /// Its words, of which the first one is the program.
    pub words: &'a [OsString],
    /// The image that it is called for.
    pub image: &'a Path,
    /// Longest time.
    pub limit: Duration,
}

impl Call<'_> {
    /// Runs the program, which may keep its files in `folder`, and returns the last lines of its standard error; none if
    /// `progress` asks to stop. It does not run on in any case.
    ///
    /// # Errors
    /// [`PriorError`] if it cannot be started, fails or takes longer than the limit.
    pub fn run(&self, folder: &Path, progress: &dyn Progress) -> Result<Option<String>, PriorError> {
        let failed = |cause: std::io::Error| PriorError::Write(WriteError::new(folder, cause));
        let mut said = tempfile::tempfile().map_err(failed)?;
        let program = self.words.first().cloned().unwrap_or_default();
        let mut command = Command::new(&program);
        command.args(self.words.iter().skip(1)).stdin(Stdio::null()).stdout(Stdio::null());
        command.stderr(said.try_clone().map_err(failed)?);
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let child = command.spawn().map_err(|cause| PriorError::CommandStart {
            command: self.text.into(),
            program: program.to_string_lossy().into_owned(),
            cause,
        })?;
        let end = wait(child, self.limit, progress).map_err(failed)?;
        let said = last_lines(&mut said);
        let (command, image) = (self.text.to_owned(), self.image.to_path_buf());
        match end {
            End::Stopped => Ok(None),
            End::TimeOver => {
                Err(PriorError::CommandTime { command, image, limit_s: self.limit.as_secs_f64(), said })
            }
            End::Exited(status) if !status.success() => {
                Err(PriorError::CommandFailed { command, image, status, said })
            }
            End::Exited(_) => Ok(Some(said)),
        }
    }
}

/// How the wait for a command ends.
enum End {
    Exited(ExitStatus),
    TimeOver,
    Stopped,
}

/// Waits for a command, which is ended after a time or when `progress` asks to stop.
fn wait(mut child: Child, limit: Duration, progress: &dyn Progress) -> std::io::Result<End> {
    let began = Instant::now();
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(End::Exited(status));
        }
        let end = match (progress.is_cancelled(), began.elapsed() > limit) {
            (true, _) => End::Stopped,
            (_, true) => End::TimeOver,
            _ => {
                std::thread::sleep(POLL);
                continue;
            }
        };
        kill(&mut child);
        child.wait()?;
        return Ok(end);
    }
}

/// Ends a command, and the programs that it has started.
fn kill(child: &mut Child) {
    #[cfg(unix)]
    {
        let group = rustix::process::Pid::from_child(child);
        let _ = rustix::process::kill_process_group(group, rustix::process::Signal::KILL);
    }
    // It may have ended in between.
    let _ = child.kill();
}

/// The last lines of what a command wrote to standard error, in one line.
fn last_lines(file: &mut std::fs::File) -> String {
    let mut bytes = Vec::new();
    let read = file.seek(SeekFrom::End(0)).and_then(|length| {
        file.seek(SeekFrom::Start(length.saturating_sub(SAID_BYTES)))?;
        file.read_to_end(&mut bytes)
    });
    let text = String::from_utf8_lossy(&bytes);
    let lines: Vec<&str> = text.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    match (read, lines.as_slice()) {
        (Ok(_), [.., _]) => lines[lines.len().saturating_sub(SAID_LINES)..].join(" | "),
        _ => "it wrote nothing to standard error".into(),
    }
}
