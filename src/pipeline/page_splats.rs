//! The splats of the page of `satgs view`, as files from coarse to fine.

use super::PipelineError;
use crate::io::{WriteError, read_json, write_file, write_json};
use crate::run_files::{CAMERAS, SPLATS, VIEW};
use crate::splat::ply::PlyTable;
use crate::splat::splats::Splats;
use crate::viewer::{PageContent, PageFile, PageScope, coarse_to_fine, parts};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// With more splats than so many, the parts are kept in the run's folder, so that the next page does not wait for them.
const MOST_UNKEPT: usize = 500_000;
/// What says of which splats the kept parts are, in their folder; it is written last.
const KEPT: &str = "parts.json";

/// Splats as the files of a page.
#[derive(Debug)]
pub struct PageSplats {
    /// The parts, from coarse to fine: PLY files of 3DGS.
    pub files: Vec<PageFile>,
    /// Number of splats.
    pub count: usize,
    /// What the page looks at.
    pub scope: PageScope,
}

/// What kept parts were made of.
#[derive(PartialEq, Serialize, Deserialize)]
struct Kept {
    made_from: String,
    scope: PageScope,
}

impl PageSplats {
    /// The parts of splats; `encode` makes a PLY file, and names begin with `prefix`.
    pub fn new(splats: &Splats, scope: PageScope, prefix: &str, encode: impl Fn(&Splats) -> Vec<u8>) -> Self {
        let order = coarse_to_fine(splats);
        let mut part = Splats::default();
        let files = parts(order.len()).into_iter().enumerate().map(|(k, range)| {
            part.take_from(splats, &order[range]);
            PageFile { name: name(prefix, k).into(), content: PageContent::Bytes(encode(&part)) }
        });
        Self { files: files.collect(), count: splats.len(), scope }
    }

    /// The parts of the splats of a run: those that are kept in its folder, or of the splats that `read` reads with their scope,
    /// which are kept if there are many of them.
    ///
    /// # Errors
    /// Those of `read`; [`PlyError`](crate::splat::ply::PlyError) if the splats have no header.
    pub fn of_run(
        run: &Path,
        read: impl FnOnce() -> Result<(Splats, PageScope), PipelineError>,
        encode: impl Fn(&Splats) -> Vec<u8>,
    ) -> Result<Self, PipelineError> {
        let count = PlyTable::of(&run.join(SPLATS))?.rows;
        let (folder, made_from) = (run.join(VIEW), made_from(run));
        let is_kept = count > MOST_UNKEPT;
        let kept = |scope| {
            let file = |k| {
                let name = name("", k);
                PageFile { content: PageContent::File(folder.join(&name)), name: name.into() }
            };
            Self { files: (0..parts(count).len()).map(file).collect(), count, scope }
        };
        if is_kept
            && let Ok(found) = read_json::<Kept>(&folder.join(KEPT))
            && found.made_from == made_from
        {
            return Ok(kept(found.scope));
        }
        let (splats, scope) = read()?;
        let made = Self::new(&splats, scope, "", encode);
        // A run that cannot be written to is shown all the same.
        let is_written = is_kept && made.keep(&folder, Kept { made_from, scope }).is_ok();
        Ok(if is_written { kept(scope) } else { made })
    }

    fn keep(&self, folder: &Path, kept: Kept) -> Result<(), WriteError> {
        let _ = std::fs::remove_dir_all(folder);
        for file in &self.files {
            if let PageContent::Bytes(bytes) = &file.content {
                write_file(&folder.join(&*file.name), bytes)?;
            }
        }
        write_json(&folder.join(KEPT), &kept)
    }
}

/// The name of a part.
fn name(prefix: &str, k: usize) -> String {
    format!("{prefix}splats-{k}.ply")
}

/// What tells that splats or their colours have changed, without reading them: sizes and times of the files.
fn made_from(run: &Path) -> String {
    let stamp = |name: &str| {
        let path: PathBuf = run.join(name);
        let about = path.metadata().ok();
        let time = about.as_ref().and_then(|m| m.modified().ok());
        format!("{name} {:?} {time:?}", about.map(|m| m.len()))
    };
    format!("{} {} of {}", stamp(SPLATS), stamp(CAMERAS), env!("CARGO_PKG_VERSION"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splat::ply;

    fn splats(count: usize) -> Splats {
        let mut splats = Splats::default();
        (0..count).for_each(|i| splats.push([i as f32, 0.0, 0.0], 0.1 + (i % 7) as f32, 0.5, [0.5; 3]));
        splats
    }

    #[test]
    fn parts_of_large_runs_are_kept_until_the_splats_change() {
        let run = tempfile::tempdir().unwrap();
        let scope = PageScope::of_area((0.0, 0.0, 10.0, 10.0));
        let write = |count| ply::write_local(&run.path().join(SPLATS), &splats(count)).unwrap();
        let encode = |part: &Splats| part.len().to_string().into_bytes();
        let of_run = |is_read: &mut bool| {
            let read = || {
                *is_read = true;
                Ok((ply::read(&run.path().join(SPLATS))?, scope))
            };
            let parts = PageSplats::of_run(run.path(), read, encode).unwrap();
            let bytes = |file: &PageFile| match &file.content {
                PageContent::Bytes(bytes) => bytes.clone(),
                PageContent::File(path) => std::fs::read(path).unwrap(),
            };
            let counts = parts.files.iter().map(|f| String::from_utf8(bytes(f)).unwrap().parse::<usize>());
            (parts.count, counts.map(Result::unwrap).sum::<usize>(), parts.scope == scope)
        };
        for (count, is_read_again) in [(MOST_UNKEPT + 1, false), (MOST_UNKEPT + 2, false), (1000, true)] {
            write(count);
            let [mut first, mut second] = [false; 2];
            assert_eq!(of_run(&mut first), (count, count, true));
            assert_eq!(of_run(&mut second), (count, count, true));
            assert_eq!((first, second), (true, is_read_again));
        }
    }
}
