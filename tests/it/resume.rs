//! Trainings that are killed, interrupted, or find a checkpoint that is not theirs, through the binary.

use crate::common::{copy_folder, satgs, scenes, text};
use satgs::random::CounterRng;
use std::path::PathBuf;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Times that training is killed in the short and in the long test.
const FEW_KILLS: u64 = 4;
const MANY_KILLS: u64 = 20;
/// Opacities are reset at iteration 78; splats are doubled and removed once, at 100.
const ITERATIONS: &str = "130";
/// Longest time until a kill, as a part of the whole training: most of them find a checkpoint.
const LONGEST: f64 = 0.4;

/// Copies of an adjusted run, to be trained.
struct Runs {
    folder: tempfile::TempDir,
}

impl Runs {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    fn adjusted(&self, name: &str) -> Run {
        let folder = self.folder.path().join(name);
        copy_folder(scenes::adjusted_town(), &folder);
        Run { folder }
    }

    /// The results of an uninterrupted training, and how long it takes.
    fn uninterrupted(&self) -> ([Vec<u8>; 3], Duration) {
        let whole = self.adjusted("whole");
        let started = Instant::now();
        let output = whole.train(&[]);
        assert!(output.status.success(), "{}", text(&output));
        let lasts = started.elapsed();
        assert!(!whole.checkpoint().exists(), "a checkpoint is left of a complete training");
        (whole.result(), lasts)
    }
}

struct Run {
    folder: PathBuf,
}

impl Run {
    fn checkpoint(&self) -> PathBuf {
        self.folder.join("train/checkpoint.bin")
    }

