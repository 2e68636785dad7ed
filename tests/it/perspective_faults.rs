//! Damaged and hostile perspective scenes give an error that names file and field; nothing panics.
use crate::common;
use crate::common::perspective::{SIZE, depth_png, image, phone, project, rgbd};
use crate::common::satgs;
use satgs::perspective::colmap::{self, ColmapModel, Format};
use satgs::perspective::{
    GeoreferenceSource, PerspectiveError, PerspectiveOptions, PerspectiveScene, points_from_depths,
};
use std::path::Path;

/// A COLMAP project of a changed model.
fn changed(format: Format, change: impl FnOnce(&mut ColmapModel)) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut model = phone();
    change(&mut model);
    project(folder.path(), &model, format);
    folder
}

fn error(path: &Path) -> PerspectiveError {
    PerspectiveScene::read(path, &PerspectiveOptions::default()).unwrap_err()
}

/// Asserts that reading fails with these words in the message, and that the message has a hint.
#[track_caller]
fn refused(path: &Path, says: &[&str]) {
    let error = error(path);
    let text = error.to_string();
    assert!(says.iter().all(|s| text.contains(s)), "{says:?} in: {text}");
    assert!(miette::Diagnostic::help(&error).is_some() || text.contains("failed"), "a hint: {text}");
}

#[test]
fn what_is_no_scene_is_refused_by_the_command_line_with_code_2() {
    let folder = tempfile::tempdir().unwrap();
    refused(folder.path(), &["no perspective scene"]);
    refused(&folder.path().join("absent"), &["no perspective scene"]);
    project(folder.path(), &phone(), Format::Binary);
    std::fs::remove_file(folder.path().join("sparse/0/images.bin")).unwrap();
    let out = satgs(&["info", folder.path().to_str().unwrap()]);
    let said = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(2));
    assert!(said.contains("images.bin` is missing") && said.contains("hint:"), "{said}");
}

#[test]
fn a_model_without_images_names_the_file() {
    let folder = changed(Format::Binary, |model| model.images.clear());
    refused(folder.path(), &["has no views"]);
    std::fs::remove_file(folder.path().join("sparse/0/images.bin")).unwrap();
    refused(folder.path(), &["images.bin` is missing", "poses"]);
}

#[test]
fn missing_images_are_counted_and_the_first_is_named() {
    let folder = changed(Format::Binary, |_| ());
    std::fs::remove_file(folder.path().join("images/view 2.png")).unwrap();
    refused(folder.path(), &["1 of 4 images", "view 2.png"]);
    std::fs::remove_dir_all(folder.path().join("images")).unwrap();
    refused(folder.path(), &["4 of 4 images", "images/view 0.png"]);
}

#[test]
fn cameras_without_focal_length_or_size_are_refused() {
    for format in [Format::Binary, Format::Text] {
        for focal in [0.0, -30.0, f64::NAN, f64::INFINITY] {
            let folder = changed(format, |model| model.cameras[0].parameters[0] = focal);
            refused(folder.path(), &["cameras.", "camera 7", "focal length above zero"]);
        }
        let folder = changed(format, |model| model.cameras[0].width = 0);
        refused(folder.path(), &["camera 7", "0 x 24"]);
    }
    let folder = changed(Format::Text, |model| model.cameras[0].parameters.truncate(7));
    refused(folder.path(), &["cameras.txt", "8 finite parameters of OPENCV"]);
}

#[test]
fn poses_that_are_none_are_refused() {
    for format in [Format::Binary, Format::Text] {
        let folder = changed(format, |model| model.images[1].rotation = [0.0; 4]);
        refused(folder.path(), &["images.", "image 11 (`view 1.png`)", "a quaternion that is not zero"]);
        let folder = changed(format, |model| model.images[1].rotation[2] = f64::NAN);
        refused(folder.path(), &["pose of image 11"]);
        let folder = changed(format, |model| model.images[2].translation[0] = f64::NAN);
        refused(folder.path(), &["pose of image 12", "finite"]);
        let folder = changed(format, |model| model.points[4].position[1] = f64::INFINITY);
        refused(folder.path(), &["points3D.", "finite"]);
    }
}

