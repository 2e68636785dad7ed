//! Rendering of images: rays of every pixel are cast through the RPC onto the height field, which is lit by the sun.

use super::cars::Cars;
use super::field::{Field, Material, Place};
use super::keyed_rng::KeyedRng;
use super::texture;
use crate::frame::{CenterPx, Pixel, SiteGrid};
use crate::rpc::{LocalizeError, Rpc};
use rayon::prelude::*;

/// Number of rays per pixel along each side.
const RAYS: usize = 3;
/// Distance between localised positions, pixels; rays between them are interpolated.
const LATTICE_PX: usize = 8;
/// Slope from which on a surface counts as a wall, metres per metre.
const WALL_SLOPE: f64 = 1.7;
/// Irradiance of a horizontal surface by the sky, relative to that of a surface perpendicular to the sun.
const SKY: [f64; 3] = [0.25, 0.275, 0.32];

/// The lines of sight of an image, localised on a lattice at three heights.
pub(super) struct ViewRays {
    columns: usize,
    lattice: Vec<[Place; 3]>,
}

impl ViewRays {
    /// The lines of sight of a square image of `size_px` pixels a side, from above `heights_m.1` to below `heights_m.0`.
    pub(super) fn new(
        rpc: &Rpc,
        grid: &SiteGrid,
        size_px: usize,
        heights_m: (f64, f64),
    ) -> Result<Self, LocalizeError> {
        let columns = size_px.div_ceil(LATTICE_PX) + 3;
        let (low, high) = heights_m;
        let lattice = (0..columns * columns)
            .into_par_iter()
            .map(|k| {
                let at = |i: usize| (i as f64 - 1.0) * LATTICE_PX as f64;
                let px = Pixel::<CenterPx>::new(at(k % columns), at(k / columns));
                let place = |h| Ok(grid.site_from_geodetic(rpc.localize(px, h)?).xyz());
                Ok([place(high)?, place(0.5 * (low + high))?, place(low)?])
            })
            .collect::<Result<_, LocalizeError>>()?;
        Ok(Self { columns, lattice })
    }

    /// The line of sight of an image position as a function of t, which is 0 at the highest and 1 at the lowest height.
    pub(super) fn ray(&self, px: Pixel<CenterPx>) -> impl Fn(f64) -> Place + use<> {
        let at = |v: f64| {
            let w = v / LATTICE_PX as f64 + 1.0;
            let i = w.floor().clamp(0.0, (self.columns - 2) as f64);
            (i as usize, w - i)
        };
        let ((i, u), (j, v)) = (at(px.col), at(px.row));
        let node = |di: usize, dj: usize| &self.lattice[(j + dj) * self.columns + i + di];
        let [top, middle, bottom]: [Place; 3] = std::array::from_fn(|h| {
            std::array::from_fn(|k| {
                let row = |dj| node(0, dj)[h][k] + (node(1, dj)[h][k] - node(0, dj)[h][k]) * u;
                row(0) + (row(1) - row(0)) * v
            })
        });
        move |t| {
            // Parabola through the three positions.
            std::array::from_fn(|k| {
                let bend = 2.0 * (top[k] - 2.0 * middle[k] + bottom[k]);
                top[k] + t * (bottom[k] - top[k] - bend + t * bend)
            })
        }
    }
}

/// Radiometry of a view: illumination, season, gain and noise.
#[derive(Clone, Debug)]
pub(super) struct Radiometry {
    /// Unit vector to the sun on the map.
    pub(super) sun: [f64; 3],
    /// Grey levels per unit of radiance, by band.
    pub(super) gain: [f64; 3],
    /// Grey level of black (haze), by band.
    pub(super) offset: [f64; 3],
    /// Standard deviation of the noise, grey levels.
    pub(super) noise: f64,
    /// Seasonal factor of the reflectance of vegetation, by band.
    pub(super) season: [f64; 3],
}

impl Radiometry {
    /// The radiometry of a view taken on a day of the year.
    pub(super) fn new(rng: KeyedRng, sun: [f64; 3], day_of_year: u32) -> Self {
        // The exposure follows the light on level ground; gains and haze of the bands vary between days.
        let exposure = 255.0 * 1.3 / (sun[2] + 0.27) * rng.key(1).uniform_in(0.85, 1.15);
        let cast = [rng.key(2).uniform_in(0.94, 1.08), 1.0, rng.key(3).uniform_in(0.92, 1.08)];
        let haze = rng.key(4).uniform_in(2.0, 16.0);
        let warmth = [1.0, 0.98, 0.92];
        let summer = ((f64::from(day_of_year) - 120.0) / 120.0).clamp(0.0, 1.0);
        Self {
            sun,
            gain: std::array::from_fn(|k| exposure * cast[k] * warmth[k]),
            offset: [0.75 * haze, 0.9 * haze, 1.25 * haze],
            noise: rng.key(5).uniform_in(0.8, 1.8),
            season: [0.9 + 0.4 * summer, 1.08 - 0.06 * summer, 0.95],
        }
    }
}

