//! Whether cameras are those of their photographs: what the photographs say is told before a training.

use crate::common::{copy_folder, data_dir, refused, succeeds, text};
use satgs::io::write_png_rgb;
use satgs::perspective::{
    ColorRegistration, PerspectiveOptions, PerspectiveScene, PoseCheck, PoseFinding, TestViews,
};
use satgs::progress::NoProgress;
use satgs::simulate::{RoomOptions, StatedCamera, simulate_room};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Frames and columns and rows of each.
const FRAMES: usize = 30;
const SIZE: usize = 400;

/// A room with RGB-D frames.
fn room(stated: StatedCamera) -> tempfile::TempDir {
    let out = tempfile::tempdir().unwrap();
    let options =
        RoomOptions { views: FRAMES, size_px: SIZE, frames: Some(stated), ..RoomOptions::default() };
    simulate_room(out.path(), &options, &NoProgress).unwrap();
    out
}

/// A copy of frames of one camera, which a test changes.
fn frames() -> tempfile::TempDir {
    static ROOM: OnceLock<tempfile::TempDir> = OnceLock::new();
    let copy = tempfile::tempdir().unwrap();
    copy_folder(&ROOM.get_or_init(|| room(StatedCamera::Registered)).path().join("frames"), copy.path());
    copy
}

fn file(frames: &Path, i: usize, end: &str) -> PathBuf {
    frames.join(format!("frame-{i:06}.{end}"))
}

fn exchange(a: &Path, b: &Path) {
    let aside = a.with_extension("aside");
    std::fs::rename(a, &aside).unwrap();
    std::fs::rename(b, a).unwrap();
    std::fs::rename(aside, b).unwrap();
}

/// The matrix of a frame's pose, and its file with another one.
fn pose(frames: &Path, i: usize) -> glam::DMat4 {
    let text = std::fs::read_to_string(file(frames, i, "pose.txt")).unwrap();
    let values: Vec<f64> = text.split_whitespace().map(|v| v.parse().unwrap()).collect();
    glam::DMat4::from_cols_slice(&values).transpose()
}

fn set_pose(frames: &Path, i: usize, pose: glam::DMat4) {
    let rows = [0, 1, 2, 3].map(|k| pose.row(k).to_array().map(|v| v.to_string()).join(" "));
    std::fs::write(file(frames, i, "pose.txt"), rows.join("\n")).unwrap();
}

fn read(scene: &Path) -> PerspectiveScene {
    PerspectiveScene::read(scene, &PerspectiveOptions { test_views: TestViews::None, ..Default::default() })
        .unwrap()
}

fn check(scene: &Path) -> PoseCheck {
    let scene = read(scene);
    PoseCheck::of(&scene.views, &scene.points)
}

