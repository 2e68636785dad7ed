//! Maps by a command that a user names, called once for each image. No shell is involved.

use super::error::PriorError;
use super::folder::ENDS;
use crate::io::{WriteError, vsi};
use crate::perspective::PerspectiveView;
use crate::progress::Progress;
use std::ffi::{OsStr, OsString};
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// What stands for the image file in a command.
const IMAGE: &str = "{image}";
/// What stands for the file to write.
const OUT: &str = "{out}";
/// How often a running command is looked at.
const POLL: Duration = Duration::from_millis(20);
/// How many bytes at the end of its standard error are read, and how many lines are quoted.
const SAID_BYTES: u64 = 4096;
const SAID_LINES: usize = 4;

/// A command that writes the map of an image.
///
/// The text is split into words as a shell does, with quotation marks and backslashes, and nothing else of a shell: no
/// variables, pipes or redirections. `{image}` stands for the path of an image, `{out}` for that of the file to write,
/// `NAME.npy`; followed by another ending, as in `{out}.png`, for `NAME.png`.
#[derive(Clone, Debug, PartialEq)]
pub struct PriorCommand {
    text: String,
    words: Vec<String>,
}

impl PriorCommand {
    /// Reads a command.
    ///
    /// # Errors
    /// [`PriorError::NoSource`] if it does not name `{image}` and `{out}`, [`PriorError::Words`] if a quotation mark is open.
    pub fn parse(text: &str) -> Result<Self, PriorError> {
        let no_source = || PriorError::NoSource { text: text.into() };
        if !(text.contains(IMAGE) && text.contains(OUT)) {
            return Err(no_source());
        }
        let words = shlex::split(text).ok_or_else(|| PriorError::Words { text: text.into() })?;
        // What follows a lone # is a comment.
        let is_named = |mark| words.iter().any(|word| word.contains(mark));
        if is_named(IMAGE) && is_named(OUT) {
            Ok(Self { text: text.into(), words })
        } else {
            Err(no_source())
        }
    }

    /// The command as it was given.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The words that name existing files, such as a script or its weights.
    pub(super) fn files(&self) -> impl Iterator<Item = &Path> {
        self.words.iter().map(Path::new).filter(|path| path.is_file())
    }

    /// Calls the command for a view, and returns the file that it has written into `folder`.
    ///
    /// # Errors
    /// [`PriorError`] if it cannot be started, fails, takes longer than `limit` or writes nothing; none of a map if `progress` asks
    /// to stop. It does not run on in any case.
    pub(super) fn call(
        &self,
        view: &PerspectiveView,
        folder: &Path,
        limit: Duration,
        progress: &dyn Progress,
    ) -> Result<Option<PathBuf>, PriorError> {
        let failed = |cause: std::io::Error| PriorError::Write(WriteError::new(folder, cause));
        let image = local_image(view, folder)?;
        let name = Path::new(&view.name).file_name().unwrap_or(OsStr::new("map"));
        let stem = std::path::absolute(folder).map_err(failed)?.join(name);
        let out = with_end(&stem, self.end());
        let mut said = tempfile::tempfile().map_err(failed)?;
        let words: Vec<OsString> = self.words.iter().map(|word| filled(word, &image, &stem)).collect();
        let mut command = Command::new(&words[0]);
        command.args(&words[1..]).stdin(Stdio::null()).stdout(Stdio::null());
        command.stderr(said.try_clone().map_err(failed)?);
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let child = command.spawn().map_err(|cause| PriorError::CommandStart {
            command: self.text.clone(),
            program: self.words[0].clone(),
            cause,
        })?;
        let end = wait(child, limit, progress).map_err(failed)?;
        let said = last_lines(&mut said);
        let (command, image) = (self.text.clone(), view.image.clone());
        match end {
            End::Stopped => Ok(None),
            End::TimeOver => {
                Err(PriorError::CommandTime { command, image, limit_s: limit.as_secs_f64(), said })
            }
            End::Exited(status) if !status.success() => {
                Err(PriorError::CommandFailed { command, image, status, said })
            }
            End::Exited(_) if !out.is_file() => Err(PriorError::CommandSilent { command, image, said }),
            End::Exited(_) => Ok(Some(out)),
        }
    }

    /// The end of the name of the file that the command writes.
    fn end(&self) -> &'static str {
        let is_named = |end: &&str| self.words.iter().any(|word| word.contains(&format!("{OUT}.{end}")));
        ENDS.into_iter().rev().find(is_named).unwrap_or(ENDS[0])
    }
}

/// A path of the image that a program can open: its own, else that of a copy in `folder`.
fn local_image(view: &PerspectiveView, folder: &Path) -> Result<PathBuf, PriorError> {
    if view.image.is_file() {
        let absolute = std::path::absolute(&view.image);
        return Ok(absolute.unwrap_or_else(|_| view.image.clone()));
    }
    let copy = folder.join(view.image.file_name().unwrap_or(OsStr::new("image")));
    let bytes = vsi::read(&view.image).map_err(|e| crate::io::ReadError::new(&view.image, e))?;
    crate::io::write_file(&copy, bytes)?;
    Ok(std::path::absolute(&copy).unwrap_or(copy))
}

/// A path with an ending added; points in its name belong to it.
fn with_end(stem: &Path, end: &str) -> PathBuf {
    let mut path = stem.as_os_str().to_owned();
    path.push(".");
    path.push(end);
    path.into()
}

/// A word with the paths that it names.
fn filled(word: &str, image: &Path, stem: &Path) -> OsString {
    let mut out = OsString::new();
    let mut rest = word;
    while let Some((at, mark)) = [IMAGE, OUT].into_iter().filter_map(|m| Some((rest.find(m)?, m))).min() {
        out.push(&rest[..at]);
        rest = &rest[at + mark.len()..];
        if mark == IMAGE {
            out.push(image);
        } else if ENDS.iter().any(|end| rest.starts_with(&format!(".{end}"))) {
            out.push(stem);
        } else {
            out.push(with_end(stem, ENDS[0]));
        }
    }
    out.push(rest);
    out
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_is_split_into_words_and_gets_paths() {
        let command = PriorCommand::parse(r#"python3 "my depth.py" --in={image} {out}"#).unwrap();
        let (image, stem) = (Path::new("/a b/c.jpg"), Path::new("/maps/c.1"));
        let words: Vec<OsString> = command.words.iter().map(|word| filled(word, image, stem)).collect();
        assert_eq!(words, ["python3", "my depth.py", "--in=/a b/c.jpg", "/maps/c.1.npy"]);
        assert_eq!(command.end(), "npy");
        let command = PriorCommand::parse("f {image} --png {out}.png").unwrap();
        assert_eq!((filled("{out}.png", image, stem), command.end()), ("/maps/c.1.png".into(), "png"));
        assert_eq!(PriorCommand::parse("f {image} {out}.tiff").unwrap().end(), "tiff");
        assert!(matches!(PriorCommand::parse("f {image}"), Err(PriorError::NoSource { .. })));
        assert!(matches!(PriorCommand::parse("f {image} # {out}"), Err(PriorError::NoSource { .. })));
        assert!(matches!(PriorCommand::parse("f '{image} {out}"), Err(PriorError::Words { .. })));
    }
}
