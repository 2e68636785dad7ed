//! The satellites: time and direction of each acquisition, and the line scanner.
//!
//! The scanner records the ground line by line while it moves, so that the viewing direction varies over the image as in
//! real images. An RPC is fitted to it, and the image is rendered with the RPC, which therefore is the exact camera.

use super::calendar::{Calendar, Moment, season_day};
use super::error::SimulateError;
use super::geodesy::{Ecef, ecef_from_geodetic, local_axes};
use super::keyed_rng::KeyedRng;
use super::options::PlannedView;
use crate::frame::{CenterPx, Geodetic, Pixel, Point};
use crate::rpc::{Axis, Rpc, RpcError, Volume, fit};
use crate::scene::Sun;

/// Height of the orbit above the ground, metres (WorldView-3).
const ALTITUDE_M: f64 = 617_000.0;
/// Speed along the orbit, metres per second.
const SPEED_M_S: f64 = 7_550.0;
/// True heading of the descending, sun-synchronous orbit, degrees.
const HEADING_DEG: f64 = 191.0;
/// Image lines per second.
const LINES_PER_S: f64 = 14_000.0;
/// Standard deviation of the pointing error of a delivered RPC, per axis, pixels.
const POINTING_SIGMA_PX: f64 = 4.0;
/// One of this number of images is rotated by 90°.
const TURNED_EVERY: usize = 5;
/// Margin of the ground volume of the RPC around the image on each side, as a fraction of the half width of the image.
const VOLUME_MARGIN: f64 = 0.35;

/// Time and direction of one acquisition.
#[derive(Clone, Debug)]
pub(super) struct Acquisition {
    pub(super) name: String,
    /// Zenith angle of the satellite seen from the ground, degrees.
    pub(super) off_nadir_deg: f64,
    /// True azimuth of the satellite seen from the ground, degrees.
    pub(super) azimuth_deg: f64,
    /// True azimuth of the image's right-hand side, degrees.
    pub(super) right_deg: f64,
    pub(super) sun: Sun,
    pub(super) day_of_year: u32,
    /// Acquisition time, ISO 8601 in UTC.
    pub(super) acquired: String,
    /// Shift of the delivered RPC against the true one, (column, row) in pixels.
    pub(super) pointing_error: (f64, f64),
}

/// Fraction of a turn between consecutive views that spreads any number of them evenly.
const GOLDEN: f64 = 0.618_033_988_749_895;

/// Plans `count` acquisitions of a position.
pub(super) fn acquisitions(
    rng: KeyedRng,
    calendar: Calendar,
    count: usize,
    place: Point<Geodetic>,
) -> Vec<Acquisition> {
    (0..count)
        .map(|i| {
            let rng = rng.key(i as i64);
            let day = season_day(calendar.day(((i as f64 + 0.5) * GOLDEN * 2.0).fract()), place);
            let moment = calendar.moment(i, day, rng, place);
            let turned = if i % TURNED_EVERY == 3 { 90.0 } else { 0.0 };
            Acquisition::new(
                format!("VIEW_{:02}", i + 1),
                i as f64 / spaces(count),
                i as f64,
                turned,
                moment,
                rng,
            )
        })
        .collect()
}

/// The acquisitions of a position that a user plans.
///
/// # Errors
/// [`SimulateError::Time`] for times that are none.
pub(super) fn planned(
    rng: KeyedRng,
    calendar: Calendar,
    views: &[PlannedView],
    place: Point<Geodetic>,
) -> Result<Vec<Acquisition>, SimulateError> {
    let free = acquisitions(rng, calendar, views.len(), place).into_iter();
    let as_planned = |(free, view): (Acquisition, &PlannedView)| {
        let moment = match &view.acquired {
            Some(time) => Moment::at(time, place)?,
            None => Moment { day_of_year: free.day_of_year, sun: free.sun, acquired: free.acquired.clone() },
        };
        Ok(Acquisition {
            off_nadir_deg: view.off_nadir_deg,
            azimuth_deg: view.azimuth_deg.rem_euclid(360.0),
            sun: moment.sun,
            day_of_year: moment.day_of_year,
            acquired: moment.acquired,
            ..free
        })
    };
    free.zip(views).map(as_planned).collect()
}

/// Plans `count` acquisitions on days and from directions between those of the images to train on.
pub(super) fn held_out(
    rng: KeyedRng,
    calendar: Calendar,
    training: &[Acquisition],
    count: usize,
    place: Point<Geodetic>,
) -> Vec<Acquisition> {
    let mut days: Vec<f64> = training.iter().map(|view| f64::from(view.day_of_year)).collect();
    days.sort_by(f64::total_cmp);
    let between = positions_between(days.len(), count);
    between
        .into_iter()
        .enumerate()
        .map(|(i, position)| {
            let rng = rng.key(i as i64);
            let before = position as usize;
            let day = days[before] + (days[before + 1] - days[before]) * position.fract();
            let moment = calendar.moment(i, day.round() as u32, rng, place);
            let outwards = position / spaces(training.len());
            Acquisition::new(format!("TEST_{:02}", i + 1), outwards, position, 0.0, moment, rng)
        })
        .collect()
}

