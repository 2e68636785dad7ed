//! An enum of errors that wraps another one with a `kind` asks it: else whose fault a failure is would be lost on the way.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries
        .flat_map(|path| if path.is_dir() { rust_files(&path) } else { vec![path] })
        .filter(|path| path.extension().is_some_and(|x| x == "rs"))
        .collect()
}

/// The part of a text from the brace after `start` to the one that closes it.
fn block<'a>(text: &'a str, start: &str) -> Option<&'a str> {
    let from = text.find(start)?;
    let open = from + text[from..].find('{')?;
    let mut depth = 0;
    for (i, c) in text[open..].char_indices() {
        depth += i32::from(c == '{') - i32::from(c == '}');
        if depth == 0 {
            return Some(&text[open..=open + i]);
        }
    }
    None
}

/// Variants of an enum that hold one other error, `Name(#[from] Other)` or `Name(Box<Other>)`, and the type that they hold.
fn wrapped(body: &str) -> Vec<(String, String)> {
    let lines = body.lines().map(str::trim).filter(|line| !line.starts_with("//") && !line.starts_with('#'));
    let variant = |line: &str| {
        let (name, rest) = line.split_once('(')?;
        let held = rest.trim_end_matches([',', ')']).trim_start_matches("#[from] ");
        let held = held.trim_start_matches("Box<").trim_end_matches('>');
        let is_name = |word: &str| !word.is_empty() && word.chars().all(char::is_alphanumeric);
        (is_name(name) && is_name(held)).then(|| (name.to_owned(), held.to_owned()))
    };
    lines.filter_map(variant).collect()
}

#[test]
fn an_error_that_wraps_another_has_its_kind() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    // Name of each enum of errors with a `kind`, its body and that of the method.
    let mut enums = BTreeMap::new();
    for file in rust_files(&source) {
        let text = std::fs::read_to_string(&file).unwrap();
        for (at, _) in text.match_indices("pub enum ") {
            let name: String =
                text[at + "pub enum ".len()..].chars().take_while(|c| c.is_alphanumeric()).collect();
            let methods = block(&text, &format!("impl {name} {{"));
            let kind = methods.and_then(|methods| block(methods, "fn kind(&self) -> ErrorKind"));
            if let (true, Some(kind), Some(body)) = (name.ends_with("Error"), kind, block(&text[at..], &name))
            {
                enums.insert(name, (body.to_owned(), kind.to_owned()));
            }
        }
    }
    assert!(enums.len() > 15, "{:?}", enums.keys());
    let mut lost = Vec::new();
    for (name, (body, kind)) in &enums {
        for (variant, held) in wrapped(body).iter().filter(|(_, held)| enums.contains_key(held)) {
            if !kind.contains(&format!("Self::{variant}(e) => e.kind()")) {
                lost.push(format!("{name}::{variant} holds {held}"));
            }
        }
    }
    assert!(lost.is_empty(), "`kind` does not ask what these hold: {lost:#?}");
}
