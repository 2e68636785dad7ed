//! Dates and times of acquisitions, and the sun at them.

use super::error::SimulateError;
use super::geodesy::{PLACE, sun_at};
use super::keyed_rng::KeyedRng;
use crate::frame::{Geodetic, Point};
use crate::rpc::formats::iso_date;
use crate::scene::Sun;

/// Lowest elevation of the sun in an image, degrees. Farther shadows would reach beyond the margin of the town.
pub(super) const LOWEST_SUN_DEG: f64 = 33.0;
/// First minute of the day at which an image is taken, UTC: the satellite passes in the late morning.
const FIRST_MINUTE: u32 = 9 * 60 + 35;
/// Length of the span of time in which images are taken, minutes.
const MINUTES: f64 = 75.0;
/// A minute, UTC, when the sun has culminated on any day.
const AFTER_NOON_MINUTE: u32 = 12 * 60;
/// Minutes in which the sun moves by a degree, and minutes of a day.
const MINUTES_PER_DEGREE: f64 = 4.0;
const DAY_MINUTES: i64 = 24 * 60;
const YEAR_DAYS: u32 = 365;
/// Days of the months of a year that is no leap year.
const MONTHS: [u32; 12] = [31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];

/// The day of the year with the season in the northern hemisphere that a day has at a place, and the reverse, to a day.
pub(super) fn season_day(day_of_year: u32, place: Point<Geodetic>) -> u32 {
    if place.lat_deg() >= 0.0 { day_of_year } else { (day_of_year + YEAR_DAYS / 2 - 1) % YEAR_DAYS + 1 }
}

/// How the images are distributed over the year.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Calendar {
    /// March to October of one year.
    Mild,
    /// The four seasons of three years in equal shares. Winter begins in February, when the sun is high enough at noon.
    Seasons,
}

/// Time of an acquisition, and the sun at that time.
pub(super) struct Moment {
    pub(super) day_of_year: u32,
    pub(super) sun: Sun,
    /// ISO 8601 in UTC.
    pub(super) acquired: String,
}

impl Moment {
    /// A time that a user plans, in any of the formats that [`iso_date`] reads.
    pub(super) fn at(time: &str, place: Point<Geodetic>) -> Result<Self, SimulateError> {
        // Seconds may be left out.
        let whole = format!("{}:00", time.trim().trim_end_matches(['Z', 'z']));
        let acquired = [time, &whole].into_iter().filter_map(iso_date).find(|iso| iso.contains('T'));
        let acquired = acquired.ok_or_else(|| SimulateError::Time { found: time.to_owned() })?;
        let number =
            |from: usize, to: usize| acquired.get(from..to).and_then(|t| t.parse::<u32>().ok()).unwrap_or(0);
        let months = MONTHS.iter().take(number(5, 7).saturating_sub(1) as usize);
        let day_of_year = months.sum::<u32>() + number(8, 10);
        let hours =
            f64::from(number(11, 13)) + f64::from(number(14, 16)) / 60.0 + f64::from(number(17, 19)) / 3600.0;
        let sun = sun_at(day_of_year, hours, place);
        Ok(Self { day_of_year, sun, acquired })
    }
}

impl Calendar {
    /// The day of the year at a fraction, from 0 to 1, of the images in the order of their days.
    pub(super) fn day(self, fraction: f64) -> u32 {
        /// First days of winter, spring, summer, autumn; last day of autumn: the sun rises 33 degrees high on all of them.
        const SEASONS: [f64; 5] = [46.0, 78.0, 150.0, 235.0, 300.0];
        match self {
            // March to October; in winter the sun is too low for good images.
            Self::Mild => 66 + (fraction * 215.0) as u32,
            Self::Seasons => {
                let season = ((4.0 * fraction) as usize).min(3);
                let (from, to) = (SEASONS[season], SEASONS[season + 1]);
                (from + (4.0 * fraction - season as f64) * (to - from)) as u32
            }
        }
    }

    /// The year of an image; none of them is a leap year.
    fn year(self, index: usize) -> usize {
        match self {
            Self::Mild => 2023,
            Self::Seasons => 2021 + index % 3,
        }
    }

    /// The time at which an image is taken on a day: in the late morning, or as much later as the sun needs to be high enough.
    pub(super) fn moment(self, index: usize, day: u32, rng: KeyedRng, place: Point<Geodetic>) -> Moment {
        // The minutes are those of the town; elsewhere the sun is as high at other ones.
        let later = ((PLACE.lon_deg() - place.lon_deg()) * MINUTES_PER_DEGREE).round() as i64;
        let mut minute = i64::from(FIRST_MINUTE) + later + (rng.key(3).uniform() * MINUTES) as i64;
        let second = (rng.key(4).uniform() * 60.0) as u32;
        let sun = |minute: i64| sun_at(day, (minute as f64 + f64::from(second) / 60.0) / 60.0, place);
        while sun(minute).elevation_deg < LOWEST_SUN_DEG && minute < i64::from(AFTER_NOON_MINUTE) + later {
            minute += 1;
        }
        // The day in UTC may be the one before or after.
        let utc_day =
            (i64::from(day) + minute.div_euclid(DAY_MINUTES) - 1).rem_euclid(i64::from(YEAR_DAYS)) + 1;
        let (month, day_of_month) = month_and_day(utc_day as u32);
        let minute_of_day = minute.rem_euclid(DAY_MINUTES);
        let (year, hour, minute_of_hour) = (self.year(index), minute_of_day / 60, minute_of_day % 60);
        Moment {
            day_of_year: day,
            sun: sun(minute),
            acquired: format!(
                "{year}-{month:02}-{day_of_month:02}T{hour:02}:{minute_of_hour:02}:{second:02}Z"
            ),
        }
    }
}

fn month_and_day(day_of_year: u32) -> (u32, u32) {
    let mut day = day_of_year;
    for (month, length) in (1..).zip(MONTHS) {
        if day <= length {
            return (month, day);
        }
        day -= length;
    }
    (12, 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sun_is_high_enough_on_every_day_of_the_calendar() {
        let place = Point::new(5.5, 43.3, 150.0);
        for calendar in [Calendar::Mild, Calendar::Seasons] {
            for i in 0..=100 {
                let day = calendar.day(f64::from(i) / 100.0);
                let moment = calendar.moment(0, day, KeyedRng::new(i as u64), place);
                assert!(
                    moment.sun.elevation_deg >= LOWEST_SUN_DEG,
                    "{calendar:?} day {day}: {:?}",
                    moment.sun
                );
            }
        }
    }
}
