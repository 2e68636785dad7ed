//! Perspective scenes of every layout are read with the right cameras, pixels and points.
use crate::common::perspective::{CENTERS, SIZE, depth_png, image, model, phone, project, rgbd};
use crate::common::{data_dir, satgs};
use glam::{DMat3, DQuat, DVec2, DVec3};
use satgs::frame::{Pixel, Point};
use satgs::perspective::colmap::{self, Format};
use satgs::perspective::{
    GeoreferenceSource, Layout, LensModel, PerspectiveOptions, PerspectiveScene, TestViews,
    points_from_depths,
};
use satgs::scene::Role;
use std::path::Path;

fn read(path: &Path) -> PerspectiveScene {
    PerspectiveScene::read(path, &PerspectiveOptions::default()).unwrap()
}

fn georeferenced(path: &Path, source: GeoreferenceSource) -> PerspectiveScene {
    let options = PerspectiveOptions { georeference: Some(source), ..PerspectiveOptions::default() };
    PerspectiveScene::read(path, &options).unwrap()
}

/// COLMAP models of the real data, with their mean reprojection error according to pycolmap 4.2.1 (`scripts/check-colmap`),
/// pixels.
const REAL: [(&str, f64); 4] = [
    ("office", 0.569_856_009),
    ("brighton", 0.294_437_542),
    ("fox9", 0.621_563_856),
    ("lightfield", 0.240_806_272),
];

#[test]
fn reprojection_errors_of_colmap_models_are_those_of_pycolmap_and_of_their_files() {
    let Some(data) = data_dir() else { return };
    for (name, expected) in REAL {
        let r = PerspectiveScene::reprojection(&data.join("perspective").join(name)).unwrap().unwrap();
        println!("{name}: {r:?}");
        assert!((r.mean_px - expected).abs() < 1e-6, "{name}: {r:?}");
        match name {
            // Nothing was done to the drone's model since it was reconstructed.
            "brighton" => assert!((r.mean_px - r.stated_px.unwrap()).abs() < 1e-6),
            "lightfield" => assert_eq!(r.stated_px, None),
            _ => assert!(r.stated_px.unwrap() > r.mean_px),
        }
    }
}

/// The office was undistorted and made smaller after its errors were written: all of them are 1 / 0.68 of ours.
#[test]
fn errors_of_the_office_are_those_that_its_file_states_times_the_scale_of_its_images() {
    let Some(data) = data_dir() else { return };
    let model = colmap::read(&data.join("perspective/office/sparse/0")).unwrap();
    let ratios = model.points.iter().filter(|p| p.error > 0.0).filter_map(|point| {
        let alone = colmap::ColmapModel { points: vec![point.clone()], ..colmap::ColmapModel::default() };
        let seen: std::collections::BTreeSet<u32> = point.track.iter().map(|t| t.0).collect();
        let images = model.images.iter().filter(|i| seen.contains(&i.id)).cloned().collect();
        let alone = colmap::ColmapModel { images, cameras: model.cameras.clone(), ..alone };
        Some(alone.reprojection()?.mean_px / point.error)
    });
    let ratios: Vec<f64> = ratios.take(300).collect();
    let share = |s: f64| satgs::stats::quantile(ratios.clone(), s).unwrap();
    assert!(share(0.05) > 0.66 && share(0.95) < 0.70, "{} {} {}", share(0.05), share(0.5), share(0.95));
}

#[test]
fn colmap_models_are_the_same_after_writing_and_reading() {
    let folder = tempfile::tempdir().unwrap();
    let mut models = vec![("made".to_owned(), phone())];
    if let Some(data) = data_dir() {
        for (name, _) in REAL {
            let folder = data.join("perspective").join(name).join("sparse/0");
            models.push((name.to_owned(), colmap::read(&folder).unwrap()));
        }
    }
    for (name, model) in &models {
        for format in [Format::Binary, Format::Text, Format::Binary] {
            colmap::write(folder.path(), model, format).unwrap();
            assert!(colmap::read(folder.path()).unwrap() == *model, "{name} {format:?}");
            assert_eq!(
                std::fs::read_dir(folder.path()).unwrap().count(),
                3,
                "files of the other format are removed"
            );
        }
    }
}

