//! The modules stand in layers: each imports only from those before it. ARCHITECTURE.md draws them.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Modules in the order of the layers, and what each may import; `None`: everything before it.
const LAYERS: [(&str, Option<&[&str]>); 34] = [
    ("fault", Some(&[])),
    ("random", Some(&[])),
    ("stats", Some(&["random"])),
    ("simd", Some(&[])),
    ("progress", Some(&[])),
    ("run_files", Some(&[])),
    ("frame", Some(&[])),
    ("io", Some(&["fault", "frame"])),
    ("checkpoint", Some(&["progress", "io"])),
    ("nn", Some(&["fault", "random", "simd", "io"])),
    ("rpc", None),
    ("scene", None),
    // The simulator makes the truth: it must share nothing with what is tested against it.
    ("simulate", Some(&["fault", "stats", "random", "progress", "frame", "io", "rpc", "scene"])),
    (
        "bundle",
        Some(&["fault", "stats", "progress", "run_files", "frame", "io", "checkpoint", "rpc", "scene"]),
    ),
    ("camera", Some(&["simd"])),
    ("affine", Some(&["fault", "stats", "random", "simd", "frame", "io", "rpc", "scene", "camera"])),
    ("perspective", Some(&["fault", "stats", "random", "simd", "frame", "io", "scene", "bundle", "camera"])),
    (
        "mvs",
        Some(&[
            "fault",
            "stats",
            "random",
            "progress",
            "frame",
            "io",
            "checkpoint",
            "scene",
            "affine",
            "perspective",
        ]),
    ),
    (
        "prior",
        Some(&[
            "fault",
            "stats",
            "random",
            "progress",
            "run_files",
            "frame",
            "io",
            "checkpoint",
            "nn",
            "scene",
            "perspective",
            "mvs",
        ]),
    ),
    ("splat", None),
    ("estimate", Some(&["stats", "progress", "scene", "affine", "mvs", "splat"])),
    ("predict", None),
    (
        "mesh",
        Some(&["fault", "stats", "random", "progress", "frame", "io", "camera", "affine", "perspective"]),
    ),
    ("dsm", None),
    ("metrics", Some(&["fault", "stats", "random", "progress", "frame", "io", "mesh"])),
    ("coregister", Some(&["fault", "stats", "frame", "io", "metrics"])),
    ("changes", Some(&["fault", "stats", "random", "frame", "io", "metrics"])),
    ("report", None),
    ("viewer", None),
    ("export", None),
    ("pipeline", None),
    ("tiles", None),
    ("run", None),
    ("cli", None),
];

fn source() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

fn may_import(module: &str) -> Vec<&'static str> {
    let place = LAYERS.iter().position(|(name, _)| *name == module).expect("a known module");
    match LAYERS[place].1 {
        Some(listed) => listed.to_vec(),
        None => LAYERS[..place].iter().map(|(name, _)| *name).collect(),
    }
}

fn rust_files(path: &Path) -> Vec<PathBuf> {
    if path.is_file() {
        return vec![path.into()];
    }
    let Ok(entries) = std::fs::read_dir(path) else { return Vec::new() };
    let mut files: Vec<PathBuf> = entries
        .flat_map(|e| rust_files(&e.unwrap().path()))
        .filter(|p| p.extension().is_some_and(|x| x == "rs"))
        .collect();
    files.sort();
    files
}

/// Top-level modules that a file's code names after `crate::`, in paths and in `use crate::{a, b::c}`.
fn imports(text: &str) -> BTreeSet<String> {
    let code: String = text
        .lines()
        .map(|line| line.split_once("//").map_or(line, |(code, _)| code))
        .collect::<Vec<_>>()
        .join("\n");
    let mut found = BTreeSet::new();
    for (_, after) in code.match_indices("crate::").map(|(i, m)| (i, &code[i + m.len()..])) {
        if let Some(group) = after.strip_prefix('{') {
            found.extend(group_heads(group));
        } else {
            found.insert(first_word(after));
        }
    }
    found
}

/// First words of the entries of a `{...}` group, nested groups skipped.
fn group_heads(group: &str) -> Vec<String> {
    let (mut depth, mut entry, mut heads) = (1, String::new(), Vec::new());
    for c in group.chars() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            _ => {}
        }
        if depth == 0 || (depth == 1 && c == ',') {
            heads.push(first_word(entry.trim_start()));
            entry.clear();
        } else {
            entry.push(c);
        }
        if depth == 0 {
            break;
        }
    }
    heads.retain(|h| !h.is_empty());
    heads
}

fn first_word(text: &str) -> String {
    text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()
}

#[test]
fn modules_import_only_what_stands_before_them() {
    let mut wrong = Vec::new();
    for (module, _) in LAYERS {
        let allowed = may_import(module);
        let files =
            [rust_files(&source().join(module)), rust_files(&source().join(format!("{module}.rs")))].concat();
        assert!(!files.is_empty(), "src/{module} has no Rust file");
        for file in files {
            for import in imports(&std::fs::read_to_string(&file).unwrap()) {
                if import != module && !allowed.contains(&import.as_str()) {
                    wrong.push(format!("{} imports {import}", file.display()));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn the_crate_lists_its_modules_in_the_order_of_the_layers() {
    let lib = std::fs::read_to_string(source().join("lib.rs")).unwrap();
    let listed: Vec<&str> =
        lib.lines().filter_map(|l| l.strip_prefix("pub mod ")?.strip_suffix(';')).collect();
    assert_eq!(listed, LAYERS.map(|(name, _)| name));
}

#[test]
fn imports_are_read_in_every_form() {
    let text = "use crate::frame::{Point, Site};\n//! use crate::cli;\nuse crate::{rpc::Rpc, scene::{A, B}, io};\n\
                fn f() { crate::bundle::run() } // crate::dsm\npub(in crate::splat) fn g() {}";
    let found: Vec<String> = imports(text).into_iter().collect();
    assert_eq!(found, ["bundle", "frame", "io", "rpc", "scene", "splat"]);
}
