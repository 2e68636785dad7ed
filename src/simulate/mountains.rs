//! A mountain without buildings: ridges with gullies between them, rock, scree, meadows and smooth snow.
//!
//! Ridges and valleys are those of eroded land, with knolls and hollows of all sizes on them. Gullies are waves across the line
//! of greatest slope, of four wavelengths, each of which follows the slope that the longer ones left, so that they branch. Heights
//! are a function of place and seed alone.

use super::erosion::Land;
use super::field::{Field, Material, Node};
use super::keyed_rng::KeyedRng;
use super::season::smoothstep;
use super::texture::{Albedo, mixed, scaled};
use rayon::prelude::*;

/// Ellipsoidal height of the rivers, metres: low for a mountain with snow, so that programs that project images to height 0 to find
/// what they share take its pairs as well.
const RIVER_M: f64 = 350.0;
/// Height of knolls and hollows, metres.
const ROUGHNESS_M: f64 = 16.0;
/// Distance by which ridges and valleys bend, metres: cells drain in eight directions only.
const BEND_M: f64 = 26.0;
/// Wavelengths of the gullies, metres.
const GULLIES_M: [f64; 4] = [58.0, 27.0, 13.0, 6.5];
/// Depth of a gully as a share of its wavelength where the slope is 45 degrees.
const GULLY_DEPTH: f64 = 0.075;
/// Weight of the cells around a place at which waves have half their height.
const FADE: f64 = 0.05;
/// Height above which snow lies on level ground, metres, and the width of the zone in which it sets in.
const SNOW_LINE_M: f64 = RIVER_M + 260.0;
const SNOW_ZONE_M: f64 = 50.0;
/// Depth of the snow, metres; it fills gullies, and hides stones.
const SNOW_DEPTH_M: f64 = 1.4;
/// Slopes, metres per metre, from which on snow and scree begin to slide, and up to which they hold.
const SNOW_SLOPES: (f64, f64) = (0.60, 0.90);
const SCREE_SLOPES: (f64, f64) = (0.66, 0.84);
/// Slopes and heights below which grass grows.
const GRASS_SLOPES: (f64, f64) = (0.30, 0.52);
const GRASS_LINE_M: f64 = RIVER_M + 190.0;

/// The mountain of a seed.
pub(super) struct Mountain {
    rng: KeyedRng,
    land: Land,
    /// Address of the colours.
    colors: KeyedRng,
}

/// What lies at a place, each from 0 to 1: snow on grass, grass on scree, scree on rock.
struct Cover {
    snow: f64,
    scree: f64,
    grass: f64,
}

impl Mountain {
    /// Height differences within a few hundred metres, metres.
    pub(super) const SPAN_M: f64 = 300.0;

    /// The mountain of a seed; `colors` is the address of its colours.
    pub(super) fn new(seed: u64, colors: KeyedRng) -> Self {
        let rng = KeyedRng::new(seed).key(500);
        Self { rng, land: Land::eroded(rng), colors }
    }

    /// The mountain over ±`half_m` with a node every `step_m`.
    pub(super) fn field(&self, half_m: f64, step_m: f64) -> Field {
        let side = Field::nodes_per_side(half_m, step_m);
        let place = |k: usize| k as f64 * step_m - half_m;
        let node = |k: usize| self.node(place(k % side), place(k / side));
        Field::new(half_m, step_m, (0..side * side).into_par_iter().map(node).collect())
    }

    /// The surface at a place.
    pub(super) fn node(&self, x: f64, y: f64) -> Node {
        // Turned against the axes, which the lattice of the noise follows.
        let (u, v) = (0.8 * x - 0.6 * y, 0.6 * x + 0.8 * y);
        let bend = |key| BEND_M * self.rng.key(key).fractal_noise(u, v, 110.0, 2);
        let (eroded_m, slope) = self.land.at(x + bend(2), y + bend(3));
        let ridges_m = eroded_m + ROUGHNESS_M * self.rng.key(1).fractal_noise(u, v, 150.0, 5);
        let (gullies_m, slope) = self.gullies(x, y, slope);
        let bare_m = RIVER_M + ridges_m + gullies_m;
        let cover = self.cover(x, y, bare_m, slope[0].hypot(slope[1]));
        let stones_m = self.stones_m(x, y, &cover);
        // Snow lies level with the rims of the gullies that it fills.
        let filled_m = cover.snow * (SNOW_DEPTH_M - 0.6 * gullies_m);
        let (material, albedo) = self.color(x, y, bare_m, &cover);
        Node { height_m: bare_m + filled_m + (1.0 - cover.snow) * stones_m, material, owner: 0, albedo }
    }

