//! Fusion of the views' altitude maps to one surface on the map grid.

use super::fill::{close_gaps, fill};
use crate::affine::ViewCamera;
use crate::frame::Pixel;
use crate::io::{Grid2, MapGrid};
use crate::mvs::plane_sweep::PlaneSweep;
use crate::mvs::ray_map::RayMap;
use crate::mvs::reference_view::ReferenceView;
use crate::mvs::surface::MatchedSurface;
use rayon::prelude::*;

/// Largest difference of altitude across a gap between cells that is closed by interpolation, as a share of a
/// discontinuity.
const GAP_STEP: f32 = 2.0 / 3.0;

/// Altitudes and scores on the map grid.
type ResampledMap = (Grid2, Grid2);

/// The fused surface: in every cell the median of the altitude maps. Cells without altitude are filled from
/// their surroundings, with a score of 0.
pub(super) fn fused(sweep: &PlaneSweep, references: &[ReferenceView], maps: &[RayMap]) -> MatchedSurface {
    let PlaneSweep { site, grid, images, .. } = sweep;
    let resample = |(own, map): (&ReferenceView, &RayMap)| {
        let mut mesh = Mesh::new(grid, site.origin.xyz(), own.discontinuity);
        mesh.draw(&images[own.view].camera, map);
        (mesh.altitude, mesh.score)
    };
    let resampled: Vec<ResampledMap> = references.par_iter().zip(maps).map(resample).collect();
    let discontinuity_m = references.iter().fold(0.0, |most: f32, r| most.max(r.discontinuity));
    let median = |i: usize| {
        let mut known: Vec<(f32, f32)> = resampled.iter().map(|(z, s)| (z.data[i], s.data[i])).collect();
        known.retain(|(z, _)| !z.is_nan());
        known.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let (Some(low), Some(high)) =
            (known.get(known.len().saturating_sub(1) / 2), known.get(known.len() / 2))
        else {
            return (f32::NAN, 0.0);
        };
        // Matching in windows enlarges elevated objects. Where two altitudes differ at their edges, the lower
        // one is right.
        let z = if high.0 - low.0 <= discontinuity_m { 0.5 * (low.0 + high.0) } else { low.0 };
        (z, 0.5 * (low.1 + high.1))
    };
    let (altitude, score) = (0..grid.width * grid.height).into_par_iter().map(median).unzip();
    let raster = |data| Grid2 { width: grid.width, height: grid.height, data };
    let (mut altitude, mut score) = (raster(altitude), raster(score));
    close_gaps(&mut altitude, &mut score, GAP_STEP * discontinuity_m);
    fill(sweep, &mut altitude, &mut score, discontinuity_m);
    // Two or three views do not determine the surface well enough for training without this prior.
    let prior_weight =
        Grid2::from_fn(grid.width, grid.height, |col, row| f32::from(!altitude.at(col, row).is_nan()));
    MatchedSurface { site: *site, grid: *grid, altitude, score, prior_weight }
}

/// Draws an altitude map as a triangle mesh, seen from above: each cell takes the highest triangle.
struct Mesh<'a> {
    grid: &'a MapGrid,
    /// Easting and northing of the site's origin.
    origin: [f64; 2],
    /// Triangles with a larger difference of altitude cross a discontinuity and are not drawn, metres.
    discontinuity_m: f32,
    altitude: Grid2,
    score: Grid2,
}

impl<'a> Mesh<'a> {
    fn new(grid: &'a MapGrid, [east, north, _]: [f64; 3], discontinuity_m: f32) -> Self {
        Self {
            grid,
            origin: [east, north],
            discontinuity_m,
            altitude: Grid2::filled(grid.width, grid.height, f32::NAN),
            score: Grid2::filled(grid.width, grid.height, 0.0),
        }
    }

    /// Draws two triangles for every four neighbouring pixels.
    fn draw(&mut self, camera: &ViewCamera, map: &RayMap) {
        for row in 0..map.value.height - 1 {
            for col in 0..map.value.width - 1 {
                let corners = [(col, row), (col + 1, row), (col, row + 1), (col + 1, row + 1)];
                let corners = corners.map(|(c, r)| self.corner(camera, c, r, map.value.at(c, r)));
                for [a, b, c] in [[0, 1, 2], [3, 2, 1]] {
                    self.triangle([corners[a], corners[b], corners[c]], map.score.at(col, row));
                }
            }
        }
    }

    /// Column and row on the map grid (centres of cells at whole numbers) of the point that a pixel shows,
    /// and its altitude `z`.
    fn corner(&self, camera: &ViewCamera, col: usize, row: usize, z: f32) -> [f32; 3] {
        let [x, y] = camera.localize(Pixel::new(col as f64, row as f64), f64::from(z));
        let east = (x + self.origin[0] - self.grid.west) / self.grid.cell - 0.5;
        let south = (self.grid.north - y - self.origin[1]) / self.grid.cell - 0.5;
        [east as f32, south as f32, z]
    }

    /// Draws a triangle with corners as given by [`Mesh::corner`].
    fn triangle(&mut self, p: [[f32; 3]; 3], score: f32) {
        let [a, b, c] = p;
        let climb = a[2].max(b[2]).max(c[2]) - a[2].min(b[2]).min(c[2]);
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
        // The area is NaN if an altitude is.
        if area.is_nan() || area == 0.0 || climb > self.discontinuity_m {
            return;
        }
        let cells = |axis: usize, n: usize| {
            let (low, high) = (a[axis].min(b[axis]).min(c[axis]), a[axis].max(b[axis]).max(c[axis]));
            low.ceil().max(0.0) as usize..(high.floor() + 1.0).clamp(0.0, n as f32) as usize
        };
        let cols = cells(0, self.grid.width);
        for row in cells(1, self.grid.height) {
            for col in cols.clone() {
                let (x, y) = (col as f32, row as f32);
                let edge = |p: [f32; 3], q: [f32; 3]| (q[0] - p[0]) * (y - p[1]) - (x - p[0]) * (q[1] - p[1]);
                let weights = [edge(b, c), edge(c, a), edge(a, b)].map(|e| e / area);
                if weights.iter().any(|w| *w < -1e-4) {
                    continue;
                }
                let z = weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2];
                let i = row * self.grid.width + col;
                if self.altitude.data[i].is_nan() || self.altitude.data[i] < z {
                    (self.altitude.data[i], self.score.data[i]) = (z, score);
                }
            }
        }
    }
}
