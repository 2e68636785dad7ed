//! The pipeline as a library: every stage of a tiny scene, without the command line.

use crate::common::scenes;
use satgs::pipeline::{
    AdjustOptions, AlignOptions, DsmOptions, ErrorKind, EvaluateOptions, NvsOptions, Outcome, PipelineError,
    RenderOptions, RunLock, TrainOptions, TrainedCameras, adjust, align, dsm, evaluate, nvs_eval, render,
    train,
};
use satgs::progress::{Event, NoProgress, Recorder};
use satgs::run::{RunOptions, StageResult, run};
use satgs::run_files::{CAMERAS, CHECKPOINT, DSM, PAGE, SPLATS, TRAIN_STAGE};
use satgs::scene::{self, ReadOptions, Scene};
use std::path::{Path, PathBuf};

const ITERATIONS: u32 = 40;

struct Town {
    folder: tempfile::TempDir,
    scene: Scene,
}

impl Town {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let scene = scene::read(scenes::town(), &ReadOptions::default()).unwrap();
        Self { folder, scene }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn truth(&self) -> PathBuf {
        scenes::town().join("truth/TOWN_DSM.tif")
    }
}

fn training() -> TrainOptions {
    TrainOptions { recipe: "baeogs".into(), iterations: Some(ITERATIONS), ..TrainOptions::default() }
}

fn bytes(run: &Path, name: &str) -> Vec<u8> {
    std::fs::read(run.join(name)).unwrap()
}

#[test]
fn stages_give_the_same_bytes_after_an_interruption() {
    let town = Town::new();
    let (whole, broken) = (town.path("whole"), town.path("broken"));

    // All at once, uninterrupted.
    let options = RunOptions { train: training(), truth: Some(town.truth()), ..RunOptions::default() };
    let mut stages = Vec::new();
    run(town.scene.clone().into(), &options, &whole, &NoProgress, &mut |stage| stages.push(stage)).unwrap();
    assert!(matches!(
        &stages[..],
        [
            StageResult::Adjusted(_),
            StageResult::Trained(Outcome::Made(_)),
            StageResult::Dsm(Outcome::Made(_)),
            StageResult::Evaluated(_),
            StageResult::Reported(_),
        ]
    ));
    assert!(whole.join(PAGE).exists() && !whole.join(".lock").exists());

    // Stage by stage; training is asked to stop once and then goes on.
    let adjusted = adjust(&town.scene, &AdjustOptions::default(), &broken, &NoProgress).unwrap();
    assert!(adjusted.left_out().is_empty() && !adjusted.was_complete);
    let again = adjust(&town.scene, &AdjustOptions::default(), &broken, &NoProgress).unwrap();
    assert!(again.was_complete && again.report == adjusted.report && again.seconds == adjusted.seconds);

    let progress = Recorder::cancelling(|e| matches!(e, Event::Advanced { done: 20, .. }));
    let stopped = train(&broken, &training(), &progress).unwrap_err();
    let PipelineError::TrainingInterrupted { iterations, .. } = &stopped else { panic!("{stopped}") };
    assert!((20..ITERATIONS as usize).contains(iterations), "{stopped}");
    assert_eq!(stopped.kind(), ErrorKind::Interrupted);
    assert!(broken.join(TRAIN_STAGE).join(CHECKPOINT).exists() && !broken.join(SPLATS).exists());
    let refused =
        align(&broken, &AlignOptions { reference: town.truth(), ..AlignOptions::default() }, &NoProgress);
    assert!(matches!(refused, Err(PipelineError::TrainingIncomplete { .. })));

    let Outcome::Made(trained) = train(&broken, &training(), &NoProgress).unwrap() else { panic!("kept") };
    assert_eq!(trained.iterations, ITERATIONS);
    let kept = train(&broken, &training(), &NoProgress).unwrap();
    assert_eq!(kept, Outcome::Kept(Some(trained)));
    let other = TrainOptions { seed: 1, ..training() };
    let refused = train(&broken, &other, &NoProgress).unwrap_err();
    let PipelineError::Changed { differences, .. } = &refused else { panic!("{refused}") };
    assert_eq!((differences.as_str(), refused.kind()), ("--seed was 0, is 1", ErrorKind::Input));

    let options = DsmOptions { mesh: Some("dsm.glb".into()), ..DsmOptions::default() };
    assert!(matches!(dsm(&broken, &options, &NoProgress).unwrap(), Outcome::Made(_)));
    assert!(broken.join("dsm.glb").exists());
    for name in [SPLATS, CAMERAS, DSM] {
        // Not by `assert_eq`, which would print all of it.
        assert!(bytes(&whole, name) == bytes(&broken, name), "{name} differs after an interruption");
    }

    let scoring = EvaluateOptions::default();
    let scores =
        evaluate(&broken.join(DSM), &town.truth(), &scoring, Some(&broken.join("eval")), &NoProgress);
    assert!(serde_json::to_value(scores.unwrap()).unwrap()["land_cells"].as_u64().unwrap() > 0);
    let refused =
        evaluate(&broken.join(DSM), &town.truth(), &scoring, Some(&broken.join("eval")), &NoProgress);
    assert!(matches!(refused, Err(PipelineError::Exists { .. })));

    let cameras = TrainedCameras::read(&broken).unwrap();
    let view = cameras.setup.views[0].name.clone();
    let image = town.path("nadir.png");
    let rendered = render(&broken, &image, &RenderOptions::default(), &NoProgress).unwrap();
    assert!(rendered.frames == 1 && image.exists());
    assert!(matches!(nvs_eval(&broken, &NvsOptions::default(), &NoProgress), Err(PipelineError::NoTestView)));
    let scores =
        nvs_eval(&broken, &NvsOptions { views: vec![view], ..NvsOptions::default() }, &NoProgress).unwrap();
    assert!(scores.views[0].score.psnr_db > 5.0);
}

#[test]
fn a_run_folder_is_locked_during_a_call() {
    let folder = tempfile::tempdir().unwrap();
    let lock = RunLock::make(folder.path()).unwrap();
    let refused = train(folder.path(), &training(), &NoProgress).unwrap_err();
    assert!(matches!(refused, PipelineError::Locked { .. }), "{refused}");
    drop(lock);
    let refused = train(folder.path(), &training(), &NoProgress).unwrap_err();
    assert!(matches!(refused, PipelineError::RunFile { .. }), "{refused}");
}

#[test]
fn options_out_of_range_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let none = TrainOptions { iterations: Some(0), ..training() };
    let refused = none.recipe().unwrap_err().to_string();
    assert!(refused.contains("--iterations"), "{refused}");
    let flat = DsmOptions { resolution_m: 0.0, ..DsmOptions::default() };
    let refused = flat.check(folder.path()).unwrap_err().to_string();
    assert!(refused.contains("--resolution"), "{refused}");
}