#[test]
fn binary_files_of_colmap_are_reproduced_byte_by_byte() {
    let Some(data) = data_dir() else { return };
    let folder = tempfile::tempdir().unwrap();
    for (name, _) in REAL {
        let original = data.join("perspective").join(name).join("sparse/0");
        colmap::write(folder.path(), &colmap::read(&original).unwrap(), Format::Binary).unwrap();
        for file in ["cameras.bin", "images.bin", "points3D.bin"] {
            let (a, b) = (std::fs::read(original.join(file)), std::fs::read(folder.path().join(file)));
            assert!(a.unwrap() == b.unwrap(), "{name}/{file}");
        }
    }
}

#[test]
fn a_colmap_project_is_read_from_every_place_and_in_both_formats() {
    for format in [Format::Binary, Format::Text] {
        let folder = tempfile::tempdir().unwrap();
        project(folder.path(), &phone(), format);
        let scene = read(folder.path());
        assert_eq!((scene.layout, scene.views.len(), scene.points.len()), (Layout::Colmap, 4, 9));
        assert_eq!(read(&folder.path().join("sparse")), scene);
        assert_eq!(read(&folder.path().join("sparse/0")), scene);
        // Files directly in `sparse`, and directly beside the images.
        for file in ["cameras", "images", "points3D"] {
            let name = format!("{file}.{}", if format == Format::Binary { "bin" } else { "txt" });
            std::fs::rename(
                folder.path().join("sparse/0").join(&name),
                folder.path().join("sparse").join(&name),
            )
            .unwrap();
        }
        assert_eq!(read(folder.path()), scene);
    }
}

/// The half pixel: COLMAP's (0.5, 0.5) is the centre of the first pixel, ours is (0, 0).
#[test]
fn pinhole_cameras_project_points_half_a_pixel_from_colmaps_observations() {
    let folder = tempfile::tempdir().unwrap();
    let model = model(LensModel::Pinhole, &[30.0, 31.0, 16.0, 12.0]);
    project(folder.path(), &model, Format::Binary);
    let scene = read(folder.path());
    for (view, image) in scene.views.iter().zip(&model.images) {
        assert_eq!(view.camera.principal, DVec2::new(15.5, 11.5));
        for (point, seen) in scene.points.iter().zip(&image.observations) {
            let px = view.camera.project(point.position).unwrap();
            assert!((px.col + 0.5 - seen.x).abs() < 1e-9 && (px.row + 0.5 - seen.y).abs() < 1e-9);
        }
    }
    let r = PerspectiveScene::reprojection(folder.path()).unwrap().unwrap();
    assert!(r.observations == 36 && r.mean_px < 1e-9, "{r:?}");
}

#[test]
fn undistorted_images_show_points_where_the_pinhole_camera_does() {
    let folder = tempfile::tempdir().unwrap();
    project(folder.path(), &phone(), Format::Binary);
    for downsampling in [1, 2] {
        let options = PerspectiveOptions { downsampling, ..PerspectiveOptions::default() };
        let scene = PerspectiveScene::read(folder.path(), &options).unwrap();
        let view = &scene.views[0];
        let image = view.read_image().unwrap();
        assert_eq!((image.planes[0].width, image.planes[0].height), view.camera.size);
        // The file's red is the column times 4 / 255, its green the row times 8 / 255: what is read at the projection of
        // a point by the pinhole camera tells where the lens saw it.
        for point in &scene.points {
            let px = view.camera.project(point.position).unwrap();
            let camera =
                view.camera.cam_from_site * (DVec3::from_array(point.position.xyz()) - view.camera.center);
            let seen = view.lens_camera.project(camera).unwrap();
            let (red, green) =
                (image.planes[0].bilinear(px.col, px.row), image.planes[1].bilinear(px.col, px.row));
            let off =
                ((f64::from(red) * 255.0 / 4.0 - seen.col), (f64::from(green) * 255.0 / 8.0 - seen.row));
            assert!(off.0.abs() < 0.02 && off.1.abs() < 0.02, "{off:?}");
        }
    }
}