    /// Height of the ground in the gullies relative to that between them, metres, at a place with a slope; and the slope
    /// with the gullies.
    fn gullies(&self, x: f64, y: f64, mut slope: [f64; 2]) -> (f64, [f64; 2]) {
        let mut sum = 0.0;
        for (octave, wavelength_m) in GULLIES_M.into_iter().enumerate() {
            let steep = slope[0].hypot(slope[1]);
            if steep < 1e-6 {
                break;
            }
            let across = [-slope[1] / steep, slope[0] / steep];
            let (cos, sin) = self.waves(octave as i64, [x / wavelength_m, y / wavelength_m], across);
            let depth_m = GULLY_DEPTH * wavelength_m * smoothstep(steep);
            sum += depth_m * (cos - 1.0) * 0.5;
            let rate = -0.5 * depth_m * sin * std::f64::consts::TAU / wavelength_m;
            slope = [slope[0] + rate * across[0], slope[1] + rate * across[1]];
        }
        (sum, slope)
    }

    /// Cosine and sine of a wave of wavelength 1 along a direction whose phase varies from place to place.
    fn waves(&self, octave: i64, at: [f64; 2], along: [f64; 2]) -> (f64, f64) {
        let rng = self.rng.key(30 + octave);
        let cell = at.map(f64::floor);
        let (mut cos, mut sin, mut weights) = (0.0, 0.0, 0.0);
        for j in -1..=1 {
            for i in -1..=1 {
                let corner = [cell[0] + f64::from(i), cell[1] + f64::from(j)];
                let own = rng.key(corner[0] as i64).key(corner[1] as i64);
                let off =
                    [at[0] - corner[0] - own.key(0).uniform(), at[1] - corner[1] - own.key(1).uniform()];
                // 0 at the distance at which the next ring of cells would be needed.
                let weight = (1.0 - (off[0] * off[0] + off[1] * off[1])).max(0.0).powi(2);
                let phase = std::f64::consts::TAU * (off[0] * along[0] + off[1] * along[1]);
                cos += weight * phase.cos();
                sin += weight * phase.sin();
                weights += weight;
            }
        }
        // Waves end softly where no cell reaches.
        (cos / (weights + FADE), sin / (weights + FADE))
    }

    fn cover(&self, x: f64, y: f64, height_m: f64, steep: f64) -> Cover {
        let patches = self.rng.key(40).fractal_noise(x, y, 45.0, 4);
        let holds = |(from, to): (f64, f64)| smoothstep((to - steep - 0.1 * patches) / (to - from));
        let high = (height_m + 22.0 * patches - SNOW_LINE_M) / SNOW_ZONE_M + 0.5;
        let low = (GRASS_LINE_M - height_m + 22.0 * patches) / SNOW_ZONE_M + 0.5;
        Cover {
            snow: smoothstep(high) * holds(SNOW_SLOPES),
            scree: holds(SCREE_SLOPES),
            grass: smoothstep(low) * holds(GRASS_SLOPES),
        }
    }

    /// Height of ledges of rock and of the stones of scree, metres.
    fn stones_m(&self, x: f64, y: f64, cover: &Cover) -> f64 {
        let rock = 0.9 * self.rng.key(50).fractal_noise(x, y, 9.0, 4);
        let scree = 0.3 * self.rng.key(51).fractal_noise(x, y, 2.6, 2);
        let grass = 0.12 * self.rng.key(52).fractal_noise(x, y, 3.0, 2);
        let loose = scree + (grass - scree) * cover.grass;
        rock + (loose - rock) * cover.scree
    }

    fn color(&self, x: f64, y: f64, height_m: f64, cover: &Cover) -> (Material, Albedo) {
        let noise = |key, wavelength_m, count| self.colors.key(key).fractal_noise(x, y, wavelength_m, count);
        let (broad, grain) = (noise(70, 30.0, 5), noise(71, 1.4, 2));
        // Layers of rock, a few metres thick, that dip a little.
        let bed = ((height_m + 0.12 * x - 0.07 * y + 4.0 * broad) / 7.0).floor() as i64;
        let tone = 0.75 + 0.5 * self.colors.key(72).key(bed).uniform();
        let rock = scaled([0.30, 0.275, 0.25], tone * (1.0 + 0.35 * broad + 0.25 * grain));
        let scree = scaled([0.40, 0.385, 0.36], 1.0 + 0.35 * broad + 0.45 * noise(73, 0.9, 2));
        let grass = scaled([0.20, 0.24, 0.12], 1.0 + 0.45 * broad + 0.3 * grain);
        // Old and new snow differ by a few percent, and wind makes waves of one percent.
        let snow = scaled([0.86, 0.865, 0.88], 1.0 + 0.03 * noise(74, 14.0, 3) + 0.012 * noise(75, 1.1, 2));
        let ground = mixed(mixed(rock, scree, cover.scree), grass, cover.grass);
        let material = match cover {
            Cover { snow, .. } if *snow > 0.5 => Material::Snow,
            Cover { grass, .. } if *grass > 0.5 => Material::Grass,
            Cover { scree, .. } if *scree > 0.5 => Material::Scree,
            _ => Material::Rock,
        };
        (material, mixed(ground, snow, cover.snow))
    }
}

