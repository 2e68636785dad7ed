//! Priors of a ball, and what contradicts the points on it.

use super::*;
use crate::frame::{CenterPx, Pixel, Point, Site};
use crate::io::{NpyArray, NumberKind};
use crate::perspective::{LensCamera, LensModel, PerspectiveView};
use crate::progress::{Event, NoProgress, Recorder};
use crate::random::CounterRng;
use crate::scene::Role;
use glam::{DMat3, DVec2, DVec3};
use std::path::{Path, PathBuf};

pub(super) const SIZE: (usize, usize) = (64, 48);

/// A view from 4 m away of a ball of radius 1 m around the origin.
pub(super) fn view(k: usize) -> PerspectiveView {
    let (sin, cos) = (0.5 * k as f64).sin_cos();
    let center = DVec3::new(4.0 * cos, 4.0 * sin, 1.5);
    let forward = (-center).normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let cam_from_site = DMat3::from_cols(right, forward.cross(right), forward).transpose();
    let lens = LensCamera::from_colmap(LensModel::Pinhole, &[55.0, 55.0, 32.0, 24.0], SIZE).unwrap();
    PerspectiveView {
        name: format!("photo.{k}"),
        path_in_scene: PathBuf::from(format!("photo.{k}.png")),
        image: PathBuf::from(format!("photo.{k}.png")),
        role: Role::Train,
        turned: None,
        lens_camera: lens,
        camera: PerspectiveView::undistorted_camera(&lens, cam_from_site, center, 1),
        downsampling: 1,
        masks: Vec::new(),
        transparency: None,
        depth: None,
        observed: Vec::new(),
    }
}

fn points() -> Vec<Point<Site>> {
    let of = |i| CounterRng::new(5, 0, 0, i).direction();
    (0..8000).map(of).map(|[x, y, z]| Point::new(x, y, z)).collect()
}

/// Depth and normal of the ball at each pixel, NaN beside it.
fn ball(view: &PerspectiveView, (width, height): (usize, usize)) -> (Vec<f32>, Vec<[f32; 3]>) {
    let camera = &view.camera;
    let factor = DVec2::new(SIZE.0 as f64 / width as f64, SIZE.1 as f64 / height as f64);
    let pixel = |i: usize| {
        let at = (DVec2::new((i % width) as f64, (i / width) as f64) + 0.5) * factor - 0.5;
        let ray = DVec3::from_array(camera.ray(Pixel::<CenterPx>::new(at.x, at.y)));
        let middle = ray.dot(camera.center);
        let inside = middle * middle - camera.center.length_squared() + 1.0;
        let p = camera.center + ray * (-middle - inside.sqrt());
        let depth = (camera.cam_from_site * (p - camera.center)).z;
        (depth as f32, (camera.cam_from_site * p).as_vec3().to_array())
    };
    (0..width * height).map(pixel).unzip()
}

/// Writes the depths of views, each value changed, of pictures of this size.
fn write_depths(folder: &Path, views: &[PerspectiveView], size: (usize, usize), change: impl Fn(f32) -> f32) {
    for view in views {
        let values = ball(view, size).0.into_iter().map(&change).collect();
        let array = NpyArray { shape: vec![size.1, size.0], values, kind: NumberKind::Float };
        array.write(&folder.join(format!("{}.npy", view.name))).unwrap();
    }
}

fn depths(folder: &Path, kind: Option<DepthKind>) -> PriorSources {
    PriorSources { depths: Some(PriorSource::Folder(folder.into())), kind, normals: None }
}

fn read(sources: &PriorSources, views: &[PerspectiveView]) -> Result<Vec<ViewPriors>, PriorError> {
    read_priors(sources, &views.iter().collect::<Vec<_>>(), &points(), Path::new("unused"), &NoProgress)
}

#[test]
fn the_kind_of_depths_is_found_from_the_points_of_the_scene() {
    let views = [view(0), view(1)];
    for kind in [DepthKind::Relative, DepthKind::Disparity] {
        let change = |d: f32| if kind == DepthKind::Relative { 3.0 * d + 2.0 } else { 7.0 / d + 0.1 };
        let folder = tempfile::tempdir().unwrap();
        write_depths(folder.path(), &views, SIZE, change);
        let priors = read(&depths(folder.path(), None), &views).unwrap();
        let prior = priors[1].depth.as_ref().unwrap();
        assert_eq!(prior.kind, kind);
        let expected = change(ball(&views[1], SIZE).0[24 * 64 + 32]);
        assert!((prior.values.at(32, 24) - expected).abs() < 1e-6);
        assert!(prior.values.at(0, 0).is_nan());
    }
}

