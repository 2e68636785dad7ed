//! Where the cameras above the town are, and which of them are trained on.

use crate::simulate::keyed_rng::KeyedRng;
use crate::simulate::perspective::PinholeCamera;
use glam::DVec3;

/// Fraction of a turn between consecutive views that spreads any number of them evenly.
const GOLDEN: f64 = 0.618_033_988_749_895;
/// Height of the cameras above the ground at the centre of the town, metres.
const ALTITUDE_M: f64 = 600.0;
/// Side of the ground that an image straight down shows, metres.
pub(super) const FOOTPRINT_M: f64 = 260.0;
/// Largest tilt of a camera, degrees.
pub(super) const MOST_TILT_DEG: f64 = 30.0;
/// Largest distance of the places that the cameras look at from the centre along both axes, metres.
const ASIDE_M: f64 = 12.0;
/// Largest angle between the direction upwards in an image and north, degrees.
const MOST_HEADING_DEG: f64 = 10.0;
/// Number of images to train on.
const TRAINING: usize = 3;

/// Cameras that look at the middle of the town, whose centre on the ground is `ground`: the first one straight down, the
/// others on a spiral with tilts up to [`MOST_TILT_DEG`].
pub(super) fn above(ground: DVec3, views: usize, size_px: usize, rng: KeyedRng) -> Vec<PinholeCamera> {
    let focal_px = size_px as f64 * ALTITUDE_M / FOOTPRINT_M;
    (0..views)
        .map(|i| {
            let own = rng.key(i as i64);
            let share = (i as f64 / (views - 1).max(1) as f64).sqrt();
            let tilt = (share * MOST_TILT_DEG).to_radians();
            let turn = (rng.uniform() + i as f64 * GOLDEN).fract() * std::f64::consts::TAU;
            let shift = |k: i64| own.key(k).uniform_in(-ASIDE_M, ASIDE_M);
            let target = ground + DVec3::new(shift(1), shift(2), 0.0);
            let away = ALTITUDE_M * tilt.tan();
            let center = target + DVec3::new(away * turn.cos(), away * turn.sin(), ALTITUDE_M);
            let heading = (MOST_HEADING_DEG * own.key(3).uniform_in(-1.0, 1.0)).to_radians();
            let up = DVec3::new(heading.sin(), heading.cos(), 0.0);
            PinholeCamera::looking_at(center, target, up, size_px, focal_px)
        })
        .collect()
}

/// Numbers of the cameras to train on, ascending: the one farthest from the mean of all centres, then the one farthest from
/// those that were chosen, and so on (farthest-point sampling).
pub(super) fn spread(cameras: &[PinholeCamera]) -> Vec<usize> {
    let mean = cameras.iter().map(|c| c.center).sum::<DVec3>() / cameras.len() as f64;
    let mut apart_m: Vec<f64> = cameras.iter().map(|c| c.center.distance(mean)).collect();
    let mut chosen = Vec::new();
    while chosen.len() < TRAINING.min(cameras.len()) {
        let Some(next) = (0..cameras.len()).max_by(|a, b| apart_m[*a].total_cmp(&apart_m[*b])) else { break };
        let is_first = chosen.is_empty();
        chosen.push(next);
        for (apart_m, camera) in apart_m.iter_mut().zip(cameras) {
            let to_next = camera.center.distance(cameras[next].center);
            *apart_m = if is_first { to_next } else { apart_m.min(to_next) };
        }
    }
    chosen.sort_unstable();
    chosen
}