fn path(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A COLMAP model whose focal length is changed says so by its points, even where the photographs cannot.
#[test]
fn a_model_that_was_changed_after_the_reconstruction_is_named() {
    let out = tempfile::tempdir().unwrap();
    let options = RoomOptions { views: 8, size_px: 128, ..RoomOptions::default() };
    simulate_room(out.path(), &options, &NoProgress).unwrap();
    let told = "from where its images observe them";
    assert!(!text(&succeeds(&["info", path(out.path())])).contains(told));
    let cameras = out.path().join("sparse/0/cameras.txt");
    let wrong = std::fs::read_to_string(&cameras).unwrap().replace(" 91.4", " 115.4");
    std::fs::write(&cameras, wrong).unwrap();
    assert!(text(&succeeds(&["info", path(out.path())])).contains(told));
}

/// What `satgs run` says of a scene before five iterations.
fn run(scene: &Path) -> String {
    let out = tempfile::tempdir().unwrap();
    let run = out.path().join("run");
    let options = ["--iterations", "5", "--test-views", "none"];
    text(&succeeds(&[&["run", path(scene), "-o", path(&run)][..], &options].concat()))
}

fn run_is_refused(scene: &Path, says: &[&str]) {
    let out = tempfile::tempdir().unwrap();
    let run = out.path().join("run");
    refused(&["run", path(scene), "-o", path(&run), "--iterations", "5", "--test-views", "none"], 2, says);
}

#[test]
fn right_cameras_have_small_residuals_and_no_findings() {
    let frames = frames();
    let found = check(frames.path());
    assert_eq!(found.findings, []);
    assert!(found.pairs >= FRAMES && found.median_px.unwrap() < 0.5, "{found:?}");
    let said = String::from_utf8_lossy(&succeeds(&["info", path(frames.path())]).stdout).into_owned();
    assert!(said.contains("(median) from their epipolar lines, those of `frame-"), "{said}");
}

#[test]
fn a_wrong_focal_length_is_named_with_the_right_one() {
    let frames = frames();
    let intrinsics = frames.path().join("camera-intrinsics.txt");
    let stated = std::fs::read_to_string(&intrinsics).unwrap();
    let focal: f64 = stated.split_whitespace().next().unwrap().parse().unwrap();
    for factor in [1.1, 0.93] {
        let wrong = (factor * focal).to_string();
        std::fs::write(&intrinsics, stated.replace(&focal.to_string(), &wrong)).unwrap();
        match check(frames.path()).findings.as_slice() {
            [PoseFinding::Focal { factor: found, px: [stated, fitted] }] => {
                assert!((found * factor - 1.0).abs() < 0.02 && fitted < stated, "{found} of {factor}");
            }
            other => panic!("{other:?}"),
        }
    }
    let said = run(frames.path());
    assert!(said.contains("warning: the photographs have 1.0") && said.contains("resampled?"), "{said}");
}

#[test]
fn poses_in_another_convention_are_refused_before_the_training() {
    let frames = frames();
    let poses: Vec<glam::DMat4> = (0..FRAMES).map(|i| pose(frames.path(), i)).collect();
    (0..FRAMES).for_each(|i| set_pose(frames.path(), i, poses[i].inverse()));
    run_is_refused(frames.path(), &["the poses contradict the photographs", "their matrices are inverted"]);
    let axes = |signs: [f64; 3]| glam::DMat4::from_scale(glam::DVec3::from_array(signs));
    // Camera axes right, up, backward, as in a transforms.json.
    (0..FRAMES).for_each(|i| set_pose(frames.path(), i, poses[i] * axes([1.0, -1.0, -1.0])));
    run_is_refused(frames.path(), &["taken as right, up, backward", "docs/conventions.md"]);
    // A left-handed world whose y axis goes up.
    let mirror = axes([1.0, -1.0, 1.0]);
    (0..FRAMES).for_each(|i| set_pose(frames.path(), i, mirror * poses[i] * mirror));
    run_is_refused(frames.path(), &["a mirrored frame, as "]);
}

#[test]
fn exchanged_images_are_named() {
    let frames = frames();
    exchange(&file(frames.path(), 2, "color.png"), &file(frames.path(), 10, "color.png"));
    let said = run(frames.path());
    let expected = "the images of `frame-000002` and `frame-000010` are swapped";
    assert!(said.contains(expected) && said.contains("exchange the names of their files"), "{said}");
}

#[test]
fn an_image_of_another_place_is_named() {
    let frames = frames();
    let mut draw = satgs::random::CounterRng::new(1, 0, 0, 0);
    let boards: Vec<u8> = (0..(SIZE / 8 + 1).pow(2)).map(|_| (255.0 * draw.uniform()) as u8).collect();
    let cell = |k: usize| boards[k / SIZE / 8 * (SIZE / 8 + 1) + k % SIZE / 8];
    let picture: Vec<u8> = (0..SIZE * SIZE).flat_map(|k| [cell(k); 3]).collect();
    write_png_rgb(&file(frames.path(), 5, "color.png"), SIZE, SIZE, &picture).unwrap();
    let said = run(frames.path());
    assert!(said.contains("`frame-000005` shows nothing that the"), "{said}");
}

#[test]
fn one_view_says_nothing_about_depths() {
    let frames = frames();
    (1..FRAMES).for_each(|i| std::fs::remove_file(file(frames.path(), i, "pose.txt")).unwrap());
    let said = run(frames.path());
    assert!(said.contains("warning: there is one view to train on"), "{said}");
}

fn registration(stated: StatedCamera) -> Option<ColorRegistration> {
    let room = room(stated);
    let scene = read(&room.path().join("frames"));
    assert_eq!(scene.rejected_registration, None);
    scene.registration
}

#[test]
fn frames_that_are_registered_keep_their_camera() {
    let frames = frames();
    let scene = read(frames.path());
    assert_eq!((scene.registration, scene.rejected_registration), (None, None));
}

#[test]
fn the_colour_camera_of_frames_that_state_the_depth_camera_is_found() {
    let found = registration(StatedCamera::Depth).expect("two cameras");
    assert!((1.1 * found.focal_ratio - 1.0).abs() < 0.02 && found.depth_focal_ratio == 1.0, "{found:?}");
    let [stated, fitted] = found.evidence.epipolar_px.unwrap();
    assert!(fitted < 0.5 * stated && (found.offset_m[0] + 0.025).abs() < 0.02, "{found:?}");
}

#[test]
fn the_depth_camera_of_frames_that_state_the_colour_camera_is_found() {
    let found = registration(StatedCamera::Color).expect("two cameras");
    assert!((found.depth_focal_ratio / 1.1 - 1.0).abs() < 0.02 && found.focal_ratio == 1.0, "{found:?}");
    let [stated, fitted] = found.evidence.carried_px.unwrap();
    assert!(fitted < 0.7 * stated, "{found:?}");
}

/// Real scenes are not accused; prints their residuals.
#[test]
fn real_scenes_have_no_findings() {
    let Some(data) = data_dir() else { return };
    for name in ["perspective/lightfield", "perspective/fox9", "strecha/herzjesu-P8"] {
        let found = check(&data.join(name));
        println!("{name}: {found}");
        assert_eq!(found.findings, [], "{name}");
        assert!(found.median_px.unwrap() < 1.5, "{name}: {found:?}");
    }
}

/// A grey JPEG whose EXIF states an orientation.
fn jpeg_with_orientation(path: &Path, (width, height): (usize, usize), gray: Vec<u8>, orientation: u8) {
    let memory = gdal::DriverManager::get_driver_by_name("MEM").unwrap();
    let dataset = memory.create_with_band_type::<u8, _>("", width, height, 1).unwrap();
    let mut buffer = gdal::raster::Buffer::new((width, height), gray);
    dataset.rasterband(1).unwrap().write((0, 0), (width, height), &mut buffer).unwrap();
    let jpeg = gdal::DriverManager::get_driver_by_name("JPEG").unwrap();
    drop(dataset.create_copy(&jpeg, path, &gdal::raster::RasterCreationOptions::default()).unwrap());
    let bytes = std::fs::read(path).unwrap();
    // A big-endian TIFF directory with one entry: tag 0x0112, one short number.
    let entry = [&b"\x01\x12\0\x03\0\0\0\x01\0"[..], &[orientation, 0, 0]].concat();
    let tiff = [&b"Exif\0\0MM\0*\0\0\0\x08\0\x01"[..], &entry, &[0; 4]].concat();
    let length = (tiff.len() + 2) as u16;
    let exif = [&[0xFF, 0xE1][..], &length.to_be_bytes(), &tiff].concat();
    std::fs::write(path, [&bytes[..2], &exif, &bytes[2..]].concat()).unwrap();
}

#[test]
fn a_photograph_is_turned_as_its_exif_says_if_its_camera_is_of_the_displayed_one() {
    let (width, height) = (48, 32);
    let scene = tempfile::tempdir().unwrap();
    let read = |orientation: u8, [w, h]: [usize; 2]| {
        // Stored: the first rows are bright.
        let gray = (0..width * height).map(|k| if k / width < 8 { 250 } else { 20 }).collect();
        jpeg_with_orientation(&scene.path().join("a.jpg"), (width, height), gray, orientation);
        let pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];
        let json = serde_json::json!({
            "w": w, "h": h, "fl_x": 40.0, "cx": w as f64 / 2.0, "cy": h as f64 / 2.0,
            "frames": [{ "file_path": "a.jpg", "transform_matrix": pose }],
        });
        std::fs::write(scene.path().join("transforms.json"), json.to_string()).unwrap();
        PerspectiveScene::read(scene.path(), &PerspectiveOptions::default())
    };
    let plane =
        |orientation, size| read(orientation, size).unwrap().views[0].read_image().unwrap().planes[0].clone();
    // A camera of the stored image sees it as stored, whatever EXIF says.
    for orientation in [1, 6] {
        let stored = plane(orientation, [48, 32]);
        assert!(stored.width == 48 && stored.at(24, 2) > 0.9 && stored.at(24, 29) < 0.2);
    }
    // Turned clockwise, the first rows are the last columns; counter-clockwise the first ones.
    let (right, left) = (plane(6, [32, 48]), plane(8, [32, 48]));
    assert!(right.width == 32 && right.at(29, 24) > 0.9 && right.at(2, 24) < 0.2);
    assert!(left.width == 32 && left.at(2, 24) > 0.9 && left.at(29, 24) < 0.2);
    let refused = read(1, [32, 48]).unwrap_err().to_string();
    assert!(refused.contains("48 x 32 pixels") && refused.contains("32 x 48"), "{refused}");
}