#[test]
fn depths_of_another_size_are_brought_to_that_of_the_image() {
    let views = [view(0)];
    let folder = tempfile::tempdir().unwrap();
    write_depths(folder.path(), &views, (32, 24), |d| d);
    let priors = read(&depths(folder.path(), Some(DepthKind::Metric)), &views).unwrap();
    let (found, expected) = (&priors[0].depth.as_ref().unwrap().values, ball(&views[0], SIZE).0);
    for (col, row) in [(32, 24), (25, 30), (38, 20)] {
        assert!((found.at(col, row) - expected[row * 64 + col]).abs() < 0.01);
    }
}

#[test]
fn whole_numbers_have_a_unit_and_pixels_without_a_depth() {
    let views = [view(0)];
    let folder = tempfile::tempdir().unwrap();
    let stored = |d: f32| if d.is_nan() { 65535.0 } else { (1000.0 * d).round() };
    let values: Vec<u16> = ball(&views[0], SIZE).0.into_iter().map(|d| stored(d) as u16).collect();
    let picture = image::ImageBuffer::<image::Luma<u16>, _>::from_raw(64, 48, values).unwrap();
    picture.save(folder.path().join("photo.0.png")).unwrap();
    std::fs::write(folder.path().join("prior.json"), r#"{"kind": "metric", "scale": 0.001}"#).unwrap();
    let priors = read(&depths(folder.path(), None), &views).unwrap();
    let prior = priors[0].depth.as_ref().unwrap();
    assert!((prior.values.at(32, 24) - ball(&views[0], SIZE).0[24 * 64 + 32]).abs() < 6e-4);
    assert!(prior.values.at(0, 0).is_nan() && prior.kind == DepthKind::Metric);
}

#[test]
fn depths_that_contradict_the_scene_are_refused() {
    let views = [view(0), view(1)];
    let refusal = |kind, change: &dyn Fn(f32) -> f32| {
        let folder = tempfile::tempdir().unwrap();
        write_depths(folder.path(), &views, SIZE, change);
        read(&depths(folder.path(), kind), &views).err().unwrap()
    };
    let error = refusal(Some(DepthKind::Metric), &|d| 1.0 / d);
    assert!(
        matches!(error, PriorError::Opposite { kind: DepthKind::Metric, correlation, .. } if correlation < -0.9),
        "{error}"
    );
    let error = refusal(Some(DepthKind::Disparity), &|d| d);
    assert!(matches!(error, PriorError::Opposite { .. }), "{error}");
    // Depths that grow from left to right have nothing to do with the ball.
    let folder = tempfile::tempdir().unwrap();
    let values = (0..SIZE.0 * SIZE.1).map(|i| (1 + i % SIZE.0) as f32).collect();
    let slope = NpyArray { shape: vec![SIZE.1, SIZE.0], values, kind: NumberKind::Float };
    views.iter().for_each(|view| slope.write(&folder.path().join(format!("{}.npy", view.name))).unwrap());
    let error = read(&depths(folder.path(), None), &views).err();
    assert!(matches!(error, Some(PriorError::OtherScene { views: 2, .. })), "{error:?}");
    let error = refusal(None, &|_| 2.0);
    assert!(matches!(error, PriorError::Empty { fault: "has the same depth everywhere", .. }), "{error}");
    let error = refusal(None, &|_| f32::NAN);
    assert!(matches!(error, PriorError::Empty { fault: "has no depth", .. }), "{error}");
}

#[test]
fn maps_that_do_not_fit_their_images_are_refused() {
    let views = [view(0)];
    let folder = tempfile::tempdir().unwrap();
    let error = |sources: &PriorSources| read(sources, &views).unwrap_err().to_string();
    let sources = depths(folder.path(), None);
    assert!(error(&sources).contains("no file for any of the 1 training views, such as `photo.0.npy`"));
    assert!(error(&depths(&folder.path().join("none"), None)).contains("is no folder"));
    write_depths(folder.path(), &views, (48, 48), |d| d);
    assert!(error(&sources).contains("photo.0.npy` is of 48 x 48 pixels, expected the shape of 64 x 48"));
    let normals = PriorSources { normals: sources.depths.clone(), ..PriorSources::default() };
    assert!(error(&normals).contains("of 1 values a pixel, expected three"));
    std::fs::write(folder.path().join("photo.0.npy"), b"\x93NUMPY").unwrap();
    assert!(error(&sources).contains("photo.0.npy"));
    std::fs::write(folder.path().join("prior.json"), r#"{"kind": "far"}"#).unwrap();
    assert!(error(&sources).contains("prior.json"));
}

#[test]
fn views_without_a_map_are_trained_without_and_named() {
    let views = [view(0), view(1)];
    let folder = tempfile::tempdir().unwrap();
    write_depths(folder.path(), &views[1..], SIZE, |d| d);
    let recorder = Recorder::default();
    let sources = depths(folder.path(), None);
    let priors =
        read_priors(&sources, &views.iter().collect::<Vec<_>>(), &points(), Path::new("unused"), &recorder)
            .unwrap();
    assert!(priors[0].depth.is_none() && priors[1].depth.is_some());
    let events = recorder.events();
    let is_said = |text: &str| text.contains("for 1 of 2 training views, the first is photo.0");
    assert!(events.iter().any(|e| matches!(e, Event::Warning(text) if is_said(text))), "{events:?}");
}

#[test]
fn without_points_the_kind_of_depths_must_be_said() {
    let views = [view(0)];
    let folder = tempfile::tempdir().unwrap();
    write_depths(folder.path(), &views, SIZE, |d| d);
    let read =
        |kind| read_priors(&depths(folder.path(), kind), &[&views[0]], &[], Path::new("unused"), &NoProgress);
    assert!(matches!(read(None), Err(PriorError::NoKind { .. })));
    assert_eq!(read(Some(DepthKind::Relative)).unwrap()[0].depth.as_ref().unwrap().kind, DepthKind::Relative);
}

/// Writes normals, changed, as arrays of rows x columns x 3.
fn write_normals(
    folder: &Path,
    views: &[PerspectiveView],
    change: impl Fn([f32; 3]) -> [f32; 3],
) -> PriorSources {
    for view in views {
        let values = ball(view, SIZE).1.into_iter().flat_map(&change).collect();
        let array = NpyArray { shape: vec![SIZE.1, SIZE.0, 3], values, kind: NumberKind::Float };
        array.write(&folder.join(format!("{}.npy", view.name))).unwrap();
    }
    PriorSources { normals: Some(PriorSource::Folder(folder.into())), ..PriorSources::default() }
}

#[test]
fn normals_in_other_axes_are_brought_to_those_of_the_camera() {
    let views = [view(0), view(1)];
    for signs in [[1.0f32, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, 1.0]] {
        let folder = tempfile::tempdir().unwrap();
        let sources =
            write_normals(folder.path(), &views, |n| std::array::from_fn(|k| 0.9 * signs[k] * n[k]));
        let priors = read(&sources, &views).unwrap();
        let [x, y, z] = &priors[1].normal.as_ref().unwrap().planes;
        let (at, expected) = (20 * 64 + 25, ball(&views[1], SIZE).1[20 * 64 + 25]);
        for (found, expected) in [x.data[at], y.data[at], z.data[at]].into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-5, "{signs:?}: {found} {expected}");
        }
        assert!(x.at(0, 0).is_nan());
    }
}

#[test]
fn normals_that_do_not_fit_the_points_are_refused() {
    let views = [view(0), view(1)];
    let folder = tempfile::tempdir().unwrap();
    // All point to the right: up and down cannot be told.
    let error = read(&write_normals(folder.path(), &views, |_| [1.0, 0.0, 0.0]), &views).unwrap_err();
    assert!(matches!(error, PriorError::Normals { .. }), "{error}");
    let error = read(&write_normals(folder.path(), &views, |_| [0.0; 3]), &views).unwrap_err();
    assert!(matches!(error, PriorError::Empty { .. }), "{error}");
}