#[test]
fn images_of_unknown_cameras_and_unknown_models_are_refused() {
    let folder = changed(Format::Text, |model| model.images[0].camera = 8);
    refused(folder.path(), &["camera of image 10", "8"]);
    let folder = changed(Format::Text, |_| ());
    let file = folder.path().join("sparse/0/cameras.txt");
    let text = std::fs::read_to_string(&file).unwrap();
    std::fs::write(&file, text.replace("OPENCV", "SPHERICAL")).unwrap();
    refused(folder.path(), &["cameras.txt", "camera 7", "SPHERICAL"]);
    let folder = changed(Format::Binary, |_| ());
    let file = folder.path().join("sparse/0/cameras.bin");
    let mut bytes = std::fs::read(&file).unwrap();
    bytes[12] = 11;
    std::fs::write(&file, bytes).unwrap();
    refused(folder.path(), &["cameras.bin", "camera 7", "model 11"]);
}

#[test]
fn files_that_are_cut_short_at_any_length_are_refused() {
    let folder = changed(Format::Binary, |_| ());
    let model = folder.path().join("sparse/0");
    for name in ["cameras.bin", "images.bin", "points3D.bin"] {
        let whole = std::fs::read(model.join(name)).unwrap();
        for length in 0..whole.len() {
            std::fs::write(model.join(name), &whole[..length]).unwrap();
            let text = colmap::read(&model).unwrap_err().to_string();
            assert!(text.contains(name) && text.contains("are left"), "{length}: {text}");
        }
        std::fs::write(model.join(name), [whole.as_slice(), &[0]].concat()).unwrap();
        assert!(colmap::read(&model).unwrap_err().to_string().contains("followed by 1 bytes"));
        std::fs::write(model.join(name), &whole).unwrap();
    }
}

/// Any single damaged byte gives a model or an error, and no panic.
#[test]
fn damaged_bytes_do_not_panic() {
    let folder = changed(Format::Binary, |_| ());
    let model = folder.path().join("sparse/0");
    for name in ["cameras.bin", "images.bin", "points3D.bin"] {
        let whole = std::fs::read(model.join(name)).unwrap();
        for at in 0..whole.len() {
            let mut damaged = whole.clone();
            damaged[at] ^= 0xFF;
            std::fs::write(model.join(name), &damaged).unwrap();
            if let Ok(model) = colmap::read(&model) {
                let _ = model.reprojection();
            }
        }
        std::fs::write(model.join(name), &whole).unwrap();
    }
}

#[test]
fn counts_that_no_file_can_hold_are_refused_before_memory_is_taken() {
    let folder = changed(Format::Binary, |_| ());
    let model = folder.path().join("sparse/0");
    for (name, field) in [
        ("cameras.bin", "number of cameras"),
        ("images.bin", "number of images"),
        ("points3D.bin", "number of points"),
    ] {
        let whole = std::fs::read(model.join(name)).unwrap();
        for count in [1u64 << 60, u64::MAX, 1 << 40] {
            let mut hostile = whole.clone();
            hostile[..8].copy_from_slice(&count.to_le_bytes());
            std::fs::write(model.join(name), &hostile).unwrap();
            let text = colmap::read(&model).unwrap_err().to_string();
            assert!(text.contains(field) && text.contains(&count.to_string()), "{text}");
        }
        std::fs::write(model.join(name), &whole).unwrap();
    }
    // The number of observations of the first image stands after its name.
    let images = model.join("images.bin");
    let mut bytes = std::fs::read(&images).unwrap();
    let name_end = bytes.windows(5).position(|w| w == b".png\0").unwrap() + 5;
    bytes[name_end..name_end + 8].copy_from_slice(&(1u64 << 60).to_le_bytes());
    std::fs::write(&images, bytes).unwrap();
    refused(folder.path(), &["number of observations of image 10"]);
}

