//! Runs of recipe `satgs`: the bytes of the colours, and what is refused.

use crate::common::{copy_folder, refused, succeeds};
use satgs::io::write_moved;
use satgs::pipeline::{PipelineError, TrainOptions, train};
use satgs::progress::{Event, Recorder};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Iterations of the training for heights; that of colours has half as many again.
const ITERATIONS: u32 = 40;
/// The iteration of colours that one training is interrupted at.
const INTERRUPTED_AT: u64 = 20;

/// A scene with a view that is held back, an adjusted run of it, and one that is trained.
struct Runs {
    folder: tempfile::TempDir,
}

impl Runs {
    fn new() -> Self {
        let runs = Self { folder: tempfile::tempdir().unwrap() };
        let (scene, adjusted, trained) = (runs.path("scene"), runs.path("adjusted"), runs.path("trained"));
        succeeds(&["simulate", &scene, "--views", "6", "--size", "140", "--held-out", "1", "-q"]);
        succeeds(&["ba", &scene, "-o", &adjusted, "-q"]);
        runs.copy("adjusted", "trained");
        runs.train("trained", &["--threads", "1"]);
        assert!(Path::new(&trained).join("appearance.safetensors").exists());
        runs
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap()
    }

    fn write(&self, name: &str, bytes: &[u8]) -> String {
        std::fs::write(self.path(name), bytes).unwrap();
        self.path(name)
    }

    fn copy(&self, from: &str, to: &str) {
        copy_folder(Path::new(&self.path(from)), Path::new(&self.path(to)));
    }

    fn train(&self, run: &str, more: &[&str]) {
        let (run, iterations) = (self.path(run), ITERATIONS.to_string());
        let train = ["train", &run, "--recipe", "satgs", "--iterations", &iterations, "-q"];
        succeeds(&[&train[..], more].concat());
    }
}

/// One scene for all checks: its training takes longer than they do.
#[test]
fn colours_are_kept_as_they_were_trained_and_what_is_damaged_or_unknown_is_refused() {
    let runs = Runs::new();
    an_interruption_and_the_number_of_threads_do_not_change_a_byte(&runs);
    scoring_a_view_does_not_change_the_colours(&runs);
    networks_of_others_are_refused_before_training(&runs);
    damaged_colours_and_those_of_other_splats_are_refused(&runs);
    an_aligned_run_keeps_its_colours(&runs);
    a_date_between_undated_views_is_refused_and_a_view_without_a_sun_is_rendered_without_shadows(&runs);
}

fn an_interruption_and_the_number_of_threads_do_not_change_a_byte(runs: &Runs) {
    runs.copy("adjusted", "interrupted");
    let trains_colors = AtomicBool::new(false);
    let progress = Recorder::cancelling(move |event| match event {
        Event::Started { total, .. } => {
            trains_colors.store(*total > u64::from(ITERATIONS), Ordering::Relaxed);
            false
        }
        Event::Advanced { done, .. } => trains_colors.load(Ordering::Relaxed) && *done >= INTERRUPTED_AT,
        _ => false,
    });
    let options =
        TrainOptions { recipe: "satgs".into(), iterations: Some(ITERATIONS), ..TrainOptions::default() };
    let interrupted = train(Path::new(&runs.path("interrupted")), &options, &progress);
    assert!(matches!(interrupted, Err(PipelineError::TrainingInterrupted { .. })), "{interrupted:?}");
    runs.train("interrupted", &["--threads", "2"]);
    for file in ["appearance.safetensors", "splats.ply"] {
        let [one, other] = ["trained", "interrupted"].map(|run| runs.bytes(&format!("{run}/{file}")));
        assert!(one == other, "{file}");
    }
}

fn scoring_a_view_does_not_change_the_colours(runs: &Runs) {
    let before = runs.bytes("trained/appearance.safetensors");
    succeeds(&["nvs-eval", &runs.path("trained"), "--protocol", "half"]);
    assert!(runs.bytes("trained/appearance.safetensors") == before);
}