/// The values of a column of a run's log.
fn logged(run: &Path, column: &str) -> Vec<f64> {
    let log = std::fs::read_to_string(run.join("train/train.csv")).unwrap();
    let place = log.lines().next().unwrap().split(',').position(|name| name == column).unwrap();
    log.lines().skip(1).map(|line| line.split(',').nth(place).unwrap().parse().unwrap()).collect()
}

#[test]
fn a_scene_in_map_coordinates_trains_as_at_the_origin() {
    let frames = frames();
    let out = tempfile::tempdir().unwrap();
    let train = |name: &str| {
        let run = out.path().join(name);
        let options = ["--iterations", "5", "--test-views", "none", "--downsampling", "4"];
        let said = text(&succeeds(&[&["run", path(frames.path()), "-o", path(&run)][..], &options].concat()));
        (logged(&run, "l1"), said)
    };
    let (here, _) = train("here");
    let far = glam::DMat4::from_translation(glam::DVec3::new(500_000.0, 4_000_000.0, 100.0));
    (0..FRAMES).for_each(|i| set_pose(frames.path(), i, far * pose(frames.path(), i)));
    let (there, said) = train("there");
    assert_eq!(here.len(), there.len());
    assert!(here.iter().zip(&there).all(|(a, b)| (a - b).abs() < 1e-3 * a), "{here:?} {there:?}");
    assert!(said.contains("positions are those of the file less ("), "{said}");
}

