//! Tests of the photographs from the air: cameras, heights, mesh.

use super::*;
use crate::simulate::Relief;
use crate::simulate::field::tests::one_box;

#[test]
fn cameras_look_at_the_middle_of_the_town_with_all_of_it_inside_the_field() {
    let cameras = cameras::above(DVec3::new(0.0, 0.0, 5.0), 21, 512, KeyedRng::new(1));
    for (i, camera) in cameras.iter().enumerate() {
        let tilt_deg = (-camera.axes[2].z).acos().to_degrees();
        assert!(tilt_deg < cameras::MOST_TILT_DEG + 1e-9 && (i > 0) == (tilt_deg > 1.0), "{tilt_deg}");
        assert!((camera.center.z - 605.0).abs() < 1e-9);
        assert!(camera.axes[1].y < -0.8, "north is up in the image");
        for (col, row) in [(0.0, 0.0), (511.0, 0.0), (0.0, 511.0), (511.0, 511.0)] {
            let along = camera.direction(Pixel::new(col, row));
            // 40 m below the town's centre, which hills do not reach.
            let ground = camera.center + along * ((-40.0 - camera.center.z) / along.z);
            let reach = ground.x.abs().max(ground.y.abs());
            assert!((110.0..HALF_TOWN_M).contains(&reach), "{ground}");
        }
    }
    let training = cameras::spread(&cameras);
    let center = |i: usize| cameras[training[i]].center;
    assert!(training.len() == 3 && training.is_sorted());
    for (a, b) in [(0, 1), (1, 2), (0, 2)] {
        assert!(center(a).distance(center(b)) > 400.0, "{} {}", center(a), center(b));
    }
}

#[test]
fn rays_end_on_the_surface_to_a_tenth_of_a_millimetre() {
    let field = one_box();
    let from = DVec3::new(30.0, -20.0, 600.0);
    for k in 0..400 {
        let rng = KeyedRng::new(5).key(k);
        let target = DVec3::new(rng.key(1).uniform_in(-5.0, 15.0), rng.key(2).uniform_in(-12.0, 2.0), 0.0);
        let [x, y, z] = first_place(&field, from, target - from).unwrap();
        assert!(
            (z - field.height_m(x, y)).abs() < 1e-4 * (1.0 + 50.0 * f64::from(u8::from(z < 161.9))),
            "{z}"
        );
    }
    // Straight down onto the roof.
    let roof = first_place(&field, DVec3::new(8.0, -6.0, 600.0), DVec3::NEG_Z).unwrap();
    assert!((roof[2] - 162.0).abs() < 1e-6, "{roof:?}");
    assert!(first_place(&field, from, DVec3::Z).is_none());
}

#[test]
fn depths_are_those_of_the_surface_of_the_town_and_normals_face_the_camera() {
    for relief in [Relief::Rolling, Relief::Hilly] {
        let options = AerialOptions { views: 4, size_px: 64, relief, ..AerialOptions::default() };
        let scene = TownFromAbove::new(&options).unwrap();
        let field = &scene.town.field;
        let cameras = cameras::above(DVec3::ZERO, 4, 64, KeyedRng::new(2));
        for k in 0..2000 {
            let rng = KeyedRng::new(3).key(k);
            let camera = &cameras[k as usize % 4];
            let px = Pixel::new(rng.key(1).uniform_in(0.0, 63.0), rng.key(2).uniform_in(0.0, 63.0));
            let along = camera.direction(px);
            let hit = scene.first_hit(camera.center, along).unwrap();
            let place = camera.center + along * hit.distance;
            let [east, north] = field.slope(place.x, place.y);
            let off_m = (place.z + DATUM_M - field.height_m(place.x, place.y)).abs();
            assert!(off_m < 1e-4 * (1.0 + east.hypot(north)), "{place} {off_m}");
            assert!(hit.normal.dot(along) < 0.0 && (hit.normal.length() - 1.0).abs() < 1e-9);
        }
    }
}

#[test]
fn vertices_of_the_mesh_lie_on_the_town_and_are_close_to_each_other_on_walls() {
    let field = one_box();
    let mesh = mesh::of_field(&field, |_| [1, 2, 3]);
    let at = |v: u32| glam::Vec3::from_array(mesh.vertices[v as usize]).as_dvec3();
    for t in &mesh.triangles {
        let [a, b, c] = t.map(at);
        assert!((b - a).cross(c - a).z > 0.0, "{a} {b} {c}");
        // On a wall of 12 m between two nodes, a thousandth of the 0.25 m is 5 cm of height.
        assert!((a.z + DATUM_M - field.height_m(a.x, a.y)).abs() < 1e-3, "{a}");
    }
    let on_walls = mesh.vertices.iter().filter(|v| (0.5..11.5).contains(&v[2])).count();
    // 32 m of walls, 12 m high, with at least four vertices a metre along them and one a metre up.
    assert!(on_walls >= 32 * 4 * 11, "{on_walls}");
}
