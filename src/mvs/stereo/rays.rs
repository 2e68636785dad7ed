//! The rays of a reference view's pixels, and where other views see their points.

use crate::affine::AffineCamera;
use crate::frame::Pixel;
use crate::io::Grid2;
use crate::mvs::PlaneSweep;
use crate::mvs::correlation::MatchImage;

/// Steps in which a ray finds the ground, whose slopes are gentle: each leaves a fraction of the error.
const STEPS_TO_GROUND: usize = 6;

/// Planes parallel to the ground along the rays of a view's pixels.
pub(super) struct Rays {
    /// Number of planes.
    pub planes: usize,
    /// Altitude of the lowest plane on every ray, site metres.
    pub lowest: Grid2,
    /// From one plane to the next, metres.
    pub step_m: f32,
    /// For every other view the columns and rows at which it sees the lowest plane on every ray.
    pub start: Vec<[Grid2; 2]>,
    /// For every other view the columns and rows from one plane to the next.
    pub step_px: Vec<[f32; 2]>,
}

impl Rays {
    /// The rays of `reference`, with planes `step_m` apart over all heights of the sweep.
    pub fn new(sweep: &PlaneSweep, reference: &MatchImage, others: &[&MatchImage], step_m: f64) -> Self {
        let camera = &reference.camera;
        let (width, height) = (reference.gray.width, reference.gray.height);
        let planes = (sweep.stack.height_m() / step_m).ceil() as usize + 1;
        let start_z = sweep.ground_at(0.0, 0.0);
        let lowest = Grid2::from_rows(width, height, |row, line| {
            for (col, lowest) in line.iter_mut().enumerate() {
                let to_ground = |z: f64| {
                    let [x, y] = camera.place_at(Pixel::new(col as f64, row as f64), z);
                    sweep.ground_at(x, y)
                };
                let ground = (0..STEPS_TO_GROUND).fold(start_z, |z, _| to_ground(z));
                *lowest = ground as f32 + sweep.stack.low;
            }
        });
        let seen_at = |other: &&MatchImage| {
            [0, 1].map(|axis| {
                Grid2::from_rows(width, height, |row, line| {
                    for (col, at) in line.iter_mut().enumerate() {
                        let z = f64::from(lowest.at(col, row));
                        let [x, y] = camera.place_at(Pixel::new(col as f64, row as f64), z);
                        let [u, v] = other.camera.displace([x, y, z]);
                        *at = ([u, v][axis] + other.camera.offset[axis]) as f32;
                    }
                })
            })
        };
        let step_px = others.iter().map(|o| along_ray(camera, &o.camera).map(|d| (d * step_m) as f32));
        Self {
            planes,
            start: others.iter().map(seen_at).collect(),
            step_px: step_px.collect(),
            lowest,
            step_m: step_m as f32,
        }
    }
}

/// How far another view sees a point move that climbs a ray by a metre, pixels.
fn along_ray(reference: &AffineCamera, other: &AffineCamera) -> [f64; 2] {
    let [east, north] = reference.line_of_sight_slope();
    other.displace([east, north, 1.0])
}

/// Altitude on the reference's rays that moves a point by one pixel of another view, metres.
pub(super) fn metres_per_pixel(reference: &AffineCamera, other: &AffineCamera) -> f64 {
    let [u, v] = along_ray(reference, other);
    u.hypot(v).recip()
}
