//! Runs of recipe `satgs`, through the binary: bytes of the colours, and what is refused.

#![allow(clippy::unwrap_used)]

mod common;

use common::{refused, succeeds};
use std::path::Path;

/// A scene with a view that is held back, and runs of it with different numbers of threads.
struct Runs {
    folder: tempfile::TempDir,
}

impl Runs {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let runs = Self { folder };
        let scene = ["--views", "6", "--size", "140", "--held-out", "1", "-q"];
        succeeds(&[&["simulate", &runs.path("scene")][..], &scene].concat());
        for threads in ["1", "2"] {
            let run = ["run", &runs.path("scene"), "-o", &runs.path(threads), "--threads", threads];
            succeeds(&[&run[..], &["--recipe", "satgs", "--iterations", "40", "-q"]].concat());
        }
        runs
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap()
    }
}

#[test]
fn colours_do_not_depend_on_threads_or_scores_and_those_that_are_damaged_or_of_another_training_are_refused()
{
    let runs = Runs::new();
    for file in ["appearance.safetensors", "splats.ply"] {
        assert!(runs.bytes(&format!("1/{file}")) == runs.bytes(&format!("2/{file}")), "{file}");
    }

    let (run, picture) = (runs.path("1"), runs.path("picture.png"));
    let before = runs.bytes("1/appearance.safetensors");
    succeeds(&["nvs-eval", &run, "--protocol", "half"]);
    assert!(runs.bytes("1/appearance.safetensors") == before, "fitting a view changed the colours");
    succeeds(&["render", &run, "--view", "0,0", "--date", "2022-05-01", "-o", &picture]);
    assert!(Path::new(&picture).exists());

    let half = &before[..before.len() / 2];
    std::fs::write(runs.path("cut.safetensors"), half).unwrap();
    refused(&["nvs-eval", &run, "--lpips", &runs.path("cut.safetensors")], 2, &["cut.safetensors", "hint"]);
    let render = ["render", &run, "--view", "0,0", "-o", &picture];
    std::fs::write(runs.path("1/appearance.safetensors"), half).unwrap();
    refused(&render, 2, &["appearance.safetensors", "hint"]);
    std::fs::write(runs.path("1/appearance.safetensors"), &before).unwrap();
    std::fs::copy(runs.path("1/train/splats.ply"), runs.path("1/splats.ply")).unwrap();
    refused(&render, 2, &["appearance.safetensors", "splats.ply"]);
}
