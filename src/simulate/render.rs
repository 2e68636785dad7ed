//! Rendering of images: rays of every pixel are cast through the RPC onto the height field, which is lit by the sun.

use super::cars::{Cars, Cover};
use super::field::{Field, Material, Place};
use super::keyed_rng::KeyedRng;
use super::radiometry::Radiometry;
use super::rays::Sight;
use super::season::Palette;
use super::surface::Surface;
use super::texture::Albedo;
use crate::frame::Pixel;
use rayon::prelude::*;

/// Number of rays per pixel along each side.
const RAYS: usize = 3;

/// Everything that an image shows.
pub(super) struct Shot<'a> {
    pub(super) field: &'a Field,
    pub(super) rays: &'a dyn Sight,
    pub(super) cars: Option<Cars<'a>>,
    pub(super) palette: &'a Palette,
    pub(super) radiometry: &'a Radiometry,
    /// Address of the town's colours.
    pub(super) colors: KeyedRng,
    /// Address of this image's noise and waves.
    pub(super) grain: KeyedRng,
    /// Columns and rows.
    pub(super) size_px: usize,
}

/// An image and what is known about it; all row by row.
pub(super) struct Picture {
    /// Red, green, blue.
    pub(super) bands: Vec<Vec<u16>>,
    /// The image without cars and noise, in eight bits: red, green and blue of each pixel.
    pub(super) clean: Vec<u8>,
    /// Share of the rays that end in sunlight: 255 if all do. Cars cast no shadow here.
    pub(super) sunlit: Vec<u8>,
    /// 255 where a ray ends on a car or its shadow, else 0.
    pub(super) cars: Vec<u8>,
}

impl Picture {
    /// Percent of the pixels that show a car or its shadow.
    pub(super) fn cars_percent(&self) -> f64 {
        let shown = self.cars.iter().filter(|c| **c > 0).count();
        100.0 * shown as f64 / self.cars.len() as f64
    }
}

/// A pixel of a [`Picture`].
struct PicturePixel {
    image: [u16; 3],
    clean: [u8; 3],
    sunlit: u8,
    cars: u8,
}

impl Shot<'_> {
    /// Renders the image.
    pub(super) fn picture(&self) -> Picture {
        let pixels: Vec<_> =
            (0..self.size_px * self.size_px).into_par_iter().map(|k| self.pixel(k)).collect();
        Picture {
            bands: (0..3).map(|b| pixels.iter().map(|p| p.image[b]).collect()).collect(),
            clean: pixels.iter().flat_map(|p| p.clean).collect(),
            sunlit: pixels.iter().map(|p| p.sunlit).collect(),
            cars: pixels.iter().map(|p| p.cars).collect(),
        }
    }

    /// The fraction of slots to fill so that cars and their shadows cover a percentage of the pixels, or all of them if that is
    /// not enough.
    pub(super) fn fill_for(&self, cars: &Cars, percent: f64) -> f64 {
        let covering = |place: Place| {
            let is_wall = Surface::at(self.field, place, self.colors).is_wall;
            if is_wall { None } else { cars.covering_fill(self.field, place[0], place[1]) }
        };
        let pixels = self.size_px * self.size_px;
        let mut fills: Vec<f64> = (0..pixels)
            .into_par_iter()
            .filter_map(|k| self.hits(k).filter_map(covering).min_by(f64::total_cmp))
            .collect();
        fills.sort_by(f64::total_cmp);
        nearest_fill(&fills, (0.01 * percent * pixels as f64).round() as usize)
    }

    /// Where the rays of a pixel end.
    fn hits(&self, index: usize) -> impl Iterator<Item = Place> {
        let (col, row) = ((index % self.size_px) as f64, (index / self.size_px) as f64);
        (0..RAYS * RAYS).filter_map(move |s| {
            let inside = |i: usize| (i as f64 + 0.5) / RAYS as f64 - 0.5;
            let px = Pixel::new(col + inside(s % RAYS), row + inside(s / RAYS));
            self.rays.first_hit(self.field, px)
        })
    }

    fn pixel(&self, index: usize) -> PicturePixel {
        let (mut shown, mut clean) = ([0.0; 3], [0.0; 3]);
        let (mut sunlit, mut cars) = (0, 0);
        for hit in self.hits(index) {
            let surface = Surface::at(self.field, hit, self.colors);
            if surface.material == Material::Void {
                return PicturePixel { image: [0; 3], clean: [0; 3], sunlit: 0, cars: 0 };
            }
            let direct = surface.direct_light(self.field, self.radiometry.sun);
            sunlit += usize::from(direct > 0.0);
            let bare = self.radiance(&surface, surface.albedo, direct);
            let light = match self.cover(&surface) {
                None => bare,
                Some(cover) => {
                    cars = 255;
                    self.covered(&surface, cover, direct)
                }
            };
            for b in 0..3 {
                shown[b] += light[b];
                clean[b] += bare[b];
            }
        }
        let rng = self.grain.key((index % self.size_px) as i64).key((index / self.size_px) as i64);
        let rays = (RAYS * RAYS) as f64;
        let level = |b: usize, sum: f64, noise| self.radiometry.level(b, sum / rays, noise);
        PicturePixel {
            image: std::array::from_fn(|b| {
                level(b, shown[b], self.radiometry.noise * rng.key(b as i64).normal())
            }),
            clean: std::array::from_fn(|b| self.radiometry.in_eight_bits(level(b, clean[b], 0.0))),
            sunlit: (255.0 * sunlit as f64 / rays).round() as u8,
            cars,
        }
    }

    /// Grey levels of a surface without cars and noise.
    pub(super) fn color(&self, surface: &Surface) -> [u8; 3] {
        let direct = surface.direct_light(self.field, self.radiometry.sun);
        let radiance = self.radiance(surface, surface.albedo, direct);
        std::array::from_fn(|b| self.radiometry.in_eight_bits(self.radiometry.level(b, radiance[b], 0.0)))
    }

    /// What a surface shows of a car.
    fn cover(&self, surface: &Surface) -> Option<Cover> {
        let [x, y, _] = surface.place;
        self.cars.as_ref().filter(|_| !surface.is_wall)?.cover(self.field, x, y)
    }

    fn covered(&self, surface: &Surface, cover: Cover, direct: f64) -> [f64; 3] {
        let [x, y, _] = surface.place;
        match cover {
            Cover::Body(color) => self.radiance(surface, color, direct),
            Cover::Shadow => self.radiance(surface, self.field.nearest(x, y).albedo, 0.0),
        }
    }

    /// Radiance of a surface of a colour towards the satellite, by band.
    fn radiance(&self, surface: &Surface, albedo: Albedo, direct: f64) -> [f64; 3] {
        let reflectance = self.palette.reflectance(surface, albedo);
        let irradiance = Radiometry::irradiance(direct, surface.normal);
        let [x, y, _] = surface.place;
        let waves = match surface.material {
            Material::Water => 1.0 + 0.5 * self.grain.key(9).fractal_noise(x, y, 3.0, 2),
            _ => 1.0,
        };
        std::array::from_fn(|b| reflectance[b] * waves * irradiance[b])
    }
}