#[test]
fn masked_pixels_and_pixels_that_the_lens_does_not_show_are_nan() {
    let folder = tempfile::tempdir().unwrap();
    let barrel = model(LensModel::SimpleRadial, &[30.0, 16.0, 12.0, 0.3]);
    project(folder.path(), &barrel, Format::Binary);
    let mask: Vec<u8> = (0..SIZE.0 * SIZE.1).map(|i| if i % SIZE.0 < 16 { 0 } else { 255 }).collect();
    std::fs::create_dir(folder.path().join("masks")).unwrap();
    satgs::io::write_png_gray(&folder.path().join("masks/view 1.png.png"), SIZE.0, SIZE.1, &mask).unwrap();
    let scene = read(folder.path());
    let (free, masked) = (scene.views[0].read_image().unwrap(), scene.views[1].read_image().unwrap());
    assert!(free.planes[0].at(0, 0).is_nan(), "the pincushion lens shows less in the corners");
    assert!(!free.planes[0].at(5, 12).is_nan() && masked.planes[0].at(5, 12).is_nan());
    assert!(!masked.planes[2].at(25, 12).is_nan());
}

#[test]
fn cameras_follow_images_that_were_resampled_and_refuse_cropped_ones() {
    let folder = tempfile::tempdir().unwrap();
    project(folder.path(), &phone(), Format::Binary);
    let whole = read(folder.path());
    for view in 0..4 {
        image(&folder.path().join(format!("images/view {view}.png")), (16, 12));
    }
    let half = read(folder.path());
    let p = whole.points[3].position;
    let (a, b) = (whole.views[2].camera.project(p).unwrap(), half.views[2].camera.project(p).unwrap());
    assert!(
        (0.5 * (a.col + 0.5) - 0.5 - b.col).abs() < 1e-9 && (0.5 * (a.row + 0.5) - 0.5 - b.row).abs() < 1e-9
    );
    image(&folder.path().join("images/view 3.png"), (32, 12));
    let error =
        PerspectiveScene::read(folder.path(), &PerspectiveOptions::default()).unwrap_err().to_string();
    assert!(
        error.contains("view 3.png") && error.contains("32 x 12") && error.contains("32 x 24"),
        "{error}"
    );
}

#[test]
fn test_views_are_every_eighth_or_listed() {
    let folder = tempfile::tempdir().unwrap();
    project(folder.path(), &phone(), Format::Binary);
    let tests = |test_views: TestViews| -> Vec<String> {
        let options = PerspectiveOptions { test_views, ..PerspectiveOptions::default() };
        let scene = PerspectiveScene::read(folder.path(), &options).unwrap();
        scene.views.iter().filter(|v| v.role == Role::Test).map(|v| v.name.clone()).collect()
    };
    assert_eq!(tests(TestViews::Every(8)), ["view 0"]);
    assert_eq!(tests(TestViews::Every(2)), ["view 0", "view 2"]);
    assert!(tests(TestViews::None).is_empty());
    let list = folder.path().join("list.txt");
    std::fs::write(&list, "# held back\nview 3.png\nview 1\n").unwrap();
    assert_eq!(tests(TestViews::List(list.clone())), ["view 1", "view 3"]);
    std::fs::write(&list, "view 9\n").unwrap();
    let options = PerspectiveOptions { test_views: TestViews::List(list), ..PerspectiveOptions::default() };
    let error = PerspectiveScene::read(folder.path(), &options).unwrap_err().to_string();
    assert!(error.contains("list.txt") && error.contains("view 9"), "{error}");
}

/// The fox was photographed once: relative rotations of its `transforms.json` are those of the COLMAP model of other copies
/// of the same photographs.
#[test]
fn transforms_of_the_fox_agree_with_its_colmap_model() {
    let Some(data) = data_dir() else { return };
    let (transforms, colmap) = (read(&data.join("fox")), read(&data.join("perspective/fox9")));
    assert_eq!((transforms.views.len(), transforms.skipped.len()), (50, 17));
    assert_eq!(transforms.views.iter().filter(|v| v.role == Role::Test).count(), 7);
    let pairs: Vec<(DMat3, DMat3)> = colmap
        .views
        .iter()
        .filter_map(|c| {
            let other = transforms.views.iter().find(|t| t.name == c.name)?;
            Some((c.camera.cam_from_site, other.camera.cam_from_site))
        })
        .collect();
    assert!(pairs.len() >= 5, "{} images are in both", pairs.len());
    for (a, b) in &pairs[1..] {
        let (first, other) = (pairs[0].0 * a.transpose(), pairs[0].1 * b.transpose());
        let turn = DQuat::from_mat3(&(first * other.transpose())).to_axis_angle().1.to_degrees();
        assert!(turn.min(360.0 - turn) < 1.0, "{turn}");
    }
    let options = PerspectiveOptions { downsampling: 4, ..PerspectiveOptions::default() };
    let quarter = PerspectiveScene::read(&data.join("fox"), &options).unwrap();
    let view = &quarter.views[1];
    assert_eq!((view.camera.size, view.lens_camera.size), ((270, 480), (1080, 1920)));
    assert!((view.camera.principal - (DVec2::new(554.558, 965.268) / 4.0 - 0.5)).length() < 1e-9);
    let image = view.read_image().unwrap();
    let valid = image.planes[0].valid().count() as f64 / (270.0 * 480.0);
    assert!(valid > 0.97, "{valid}");
    assert!(image.planes.iter().all(|p| p.valid().all(|v| (0.0..=1.0).contains(&v))));
}

