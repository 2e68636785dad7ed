//! Stages of a run: each records what it was made from, so that it is kept, resumed or refused.

use super::super::PipelineError;
use crate::io::{ReadError, check_writable, read_json, remove_if_there, vsi, write_json};
use crate::run_files::{ADJUSTMENT, APPEARANCE_STAGE, PREDICT_STAGE, STAGE, SUMMARY, TILES, TRAIN_STAGE};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Hexadecimal digits of a hash.
const HASH_LENGTH: usize = 32;

/// How a call to a stage ended.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome<T> {
    /// The stage has been made.
    Made(T),
    /// The stage was complete already. Its summary is of the time when it was made; none if its file is missing.
    Kept(Option<T>),
}

impl<T> Outcome<T> {
    /// The summary of the stage, if there is one.
    pub fn summary(&self) -> Option<&T> {
        match self {
            Self::Made(summary) => Some(summary),
            Self::Kept(summary) => summary.as_ref(),
        }
    }
}

/// What a stage was made from: option or input → its value or hash.
pub type Fingerprint = BTreeMap<String, String>;

/// What `stage.json` holds.
#[derive(Serialize, Deserialize)]
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
    pub fn is_done(&self, overwrite: bool) -> Result<bool, PipelineError> {
        if !self.record.exists() {
            return Ok(false);
        }
        if overwrite {
            self.forget()?;
            return Ok(false);
        }
        let before: Record = read_json(&self.record).map_err(|e| self.damaged(e))?;
        Ok(self.is_made_from(&before.made_from, false)? && self.outputs.iter().all(|o| o.exists()))
    }

    /// Whether something was made from what this stage is to be made from.
    ///
    /// Made from other things it is an error that names them, unless `overwrite`.
    pub fn is_made_from(&self, before: &Fingerprint, overwrite: bool) -> Result<bool, PipelineError> {
        if *before == self.fingerprint || overwrite {
            return Ok(*before == self.fingerprint);
        }
        let keys: std::collections::BTreeSet<&String> =
            before.keys().chain(self.fingerprint.keys()).collect();
        let differences =
            keys.into_iter().filter_map(|k| difference(k, before.get(k), self.fingerprint.get(k)));
        let folder = self.record.parent().unwrap_or(&self.record).to_path_buf();
        let differences = differences.collect::<Vec<_>>().join("; ");
        let hint = match self.name {
            TILES | PREDICT_STAGE => "--overwrite makes it again, another -o keeps both".into(),
            ADJUSTMENT => "`satgs run … --overwrite` replaces everything, `satgs ba … --overwrite` this stage; another -o keeps both".into(),
            _ => format!(
                "{}, `satgs run … --overwrite` everything; a copy of RUN keeps both",
                self.made_by()
            ),
        };
        Err(PipelineError::Changed { folder, differences, hint })
    }

    /// An error unless the outputs can be written, for that to be known before long work.
    pub fn require_writable(&self) -> Result<(), PipelineError> {
        self.outputs.iter().chain([&self.record]).try_for_each(|path| Ok(check_writable(path)?))
    }

    /// The summary of the time when the stage was made; none if its file is missing.
    pub fn summary<T: DeserializeOwned>(&self) -> Result<Option<T>, PipelineError> {
        let path = self.record.with_file_name(SUMMARY);
        path.exists().then(|| read_json(&path)).transpose().map_err(|e| self.damaged(e))
    }

    /// The command that makes the stage again.
    fn made_by(&self) -> &'static str {
        match self.name {
            ADJUSTMENT => "`satgs ba SCENE -o RUN --overwrite` makes it again",
            TRAIN_STAGE | APPEARANCE_STAGE => "`satgs train RUN --overwrite` makes it again",
            PREDICT_STAGE => "`satgs predict RUN -o RUN2 --overwrite` makes it again",
            TILES => "`satgs plan SCENE -o RUN --overwrite` makes it again",
            _ => "`satgs dsm RUN --overwrite` makes it again",
        }
    }

    fn damaged(&self, source: ReadError) -> PipelineError {
        PipelineError::RunFile { source, made_by: self.made_by() }
    }

    /// What the stage is made from.
    pub fn fingerprint(&self) -> &Fingerprint {
        &self.fingerprint
    }

    /// Records that the stage is complete, and its summary.
    pub fn complete(&self, summary: &impl Serialize) -> Result<(), PipelineError> {
        let words = std::env::args_os().map(|word| word.to_string_lossy().into_owned());
        self.complete_as(&words.collect::<Vec<_>>().join(" "), summary)
    }

    /// As [`Stage::complete`], made by this command. A record that must not depend on who started the work names a fixed
    /// one.
    pub fn complete_as(&self, command: &str, summary: &impl Serialize) -> Result<(), PipelineError> {
        // Not in the record: later stages hash its bytes, and a summary holds seconds.
        write_json(&self.record.with_file_name(SUMMARY), summary)?;
        let record = Record {
            satgs: env!("CARGO_PKG_VERSION").into(),
            command: command.into(),
            made_from: self.fingerprint.clone(),
        };
        Ok(write_json(&self.record, &record)?)
    }

    /// Forgets that the stage is complete, if it is.
    pub fn forget(&self) -> Result<(), PipelineError> {
        Ok(remove_if_there(&self.record)?)
    }
}

