//! Colours for the holes of pseudo-views by a command that a user names, such as one that calls an inpainting network.

use super::error::PriorError;
use super::process::{Call, LIMIT};
use super::pseudo_views::PseudoView;
use crate::io::{ImageFile, NpyArray, ReadError, WriteError, vsi, write_file, write_png_gray, write_png_rgb};
use crate::progress::{Event, Progress};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// What stands in a command for the picture with holes, the mask of its holes, its depths and the file to write.
const MARKS: [&str; 4] = ["{rgb}", "{mask}", "{depth}", "{out}"];
/// Those that a command must name.
const NEEDED: [&str; 3] = ["{rgb}", "{mask}", "{out}"];
/// Part of every hash: to be counted up when the same command gets other input.
const FORM: &str = "satgs inpaint 1";

/// A command that fills the holes of pictures.
///
/// The text is split into words as a shell does, and nothing else of a shell. `{rgb}` is a picture (PNG, black in holes),
/// `{mask}` its holes (PNG, 255 in holes), `{depth}` its depths with the holes filled (NumPy, float32), `{out}` the filled picture
/// to write (PNG).
#[derive(Clone, Debug, PartialEq)]
pub struct InpaintCommand {
    text: String,
    words: Vec<String>,
}

impl InpaintCommand {
    /// Reads a command.
    ///
    /// # Errors
    /// [`PriorError::NoInpainter`] if it does not name `{rgb}`, `{mask}` and `{out}`, [`PriorError::Words`] if a quotation mark is
    /// open.
    pub fn parse(text: &str) -> Result<Self, PriorError> {
        let words = shlex::split(text).ok_or_else(|| PriorError::Words { text: text.into() })?;
        let is_named = |mark: &&str| words.iter().any(|word| word.contains(*mark));
        if NEEDED.iter().all(is_named) {
            Ok(Self { text: text.into(), words })
        } else {
            Err(PriorError::NoInpainter { text: text.into() })
        }
    }

    /// The command as it was given.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Gives the holes of the pseudo-views that are used colours. Pictures are kept in `folder`: the same picture is filled once.
    ///
    /// # Errors
    /// [`PriorError`] if the command fails, takes too long, or writes no picture of the same size.
    pub(super) fn fill(
        &self,
        views: &mut [PseudoView],
        folder: &Path,
        progress: &dyn Progress,
    ) -> Result<(), PriorError> {
        self.fill_within(views, folder, LIMIT, progress)
    }

    /// As [`InpaintCommand::fill`], with a time limit for each picture.
    pub(super) fn fill_within(
        &self,
        views: &mut [PseudoView],
        folder: &Path,
        limit: Duration,
        progress: &dyn Progress,
    ) -> Result<(), PriorError> {
        let used: Vec<&mut PseudoView> = views.iter_mut().filter(|view| view.is_used).collect();
        let total = used.len();
        std::fs::create_dir_all(folder).map_err(|e| WriteError::new(folder, e))?;
        progress.event(Event::Started { stage: "filling holes", total: total as u64 });
        for (k, view) in used.into_iter().enumerate() {
            let interrupted = PriorError::Interrupted { made: k, total };
            if progress.is_cancelled() || !self.fill_view(view, folder, limit, progress)? {
                return Err(interrupted);
            }
            progress.event(Event::Advanced { done: k as u64 + 1, status: String::new() });
        }
        progress.event(Event::Finished);
        Ok(())
    }

    /// Fills one picture; false if `progress` asks to stop.
    fn fill_view(
        &self,
        view: &mut PseudoView,
        folder: &Path,
        limit: Duration,
        progress: &dyn Progress,
    ) -> Result<bool, PriorError> {
        let (width, height) = (view.depth.width, view.depth.height);
        let kept = folder.join(format!("{}.png", self.hash(view)));
        if !kept.exists() {
            let made = tempfile::Builder::new().prefix(".satgs-").tempdir_in(folder);
            let made = made.map_err(|e| WriteError::new(folder, e))?;
            let path = std::path::absolute(made.path()).map_err(|e| WriteError::new(folder, e))?;
            let files = ["rgb.png", "mask.png", "depth.npy", "out.png"].map(|name| path.join(name));
            let [rgb, mask, depth, out] = &files;
            write_png_rgb(rgb, width, height, view.colors.as_flattened())?;
            let holes: Vec<u8> = view.hole.iter().map(|hole| if *hole { 255 } else { 0 }).collect();
            write_png_gray(mask, width, height, &holes)?;
            NpyArray::from(view.depth.clone()).write(depth)?;
            let words: Vec<OsString> = self.words.iter().map(|word| filled(word, &files)).collect();
            let call = Call { text: &self.text, words: &words, image: rgb, limit };
            let Some(said) = call.run(folder, progress)? else { return Ok(false) };
            if !out.is_file() {
                let (command, image) = (self.text.clone(), rgb.clone());
                return Err(PriorError::CommandSilent { command, image, said });
            }
            self.read(out, (width, height))?;
            write_file(&kept, vsi::read(out).map_err(|e| ReadError::new(out, e))?)?;
        }
        let colors = self.read(&kept, (width, height))?;
        for ((color, filled), is_hole) in view.colors.iter_mut().zip(colors).zip(&view.hole) {
            if *is_hole {
                *color = filled;
            }
        }
        Ok(true)
    }

    /// The colours of a picture that the command has written.
    fn read(&self, path: &Path, (width, height): (usize, usize)) -> Result<Vec<[u8; 3]>, PriorError> {
        let unusable = |fault: String| PriorError::Inpainted { command: self.text.clone(), fault };
        let file = ImageFile::open(path).map_err(|e| unusable(format!("cannot be read: {e}")))?;
        let (found, bands) = (file.size(), file.bands());
        if found != (width, height) || bands < 3 {
            return Err(unusable(format!(
                "has {} x {} pixels of {bands} bands, expected {width} x {height} of three",
                found.0, found.1
            )));
        }
        let band = |k: usize| file.read(k).map_err(|e| unusable(format!("cannot be read: {e}")));
        let bands = [band(1)?, band(2)?, band(3)?];
        Ok((0..width * height).map(|i| bands.each_ref().map(|b| b.data[i].clamp(0.0, 255.0) as u8)).collect())
    }

    /// A hash of all that the command gets.
    fn hash(&self, view: &PseudoView) -> String {
        let mut hasher = blake3::Hasher::new();
        hasher.update(format!("{FORM} {}\0", self.text).as_bytes());
        hasher.update(view.colors.as_flattened());
        view.depth.data.iter().for_each(|v| {
            hasher.update(&v.to_le_bytes());
        });
        hasher.finalize().to_hex()[..32].to_string()
    }
}

/// A word with the paths that it names.
fn filled(word: &str, files: &[PathBuf; 4]) -> OsString {
    let mut out = OsString::new();
    let mut rest = word;
    while let Some((at, k)) = (0..4).filter_map(|k| Some((rest.find(MARKS[k])?, k))).min() {
        out.push(&rest[..at]);
        out.push(&files[k]);
        rest = &rest[at + MARKS[k].len()..];
    }
    out.push(rest);
    out
}

#[cfg(test)]
mod tests;