#[test]
fn frames_of_transforms_have_their_own_intrinsics_and_angles() {
    let folder = tempfile::tempdir().unwrap();
    image(&folder.path().join("images/a.png"), SIZE);
    image(&folder.path().join("images/b.png"), SIZE);
    let frame = |path: &str, more: &str| {
        format!(
            r#"{{"file_path": "{path}", {more} "transform_matrix": [[1,0,0,1],[0,0,-1,2],[0,1,0,3],[0,0,0,1]]}}"#
        )
    };
    // The camera looks along +y of the world, with z up.
    let text = format!(
        r#"{{"camera_angle_x": 0.9, "frames": [{}, {}, {}]}}"#,
        frame("./images/a", ""),
        frame("images/b.png", r#""fl_x": 40, "fl_y": 42, "cx": 15, "cy": 11, "k1": 0.01,"#),
        frame("images/c.png", "")
    );
    std::fs::write(folder.path().join("transforms.json"), text).unwrap();
    let scene = read(folder.path());
    assert_eq!((scene.views.len(), scene.skipped.len()), (2, 1));
    let [a, b] = [&scene.views[0], &scene.views[1]];
    assert!(
        (a.camera.focal.x - 16.0 / 0.45f64.tan()).abs() < 1e-9 && a.lens_camera.model == LensModel::Pinhole
    );
    assert_eq!((b.camera.focal, b.lens_camera.principal), (DVec2::new(40.0, 42.0), DVec2::new(14.5, 10.5)));
    assert_eq!(a.camera.center, DVec3::new(1.0, 2.0, 3.0));
    let ahead = a.camera.project(Point::new(1.0, 7.0, 3.0)).unwrap();
    assert!((ahead.col - 15.5).abs() < 1e-9 && (ahead.row - 11.5).abs() < 1e-9);
    let (right, above) = (Point::new(1.5, 7.0, 3.0), Point::new(1.0, 7.0, 3.5));
    assert!(a.camera.project(right).unwrap().col > 16.0 && a.camera.project(above).unwrap().row < 11.0);
}

#[test]
fn depths_are_metres_and_their_points_lie_on_the_plane_that_the_frames_see() {
    let folder = tempfile::tempdir().unwrap();
    rgbd(folder.path());
    let options = PerspectiveOptions { test_views: TestViews::None, ..PerspectiveOptions::default() };
    let scene = PerspectiveScene::read(folder.path(), &options).unwrap();
    assert_eq!((scene.layout, scene.views.len(), scene.points.len()), (Layout::RgbD, 2, 0));
    let depth = scene.views[0].read_depth().unwrap();
    assert!(depth.at(0, 0).is_nan() && depth.at(1, 0).is_nan() && depth.at(2, 0) == 2.0);
    let points = points_from_depths(&scene, 1, 0.05).unwrap();
    assert!(points.iter().all(|p| (p.position.z() - 2.0).abs() < 1e-6));
    let east = points.iter().map(|p| p.position.x()).fold(f64::NEG_INFINITY, f64::max);
    assert!((east - (0.1 + 2.0 * 15.5 / 30.0)).abs() < 0.05, "{east}");
    // One frame less sees less; a voxel of 1 m leaves few points.
    assert!(points_from_depths(&scene, 2, 0.05).unwrap().len() < points.len());
    assert!(points_from_depths(&scene, 1, 1.0).unwrap().len() <= 12);
    let voxels: std::collections::BTreeSet<[i64; 3]> =
        points.iter().map(|p| p.position.xyz().map(|v| (v / 0.05).floor() as i64)).collect();
    assert_eq!(voxels.len(), points.len(), "one point a voxel");
    assert!(points_from_depths(&scene, 1, 0.0).is_err());
}

#[test]
fn depths_of_two_real_frames_show_the_same_surface() {
    let Some(data) = data_dir() else { return };
    let scene = read(&data.join("sevenscenes"));
    assert_eq!((scene.layout, scene.views.len()), (Layout::RgbD, 125));
    // The stated camera is that of the depth maps.
    let found = scene.registration.expect("a colour camera");
    assert!((found.focal_ratio - 0.9).abs() < 0.015 && (found.offset_m[0] + 0.02).abs() < 0.005, "{found:?}");
    let options = PerspectiveOptions::default();
    let again = PerspectiveScene::read_again(&data.join("sevenscenes"), &options, Some(found)).unwrap();
    assert!(again.views == scene.views);
    let [a, b] = [&scene.views[10], &scene.views[12]];
    let (from, to) = (a.read_depth().unwrap(), b.read_depth().unwrap());
    let invalid = from.data.iter().filter(|v| v.is_nan()).count() as f64 / from.data.len() as f64;
    assert!(invalid > 0.01 && invalid < 0.4, "{invalid}");
    let mut off = Vec::new();
    for (col, row) in
        (0..from.height).step_by(7).flat_map(|r| (0..from.width).step_by(7).map(move |c| (c, r)))
    {
        let z = f64::from(from.at(col, row));
        let ray = (DVec2::new(col as f64, row as f64) - a.camera.principal) / a.camera.focal;
        let p = a.camera.center + a.camera.cam_from_site.transpose() * (z * ray.extend(1.0));
        if z.is_nan() {
            continue;
        }
        let seen = b.camera.cam_from_site * (p - b.camera.center);
        if let Some(px) = b.camera.project(Point::new(p.x, p.y, p.z)) {
            let there = f64::from(to.get(px.col.round() as i64, px.row.round() as i64));
            off.extend(Some((there - seen.z).abs()).filter(|d| !d.is_nan()));
        }
    }
    assert!(off.len() > 2000);
    let median = satgs::stats::quantile(off, 0.5).unwrap();
    println!("median difference of depths: {median:.4} m");
    assert!(median < 0.03, "{median}");
}

#[test]
fn levir_scenes_are_read_with_commas_or_blanks_and_their_split() {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("scene_000");
    std::fs::write(parent.path().join("view_split.txt"), "2\n0 2\n1\n1\n").unwrap();
    std::fs::create_dir_all(folder.join("Cams")).unwrap();
    for view in 0..3 {
        image(&folder.join(format!("Images/00{view}.png")), SIZE);
        let text = format!(
            "extrinsic\n1 0 0 {view}\n0 1 0 2\n0 0 1 3\n0 0 0 1\n\nintrinsic\n30 0 15\n0 31 11\n0 0 1\n\n400 700\n"
        );
        let text = if view == 1 { text.replace(' ', ", ") } else { text };
        std::fs::write(folder.join(format!("Cams/00{view}.txt")), text).unwrap();
    }
    let scene = read(&folder);
    assert_eq!((scene.layout, scene.views.len()), (Layout::Levir, 3));
    let roles: Vec<Role> = scene.views.iter().map(|v| v.role).collect();
    assert_eq!(roles, [Role::Train, Role::Test, Role::Train]);
    assert_eq!(scene.views[1].camera.center, DVec3::new(-1.0, -2.0, -3.0));
    assert_eq!(
        (scene.views[1].camera.focal, scene.views[1].camera.principal),
        (DVec2::new(30.0, 31.0), DVec2::new(15.0, 11.0))
    );
}

/// A list of positions in UTM zone 32 that a similarity brings the camera centres to.
fn geo_list() -> (String, impl Fn(DVec3) -> DVec3) {
    let rotation = DMat3::from_euler(glam::EulerRot::XYZ, -2.0, 0.3, 0.9);
    let map = move |p: DVec3| 12.5 * (rotation * p) + DVec3::new(500_400.0, 5_400_700.0, 310.0);
    let line = |(i, c): (usize, &[f64; 3])| {
        let p = map(DVec3::from_array(*c));
        format!("view{i}.png {} {} {}\n", p.x, p.y, p.z)
    };
    (
        "EPSG:32632\n# name easting northing height\n".to_owned()
            + &CENTERS.iter().enumerate().map(line).collect::<String>(),
        map,
    )
}

/// The phone's model with names without blanks, which lists of positions need.
fn phone_without_blanks() -> colmap::ColmapModel {
    let mut model = phone();
    for image in &mut model.images {
        image.name = image.name.replace(' ', "");
    }
    model
}

#[test]
fn a_list_of_positions_moves_the_scene_into_the_site_frame() {
    let folder = tempfile::tempdir().unwrap();
    project(folder.path(), &phone_without_blanks(), Format::Binary);
    let (list, map) = geo_list();
    std::fs::write(folder.path().join("geo.txt"), list).unwrap();
    let plain = read(folder.path());
    let scene = georeferenced(folder.path(), GeoreferenceSource::File(folder.path().join("geo.txt")));
    let found = scene.georeference.unwrap();
    let fit = found.fit.as_ref().unwrap();
    assert_eq!((found.grid.epsg, fit.quality.points), (32632, 4));
    assert!((found.scale - 12.5).abs() < 1e-6 && fit.quality.rms_m < 1e-6, "{found:?}");
    for (a, b) in plain.points.iter().zip(&scene.points) {
        let utm = found.grid.utm_from_site(b.position).xyz();
        assert!((map(DVec3::from_array(a.position.xyz())) - DVec3::from_array(utm)).length() < 1e-5);
        assert!(b.position.xyz().iter().all(|v| v.abs() < 20.0), "the origin is in the middle of the scene");
        for (before, after) in plain.views.iter().zip(&scene.views) {
            let (p, q) =
                (before.camera.project(a.position).unwrap(), after.camera.project(b.position).unwrap());
            assert!(p.distance(q) < 1e-6, "the images show the same as before");
        }
    }
}

#[test]
fn a_given_similarity_is_used_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    project(folder.path(), &phone(), Format::Binary);
    let file = folder.path().join("georef.json");
    let text = r#"{"epsg": 32632, "scale": 2.0, "rotation": [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
        "translation": [500000.0, 5400000.0, 100.0]}"#;
    std::fs::write(&file, text).unwrap();
    let (plain, scene) = (read(folder.path()), georeferenced(folder.path(), GeoreferenceSource::File(file)));
    let grid = scene.georeference.unwrap().grid;
    let ([x, y, z], utm) =
        (plain.points[5].position.xyz(), grid.utm_from_site(scene.points[5].position).xyz());
    let expected = [500_000.0 - 2.0 * y, 5_400_000.0 + 2.0 * x, 100.0 + 2.0 * z];
    assert!(utm.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{utm:?} {expected:?}");
}