/// Number of spaces between `count` views, at least 1.
fn spaces(count: usize) -> f64 {
    (count.max(2) - 1) as f64
}

/// `count` positions in the spaces between `n` points at 0, 1, 2, …: distributed over the spaces evenly, and in each space
/// too. Of a single one in a space this is the middle.
fn positions_between(n: usize, count: usize) -> Vec<f64> {
    let space_of = |i: usize| (2 * i + 1) * (n - 1) / (2 * count);
    let place = |i: usize| {
        let space = space_of(i);
        let in_space = (0..count).filter(|k| space_of(*k) == space).count();
        let before = (0..i).filter(|k| space_of(*k) == space).count();
        space as f64 + (before + 1) as f64 / (in_space + 1) as f64
    };
    (0..count).map(place).collect()
}

impl Acquisition {
    /// A view from a direction of the spiral over the cap of directions: `outwards` is 0 in its middle and 1 at its border,
    /// `step` counts the steps along it. `turned_deg` turns the image.
    fn new(name: String, outwards: f64, step: f64, turned_deg: f64, moment: Moment, rng: KeyedRng) -> Self {
        let spread = (step * GOLDEN).fract();
        // The square root distributes the views evenly over the spherical cap of directions.
        let off_nadir_deg = 5.5 + 23.5 * outwards.sqrt() * rng.key(1).uniform_in(0.9, 1.0);
        let azimuth_deg = (360.0 * spread + rng.key(2).uniform_in(-12.0, 12.0) + 20.0).rem_euclid(360.0);
        Self {
            name,
            off_nadir_deg,
            azimuth_deg,
            right_deg: 90.0 + rng.key(5).uniform_in(-9.0, 9.0) + turned_deg,
            sun: moment.sun,
            day_of_year: moment.day_of_year,
            acquired: moment.acquired,
            pointing_error: (
                POINTING_SIGMA_PX * rng.key(6).normal(),
                POINTING_SIGMA_PX * rng.key(7).normal(),
            ),
        }
    }
}

/// A line scanner in motion.
pub(super) struct LineScanner {
    /// Ground point at the image's centre.
    target: Ecef,
    /// Position of the satellite at the central line.
    position: Ecef,
    /// Motion of the satellite per line, metres.
    advance: Ecef,
    /// Motion of the line of sight on the ground per line, metres.
    sweep: Ecef,
    /// Direction of the line of detectors.
    detector: Ecef,
    /// Pixels per unit of tangent.
    focal_px: f64,
    /// Column and row of the image centre.
    center: Pixel<CenterPx>,
}

impl LineScanner {
    /// A scanner that takes `size_px` square images centred on `target` with pixels of `gsd_m` at nadir.
    pub(super) fn new(target: Point<Geodetic>, view: &Acquisition, size_px: usize, gsd_m: f64) -> Self {
        let axes = local_axes(target);
        let ground = ecef_from_geodetic(target);
        let to_satellite = axes.direction(view.azimuth_deg, 90.0 - view.off_nadir_deg);
        // |ground + range * direction| = |ground| + altitude.
        let along = ground.dot(&to_satellite);
        let orbit = ground.norm() + ALTITUDE_M;
        let range = -along + (along * along + orbit * orbit - ground.norm_squared()).sqrt();
        let right = axes.direction(view.right_deg, 0.0);
        let down = axes.direction(view.right_deg + 90.0, 0.0);
        let across = |d: Ecef| (1.0 - d.dot(&to_satellite).powi(2)).sqrt();
        let half = 0.5 * (size_px as f64 - 1.0);
        Self {
            target: ground,
            position: ground + to_satellite * range,
            advance: axes.direction(HEADING_DEG, 0.0) * (SPEED_M_S / LINES_PER_S),
            sweep: down * (gsd_m / across(down)),
            detector: (right - to_satellite * right.dot(&to_satellite)).normalize(),
            focal_px: range / gsd_m,
            center: Pixel::new(half, half),
        }
    }

    /// Image position of a ground point.
    pub(super) fn project(&self, p: Point<Geodetic>) -> Pixel<CenterPx> {
        let p = ecef_from_geodetic(p);
        // Tangents of the viewing angles along the track and along the detectors, `line` lines after the central one.
        let tangents = |line: f64| {
            let satellite = self.position + self.advance * line;
            let axis = (self.target + self.sweep * line - satellite).normalize();
            let detector = (self.detector - axis * self.detector.dot(&axis)).normalize();
            let ray = p - satellite;
            let depth = ray.dot(&axis);
            (ray.dot(&axis.cross(&detector)) / depth, ray.dot(&detector) / depth)
        };
        // The line that records the point is the root of a nearly linear function, found by the secant method.
        let (mut a, mut b) = (0.0, 10.0);
        let (mut fa, mut fb) = (tangents(a).0, tangents(b).0);
        for _ in 0..8 {
            if (fb - fa).abs() < 1e-18 {
                break;
            }
            let next = b - fb * (b - a) / (fb - fa);
            (a, fa) = (b, fb);
            (b, fb) = (next, tangents(next).0);
        }
        Pixel::new(self.center.col + self.focal_px * tangents(b).1, self.center.row + b)
    }

