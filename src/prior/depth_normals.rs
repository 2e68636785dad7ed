//! Normals of the surfaces that depths of a view show.

use super::map::NormalPrior;
use crate::io::Grid2;
use crate::perspective::PinholeCamera;
use glam::{DMat2, DVec2, DVec3};

/// A normal is that of the plane through the depths at these columns and rows around its pixel.
const OFFSETS: [i64; 5] = [-4, -2, 0, 2, 4];
/// Depths that differ by more than this share belong to another surface.
const SAME_SURFACE: f32 = 0.05;
/// Fewest depths of a plane.
const FEWEST: usize = 12;

/// Unit normals that face the camera, in its axes; NaN where depths are missing or jump.
///
/// On a plane `n P = d` the inverse depth at the ray `(x, y, 1)` is `(n / d) (x, y, 1)`: a linear function, whose coefficients are
/// found by least squares.
pub(super) fn normals_of_depths(depth: &Grid2, camera: &PinholeCamera) -> NormalPrior {
    let ray = |col: i64, row: i64| (DVec2::new(col as f64, row as f64) - camera.principal) / camera.focal;
    let normal = |col: i64, row: i64| {
        let (center, z) = (ray(col, row), depth.get(col, row));
        let around = OFFSETS.into_iter().flat_map(|dr| OFFSETS.map(|dc| (col + dc, row + dr)));
        let (mut same, mut found) = ([(DVec2::ZERO, 0.0); OFFSETS.len() * OFFSETS.len()], 0);
        for (c, r) in around {
            let other = depth.get(c, r);
            if (other - z).abs() < SAME_SURFACE * z {
                same[found] = (ray(c, r) - center, f64::from(other).recip());
                found += 1;
            }
        }
        let same = &same[..found];
        if found < FEWEST {
            return DVec3::NAN;
        }
        let count = found as f64;
        let mean = same.iter().map(|s| s.0).sum::<DVec2>() / count;
        let mean_inverse = same.iter().map(|s| s.1).sum::<f64>() / count;
        let (mut products, mut right) = (DMat2::ZERO, DVec2::ZERO);
        for (at, inverse) in same {
            let from_mean = *at - mean;
            products += DMat2::from_cols(from_mean * from_mean.x, from_mean * from_mean.y);
            right += from_mean * (inverse - mean_inverse);
        }
        let slope = products.inverse() * right;
        -slope.extend(mean_inverse - slope.dot(center + mean)).normalize()
    };
    let (width, height) = (depth.width, depth.height);
    let mut planes = [(); 3].map(|()| Grid2::filled(width, height, f32::NAN));
    for row in 0..height {
        for col in 0..width {
            let found = normal(col as i64, row as i64).to_array();
            planes.iter_mut().zip(found).for_each(|(plane, v)| plane.data[row * width + col] = v as f32);
        }
    }
    NormalPrior { planes }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;

    #[test]
    fn normals_of_a_plane_are_exact_and_unknown_at_a_jump() {
        let camera = PinholeCamera {
            cam_from_site: DMat3::IDENTITY,
            center: DVec3::ZERO,
            focal: DVec2::new(60.0, 55.0),
            principal: DVec2::new(20.3, 14.8),
            size: (40, 30),
        };
        let normal = DVec3::new(0.3, -0.5, -0.8).normalize();
        let depth = |col: usize, row: usize| {
            let ray = (DVec2::new(col as f64, row as f64) - camera.principal) / camera.focal;
            let plane = -2.0 / normal.dot(ray.extend(1.0));
            (if col < 20 { plane } else { 2.0 * plane }) as f32
        };
        let found = normals_of_depths(&Grid2::from_fn(40, 30, depth), &camera).planes;
        let at = |col: usize, row: usize| [0, 1, 2].map(|k| f64::from(found[k].at(col, row)));
        for (col, row) in [(8, 9), (18, 15), (22, 15), (33, 20)] {
            assert!(DVec3::from_array(at(col, row)).distance(normal) < 1e-3, "{:?}", at(col, row));
        }
        let empty = normals_of_depths(&Grid2::filled(40, 30, f32::NAN), &camera);
        assert!(empty.planes[0].data.iter().all(|v| v.is_nan()));
    }
}
