//! Wrong input of the first hour: each error names the next step that works.

use crate::common::scenes::town;
use crate::common::{copy_folder, image, refused, satgs, text, two_views};
use std::path::Path;
use std::process::Command;

/// A folder with these files, which have no content that could be read.
fn folder(files: &[&str]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for file in files {
        let path = folder.path().join(file);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, "x").unwrap();
    }
    folder
}

fn name(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Refusals of a scene by `satgs info` and by `satgs run`, which are the same.
fn refused_scene(scene: &Path, says: &[&str]) {
    let run = tempfile::tempdir().unwrap();
    let of_info = refused(&["info", name(scene)], 2, says);
    let of_run = refused(&["run", name(scene), "-o", name(&run.path().join("run"))], 2, says);
    let last_two = |said: &str| said.lines().rev().take(2).map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(last_two(&of_info), last_two(&of_run));
}

#[test]
fn photographs_without_poses_are_sent_to_colmap() {
    let says = ["2 photographs without the poses", "colmap automatic_reconstructor", "satgs run WORK -o RUN"];
    for files in [["a.jpg", "b.JPG"], ["images/1.png", "images/2.jpeg"]] {
        let photographs = folder(&files);
        let poses = format!("`satgs-poses {} -o SCENE`", photographs.path().display());
        refused_scene(
            photographs.path(),
            &[&says[..], &[poses.as_str(), "pip install './python[poses]'"]].concat(),
        );
    }
    let one = folder(&["a.jpg"]);
    refused_scene(&one.path().join("a.jpg"), &["a photograph without the pose", "colmap"]);
    // Commands that need photographs say the same.
    let prior = ["prior", name(one.path()), "-o", "out", "--command", "cmd {image} {out}"];
    refused(&prior, 2, &["photograph", "colmap automatic_reconstructor"]);
}

#[test]
fn a_video_is_sent_to_ffmpeg_and_colmap() {
    let one = folder(&["walk.mp4"]);
    for scene in [one.path().join("walk.mp4"), one.path().to_path_buf()] {
        refused_scene(
            &scene,
            &["`walk.mp4` is a video", "ffmpeg -i", "walk.mp4", "colmap automatic_reconstructor"],
        );
    }
}

#[test]
fn the_path_that_reads_an_archive_in_place_is_named_and_works() {
    let place = tempfile::tempdir().unwrap();
    copy_folder(town(), &place.path().join("town"));
    let archive = place.path().join("town.tar");
    let tar = ["-cf", name(&archive), "-C", name(place.path()), "town"];
    assert!(Command::new("tar").args(tar).status().unwrap().success());
    let inside = format!("/vsitar/{}/town", archive.display());
    refused_scene(&archive, &["`town.tar` is an archive", &inside]);
    let output = satgs(&["info", &inside]);
    assert!(output.status.success(), "{}", text(&output));
    let other = folder(&["a.rar"]);
    refused_scene(&other.path().join("a.rar"), &["is an archive", "unpack it"]);
}

#[test]
fn a_scene_one_folder_deeper_is_named() {
    let place = tempfile::tempdir().unwrap();
    copy_folder(two_views().path(), &place.path().join("delivery"));
    let inner = place.path().join("delivery");
    refused_scene(place.path(), &["no images found", &format!("give `{}`", inner.display())]);
}

#[test]
fn swapped_longitude_and_latitude_are_recognised() {
    let place = two_views();
    let swapped = ["info", name(place.path()), "--aoi", "43.2598,5.4397,43.2602,5.4403"];
    refused(&swapped, 2, &["no view sees the area", "longitude and latitude are swapped"]);
    let elsewhere = ["info", name(place.path()), "--aoi", "6.1,44.1,6.2,44.2"];
    let error = refused(&elsewhere, 2, &["no view sees the area", "lists the footprints"]);
    assert!(!error.contains("swapped"), "{error}");
}

#[test]
fn heights_outside_of_those_of_the_rpcs_are_refused_or_warned_of() {
    // The RPCs are made for 50 to 150 m.
    let place = two_views();
    let info = |range: &str| {
        satgs(&["ba", name(place.path()), "-o", name(&place.path().join("run")), "--height-range", range])
    };
    let far = text(&info("3000,3100"));
    assert!(
        far.contains("--height-range 3000,3100 lies outside of the heights of the RPCs, 50 to 150 m"),
        "{far}"
    );
    assert!(far.contains("above the ellipsoid") && far.contains("--dem"), "{far}");
    let near = text(&info("0,40"));
    assert!(near.contains("warning: --height-range 0,40 lies outside of the heights of the RPCs"), "{near}");
    assert!(!text(&info("40,60")).contains("lies outside of the heights"));
}

#[test]
fn the_names_of_recipes_are_listed() {
    let run = tempfile::tempdir().unwrap();
    let words = ["run", name(town()), "-o", name(run.path()), "--recipe", "bset"];
    refused(&words, 2, &["recipe `bset` is neither", "best, baeogs", "3dgs", "--print-recipe"]);
}

#[test]
fn a_single_simulated_view_is_refused() {
    let out = tempfile::tempdir().unwrap();
    refused(&["simulate", name(out.path()), "--views", "1"], 2, &["expected 2 to 99"]);
}

#[test]
fn a_picture_is_no_surface_model() {
    let place = two_views();
    let picture = place.path().join("picture.tif");
    let (width, height) = (40, 30);
    let grid =
        satgs::io::MapGrid { epsg: 32631, west: 697_900.0, north: 4_793_000.0, cell: 0.5, width, height };
    let cog = satgs::io::Cog { grid, metadata: &[], heights_from: None };
    cog.write_u8(&picture, vec![vec![90; width * height]; 3], Some(0.0)).unwrap();
    let heights = satgs::io::Grid2::from_fn(width, height, |col, row| (col / 9 + row / 7) as f32);
    let dsm = place.path().join("dsm.tif");
    cog.write_f32(&dsm, &[("height", "m", &heights)]).unwrap();
    for (prediction, truth) in [(&picture, &dsm), (&dsm, &picture)] {
        let words = ["dsm-eval", name(prediction), name(truth)];
        refused(&words, 2, &["picture.tif` holds no heights: its first of 3 bands holds colours", "dsm.tif"]);
    }
    // Before a long run, too.
    let run = place.path().join("run");
    let words = ["run", name(place.path()), "-o", name(&run), "--truth", name(&picture)];
    refused(&words, 2, &["picture.tif` holds no heights"]);
    let scene = place.path().join("scene");
    std::fs::create_dir(&scene).unwrap();
    image(&scene.join("a.tif"), 1, Some(&crate::common::camera(5.44, 0.2)), &[]);
    image(&scene.join("b.tif"), 2, Some(&crate::common::camera(5.44, -0.2)), &[]);
    let words =
        ["ba", name(&scene), "-o", name(&run), "--dem", name(&picture), "--dem-vertical", "ellipsoid"];
    refused(&words, 2, &["picture.tif` holds no heights"]);
}

#[test]
fn a_changed_option_names_the_command_that_makes_the_run_anew() {
    let place = two_views();
    let run = place.path().join("run");
    std::fs::create_dir_all(run.join("ba")).unwrap();
    let record = r#"{"satgs": "0", "command": "satgs ba", "made_from": {"--model": "affine"}}"#;
    std::fs::write(run.join("ba/stage.json"), record).unwrap();
    let words = ["ba", name(place.path()), "-o", name(&run)];
    refused(&words, 2, &["--model was affine", "satgs run … --overwrite", "another -o keeps both"]);
}

#[test]
fn tie_points_outside_of_the_heights_to_search_are_warned_of() {
    // The ground of the town lies from 150 m on.
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let ba = |range: &str| {
        text(&satgs(&["ba", "data/town", "-o", name(&run), "--height-range", range, "--overwrite"]))
    };
    let said = ba("100,150");
    assert!(said.contains("tie points lie outside of the heights to search, 100 to 150 m"), "{said}");
    assert!(!ba("140,190").contains("lie outside"));
}
