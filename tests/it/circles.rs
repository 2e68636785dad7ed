//! Within a room (a folder of `src`) neither files nor folders import each other in a circle.
//!
//! An import is a path that starts with `super::` or `crate::ROOM::`, or a `use` of a child module. It counts for
//! the file that defines the imported item: what a `mod.rs` re-exports by `pub use` counts for the file that it is from,
//! and the re-export itself is no import. Tests are left out, as they may use anything.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Depth of the deepest folder below a room, at least.
const DEEPEST: usize = 4;

/// Names of a module path below `src`, as `["mvs", "stereo", "rays"]`.
type Module = Vec<String>;

struct Sources {
    /// Code of each module, without comments and tests.
    code: BTreeMap<Module, String>,
}

impl Sources {
    fn of_room(room: &Path) -> Self {
        let mut code = BTreeMap::new();
        for file in rust_files(room) {
            let relative = file.strip_prefix(source()).expect("a file below src").with_extension("");
            let mut module: Module = relative.iter().map(|n| n.to_string_lossy().into_owned()).collect();
            if module.last().is_some_and(|name| name == "mod") {
                module.pop();
            }
            if module.last().is_some_and(|name| name.ends_with("tests")) {
                continue;
            }
            code.insert(module, code_of(&std::fs::read_to_string(&file).expect("a source file")));
        }
        Self { code }
    }

    /// The module that defines what a path names, seen from a module; none outside of the room.
    fn definer(&self, from: &[String], path: &[String]) -> Option<Module> {
        let mut at: Module = match path.first()?.as_str() {
            "crate" => Vec::new(),
            "super" => from[..from.len().checked_sub(1)?].to_vec(),
            "self" => from.to_vec(),
            child => {
                let mut child_module = from.to_vec();
                child_module.push(child.to_owned());
                if !self.code.contains_key(&child_module) {
                    return None;
                }
                child_module
            }
        };
        let mut rest = &path[1..];
        while let [name, more @ ..] = rest {
            if name == "super" {
                at.pop()?;
            } else {
                at.push(name.clone());
                if !at.is_empty() && !self.code.contains_key(&at) {
                    at.pop();
                    break;
                }
            }
            rest = more;
        }
        let item = rest.first();
        self.code.get(&at)?;
        // What a module re-exports is defined elsewhere.
        if let Some(item) = item {
            for (is_public, exported) in uses(&self.code[&at]) {
                let is_it = exported.last() == Some(item);
                if is_public && is_it && exported.as_slice() != path {
                    return self.definer(&at, &exported).or(Some(at));
                }
            }
        }
        Some(at)
    }

    /// Modules that each module imports from.
    fn imports(&self) -> BTreeMap<Module, BTreeSet<Module>> {
        let of_module = |(module, code): (&Module, &String)| {
            let paths = uses(code).into_iter().filter(|(is_public, _)| !is_public).map(|(_, path)| path);
            let all = paths.chain(paths_in_code(code));
            let found = all.filter_map(|path| self.definer(module, &path)).filter(|m| m != module);
            (module.clone(), found.collect())
        };
        self.code.iter().map(of_module).collect()
    }
}

fn source() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let entries =
        std::fs::read_dir(folder).expect("a folder of the sources").map(|e| e.expect("a source file").path());
    let files = entries.flat_map(|p| if p.is_dir() { rust_files(&p) } else { vec![p] });
    files.filter(|p| p.extension().is_some_and(|x| x == "rs")).collect()
}

/// Code before the tests of a file, without comments.
fn code_of(text: &str) -> String {
    let is_module =
        |i: &usize| text[*i..].lines().nth(1).is_some_and(|l| l.contains("mod ") && l.ends_with('{'));
    let tests = text.match_indices("#[cfg(test)]").map(|(i, _)| i).find(is_module);
    let before_tests = &text[..tests.unwrap_or(text.len())];
    let lines = before_tests.lines().map(|l| l.split_once("//").map_or(l, |(code, _)| code));
    lines.collect::<Vec<_>>().join("\n")
}

/// Paths of all `use` declarations, and whether they are public re-exports.
fn uses(code: &str) -> Vec<(bool, Vec<String>)> {
    let mut out = Vec::new();
    for statement in code.split_inclusive(';') {
        let Some(start) = statement.find("use ").filter(|i| {
            let before = statement[..*i].trim_end();
            before.is_empty() || before.ends_with(['}', ']', '{', ')', ';']) || before.ends_with("pub")
        }) else {
            continue;
        };
        let is_public = statement[..start].lines().last().is_some_and(|l| l.trim_start().starts_with("pub"));
        let tree = statement[start + 4..].trim_end_matches(';');
        expand(tree.trim(), &[], &mut |path| out.push((is_public, path)));
    }
    out
}

/// Calls `found` with each path of a `use` tree.
fn expand(tree: &str, prefix: &[String], found: &mut impl FnMut(Vec<String>)) {
    let (head, group) = match tree.split_once('{') {
        Some((head, group)) => (head, Some(group.trim_end().strip_suffix('}').unwrap_or(group))),
        None => (tree, None),
    };
    let head = head.split(" as ").next().unwrap_or(head);
    let names = head.split("::").map(str::trim).filter(|n| !n.is_empty());
    let path: Vec<String> = prefix.iter().cloned().chain(names.map(str::to_owned)).collect();
    let Some(group) = group else { return found(path) };
    let (mut depth, mut entry) = (0, String::new());
    for c in group.chars().chain([',']) {
        match c {
            ',' if depth == 0 => {
                if !entry.trim().is_empty() {
                    expand(entry.trim(), &path, found);
                }
                entry.clear();
                continue;
            }
            '{' => depth += 1,
            '}' => depth -= 1,
            _ => {}
        }
        entry.push(c);
    }
}

