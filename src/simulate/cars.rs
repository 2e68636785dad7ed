//! Cars on the streets. They differ between images and are not part of the exact DSM.

use super::field::{Field, Material};
use super::keyed_rng::KeyedRng;
use super::plan::Plan;
use super::texture::{Albedo, car_color};

/// Distance of a lane from its street's axis, metres.
const LANE_M: f64 = 1.65;
/// Half length and half width of a car, metres.
const HALF_M: [f64; 2] = [2.15, 0.9];

/// How many cars are on the streets.
#[derive(Clone, Copy, Debug)]
pub(super) struct Traffic {
    /// Distance between slots for cars along a lane, metres.
    slot_m: f64,
    /// Largest distance of a car from the middle of its slot, metres.
    jitter_m: f64,
    /// Fraction of the slots that hold a car.
    pub(super) fill: f64,
}

impl Traffic {
    /// A car every 50 m.
    pub(super) const LIGHT: Self = Self { slot_m: 11.0, jitter_m: 2.8, fill: 0.22 };
    /// Bumper to bumper.
    pub(super) const JAM: Self = Self { slot_m: 6.2, jitter_m: 0.9, fill: 1.0 };
}

/// What a position on a street shows of a car.
#[derive(Clone, Copy, Debug)]
pub(super) enum Cover {
    /// Its body, of a colour.
    Body(Albedo),
    /// Its shadow.
    Shadow,
}

/// Width of a row of cars where streets are unknown, metres.
const ROW_M: f64 = 3.3;
/// Sine and cosine of the angle between the map's axes and rows of cars where streets are unknown.
const TURN: (f64, f64) = (0.28, 0.96);

/// Where cars drive.
#[derive(Clone, Copy)]
pub(super) enum Roads<'a> {
    /// In the lanes of a town.
    Streets(&'a Plan),
    /// In rows on ground that looks like asphalt.
    Open(&'a Field),
}

impl Roads<'_> {
    /// Coordinates along the axes of the streets or rows.
    fn along_axes(&self, x: f64, y: f64) -> [f64; 2] {
        match self {
            Self::Streets(plan) => plan.town_from_map(x, y),
            Self::Open(_) => [TURN.1 * x + TURN.0 * y, TURN.1 * y - TURN.0 * x],
        }
    }
}

/// The cars of one view, drawn as colours of the street surface.
pub(super) struct Cars<'a> {
    roads: Roads<'a>,
    rng: KeyedRng,
    /// Vector from the end of a car's shadow to the car, metres along the axes of the town.
    shadow: [f64; 2],
    traffic: Traffic,
}

impl<'a> Cars<'a> {
    /// The cars of one view; `sun` is the unit vector to the sun in map axes.
    pub(super) fn new(roads: Roads<'a>, rng: KeyedRng, sun: [f64; 3], traffic: Traffic) -> Self {
        const HEIGHT_M: f64 = 1.4;
        let length = 0.6 * HEIGHT_M / sun[2].max(0.3);
        Self { roads, rng, shadow: roads.along_axes(sun[0] * length, sun[1] * length), traffic }
    }

    /// The same cars with another fraction of the slots filled: of two fractions, the larger one adds cars and moves none.
    pub(super) fn filled(self, fill: f64) -> Self {
        Self { traffic: Traffic { fill, ..self.traffic }, ..self }
    }

    /// What a position on the map shows of a car; none if it shows the surface as it is.
    pub(super) fn cover(&self, field: &Field, x: f64, y: f64) -> Option<Cover> {
        let [body, shadow] = self.slots(field, x, y)?;
        let is_there = |slot: &Slot| slot.draw <= self.traffic.fill;
        let body = body.filter(is_there).map(|slot| Cover::Body(slot.color));
        body.or(shadow.filter(is_there).map(|_| Cover::Shadow))
    }

    /// The smallest fraction of filled slots with which a position is covered by a car or its shadow.
    pub(super) fn covering_fill(&self, field: &Field, x: f64, y: f64) -> Option<f64> {
        let draws = self.slots(field, x, y)?.into_iter().flatten().map(|slot| slot.draw);
        draws.min_by(f64::total_cmp)
    }

    /// The slots whose cars cover a position of a street: with the body, and with the shadow.
    fn slots(&self, field: &Field, x: f64, y: f64) -> Option<[Option<Slot>; 2]> {
        if field.nearest(x, y).material != Material::Asphalt {
            return None;
        }
        let at = self.roads.along_axes(x, y);
        Some([self.slot(at), self.slot([at[0] + self.shadow[0], at[1] + self.shadow[1]])])
    }

    /// The slot whose car has its body at a position in town coordinates.
    fn slot(&self, at: [f64; 2]) -> Option<Slot> {
        let plan = match self.roads {
            Roads::Streets(plan) => plan,
            Roads::Open(field) => return self.open_slot(field, at),
        };
        let distances = plan.street_distances(at);
        let block = plan.block_at(at);
        let center = plan.block_center(block);
        let Traffic { slot_m, jitter_m, .. } = self.traffic;
        (0..2).find_map(|across| {
            let along = 1 - across;
            let off_axis = distances[across];
            // Crossings are free of cars.
            if off_axis > LANE_M + HALF_M[1] || distances[along] < 6.0 {
                return None;
            }
            let slot = (at[along] / slot_m).floor();
            // The lane is identified by the street and the side of its axis.
            let is_far = at[across] > center[across];
            let rng = self.rng.key(across as i64).key(block[across]).key(i64::from(is_far)).key(slot as i64);
            let middle = (slot + 0.5) * slot_m + rng.key(1).uniform_in(-jitter_m, jitter_m);
            let (u, v) = (at[along] - middle, off_axis - LANE_M);
            if u.abs() > HALF_M[0] || v.abs() > HALF_M[1] {
                return None;
            }
            Some(Slot::new(rng, u))
        })
    }

    /// As [`Cars::slot`], where a car needs asphalt under its middle and its ends.
    fn open_slot(&self, field: &Field, at: [f64; 2]) -> Option<Slot> {
        let Traffic { slot_m, jitter_m, .. } = self.traffic;
        let (slot, row) = ((at[0] / slot_m).floor(), (at[1] / ROW_M).floor());
        let rng = self.rng.key(row as i64).key(slot as i64);
        let middle =
            [(slot + 0.5) * slot_m + rng.key(1).uniform_in(-jitter_m, jitter_m), (row + 0.5) * ROW_M];
        let (u, v) = (at[0] - middle[0], at[1] - middle[1]);
        let is_asphalt = |along: f64| {
            let [a, b] = [middle[0] + along, middle[1]];
            field.nearest(TURN.1 * a - TURN.0 * b, TURN.0 * a + TURN.1 * b).material == Material::Asphalt
        };
        let is_car = u.abs() <= HALF_M[0] && v.abs() <= HALF_M[1];
        (is_car && [-HALF_M[0], 0.0, HALF_M[0]].into_iter().all(is_asphalt)).then(|| Slot::new(rng, u))
    }
}

/// A place for a car.
struct Slot {
    /// The car is there if this fraction of the slots or more is filled.
    draw: f64,
    /// Colour of the car at the position asked for.
    color: Albedo,
}

impl Slot {
    /// The place of a car at `along_m` from its middle, towards its front.
    fn new(rng: KeyedRng, along_m: f64) -> Self {
        let is_glass = (0.5..1.1).contains(&along_m) || (-1.7..-1.3).contains(&along_m);
        let color = if is_glass { [0.05, 0.06, 0.07] } else { car_color(rng.key(2)) };
        Self { draw: rng.uniform(), color }
    }
}
