//! Cars on the streets. They differ between images and are not part of the exact DSM.

use super::field::{Field, Material};
use super::keyed_rng::KeyedRng;
use super::plan::Plan;
use super::texture::car_color;

/// Distance between slots for cars along a lane, metres.
const SLOT_M: f64 = 11.0;
/// Fraction of the slots that hold a car.
const TRAFFIC: f64 = 0.22;
/// Distance of a lane from its street's axis, metres.
const LANE_M: f64 = 1.65;
/// Half length and half width of a car, metres.
const HALF_M: [f64; 2] = [2.15, 0.9];

/// The cars of one view, drawn as colours of the street surface.
pub(super) struct Cars<'a> {
    plan: &'a Plan,
    rng: KeyedRng,
    /// Vector from the end of a car's shadow to the car, metres along the axes of the town.
    shadow: [f64; 2],
}

impl<'a> Cars<'a> {
    /// The cars of one view; `sun` is the unit vector to the sun in map axes.
    pub(super) fn new(plan: &'a Plan, rng: KeyedRng, sun: [f64; 3]) -> Self {
        const HEIGHT_M: f64 = 1.4;
        let length = 0.6 * HEIGHT_M / sun[2].max(0.3);
        Self { plan, rng, shadow: plan.town_from_map(sun[0] * length, sun[1] * length) }
    }

    /// Reflectance at a position and the fraction of sunlight that reaches it, if a car or its shadow covers the position.
    pub(super) fn at(&self, field: &Field, x: f64, y: f64) -> Option<([f32; 3], f64)> {
        if field.nearest(x, y).material != Material::Asphalt {
            return None;
        }
        let at = self.plan.town_from_map(x, y);
        if let Some(color) = self.body(at) {
            return Some((color, 1.0));
        }
        let towards_sun = [at[0] + self.shadow[0], at[1] + self.shadow[1]];
        self.body(towards_sun).map(|_| (field.nearest(x, y).albedo, 0.0))
    }

    fn body(&self, at: [f64; 2]) -> Option<[f32; 3]> {
        let distances = self.plan.street_distances(at);
        let block = self.plan.block_at(at);
        let center = self.plan.block_center(block);
        (0..2).find_map(|across| {
            let along = 1 - across;
            let off_axis = distances[across];
            // Crossings are free of cars.
            if off_axis > LANE_M + HALF_M[1] || distances[along] < 6.0 {
                return None;
            }
            let slot = (at[along] / SLOT_M).floor();
            // The lane is identified by the street and the side of its axis.
            let is_far = at[across] > center[across];
            let rng = self.rng.key(across as i64).key(block[across]).key(i64::from(is_far)).key(slot as i64);
            let middle = (slot + 0.5) * SLOT_M + rng.key(1).uniform_in(-2.8, 2.8);
            let (u, v) = (at[along] - middle, off_axis - LANE_M);
            if rng.uniform() > TRAFFIC || u.abs() > HALF_M[0] || v.abs() > HALF_M[1] {
                return None;
            }
            let is_glass = (0.5..1.1).contains(&u) || (-1.7..-1.3).contains(&u);
            Some(if is_glass { [0.05, 0.06, 0.07] } else { car_color(rng.key(2)) })
        })
    }
}