/// The drone's GPS is good to a few metres.
#[test]
fn gps_of_photographs_places_the_drone_scene() {
    let Some(data) = data_dir() else { return };
    let scene = georeferenced(&data.join("perspective/brighton"), GeoreferenceSource::Exif);
    let found = scene.georeference.unwrap();
    println!("{found:?}");
    let fit = found.fit.as_ref().unwrap();
    assert_eq!((found.grid.epsg, fit.quality.points), (32615, 18));
    assert!(fit.quality.rms_m < 5.0);
    // Cameras look down from above the points.
    for view in &scene.views {
        let middle = Pixel::new(0.5 * view.camera.size.0 as f64, 0.5 * view.camera.size.1 as f64);
        assert!(view.camera.ray(middle)[2] < -0.9);
    }
}

#[test]
fn info_shows_what_was_read_and_commands_for_satellites_refuse_it() {
    let folder = tempfile::tempdir().unwrap();
    project(folder.path(), &phone_without_blanks(), Format::Text);
    std::fs::write(folder.path().join("geo.txt"), geo_list().0).unwrap();
    let (scene, list) = (folder.path().to_str().unwrap(), folder.path().join("geo.txt"));
    let out = satgs(&["info", scene, "--georef", list.to_str().unwrap(), "--test-views", "2"]);
    let text = String::from_utf8_lossy(&out.stdout);
    for says in [
        "COLMAP model: 4 views, 2 to train on, 2 held back (view0, view2)",
        "OPENCV: 1 camera of 4 views, 32 x 24 px, focal length 30.0 to 31.0 px, distortion up to",
        "points: 9",
        "reprojection error: 0.000 px",
        "georeference: EPSG:32632",
        "4 camera positions fitted with an RMS of 0.00 m",
    ] {
        assert!(text.contains(says), "`{says}` in {text}{}", String::from_utf8_lossy(&out.stderr));
    }
    let out = satgs(&["--json", "info", scene]);
    let json: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let of =
        |pointer: &str| json.pointer(pointer).or_else(|| json.pointer(&format!("/info{pointer}"))).cloned();
    assert_eq!(of("/train"), Some(3.into()), "{json}");
    assert_eq!(of("/views/1/model"), Some("OPENCV".into()));
    let run = folder.path().join("run");
    for command in ["ba", "plan"] {
        let out = satgs(&[command, scene, "-o", run.to_str().unwrap()]);
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(2), "{said}");
        assert!(said.contains("is a perspective scene (COLMAP model)"), "{said}");
        assert!(!run.exists());
    }
    let out = satgs(&["info", scene, "--rpcs", "x"]);
    assert!(String::from_utf8_lossy(&out.stderr).contains("--rpcs is for satellite scenes"));
}