#[test]
fn lists_name_images_of_one_file_name_by_their_folders() {
    let scene = tempfile::tempdir().unwrap();
    let pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];
    let frame = |name: &str| {
        std::fs::create_dir_all(scene.path().join(name).parent().unwrap()).unwrap();
        write_png_rgb(&scene.path().join(name), 8, 8, &[90; 192]).unwrap();
        serde_json::json!({ "file_path": name, "transform_matrix": pose })
    };
    let frames = ["left/1.png", "right/1.png", "right/2.png"].map(frame);
    let json = serde_json::json!({ "w": 8, "h": 8, "fl_x": 9.0, "frames": frames });
    std::fs::write(scene.path().join("transforms.json"), json.to_string()).unwrap();
    let list = scene.path().join("test.txt");
    let tests = |line: &str| {
        std::fs::write(&list, line).unwrap();
        let options = PerspectiveOptions { test_views: TestViews::List(list.clone()), ..Default::default() };
        let read = PerspectiveScene::read(scene.path(), &options).map_err(|e| e.to_string())?;
        let is_test = |v: &&satgs::perspective::PerspectiveView| v.role == satgs::scene::Role::Test;
        Ok::<_, String>(read.views.iter().filter(is_test).map(|v| v.name.clone()).collect::<Vec<_>>())
    };
    assert_eq!(tests("right/1.png").unwrap(), ["right_1"]);
    assert_eq!(tests("left/1").unwrap(), ["left_1"]);
    assert_eq!(tests("2.png").unwrap(), ["right_2"]);
    assert!(tests("1.png").unwrap_err().contains("of several images"));
}
