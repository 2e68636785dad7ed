//! Light in the room: soft, the same from every direction of view.

use super::shape::{Part, ROOM, SPHERE_CENTER, SPHERE_RADIUS_M, TABLE_TOP};
use super::texture;
use crate::simulate::keyed_rng::KeyedRng;
use glam::DVec3;

/// Irradiance of a surface by its normal: a constant, and a part that grows towards the lamp.
const CONSTANT_LIGHT: f64 = 0.78;
const LIGHT_FROM: DVec3 = DVec3::new(-0.06, 0.09, 0.16);
/// Share of the light that a body takes which covers the whole sky of a surface.
const OCCLUSION: f64 = 0.75;
/// Largest share of the light that a corner takes, and the distance over which this falls by e, metres.
const CORNER: f64 = 0.22;
const CORNER_M: f64 = 0.2;
/// Grey levels are radiance to this power, as displays expect.
const DISPLAY_EXPONENT: f64 = 1.0 / 2.2;

/// The colours of the room in its light.
pub(super) struct Shading {
    colors: KeyedRng,
}

impl Shading {
    /// The colours at an address of random numbers.
    pub(super) const fn new(colors: KeyedRng) -> Self {
        Self { colors }
    }

    /// Radiance of a place in all directions, by band. Parts without texture have one colour everywhere.
    pub(super) fn radiance(&self, part: Part, place: DVec3, normal: DVec3) -> DVec3 {
        let light = CONSTANT_LIGHT + LIGHT_FROM.dot(normal);
        let open = if part.is_textured() { openness(part, place, normal) } else { 1.0 };
        texture::albedo(self.colors, part, place, normal) * (light * open)
    }
}

/// Grey levels of a radiance.
pub(super) fn displayed(radiance: DVec3) -> [u8; 3] {
    radiance.to_array().map(|v| (255.0 * v.clamp(0.0, 1.0).powf(DISPLAY_EXPONENT)).round() as u8)
}

/// Share of the light that reaches a place past the sphere, the table and the corners of the room.
fn openness(part: Part, place: DVec3, normal: DVec3) -> f64 {
    let of_sphere = if part == Part::Sphere { 0.0 } else { covered_by_sphere(place, normal) };
    let is_of_table = matches!(part, Part::TableTop | Part::TableFrame | Part::Sphere);
    let of_table = if is_of_table { 0.0 } else { covered_by_table(place, normal) };
    let corners = if is_of_table { 1.0 } else { corners(place, normal) };
    (1.0 - OCCLUSION * (of_sphere + of_table).min(1.0)) * corners
}

/// Share of the sky of a surface, weighted by the cosine, that the sphere covers; exact where all of it is above the horizon.
fn covered_by_sphere(place: DVec3, normal: DVec3) -> f64 {
    let to_center = SPHERE_CENTER - place;
    let distance = to_center.length();
    let sine = (SPHERE_RADIUS_M / distance).min(1.0);
    let cosine = normal.dot(to_center) / distance;
    let height = if cosine > sine {
        cosine
    } else {
        // A parabola that ends at the sphere's setting.
        (cosine + sine).max(0.0).powi(2) / (4.0 * sine)
    };
    height * sine * sine
}

/// Share of the sky of a surface, weighted by the cosine, that the lower side of the table's top covers: Lambert's formula of
/// a polygon, which is exact where all of it is above the horizon.
fn covered_by_table(place: DVec3, normal: DVec3) -> f64 {
    let (low, high) = (TABLE_TOP.low, TABLE_TOP.high);
    let corners = [(low.x, low.y), (high.x, low.y), (high.x, high.y), (low.x, high.y)]
        .map(|(x, y)| (DVec3::new(x, y, low.z) - place).normalize());
    let side = |i: usize| {
        let (a, b) = (corners[i], corners[(i + 1) % 4]);
        let across = a.cross(b);
        across.length().atan2(a.dot(b)) * across.normalize_or_zero().dot(normal)
    };
    ((0..4).map(side).sum::<f64>() / std::f64::consts::TAU).abs().min(1.0)
}

/// Share of the light that the walls, floor and ceiling beside a place leave.
fn corners(place: DVec3, normal: DVec3) -> f64 {
    let beside = |k: usize| {
        let distance = (place[k] - ROOM.low[k]).min(ROOM.high[k] - place[k]).max(0.0);
        1.0 - CORNER * (-distance / CORNER_M).exp()
    };
    (0..3).filter(|k| normal[*k].abs() < 0.5).map(beside).product()
}
