//! The heights between which a surface is searched, and their source.

use serde::{Deserialize, Serialize};
use std::fmt;

/// Depth below the lowest and height above the highest tie point that is searched where the metadata allow more, metres:
/// pits and quarries, towers and skyscrapers may have no tie point. The validity range of an RPC says little about the
/// ground: usual are 1,000 m for any place, and 18 km occur.
const BELOW_TIE_POINTS_M: f64 = 100.0;
const ABOVE_TIE_POINTS_M: f64 = 200.0;
/// Depth below and height above tie points that is searched in any case, metres: the metadata may be those of an elevation
/// model without buildings.
const LEAST_BELOW_M: f64 = 5.0;
const LEAST_ABOVE_M: f64 = 15.0;

/// Source of a range of heights, in the order of precedence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeightSource {
    /// The option `--height-range`.
    Option,
    /// An elevation model.
    ElevationModel,
    /// The metadata of the views.
    Metadata,
    /// The validity ranges of the RPCs.
    Rpcs,
    /// The tie points, because the range of the metadata or of the RPCs goes far beyond them.
    TiePoints,
}

/// A range of ellipsoidal heights that is searched for the surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SearchedHeights {
    /// Lowest height, metres.
    pub low_m: f64,
    /// Highest height, metres.
    pub high_m: f64,
    /// Its source.
    pub source: HeightSource,
}

impl SearchedHeights {
    /// The range in which the surface is searched once tie points are known, of which the lowest and highest height are given.
    ///
    /// The option always bounds the search. Otherwise it includes all tie points, and ends far from them.
    #[must_use]
    pub fn with_tie_points(self, (lowest_m, highest_m): (f64, f64)) -> Self {
        if self.source == HeightSource::Option {
            return self;
        }
        let low_m = self.low_m.min(lowest_m - LEAST_BELOW_M);
        let high_m = self.high_m.max(highest_m + LEAST_ABOVE_M);
        if self.source == HeightSource::ElevationModel {
            return Self { low_m, high_m, ..self };
        }
        let near = (lowest_m - BELOW_TIE_POINTS_M, highest_m + ABOVE_TIE_POINTS_M);
        let is_wide = low_m < near.0 || high_m > near.1;
        let source = if is_wide { HeightSource::TiePoints } else { self.source };
        Self { low_m: low_m.max(near.0), high_m: high_m.min(near.1), source }
    }

    /// Whether the user states the range, by an option or an elevation model.
    #[must_use]
    pub fn is_stated(self) -> bool {
        matches!(self.source, HeightSource::Option | HeightSource::ElevationModel)
    }

    /// Lowest and highest height, metres.
    #[must_use]
    pub fn range(self) -> (f64, f64) {
        (self.low_m, self.high_m)
    }
}

impl fmt::Display for SearchedHeights {
    /// As `100 to 230 m, from the RPCs`.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Self { low_m, high_m, source } = self;
        write!(f, "{low_m:.0} to {high_m:.0} m, ")?;
        match source {
            HeightSource::Option => write!(f, "from --height-range"),
            HeightSource::ElevationModel => write!(f, "from --dem"),
            HeightSource::Metadata => write!(f, "from the metadata of the images"),
            HeightSource::Rpcs => write!(f, "from the RPCs"),
            HeightSource::TiePoints => write!(
                f,
                "at most {BELOW_TIE_POINTS_M} m below and {ABOVE_TIE_POINTS_M} m above the tie points, because the \
                 metadata state a wider range"
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heights(low_m: f64, high_m: f64, source: HeightSource) -> SearchedHeights {
        SearchedHeights { low_m, high_m, source }
    }

    #[test]
    fn an_option_bounds_the_search_and_other_ranges_include_the_tie_points_and_end_far_from_them() {
        use HeightSource::{ElevationModel, Metadata, Option, Rpcs, TiePoints};
        let with = |low, high, source| heights(low, high, source).with_tie_points((140.0, 170.0));
        assert_eq!(with(150.0, 160.0, Option), heights(150.0, 160.0, Option));
        assert_eq!(with(-9000.0, 9000.0, Option), heights(-9000.0, 9000.0, Option));
        assert_eq!(with(150.0, 230.0, ElevationModel), heights(135.0, 230.0, ElevationModel));
        assert_eq!(with(150.0, 160.0, Metadata), heights(135.0, 185.0, Metadata));
        assert_eq!(with(100.0, 230.0, Rpcs), heights(100.0, 230.0, Rpcs));
        assert_eq!(with(-9000.0, 9000.0, Rpcs), heights(40.0, 370.0, TiePoints));
        assert_eq!(with(-350.0, 200.0, Rpcs), heights(40.0, 200.0, TiePoints));
    }

    #[test]
    fn the_text_says_what_a_range_is_from() {
        assert_eq!(heights(100.2, 229.8, HeightSource::Rpcs).to_string(), "100 to 230 m, from the RPCs");
        assert!(
            heights(0.0, 1.0, HeightSource::TiePoints).to_string().contains("200 m above the tie points")
        );
    }
}
