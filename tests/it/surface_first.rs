//! Of two and three views, training does not change the heights: the surface is complete before it starts, and may be all that
//! is wanted.

use crate::common::{refused, succeeds};
use satgs::io::ImageFile;
use satgs::pipeline::{PipelineError, TrainOptions};
use satgs::progress::{Event, Progress};
use satgs::run::{RunError, RunOptions, run};
use satgs::scene::{self, ReadOptions};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// A scene of two views of the town.
fn pair(folder: &Path) -> PathBuf {
    let scene = folder.join("scene");
    std::fs::create_dir(&scene).unwrap();
    for view in ["VIEW_01.tif", "VIEW_02.tif"] {
        std::fs::copy(Path::new("data/town").join(view), scene.join(view)).unwrap();
    }
    scene
}

fn heights(run: &Path) -> Vec<u32> {
    let dsm = ImageFile::open(&run.join("dsm.tif")).unwrap().read(1).unwrap();
    dsm.data.iter().map(|z| z.to_bits()).collect()
}

/// Interrupts at the first iteration of the training.
#[derive(Default)]
struct UntilTraining {
    notes: Mutex<Vec<String>>,
    trains: AtomicBool,
}

impl Progress for UntilTraining {
    fn event(&self, event: Event) {
        match event {
            Event::Note(text) => self.notes.lock().unwrap().push(text),
            Event::Started { stage: "training", .. } => self.trains.store(true, Ordering::Relaxed),
            _ => {}
        }
    }

    fn is_cancelled(&self) -> bool {
        self.trains.load(Ordering::Relaxed)
    }
}

#[test]
fn the_surface_of_a_pair_is_complete_before_its_splats_are_trained() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene::read(&pair(folder.path()), &ReadOptions::default()).unwrap();
    let (out, progress) = (folder.path().join("run"), UntilTraining::default());
    let train = TrainOptions { iterations: Some(20), ..TrainOptions::default() };
    let options = RunOptions { train, ..RunOptions::default() };
    let interrupted = run(scene.clone().into(), &options, &out, &progress, &mut |_| {});
    assert!(
        matches!(interrupted, Err(RunError::Pipeline(PipelineError::TrainingInterrupted { .. }))),
        "{interrupted:?}"
    );
    for product in ["dsm.tif", "ortho.tif", "confidence.tif", "dsm.qml"] {
        assert!(out.join(product).exists(), "{product}");
    }
    assert!(!out.join("splats.ply").exists(), "no splats are trained yet");
    assert!(
        progress.notes.lock().unwrap().iter().any(|note| note.contains("only the colours of the orthophoto"))
    );
    let first = heights(&out);
    assert!(first.iter().any(|z| !f32::from_bits(*z).is_nan()));

    // The same command goes on, and no height changes.
    run(scene.into(), &options, &out, &satgs::progress::NoProgress, &mut |_| {}).unwrap();
    assert_eq!(heights(&out), first);
    assert!(out.join("report.html").exists());
}

#[test]
fn a_run_without_splats_has_the_heights_of_one_with_splats() {
    let folder = tempfile::tempdir().unwrap();
    let scene = pair(folder.path());
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (scene, bare, whole) = (scene.to_str().unwrap(), path("bare"), path("whole"));
    let said = succeeds(&["run", scene, "-o", &bare, "--no-splats"]).stdout;
    let said = String::from_utf8(said).unwrap();
    assert!(said.contains("no splats trained"), "{said}");
    succeeds(&["run", scene, "-o", &whole, "--iterations", "5"]);
    assert_eq!(heights(Path::new(&bare)), heights(Path::new(&whole)));
    assert!(Path::new(&bare).join("report.html").exists());

    refused(&["run", scene, "-o", &bare], 2, &["--no-splats was given, is none"]);
    refused(
        &["run", scene, "-o", &path("eogs"), "--no-splats", "--recipe", "eogs"],
        2,
        &["--no-splats", "best"],
    );
    refused(&["run", scene, "-o", &path("both"), "--no-splats", "--iterations", "5"], 2, &["--iterations"]);
}
