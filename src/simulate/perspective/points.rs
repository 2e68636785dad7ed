//! Points as structure from motion finds them: on textured surfaces, with noise, each with the images that see it.

use super::camera::PinholeCamera;
use super::{Hit, Scenery};
use crate::frame::{CenterPx, CornerPx, Pixel};
use crate::simulate::keyed_rng::KeyedRng;
use glam::DVec3;
use rayon::prelude::*;

/// Number of images that must see a point.
const SEEN_BY: usize = 3;
/// Standard deviation of the place in an image at which a point is found, along each axis, pixels.
const OBSERVATION_SIGMA_PX: f64 = 0.3;
/// Smallest cosine of the angle between a normal and a ray at which a point is found again.
const LEAST_COSINE: f64 = 0.2;
/// Points are at least this far inside of an image, pixels.
const MARGIN_PX: f64 = 2.0;
/// Pixels that are tried for each point that is wanted of an image.
const TRIES: usize = 40;

/// How many points there are, and how exact they are.
#[derive(Clone, Copy, Debug)]
pub(in crate::simulate) struct PointRules {
    /// Number of points.
    pub(in crate::simulate) count: usize,
    /// Root mean square of the distance of a point from its exact place, metres.
    pub(in crate::simulate) error_m: f64,
    /// Distance of two surfaces along a ray from which on one hides the other, metres.
    pub(in crate::simulate) hidden_from_m: f64,
}

/// A point and where it is seen.
#[derive(Clone, Debug)]
pub(super) struct FoundPoint {
    /// Position in the world with its error, metres.
    pub(super) position: DVec3,
    /// Red, green, blue.
    pub(super) rgb: [u8; 3],
    /// Numbers of the cameras that see it, ascending, and where it was found in their images.
    pub(super) seen: Vec<(usize, Pixel<CornerPx>)>,
    /// Mean distance between the found places and the projections of the position, pixels.
    pub(super) error_px: f64,
}

/// Finds points on surfaces by the cameras that look at them.
pub(super) struct PointFinder<'a> {
    pub(super) scenery: &'a dyn Scenery,
    pub(super) cameras: &'a [PinholeCamera],
    pub(super) rules: PointRules,
    pub(super) rng: KeyedRng,
}

impl PointFinder<'_> {
    /// The points that begin in the image `picture` of a camera; all images together give the wanted number, unless too few
    /// images see the same surfaces.
    pub(super) fn of_image(&self, camera: usize, picture: &[u8]) -> Vec<FoundPoint> {
        let before = |n: usize| self.rules.count * n / self.cameras.len();
        let wanted = before(camera + 1) - before(camera);
        let rng = self.rng.key(camera as i64);
        let tried: Vec<_> = (0..wanted * TRIES)
            .step_by(wanted.max(1))
            .flat_map(|first| {
                let some: Vec<_> = (first..first + wanted)
                    .into_par_iter()
                    .map(|k| self.point(camera, picture, rng.key(k as i64)))
                    .collect();
                some
            })
            .flatten()
            .take(wanted)
            .collect();
        tried
    }

    /// The point at a random place of an image; none where it has no texture or is seen by too few images.
    fn point(&self, camera: usize, picture: &[u8], rng: KeyedRng) -> Option<FoundPoint> {
        let from = &self.cameras[camera];
        let size = from.size_px;
        let along = |k: i64| MARGIN_PX - 0.5 + rng.key(k).uniform() * (size as f64 - 2.0 * MARGIN_PX);
        let px = Pixel::<CenterPx>::new(along(1), along(2));
        let direction = from.direction(px);
        let hit = self.scenery.first_hit(from.center, direction).filter(|hit| hit.is_textured)?;
        let exact = from.center + direction * hit.distance;
        let seen: Vec<_> = (0..self.cameras.len())
            .filter_map(|i| {
                let place = self.seen_at(&self.cameras[i], exact, hit.normal)?;
                let shift = |k: i64| OBSERVATION_SIGMA_PX * rng.key(3).key(i as i64).key(k).normal();
                Some((
                    i,
                    Pixel::<CornerPx>::from(Pixel::<CenterPx>::new(
                        place.col + shift(1),
                        place.row + shift(2),
                    )),
                ))
            })
            .collect();
        if seen.len() < SEEN_BY {
            return None;
        }
        let per_axis = self.rules.error_m / 3f64.sqrt();
        let position = exact + DVec3::from_array([4, 5, 6].map(|k| per_axis * rng.key(k).normal()));
        let errors = seen.iter().filter_map(|(i, found)| {
            let (px, _) = self.cameras[*i].project(position)?;
            Some(Pixel::<CornerPx>::from(px).distance(*found))
        });
        let error_px = errors.sum::<f64>() / seen.len() as f64;
        let at = 3 * (px.row.round() as usize * size + px.col.round() as usize);
        let rgb = [0, 1, 2].map(|b| picture[at + b]);
        Some(FoundPoint { position, rgb, seen, error_px })
    }

    /// Where a camera sees a place of a surface; none if it does not.
    fn seen_at(&self, camera: &PinholeCamera, place: DVec3, normal: DVec3) -> Option<Pixel<CenterPx>> {
        let (px, depth) = camera.project(place)?;
        let sight = camera.center - place;
        if !camera.contains(px, MARGIN_PX) || normal.dot(sight) < LEAST_COSINE * sight.length() {
            return None;
        }
        let Hit { distance, .. } = self.scenery.first_hit(camera.center, camera.direction(px))?;
        (distance > depth - self.rules.hidden_from_m).then_some(px)
    }
}
