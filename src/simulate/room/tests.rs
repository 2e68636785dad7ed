//! Tests of the room: what cameras see, what the mesh holds.

use super::shape::{LEGS, Part, ROOM, SPHERE_CENTER, SPHERE_RADIUS_M, TABLE_TOP, first_contact};
use super::*;

fn room() -> Room {
    Room { shading: Shading::new(KeyedRng::new(0)) }
}

#[test]
fn cameras_are_clear_of_all_surfaces_and_see_all_of_the_room() {
    for seed in 0..3 {
        let cameras = cameras::around(60, 640, KeyedRng::new(seed));
        for camera in &cameras {
            assert!(cameras::room_around_m(camera.center) > 0.35, "{}", camera.center);
        }
        let mesh = mesh::of_room(&room().shading);
        let seen_by = |place: &[f32; 3]| {
            let place = glam::Vec3::from_array(*place).as_dvec3();
            let sees = |camera: &&PinholeCamera| {
                camera.project(place).is_some_and(|(px, depth)| {
                    let hit = first_contact(camera.center, camera.direction(px));
                    camera.contains(px, 0.0) && hit.distance > depth - 1e-4
                })
            };
            cameras.iter().filter(sees).count()
        };
        let seen: Vec<usize> = mesh.vertices.par_iter().step_by(97).map(seen_by).collect();
        let share = |least| seen.iter().filter(|n| **n >= least).count() as f64 / seen.len() as f64;
        assert!(share(3) > 0.985 && share(6) > 0.94, "{seed}: {} {} {}", share(1), share(3), share(6));
    }
}

#[test]
fn vertices_of_the_mesh_lie_on_surfaces_and_triangles_face_the_room() {
    let mesh = mesh::of_room(&room().shading);
    assert!(mesh.vertices.len() > 150_000 && mesh.vertices.len() == mesh.colors.len());
    let from_box = |p: DVec3, low: DVec3, high: DVec3| {
        let outside = (p - p.clamp(low, high)).length();
        outside.max((p - low).min(high - p).min_element().max(0.0))
    };
    for vertex in &mesh.vertices {
        let p = glam::Vec3::from_array(*vertex).as_dvec3();
        let solids = LEGS.iter().chain([&ROOM, &TABLE_TOP]).map(|b| from_box(p, b.low, b.high));
        let sphere = ((p - SPHERE_CENTER).length() - SPHERE_RADIUS_M).abs();
        let nearest = solids.fold(sphere, f64::min);
        assert!(nearest < 1e-6, "{p} {nearest}");
    }
    let at = |v: u32| glam::Vec3::from_array(mesh.vertices[v as usize]).as_dvec3();
    for t in mesh.triangles.iter().step_by(53) {
        let [a, b, c] = t.map(at);
        let (middle, normal) = ((a + b + c) / 3.0, (b - a).cross(c - a).normalize());
        // A ray from just before the middle of the triangle meets it, from the side to which its normal points.
        let hit = first_contact(middle + 1e-3 * normal, -normal);
        assert!(hit.normal.dot(normal) > 0.99 && hit.distance < 2e-3, "{middle} {normal} {hit:?}");
    }
}

#[test]
fn walls_without_texture_have_one_colour() {
    let room = room();
    let camera =
        PinholeCamera::looking_at(DVec3::new(0.9, 1.2, 1.5), DVec3::new(2.0, 2.5, 1.4), DVec3::Z, 48, 30.0);
    let picture = room.picture(&camera);
    let part = |col: f64, row: f64| first_contact(camera.center, camera.direction(Pixel::new(col, row))).part;
    for wall in [Part::EastWall, Part::NorthWall] {
        let whole = |k: &usize| {
            let (col, row) = ((k % 48) as f64, (k / 48) as f64);
            [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)]
                .iter()
                .all(|(u, v)| part(col + u, row + v) == wall)
        };
        let colors: std::collections::BTreeSet<_> =
            (0..48 * 48).filter(whole).map(|k| picture[3 * k..3 * k + 3].to_vec()).collect();
        assert_eq!(colors.len(), 1, "{wall:?} {colors:?}");
    }
}

#[test]
fn surfaces_with_texture_vary_from_pixel_to_pixel() {
    let room = room();
    for target in [
        DVec3::NEG_X,
        DVec3::NEG_Y,
        DVec3::new(0.1, -0.2, 1.0),
        DVec3::new(-0.3, -0.2, -1.0),
        DVec3::new(0.9, 0.9, -1.0),
    ] {
        let eye = DVec3::new(-0.9, -1.3, 1.2);
        let camera = PinholeCamera::looking_at(eye, eye + target, DVec3::new(0.1, 0.1, 1.0), 64, 200.0);
        let picture = room.picture(&camera);
        let steps = picture.chunks_exact(3).zip(picture.chunks_exact(3).skip(1));
        let changes = steps.filter(|(a, b)| a[1].abs_diff(b[1]) > 2).count();
        assert!(changes > 64 * 64 / 3, "{target}: {changes}");
    }
}
