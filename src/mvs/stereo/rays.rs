//! The rays of a reference view's pixels, and where the source views see the points on them.

use crate::affine::AffineCamera;
use crate::frame::Pixel;
use crate::io::Grid2;
use crate::mvs::image::MatchImage;
use crate::mvs::plane_sweep::PlaneSweep;

/// Number of fixed-point iterations that intersect a ray with the ground. The slopes of the ground are
/// gentle, so that each iteration leaves a fraction of the error.
const INTERSECTION_STEPS: usize = 6;

/// The rays of a view's pixels, which intersect a stack of planes parallel to the ground.
pub(super) struct Rays {
    /// Number of planes.
    pub planes: usize,
    /// Altitude of the lowest plane on every ray, site metres.
    pub lowest: Grid2,
    /// Distance between planes, metres.
    pub step_m: f32,
    /// For every source view, the columns and rows at which it sees the lowest plane on every ray, pixels.
    pub lowest_px: Vec<[Grid2; 2]>,
    /// For every source view, the displacement (columns, rows) in its image from one plane to the next, pixels.
    pub step_px: Vec<[f32; 2]>,
}

impl Rays {
    /// The rays of `reference`, with planes `step_m` metres apart over all heights of the sweep.
    pub fn new(sweep: &PlaneSweep, reference: &MatchImage, sources: &[&MatchImage], step_m: f64) -> Self {
        let camera = &reference.camera;
        let (width, height) = (reference.gray.width, reference.gray.height);
        let planes = (sweep.stack.height_m() / step_m).ceil() as usize + 1;
        let initial = ground_altitude(sweep, 0.0, 0.0);
        let lowest = Grid2::from_rows(width, height, |row, line| {
            for (col, lowest) in line.iter_mut().enumerate() {
                let to_ground = |z: f64| {
                    let [x, y] = camera.localize(Pixel::new(col as f64, row as f64), z);
                    ground_altitude(sweep, x, y)
                };
                let ground = (0..INTERSECTION_STEPS).fold(initial, |z, _| to_ground(z));
                *lowest = ground as f32 + sweep.stack.low;
            }
        });
        let lowest_px = |source: &&MatchImage| {
            [0, 1].map(|axis| {
                Grid2::from_rows(width, height, |row, line| {
                    for (col, at) in line.iter_mut().enumerate() {
                        let z = f64::from(lowest.at(col, row));
                        let [x, y] = camera.localize(Pixel::new(col as f64, row as f64), z);
                        let [u, v] = source.camera.displace([x, y, z]);
                        *at = ([u, v][axis] + source.camera.offset[axis]) as f32;
                    }
                })
            })
        };
        let step_px = sources.iter().map(|s| px_per_metre(camera, &s.camera).map(|d| (d * step_m) as f32));
        Self {
            planes,
            lowest_px: sources.iter().map(lowest_px).collect(),
            step_px: step_px.collect(),
            lowest,
            step_m: step_m as f32,
        }
    }
}

/// Displacement in the image of a source view, pixels, of a point that moves up by one metre on a ray of the
/// reference view.
fn px_per_metre(reference: &AffineCamera, source: &AffineCamera) -> [f64; 2] {
    let [east, north] = reference.line_of_sight_slope();
    source.displace([east, north, 1.0])
}

/// Difference of altitude, metres, that moves a point on the rays of the reference view by one pixel of a
/// source view.
pub(super) fn metres_per_pixel(reference: &AffineCamera, source: &AffineCamera) -> f64 {
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