    fn arguments<'a>(&'a self, more: &[&'a str]) -> Vec<&'a str> {
        let all = ["train", self.folder.to_str().unwrap(), "--recipe", "baeogs", "--iterations", ITERATIONS];
        [&all, more].concat()
    }

    fn train(&self, more: &[&str]) -> Output {
        satgs(&self.arguments(more))
    }

    fn start(&self, more: &[&str]) -> Child {
        let mut command = Command::new(env!("CARGO_BIN_EXE_satgs"));
        command.args(self.arguments(more)).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
    }

    /// Starts training and interrupts it (Ctrl-C) once there is a checkpoint.
    #[cfg(unix)]
    fn interrupted(&self) -> Output {
        let child = self.start(&["--checkpoint-every", "10"]);
        self.wait_for_checkpoint();
        let pid = child.id().to_string();
        assert!(Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
        child.wait_with_output().unwrap()
    }

    fn wait_for_checkpoint(&self) {
        let start = Instant::now();
        while !self.checkpoint().exists() {
            assert!(start.elapsed() < Duration::from_secs(120), "no checkpoint appears");
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Splats, cameras, and the log without its seconds.
    fn result(&self) -> [Vec<u8>; 3] {
        let read = |name: &str| std::fs::read(self.folder.join(name)).unwrap();
        let log = read("train/train.csv");
        let mut rows = csv::ReaderBuilder::new().has_headers(false).from_reader(log.as_slice());
        let rows: Vec<csv::StringRecord> = rows.records().map(Result::unwrap).collect();
        let seconds = rows[0].iter().position(|c| c == "seconds").unwrap();
        let mut others = csv::Writer::from_writer(Vec::new());
        for row in &rows {
            others
                .write_record(row.iter().enumerate().filter(|(k, _)| *k != seconds).map(|(_, c)| c))
                .unwrap();
        }
        [read("splats.ply"), read("cameras.json"), others.into_inner().unwrap()]
    }
}

/// Not by `assert_eq`, which would print megabytes.
fn assert_same(a: &[Vec<u8>; 3], b: &[Vec<u8>; 3]) {
    for (k, name) in ["splats.ply", "cameras.json", "train.csv"].iter().enumerate() {
        assert!(a[k] == b[k], "{name} differs from that of an uninterrupted training");
    }
}

#[test]
fn interrupted_trainings_give_the_same_bytes_and_foreign_checkpoints_are_reported() {
    let runs = Runs::new();
    let (expected, lasts) = runs.uninterrupted();
    killed(&runs, FEW_KILLS, lasts, &expected);
    interrupted(&runs, &expected);
    strange_checkpoints(&runs, &expected);
}

#[test]
#[ignore = "takes a minute"]
fn twenty_kills_of_a_training_do_not_change_a_byte() {
    let runs = Runs::new();
    let (expected, lasts) = runs.uninterrupted();
    killed(&runs, MANY_KILLS, lasts, &expected);
}

/// SIGKILL at random moments: the next start goes on. A training that ends before it is killed is compared, and
/// another begun.
fn killed(runs: &Runs, times: u64, lasts: Duration, expected: &[Vec<u8>; 3]) {
    let (mut kills, mut complete, mut resumed) = (0, 0, 0);
    let mut run = runs.adjusted("killed");
    while kills < times || complete == 0 {
        let resume: &[&str] = if run.checkpoint().exists() { &["--resume"] } else { &[] };
        resumed += resume.len();
        let mut child = run.start(&[&["--checkpoint-every", "7"], resume].concat());
        let moment = lasts.mul_f64(LONGEST * CounterRng::new(0, 0, kills, complete).uniform());
        let begun = Instant::now();
        while begun.elapsed() < moment && child.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_millis(1));
        }
        match child.try_wait().unwrap() {
            Some(status) => {
                assert!(status.success(), "{}", text(&child.wait_with_output().unwrap()));
                assert_same(&run.result(), expected);
                complete += 1;
                run = runs.adjusted(&format!("killed{complete}"));
            }
            None => {
                child.kill().unwrap();
                child.wait().unwrap();
                kills += 1;
            }
        }
    }
    assert!(resumed > 0, "no kill left a checkpoint behind");
}

#[cfg(unix)]
fn interrupted(runs: &Runs, expected: &[Vec<u8>; 3]) {
    let run = runs.adjusted("interrupted");
    let output = run.interrupted();
    assert_eq!(output.status.code(), Some(130), "{}", text(&output));
    assert!(text(&output).contains("hint: the same command continues"), "{}", text(&output));
    assert!(!run.folder.join("splats.ply").exists());
    let output = run.train(&["--resume"]);
    assert!(output.status.success() && text(&output).contains("continuing from"), "{}", text(&output));
    assert_same(&run.result(), expected);
}

#[cfg(not(unix))]
fn interrupted(_: &Runs, _: &[Vec<u8>; 3]) {}

fn strange_checkpoints(runs: &Runs, expected: &[Vec<u8>; 3]) {
    let run = runs.adjusted("strange");
    let output = run.train(&["--resume"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output).contains("checkpoint.bin` does not exist"), "{}", text(&output));

    let mut child = run.start(&["--checkpoint-every", "10"]);
    run.wait_for_checkpoint();
    child.kill().unwrap();
    child.wait().unwrap();

    // Another seed's checkpoint is refused by name, with --overwrite passed over.
    let output = run.train(&["--seed", "1"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output).contains("seed was 0, is 1"), "{}", text(&output));
    let output = run.train(&["--seed", "1", "--overwrite"]);
    assert!(output.status.success() && !text(&output).contains("going on"), "{}", text(&output));
    assert!(run.result()[0] != expected[0], "another seed trains the same splats");

    // One that is cut short is an error with --resume, else passed over with a warning.
    let run = runs.adjusted("cut");
    let mut child = run.start(&["--checkpoint-every", "10"]);
    run.wait_for_checkpoint();
    child.kill().unwrap();
    child.wait().unwrap();
    let bytes = std::fs::read(run.checkpoint()).unwrap();
    std::fs::write(run.checkpoint(), &bytes[..bytes.len() / 2]).unwrap();
    let output = run.train(&["--resume"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output).contains("is not a valid checkpoint: it is cut short"), "{}", text(&output));
    let output = run.train(&[]);
    assert!(output.status.success() && text(&output).contains("warning: "), "{}", text(&output));
    assert_same(&run.result(), expected);
}
