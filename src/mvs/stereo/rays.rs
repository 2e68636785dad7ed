//! The rays of a reference view's pixels, and where the source views see the points on them.

use crate::affine::ViewCamera;
use crate::frame::{CenterPx, Pixel, Point};
use crate::io::Grid2;
use crate::mvs::image::MatchImage;
use crate::mvs::plane_ranges::PlaneRanges;
use crate::mvs::plane_sweep::PlaneSweep;
use crate::mvs::ray_costs::Rays;
use multiversion::multiversion;
use std::ops::Range;

/// Number of fixed-point iterations that intersect a ray with the ground. The slopes of the ground are
/// gentle, so that each iteration leaves a fraction of the error.
const INTERSECTION_STEPS: usize = 6;

/// The rays of a view's pixels, which intersect a stack of planes parallel to the ground.
pub(super) struct GroundRays {
    /// Altitude of plane 0 on every ray, site metres.
    lowest: Grid2,
    /// Distance between planes, metres.
    step_m: f32,
    /// For every source view, the columns and rows at which it sees plane 0 on every ray, pixels.
    lowest_px: Vec<[Grid2; 2]>,
    /// For every source view, the displacement (columns, rows) in its image from one plane to the next on every
    /// ray, pixels: the mean up to the middle of the planes that are tested.
    step_px: Vec<[Grid2; 2]>,
}

impl GroundRays {
    /// The rays of `reference`, with planes `step_m` metres apart, of which those of `ranges` are tested; plane 0 lies `low_m`
    /// metres above the ground.
    pub fn new(
        sweep: &PlaneSweep,
        reference: &MatchImage,
        sources: &[&MatchImage],
        (low_m, step_m): (f32, f64),
        ranges: &PlaneRanges,
    ) -> Self {
        let camera = &reference.camera;
        let (width, height) = (reference.gray.width, reference.gray.height);
        let lowest = Grid2::from_rows(width, height, |row, line| {
            for (col, lowest) in line.iter_mut().enumerate() {
                *lowest = to_ground(sweep, camera, Pixel::new(col as f64, row as f64)) as f32 + low_m;
            }
        });
        // The point on a ray at a height above plane 0.
        let point = |col: usize, row: usize, above_m: f64| {
            let z = f64::from(lowest.at(col, row)) + above_m;
            let [x, y] = camera.localize(Pixel::new(col as f64, row as f64), z);
            Point::new(x, y, z)
        };
        // A grid of columns and one of rows.
        let columns_and_rows = |of: &(dyn Fn(usize, usize) -> [f64; 2] + Sync)| {
            [0, 1].map(|axis| {
                Grid2::from_rows(width, height, |row, line| {
                    line.iter_mut().enumerate().for_each(|(col, at)| *at = of(col, row)[axis] as f32);
                })
            })
        };
        let lowest_px = |source: &&MatchImage| {
            columns_and_rows(&|col, row| {
                let px = source.camera.project(point(col, row, 0.0));
                [px.col, px.row]
            })
        };
        let step_px = |source: &&MatchImage| {
            columns_and_rows(&|col, row| {
                let planes = ranges.planes(row * width + col);
                let middle = (0.5 * (planes.start + planes.end) as f64).max(1.0);
                let [low, high] =
                    [0.0, middle * step_m].map(|above_m| source.camera.project(point(col, row, above_m)));
                [(high.col - low.col) / middle, (high.row - low.row) / middle]
            })
        };
        Self {
            lowest_px: sources.iter().map(lowest_px).collect(),
            step_px: sources.iter().map(step_px).collect(),
            lowest,
            step_m: step_m as f32,
        }
    }
}

impl Rays for GroundRays {
    fn places(&self, source: usize, plane: usize, row: usize, columns: Range<usize>, out: [&mut [f32]; 2]) {
        let planes = self.lowest_px[source].iter().zip(&self.step_px[source]);
        for ((lowest, step), out) in planes.zip(out) {
            displaced(&lowest.row(row)[columns.clone()], &step.row(row)[columns.clone()], plane as f32, out);
        }
    }

    fn value(&self, pixel: usize, plane: f32) -> f32 {
        self.lowest.data[pixel] + self.step_m * plane
    }
}

/// Places that are displaced by `steps` times `step`.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx2+fma", "x86_64+avx2+fma"))]
fn displaced(places: &[f32], step: &[f32], steps: f32, out: &mut [f32]) {
    for ((out, place), step) in out.iter_mut().zip(places).zip(step) {
        *out = place + step * steps;
    }
}

/// Altitude of the ground that a pixel shows.
pub(super) fn to_ground(sweep: &PlaneSweep, camera: &ViewCamera, px: Pixel<CenterPx>) -> f64 {
    let below = |z: f64| {
        let [x, y] = camera.localize(px, z);
        ground_altitude(sweep, x, y)
    };
    (0..INTERSECTION_STEPS).fold(ground_altitude(sweep, 0.0, 0.0), |z, _| below(z))
}

/// Displacement in the image of a source view, pixels, of a point that moves up by one metre on a ray of the
/// reference view.
fn px_per_metre(reference: &ViewCamera, source: &ViewCamera) -> [f64; 2] {
    let [east, north] = reference.line_of_sight_slope();
    source.displace([east, north, 1.0])
}

/// Difference of altitude, metres, that moves a point on the rays of the reference view by one pixel of a
/// source view.
pub(super) fn metres_per_pixel(reference: &ViewCamera, source: &ViewCamera) -> f64 {
    let [u, v] = px_per_metre(reference, source);
    u.hypot(v).recip()
}

/// Altitude of the ground at a place (east and north, site metres), from the plane stack of the sweep.
fn ground_altitude(sweep: &PlaneSweep, x: f64, y: f64) -> f64 {
    let [east, north, _] = sweep.site.origin.xyz();
    let ground: &Grid2 = &sweep.stack.ground;
    let col = (x + east - sweep.grid.west) / sweep.grid.cell - 0.5;
    let row = (sweep.grid.north - y - north) / sweep.grid.cell - 0.5;
    let within = |v: f64, n: usize| v.clamp(0.0, n as f64 - 1.0);
    f64::from(ground.bilinear(within(col, ground.width), within(row, ground.height)))
}
