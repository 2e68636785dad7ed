//! Folders of maps that a network or a command makes, one for each image, as [`PriorFolder`] reads them.

use super::command::PriorCommand;
use super::error::PriorError;
use super::folder::{DESCRIPTION, ENDS, PriorDescription, PriorFolder};
use super::map::PriorContent;
use super::network::PriorNetwork;
use super::process::LIMIT;
use super::source::PriorMaker;
use crate::io::{ReadError, WriteError, read_json, remove_if_there, vsi, write_json};
use crate::perspective::PerspectiveView;
use crate::progress::{Event, Progress};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The file that records from what maps were made.
const RECORD: &str = "made_from.json";

/// What happens to maps that are in a folder already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExistingMaps {
    /// Those of the same maker and image are kept, others are an error.
    Keep,
    /// Those of the same maker and image are kept, others are made anew.
    Update,
    /// All are made anew.
    Replace,
}

/// What [`make_maps`] did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct MadeMaps {
    /// Number of maps that were made.
    pub made: usize,
    /// Number of maps that were there.
    pub kept: usize,
    /// Number of images of which the map has no values to compare with, such as those of one colour: they have none.
    pub left_out: usize,
}

/// From what the maps of a folder were made.
#[derive(Default, Serialize, Deserialize)]
struct Record {
    /// The network or the command, for a reader.
    made_by: String,
    /// The hash of maker and image, by the name of the map.
    maps: BTreeMap<String, String>,
}

/// Makes the maps of views in a folder, and writes `description` there as `prior.json`.
///
/// # Errors
/// [`PriorError`]: a file cannot be read or written, the network or the command fails or gives something else than a map of its
/// image, a map exists that is not to be replaced, or `progress` asks to stop. The maps that are made already stay, and are kept
/// the next time.
pub fn make_maps(
    maker: &PriorMaker,
    content: PriorContent,
    views: &[&PerspectiveView],
    folder: &Path,
    description: &PriorDescription,
    existing: ExistingMaps,
    progress: &dyn Progress,
) -> Result<MadeMaps, PriorError> {
    let work = Work { maker, content, folder, limit: LIMIT };
    work.make(views, description, existing, progress)
}

/// A maker that is ready.
enum Loaded<'a> {
    Network(Box<PriorNetwork>),
    Command(&'a PriorCommand),
}

/// The folder that maps are made in, and what makes them.
pub(super) struct Work<'a> {
    pub maker: &'a PriorMaker,
    pub content: PriorContent,
    pub folder: &'a Path,
    /// Longest time that a command may take for an image.
    pub limit: Duration,
}

