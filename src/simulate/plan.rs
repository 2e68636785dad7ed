//! The plan of the town: terrain, streets and blocks, buildings, a pond.
//!
//! Streets run along the axes (a, b) of the town, which are rotated against the map grid so that no wall is parallel to
//! rows of pixels. The plan depends on the seed and on the indices of blocks only.

use super::keyed_rng::KeyedRng;
use serde::{Deserialize, Serialize};

/// Height differences of the terrain.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Relief {
    /// About 15 m between the lowest and the highest ground.
    Rolling,
    /// 60 m and more.
    Hilly,
}

/// Places the trees of a block after its buildings.
pub(super) type Trees = fn(&Plan, [i64; 2]) -> Vec<Tree>;

/// Distance between streets along a and b, metres.
pub(super) const PERIOD_M: [f64; 2] = [60.0, 45.0];
/// Half the width of a carriageway, metres.
pub(super) const STREET_HALF_M: f64 = 3.5;
/// Distance from the axis of a street to the edge of the block, metres: half the carriageway and a pavement.
pub(super) const BLOCK_EDGE_M: f64 = 5.2;
/// Ellipsoidal height of the ground at the centre of the scene, metres.
const GROUND_M: f64 = 150.0;
/// Height of the tower, metres.
const TOWER_M: f64 = 33.0;

/// What a block is used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LandUse {
    Houses,
    Flats,
    Hall,
    Park,
    Tower,
    Pond,
}

/// Shape of a roof.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Roof {
    /// Flat, with a parapet and machines.
    Flat,
    /// Two slopes with the ridge along a; the number is the height of the ridge above the eaves, metres.
    Gable(f64),
    /// Four slopes; the number is their gradient, metres per metre.
    Hip(f64),
}

/// A part of a building: a box with a roof.
#[derive(Clone, Debug)]
pub(super) struct Building {
    /// Centre in town coordinates, metres.
    pub(super) center: [f64; 2],
    /// Half sides, metres.
    pub(super) half: [f64; 2],
    /// Height of the eaves above the ground at the centre, metres.
    pub(super) eaves_m: f64,
    pub(super) roof: Roof,
    /// Number of the building, which its parts share; never 0.
    pub(super) owner: u16,
}

/// A tree with a round crown.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tree {
    /// Position in town coordinates, metres.
    pub(super) at: [f64; 2],
    pub(super) radius_m: f64,
    pub(super) height_m: f64,
}

/// The plan of a town.
pub(super) struct Plan {
    rng: KeyedRng,
    relief: Relief,
    turn: (f64, f64),
    shift: [f64; 2],
    tower: [i64; 2],
    pond: [i64; 2],
    pond_level_m: f64,
    pub(super) buildings: Vec<Building>,
    pub(super) trees: Vec<Tree>,
}

impl Plan {
    /// Plans a town over ±`half_m`; pond and tower lie within ±`core_half_m`.
    pub(super) fn new(seed: u64, half_m: f64, core_half_m: f64, relief: Relief, trees: Trees) -> Self {
        let rng = KeyedRng::new(seed);
        let turn = rng.key(1).uniform_in(0.2, 0.5).sin_cos();
        let shift = [rng.key(2).uniform_in(0.0, 8.0), rng.key(3).uniform_in(0.0, 8.0)];
        let mut plan = Self {
            rng,
            relief,
            turn,
            shift,
            tower: [0, 0],
            pond: [0, 0],
            pond_level_m: 0.0,
            buildings: Vec::new(),
            trees: Vec::new(),
        };
        plan.tower = plan.block_at(plan.town_from_map(0.3 * core_half_m, 0.1 * core_half_m));
        plan.pond = plan.block_at(plan.town_from_map(-0.5 * core_half_m, -0.4 * core_half_m));
        let (x, y) = plan.map_from_town(plan.block_center(plan.pond));
        plan.pond_level_m = plan.hills_m(x, y) - 0.8;
        plan.build(half_m, trees);
        plan
    }

    /// Town coordinates of a map position.
    pub(super) fn town_from_map(&self, x: f64, y: f64) -> [f64; 2] {
        let (s, c) = self.turn;
        [c * x + s * y, c * y - s * x]
    }

