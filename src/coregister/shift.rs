//! A translation on a map, and what is left after it.

use crate::frame::{Geodetic, Point, SiteGrid};
use crate::stats::FitQuality;
use serde::{Deserialize, Serialize};

/// Translation of a scene on its map, metres.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Shift {
    /// To the east, metres.
    pub east_m: f64,
    /// To the north, metres.
    pub north_m: f64,
    /// Upwards, metres.
    pub up_m: f64,
}

impl Shift {
    /// The components east, north and up, metres.
    #[must_use]
    pub fn enu(&self) -> [f64; 3] {
        [self.east_m, self.north_m, self.up_m]
    }

    /// Its length, metres.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        self.enu().iter().map(|v| v * v).sum::<f64>().sqrt()
    }

    /// This translation applied after another one.
    #[must_use]
    pub fn after(&self, first: &Self) -> Self {
        Self {
            east_m: self.east_m + first.east_m,
            north_m: self.north_m + first.north_m,
            up_m: self.up_m + first.up_m,
        }
    }

    /// The translation at a place as a step in degrees of longitude, degrees of latitude and metres of height. Over 50
    /// km, the same step in degrees differs from that in metres by less than a centimetre for a translation of 10 m.
    #[must_use]
    pub fn on_ground(&self, map: &SiteGrid, at: Point<Geodetic>) -> [f64; 3] {
        let here = map.utm_from_geodetic(at);
        let there = Point::new(here.x() + self.east_m, here.y() + self.north_m, here.z());
        let there = map.geodetic_from_utm(there);
        [there.lon_deg() - at.lon_deg(), there.lat_deg() - at.lat_deg(), self.up_m]
    }
}

/// A translation and the differences that remain.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Coregistration {
    /// The translation to apply to the scene.
    pub shift: Shift,
    /// Number of compared points.
    pub points: usize,
    /// Median absolute difference after the translation, metres: of heights, or of positions of surveyed points.
    pub left_m: f64,
    /// Standard deviations of east, north and up, metres; none where nothing determines it.
    #[serde(default)]
    pub sigma_m: [Option<f64>; 3],
    /// Number of horizontal directions that are determined, 0 to 2. The shift has no part in others.
    #[serde(default)]
    pub directions: usize,
    /// Of surveyed points, how they agree with the shift.
    #[serde(default)]
    pub fit: Option<FitQuality>,
}

impl Coregistration {
    /// The standard deviations for a message.
    #[must_use]
    pub fn sigma_text(&self) -> String {
        let [east, north, up] =
            self.sigma_m.map(|s| s.map_or_else(|| "not determined".to_owned(), |s| format!("{s:.3} m")));
        format!("standard deviations: east {east}, north {north}, up {up}")
    }

    /// What is not moved because nothing determines it; none if all is determined.
    #[must_use]
    pub fn open_text(&self) -> Option<String> {
        let what = match self.directions {
            0 => "the horizontal shift is not determined, only the height is moved",
            1 => "the horizontal shift is determined in one direction, and moved in that alone",
            _ => return None,
        };
        Some(format!("{what} ({}): a reference with buildings or more relief would tell", self.sigma_text()))
    }
}