impl Work<'_> {
    /// See [`make_maps`].
    pub fn make(
        &self,
        views: &[&PerspectiveView],
        description: &PriorDescription,
        existing: ExistingMaps,
        progress: &dyn Progress,
    ) -> Result<MadeMaps, PriorError> {
        let path = self.folder.join(RECORD);
        // Without a record, or with a damaged one, no map is known.
        let mut record: Record = read_json(&path).unwrap_or_default();
        let hashes = self.hashes(views)?;
        let is_kept = |view: &PerspectiveView, hash: &String| {
            existing != ExistingMaps::Replace
                && record.maps.get(&view.name) == Some(hash)
                && self.file(view).is_some()
        };
        let all = views.iter().copied().zip(hashes);
        let (kept, missing): (Vec<_>, Vec<_>) = all.partition(|(view, hash)| is_kept(view, hash));
        let replaced = missing.iter().find_map(|(view, _)| self.file(view));
        if let Some(path) = replaced.filter(|_| existing == ExistingMaps::Keep) {
            return Err(PriorError::OtherMap { path, maker: self.maker.to_string() });
        }
        let mut done = MadeMaps { kept: kept.len(), ..MadeMaps::default() };
        write_json(&self.folder.join(DESCRIPTION), description)?;
        if missing.is_empty() {
            return Ok(done);
        }
        record.made_by = self.maker.to_string();
        let stage = match self.content {
            PriorContent::Depths => "making depth maps",
            PriorContent::Normals => "making normal maps",
        };
        // What is made is kept, so that the same call goes on.
        progress.event(Event::Resumable(true));
        progress.event(Event::Started { stage, total: missing.len() as u64 });
        let result = self.make_missing(&missing, &mut record, &mut done, progress);
        progress.event(Event::Finished);
        progress.event(Event::Resumable(false));
        result.map(|()| done)
    }

    /// Makes these maps one after the other: both networks and commands use all threads.
    fn make_missing(
        &self,
        missing: &[(&PerspectiveView, String)],
        record: &mut Record,
        done: &mut MadeMaps,
        progress: &dyn Progress,
    ) -> Result<(), PriorError> {
        let maker = match self.maker {
            PriorMaker::Network(path) => Loaded::Network(Box::new(PriorNetwork::load(path, self.content)?)),
            PriorMaker::Command(command) => Loaded::Command(command),
        };
        let mut fault = None;
        for (k, (view, hash)) in missing.iter().enumerate() {
            let interrupted = PriorError::Interrupted { made: k, total: missing.len() };
            if progress.is_cancelled() {
                return Err(interrupted);
            }
            let staging = self.staging()?;
            let file = match &maker {
                Loaded::Network(network) => {
                    let file = staging.path().join("map.npy");
                    network.map(view.read_file()?)?.write(&file)?;
                    file
                }
                Loaded::Command(command) => {
                    match command.call(view, staging.path(), self.limit, progress)? {
                        Some(file) => file,
                        None => return Err(interrupted),
                    }
                }
            };
            match self.accept(&file, view) {
                Ok(()) => {
                    done.made += 1;
                    record.maps.insert(view.name.clone(), hash.clone());
                    write_json(&self.folder.join(RECORD), record)?;
                }
                Err(PriorError::Empty { fault: empty, .. }) => {
                    done.left_out += 1;
                    let unusable = self.unusable(view, empty.into());
                    progress.event(Event::Warning(format!("{unusable}: the view has none")));
                    fault = Some(unusable);
                }
                Err(PriorError::Shape { found, expected, .. }) => {
                    return Err(self.unusable(view, format!("is {found}, expected {expected}")));
                }
                Err(PriorError::Read(ReadError { cause, .. })) => {
                    return Err(self.unusable(view, format!("cannot be read: {cause}")));
                }
                Err(PriorError::Raster(error)) => {
                    return Err(self.unusable(view, format!("cannot be read: {error}")));
                }
                Err(error) => return Err(error),
            }
            progress.event(Event::Advanced { done: k as u64 + 1, status: view.name.clone() });
        }
        fault.filter(|_| done.made + done.kept == 0).map_or(Ok(()), Err)
    }

    /// A folder for a map that is not complete yet, on the same file system.
    fn staging(&self) -> Result<tempfile::TempDir, PriorError> {
        let made = tempfile::Builder::new().prefix(".satgs-").tempdir_in(self.folder);
        Ok(made.map_err(|e| WriteError::new(self.folder, e))?)
    }

    /// Moves a map of a view to its place, if it can be used.
    fn accept(&self, file: &Path, view: &PerspectiveView) -> Result<(), PriorError> {
        PriorFolder::open(self.folder)?.check(file, view, self.content)?;
        let end = file.extension().unwrap_or_default().to_string_lossy();
        for other in ENDS {
            remove_if_there(&self.place(view, other))?;
        }
        let place = self.place(view, &end);
        let moved = place.parent().map_or(Ok(()), std::fs::create_dir_all);
        moved.and_then(|()| std::fs::rename(file, &place)).map_err(|e| WriteError::new(&place, e))?;
        Ok(())
    }

    fn place(&self, view: &PerspectiveView, end: &str) -> PathBuf {
        self.folder.join(format!("{}.{end}", view.name))
    }

    /// The map of a view, if there is one.
    fn file(&self, view: &PerspectiveView) -> Option<PathBuf> {
        ENDS.iter().map(|end| self.place(view, end)).find(|path| path.exists())
    }

    /// For each view the hash of what its map is made from.
    fn hashes(&self, views: &[&PerspectiveView]) -> Result<Vec<String>, PriorError> {
        let maker = self.maker.hash(self.content)?;
        let of = |view: &&PerspectiveView| {
            let image = vsi::content_hash(&view.image).map_err(|e| ReadError::new(&view.image, e))?;
            let both = [maker.as_bytes().as_slice(), image.as_bytes()].concat();
            Ok(blake3::hash(&both).to_hex()[..32].to_string())
        };
        let hashes: Vec<Result<String, PriorError>> = views.par_iter().map(of).collect();
        hashes.into_iter().collect()
    }

    fn unusable(&self, view: &PerspectiveView, fault: String) -> PriorError {
        PriorError::Unusable { maker: self.maker.to_string(), image: view.image.clone(), fault }
    }
}