#[cfg(test)]
mod tests {
    use super::super::calendar::Calendar;
    use super::super::geodesy::PLACE;
    use super::super::rays::ViewRays;
    use super::super::sensor::{LineScanner, acquisitions};
    use super::*;
    use crate::frame::{CenterPx, Pixel, Point, Site, SiteGrid};
    use crate::rpc::Axis;

    fn field(seed: u64) -> Field {
        Mountain::new(seed, KeyedRng::new(seed).key(7)).field(110.0, 0.5)
    }

    #[test]
    fn mountains_are_steep_and_continuous_and_differ_by_seed() {
        let fields = [field(1), field(2)];
        for field in &fields {
            let (low, high) = field.height_range();
            assert!((40.0..Mountain::SPAN_M).contains(&(high - low)), "{low} {high}");
            let mut slopes: Vec<f64> = (0..4000)
                .map(|k| {
                    let rng = KeyedRng::new(9).key(k);
                    let [gx, gy] = field
                        .slope(rng.key(0).uniform_in(-109.0, 109.0), rng.key(1).uniform_in(-109.0, 109.0));
                    gx.hypot(gy).atan().to_degrees()
                })
                .collect();
            slopes.sort_by(f64::total_cmp);
            assert!((20.0..45.0).contains(&slopes[2000]), "median slope {}", slopes[2000]);
            assert!(slopes[3960] < 68.0, "steepest slopes {}", slopes[3960]);
        }
        assert!((fields[0].height_m(3.0, 4.0) - fields[1].height_m(3.0, 4.0)).abs() > 0.1);
    }

    #[test]
    fn snow_is_bright_and_smooth_and_scree_is_rough() {
        let field = field(2);
        // Deviation of the height from the mean of its neighbours, and brightness.
        let of = |material: Material| {
            let (mut rough, mut bright, mut n) = (0.0, 0.0, 0.0);
            for k in 0..40_000 {
                let (x, y) = (f64::from(k % 200) - 100.0, f64::from(k / 200) - 100.0);
                if field.nearest(x, y).material == material {
                    let around = [(-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0)];
                    let mean =
                        around.iter().map(|(dx, dy)| field.height_m(x + dx, y + dy)).sum::<f64>() / 4.0;
                    rough += (field.height_m(x, y) - mean).abs();
                    bright += f64::from(field.nearest(x, y).albedo[1]);
                    n += 1.0;
                }
            }
            assert!(n > 100.0, "{material:?} {n}");
            (rough / n, bright / n)
        };
        let (snow, rock) = (of(Material::Snow), of(Material::Rock));
        assert!(snow.0 < 0.8 * rock.0 && snow.1 > 1.5 * rock.1, "{snow:?} {rock:?}");
    }

    #[test]
    fn rays_end_on_the_surface_to_a_centimetre_and_pass_through_nothing_before() {
        let field = field(1);
        let (low, high) = field.height_range();
        let target = PLACE.at_height(field.height_m(0.0, 0.0));
        let grid = SiteGrid::at(PLACE.at_height(0.0)).unwrap();
        for view in acquisitions(KeyedRng::new(0), Calendar::Mild, 3, target) {
            let height = Axis { offset: 0.5 * (low + high), scale: 150.0 };
            let rpc = LineScanner::new(target, &view, 240, 0.5).rpc(target, height).unwrap();
            let rays = ViewRays::new(&rpc, &grid, 240, (low - 1.0, high + 1.0)).unwrap();
            for k in 0..300 {
                let rng = KeyedRng::new(4).key(k);
                let px = Pixel::<CenterPx>::new(
                    rng.key(1).uniform_in(20.0, 219.0),
                    rng.key(2).uniform_in(20.0, 219.0),
                );
                let path = rays.ray(px);
                let [x, y, z] = field.first_hit(&path).unwrap();
                assert!((z - field.height_m(x, y)).abs() < 0.01, "{z} {}", field.height_m(x, y));
                let seen = rpc.project(grid.geodetic_from_site(Point::<Site>::new(x, y, z)));
                assert!(seen.distance(px) < 1e-3, "{}", seen.distance(px));
                // Steps of a ray are half the distance between nodes, so that it may touch a tip that is lower than this.
                let over = |t: f64| {
                    let [x, y, z] = path(t);
                    field.height_m(x, y) - z
                };
                let end = (path(0.0)[2] - z - 0.05) / (path(0.0)[2] - path(1.0)[2]);
                let worst = (0..2000).map(|i| over(end * f64::from(i) / 2000.0)).fold(f64::MIN, f64::max);
                assert!(worst < 0.1, "{worst}");
            }
        }
    }
}