#[test]
fn damaged_text_names_the_line() {
    let folder = changed(Format::Text, |_| ());
    let model = folder.path().join("sparse/0");
    for (name, from, to, says) in [
        ("cameras.txt", "OPENCV 32", "OPENCV wide", "the size in line 3"),
        ("images.txt", "10 ", "ten ", "the number of an image in line 4"),
        ("points3D.txt", " 10 0 200", " 10 0 300", "the colour in line 3"),
    ] {
        let whole = std::fs::read_to_string(model.join(name)).unwrap();
        assert!(whole.contains(from), "{name}: {whole}");
        std::fs::write(model.join(name), whole.replacen(from, to, 1)).unwrap();
        refused(folder.path(), &[name, says]);
        std::fs::write(model.join(name), &whole).unwrap();
    }
    let images = model.join("images.txt");
    let whole = std::fs::read_to_string(&images).unwrap();
    for length in (0..whole.len()).step_by(7) {
        std::fs::write(&images, &whole[..length]).unwrap();
        let _ = colmap::read(&model);
    }
}

#[test]
fn names_of_images_that_differ_in_their_folder_stay_apart() {
    let folder = changed(Format::Binary, |model| {
        model.images[0].name = "left/a.png".into();
        model.images[1].name = "right/a.png".into();
    });
    let scene = PerspectiveScene::read(folder.path(), &PerspectiveOptions::default()).unwrap();
    assert_eq!((scene.views[0].name.as_str(), scene.views[1].name.as_str()), ("left_a", "right_a"));
    let folder = changed(Format::Binary, |model| {
        model.images[0].name = "left/a.png".into();
        model.images[1].name = "left_a.png".into();
        model.images[2].name = "right/a.png".into();
    });
    refused(folder.path(), &["left/a.png", "left_a.png", "same name"]);
}

