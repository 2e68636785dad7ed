//! No public type has the name of another room's public type: a name has one meaning in the whole library.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Names of types that are declared `pub` at the top level of a file.
fn public_types(text: &str) -> impl Iterator<Item = &str> {
    text.lines().filter_map(|line| {
        let declaration = line.strip_prefix("pub ")?;
        let (kind, rest) = declaration.split_once(' ')?;
        let end = rest.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(rest.len());
        ["struct", "enum", "trait", "type"].contains(&kind).then_some(&rest[..end])
    })
}

fn collect(path: &Path, room: &str, rooms: &mut BTreeMap<String, BTreeSet<String>>) {
    for entry in std::fs::read_dir(path).expect("a folder of the sources") {
        let path = entry.expect("a folder of the sources").path();
        if path.is_dir() {
            collect(&path, room, rooms);
        } else if path.extension().is_some_and(|e| e == "rs") {
            for name in public_types(&std::fs::read_to_string(&path).expect("a source file")) {
                rooms.entry(name.to_owned()).or_default().insert(room.to_owned());
            }
        }
    }
}

#[test]
fn public_types_of_different_rooms_have_different_names() {
    let mut rooms = BTreeMap::new();
    for entry in std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("src")).unwrap() {
        let path = entry.unwrap().path();
        // The command line has one file a command, each with its `Args`; it is no part of the library's interface.
        if path.is_dir() && path.file_name().is_some_and(|n| n != "cli") {
            let room = path.file_name().unwrap().to_string_lossy().into_owned();
            collect(&path, &room, &mut rooms);
        }
    }
    let twice = rooms.iter().filter(|(_, rooms)| rooms.len() > 1);
    let twice: Vec<String> = twice.map(|(name, rooms)| format!("{name}: {rooms:?}")).collect();
    assert!(twice.is_empty(), "{}", twice.join("\n"));
}
