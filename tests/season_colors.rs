//! Runs of recipe `satgs`, through the binary: bytes of the colours, and what is refused.

#![allow(clippy::unwrap_used)]

mod common;

use common::satgs;
use std::path::{Path, PathBuf};
use std::process::Output;

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

fn succeed(arguments: &[&str]) {
    let output = satgs(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", text(&output));
}

fn refuse(arguments: &[&str], reasons: &[&str]) {
    let output = satgs(arguments);
    let said = text(&output);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
    reasons
        .iter()
        .for_each(|reason| assert!(said.contains(reason), "{arguments:?}: no `{reason}` in {said}"));
}

/// A scene with a view that is held back, and runs of it with different numbers of threads.
struct Runs {
    folder: tempfile::TempDir,
}

impl Runs {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let runs = Self { folder };
        let scene = ["--views", "6", "--size", "140", "--held-out", "1", "-q"];
        succeed(&[&["simulate", &runs.path("scene")][..], &scene].concat());
        for threads in ["1", "2"] {
            let run = ["run", &runs.path("scene"), "-o", &runs.path(threads), "--threads", threads];
            succeed(&[&run[..], &["--recipe", "satgs", "--iterations", "40", "-q"]].concat());
        }
        runs
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(Path::new(&self.path(name))).unwrap()
    }
}

#[test]
fn colours_are_the_same_for_any_number_of_threads_and_those_of_another_training_are_refused() {
    let runs = Runs::new();
    for file in ["appearance.safetensors", "splats.ply"] {
        assert!(runs.bytes(&format!("1/{file}")) == runs.bytes(&format!("2/{file}")), "{file}");
    }

    let (run, picture) = (runs.path("1"), runs.path("picture.png"));
    let before = runs.bytes("1/appearance.safetensors");
    succeed(&["nvs-eval", &run, "--protocol", "half"]);
    assert!(runs.bytes("1/appearance.safetensors") == before, "fitting a view changed the colours");
    succeed(&["render", &run, "--view", "0,0", "--date", "2022-05-01", "-o", &picture]);
    assert!(PathBuf::from(&picture).exists());

    let cut = runs.path("cut.safetensors");
    std::fs::write(&cut, &before[..before.len() / 2]).unwrap();
    refuse(&["nvs-eval", &run, "--lpips", &cut], &["cut.safetensors"]);

    let colors = PathBuf::from(&run).join("appearance.safetensors");
    std::fs::write(&colors, &before[..before.len() / 2]).unwrap();
    refuse(&["render", &run, "--view", "0,0", "-o", &picture], &["appearance.safetensors", "hint"]);
    std::fs::write(&colors, &before).unwrap();
    std::fs::copy(PathBuf::from(&run).join("train/splats.ply"), PathBuf::from(&run).join("splats.ply"))
        .unwrap();
    refuse(&["render", &run, "--view", "0,0", "-o", &picture], &["appearance.safetensors", "splats.ply"]);
}
