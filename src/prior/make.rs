//! Folders of maps that a network, a command or matching makes, one for each image, as [`PriorFolder`] reads them.

use super::command::PriorCommand;
use super::error::PriorError;
use super::folder::{DESCRIPTION, ENDS, PriorDescription, PriorFolder};
use super::map::{DepthKind, PriorContent};
use super::network::PriorNetwork;
use super::process::LIMIT;
use super::source::PriorMaker;
use super::stereo::stereo_maps;
use crate::checkpoint::PartStore;
use crate::io::{Grid2, NpyArray, ReadError, WriteError, read_json, remove_if_there, vsi, write_json};
use crate::perspective::PerspectiveView;
use crate::progress::{Event, Progress};
use crate::run_files::MATCHING;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The file that records from what maps were made.
const RECORD: &str = "made_from.json";
/// What is wrong with views of which matching finds nothing.
const NO_DEPTHS: &str = "has no depth that other views confirm";

/// What happens to maps that are in a folder already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExistingMaps {
    /// Those of the same maker and image are kept, others are an error.
    Keep,
    /// Those of the same maker and image are kept, others are made again.
    Update,
    /// All are made again.
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
    /// What made them, for a reader.
    made_by: String,
    /// The hash of maker and image, by the name of the map.
    maps: BTreeMap<String, String>,
    /// The same of views of which matching found nothing.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    empty: BTreeMap<String, String>,
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
    /// The maps of the views that have none yet, in their order.
    Maps(std::vec::IntoIter<Grid2>),
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
        if *self.maker == PriorMaker::Stereo && self.content == PriorContent::Normals {
            return Err(PriorError::NoNormals);
        }
        let path = self.folder.join(RECORD);
        // Without a record, or with a damaged one, no map is known.
        let mut record: Record = read_json(&path).unwrap_or_default();
        let hashes = self.hashes(views)?;
        let parts = PartStore::new(self.folder.join(MATCHING), hashes.concat());
        let is_kept = |(view, hash): &(&PerspectiveView, String)| {
            let is_there = record.maps.get(&view.name) == Some(hash) && self.file(view).is_some();
            existing != ExistingMaps::Replace && is_there
        };
        let is_empty = |(view, hash): &(&PerspectiveView, String)| {
            existing != ExistingMaps::Replace && record.empty.get(&view.name) == Some(hash)
        };
        let all = views.iter().copied().zip(hashes);
        let (kept, others): (Vec<_>, Vec<_>) = all.partition(is_kept);
        let (empty, missing): (Vec<_>, Vec<_>) = others.into_iter().partition(is_empty);
        let replaced = missing.iter().find_map(|(view, _)| self.file(view));
        if let Some(path) = replaced.filter(|_| existing == ExistingMaps::Keep) {
            return Err(PriorError::OtherMap { path, maker: self.maker.to_string() });
        }
        let mut done = MadeMaps { kept: kept.len(), left_out: empty.len(), made: 0 };
        let of_stereo = PriorDescription { kind: Some(DepthKind::Measured), scale: None };
        let is_stereo = *self.maker == PriorMaker::Stereo;
        write_json(&self.folder.join(DESCRIPTION), if is_stereo { &of_stereo } else { description })?;
        if missing.is_empty() {
            let none = empty.first().filter(|_| kept.is_empty());
            return none.map_or(Ok(done), |(view, _)| Err(self.unusable(view, NO_DEPTHS.into())));
        }
        record.made_by = self.maker.to_string();
        let stage = match self.content {
            PriorContent::Depths => "making depth maps",
            PriorContent::Normals => "making normal maps",
        };
        // What is made is kept, so that the same call continues.
        progress.event(Event::Resumable(true));
        progress.event(Event::Started { stage, total: missing.len() as u64 });
        let result = self.make_missing(views, &missing, &parts, &mut record, &mut done, progress);
        progress.event(Event::Finished);
        progress.event(Event::Resumable(false));
        if result.is_ok() {
            parts.remove();
        }
        result.map(|()| done)
    }

    /// Makes those of the maps of the views that are missing, one after the other: both networks and commands use all threads.
    fn make_missing(
        &self,
        views: &[&PerspectiveView],
        missing: &[(&PerspectiveView, String)],
        parts: &PartStore,
        record: &mut Record,
        done: &mut MadeMaps,
        progress: &dyn Progress,
    ) -> Result<(), PriorError> {
        let mut maker = match self.maker {
            PriorMaker::Network(path) => Loaded::Network(Box::new(PriorNetwork::load(path, self.content)?)),
            PriorMaker::Command(command) => Loaded::Command(command),
            PriorMaker::Stereo => {
                let maps = stereo_maps(views, parts, progress)?.into_iter().zip(views);
                let is_missing = |name: &str| missing.iter().any(|(view, _)| view.name == name);
                let maps: Vec<Grid2> =
                    maps.filter(|(_, view)| is_missing(&view.name)).map(|(map, _)| map).collect();
                Loaded::Maps(maps.into_iter())
            }
        };
        let mut fault = None;
        for (k, (view, hash)) in missing.iter().enumerate() {
            let interrupted = PriorError::Interrupted { made: k, total: missing.len() };
            if progress.is_cancelled() {
                return Err(interrupted);
            }
            let staging = self.staging()?;
            let file = match &mut maker {
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
                Loaded::Maps(maps) => {
                    let file = staging.path().join("map.npy");
                    let map = maps.next().unwrap_or_else(|| Grid2::filled(1, 1, f32::NAN));
                    NpyArray::from(map).write(&file)?;
                    file
                }
            };
            match self.accept(&file, view) {
                Ok(()) => {
                    done.made += 1;
                    record.empty.remove(&view.name);
                    record.maps.insert(view.name.clone(), hash.clone());
                    write_json(&self.folder.join(RECORD), record)?;
                }
                Err(PriorError::Empty { fault: empty, .. }) => {
                    done.left_out += 1;
                    // A map of another maker must not stand for this one's.
                    self.remove(view)?;
                    record.maps.remove(&view.name);
                    let is_stereo = *self.maker == PriorMaker::Stereo;
                    let unusable = self.unusable(view, if is_stereo { NO_DEPTHS } else { empty }.into());
                    if is_stereo {
                        record.empty.insert(view.name.clone(), hash.clone());
                    } else {
                        progress.event(Event::Warning(format!("{unusable}: the view has none")));
                    }
                    write_json(&self.folder.join(RECORD), record)?;
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
        self.remove(view)?;
        let place = self.place(view, &end);
        let moved = place.parent().map_or(Ok(()), std::fs::create_dir_all);
        moved.and_then(|()| std::fs::rename(file, &place)).map_err(|e| WriteError::new(&place, e))?;
        Ok(())
    }

    /// Removes the map of a view, if there is one.
    fn remove(&self, view: &PerspectiveView) -> Result<(), PriorError> {
        Ok(ENDS.iter().try_for_each(|end| remove_if_there(&self.place(view, end)))?)
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
        let mut maker = self.maker.hash(self.content)?;
        let of = |view: &&PerspectiveView| -> Result<blake3::Hash, PriorError> {
            let content = vsi::content_hash(&view.image).map_err(|e| ReadError::new(&view.image, e))?;
            // A map of the image as displayed is another one than that of the image as stored.
            Ok(view.turned.map_or(content, |turned| {
                blake3::Hasher::new()
                    .update(content.as_bytes())
                    .update(format!("{turned:?}").as_bytes())
                    .finalize()
            }))
        };
        let images: Vec<Result<blake3::Hash, PriorError>> = views.par_iter().map(of).collect();
        let images: Vec<blake3::Hash> = images.into_iter().collect::<Result<_, _>>()?;
        if *self.maker == PriorMaker::Stereo {
            // What one view shows is found by the others.
            let mut hasher = blake3::Hasher::new();
            hasher.update(maker.as_bytes());
            for (view, image) in views.iter().zip(&images) {
                hasher.update(image.as_bytes());
                let lens = (&view.camera, &view.lens_camera, &view.transparency);
                hasher.update(format!("{lens:?}").as_bytes());
                for mask in &view.masks {
                    let content = vsi::content_hash(&mask.path).map_err(|e| ReadError::new(&mask.path, e))?;
                    hasher.update(content.as_bytes());
                    hasher.update(&[u8::from(mask.marks_used)]);
                }
            }
            maker = hasher.finalize();
        }
        let both = |image: &blake3::Hash| [maker.as_bytes().as_slice(), image.as_bytes()].concat();
        Ok(images.iter().map(|image| blake3::hash(&both(image)).to_hex()[..32].to_string()).collect())
    }

    fn unusable(&self, view: &PerspectiveView, fault: String) -> PriorError {
        PriorError::Unusable { maker: self.maker.to_string(), image: view.image.clone(), fault }
    }
}
