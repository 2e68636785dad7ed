//! The translation that brings a scene to surveyed points.

use super::error::CoregisterError;
use super::shift::{Coregistration, Shift};
use crate::frame::{Geodetic, Point, SiteGrid};
use crate::metrics::MEDIAN_TO_MEAN;
use crate::stats::{FitQuality, MAD_TO_SIGMA, interpolated_quantile};
use std::path::Path;

/// Surveyed points that are farther from the median shift than this multiple of the median distance, or of the least error
/// of a point in satellite images, are named and left out; if half of the points are that far from it, they are refused.
const MOST_TIMES: f64 = 10.0;
const LEAST_ERROR_M: f64 = 0.5;
/// Unknowns of a shift.
const UNKNOWNS: usize = 3;

/// The translation between pairs of (triangulated, surveyed) positions with their names: the median along each axis of the
/// map. `stated_m` is the standard deviation that the survey states.
///
/// # Errors
/// [`CoregisterError::NoControl`] without any, [`CoregisterError::ControlDisagrees`] if half of them are wrong.
pub fn to_control(
    pairs: &[(String, [Point<Geodetic>; 2])],
    stated_m: f64,
    map: &SiteGrid,
    reference: &Path,
) -> Result<Coregistration, CoregisterError> {
    if pairs.is_empty() {
        return Err(CoregisterError::NoControl { reference: reference.into() });
    }
    let off: Vec<[f64; 3]> = pairs
        .iter()
        .map(|(_, [ours, exact])| (map.utm_from_geodetic(*exact) - map.utm_from_geodetic(*ours)).xyz())
        .collect();
    let median = |of: &dyn Fn(&[f64; 3]) -> f64| {
        interpolated_quantile(&off.iter().map(|d| of(d) as f32).collect::<Vec<_>>(), 0.5)
    };
    let [east_m, north_m, up_m] = [0, 1, 2].map(|k| median(&|d| d[k]));
    let shift = Shift { east_m, north_m, up_m };
    let distance = |d: &[f64; 3]| d.iter().zip(shift.enu()).map(|(d, s)| (d - s).powi(2)).sum::<f64>().sqrt();
    let left_m = median(&distance);
    let error_m = stated_m.max(LEAST_ERROR_M);
    let limit_m = MOST_TIMES * left_m.max(error_m);
    let named =
        pairs.iter().zip(&off).map(|((name, _), d)| (name.as_str(), distance(d), distance(d) <= limit_m));
    let quality = FitQuality::of(named, UNKNOWNS);
    if left_m > MOST_TIMES * error_m {
        return Err(CoregisterError::ControlDisagrees { reference: reference.into(), left_m, quality });
    }
    // Of one or two points the scatter says nothing, but the survey does.
    let of_mean = MEDIAN_TO_MEAN / (quality.points as f64).sqrt();
    let sigma_m = [0, 1, 2].map(|k| {
        let scatter = MAD_TO_SIGMA * median(&|d| (d[k] - shift.enu()[k]).abs());
        Some(of_mean * scatter.max(stated_m))
    });
    let points = quality.points;
    Ok(Coregistration { shift, points, left_m, sigma_m, directions: 2, fit: Some(quality) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Utm;

    #[test]
    fn a_wrong_surveyed_point_does_not_change_the_median() {
        let map = SiteGrid::at(Point::new(5.44, 43.26, 100.0)).unwrap();
        let pair = |dx: f64| {
            let ours = Point::<Utm>::new(map.origin.x() + 10.0 * dx, map.origin.y(), 90.0);
            let exact = Point::new(ours.x() + dx, ours.y() - 2.0, 93.0);
            (format!("line {dx}"), [map.geodetic_from_utm(ours), map.geodetic_from_utm(exact)])
        };
        let file = Path::new("gcps.csv");
        let found = to_control(&[pair(1.0), pair(1.1), pair(50.0)], 0.1, &map, file).unwrap();
        let fit = found.fit.as_ref().unwrap();
        assert_eq!((fit.points, fit.redundancy, fit.left_out[0].0.as_str()), (2, 3, "line 50"));
        let apart = to_control(&[pair(1.0), pair(90.0)], 0.1, &map, file);
        assert!(matches!(apart, Err(CoregisterError::ControlDisagrees { .. })), "{apart:?}");
        for (f, s) in found.shift.enu().iter().zip([1.1, -2.0, 3.0]) {
            assert!((f - s).abs() < 1e-3, "{found:?}");
        }
        assert!(matches!(to_control(&[], 0.1, &map, file), Err(CoregisterError::NoControl { .. })));
    }
}