#[test]
fn transforms_without_frames_images_or_focal_lengths_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    image(&folder.path().join("a.png"), SIZE);
    let file = folder.path().join("transforms.json");
    let pose = "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]";
    let frames = |path: &str, pose: &str| {
        format!(r#""frames": [{{"file_path": "{path}", "transform_matrix": {pose}}}]"#)
    };
    let focal = r#""fl_x": 30"#;
    for (text, says) in [
        ("{}".to_owned(), vec!["transforms.json", "`frames`", "empty"]),
        (r#"{"frames": []}"#.to_owned(), vec!["`frames`", "empty"]),
        ("{".to_owned(), vec!["transforms.json", "failed"]),
        (r#"{"frames": 3}"#.to_owned(), vec!["transforms.json", "failed"]),
        (format!("{{{}}}", frames("a.png", pose)), vec!["`fl_x` of frame 0", "missing"]),
        (format!("{{\"fl_x\": 0, {}}}", frames("a.png", pose)), vec!["camera of frame 0", "above zero"]),
        (
            format!("{{\"fl_x\": 30, \"w\": 0, \"h\": 2, {}}}", frames("a.png", pose)),
            vec!["`w, h` of frame 0"],
        ),
        (format!("{{\"k4\": 1, {focal}, {}}}", frames("a.png", pose)), vec!["`k4` of frame 0"]),
        (
            format!("{{\"camera_model\": \"EQUIRECTANGULAR\", {focal}, {}}}", frames("a.png", pose)),
            vec!["EQUIRECTANGULAR"],
        ),
        (format!("{{{focal}, {}}}", frames("b.png", pose)), vec!["1 of 1 images", "b.png"]),
        (
            format!("{{{focal}, {}}}", frames("a.png", "[[1,0,0,null],[0,1,0,0],[0,0,1,0],[0,0,0,1]]")),
            vec!["all 1 images are left out", "its pose is lost"],
        ),
        (
            format!("{{{focal}, {}}}", frames("a.png", "[[0,0,0,0],[0,0,0,0],[0,0,0,0],[0,0,0,1]]")),
            vec!["a rotation"],
        ),
        (format!("{{{focal}, {}}}", frames("a.png", "[]")), vec!["`transform_matrix` of frame 0", "rows"]),
        (
            format!("{{\"w\": 20, \"h\": 24, {focal}, {}}}", frames("a.png", pose)),
            vec!["a.png", "32 x 24", "20 x 24"],
        ),
    ] {
        std::fs::write(&file, text).unwrap();
        refused(folder.path(), &says);
    }
}

#[test]
fn rgbd_frames_with_bad_poses_or_intrinsics_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    rgbd(folder.path());
    let pose = folder.path().join("frame-000008.pose.txt");
    for (text, says) in [
        ("1 0 0 0\n".to_owned(), "4 values"),
        ("a b\n".to_owned(), "`a`"),
        ("0 0 0 0\n".repeat(4), "a rotation"),
    ] {
        std::fs::write(&pose, text).unwrap();
        refused(folder.path(), &["frame-000008.pose.txt", "the pose", says]);
    }
    for value in ["nan", "-inf", "-nan(ind)"] {
        std::fs::write(&pose, format!("{value} {value} {value} {value}\n").repeat(4)).unwrap();
        let scene = PerspectiveScene::read(folder.path(), &PerspectiveOptions::default()).unwrap();
        assert!(scene.skipped[0].1.contains("its pose is lost"), "{value}: {:?}", scene.skipped);
    }
    std::fs::remove_file(&pose).unwrap();
    let scene = PerspectiveScene::read(folder.path(), &PerspectiveOptions::default()).unwrap();
    assert_eq!(
        scene.skipped,
        [("frame-000008.color.png".to_owned(), "it has no file of its pose".to_owned())]
    );
    for text in ["0 0 15\n0 30 11\n0 0 1\n", "nan 0 15 0 30 11 0 0 1", "30 0 15"] {
        std::fs::write(folder.path().join("camera-intrinsics.txt"), text).unwrap();
        refused(folder.path(), &["camera-intrinsics.txt", "the intrinsic matrix"]);
    }
}

#[test]
fn depth_maps_of_another_shape_are_refused_and_invalid_depths_are_gaps() {
    let folder = tempfile::tempdir().unwrap();
    rgbd(folder.path());
    let depth = folder.path().join("frame-000008.depth.png");
    let view = || {
        let scene = PerspectiveScene::read(folder.path(), &PerspectiveOptions::default()).unwrap();
        scene.views[1].clone()
    };
    depth_png(&depth, (16, 10), |_, _| 2000);
    let text = view().read_depth().unwrap_err().to_string();
    assert!(
        text.contains("frame-000008.depth.png") && text.contains("16 x 10") && text.contains("32 x 24"),
        "{text}"
    );
    // Depths of a smaller map of the same shape are those of the nearest pixel.
    depth_png(&depth, (16, 12), |col, _| 1000 + 100 * col as u16);
    let half = view().read_depth().unwrap();
    assert_eq!((half.at(6, 5), half.at(7, 4), half.at(8, 5)), (1.3, 1.3, 1.4));
    for invalid in [0, 65535] {
        depth_png(&depth, SIZE, |_, _| invalid);
        assert!(view().read_depth().unwrap().data.iter().all(|d| d.is_nan()), "{invalid}");
    }
    std::fs::write(&depth, "no picture").unwrap();
    assert!(view().read_depth().unwrap_err().to_string().contains("frame-000008.depth.png"));
    std::fs::remove_file(&depth).unwrap();
    assert!(matches!(view().read_depth(), Err(PerspectiveError::NoDepth { .. })));
}

#[test]
fn points_need_training_views_with_depths() {
    let folder = changed(Format::Binary, |_| ());
    let scene = PerspectiveScene::read(folder.path(), &PerspectiveOptions::default()).unwrap();
    assert!(points_from_depths(&scene, 1, 0.05).unwrap_err().to_string().contains("no views"));
    for thinning in [0.0, -1.0, f64::NAN] {
        assert!(points_from_depths(&scene, 1, thinning).unwrap_err().to_string().contains("thinning"));
    }
}

#[test]
fn damaged_pictures_are_refused_when_they_are_read() {
    let folder = changed(Format::Binary, |_| ());
    let picture = folder.path().join("images/view 1.png");
    let whole = std::fs::read(&picture).unwrap();
    let scene = PerspectiveScene::read(folder.path(), &PerspectiveOptions::default()).unwrap();
    std::fs::write(&picture, &whole[..whole.len() / 2]).unwrap();
    assert!(scene.views[1].read_image().unwrap_err().to_string().contains("view 1.png"));
    std::fs::write(&picture, "").unwrap();
    refused(folder.path(), &["view 1.png"]);
}

#[test]
fn a_photograph_that_is_cut_short_is_refused_and_not_filled_with_grey() {
    let Some(data) = common::data_dir() else { return };
    let mut scene =
        PerspectiveScene::read(&data.join("perspective/office"), &PerspectiveOptions::default()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let view = &mut scene.views[0];
    assert!(view.read_image().is_ok());
    let whole = std::fs::read(&view.image).unwrap();
    view.image = folder.path().join("cut.jpg");
    std::fs::write(&view.image, &whole[..whole.len() / 2]).unwrap();
    let text = view.read_image().unwrap_err().to_string();
    assert!(text.contains("cut.jpg") && text.contains("ends before its picture does"), "{text}");
}

#[test]
fn only_some_downsamplings_are_possible() {
    let folder = changed(Format::Binary, |_| ());
    for downsampling in [0, 3, 16] {
        let options = PerspectiveOptions { downsampling, ..PerspectiveOptions::default() };
        let error = PerspectiveScene::read(folder.path(), &options).unwrap_err();
        assert!(matches!(error, PerspectiveError::Downsampling { .. }), "{error}");
    }
}

#[test]
fn georeferences_that_do_not_determine_the_place_are_refused() {
    let folder = changed(Format::Binary, |model| {
        for image in &mut model.images {
            image.name = image.name.replace(' ', "");
        }
    });
    let file = folder.path().join("geo.txt");
    let given = |source| {
        let options = PerspectiveOptions { georeference: Some(source), ..PerspectiveOptions::default() };
        PerspectiveScene::read(folder.path(), &options).unwrap_err().to_string()
    };
    assert!(given(GeoreferenceSource::Exif).contains("no image of the scene has a position"));
    let similarity = |scale: &str, epsg: u32, first: &str| {
        format!(
            r#"{{"epsg": {epsg}, "scale": {scale}, "rotation": [[{first},0,0],[0,1,0],[0,0,1]], "translation": [0,0,0]}}"#
        )
    };
    for (text, says) in [
        (String::new(), "`EPSG:`"),
        ("view0.png 1 2 3\n".into(), "`EPSG:`"),
        ("EPSG:99999999\nview0.png 1 2 3\n".into(), "EPSG:99999999"),
        ("EPSG:32632\n".into(), "no image"),
        ("EPSG:32632\nview0.png 1 2\n".into(), "line 2"),
        ("EPSG:32632\nview0.png a b c\n".into(), "line 2"),
        ("EPSG:32632\nview0.png nan 2 3\n".into(), "no position"),
        ("EPSG:4326\nview0.png 200 2 3\n".into(), "no position"),
        ("EPSG:32632\nview0.png 1 2 3\nview1.png 2 3 4\n".into(), "3 are needed"),
        ("EPSG:32632\nview0.png 1 2 3\nview1.png 1 2 3\nview2.png 1 2 3\n".into(), "one place"),
        ("{".into(), "geo.txt"),
        ("{}".into(), "epsg"),
        (similarity("0", 32632, "1"), "`scale`"),
        (similarity("1", 4326, "1"), "`epsg`"),
        (similarity("1", 32632, "7"), "`rotation`"),
    ] {
        std::fs::write(&file, &text).unwrap();
        let said = given(GeoreferenceSource::File(file.clone()));
        assert!(said.contains(says), "`{says}` for {text}: {said}");
    }
}
