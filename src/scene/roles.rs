//! Lists of the views to train on and of those to hold back: `train.txt` and `test.txt`, a file name per line.
//!
//! Views in `test.txt` are not trained on. If there is a file `train.txt`, only the views that it lists are trained on.

use super::files::{read_text, stem};
use super::{Role, SceneError, View};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Content of `train.txt` and `test.txt`.
pub(super) struct Roles {
    train: Option<BTreeSet<String>>,
    test: BTreeSet<String>,
}

impl Roles {
    /// Reads the lists among the files of a folder.
    pub(super) fn read(listing: &[PathBuf]) -> Result<Self, SceneError> {
        let list = |name: &str| {
            let file = listing.iter().find(|p| p.file_name().is_some_and(|n| n == name));
            file.map(|path| names_in(path)).transpose()
        };
        Ok(Self { train: list("train.txt")?, test: list("test.txt")?.unwrap_or_default() })
    }

    /// Gives the views their roles. Returns the names that are listed, but belong to none of the `images`.
    pub(super) fn assign(&self, views: &mut [View], images: &[PathBuf]) -> Vec<&str> {
        for view in views {
            let trained = self.train.as_ref().is_none_or(|t| t.contains(&view.name));
            view.role = if trained && !self.test.contains(&view.name) { Role::Train } else { Role::Test };
        }
        let names: BTreeSet<String> = images.iter().map(|i| stem(i)).collect();
        let listed = self.train.iter().flatten().chain(&self.test);
        listed.map(String::as_str).filter(|name| !names.contains(*name)).collect()
    }
}

/// Names of the views in a list.
fn names_in(list: &Path) -> Result<BTreeSet<String>, SceneError> {
    let text = read_text(list)?;
    let lines = text.lines().map(str::trim).filter(|l| !l.is_empty() && !l.starts_with('#'));
    // Names may contain dots, so that only known extensions are removed.
    let bare = |l: &str| {
        let known = [".json", ".tif", ".tiff"];
        known.iter().find_map(|e| l.strip_suffix(e)).unwrap_or(l).to_owned()
    };
    Ok(lines.map(bare).collect())
}
