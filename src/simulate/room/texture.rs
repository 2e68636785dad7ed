//! Colours of the room's surfaces, with detail at scales from metres to millimetres. They are fixed to the surfaces.

use super::shape::{Part, SPHERE_CENTER, SPHERE_RADIUS_M};
use crate::simulate::keyed_rng::KeyedRng;
use glam::DVec3;

/// Colours of the walls without texture.
const EAST_WALL: DVec3 = DVec3::new(0.70, 0.66, 0.56);
const NORTH_WALL: DVec3 = DVec3::new(0.50, 0.58, 0.62);
/// The pictures on the west wall: lowest and highest corner in y and z, metres.
const PICTURES: [[f64; 4]; 3] = [[-1.9, 1.0, -1.1, 2.0], [-0.6, 1.3, 0.3, 1.95], [0.9, 0.9, 1.8, 2.1]];
/// Width of the frame of a picture, metres.
const FRAME_M: f64 = 0.04;
/// The rug: lowest and highest corner in x and y, metres.
const RUG: [f64; 4] = [-1.6, -2.0, 0.4, -0.7];

/// Reflectance of a place of a part, by band.
pub(super) fn albedo(rng: KeyedRng, part: Part, place: DVec3, normal: DVec3) -> DVec3 {
    let DVec3 { x, y, z } = place;
    let color = match part {
        Part::EastWall => return EAST_WALL,
        Part::NorthWall => return NORTH_WALL,
        Part::Floor => floor(rng.key(1), x, y),
        Part::Ceiling => ceiling(rng.key(2), x, y),
        Part::WestWall => wallpaper(rng.key(3), y, z),
        Part::SouthWall => bricks(rng.key(4), x, z),
        Part::TableTop => planks(rng.key(5), x, y, 0.1, DVec3::new(0.50, 0.32, 0.18)),
        Part::TableFrame => {
            let along = if normal.z.abs() > 0.5 { (x, y) } else { (x + y, z) };
            let grain = rng.key(6).fractal_noise(6.0 * along.0, along.1, 0.3, 5);
            DVec3::new(0.34, 0.22, 0.13) * (1.0 + 0.6 * grain)
        }
        Part::Sphere => marble(rng.key(7), place),
    };
    color.clamp(DVec3::splat(0.02), DVec3::splat(0.92))
}

/// Whole number of a cell and the position in it from 0 to 1.
fn cell(at: f64, size: f64) -> (i64, f64) {
    let place = at / size;
    (place.floor() as i64, place - place.floor())
}

/// A colour of an address.
fn random_color(rng: KeyedRng) -> DVec3 {
    DVec3::from_array([1, 2, 3].map(|k| rng.key(k).uniform_in(0.08, 0.8)))
}

fn floor(rng: KeyedRng, x: f64, y: f64) -> DVec3 {
    let [west, south, east, north] = RUG;
    if (west..east).contains(&x) && (south..north).contains(&y) {
        return rug(rng.key(1), x - west, y - south, (x - west).min(east - x).min(y - south).min(north - y));
    }
    planks(rng.key(2), x, y, 0.14, DVec3::new(0.56, 0.42, 0.28))
}

/// Wooden planks along y.
fn planks(rng: KeyedRng, x: f64, y: f64, width_m: f64, wood: DVec3) -> DVec3 {
    const LENGTH_M: f64 = 1.1;
    const SEAM_M: f64 = 0.004;
    let (column, across) = cell(x, width_m);
    let (row, along) = cell(y + LENGTH_M * rng.key(column).uniform(), LENGTH_M);
    let plank = rng.key(column).key(row);
    let edge_m = (across.min(1.0 - across) * width_m).min(along.min(1.0 - along) * LENGTH_M);
    if edge_m < SEAM_M {
        return wood * 0.3;
    }
    let grain = plank.key(1).fractal_noise(9.0 * x, y, 0.45, 6);
    let knots = rng.key(-1).fractal_noise(x, y, 0.35, 5);
    let pores = rng.key(-2).fractal_noise(2.0 * x, y, 0.06, 3);
    let hue = DVec3::new(1.0, 1.0 + 0.12 * (plank.key(2).uniform() - 0.5), 1.0);
    wood * hue * (0.75 + 0.5 * plank.uniform()) * (1.0 + 0.75 * grain + 0.35 * knots + 0.35 * pores)
}

fn rug(rng: KeyedRng, u: f64, v: f64, rim_m: f64) -> DVec3 {
    let weave = 1.0 + 0.5 * rng.fractal_noise(u, v, 0.04, 3) + 0.35 * rng.key(9).fractal_noise(u, v, 0.5, 3);
    if rim_m < 0.06 {
        return DVec3::new(0.16, 0.13, 0.24) * weave;
    }
    let ((i, a), (j, b)) = (cell(u, 0.2), cell(v, 0.2));
    let diamond = (a - 0.5).abs() + (b - 0.5).abs();
    let ground = DVec3::new(0.46, 0.12, 0.12);
    let color = if diamond < 0.22 {
        random_color(rng.key(i).key(j))
    } else if diamond < 0.42 {
        DVec3::new(0.70, 0.58, 0.36)
    } else {
        ground
    };
    color * weave
}