/// A made scene of ScanNet++ with a fisheye lens: four images in the model, of which the first does not exist and the last is in no
/// list; a mask, and rendered depths that grow by 1 cm with the column from 1.5 m, and of which the first four columns are unknown.
fn scannetpp(folder: &Path) {
    let part = folder.join("dslr");
    let model = model(LensModel::OpenCvFisheye, &[30.0, 31.0, 16.25, 11.75, 0.02, -0.01, 0.001, 0.0]);
    colmap::write(&part.join("colmap"), &model, Format::Text).unwrap();
    let names: Vec<&str> = model.images.iter().map(|i| i.name.as_str()).collect();
    let png = |kind: &str, name: &str| part.join(kind).join(name).with_extension("png");
    ["resized_anon_masks", "render_depth"]
        .iter()
        .for_each(|f| std::fs::create_dir_all(part.join(f)).unwrap());
    for name in &names[1..] {
        image(&part.join("resized_images").join(name), SIZE);
        depth_png(
            &png("render_depth", name),
            SIZE,
            |col, _| if col < 4 { 0 } else { 1500 + 10 * col as u16 },
        );
    }
    depth_png(&png("resized_anon_masks", names[1]), SIZE, |col, _| u16::from(col > 10));
    let lists = serde_json::json!({ "train": [names[0], names[1]], "test": [names[2]], "has_masks": true });
    std::fs::write(part.join("train_test_lists.json"), lists.to_string()).unwrap();
}