/// Paths from `super::` and `crate::` on in expressions and types.
fn paths_in_code(code: &str) -> Vec<Vec<String>> {
    let starts = ["super::", "crate::"].into_iter().flat_map(|start| code.match_indices(start));
    let is_start = |i: &usize| !code[..*i].ends_with(|c: char| c == ':' || c.is_alphanumeric() || c == '_');
    let path_at = |i: usize| {
        let end = code[i..].find(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':'));
        let text = &code[i..end.map_or(code.len(), |e| i + e)];
        text.split("::").filter(|n| !n.is_empty()).map(str::to_owned).collect()
    };
    starts.map(|(i, _)| i).filter(is_start).map(path_at).collect()
}

/// Modules from which one can come back to themselves, each with all that it reaches in such circles.
fn circles(imports: &BTreeMap<Module, BTreeSet<Module>>) -> BTreeSet<Vec<String>> {
    let reach = |start: &Module| {
        let (mut seen, mut open) = (BTreeSet::new(), vec![start.clone()]);
        while let Some(module) = open.pop() {
            for next in imports.get(&module).into_iter().flatten() {
                if seen.insert(next.clone()) {
                    open.push(next.clone());
                }
            }
        }
        seen
    };
    let reached: BTreeMap<&Module, BTreeSet<Module>> = imports.keys().map(|m| (m, reach(m))).collect();
    let circle = |module: &&Module| -> Option<Vec<String>> {
        let of = |m: &Module| reached.get(m).is_some_and(|r| r.contains(*module));
        let members = reached[*module].iter().filter(|m| of(m)).map(|m| m.join("::"));
        reached[*module].contains(*module).then(|| members.collect())
    };
    reached.keys().filter_map(circle).collect()
}

/// What the files and folders at a depth below a room, 1 for those that lie directly in it, import of each other, with all that
/// a folder holds as one.
fn of_folders(
    imports: &BTreeMap<Module, BTreeSet<Module>>,
    depth: usize,
) -> BTreeMap<Module, BTreeSet<Module>> {
    let folder = |module: &Module| module.iter().take(depth + 1).cloned().collect::<Module>();
    let mut out = BTreeMap::<Module, BTreeSet<Module>>::new();
    for (module, imported) in imports {
        let from = folder(module);
        let others = imported.iter().map(folder).filter(|to| *to != from);
        out.entry(from.clone()).or_default().extend(others);
    }
    out
}

fn rooms() -> impl Iterator<Item = BTreeMap<Module, BTreeSet<Module>>> {
    let entries = std::fs::read_dir(source()).expect("src").map(|e| e.expect("a room").path());
    entries.filter(|p| p.is_dir()).map(|room| Sources::of_room(&room).imports())
}

fn text(circles: impl Iterator<Item = Vec<String>>) -> String {
    circles.map(|circle| circle.join(" <-> ")).collect::<Vec<_>>().join("\n")
}

#[test]
fn files_of_a_room_do_not_import_each_other_in_circles() {
    let found = text(rooms().flat_map(|imports| circles(&imports)));
    assert!(found.is_empty(), "{found}");
}

#[test]
fn folders_of_a_room_do_not_import_each_other_in_circles() {
    let found = text(
        rooms()
            .flat_map(|imports| (1..=DEEPEST).flat_map(move |depth| circles(&of_folders(&imports, depth)))),
    );
    assert!(found.is_empty(), "{found}");
}

#[test]
fn imports_are_found_in_trees_and_in_expressions() {
    let code = "use super::{a, b::{C, D as E}};\npub use f::G;\nfn h() { super::i::j() }";
    let paths: Vec<String> = uses(code).into_iter().map(|(_, path)| path.join("::")).collect();
    assert_eq!(paths, ["super::a", "super::b::C", "super::b::D", "f::G"]);
    assert!(paths_in_code(code).contains(&["super", "i", "j"].map(str::to_owned).to_vec()));
    let module = |name: &str| vec!["room".to_owned(), name.to_owned()];
    let (a, b) = (module("a"), module("b"));
    let of = |imports: &[(&Module, &Module)]| -> BTreeMap<Module, BTreeSet<Module>> {
        imports.iter().map(|(from, to)| ((*from).clone(), BTreeSet::from([(*to).clone()]))).collect()
    };
    assert_eq!(circles(&of(&[(&a, &b), (&b, &a)])).into_iter().collect::<Vec<_>>(), [["room::a", "room::b"]]);
    assert!(circles(&of(&[(&a, &b)])).is_empty());
    // Two folders, although no file comes back to itself.
    let within = |folder: &str, file: &str| vec!["room".to_owned(), folder.to_owned(), file.to_owned()];
    let files = of(&[(&within("f", "x"), &within("g", "y")), (&within("g", "z"), &within("f", "w"))]);
    assert!(circles(&files).is_empty());
    assert_eq!(circles(&of_folders(&files, 1)).into_iter().collect::<Vec<_>>(), [["room::f", "room::g"]]);
}