/// The fraction of slots to fill so that about `wanted` pixels are covered, if the fractions from which on each pixel is
/// covered are `fills`, in ascending order. A car is there or not, so that numbers of pixels come in steps.
fn nearest_fill(fills: &[f64], wanted: usize) -> f64 {
    let Some(before) = wanted.checked_sub(1) else { return 0.0 };
    let Some(&fill) = fills.get(before) else { return 1.0 };
    let with_last_car = fills.partition_point(|f| *f <= fill);
    let without = fills.partition_point(|f| *f < fill);
    if with_last_car - wanted <= wanted - without {
        return fill;
    }
    without.checked_sub(1).map_or(0.0, |last| fills[last])
}

#[cfg(test)]
mod tests {
    use super::super::field::tests::one_box;
    use super::super::rays::ViewRays;
    use super::super::rays::tests::views;
    use super::*;
    use crate::frame::{Point, Site, SiteGrid};
    use crate::rpc::Rpc;

    const SUN: [f64; 3] = [0.3, -0.3, 0.9];

    /// The box under [`SUN`], without cars and noise.
    fn picture(field: &Field, grid: &SiteGrid, rpc: &Rpc) -> Picture {
        let rays = &ViewRays::new(rpc, grid, 120, (149.0, 163.0)).unwrap();
        let radiometry = &Radiometry { sun: SUN, gain: [255.0; 3], offset: [0.0; 3], noise: 0.0, white: 255 };
        let (colors, grain) = (KeyedRng::new(0), KeyedRng::new(1));
        // On this day the mild palette leaves the grass dark.
        let palette = &Palette::mild(66, colors);
        Shot { field, rays, cars: None, palette, radiometry, colors, grain, size_px: 120 }.picture()
    }

    #[test]
    fn as_many_cars_are_there_as_come_nearest_to_the_wanted_pixels() {
        // Three cars, of two, three and one pixels.
        let fills = [0.1, 0.1, 0.4, 0.4, 0.4, 0.7];
        let found: Vec<f64> = (0..8).map(|wanted| nearest_fill(&fills, wanted)).collect();
        assert_eq!(found, [0.0, 0.1, 0.1, 0.1, 0.4, 0.4, 0.7, 1.0]);
    }

    #[test]
    fn a_bright_roof_is_rendered_where_the_rpc_projects_it() {
        let field = one_box();
        for (grid, rpc) in views() {
            let image = picture(&field, &grid, &rpc).bands;
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

    #[test]
    fn roofs_are_sunlit_and_the_ground_behind_a_building_is_not() {
        let field = one_box();
        for (grid, rpc) in views() {
            let sunlit = picture(&field, &grid, &rpc).sunlit;
            let at = |x: f64, y: f64, z: f64| {
                let px = rpc.project(grid.geodetic_from_site(Point::<Site>::new(x, y, z)));
                sunlit[px.row.round() as usize * 120 + px.col.round() as usize]
            };
            assert_eq!(at(8.0, -6.0, 162.0), 255, "the roof");
            // The sun is in the south-east. The box ends at x = 3 and y = -3; its shadow has 12 * 0.3 / 0.9 = 4 m along both axes.
            assert_eq!(at(0.5, 3.5, 150.0), 255, "ground beyond the end of the shadow");
            assert_eq!(at(25.0, -20.0, 150.0), 255, "ground on the side of the sun");
        }
        let (grid, rpc) = &views()[0];
        let sunlit = picture(&field, grid, rpc).sunlit;
        let px = rpc.project(grid.geodetic_from_site(Point::<Site>::new(7.0, -1.5, 150.0)));
        assert_eq!(
            sunlit[px.row.round() as usize * 120 + px.col.round() as usize],
            0,
            "ground in the shadow"
        );
    }
}
