//! Stages of a run: each remembers what it was made from, so that it is skipped, resumed or refused.

use super::Failure;
use crate::raster::{RasterError, write_file};
use crate::run_files::STAGE;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What a stage was made from: option or input → its value or hash.
pub type Fingerprint = BTreeMap<String, String>;

/// What `stage.json` holds.
#[derive(Default, Serialize, Deserialize)]
struct Record {
    /// Version that made the stage.
    satgs: String,
    /// Command line that made it.
    command: String,
    made_from: Fingerprint,
}

/// A stage of a run folder: `RUN/NAME/stage.json` records a completed one.
pub struct Stage {
    record: PathBuf,
    name: &'static str,
    fingerprint: Fingerprint,
    outputs: Vec<PathBuf>,
}

impl Stage {
    /// A stage of `run` called `name` that makes `outputs` from `fingerprint`.
    pub fn new(run: &Path, name: &'static str, outputs: Vec<PathBuf>, fingerprint: Fingerprint) -> Self {
        Self { record: run.join(name).join(STAGE), name, fingerprint, outputs }
    }

    /// Whether the stage is complete, made from the same things, and what it made is still there.
    ///
    /// Made from other things it is an error that names them. With `overwrite` no stage is complete.
    pub fn is_done(&self, overwrite: bool) -> Result<bool, Failure> {
        let Ok(text) = std::fs::read_to_string(&self.record) else { return Ok(false) };
        if overwrite {
            self.forget()?;
            return Ok(false);
        }
        let before: Record = serde_json::from_str(&text).unwrap_or_default();
        Ok(self.is_made_from(&before.made_from, false)? && self.outputs.iter().all(|o| o.exists()))
    }

    /// Whether something was made from what this stage is to be made from.
    ///
    /// Made from other things it is an error that names them, unless `overwrite`.
    pub fn is_made_from(&self, before: &Fingerprint, overwrite: bool) -> Result<bool, Failure> {
        if *before == self.fingerprint || overwrite {
            return Ok(*before == self.fingerprint);
        }
        let keys: std::collections::BTreeSet<&String> =
            before.keys().chain(self.fingerprint.keys()).collect();
        let differ: Vec<String> = keys
            .into_iter()
            .filter(|k| before.get(*k) != self.fingerprint.get(*k))
            .map(|k| {
                let show = |f: &Fingerprint| {
                    f.get(k).map_or("none".into(), |v| v.chars().take(16).collect::<String>())
                };
                format!("{k} was {}, is {}", show(before), show(&self.fingerprint))
            })
            .collect();
        let folder = self.record.parent().unwrap_or(&self.record);
        Err(Failure::input(
            format!("`{}` holds a {} of other input: {}", folder.display(), self.name, differ.join("; ")),
            "--overwrite makes it anew, another -o keeps both",
        ))
    }

    /// What the stage is made from.
    pub fn fingerprint(&self) -> &Fingerprint {
        &self.fingerprint
    }

    /// Records that the stage is complete.
    pub fn complete(&self) -> Result<(), Failure> {
        let words = std::env::args_os().map(|word| word.to_string_lossy().into_owned());
        let record = Record {
            satgs: env!("CARGO_PKG_VERSION").into(),
            command: words.collect::<Vec<_>>().join(" "),
            made_from: self.fingerprint.clone(),
        };
        let text = serde_json::to_string_pretty(&record).unwrap_or_default();
        Ok(write_file(&self.record, text)?)
    }

    /// Forgets that the stage is complete, if it is.
    pub fn forget(&self) -> Result<(), Failure> {
        match std::fs::remove_file(&self.record) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
                Err(RasterError::Write { path: self.record.clone(), reason: e.to_string() }.into())
            }
            _ => Ok(()),
        }
    }
}

/// Short hash of bytes.
pub fn hash(bytes: &[u8]) -> String {
    short(blake3::hash(bytes))
}

/// Hash of a file's content.
pub fn hash_file(path: &Path) -> String {
    let mut hasher = blake3::Hasher::new();
    let read = std::fs::File::open(path).and_then(|mut file| std::io::copy(&mut file, &mut hasher));
    read.map_or_else(|_| "absent".into(), |_| short(hasher.finalize()))
}

fn short(hash: blake3::Hash) -> String {
    hash.to_hex()[..32].to_string()
}
