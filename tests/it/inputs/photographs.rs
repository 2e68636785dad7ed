//! Photographs: layouts of scenes, masks, depths, priors, units.

use super::input;
use crate::common::{copy_folder, refused, succeeds, text};
use satgs::io::{Grid2, Planes, RgbImage, write_png_gray};
use satgs::mesh::TriangleMesh;
use satgs::perspective::{PerspectiveOptions, PerspectiveScene, TestViews, Transparency};
use satgs::scene::Role;
use std::path::{Path, PathBuf};

pub const FOLDERS: &[&str] = &[
    "alpha-ignored",
    "alpha_band_ignored",
    "blender-folder",
    "depth-32-bit-integers",
    "mask-palette",
    "masks-leave-no-pixel",
    "mesh-of-room-transforms",
    "mesh-text-of-other-programs",
    "prior-in-sub-folders",
    "rgba-means-empty",
    "transforms-ply-ignored",
    "transforms-splits-ignored",
    "usual-but-refused",
];

fn read(path: &Path) -> PerspectiveScene {
    PerspectiveScene::read(path, &PerspectiveOptions::default()).unwrap()
}

fn names(scene: &PerspectiveScene, role: Role) -> Vec<&str> {
    scene.views.iter().filter(|v| v.role == role).map(|v| v.name.as_str()).collect()
}

fn path_text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// What `satgs info` says of a scene.
fn info(path: &Path) -> String {
    output(&["info", path_text(path)])
}

/// What a command that succeeds writes to standard output.
fn output(args: &[&str]) -> String {
    String::from_utf8(succeeds(args).stdout).unwrap()
}

/// Trains a scene for some iterations; returns what the command says, and the folder with the run.
fn trained(scene: &Path, iterations: &str, options: &[&str]) -> (String, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let args =
        [&["run", path_text(scene), "-o", path_text(&run), "--iterations", iterations], options].concat();
    (text(&succeeds(&args)), folder)
}

/// A copy of an input that a test changes.
fn copy_of(name: &str) -> Option<tempfile::TempDir> {
    let folder = tempfile::tempdir().unwrap();
    copy_folder(&input(name)?, folder.path());
    Some(folder)
}

/// Share of the cells that have a value.
fn known_share(plane: &Grid2) -> f64 {
    plane.valid().count() as f64 / plane.data.len() as f64
}

#[test]
fn transparent_pixels_of_transforms_are_empty_and_those_of_other_layouts_unknown() {
    let Some(scene) = input("rgba-means-empty") else { return };
    let as_usual = read(&scene);
    assert_eq!(as_usual.transparency(), Some((16, Transparency::Empty)));
    assert!(info(&scene).contains("transparent pixels of 16 images are empty"), "{}", info(&scene));
    let image = as_usual.views[3].read_image().unwrap();
    let opacity = image.opacity.as_ref().unwrap();
    assert!(
        image.planes[0].valid().count() == 64 * 64
            && opacity.at(0, 0) == 0.0
            && image.planes[1].at(0, 0) == 0.0
    );
    assert!(opacity.at(32, 32) == 1.0 && image.is_empty_at(0) && image.shows_surface(32 * 64 + 32));

    let options =
        PerspectiveOptions { transparency: Some(Transparency::Unknown), ..PerspectiveOptions::default() };
    let unknown = PerspectiveScene::read(&scene, &options).unwrap();
    let image = unknown.views[3].read_image().unwrap();
    assert!(
        image.opacity.is_none() && image.planes[0].at(0, 0).is_nan() && !image.planes[0].at(32, 32).is_nan()
    );
    let says = output(&["info", path_text(&scene), "--transparent", "unknown"]);
    assert!(says.contains("transparent pixels of 16 images are left out"), "{says}");
}

#[test]
fn nothing_begins_where_images_are_empty() {
    let Some(scene) = input("rgba-means-empty") else { return };
    let (says, folder) = trained(&scene, "5", &[]);
    assert!(says.contains("transparent pixels of 16 images are empty"), "{says}");
    let run = folder.path().join("run");
    // Of splats that begin at random places on the rays of the images those are left that all views show on the sphere of radius 1.
    let splats = satgs::splat::ply::read(&run.join("splats.ply")).unwrap();
    let is_near = |p: &&[f32; 3]| p[0].hypot(p[1]).hypot(p[2]) < 1.3;
    let near = splats.position.iter().filter(is_near).count();
    assert!(near * 10 > splats.len() * 9, "{near} of {}", splats.len());
}

