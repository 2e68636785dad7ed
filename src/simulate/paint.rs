//! Colours: reflectances of ground, roofs, crowns and walls, with detail at every scale so that features match.

use super::dice::Dice;
use super::field::Material;
use super::plan::{BLOCK_EDGE_M, Block, Building, Plan, Roof, STREET_HALF_M};

/// Reflectance in red, green and blue.
pub(super) type Albedo = [f32; 3];

/// Colours of tiled roofs.
const TILES: [Albedo; 6] = [
    [0.58, 0.32, 0.22],
    [0.66, 0.40, 0.28],
    [0.50, 0.27, 0.20],
    [0.61, 0.45, 0.34],
    [0.36, 0.34, 0.34],
    [0.45, 0.30, 0.25],
];
/// Colours of flat roofs.
const MEMBRANES: [Albedo; 5] =
    [[0.55, 0.54, 0.51], [0.40, 0.40, 0.41], [0.63, 0.62, 0.60], [0.48, 0.44, 0.39], [0.34, 0.36, 0.39]];
/// Colours of walls.
const PLASTERS: [Albedo; 5] =
    [[0.66, 0.58, 0.46], [0.70, 0.66, 0.58], [0.58, 0.48, 0.38], [0.62, 0.62, 0.62], [0.72, 0.60, 0.50]];

fn scaled(c: Albedo, by: f64) -> Albedo {
    c.map(|v| (f64::from(v) * by).clamp(0.015, 0.95) as f32)
}

fn mixed(a: Albedo, b: Albedo, t: f64) -> Albedo {
    std::array::from_fn(|k| a[k] + (b[k] - a[k]) * t.clamp(0.0, 1.0) as f32)
}

/// Material and colour of open ground.
pub(super) fn ground(plan: &Plan, dice: Dice, x: f64, y: f64) -> (Material, Albedo) {
    let at = plan.town_from_map(x, y);
    let grain = dice.on(1).octaves(x, y, 0.9, 2);
    let broad = dice.on(2).octaves(x, y, 24.0, 5);
    if plan.pond_distance(at) < 1.0 {
        let transfer_function = 1.0 + 0.25 * dice.on(3).octaves(x, y, 30.0, 3);
        return (Material::Water, scaled([0.055, 0.095, 0.105], transfer_function));
    }
    let [da, db] = plan.street_distances(at);
    let nearest = da.min(db);
    if nearest < STREET_HALF_M {
        return (Material::Asphalt, street(dice, at, [da, db], 1.0 + 0.22 * broad + 0.12 * grain));
    }
    if nearest < BLOCK_EDGE_M {
        let slab = dice.on(4).on((at[0] / 1.5).floor() as i64).on((at[1] / 1.5).floor() as i64);
        let curb = if nearest < STREET_HALF_M + 0.35 { 1.25 } else { 1.0 };
        return (
            Material::Paving,
            scaled([0.43, 0.41, 0.38], curb * (0.85 + 0.25 * slab.unit() + 0.15 * broad)),
        );
    }
    let block = plan.block_at(at);
    let own = plan.block_dice(block);
    match plan.block(block) {
        Block::Flats | Block::Tower | Block::Hall if own.on(30).unit() < 0.6 || nearest > 14.0 => {
            (Material::Paving, parking(dice.on(5), at, 1.0 + 0.2 * broad + 0.12 * grain))
        }
        kind => {
            let c = plan.block_center(block);
            let lot = [((at[0] - c[0] + 100.0) / 16.5).floor(), ((at[1] - c[1] + 100.0) / 17.3).floor()];
            let transfer_function = own.on(31).on(lot[0] as i64).on(lot[1] as i64);
            let park = matches!(kind, Block::Park | Block::Pond);
            if park && is_path((at[0] - c[0]) * 0.7 + (at[1] - c[1])) {
                return (Material::Paving, scaled([0.60, 0.53, 0.42], 1.0 + 0.15 * broad + 0.1 * grain));
            }
            let dry = if park { 0.25 } else { 0.75 * transfer_function.unit() } + 0.75 * broad;
            let lush = scaled([0.17, 0.25, 0.11], 0.8 + 0.5 * transfer_function.on(1).unit());
            let mut color = mixed(lush, [0.46, 0.39, 0.27], dry);
            if !park && transfer_function.on(2).unit() < 0.3 {
                color = mixed(color, [0.52, 0.48, 0.42], 0.8);
            }
            (Material::Grass, scaled(color, 1.0 + 0.35 * broad + 0.3 * grain))
        }
    }
}

/// Whether a park's path runs here, given a distance across the paths.
fn is_path(across_m: f64) -> bool {
    (across_m.rem_euclid(19.0) - 9.5).abs() < 0.9
}

fn street(dice: Dice, at: [f64; 2], [da, db]: [f64; 2], transfer_function: f64) -> Albedo {
    const PAINT: Albedo = [0.74, 0.74, 0.71];
    let patch = dice.on(6).on((at[0] / 5.0).floor() as i64).on((at[1] / 4.0).floor() as i64);
    let age = if patch.unit() < 0.25 { 0.72 } else { 1.0 };
    let asphalt = scaled([0.235, 0.232, 0.23], transfer_function * age);
    // (distance to this street's axis, to the crossing one's, position along).
    let (own, cross, along) = if da < db { (da, db, at[1]) } else { (db, da, at[0]) };
    let crossing = cross < STREET_HALF_M;
    let zebra = (5.4..8.2).contains(&cross) && (own / 1.1).rem_euclid(1.0) < 0.5;
    let dash = cross > 9.5 && own < 0.2 && along.rem_euclid(6.0) < 3.0;
    let edge = cross > 8.5 && (own - 3.0).abs() < 0.12;
    if !crossing && (zebra || dash || edge) { mixed(asphalt, PAINT, 0.8) } else { asphalt }
}

