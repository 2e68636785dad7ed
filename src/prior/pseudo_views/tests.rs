//! A box on slanted ground, seen from one side.

use super::super::map::PixelColor;
use super::*;
use crate::frame::{CenterPx, Pixel};
use glam::{DMat3, DVec2};

/// The box, metres; below it the ground, whose altitude is 0.05 x + 0.02 y.
const BOX: [DVec3; 2] = [DVec3::new(-2.0, -3.0, -5.0), DVec3::new(2.0, 3.0, 4.0)];

fn camera(center: DVec3) -> PinholeCamera {
    let forward = (-center).normalize();
    let right = DVec3::NEG_Y.cross(forward).normalize();
    let cam_from_site = DMat3::from_cols(right, forward.cross(right), forward).transpose();
    let (focal, principal) = (DVec2::splat(200.0), DVec2::new(99.5, 74.5));
    PinholeCamera { cam_from_site, center, focal, principal, size: (200, 150) }
}

/// Depths of box and ground, and of the ground alone.
fn depths(camera: &PinholeCamera) -> [Grid2; 2] {
    let slope = DVec3::new(-0.05, -0.02, 1.0);
    let of = |with_box: bool| {
        Grid2::from_fn(camera.size.0, camera.size.1, |col, row| {
            let ray = DVec3::from_array(camera.ray(Pixel::<CenterPx>::new(col as f64, row as f64)));
            let ground = -camera.center.dot(slope) / ray.dot(slope);
            let (a, b) = ((BOX[0] - camera.center) / ray, (BOX[1] - camera.center) / ray);
            let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
            let hit = if with_box && enter < leave { enter.min(ground) } else { ground };
            (hit * (camera.cam_from_site * ray).z) as f32
        })
    };
    [of(true), of(false)]
}

fn gray<'a>() -> PixelColor<'a> {
    Box::new(|_, _| Some([100; 3]))
}

#[test]
fn the_ground_behind_a_box_is_filled_as_ground() {
    let seen_from = camera(DVec3::new(-9.0, 1.0, 30.0));
    let color = gray();
    let [depth, _] = depths(&seen_from);
    let views = [AlignedView { camera: &seen_from, depth: &depth, color: &color }];
    let cloud = super::super::hdd::cloud::cloud(&views, usize::MAX);
    let other = camera(DVec3::new(7.0, 1.0, 31.0));
    let Drawn { mut depth, hole, .. } = draw(&cloud, &other);
    let ([with_box, ground], (width, _)) = (depths(&other), other.size);
    fill_holes(&mut depth, &hole);
    // Pixels of the hole that show the ground beside the box, not those at the picture's border, which no view sees either.
    let is_inner = |i: usize| (20..180).contains(&(i % width)) && (15..135).contains(&(i / width));
    let inner: Vec<usize> = (0..hole.len())
        .filter(|i| hole[*i] && is_inner(*i) && (with_box.data[*i] - ground.data[*i]).abs() < 1e-4)
        .collect();
    assert!(inner.len() > 300, "{} pixels", inner.len());
    let errors: Vec<f64> =
        inner.iter().map(|i| f64::from((depth.data[*i] / ground.data[*i] - 1.0).abs())).collect();
    let largest = errors.iter().copied().fold(0.0, f64::max);
    let median = quantile(errors, 0.5).unwrap();
    assert!(median < 0.0009 && largest < 0.0044, "median {median}, largest {largest}");
}

#[test]
fn a_harmonic_fill_of_linear_values_is_linear_and_of_one_side_constant() {
    let plane = |i: usize| 2.0 + 0.01 * (i % 40) as f64 + 0.02 * (i / 40) as f64;
    let mut depth = Grid2::from_fn(40, 30, |col, row| (1.0 / plane(row * 40 + col)) as f32);
    let hole: Vec<bool> =
        (0..1200).map(|i| (10..25).contains(&(i % 40)) && (8..20).contains(&(i / 40))).collect();
    fill_holes(&mut depth, &hole);
    assert!((0..1200).all(|i| (f64::from(depth.data[i]) * plane(i) - 1.0).abs() < 1e-4));
    // A hole as wide as the picture has known pixels on two sides only, of which the nearer one does not count.
    let mut depth = Grid2::from_fn(40, 30, |_, row| if row < 10 { 5.0 } else { 4.0 });
    let hole: Vec<bool> = (0..1200).map(|i| (10..20).contains(&(i / 40))).collect();
    fill_holes(&mut depth, &hole);
    assert!((0..1200).filter(|i| hole[*i]).all(|i| (depth.data[i] - 5.0).abs() < 1e-3));
    let mut nothing = Grid2::filled(4, 4, f32::NAN);
    fill_holes(&mut nothing, &[true; 16]);
    assert!(nothing.data.iter().all(|d| d.is_nan()));
}

#[test]
fn proposals_are_neither_in_front_of_what_views_see_nor_near_each_other() {
    let seen_from = [camera(DVec3::new(-9.0, 1.0, 30.0)), camera(DVec3::new(-8.0, 4.0, 31.0))];
    let color = gray();
    let depths = seen_from.each_ref().map(|camera| depths(camera)[0].clone());
    let view = |(camera, depth)| AlignedView { camera, depth, color: &color };
    let views: Vec<AlignedView> = seen_from.iter().zip(&depths).map(view).collect();
    let cloud = super::super::hdd::cloud::cloud(&views, 10_000);
    let pseudo = pseudo_views(&views, &cloud);
    let proposals = proposals(&views, &cloud, &pseudo);
    assert!(pseudo.len() == 8 && pseudo.iter().any(|p| p.is_used), "{}", pseudo.len());
    assert!(proposals.len() > 50 && 2 * proposals.len() <= cloud.len(), "{}", proposals.len());
    for p in &proposals {
        assert!(views.iter().all(|v| v.in_front(p.position).is_none_or(|share| share <= IN_FRONT)));
    }
    let spacing = quantile(cloud.iter().map(|p| p.spacing).collect(), 0.5).unwrap();
    for (i, p) in proposals.iter().enumerate().step_by(7) {
        assert!(proposals[..i].iter().all(|q| q.position.distance(p.position) >= APART * spacing));
    }
}

#[test]
fn pseudo_views_look_at_the_place_the_right_way_up() {
    let cameras = [camera(DVec3::new(-9.0, 1.0, 30.0)), camera(DVec3::new(3.0, -4.0, 33.0))];
    for pose in poses(&cameras, DVec3::new(0.0, 0.0, 1.0)) {
        let at = (pose.cam_from_site * (DVec3::new(0.0, 0.0, 1.0) - pose.center)).normalize();
        assert!((at.z - 1.0).abs() < 1e-9, "{at}");
        assert!((pose.cam_from_site.determinant() - 1.0).abs() < 1e-9);
        assert!(pose.cam_from_site.row(1).dot(DVec3::NEG_Y) > 0.3);
    }
}