/// Tiles of plaster with specks.
fn ceiling(rng: KeyedRng, x: f64, y: f64) -> DVec3 {
    const TILE_M: f64 = 0.5;
    let ((i, a), (j, b)) = (cell(x + 0.1, TILE_M), cell(y, TILE_M));
    let edge_m = a.min(1.0 - a).min(b).min(1.0 - b) * TILE_M;
    let shade = if edge_m < 0.008 { 0.55 } else { 0.88 + 0.18 * rng.key(i).key(j).uniform() };
    let stains = rng.key(1).fractal_noise(x, y, 0.7, 4);
    let specks = rng.key(2).value_noise(x / 0.022, y / 0.022);
    let specks = if specks > 0.74 { 0.6 } else { 1.0 };
    let rough = rng.key(3).fractal_noise(x, y, 0.06, 3);
    DVec3::new(0.70, 0.68, 0.62) * (shade * specks * (1.0 + 0.3 * stains + 0.3 * rough))
}

/// Wallpaper with a pattern, and three pictures on it.
fn wallpaper(rng: KeyedRng, y: f64, z: f64) -> DVec3 {
    for (k, [left, bottom, right, top]) in (0..).zip(PICTURES) {
        let rim_m = (y - left).min(right - y).min(z - bottom).min(top - z);
        if rim_m > FRAME_M {
            return picture(rng.key(10 + k), y - left, z - bottom);
        }
        if rim_m > 0.0 {
            return DVec3::new(0.13, 0.10, 0.07) * (1.0 + 0.5 * rng.fractal_noise(y, z, 0.05, 3));
        }
    }
    let (stripe, across) = cell(y, 0.25);
    let base =
        if stripe.rem_euclid(2) == 0 { DVec3::new(0.58, 0.60, 0.44) } else { DVec3::new(0.50, 0.55, 0.42) };
    let (row, up) = cell(z + 0.08 * stripe as f64, 0.2);
    let flower = rng.key(stripe).key(row);
    let away = ((across - 0.5) * 0.25).hypot((up - 0.5) * 0.2);
    let angle = (up - 0.5).atan2(across - 0.5) + flower.uniform() * std::f64::consts::TAU;
    let petal_m = 0.045 * (1.0 + 0.35 * (5.0 * angle).cos());
    let color = if away < 0.012 {
        DVec3::new(0.75, 0.62, 0.2)
    } else if away < petal_m {
        base * 0.35 + random_color(flower) * 0.5
    } else {
        base
    };
    let (broad, fine) = (rng.key(1).fractal_noise(y, z, 0.8, 4), rng.key(2).fractal_noise(y, z, 0.05, 3));
    color * (1.0 + 0.3 * broad + 0.25 * fine)
}

/// A picture of coloured rectangles at three scales.
fn picture(rng: KeyedRng, u: f64, v: f64) -> DVec3 {
    let mut color = random_color(rng);
    for (k, size_m) in (1..).zip([0.3, 0.11, 0.037]) {
        let (i, j) = (cell(u + 0.03 * size_m, size_m).0, cell(v, 0.8 * size_m).0);
        let tile = rng.key(k).key(i).key(j);
        color += (random_color(tile) - color) * (0.75 * tile.key(4).uniform());
    }
    color * (1.0 + 0.2 * rng.key(9).fractal_noise(u, v, 0.03, 2))
}

fn bricks(rng: KeyedRng, x: f64, z: f64) -> DVec3 {
    const LENGTH_M: f64 = 0.24;
    const HEIGHT_M: f64 = 0.08;
    const MORTAR_M: f64 = 0.006;
    let (row, up) = cell(z, HEIGHT_M);
    let (column, along) = cell(x + if row % 2 == 0 { 0.0 } else { 0.5 * LENGTH_M }, LENGTH_M);
    let edge_m = (along.min(1.0 - along) * LENGTH_M).min(up.min(1.0 - up) * HEIGHT_M);
    let (broad, rough) = (rng.key(1).fractal_noise(x, z, 0.9, 4), rng.key(2).fractal_noise(x, z, 0.07, 4));
    if edge_m < MORTAR_M {
        return DVec3::new(0.56, 0.53, 0.49) * (1.0 + 0.3 * rough);
    }
    let brick = rng.key(column).key(row);
    let fired = brick.key(1).uniform();
    let clay = DVec3::new(0.52, 0.24, 0.16).lerp(DVec3::new(0.36, 0.22, 0.20), fired);
    clay * (0.7 + 0.6 * brick.uniform()) * (1.0 + 0.25 * broad + 0.5 * rough)
}

/// Patches and veins of a sphere: noise of three planes, weighted by the normal, so that there is no seam.
fn marble(rng: KeyedRng, place: DVec3) -> DVec3 {
    let at = place - SPHERE_CENTER;
    let weights = (at / SPHERE_RADIUS_M).powf(2.0);
    let noise = |key: i64, wavelength_m, octaves| {
        let plane = |k: i64, a, b| rng.key(key).key(k).fractal_noise(a, b, wavelength_m, octaves);
        plane(0, at.y, at.z) * weights.x + plane(1, at.z, at.x) * weights.y + plane(2, at.x, at.y) * weights.z
    };
    let patches = (0.5 + 2.0 * noise(1, 0.18, 2)).clamp(0.0, 1.0);
    let veins = (1.0 - 7.0 * noise(2, 0.12, 4).abs()).max(0.0);
    let color = DVec3::new(0.14, 0.30, 0.52).lerp(DVec3::new(0.78, 0.70, 0.40), patches);
    color.lerp(DVec3::splat(0.85), 0.6 * veins) * (1.0 + 0.4 * noise(3, 0.04, 3))
}
