//! The commands of README.md and of the user guide, run as a reader of both would run them.
//!
//! A block of commands whose first line is ```` ```sh test ```` is run by `sh` in a folder that holds a copy of
//! `data/`: first those of README.md, then those of the guide's pages in the order of its index. After `test`
//! may stand `creates=FILE,FILE` (files that must exist afterwards) and `exit=N` (the exit code, 0 unless given).
//! Every other block says what it needs that the test has not ([`REASONS`]): ```` ```sh needs=images ````. Those of Python in
//! python.md are run by `python/tests/test_guide.py`.

use crate::common::copy_folder;
use std::path::{Path, PathBuf};
use std::process::Command;

const GUIDE: &str = "docs/guide";
/// What blocks need that are not run: images or points that are not in the repository, a network's file, minutes of work, a
/// browser, several machines, the system's packages, a package of a release, QGIS.
const REASONS: [&str; 8] = ["images", "model", "minutes", "browser", "cluster", "root", "package", "QGIS"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// Targets of the Markdown links of a page.
fn links(text: &str) -> impl Iterator<Item = &str> {
    text.split("](").skip(1).filter_map(|rest| rest.split(')').next())
}

/// README.md, the guide's index and the pages that it links, in this order.
fn pages() -> Vec<String> {
    let index = format!("{GUIDE}/README.md");
    let text = read(&index);
    let in_guide = links(&text).filter(|link| link.ends_with(".md") && !link.contains('/'));
    let linked = in_guide.map(|link| format!("{GUIDE}/{link}"));
    let mut pages = vec!["README.md".to_owned(), index];
    for page in linked {
        if !pages.contains(&page) {
            pages.push(page);
        }
    }
    pages
}

/// A block of commands of a page, and what it promises.
struct Block {
    page: String,
    line: usize,
    commands: String,
    creates: Vec<String>,
    exit: i32,
}

fn blocks(page: &str) -> Vec<Block> {
    let text = read(page);
    let mut found = Vec::new();
    let mut lines = text.lines().enumerate();
    while let Some((n, line)) = lines.next() {
        let Some(promises) = line.strip_prefix("```sh test") else { continue };
        let mut block =
            Block { page: page.to_owned(), line: n + 1, commands: String::new(), creates: vec![], exit: 0 };
        for promise in promises.split_whitespace() {
            match promise.split_once('=') {
                Some(("creates", files)) => block.creates = files.split(',').map(str::to_owned).collect(),
                Some(("exit", code)) => block.exit = code.parse().unwrap(),
                _ => panic!("{page}:{}: `{promise}` is neither creates=FILES nor exit=CODE", n + 1),
            }
        }
        for (_, line) in lines.by_ref().take_while(|(_, line)| *line != "```") {
            block.commands += line;
            block.commands += "\n";
        }
        found.push(block);
    }
    found
}

#[test]
#[cfg(unix)]
fn commands_of_readme_and_guide_do_what_the_pages_say() {
    let folder = tempfile::tempdir().unwrap();
    copy_folder(&root().join("data"), &folder.path().join("data"));
    let program = PathBuf::from(env!("CARGO_BIN_EXE_satgs"));
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders = [program.parent().unwrap().to_path_buf()].into_iter().chain(std::env::split_paths(&path));
    let path = std::env::join_paths(folders).unwrap();

    let blocks: Vec<Block> = pages().iter().flat_map(|page| blocks(page)).collect();
    assert!(blocks.len() >= 10, "only {} blocks of commands are marked for testing", blocks.len());
    for block in blocks {
        let mut shell = Command::new("sh");
        shell.args(["-euc", &block.commands]).current_dir(folder.path()).env("PATH", &path);
        let output = shell.output().unwrap();
        let said = format!(
            "{}:{}\n{}{}{}",
            block.page,
            block.line,
            block.commands,
            String::from_utf8_lossy(&output.stdout),
            String::from_utf8_lossy(&output.stderr)
        );
        assert_eq!(output.status.code(), Some(block.exit), "{said}");
        for file in &block.creates {
            assert!(folder.path().join(file).exists(), "`{file}` is missing: {said}");
        }
    }
}

#[test]
fn blocks_are_run_or_say_why_not() {
    for page in pages() {
        for (n, line) in read(&page).lines().enumerate() {
            let mark = line.trim_start().strip_prefix("```").unwrap_or_default();
            let is_excused = mark.split_once(" needs=").is_some_and(|(_, reason)| REASONS.contains(&reason));
            let is_of_python = mark == "python" && page.ends_with("/python.md");
            let is_known = mark.is_empty() || mark.starts_with("sh test") || is_of_python || is_excused;
            assert!(is_known, "{page}:{}: neither `test` nor `needs=` one of {REASONS:?}", n + 1);
        }
    }
}

#[test]
fn the_index_of_the_guide_lists_every_page() {
    let pages = pages();
    for entry in std::fs::read_dir(root().join(GUIDE)).unwrap() {
        let name = entry.unwrap().file_name().to_string_lossy().into_owned();
        assert!(pages.contains(&format!("{GUIDE}/{name}")), "{GUIDE}/README.md has no link to {name}");
    }
}

#[test]
fn links_of_the_documents_lead_to_files() {
    let mut pending = vec![root().join("README.md"), root().join("ARCHITECTURE.md"), root().join("docs")];
    while let Some(path) = pending.pop() {
        if path.is_dir() {
            pending.extend(std::fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().path()));
        } else if path.extension().is_some_and(|e| e == "md") {
            let text = std::fs::read_to_string(&path).unwrap();
            for link in links(&text).filter(|link| !link.contains("://")) {
                let file = link.split('#').next().unwrap_or_default();
                let target = path.parent().unwrap().join(file);
                assert!(target.exists(), "{}: the link to `{link}` leads nowhere", path.display());
            }
        }
    }
}

#[test]
#[cfg(unix)]
fn a_release_of_another_version_is_refused() {
    let script = root().join("scripts/release");
    let output = Command::new(script).args(["--dry-run", "9.9.9"]).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.starts_with("error: Cargo.toml does not say 9.9.9\nhint: "), "{said}");
}

#[test]
fn the_python_package_has_the_same_licence() {
    assert_eq!(read("python/LICENSE"), read("LICENSE"));
}

#[test]
fn the_citation_and_the_recipe_name_the_present_version() {
    let present = env!("CARGO_PKG_VERSION");
    for (file, line) in [
        ("CITATION.cff", format!("version: {present}")),
        ("recipe/meta.yaml", format!("{{% set version = \"{present}\" %}}")),
    ] {
        assert!(read(file).lines().any(|found| found == line), "{file} does not hold `{line}`");
    }
}
