//! Trees: in gardens, parks and yards, and in rows along the pavements.

use super::plan::{BLOCK_EDGE_M, Building, LandUse, PERIOD_M, Plan, Tree};

/// Trees of a block, clear of its walls, of the carriageway and of the pond.
pub(super) fn trees(plan: &Plan, block: [i64; 2]) -> Vec<Tree> {
    let mut trees = inside(plan, block);
    trees.extend(along_streets(plan, block));
    trees
}

fn inside(plan: &Plan, block: [i64; 2]) -> Vec<Tree> {
    const SPACING_M: f64 = 5.5;
    let center = plan.block_center(block);
    let density = match plan.land_use(block) {
        LandUse::Houses => 0.7,
        LandUse::Park | LandUse::Pond => 0.5,
        LandUse::Flats | LandUse::Tower => 0.45,
        LandUse::Hall => 0.3,
    };
    let count = PERIOD_M.map(|p| ((p - 2.0 * BLOCK_EDGE_M + 2.0) / SPACING_M).floor() as i64);
    let mut trees = Vec::new();
    for i in 0..count[0] {
        for j in 0..count[1] {
            let rng = plan.block_rng(block).key(50 + i).key(j);
            let cell = [i, j];
            let at = std::array::from_fn(|k| {
                center[k]
                    + SPACING_M * (cell[k] as f64 - 0.5 * (count[k] - 1) as f64)
                    + rng.key(k as i64).uniform_in(-1.6, 1.6)
            });
            let radius_m = rng.key(3).uniform_in(1.5, 3.6);
            if rng.key(2).uniform() < density && is_clear(plan, at, 0.7 * radius_m) {
                let height_m = radius_m * rng.key(4).uniform_in(2.0, 3.0) + 1.5;
                trees.push(Tree { at, radius_m, height_m });
            }
        }
    }
    trees
}

fn along_streets(plan: &Plan, block: [i64; 2]) -> Vec<Tree> {
    const SPACING_M: f64 = 7.5;
    /// Fraction of the sides of blocks that have a row of trees.
    const ROWS: f64 = 0.6;
    let center = plan.block_center(block);
    let half = PERIOD_M.map(|p| 0.5 * p - BLOCK_EDGE_M + 0.3);
    let mut trees = Vec::new();
    for (across, side) in [(0, -1), (0, 1), (1, -1), (1, 1)] {
        let along = 1 - across;
        let row = plan.block_rng(block).key(70 + across as i64).key(side);
        if row.uniform() > ROWS {
            continue;
        }
        for slot in 0..(2.0 * half[along] / SPACING_M) as i64 {
            let rng = row.key(slot);
            let mut at = [0.0; 2];
            at[across] = center[across] + side as f64 * half[across];
            at[along] = center[along] - half[along] + (slot as f64 + 0.6) * SPACING_M;
            let radius_m = rng.key(1).uniform_in(1.6, 2.6);
            if rng.uniform() < 0.75 && is_clear(plan, at, 0.7 * radius_m) {
                trees.push(Tree { at, radius_m, height_m: rng.key(2).uniform_in(5.5, 8.0) });
            }
        }
    }
    trees
}

/// Whether a tree of radius `room_m` is clear of the buildings of its block, which are the last in the plan, and of the
/// pond.
fn is_clear(plan: &Plan, at: [f64; 2], room_m: f64) -> bool {
    const BUILDINGS_IN_A_BLOCK: usize = 12;
    let beside = |b: &Building| (0..2).any(|k| (at[k] - b.center[k]).abs() > b.half[k] + room_m);
    plan.buildings.iter().rev().take(BUILDINGS_IN_A_BLOCK).all(beside) && plan.pond_distance(at) > 1.3
}