/// A yard with parking bays and parked cars seen as paint.
fn parking(dice: Dice, at: [f64; 2], transfer_function: f64) -> Albedo {
    let yard = scaled([0.34, 0.33, 0.32], transfer_function);
    let bay = [(at[0] / 2.6).floor() as i64, (at[1] / 5.4).floor() as i64];
    let (u, v) = (at[0].rem_euclid(2.6), at[1].rem_euclid(5.4));
    let bays = dice.on(1).on(bay[1]).unit() < 0.55;
    if bays
        && dice.on(2).on(bay[0]).on(bay[1]).unit() < 0.35
        && (0.4..2.2).contains(&u)
        && (0.5..4.8).contains(&v)
    {
        let body = car_color(dice.on(3).on(bay[0]).on(bay[1]));
        return if (1.5..2.2).contains(&v) || (3.6..4.1).contains(&v) { [0.06, 0.07, 0.08] } else { body };
    }
    if bays && u < 0.25 { mixed(yard, [0.7, 0.7, 0.68], 0.7) } else { yard }
}

/// Paint of a car.
pub(super) fn car_color(dice: Dice) -> Albedo {
    const COLORS: [Albedo; 7] = [
        [0.85, 0.85, 0.85],
        [0.07, 0.07, 0.08],
        [0.45, 0.46, 0.48],
        [0.55, 0.08, 0.07],
        [0.10, 0.18, 0.42],
        [0.70, 0.70, 0.72],
        [0.28, 0.27, 0.26],
    ];
    COLORS[(dice.unit() * COLORS.len() as f64) as usize]
}

/// Colour of a roof at (u, v) metres from its middle; `on_top` metres above the roof's own surface stand machines.
pub(super) fn roof(building: &Building, dice: Dice, [u, v]: [f64; 2], on_top_m: f64) -> Albedo {
    let own = dice.on(20).on(i64::from(building.owner));
    let pick = |palette: &[Albedo]| palette[(own.on(1).unit() * palette.len() as f64) as usize];
    let transfer_function = 0.85 + 0.3 * own.on(2).unit();
    let stain = dice.on(21).octaves(u + 50.0 * own.unit(), v, 7.0, 5);
    let [ha, hb] = building.half;
    let rim = (ha - u.abs()).min(hb - v.abs());
    if building.roof == Roof::Flat {
        let sheet = own.on(3).on((u / 4.0).floor() as i64).on((v / 3.0).floor() as i64).unit();
        if on_top_m > 0.8 {
            return scaled([0.66, 0.67, 0.68], 0.75 + 0.4 * sheet);
        }
        if rim < 0.5 {
            return scaled(pick(&MEMBRANES), 1.3);
        }
        let solar = own.on(4).unit() < 0.25 && rim > 2.0 && v > 0.0;
        if solar && v.rem_euclid(2.2) < 1.5 {
            return scaled([0.06, 0.08, 0.15], 1.0 + 0.5 * stain);
        }
        let skylight = sheet > 0.86 && u.rem_euclid(4.0) < 1.4 && v.rem_euclid(3.0) < 1.4;
        if skylight {
            return [0.82, 0.84, 0.86];
        }
        return scaled(pick(&MEMBRANES), transfer_function * (0.84 + 0.3 * sheet + 0.35 * stain));
    }
    let rows = 1.0 + 0.10 * (v / 0.75 * std::f64::consts::TAU).sin();
    let tile = own.on(5).on((u / 0.6).floor() as i64).on((v / 0.75).floor() as i64).unit();
    let ridge = if v.abs() < 0.3 { 1.3 } else { 1.0 };
    let window = own.on(6).on((u / 3.0).floor() as i64).on(i64::from(v > 0.0)).unit() < 0.3
        && (0.8..1.9).contains(&u.rem_euclid(3.0))
        && (0.35..0.6).contains(&(v.abs() / hb));
    if window {
        return [0.12, 0.14, 0.17];
    }
    let gutter = if rim < 0.3 { 0.7 } else { 1.0 };
    scaled(pick(&TILES), transfer_function * rows * ridge * gutter * (0.82 + 0.3 * tile + 0.45 * stain))
}

/// Colour of a crown.
pub(super) fn crown(dice: Dice, index: i64, x: f64, y: f64) -> Albedo {
    let own = dice.on(30).on(index);
    let base = mixed([0.10, 0.155, 0.065], [0.19, 0.22, 0.10], own.unit());
    scaled(base, 1.0 + 0.5 * dice.on(31).octaves(x, y, 1.6, 3))
}

/// Colour of a wall at a place; `along_m` runs along the wall.
pub(super) fn wall(dice: Dice, owner: u16, along_m: f64, height_m: f64) -> Albedo {
    let own = dice.on(40).on(i64::from(owner));
    let plaster = PLASTERS[(own.unit() * PLASTERS.len() as f64) as usize];
    let storey = (height_m / 3.0).floor() as i64;
    let bay = (along_m / 2.5).floor() as i64;
    let is_window = height_m.rem_euclid(3.0) > 1.0
        && (0.6..1.9).contains(&along_m.rem_euclid(2.5))
        && own.on(bay).on(storey).unit() < 0.85;
    let grime = 1.0 + 0.2 * own.octaves(along_m, height_m, 6.0, 4);
    if is_window { scaled([0.13, 0.15, 0.18], grime) } else { scaled(plaster, grime) }
}