/// Renders an image: three bands of bytes, row by row.
pub(super) fn render(
    field: &Field,
    rays: &ViewRays,
    cars: Option<&Cars>,
    radiometry: &Radiometry,
    colors: KeyedRng,
    grain: KeyedRng,
    size_px: usize,
) -> Vec<Vec<u8>> {
    let pixels: Vec<[u8; 3]> = (0..size_px * size_px)
        .into_par_iter()
        .map(|k| {
            let (col, row) = (k % size_px, k / size_px);
            let mut sum = [0.0; 3];
            for s in 0..RAYS * RAYS {
                let inside = |i: usize| (i as f64 + 0.5) / RAYS as f64 - 0.5;
                let px = Pixel::new(col as f64 + inside(s % RAYS), row as f64 + inside(s / RAYS));
                if let Some(hit) = field.first_hit(rays.ray(px)) {
                    let light = radiance(field, hit, cars, radiometry, colors, grain);
                    (0..3).for_each(|b| sum[b] += light[b]);
                }
            }
            let rng = grain.key(col as i64).key(row as i64);
            std::array::from_fn(|b| {
                let mean = sum[b] / (RAYS * RAYS) as f64;
                let level = radiometry.offset[b]
                    + radiometry.gain[b] * mean
                    + radiometry.noise * rng.key(b as i64).normal();
                // The value 0 is not used, because some readers take it for nodata.
                level.round().clamp(1.0, 255.0) as u8
            })
        })
        .collect();
    (0..3).map(|b| pixels.iter().map(|p| p[b]).collect()).collect()
}

/// Radiance of a surface point towards the satellite, by band.
fn radiance(
    field: &Field,
    hit: Place,
    cars: Option<&Cars>,
    radiometry: &Radiometry,
    colors: KeyedRng,
    waves: KeyedRng,
) -> [f64; 3] {
    let [x, y, z] = hit;
    let (nodes, u, v) = field.around(x, y);
    let [gx, gy] = field.slope(x, y);
    let steep = gx.hypot(gy);
    let length = (1.0 + steep * steep).sqrt();
    let normal = [-gx / length, -gy / length, 1.0 / length];
    let mut sunlight = 1.0;
    let mut material = field.nearest(x, y).material;
    let mut albedo = [0.0f32; 3];
    if steep > WALL_SLOPE {
        // Nodes of a wall have the material of the roof above them.
        let top = nodes.iter().fold(nodes[0], |a, b| if b.height_m > a.height_m { b } else { a });
        material = top.material;
        albedo = if material == Material::Roof {
            texture::wall(colors, top.owner, (x * gy - y * gx) / steep, z)
        } else {
            top.albedo
        };
    } else {
        let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
        for (node, w) in nodes.iter().zip(weights) {
            (0..3).for_each(|b| albedo[b] += w as f32 * node.albedo[b]);
        }
        if let Some((color, share)) = cars.and_then(|c| c.at(field, x, y)) {
            (albedo, sunlight) = (color, share);
        }
    }
    let facing = (0..3).map(|k| normal[k] * radiometry.sun[k]).sum::<f64>();
    let start = [x, y, z + 0.03];
    let direct =
        if sunlight > 0.0 && facing > 0.0 && field.is_lit(start, radiometry.sun) { facing } else { 0.0 };
    let open_sky = 0.5 + 0.5 * normal[2];
    std::array::from_fn(|b| {
        let tint = match material {
            Material::Grass | Material::Tree => radiometry.season[b],
            Material::Water => 1.0 + 0.5 * waves.key(9).fractal_noise(x, y, 3.0, 2),
            _ => 1.0,
        };
        f64::from(albedo[b]) * tint * (direct + SKY[b] * open_sky)
    })
}

#[cfg(test)]
mod tests {
    use super::super::field::tests::one_box;
    use super::super::sensor::{LineScanner, acquisitions};
    use super::*;
    use crate::frame::{Point, Site};
    use crate::rpc::Axis;

    fn views() -> Vec<(SiteGrid, Rpc)> {
        let place = Point::new(5.5, 43.3, 150.0);
        let grid = SiteGrid::at(place.at_height(0.0)).unwrap();
        acquisitions(KeyedRng::new(0), 5, place)
            .iter()
            .map(|view| {
                let scanner = LineScanner::new(place, view, 120, 0.5);
                (grid, scanner.rpc(place, Axis { offset: 160.0, scale: 80.0 }).unwrap())
            })
            .collect()
    }

    #[test]
    fn interpolated_rays_are_the_rpc_to_a_ten_thousandth_of_a_pixel() {
        for (grid, rpc) in views() {
            let rays = ViewRays::new(&rpc, &grid, 120, (140.0, 220.0)).unwrap();
            for k in 0..200 {
                let rng = KeyedRng::new(1).key(k);
                let px = Pixel::new(rng.key(1).uniform_in(-0.5, 119.5), rng.key(2).uniform_in(-0.5, 119.5));
                let [x, y, z] = rays.ray(px)(rng.key(3).uniform());
                let seen = rpc.project(grid.geodetic_from_site(Point::<Site>::new(x, y, z)));
                assert!(seen.distance(px) < 1e-4, "{}", seen.distance(px));
            }
        }
    }

    #[test]
    fn a_bright_roof_is_rendered_where_the_rpc_projects_it() {
        let field = one_box();
        for (grid, rpc) in views() {
            let rays = ViewRays::new(&rpc, &grid, 120, (149.0, 163.0)).unwrap();
            let radiometry = Radiometry {
                sun: [0.3, -0.3, 0.9],
                gain: [255.0; 3],
                offset: [0.0; 3],
                noise: 0.0,
                season: [1.0; 3],
            };
            let image = render(&field, &rays, None, &radiometry, KeyedRng::new(0), KeyedRng::new(1), 120);
            let (mut sum, mut n) = ([0.0, 0.0], 0.0);
            for (k, level) in image[0].iter().enumerate() {
                // Only the sunlit roof exceeds this grey level.
                if *level > 190 {
                    sum[0] += (k % 120) as f64;
                    sum[1] += (k / 120) as f64;
                    n += 1.0;
                }
            }
            let roof = rpc.project(grid.geodetic_from_site(Point::<Site>::new(8.0, -6.0, 162.0)));
            let seen = Pixel::new(sum[0] / n, sum[1] / n);
            assert!(n > 100.0 && seen.distance(roof) < 0.4, "{seen:?} {roof:?} {n}");
        }
    }
}