    /// Map position of town coordinates.
    pub(super) fn map_from_town(&self, [a, b]: [f64; 2]) -> (f64, f64) {
        let (s, c) = self.turn;
        (c * a - s * b, s * a + c * b)
    }

    /// Indices of the block that contains a position in town coordinates.
    pub(super) fn block_at(&self, at: [f64; 2]) -> [i64; 2] {
        std::array::from_fn(|k| ((at[k] - self.shift[k]) / PERIOD_M[k]).floor() as i64)
    }

    /// Centre of a block in town coordinates.
    pub(super) fn block_center(&self, block: [i64; 2]) -> [f64; 2] {
        std::array::from_fn(|k| (block[k] as f64 + 0.5) * PERIOD_M[k] + self.shift[k])
    }

    /// What a block is used for.
    pub(super) fn land_use(&self, block: [i64; 2]) -> LandUse {
        if block == self.tower {
            return LandUse::Tower;
        }
        if block == self.pond {
            return LandUse::Pond;
        }
        match self.block_rng(block).key(0).uniform() {
            u if u < 0.50 => LandUse::Houses,
            u if u < 0.80 => LandUse::Flats,
            u if u < 0.93 => LandUse::Hall,
            _ => LandUse::Park,
        }
    }

    /// The random numbers of a block.
    pub(super) fn block_rng(&self, block: [i64; 2]) -> KeyedRng {
        self.rng.key(100).key(block[0]).key(block[1])
    }

    /// Distances to the axes of the nearest streets along b and along a, metres.
    pub(super) fn street_distances(&self, at: [f64; 2]) -> [f64; 2] {
        std::array::from_fn(|k| {
            let in_period = (at[k] - self.shift[k]).rem_euclid(PERIOD_M[k]);
            in_period.min(PERIOD_M[k] - in_period)
        })
    }

    /// Distance from the centre of the pond relative to its shore: below 1 is water.
    pub(super) fn pond_distance(&self, at: [f64; 2]) -> f64 {
        let c = self.block_center(self.pond);
        let (da, db) = ((at[0] - c[0]) / 18.0, (at[1] - c[1]) / 12.0);
        let angle = db.atan2(da);
        da.hypot(db) / (1.0 + 0.12 * (3.0 * angle + 1.0).sin() + 0.06 * (5.0 * angle).cos())
    }

    /// Ellipsoidal height of the ground at a map position, metres.
    pub(super) fn ground_m(&self, x: f64, y: f64) -> f64 {
        let hills = self.hills_m(x, y);
        let q = self.pond_distance(self.town_from_map(x, y));
        let t = ((q - 1.0) / 0.9).clamp(0.0, 1.0);
        self.pond_level_m + (hills - self.pond_level_m) * t * t * (3.0 - 2.0 * t)
    }

    fn hills_m(&self, x: f64, y: f64) -> f64 {
        let phase = self.rng.key(4).uniform_in(0.0, std::f64::consts::TAU);
        let along = x * phase.cos() + y * phase.sin();
        let across = y * phase.cos() - x * phase.sin();
        match self.relief {
            Relief::Rolling => {
                GROUND_M
                    + 5.0 * (along / 62.0).sin()
                    + 3.0 * (across / 45.0 + 1.0).sin()
                    + 1.2 * self.rng.key(5).fractal_noise(x, y, 70.0, 2)
            }
            Relief::Hilly => {
                GROUND_M
                    + 20.0
                    + 36.0 * (along / 85.0).sin()
                    + 6.0 * (across / 40.0 + 1.0).sin()
                    + 2.5 * self.rng.key(5).fractal_noise(x, y, 60.0, 2)
            }
        }
    }