#[test]
fn lists_of_training_and_test_images_are_kept() {
    let Some(scene) = input("transforms-splits-ignored") else { return };
    let found = read(&scene);
    assert_eq!(names(&found, Role::Test), ["0008", "0009", "0010"]);
    assert_eq!(names(&found, Role::Train).len(), 7);
    assert!(found.unused.is_empty() && found.skipped.is_empty(), "{:?} {:?}", found.unused, found.skipped);

    let copy = copy_of("transforms-splits-ignored").unwrap();
    let file = copy.path().join("transforms.json");
    let whole = std::fs::read_to_string(&file).unwrap();
    std::fs::write(&file, whole.replacen("\"images/0001.png\"", "\"images/0099.png\"", 1)).unwrap();
    refused(&["info", path_text(copy.path())], 2, &["images/0099.png"]);
    // An image that no list names is left out, as in nerfstudio.
    let mut json: serde_json::Value = serde_json::from_str(&whole).unwrap();
    json["train_filenames"].as_array_mut().unwrap().remove(0);
    json["white_transparent"] = true.into();
    json["frames"][3]["exposure"] = 0.5.into();
    std::fs::write(&file, json.to_string()).unwrap();
    std::fs::create_dir(copy.path().join("masks")).unwrap();
    let says = info(copy.path());
    for expected in [
        "images/0001.png (none of the lists",
        "not used: white_transparent: ",
        "not used: exposure of frames: ",
        "not used: masks: ",
    ] {
        assert!(says.contains(expected), "no `{expected}` in {says}");
    }
    let (says, _folder) = trained(copy.path(), "5", &["--test-views", "none"]);
    assert!(says.contains("not used: white_transparent"), "{says}");
}

#[test]
fn the_points_of_transforms_are_read() {
    let Some(scene) = input("transforms-ply-ignored") else { return };
    let found = read(&scene);
    assert_eq!((found.points.len(), found.points[0].rgb), (400, [151, 134, 110]));
    assert!(found.unused.is_empty(), "{:?}", found.unused);
    let (_, folder) = trained(&scene, "5", &[]);
    let stage = std::fs::read_to_string(folder.path().join("run/train/summary.json")).unwrap();
    assert!(stage.contains("\"splats_start\": 400"), "{stage}");

    let copy = copy_of("transforms-ply-ignored").unwrap();
    std::fs::remove_file(copy.path().join("sparse_pc.ply")).unwrap();
    assert!(info(copy.path()).contains("not used: sparse_pc.ply: "), "{}", info(copy.path()));
}

#[test]
fn a_scene_of_blender_is_the_same_by_its_folder_and_by_each_of_its_files() {
    let Some(folder) = input("blender-folder") else { return };
    let files = ["transforms_train.json", "transforms_test.json", "transforms_val.json"];
    for path in [folder.clone()].into_iter().chain(files.map(|name| folder.join(name))) {
        let scene = read(&path);
        assert_eq!(names(&scene, Role::Test), ["test_r_0", "test_r_1"], "{}", path.display());
        assert_eq!(names(&scene, Role::Train).len(), 7, "{}", path.display());
        assert!(info(&path).contains("not used: transforms_val.json"), "{}", info(&path));
    }
}

#[test]
fn masks_in_colours_are_masks_and_a_view_without_pixels_is_an_error() {
    let Some(scene) = input("masks-leave-no-pixel") else { return };
    let view = &read(&scene).views[0];
    assert!(known_share(&view.read_image().unwrap().planes[0]) > 0.0);

    let copy = copy_of("masks-leave-no-pixel").unwrap();
    // The first view is held back: its mask counts before the training too.
    for (mask, options) in [("0002", "none"), ("0001", "8")] {
        copy_folder(&scene, copy.path());
        let file = copy.path().join(format!("masks/{mask}.png.png"));
        write_png_gray(&file, 64, 64, &[0; 64 * 64]).unwrap();
        let run = copy.path().join("run");
        let args = [
            "run",
            path_text(copy.path()),
            "-o",
            path_text(&run),
            "--iterations",
            "5",
            "--test-views",
            options,
        ];
        refused(&args, 2, &[&format!("{mask}.png"), "no pixel", "mask"]);
        assert!(!run.join("splats.ply").exists());
    }
}

