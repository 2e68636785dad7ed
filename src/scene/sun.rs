//! Position of the sun at a time and place, by the low-precision formulas of the Astronomical Almanac.
//!
//! The error is below 0.01° between 1950 and 2050, without refraction. That suffices to detect that a date, a place and a
//! sun direction contradict each other.

use super::Sun;
use crate::frame::{Geodetic, Point};

impl Sun {
    /// The direction of the sun at a place and a UTC time `YYYY-MM-DDThh:mm:ssZ`; `None` without a time of day.
    #[must_use]
    pub fn at(time: &str, place: Point<Geodetic>) -> Option<Self> {
        Some(Self::at_day(days_since_2000(time)?, place))
    }

    /// The direction of the sun at a place, so many days after 1 January 2000, 12 h UTC.
    #[must_use]
    pub fn at_day(days: f64, place: Point<Geodetic>) -> Self {
        let mean_longitude = 280.460 + 0.985_647_4 * days;
        let anomaly = (357.528 + 0.985_600_3 * days).to_radians();
        let longitude = (mean_longitude + 1.915 * anomaly.sin() + 0.020 * (2.0 * anomaly).sin()).to_radians();
        let obliquity = (23.439 - 4e-7 * days).to_radians();
        let ascension = (obliquity.cos() * longitude.sin()).atan2(longitude.cos());
        let declination = (obliquity.sin() * longitude.sin()).asin();
        let sidereal_deg = 280.460_618_37 + 360.985_647_366_29 * days;
        let hour = (sidereal_deg + place.lon_deg()).to_radians() - ascension;
        let lat = place.lat_deg().to_radians();
        let up = lat.sin() * declination.sin() + lat.cos() * declination.cos() * hour.cos();
        let east = -declination.cos() * hour.sin();
        let north = lat.cos() * declination.sin() - lat.sin() * declination.cos() * hour.cos();
        Self {
            azimuth_deg: east.atan2(north).to_degrees().rem_euclid(360.0),
            elevation_deg: up.clamp(-1.0, 1.0).asin().to_degrees(),
        }
    }

    /// Angle between two directions to the sun, degrees.
    #[must_use]
    pub fn angle_to_deg(self, other: Self) -> f64 {
        super::angle_between_deg(
            (self.azimuth_deg, 90.0 - self.elevation_deg),
            (other.azimuth_deg, 90.0 - other.elevation_deg),
        )
    }
}

/// Days since 1 January 2000, 12 h UTC, of an ISO 8601 time.
pub(super) fn days_since_2000(time: &str) -> Option<f64> {
    let part = |from: usize, to: usize| time.get(from..to)?.parse::<i64>().ok();
    let (year, month, day) = (part(0, 4)?, part(5, 7)?, part(8, 10)?);
    let seconds = part(11, 13)? * 3600 + part(14, 16)? * 60 + part(17, 19)?;
    // Julian day number after Fliegel and Van Flandern (1968).
    let a = (month - 14) / 12;
    let julian = (1461 * (year + 4800 + a)) / 4 + (367 * (month - 2 - 12 * a)) / 12
        - (3 * ((year + 4900 + a) / 100)) / 4
        + day
        - 32_075;
    Some((julian - 2_451_545) as f64 + seconds as f64 / 86_400.0 - 0.5)
}

/// Days since 1 January 2000, 12 h UTC, of an ISO 8601 time, or of noon of a date.
#[must_use]
pub fn days_of(time: &str) -> Option<f64> {
    days_since_2000(time).or_else(|| days_since_2000(&format!("{}T12:00:00Z", time.get(..10)?)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The expected angles are those that Maxar delivered with the image (views.csv of JAX_068).
    #[test]
    fn the_sun_agrees_with_the_metadata_of_maxar() {
        let place = Point::new(-81.6637, 30.3487, 0.0);
        let stated = Sun { azimuth_deg: 150.3, elevation_deg: 50.8 };
        let ours = Sun::at("2014-10-05T16:01:38Z", place).unwrap();
        assert!(ours.angle_to_deg(stated) < 0.3, "{ours:?}");
        assert!(Sun::at("2014-10-05", place).is_none());
        assert!(Sun::at("2014-10-05T04:00:00Z", place).unwrap().elevation_deg < -30.0);
    }

    #[test]
    fn the_epoch_is_noon_on_1_january_2000() {
        assert_eq!(days_since_2000("2000-01-01T12:00:00Z"), Some(0.0));
        assert_eq!(days_since_2000("2001-01-01T00:00:00Z"), Some(365.5));
        assert_eq!(days_of("2000-01-02"), Some(1.0));
    }
}
