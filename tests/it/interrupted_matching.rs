//! Matching that is interrupted keeps the views and pairs that are done, and ends with the same bytes.

use crate::common::{copy_folder, files, scenes, succeeds};
use satgs::pipeline::{
    AdjustOptions, ErrorKind, Outcome, PipelineError, PriorMapOptions, TrainOptions, adjust, prior_maps,
    train,
};
use satgs::prior::PriorMaker;
use satgs::progress::{Event, NoProgress, Progress, Recorder};
use satgs::scene::{self, ReadOptions};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Asks to stop once so many units of a stage are done.
fn stopping_in(stage: &'static str, units: u64) -> Recorder {
    let is_inside = AtomicBool::new(false);
    Recorder::cancelling(move |event| match event {
        Event::Started { stage: started, .. } => {
            is_inside.store(*started == stage, Ordering::Relaxed);
            false
        }
        Event::Advanced { done, .. } => *done == units && is_inside.load(Ordering::Relaxed),
        _ => false,
    })
}

/// Does `work`, which matches in `stage`, in the folder `whole` at once and in `broken` with an interruption after some units; what is
/// left of the matching is in the folder `matching` of these.
fn interrupted(
    [whole, broken]: [&Path; 2],
    (stage, units): (&'static str, u64),
    matching: &str,
    work: &dyn Fn(&Path, &dyn Progress) -> Result<(), PipelineError>,
) {
    work(whole, &NoProgress).unwrap();
    let stop = stopping_in(stage, units);
    let error = work(broken, &stop).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Interrupted, "{error}");
    assert!(miette::Diagnostic::help(&error).unwrap().to_string().contains("the same command continues"));
    assert!(stop.events().contains(&Event::Resumable(true)));
    // A view of which no other one sees a part is done without.
    let kept = files(&broken.join(matching)).len() as u64;
    assert!(2 * kept > units, "{kept} parts are kept");
    let rest = Recorder::default();
    work(broken, &rest).unwrap();
    let goes_on = |event: &Event| matches!(event, Event::Note(text) if text.starts_with("continuing from"));
    assert_eq!(rest.events().iter().filter(|event| goes_on(event)).count(), 1);
    assert!([whole, broken].iter().all(|run| !run.join(matching).exists()), "parts are left behind");
}

fn same(runs: [&Path; 2], names: &[&str]) {
    for name in names {
        let [whole, broken] = runs.map(|run| std::fs::read(run.join(name)).unwrap());
        assert!(whole == broken, "{name} differs from that of work that was not interrupted");
    }
}

#[test]
fn an_interrupted_search_of_tie_points_goes_on_with_keypoints_and_pairs() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, broken] = ["whole", "broken"].map(|name| folder.path().join(name));
    let town = scene::read(scenes::town(), &ReadOptions::default()).unwrap();
    let work = |run: &Path, progress: &dyn Progress| {
        adjust(&town, &AdjustOptions::default(), run, progress).map(|_| ())
    };
    interrupted([&whole, &broken], ("matching", 2), "ba/matching", &work);
    same([&whole, &broken], &["ba/tie_points.csv", "ba/points.laz", "ba/report.json", "scene.json"]);
}

/// Trains an adjusted run a little.
fn trained(run: &Path, progress: &dyn Progress) -> Result<(), PipelineError> {
    let options = TrainOptions { iterations: Some(4), ..TrainOptions::default() };
    train(run, &options, progress).map(|outcome| assert!(matches!(outcome, Outcome::Made(_))))
}

#[test]
fn interrupted_stereo_matching_goes_on_with_the_views_that_are_done() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, broken] = ["whole", "broken"].map(|name| folder.path().join(name));
    [&whole, &broken].into_iter().for_each(|run| copy_folder(scenes::adjusted_town(), run));
    interrupted([&whole, &broken], ("matching the surface", 2), "train/matching", &trained);
    same([&whole, &broken], &["train/first_surface.tif", "splats.ply", "cameras.json"]);
}

#[test]
fn an_interrupted_plane_sweep_goes_on_after_the_pass_that_is_done() {
    let folder = tempfile::tempdir().unwrap();
    let [town, whole, broken] = ["town", "whole", "broken"].map(|name| folder.path().join(name));
    let [of_town, of_run] = [&town, &whole].map(|path| path.to_str().unwrap());
    succeeds(&["simulate", of_town, "--size", "100", "--views", "7", "-q"]);
    succeeds(&["ba", of_town, "-o", of_run, "-q"]);
    copy_folder(&whole, &broken);
    interrupted([&whole, &broken], ("matching the surface", 1), "train/matching", &trained);
    same([&whole, &broken], &["train/first_surface.tif", "splats.ply", "cameras.json"]);
}

#[test]
fn interrupted_matching_of_photographs_goes_on_with_the_views_that_are_done() {
    let folder = tempfile::tempdir().unwrap();
    let [room, whole, broken] = ["room", "whole", "broken"].map(|name| folder.path().join(name));
    succeeds(&["simulate", room.to_str().unwrap(), "--room", "--views", "12", "--size", "64", "-q"]);
    let work = |maps: &Path, progress: &dyn Progress| {
        prior_maps(&room, &PriorMaker::Stereo, maps, &PriorMapOptions::default(), progress).map(|_| ())
    };
    // In the search at full resolution: ten views are matched three times.
    interrupted([&whole, &broken], ("matching photographs", 24), "matching", &work);
    let of = |maps: &Path| {
        let all = files(maps).into_iter();
        all.map(|(path, bytes)| (path.strip_prefix(maps).unwrap().to_path_buf(), bytes)).collect::<Vec<_>>()
    };
    assert!(of(&whole) == of(&broken), "maps differ from those of matching that was not interrupted");
}