#[test]
fn palettes_of_masks_are_looked_up() {
    let Some(scene) = input("mask-palette") else { return };
    for view in read(&scene).views {
        let image = view.read_image().unwrap();
        let [red, ..] = &image.planes;
        assert!(
            red.row(40).iter().all(|v| !v.is_nan()) && red.row(20).iter().all(|v| v.is_nan()),
            "{}",
            view.name
        );
    }
}

#[test]
fn masks_are_found_by_every_usual_name() {
    let Some(scene) = input("mask-palette") else { return };
    let copy = copy_of("mask-palette").unwrap();
    let masks = copy.path().join("masks");
    let bytes = std::fs::read(masks.join("0001.png.png")).unwrap();
    let rows = |row: usize| if row < 32 { [255; 3] } else { [0; 3] };
    for name in ["0001.png", "0001.png.jpg", "0001.jpg"] {
        std::fs::remove_dir_all(&masks).unwrap();
        std::fs::create_dir(&masks).unwrap();
        let file = masks.join(name);
        if name.ends_with("png") {
            std::fs::write(&file, &bytes).unwrap();
        } else {
            jpeg(&file, rows);
        }
        let found = read(copy.path());
        let [red, ..] = &found.views[0].read_image().unwrap().planes;
        let is_used = red.row(5).iter().all(|v| !v.is_nan());
        assert_eq!(is_used, !name.ends_with("png"), "{name}");
        assert!(red.row(60).iter().all(|v| v.is_nan() == is_used), "{name}");
        let says = info(copy.path());
        assert!(says.contains("9 of 10 images have none"), "{says}");
    }
    assert!(read(&scene).unused.is_empty(), "{:?}", read(&scene).unused);
}

/// Writes a JPEG of 64 x 64 pixels of the colours of its rows.
fn jpeg(path: &Path, of_row: impl Fn(usize) -> [u8; 3]) {
    let png = path.with_extension("tmp.png");
    RgbImage::panels((64, 64), |_, row| [of_row(row)]).write(&png).unwrap();
    let made = std::process::Command::new("gdal_translate")
        .args(["-q", "-of", "JPEG", path_text(&png), path_text(path)])
        .status()
        .unwrap();
    assert!(made.success());
    std::fs::remove_file(png).unwrap();
}

#[test]
fn integers_of_32_bits_may_be_larger_than_those_of_16() {
    let Some(scene) = input("depth-32-bit-integers") else { return };
    let found = read(&scene);
    let depths: Vec<Grid2> = found.views.iter().map(|v| v.read_depth().unwrap()).collect();
    let largest = depths.iter().flat_map(Grid2::valid).fold(0.0, f32::max);
    assert!(largest > 65535.0 * 3e-5 && depths.iter().all(|d| known_share(d) > 0.99), "{largest}");
    let prior = Planes::read(&scene.join("prior/0001.npy")).unwrap().into_depths().unwrap();
    assert!(known_share(&prior) > 0.99);
    let (says, _folder) =
        trained(&scene, "5", &["--recipe", "indoor", "--depth-prior", path_text(&scene.join("prior"))]);
    assert!(!says.contains("not used: prior"), "{says}");
}

#[test]
fn a_mesh_of_depth_maps_from_inside_a_room_has_its_walls() {
    let Some(scene) = input("mesh-of-room-transforms") else { return };
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("m.ply");
    let says = output(&["mesh", path_text(&scene), "-o", path_text(&file), "--voxel", "0.05"]);
    assert!(says.contains("depths up to ") && says.contains("of them are beyond"), "{says}");
    let mesh = TriangleMesh::read(&file).unwrap();
    let [low, high] = mesh.bounds().unwrap();
    for (k, size) in [4.0, 5.0, 2.5].into_iter().enumerate() {
        assert!((high[k] - low[k] - size).abs() < 0.25, "axis {k}: {} to {}", low[k], high[k]);
    }
    let near = folder.path().join("near.ply");
    let args = ["mesh", path_text(&scene), "-o", path_text(&near), "--voxel", "0.05", "--depth-max", "2"];
    let says = output(&args);
    assert!(says.contains("depths up to 2.00 m (") && says.contains(" % of them are beyond)"), "{says}");
}