/// How an option or input differs, whole, if it does; of hashes nobody learns more than that they do.
fn difference(key: &str, before: Option<&String>, now: Option<&String>) -> Option<String> {
    let is_hash = |v: &str| v.len() == HASH_LENGTH && v.bytes().all(|b| b.is_ascii_hexdigit());
    let shown = |v: Option<&String>| v.map_or("none".into(), |v| v.clone());
    match (before, now) {
        _ if before == now => None,
        (Some(b), Some(n)) if is_hash(b) || is_hash(n) => Some(format!("{key} has changed")),
        (Some(b), None) if is_hash(b) => Some(format!("{key} is missing now")),
        (None, Some(n)) if is_hash(n) => Some(format!("{key} is new")),
        _ => Some(format!("{key} was {}, is {}", shown(before), shown(now))),
    }
}

/// What a stage was made from, by its record.
pub fn made_from(record: &Path) -> Result<Fingerprint, PipelineError> {
    let made_by = "the command that made the stage makes it again with --overwrite";
    let read: Record = read_json(record).map_err(|source| PipelineError::RunFile { source, made_by })?;
    Ok(read.made_from)
}

/// What an adjustment is. It covers the scene, but not where its files lie.
pub fn adjustment_fingerprint(run: &Path) -> Fingerprint {
    Fingerprint::from([("adjustment".into(), hash_file(&run.join(ADJUSTMENT).join(STAGE)))])
}

/// A value of an option that may not be given.
pub fn or_none(value: Option<impl std::fmt::Display>) -> String {
    value.map_or_else(|| "none".into(), |v| v.to_string())
}

/// Short hash of bytes.
pub fn hash(bytes: &[u8]) -> String {
    short(blake3::hash(bytes))
}

/// Hash of a file's content; of a file that is read over a network, of its [`identity`](vsi::identity).
pub fn hash_file(path: &Path) -> String {
    let hashed = if vsi::is_remote(path) {
        vsi::identity(path).map(|identity| blake3::hash(identity.as_bytes()))
    } else {
        vsi::content_hash(path)
    };
    hashed.map_or_else(|_| "absent".into(), short)
}

fn short(hash: blake3::Hash) -> String {
    hash.to_hex()[..HASH_LENGTH].to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stage(run: &Path, name: &'static str, made_from: &[(&str, &str)]) -> Stage {
        let fingerprint = made_from.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
        Stage::new(run, name, vec![run.join("output")], fingerprint)
    }

    #[test]
    fn what_differs_is_said_whole_and_the_advice_is_of_the_command() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path();
        let (one, two) = (hash(b"1"), hash(b"2"));
        let grid =
            |cell: &str| format!("1200 x 1100 cells of {cell} m, west 436000, north 3357700, EPSG:32617");
        let before =
            [("grid", grid("0.5")), ("splats", one.clone()), ("mask a", one.clone()), ("--fill", "2".into())];
        let now = [("grid", grid("1")), ("splats", two.clone()), ("mask b", two), ("--fill", "2".into())];
        fn text<'a>(from: &'a [(&'a str, String)]) -> Vec<(&'a str, &'a str)> {
            from.iter().map(|(k, v)| (*k, v.as_str())).collect()
        }
        stage(run, "dsm", &text(&before)).complete(&()).unwrap();
        let refusal = stage(run, "dsm", &text(&now)).is_done(false).unwrap_err();
        let expected = format!(
            "grid was {}, is {}; mask a is missing now; mask b is new; splats has changed",
            grid("0.5"),
            grid("1")
        );
        let PipelineError::Changed { differences, hint, .. } = refusal else { panic!("{refusal}") };
        assert_eq!(differences, expected);
        assert!(!differences.contains(&one[..8]), "{differences}");
        assert!(hint.contains("satgs dsm RUN --overwrite") && !hint.contains("-o "), "{hint}");
        assert!(stage(run, "appearance", &[]).made_by().contains("satgs train RUN --overwrite"));
        stage(run, "ba", &text(&before)).complete(&()).unwrap();
        let refusal = stage(run, "ba", &text(&now)).is_done(false).unwrap_err();
        let PipelineError::Changed { hint, .. } = refusal else { panic!("{refusal}") };
        assert!(hint.contains("another -o"), "{hint}");
    }

    #[test]
    fn a_summary_is_kept_and_is_no_part_of_the_record() {
        let folder = tempfile::tempdir().unwrap();
        let stage = stage(folder.path(), "train", &[("seed", "0")]);
        let record = || {
            std::fs::write(folder.path().join("output"), "").unwrap();
            std::fs::read(folder.path().join("train").join(STAGE)).unwrap()
        };
        stage.complete(&serde_json::json!({ "seconds": 1.5 })).unwrap();
        let first = record();
        stage.complete(&serde_json::json!({ "seconds": 2.5 })).unwrap();
        assert_eq!(record(), first, "later stages would be of other input");
        assert!(stage.is_done(false).unwrap());
        let summary: serde_json::Value = stage.summary().unwrap().unwrap();
        assert_eq!(summary["seconds"], 2.5);
    }

    #[test]
    fn a_damaged_record_or_summary_is_an_error_that_names_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let stage = stage(folder.path(), "train", &[("seed", "0")]);
        std::fs::create_dir(folder.path().join("train")).unwrap();
        for name in [STAGE, SUMMARY] {
            std::fs::write(folder.path().join("train").join(name), "{").unwrap();
        }
        let of_record = stage.is_done(false).unwrap_err().to_string();
        assert!(of_record.contains("train/stage.json"), "{of_record}");
        let of_summary = stage.summary::<serde_json::Value>().unwrap_err().to_string();
        assert!(of_summary.contains("train/summary.json"), "{of_summary}");
        assert!(!stage.is_done(true).unwrap(), "it can be made again");
    }
}
