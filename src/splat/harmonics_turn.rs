//! Colours that depend on the direction, of splats that are turned.

use super::harmonics::{MAX_DEGREE, basis_of};
use super::splats::Splats;
use glam::{DMat3, DVec3};
use nalgebra::{DMatrix, SMatrix};

/// Number of coefficients of a colour channel above degree 0.
const REST: usize = 15;
/// Directions at which turned and unturned functions are compared: more than coefficients, so that these follow from them.
const DIRECTIONS: usize = 64;

/// The highest degree of the spherical harmonics that a splat has: 0 to 3.
#[must_use]
pub fn degree(splats: &Splats) -> usize {
    let is_used = |degree: usize| {
        let first = degree * degree - 1;
        let is_zero =
            |channel: &[f32; REST]| channel[first..first + 2 * degree + 1].iter().all(|c| *c == 0.0);
        !splats.f_rest.iter().all(|rest| rest.as_chunks::<REST>().0.iter().all(is_zero))
    };
    (1..=MAX_DEGREE).rev().find(|degree| is_used(*degree)).unwrap_or(0)
}

/// Turns the colours together with the splats: seen along `rotation * d`, they look as before along `d`.
///
/// The coefficients c' of the turned colours satisfy `Σ c'_k B_k(R d) = Σ c_k B_k(d)` for every direction d. A rotation maps
/// the functions of a degree onto each other, so that least squares over a few directions is exact.
pub fn turn(f_rest: &mut [[f32; 3 * REST]], rotation: DMat3) {
    if f_rest.is_empty() {
        return;
    }
    let Some(turned) = matrix(rotation) else { return };
    for rest in f_rest {
        for channel in rest.as_chunks_mut::<REST>().0 {
            let before = *channel;
            for (k, value) in channel.iter_mut().enumerate() {
                let sum: f64 = before.iter().enumerate().map(|(j, c)| turned[(k, j)] * f64::from(*c)).sum();
                *value = sum as f32;
            }
        }
    }
}

/// The coefficients after a rotation from those before.
fn matrix(rotation: DMat3) -> Option<SMatrix<f64, REST, REST>> {
    // Directions on a spiral (Fibonacci lattice) cover the sphere evenly.
    let golden = std::f64::consts::PI * (3.0 - 5.0f64.sqrt());
    let direction = |i: usize| {
        let z = 1.0 - (2 * i + 1) as f64 / DIRECTIONS as f64;
        let (sin, cos) = (golden * i as f64).sin_cos();
        let radius = (1.0 - z * z).sqrt();
        DVec3::new(radius * cos, radius * sin, z)
    };
    let values = |turned: &dyn Fn(DVec3) -> DVec3| {
        let rows: Vec<[f64; REST]> =
            (0..DIRECTIONS).map(|i| basis_of(turned(direction(i)).to_array())).collect();
        DMatrix::from_fn(DIRECTIONS, REST, |i, k| rows[i][k])
    };
    let (after, before) = (values(&|d| rotation * d), values(&|d| d));
    let solved = (after.transpose() * &after).cholesky()?.solve(&(after.transpose() * before));
    Some(SMatrix::from_fn(|k, j| solved[(k, j)]))
}

#[cfg(test)]
mod tests {
    use super::super::harmonics::seen_along;
    use super::*;
    use glam::DQuat;

    #[test]
    fn turned_colours_look_the_same_from_the_turned_direction() {
        let mut splats = Splats::default();
        splats.push([0.0; 3], 1.0, 0.5, [0.4, 0.5, 0.6]);
        splats.f_rest = vec![std::array::from_fn(|k| ((k * 37 + 11) % 19) as f32 / 40.0 - 0.2)];
        let rotation = DMat3::from_quat(DQuat::from_xyzw(0.3, -0.5, 0.2, 0.8).normalize());
        let mut turned = splats.clone();
        turn(&mut turned.f_rest, rotation);
        for d in [DVec3::X, DVec3::NEG_Y, DVec3::new(0.6, 0.0, 0.8), DVec3::new(-0.48, 0.6, 0.64)] {
            let before = seen_along(splats.clone(), d.to_array()).f_dc[0];
            let after = seen_along(turned.clone(), (rotation * d).to_array()).f_dc[0];
            for (b, a) in before.iter().zip(after) {
                assert!((b - a).abs() < 1e-5, "{before:?} {after:?}");
            }
        }
    }

    #[test]
    fn the_degree_is_that_of_the_last_coefficient_that_is_not_zero() {
        let mut splats = Splats::default();
        splats.push([0.0; 3], 1.0, 0.5, [0.5; 3]);
        assert_eq!(degree(&splats), 0);
        splats.f_rest = vec![[0.0; 45]];
        for (k, expected) in [(0, 1), (17, 1), (18, 2), (30 + 7, 2), (30 + 8, 3)] {
            splats.f_rest[0][k] = 0.1;
            assert_eq!(degree(&splats), expected);
        }
    }
}
