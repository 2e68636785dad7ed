//! Where priors come from.

use super::command::PriorCommand;
use super::error::PriorError;
use super::map::PriorContent;
use crate::io::{ReadError, vsi};
use std::path::{Path, PathBuf};

/// Part of every hash: to be counted up when the same source gives other maps.
const FORM: &str = "satgs prior 1";
/// What users call matching.
const STEREO: &str = "stereo";

/// Where the depths or normals of images come from.
#[derive(Clone, Debug, PartialEq)]
pub enum PriorSource {
    /// A folder with a map for each image.
    Folder(PathBuf),
    /// What makes a map of an image.
    Maker(PriorMaker),
}

/// What makes a map of an image.
#[derive(Clone, Debug, PartialEq)]
pub enum PriorMaker {
    /// A network, as an ONNX file. It takes one picture, f32 `[1, 3, rows, columns]`. Its first output is f32
    /// `[1, rows, columns]` or `[1, 1, rows, columns]` for depths, `[1, 3, rows, columns]` or `[1, rows, columns, 3]` for normals.
    Network(PathBuf),
    /// A command.
    Command(PriorCommand),
    /// Matching of the images with each other, at their poses. It gives depths, and needs no network.
    Stereo,
}

impl PriorSource {
    /// The source that a text names: `stereo`, an existing folder, an existing file that ends in `.onnx`, or a command with `{image}` and
    /// `{out}`.
    ///
    /// # Errors
    /// [`PriorError::NoSource`] if it is none of these, [`PriorError::Words`] for a command that cannot be split into words.
    pub fn parse(text: &str) -> Result<Self, PriorError> {
        let path = Path::new(text);
        if text == STEREO {
            Ok(Self::Maker(PriorMaker::Stereo))
        } else if vsi::is_dir(path) {
            Ok(Self::Folder(path.into()))
        } else if path.extension().is_some_and(|end| end.eq_ignore_ascii_case("onnx")) && path.is_file() {
            Ok(Self::Maker(PriorMaker::Network(path.into())))
        } else {
            PriorCommand::parse(text).map(|command| Self::Maker(PriorMaker::Command(command)))
        }
    }
}

impl std::fmt::Display for PriorSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Folder(path) => path.display().fmt(f),
            Self::Maker(maker) => maker.fmt(f),
        }
    }
}

impl PriorMaker {
    /// A hash of what decides which maps it makes: the network's file, or the command and the files that it names.
    ///
    /// # Errors
    /// [`PriorError::Read`] if a file cannot be read.
    pub fn hash(&self, content: PriorContent) -> Result<blake3::Hash, PriorError> {
        let mut hasher = blake3::Hasher::new();
        hasher.update(format!("{FORM} {content}\0").as_bytes());
        let mut add = |path: &Path| -> Result<(), ReadError> {
            let hash = vsi::content_hash(path).map_err(|e| ReadError::new(path, e))?;
            hasher.update(hash.as_bytes());
            Ok(())
        };
        match self {
            Self::Network(path) => {
                add(path)?;
                // Weights that do not fit into the file.
                let weights = path.with_extension("onnx.data");
                if weights.is_file() {
                    add(&weights)?;
                }
            }
            Self::Command(command) => {
                command.files().try_for_each(&mut add)?;
                hasher.update(command.text().as_bytes());
            }
            Self::Stereo => {
                hasher.update(STEREO.as_bytes());
            }
        }
        Ok(hasher.finalize())
    }
}

impl std::fmt::Display for PriorMaker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Network(path) => path.display().fmt(f),
            Self::Command(command) => f.write_str(command.text()),
            Self::Stereo => f.write_str(STEREO),
        }
    }
}
