//! The lines of sight of an image, from its RPC.

use super::field::{Field, Place};
use crate::frame::{CenterPx, Pixel, SiteGrid};
use crate::rpc::{LocalizeError, Rpc};
use rayon::prelude::*;

/// Distance between localised positions, pixels; rays between them are interpolated.
const LATTICE_PX: usize = 8;

/// The lines of sight of the pixels of an image.
pub(super) trait Sight: Sync {
    /// Where the line of sight of an image position first meets the field.
    fn first_hit(&self, field: &Field, px: Pixel<CenterPx>) -> Option<Place>;
}

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

impl Sight for ViewRays {
    fn first_hit(&self, field: &Field, px: Pixel<CenterPx>) -> Option<Place> {
        field.first_hit(self.ray(px))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::calendar::Calendar;
    use super::super::keyed_rng::KeyedRng;
    use super::super::sensor::{LineScanner, acquisitions};
    use super::*;
    use crate::frame::{Point, Site};
    use crate::rpc::Axis;

    /// Cameras of five images of 120 x 120 pixels.
    pub(in super::super) fn views() -> Vec<(SiteGrid, Rpc)> {
        let place = Point::new(5.5, 43.3, 150.0);
        let grid = SiteGrid::at(place.at_height(0.0)).unwrap();
        acquisitions(KeyedRng::new(0), Calendar::Mild, 5, place)
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
}
