//! What users handed to satgs and what must come of it: the folders of `inputs` in the shared data, each with a README.
//!
//! Each module names in `FOLDERS` those that it tests, so that none is forgotten.

mod georeference;
mod networks;
mod photographs;
mod products;
mod satellites;
mod units;

use crate::common::data_dir;
use std::path::PathBuf;

/// Folders whose fault is known and not mended: heights far above the tie points are not searched.
const OPEN: &[&str] = &["tower_lost"];

/// A folder of the inputs; none where the real data is absent.
fn input(name: &str) -> Option<PathBuf> {
    data_dir().map(|data| data.join("inputs").join(name)).filter(|folder| folder.is_dir())
}

#[test]
fn every_input_has_a_test() {
    let Some(inputs) = input(".") else { return };
    let listed = [
        georeference::FOLDERS,
        networks::FOLDERS,
        photographs::FOLDERS,
        products::FOLDERS,
        satellites::FOLDERS,
        units::FOLDERS,
    ]
    .concat();
    for entry in std::fs::read_dir(inputs).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let is_known = [listed.as_slice(), OPEN].iter().any(|names| names.contains(&name.as_str()));
        assert!(is_known, "no test names inputs/{name}");
    }
}
