//! Reflectances of ground, roofs, tree crowns and walls, with texture at all scales so that image features can be matched.

use super::field::Material;
use super::keyed_rng::KeyedRng;
use super::plan::{BLOCK_EDGE_M, Building, LandUse, Plan, Roof, STREET_HALF_M};

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

/// A colour that is brighter by a factor, within the reflectances that occur.
pub(super) fn scaled(c: Albedo, by: f64) -> Albedo {
    c.map(|v| (f64::from(v) * by).clamp(0.015, 0.95) as f32)
}

/// The colour on the way from one to another.
pub(super) fn mixed(a: Albedo, b: Albedo, t: f64) -> Albedo {
    std::array::from_fn(|k| a[k] + (b[k] - a[k]) * t.clamp(0.0, 1.0) as f32)
}

/// Material and colour of open ground.
pub(super) fn ground(plan: &Plan, rng: KeyedRng, x: f64, y: f64) -> (Material, Albedo) {
    let at = plan.town_from_map(x, y);
    let grain = rng.key(1).fractal_noise(x, y, 0.9, 2);
    let broad = rng.key(2).fractal_noise(x, y, 24.0, 5);
    if plan.pond_distance(at) < 1.0 {
        let shade = 1.0 + 0.25 * rng.key(3).fractal_noise(x, y, 30.0, 3);
        return (Material::Water, scaled([0.055, 0.095, 0.105], shade));
    }
    let [da, db] = plan.street_distances(at);
    let nearest = da.min(db);
    if nearest < STREET_HALF_M {
        return (Material::Asphalt, street(rng, at, [da, db], 1.0 + 0.22 * broad + 0.12 * grain));
    }
    if nearest < BLOCK_EDGE_M {
        let slab = rng.key(4).key((at[0] / 1.5).floor() as i64).key((at[1] / 1.5).floor() as i64);
        let curb = if nearest < STREET_HALF_M + 0.35 { 1.25 } else { 1.0 };
        return (
            Material::Paving,
            scaled([0.43, 0.41, 0.38], curb * (0.85 + 0.25 * slab.uniform() + 0.15 * broad)),
        );
    }
    let block = plan.block_at(at);
    let own = plan.block_rng(block);
    match plan.land_use(block) {
        LandUse::Flats | LandUse::Tower | LandUse::Hall if own.key(30).uniform() < 0.6 || nearest > 14.0 => {
            (Material::Paving, parking(rng.key(5), at, 1.0 + 0.2 * broad + 0.12 * grain))
        }
        kind => {
            let c = plan.block_center(block);
            let lot = [((at[0] - c[0] + 100.0) / 16.5).floor(), ((at[1] - c[1] + 100.0) / 17.3).floor()];
            let shade = own.key(31).key(lot[0] as i64).key(lot[1] as i64);
            let park = matches!(kind, LandUse::Park | LandUse::Pond);
            if park && is_path((at[0] - c[0]) * 0.7 + (at[1] - c[1])) {
                return (Material::Paving, scaled([0.60, 0.53, 0.42], 1.0 + 0.15 * broad + 0.1 * grain));
            }
            let dry = if park { 0.25 } else { 0.75 * shade.uniform() } + 0.75 * broad;
            let lush = scaled([0.17, 0.25, 0.11], 0.8 + 0.5 * shade.key(1).uniform());
            let mut color = mixed(lush, [0.46, 0.39, 0.27], dry);
            if !park && shade.key(2).uniform() < 0.3 {
                color = mixed(color, [0.52, 0.48, 0.42], 0.8);
            }
            (Material::Grass, scaled(color, 1.0 + 0.35 * broad + 0.3 * grain))
        }
    }
}

/// Whether a position lies on a path of a park, given its distance across the paths in metres.
fn is_path(across_m: f64) -> bool {
    (across_m.rem_euclid(19.0) - 9.5).abs() < 0.9
}

fn street(rng: KeyedRng, at: [f64; 2], [da, db]: [f64; 2], shade: f64) -> Albedo {
    const PAINT: Albedo = [0.74, 0.74, 0.71];
    let patch = rng.key(6).key((at[0] / 5.0).floor() as i64).key((at[1] / 4.0).floor() as i64);
    let age = if patch.uniform() < 0.25 { 0.72 } else { 1.0 };
    let asphalt = scaled([0.235, 0.232, 0.23], shade * age);
    // Distance to the axis of this street, distance to the axis of the crossing street, position along this street.
    let (own, cross, along) = if da < db { (da, db, at[1]) } else { (db, da, at[0]) };
    let crossing = cross < STREET_HALF_M;
    let zebra = (5.4..8.2).contains(&cross) && (own / 1.1).rem_euclid(1.0) < 0.5;
    let dash = cross > 9.5 && own < 0.2 && along.rem_euclid(6.0) < 3.0;
    let edge = cross > 8.5 && (own - 3.0).abs() < 0.12;
    if !crossing && (zebra || dash || edge) { mixed(asphalt, PAINT, 0.8) } else { asphalt }
}

