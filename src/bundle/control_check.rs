//! Plausibility of ground control: before the adjustment against the delivered cameras, after it against the residuals.

use super::control::ControlPoint;
use super::error::BundleError;
use super::problem::{Observation, PositionPrior, SIGMA_PX};
use super::report::ControlReport;
use crate::frame::{Geodetic, Point};
use crate::scene::{Scene, View};
use std::path::Path;

/// Largest plausible pointing error of a delivered camera, metres.
const FAR_M: f64 = 1000.0;
/// An observation disagrees when its residual is larger than this, both in standard deviations and in pixels.
const BAD_SIGMAS: f64 = 6.0;
const BAD_PX: f64 = 3.0;
/// Positions may lie this far outside of the image, pixels: they may count from the corner of a pixel, or be rounded.
const EDGE_PX: f64 = 1.0;
/// Mean radius of the Earth, metres.
const EARTH_M: f64 = 6_371_000.0;

/// Refuses observations that cannot be right: of images that are not in the scene, of pixels outside of the image, and
/// of points far from the ground that the delivered camera sees at the pixel.
///
/// # Errors
/// [`BundleError::ControlPlace`] names the file, the line, the distance and the likely cause.
pub fn check_control(path: &Path, control: &[ControlPoint], scene: &Scene) -> Result<(), BundleError> {
    for c in control {
        let refused = |reason: String, cause: &str| BundleError::ControlPlace {
            path: path.into(),
            line: c.line,
            reason,
            cause: cause.into(),
        };
        let view = scene.views.iter().find(|v| c.is_of(v)).ok_or_else(|| {
            refused(
                format!("the image `{}` is not in the scene", c.image),
                "`satgs info SCENE` lists its views by name",
            )
        })?;
        if let Some((width, height)) = view.window.is_none().then_some((view.width, view.height)) {
            let inside = |v: f64, size: usize| (-EDGE_PX..=size as f64 - 1.0 + EDGE_PX).contains(&v);
            if !(inside(c.px.col, width) && inside(c.px.row, height)) {
                return Err(refused(
                    format!(
                        "column {:.1}, row {:.1} is outside of `{}`, {width} x {height} pixels",
                        c.px.col, c.px.row, c.image
                    ),
                    "are the pixels those of another image, of the whole image where this is a crop, or are column and row \
                     swapped?",
                ));
            }
        }
        let Some(seen) = seen_place(view, c, c.place) else { continue };
        let away_m = distance_m(seen, c.place);
        // A comparison that NaN fails too.
        let is_near = away_m <= FAR_M;
        if !is_near {
            let [lon, lat, h] = c.place.xyz();
            let is_swapped =
                lat.abs() <= 180.0 && lon.abs() <= 90.0 && distance_m(seen, Point::new(lat, lon, h)) <= FAR_M;
            let cause = if is_swapped {
                "lon and lat are swapped: the header names the columns in the order of the file"
            } else {
                "are degrees, datum, sign and image those of this point?"
            };
            return Err(refused(
                format!(
                    "the point lies {} from where `{}` shows column {:.1}, row {:.1}",
                    length(away_m),
                    c.image,
                    c.px.col,
                    c.px.row
                ),
                cause,
            ));
        }
    }
    Ok(())
}

/// Ground position that the delivered camera sees at an observation's pixel, at the height of the point.
fn seen_place(view: &View, c: &ControlPoint, place: Point<Geodetic>) -> Option<Point<Geodetic>> {
    view.rpc.localize(view.px_of_window(c.px), place.height_m()).ok()
}

/// Distance between two places along a spherical Earth, metres.
fn distance_m(a: Point<Geodetic>, b: Point<Geodetic>) -> f64 {
    let (lat_a, lat_b) = (a.lat_deg().to_radians(), b.lat_deg().to_radians());
    let (d_lat, d_lon) = (lat_b - lat_a, (b.lon_deg() - a.lon_deg()).to_radians());
    let h = (d_lat / 2.0).sin().powi(2) + lat_a.cos() * lat_b.cos() * (d_lon / 2.0).sin().powi(2);
    2.0 * EARTH_M * h.sqrt().min(1.0).asin()
}

fn length(metres: f64) -> String {
    if metres < 10_000.0 { format!("{metres:.0} m") } else { format!("{:.0} km", metres / 1000.0) }
}

/// The report of an observation of a surveyed point after the adjustment.
#[must_use]
pub(super) fn control_report(
    view: &View,
    m: &Observation,
    known: &PositionPrior,
    point: [f64; 3],
    residual_px: f64,
    control: &[ControlPoint],
) -> ControlReport {
    let moved_m: [f64; 3] = std::array::from_fn(|k| point[k] - known.place[k]);
    let sigmas = residual_px * m.weight.sqrt() / SIGMA_PX;
    let is_near = moved_m.iter().zip(known.sigma_m).all(|(d, s)| d.abs() <= BAD_SIGMAS * s);
    let line = control.iter().find(|c| c.is_of(view) && view.px_of_window(c.px) == m.px).map(|c| c.line);
    ControlReport {
        view: view.name.clone(),
        line: line.unwrap_or(0),
        residual_px,
        moved_m,
        agrees: is_near && (sigmas <= BAD_SIGMAS || residual_px <= BAD_PX),
    }
}
