//! The town as a height field: heights and colours of terrain, buildings and trees of the plan at the nodes.

use super::field::{Field, Material, Node};
use super::keyed_rng::KeyedRng;
use super::plan::{Building, Plan, Relief, Roof, Tree};
use super::texture;
use super::vegetation;
use rayon::prelude::*;

/// A town over ±`half_m` with a node every `step_m`; its landmarks lie within ±`core_half_m`.
pub(super) struct Town {
    pub(super) plan: Plan,
    pub(super) field: Field,
}

impl Town {
    /// Builds the town of a seed.
    pub(super) fn new(seed: u64, half_m: f64, step_m: f64, core_half_m: f64, relief: Relief) -> Self {
        let plan = Plan::new(seed, half_m, core_half_m, relief, vegetation::trees);
        let colors = KeyedRng::new(seed).key(7);
        let mut builder = FieldBuilder::bare_ground(&plan, colors, half_m, step_m);
        for building in &plan.buildings {
            builder.add_building(&plan, colors, building);
        }
        for (i, tree) in plan.trees.iter().enumerate() {
            builder.add_tree(&plan, colors, i as i64, tree);
        }
        let field = Field::new(half_m, step_m, builder.nodes);
        Self { plan, field }
    }
}

/// Nodes of the height field under construction.
struct FieldBuilder {
    half_m: f64,
    step_m: f64,
    side: usize,
    nodes: Vec<Node>,
}

impl FieldBuilder {
    fn bare_ground(plan: &Plan, colors: KeyedRng, half_m: f64, step_m: f64) -> Self {
        let side = Field::nodes_per_side(half_m, step_m);
        let nodes = (0..side * side)
            .into_par_iter()
            .map(|k| {
                let (x, y) = ((k % side) as f64 * step_m - half_m, (k / side) as f64 * step_m - half_m);
                let (material, albedo) = texture::ground(plan, colors, x, y);
                Node { height_m: plan.ground_m(x, y), material, owner: 0, albedo }
            })
            .collect();
        Self { half_m, step_m, side, nodes }
    }

    /// Calls `change` for every node within `radius_m` of a map position.
    fn around(&mut self, (x, y): (f64, f64), radius_m: f64, mut change: impl FnMut(f64, f64, &mut Node)) {
        let bounds = |v: f64| {
            let index = |w: f64| ((w + self.half_m) / self.step_m).clamp(0.0, self.side as f64);
            (index(v - radius_m).floor() as usize, (index(v + radius_m).ceil() as usize).min(self.side))
        };
        let ((i0, i1), (j0, j1)) = (bounds(x), bounds(y));
        for j in j0..j1 {
            for i in i0..i1 {
                let place = [i, j].map(|k| k as f64 * self.step_m - self.half_m);
                change(place[0], place[1], &mut self.nodes[j * self.side + i]);
            }
        }
    }

    fn add_building(&mut self, plan: &Plan, colors: KeyedRng, building: &Building) {
        let [ha, hb] = building.half;
        let corners = [(-ha, -hb), (ha, -hb), (-ha, hb), (ha, hb)].map(|(u, v)| {
            let (x, y) = plan.map_from_town([building.center[0] + u, building.center[1] + v]);
            plan.ground_m(x, y)
        });
        let mean = corners.iter().sum::<f64>() / 4.0;
        let top = corners.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        // The base of a building is the mean ground height at its corners, but at most 2 m below the highest corner.
        let eaves_m = mean.max(top - 2.0) + building.eaves_m;
        let place = plan.map_from_town(building.center);
        self.around(place, ha.hypot(hb) + self.step_m, |x, y, node| {
            let at = plan.town_from_map(x, y);
            let uv = [at[0] - building.center[0], at[1] - building.center[1]];
            if uv[0].abs() > ha || uv[1].abs() > hb {
                return;
            }
            let (roof_m, on_top_m) = roof_shape(building, colors, uv);
            let height_m = eaves_m + roof_m + on_top_m;
            if height_m > node.height_m {
                let albedo = texture::roof(building, colors, uv, on_top_m);
                *node = Node { height_m, material: Material::Roof, owner: building.owner, albedo };
            }
        });
    }

    fn add_tree(&mut self, plan: &Plan, colors: KeyedRng, index: i64, tree: &Tree) {
        let place = plan.map_from_town(tree.at);
        let foot_m = plan.ground_m(place.0, place.1);
        self.around(place, tree.radius_m + self.step_m, |x, y, node| {
            let bumps = colors.key(8).fractal_noise(x, y, 1.3, 2);
            let r = (x - place.0).hypot(y - place.1) / (tree.radius_m * (1.0 + 0.12 * bumps));
            if r >= 1.0 {
                return;
            }
            let crown = 0.5 + 0.5 * (1.0 - r * r).sqrt();
            let height_m = foot_m + tree.height_m * crown + 0.35 * bumps;
            if height_m > node.height_m {
                let albedo = texture::crown(colors, index, x, y);
                *node = Node { height_m, material: Material::Tree, owner: 0, albedo };
            }
        });
    }
}

/// Height of the roof above the eaves, and height above the roof of objects on it, metres.
fn roof_shape(building: &Building, colors: KeyedRng, [u, v]: [f64; 2]) -> (f64, f64) {
    let [ha, hb] = building.half;
    let rim = (ha - u.abs()).min(hb - v.abs());
    match building.roof {
        Roof::Flat => {
            let parapet = if rim < 0.5 { 0.6 } else { 0.0 };
            let cell = [(u / 4.5).floor(), (v / 4.5).floor()];
            let rng = colors.key(9).key(i64::from(building.owner)).key(cell[0] as i64).key(cell[1] as i64);
            let size = [rng.key(1).uniform_in(0.7, 1.5), rng.key(2).uniform_in(0.7, 1.5)];
            let middle = [0, 1].map(|k| (cell[k] + 0.5) * 4.5);
            let on_machine = (u - middle[0]).abs() < size[0] && (v - middle[1]).abs() < size[1];
            let machine = if rng.uniform() < 0.3 && on_machine && rim > 1.2 {
                rng.key(3).uniform_in(1.0, 2.2)
            } else {
                0.0
            };
            (parapet, machine)
        }
        Roof::Gable(rise) => (rise * (1.0 - v.abs() / hb), chimney(building, colors, u, v)),
        Roof::Hip(slope) => (slope * rim, chimney(building, colors, u, v)),
    }
}

fn chimney(building: &Building, colors: KeyedRng, u: f64, v: f64) -> f64 {
    let rng = colors.key(10).key(i64::from(building.owner));
    let at = [0, 1].map(|k| rng.key(k as i64).uniform_in(-0.6, 0.6) * building.half[k as usize]);
    let is_there = (u - at[0]).abs() < 0.5 && (v - at[1]).abs() < 0.5;
    if is_there { 1.1 } else { 0.0 }
}
