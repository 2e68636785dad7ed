//! Where the cameras of the room stand and look.

use super::shape::{Block, ROOM};
use crate::simulate::keyed_rng::KeyedRng;
use crate::simulate::perspective::PinholeCamera;
use glam::DVec3;

/// Fraction of a turn between consecutive views that spreads any number of them evenly.
const GOLDEN: f64 = 0.618_033_988_749_895;
/// Half the angle of view, degrees.
const HALF_FIELD_DEG: f64 = 35.0;
/// Distance of the ring of cameras from the walls, metres.
const FROM_WALL_M: f64 = 0.6;
/// Heights of the cameras above the floor, metres: below the top of the table, and above the sphere on it.
const HEIGHTS_M: [f64; 2] = [0.55, 1.5];
/// Elevations of the views in turn at each height, degrees.
const ELEVATIONS_DEG: [[f64; 3]; 2] = [[6.0, -16.0, 32.0], [-32.0, -6.0, 24.0]];
/// Largest angle between a view and the direction to the middle of the room, seen from above, degrees.
const ASIDE_DEG: f64 = 42.0;
/// Smallest radius of the places at each height, as a share of the ring.
const INNERMOST: [f64; 2] = [0.9, 0.75];

/// Cameras on a ring around the table at two heights, which look across the room.
pub(super) fn around(views: usize, size_px: usize, rng: KeyedRng) -> Vec<PinholeCamera> {
    let focal_px = focal_px(size_px);
    let Block { low, high } = ROOM;
    let ring = 0.5 * (high - low) - DVec3::splat(FROM_WALL_M);
    (0..views)
        .map(|i| {
            let own = rng.key(i as i64);
            let level = i % 2;
            let turn = (rng.uniform() + i as f64 * GOLDEN).fract() * std::f64::consts::TAU;
            let share = own.key(1).uniform_in(INNERMOST[level], 1.0);
            let height = HEIGHTS_M[level] + own.key(2).uniform_in(-0.05, 0.05);
            let center = DVec3::new(share * ring.x * turn.cos(), share * ring.y * turn.sin(), height);
            let aside = (ASIDE_DEG * own.key(3).uniform_in(-1.0, 1.0)).to_radians();
            let inward = (-center.y).atan2(-center.x) + aside;
            let up_deg = ELEVATIONS_DEG[level][(i / 2) % 3] + own.key(4).uniform_in(-4.0, 4.0);
            let (rise, level_part) = up_deg.to_radians().sin_cos();
            let along = DVec3::new(inward.cos() * level_part, inward.sin() * level_part, rise);
            PinholeCamera::looking_at(center, center + along, DVec3::Z, size_px, focal_px)
        })
        .collect()
}

/// Turn between the frames of a walk around the table, degrees, and how far they swing aside and up.
const STEP_DEG: f64 = 5.0;
const SWING_DEG: [f64; 2] = [20.0, 14.0];

/// Cameras on a walk around the table, each near the one before it, which look across the room.
pub(super) fn walk(views: usize, size_px: usize) -> Vec<PinholeCamera> {
    let Block { low, high } = ROOM;
    let ring = 0.5 * (high - low) - DVec3::splat(FROM_WALL_M);
    let of = |i: usize| {
        let turn = (STEP_DEG * i as f64).to_radians();
        let [aside, up] = [1.7, 2.3].map(|rate: f64| (rate * turn).sin());
        let height = HEIGHTS_M[1] + 0.1 * aside;
        let center = DVec3::new(ring.x * turn.cos(), ring.y * turn.sin(), height);
        let inward = (-center.y).atan2(-center.x) + (SWING_DEG[0] * aside).to_radians();
        let (rise, level_part) = (SWING_DEG[1] * (up - 1.0)).to_radians().sin_cos();
        let along = DVec3::new(inward.cos() * level_part, inward.sin() * level_part, rise);
        PinholeCamera::looking_at(center, center + along, DVec3::Z, size_px, focal_px(size_px))
    };
    (0..views).map(of).collect()
}

/// Focal length of the cameras, pixels.
fn focal_px(size_px: usize) -> f64 {
    0.5 * size_px as f64 / HALF_FIELD_DEG.to_radians().tan()
}

/// Smallest distance of a place from the walls and the table, metres.
#[cfg(test)]
pub(super) fn room_around_m(place: DVec3) -> f64 {
    let walls = (place - ROOM.low).min(ROOM.high - place).min_element();
    let top = super::shape::TABLE_TOP;
    let table = Block { low: top.low.with_z(0.0), ..top };
    walls.min((place - place.clamp(table.low, table.high)).length())
}