    /// Fits the RPC of the scanner over its image and a range of heights.
    pub(super) fn rpc(&self, target: Point<Geodetic>, height: Axis) -> Result<Rpc, RpcError> {
        fit(&self.volume(target, height), |p| self.project(p))
    }

    fn volume(&self, target: Point<Geodetic>, height: Axis) -> Volume {
        let size = 2.0 * self.center.row + 1.0;
        let ground_px_m = self.sweep.norm();
        // Half the diagonal of the image, and the parallax of the lowest and highest ground.
        let radius_m = (1.0 + VOLUME_MARGIN) * (0.72 * size * ground_px_m + 0.6 * height.scale);
        let degree_m = 111_200.0;
        let image = |offset: f64| Axis { offset, scale: 0.5 * size };
        Volume {
            lon: Axis {
                offset: target.lon_deg(),
                scale: radius_m / (degree_m * target.lat_deg().to_radians().cos()),
            },
            lat: Axis { offset: target.lat_deg(), scale: radius_m / degree_m },
            height,
            col: image(self.center.col),
            row: image(self.center.row),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLACE: Point<Geodetic> = Point::new(5.5, 43.3, 150.0);

    #[test]
    fn the_fitted_rpc_agrees_with_the_scanner_to_a_thousandth_of_a_pixel() {
        for view in acquisitions(KeyedRng::new(0), Calendar::Mild, 10, PLACE) {
            let scanner = LineScanner::new(PLACE, &view, 400, 0.5);
            let height = Axis { offset: 160.0, scale: 80.0 };
            let rpc = scanner.rpc(PLACE, height).unwrap();
            let volume = scanner.volume(PLACE, height);
            let node = |i: usize| (i as f64 - 8.0) / 8.0;
            let worst = (0..17 * 17 * 17)
                .map(|i| volume.ground([node(i % 17), node(i / 17 % 17), node(i / 289)]))
                .map(|p| rpc.project(p).distance(scanner.project(p)))
                .fold(0.0, f64::max);
            assert!(worst < 1e-3, "{}: {worst}", view.name);
        }
    }

    #[test]
    fn lines_of_sight_have_the_planned_direction() {
        let view = &acquisitions(KeyedRng::new(0), Calendar::Mild, 10, PLACE)[6];
        let scanner = LineScanner::new(PLACE, view, 400, 0.5);
        let rpc = scanner.rpc(PLACE, Axis { offset: 160.0, scale: 80.0 }).unwrap();
        let px = Pixel::new(199.5, 199.5);
        let low = ecef_from_geodetic(rpc.localize(px, 150.0).unwrap());
        let high = ecef_from_geodetic(rpc.localize(px, 200.0).unwrap());
        let up = (high - low).normalize().dot(&local_axes(PLACE).up);
        assert!((up.acos().to_degrees() - view.off_nadir_deg).abs() < 1e-2);
        assert!((low - ecef_from_geodetic(PLACE)).norm() < 0.01);
    }

    #[test]
    fn suns_and_directions_are_in_realistic_ranges() {
        for view in acquisitions(KeyedRng::new(0), Calendar::Mild, 16, PLACE) {
            assert!((5.0..=30.0).contains(&view.off_nadir_deg), "{view:?}");
            assert!((33.0..=72.0).contains(&view.sun.elevation_deg), "{view:?}");
            assert!((105.0..=168.0).contains(&view.sun.azimuth_deg), "{view:?}");
        }
    }

    #[test]
    fn held_out_images_are_taken_on_days_and_from_directions_between_the_others() {
        let calendar = Calendar::Seasons;
        let training = acquisitions(KeyedRng::new(0), calendar, 12, PLACE);
        let days: Vec<u32> = training.iter().map(|v| v.day_of_year).collect();
        for view in held_out(KeyedRng::new(1), calendar, &training, 11, PLACE) {
            assert!(!days.contains(&view.day_of_year), "{view:?}");
            assert!(days.iter().any(|d| *d < view.day_of_year) && days.iter().any(|d| *d > view.day_of_year));
            let axes = local_axes(PLACE);
            let direction = |v: &Acquisition| axes.direction(v.azimuth_deg, 90.0 - v.off_nadir_deg);
            let nearest = training.iter().map(|t| direction(t).angle(&direction(&view)).to_degrees());
            let nearest = nearest.fold(f64::INFINITY, f64::min);
            assert!((1.0..15.0).contains(&nearest), "{nearest}° {view:?}");
        }
        assert_eq!(positions_between(3, 2), [0.5, 1.5]);
        assert_eq!(positions_between(3, 3), [0.5, 1.0 + 1.0 / 3.0, 1.0 + 2.0 / 3.0]);
    }
}
