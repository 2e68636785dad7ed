//! Maps by a command that a user names, called once for each image. No shell is involved.

use super::error::PriorError;
use super::folder::ENDS;
use super::process::Call;
use crate::io::{Grid2, WriteError, vsi};
use crate::perspective::PerspectiveView;
use crate::progress::Progress;
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// What stands for the image file in a command.
const IMAGE: &str = "{image}";
/// What stands for the file to write.
const OUT: &str = "{out}";

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
        let words: Vec<OsString> = self.words.iter().map(|word| filled(word, &image, &stem)).collect();
        let call = Call { text: &self.text, words: &words, image: &view.image, limit };
        let Some(said) = call.run(folder, progress)? else { return Ok(None) };
        if !out.is_file() {
            let (command, image) = (self.text.clone(), view.image.clone());
            return Err(PriorError::CommandSilent { command, image, said });
        }
        Ok(Some(out))
    }

    /// The end of the name of the file that the command writes.
    fn end(&self) -> &'static str {
        let is_named = |end: &&str| self.words.iter().any(|word| word.contains(&format!("{OUT}.{end}")));
        ENDS.into_iter().rev().find(is_named).unwrap_or(ENDS[0])
    }
}

/// A path of the image that a program can open: its own, else that of a copy in `folder`.
fn local_image(view: &PerspectiveView, folder: &Path) -> Result<PathBuf, PriorError> {
    if view.turned.is_some() {
        // Programs differ in whether they turn a photograph as its EXIF says: they get it as it is displayed.
        let planes = view.read_file()?;
        let Grid2 { width, height, .. } = planes[0];
        let byte = |v: f32| (255.0 * v.clamp(0.0, 1.0)).round() as u8;
        let rgb: Vec<u8> =
            (0..width * height).flat_map(|i| planes.each_ref().map(|p| byte(p.data[i]))).collect();
        let copy = with_end(&folder.join(&view.name), "png");
        crate::io::write_png_rgb(&copy, width, height, &rgb)?;
        return Ok(std::path::absolute(&copy).unwrap_or(copy));
    }
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
