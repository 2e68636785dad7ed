//! What the size of a shift between two data sets says about their datums.

use crate::coregister::Shift;
use crate::frame::{Geodetic, Point};
use crate::io::GeoidDifference;
use crate::progress::{Event, Progress};

/// Horizontal shifts above this are no error of delivered cameras, metres: those of present satellites point to 10 m, of old ones to
/// 30 m.
const MOST_POINTING_M: f64 = 30.0;

/// Warns of a shift at a place that another datum explains better than the cameras do. `what` is what asks for the shift.
pub fn warn_of_shift(what: &str, shift: &Shift, at: Point<Geodetic>, progress: &dyn Progress) {
    if let Some(GeoidDifference { geoid_m, is_near: true }) =
        GeoidDifference::at(at.lon_deg(), at.lat_deg(), shift.up_m)
    {
        progress.event(Event::Warning(format!(
            "{what} moves the cameras by {:+.1} m up, about the height of the geoid here ({geoid_m:+.1} m): are its heights above the \
             sea? Heights above the WGS 84 ellipsoid are expected",
            shift.up_m
        )));
    }
    let horizontal_m = shift.east_m.hypot(shift.north_m);
    if horizontal_m > MOST_POINTING_M {
        progress.event(Event::Warning(format!(
            "{what} moves the cameras by {:+.0} m east and {:+.0} m north, more than cameras of satellites are off: are datum, map and \
             zone those that are stated?",
            shift.east_m, shift.north_m
        )));
    }
}