#[test]
fn scannetpp_scenes_are_read_with_their_lists_depths_and_masks() {
    let folder = tempfile::tempdir().unwrap();
    scannetpp(folder.path());
    for path in [folder.path().to_path_buf(), folder.path().join("dslr")] {
        let scene = read(&path);
        assert_eq!((scene.layout, scene.is_metric(), scene.skipped.len()), (Layout::ScanNetPp, true, 2));
        let roles: Vec<Role> = scene.views.iter().map(|v| v.role).collect();
        assert_eq!(roles, [Role::Train, Role::Test]);
        assert!(scene.views[0].masks.len() == 1 && scene.views[1].masks.is_empty());
        let depth = scene.views[0].read_depth().unwrap();
        // Near the principal point, column 16.25, the lens does not distort; at the rim it does.
        assert!((depth.at(16, 12) - 1.66).abs() < 1e-6, "{}", depth.at(16, 12));
        assert!(depth.at(2, 12).is_nan() && depth.at(5, 12) > 1.5, "{}", depth.at(5, 12));
        assert!(scene.views[0].read_image().unwrap().planes[0].at(3, 12).is_nan(), "hidden by the mask");
        assert_eq!(scene.points.len(), 9);
    }
    std::fs::write(folder.path().join("dslr/train_test_lists.json"), r#"{"train": []}"#).unwrap();
    let error = PerspectiveScene::read(folder.path(), &PerspectiveOptions::default()).unwrap_err();
    assert!(error.to_string().contains("train_test_lists.json"), "{error}");
}