/// A yard with parking bays and parked cars, which are colours without height.
fn parking(rng: KeyedRng, at: [f64; 2], shade: f64) -> Albedo {
    let yard = scaled([0.34, 0.33, 0.32], shade);
    let bay = [(at[0] / 2.6).floor() as i64, (at[1] / 5.4).floor() as i64];
    let (u, v) = (at[0].rem_euclid(2.6), at[1].rem_euclid(5.4));
    let bays = rng.key(1).key(bay[1]).uniform() < 0.55;
    if bays
        && rng.key(2).key(bay[0]).key(bay[1]).uniform() < 0.35
        && (0.4..2.2).contains(&u)
        && (0.5..4.8).contains(&v)
    {
        let body = car_color(rng.key(3).key(bay[0]).key(bay[1]));
        return if (1.5..2.2).contains(&v) || (3.6..4.1).contains(&v) { [0.06, 0.07, 0.08] } else { body };
    }
    if bays && u < 0.25 { mixed(yard, [0.7, 0.7, 0.68], 0.7) } else { yard }
}

/// Paint of a car.
pub(super) fn car_color(rng: KeyedRng) -> Albedo {
    const COLORS: [Albedo; 7] = [
        [0.85, 0.85, 0.85],
        [0.07, 0.07, 0.08],
        [0.45, 0.46, 0.48],
        [0.55, 0.08, 0.07],
        [0.10, 0.18, 0.42],
        [0.70, 0.70, 0.72],
        [0.28, 0.27, 0.26],
    ];
    COLORS[(rng.uniform() * COLORS.len() as f64) as usize]
}

/// Colour of a roof at (u, v) metres from its centre; `on_top_m` is the height above the roof of a machine on it.
pub(super) fn roof(building: &Building, rng: KeyedRng, [u, v]: [f64; 2], on_top_m: f64) -> Albedo {
    let own = rng.key(20).key(i64::from(building.owner));
    let pick = |palette: &[Albedo]| palette[(own.key(1).uniform() * palette.len() as f64) as usize];
    let shade = 0.85 + 0.3 * own.key(2).uniform();
    let stain = rng.key(21).fractal_noise(u + 50.0 * own.uniform(), v, 7.0, 5);
    let [ha, hb] = building.half;
    let rim = (ha - u.abs()).min(hb - v.abs());
    if building.roof == Roof::Flat {
        let sheet = own.key(3).key((u / 4.0).floor() as i64).key((v / 3.0).floor() as i64).uniform();
        if on_top_m > 0.8 {
            return scaled([0.66, 0.67, 0.68], 0.75 + 0.4 * sheet);
        }
        if rim < 0.5 {
            return scaled(pick(&MEMBRANES), 1.3);
        }
        let solar = own.key(4).uniform() < 0.25 && rim > 2.0 && v > 0.0;
        if solar && v.rem_euclid(2.2) < 1.5 {
            return scaled([0.06, 0.08, 0.15], 1.0 + 0.5 * stain);
        }
        let skylight = sheet > 0.86 && u.rem_euclid(4.0) < 1.4 && v.rem_euclid(3.0) < 1.4;
        if skylight {
            return [0.82, 0.84, 0.86];
        }
        return scaled(pick(&MEMBRANES), shade * (0.84 + 0.3 * sheet + 0.35 * stain));
    }
    let rows = 1.0 + 0.10 * (v / 0.75 * std::f64::consts::TAU).sin();
    let tile = own.key(5).key((u / 0.6).floor() as i64).key((v / 0.75).floor() as i64).uniform();
    let ridge = if v.abs() < 0.3 { 1.3 } else { 1.0 };
    let window = own.key(6).key((u / 3.0).floor() as i64).key(i64::from(v > 0.0)).uniform() < 0.3
        && (0.8..1.9).contains(&u.rem_euclid(3.0))
        && (0.35..0.6).contains(&(v.abs() / hb));
    if window {
        return [0.12, 0.14, 0.17];
    }
    let gutter = if rim < 0.3 { 0.7 } else { 1.0 };
    scaled(pick(&TILES), shade * rows * ridge * gutter * (0.82 + 0.3 * tile + 0.45 * stain))
}

/// Colour of a tree crown.
pub(super) fn crown(rng: KeyedRng, index: i64, x: f64, y: f64) -> Albedo {
    let own = rng.key(30).key(index);
    let base = mixed([0.10, 0.155, 0.065], [0.19, 0.22, 0.10], own.uniform());
    scaled(base, 1.0 + 0.5 * rng.key(31).fractal_noise(x, y, 1.6, 3))
}

/// Colour of a wall; `along_m` is the position along the wall.
pub(super) fn wall(rng: KeyedRng, owner: u16, along_m: f64, height_m: f64) -> Albedo {
    let own = rng.key(40).key(i64::from(owner));
    let plaster = PLASTERS[(own.uniform() * PLASTERS.len() as f64) as usize];
    let storey = (height_m / 3.0).floor() as i64;
    let bay = (along_m / 2.5).floor() as i64;
    let is_window = height_m.rem_euclid(3.0) > 1.0
        && (0.6..1.9).contains(&along_m.rem_euclid(2.5))
        && own.key(bay).key(storey).uniform() < 0.85;
    let grime = 1.0 + 0.2 * own.fractal_noise(along_m, height_m, 6.0, 4);
    if is_window { scaled([0.13, 0.15, 0.18], grime) } else { scaled(plaster, grime) }
}