    fn build(&mut self, half_m: f64, trees: Trees) {
        let reach = half_m * 1.42;
        let [from, to] = [self.block_at([-reach; 2]), self.block_at([reach; 2])];
        for i in from[0]..=to[0] {
            for j in from[1]..=to[1] {
                let block = [i, j];
                let rng = self.block_rng(block);
                match self.land_use(block) {
                    LandUse::Houses => self.lots(block, [3, 2], |plan, at, rng| plan.house(at, rng)),
                    LandUse::Flats => self.lots(block, [2, 1], |plan, at, rng| plan.flats(at, rng)),
                    LandUse::Hall => {
                        let half = [rng.key(1).uniform_in(16.0, 19.0), rng.key(2).uniform_in(10.5, 13.0)];
                        let center = self.block_center(block);
                        let owner = self.next_owner();
                        let eaves_m = rng.key(3).uniform_in(9.0, 12.0);
                        let roof = if rng.key(4).uniform() < 0.5 { Roof::Gable(2.0) } else { Roof::Flat };
                        self.buildings.push(Building { center, half, eaves_m, roof, owner });
                    }
                    LandUse::Tower => {
                        let [a, b] = self.block_center(block);
                        let owner = self.next_owner();
                        let tall = Building {
                            center: [a + 6.0, b],
                            half: [10.0, 9.0],
                            eaves_m: TOWER_M,
                            roof: Roof::Flat,
                            owner,
                        };
                        let low = Building {
                            center: [a - 11.0, b - 2.0],
                            half: [7.0, 11.0],
                            eaves_m: 9.0,
                            ..tall.clone()
                        };
                        self.buildings.extend([tall, low]);
                    }
                    LandUse::Park | LandUse::Pond => {}
                }
                let trees = trees(self, block);
                self.trees.extend(trees);
            }
        }
    }

    fn next_owner(&self) -> u16 {
        self.buildings.last().map_or(0, |b| b.owner).wrapping_add(1).max(1)
    }

    /// Calls `build` with the centre of every lot of a block.
    fn lots(&mut self, block: [i64; 2], count: [i64; 2], build: fn(&mut Self, [f64; 2], KeyedRng)) {
        let center = self.block_center(block);
        for i in 0..count[0] {
            for j in 0..count[1] {
                let lot = [i, j];
                let at = std::array::from_fn(|k| {
                    let size = (PERIOD_M[k] - 2.0 * BLOCK_EDGE_M) / count[k] as f64;
                    center[k] + (lot[k] as f64 - 0.5 * (count[k] - 1) as f64) * size
                });
                build(self, at, self.block_rng(block).key(10 + i).key(j));
            }
        }
    }

    fn house(&mut self, at: [f64; 2], rng: KeyedRng) {
        let half = [rng.key(1).uniform_in(5.0, 6.6), rng.key(2).uniform_in(4.6, 6.2)];
        let center = [at[0] + rng.key(3).uniform_in(-1.2, 1.2), at[1] + rng.key(4).uniform_in(-1.6, 1.6)];
        let eaves_m = rng.key(5).uniform_in(5.5, 9.5);
        let roof = match rng.key(6).uniform() {
            u if u < 0.55 => Roof::Gable(0.55 * half[1]),
            u if u < 0.85 => Roof::Hip(0.5),
            _ => Roof::Flat,
        };
        let owner = self.next_owner();
        self.buildings.push(Building { center, half, eaves_m, roof, owner });
        if rng.key(7).uniform() < 0.4 {
            // A lower wing gives the house an L-shaped footprint.
            let side = if rng.key(8).uniform() < 0.5 { -1.0 } else { 1.0 };
            let center = [center[0] + 0.4 * half[0], center[1] + side * (half[1] + 1.2)];
            let half = [0.55 * half[0], 1.8];
            self.buildings.push(Building { center, half, eaves_m: 0.6 * eaves_m, roof: Roof::Flat, owner });
        }
    }

    fn flats(&mut self, at: [f64; 2], rng: KeyedRng) {
        let half = [rng.key(1).uniform_in(7.5, 9.0), rng.key(2).uniform_in(11.0, 13.5)];
        let roof = if rng.key(3).uniform() < 0.7 { Roof::Flat } else { Roof::Hip(0.4) };
        let owner = self.next_owner();
        let eaves_m = 3.0 * rng.key(4).uniform_in(4.0, 7.5).floor() + 1.0;
        self.buildings.push(Building { center: at, half, eaves_m, roof, owner });
    }
}