fn networks_of_others_are_refused_before_training(runs: &Runs) {
    let colors = runs.bytes("trained/appearance.safetensors");
    let cut = runs.write("cut.safetensors", &colors[..colors.len() / 2]);
    let other = runs.path("trained/appearance.safetensors");
    let no_network = runs.write("cut.onnx", &std::fs::read("tests/data/tiny_features.onnx").unwrap()[..200]);
    let adjusted = runs.path("adjusted");
    let train = ["train", &adjusted, "--recipe", "satgs"];
    for (option, file, says) in [
        ("--lpips", &cut, "cut.safetensors"),
        ("--lpips", &other, "appearance.safetensors"),
        ("--features", &no_network, "cut.onnx"),
        ("--features", &other, "appearance.safetensors"),
    ] {
        refused(&[&train[..], &[option, file]].concat(), 2, &[says, "hint"]);
        assert!(!Path::new(&runs.path("adjusted/splats.ply")).exists());
    }
    refused(&["nvs-eval", &runs.path("trained"), "--lpips", &cut], 2, &["cut.safetensors", "hint"]);
}

fn damaged_colours_and_those_of_other_splats_are_refused(runs: &Runs) {
    runs.copy("trained", "damaged");
    let (run, picture) = (runs.path("damaged"), runs.path("picture.png"));
    let render = ["render", &run, "--view", "0,0", "-o", &picture];
    let colors = runs.bytes("trained/appearance.safetensors");
    runs.write("damaged/appearance.safetensors", &colors[..colors.len() / 2]);
    refused(&render, 2, &["appearance.safetensors", "hint"]);
    runs.write("damaged/appearance.safetensors", &colors);
    std::fs::copy(runs.path("damaged/train/splats.ply"), runs.path("damaged/splats.ply")).unwrap();
    refused(&render, 2, &["appearance.safetensors", "splats.ply"]);
}

fn an_aligned_run_keeps_its_colours(runs: &Runs) {
    runs.copy("trained", "aligned");
    let (run, reference) = (runs.path("aligned"), runs.path("elsewhere.tif"));
    succeeds(&["dsm", &run, "-q"]);
    write_moved(Path::new(&runs.path("aligned/dsm.tif")), Path::new(&reference), [4.0, -2.0, 5.0]).unwrap();
    let before = runs.bytes("aligned/splats.ply");
    succeeds(&["align", &run, "--to", &reference]);
    assert!(runs.bytes("aligned/splats.ply") != before, "the run was not moved");
    succeeds(&["render", &run, "--view", "0,0", "-o", &runs.path("picture.png")]);
    succeeds(&["dsm", &run, "-q"]);
}

fn a_date_between_undated_views_is_refused_and_a_view_without_a_sun_is_rendered_without_shadows(runs: &Runs) {
    let (run, picture) = (runs.path("trained"), runs.path("picture.png"));
    let render = ["render", &run, "--view", "0,0", "-o", &picture];
    succeeds(&[&render[..], &["--date", "2022-05-01"]].concat());
    refused(&[&render[..], &["--appearance", "NO_VIEW"]].concat(), 2, &["NO_VIEW", "VIEW_"]);

    runs.copy("scene", "undated");
    for name in (1..=5).map(|k| format!("undated/VIEW_{k:02}.tif")) {
        runs.write(
            &name,
            &renamed(&runs.bytes(&name), &["SUN_AZIMUTH", "SUN_ELEVATION", "ACQUISITION_TIME"]),
        );
    }
    let dark = runs.path("dark");
    succeeds(&["run", &runs.path("undated"), "-o", &dark, "--recipe", "satgs", "--iterations", "10", "-q"]);
    let render = ["render", &dark, "--view", "0,0", "-o", &picture];
    succeeds(&render);
    refused(&[&render[..], &["--date", "2022-05-01"]].concat(), 2, &["dark", "hint"]);
}

/// Bytes of a file with other keys in place of these, of the same length, so that a reader does not find them.
fn renamed(bytes: &[u8], keys: &[&str]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for key in keys {
        let found = bytes.windows(key.len()).position(|w| w == key.as_bytes());
        bytes[found.unwrap()] = b'X';
    }
    bytes
}