#[test]
fn small_differences_of_other_programs_are_no_reason_to_refuse() {
    let Some(scenes) = input("usual-but-refused") else { return };
    for name in ["backslashes", "bom"] {
        assert_eq!(read(&scenes.join(name)).views.len(), 4, "{name}");
    }
    for name in ["depth-half-size", "depth-npy"] {
        let scene = read(&scenes.join(name));
        for view in &scene.views {
            let depth = view.read_depth().unwrap();
            assert!((depth.width, depth.height) == (64, 64) && known_share(&depth) > 0.9, "{name}");
        }
        trained(&scenes.join(name), "5", &["--test-views", "none"]);
    }
    let half = read(&scenes.join("depth-half-size")).views[0].read_depth().unwrap();
    assert!((0..64).step_by(2).all(|col| half.at(col, 7).to_bits() == half.at(col + 1, 6).to_bits()));
    let lost = read(&scenes.join("rgbd-lost-pose"));
    assert_eq!(lost.skipped.len(), 1);
    assert!(info(&scenes.join("rgbd-lost-pose")).contains("its pose is lost"));
}

#[test]
fn lists_and_files_of_windows_are_read() {
    let Some(scene) = input("usual-but-refused").map(|folder| folder.join("backslashes")) else { return };
    let folder = tempfile::tempdir().unwrap();
    let list = folder.path().join("test.txt");
    std::fs::write(&list, "\u{feff}images\\0002.png\r\n0003.png\r\n").unwrap();
    let options = PerspectiveOptions { test_views: TestViews::List(list), ..PerspectiveOptions::default() };
    let found = PerspectiveScene::read(&scene, &options).unwrap();
    assert_eq!(names(&found, Role::Test), ["0002", "0003"]);
}

#[test]
fn poses_that_python_writes_as_nan_are_lost() {
    let Some(copy) = copy_of("transforms-ply-ignored") else { return };
    let file = copy.path().join("transforms.json");
    let mut json: serde_json::Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    json["frames"][2]["transform_matrix"][0][0] = "NaN here".into();
    std::fs::write(&file, json.to_string().replace("\"NaN here\"", "-Infinity")).unwrap();
    let found = read(copy.path());
    assert_eq!((found.views.len(), found.skipped.len()), (9, 1));
    assert!(found.skipped[0].1.contains("its pose is lost"), "{:?}", found.skipped);
}

#[test]
fn priors_lie_in_the_folders_of_their_images() {
    let Some(scene) = input("prior-in-sub-folders") else { return };
    let prior = scene.join("depths");
    trained(&scene, "5", &["--recipe", "indoor", "--depth-prior", path_text(&prior)]);
}

#[test]
fn meshes_with_texts_of_other_programs_are_scored() {
    let Some(folder) = input("mesh-text-of-other-programs") else { return };
    let reference: PathBuf = folder.join("latin1-comment.obj");
    for name in ["latin1-comment.ply", "latin1-comment.obj", "nan-ind-normals.ply"] {
        succeeds(&["mesh-eval", path_text(&folder.join(name)), path_text(&reference)]);
    }
    assert!(TriangleMesh::read(&folder.join("nan-ind-normals.ply")).unwrap().normals.is_empty());
}

#[test]
fn transparent_pixels_of_satellite_images_are_no_image() {
    for (name, says) in [("alpha-ignored", "VIEW_01 "), ("alpha_band_ignored", "VIEW_02 ")] {
        let Some(folder) = input(name) else { return };
        let text = info(&folder);
        let line = text.lines().find(|line| line.starts_with("valid pixels (")).unwrap_or_default();
        assert!(line.contains(says), "{name}: {text}");
    }
}
