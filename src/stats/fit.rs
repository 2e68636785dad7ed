//! What every fit to points says about itself.

use serde::{Deserialize, Serialize};
use std::fmt;

/// Names that a sentence about points that were left out lists.
const LISTED: usize = 5;

/// How well points agree with what was fitted to them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FitQuality {
    /// Number of points that were fitted.
    pub points: usize,
    /// Number of measurements beyond those that the unknowns need: without any nothing checks the fit.
    pub redundancy: usize,
    /// Root mean square distance of the points from the fit, metres.
    pub rms_m: f64,
    /// Of the fitted points the one farthest from the fit, and its distance, metres.
    pub worst: Option<(String, f64)>,
    /// Points that disagree with the others and were left out, and their distances, metres; the farthest first.
    pub left_out: Vec<(String, f64)>,
}

impl FitQuality {
    /// The quality of a fit with some unknowns to points of three coordinates, from each point's name, its distance from
    /// the fit in metres and whether it was fitted.
    #[must_use]
    pub fn of<'a>(points: impl Iterator<Item = (&'a str, f64, bool)>, unknowns: usize) -> Self {
        let mut out = Self::default();
        let mut squares = 0.0;
        for (name, distance_m, is_fitted) in points {
            if !is_fitted {
                out.left_out.push((name.into(), distance_m));
                continue;
            }
            out.points += 1;
            squares += distance_m * distance_m;
            if out.worst.as_ref().is_none_or(|(_, worst_m)| distance_m > *worst_m) {
                out.worst = Some((name.into(), distance_m));
            }
        }
        out.redundancy = (3 * out.points).saturating_sub(unknowns);
        out.rms_m = if out.points > 0 { (squares / out.points as f64).sqrt() } else { 0.0 };
        out.left_out.sort_by(|a, b| b.1.total_cmp(&a.1));
        out
    }

    /// The points that were left out, for a message; none if there are none.
    #[must_use]
    pub fn left_out_text(&self) -> Option<String> {
        let named = |(name, distance_m): &(String, f64)| format!("`{name}` ({})", length(*distance_m));
        let first: Vec<String> = self.left_out.iter().take(LISTED).map(named).collect();
        let more = self.left_out.len().saturating_sub(LISTED);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        (!first.is_empty()).then(|| format!("{}{more}", first.join(", ")))
    }
}

impl fmt::Display for FitQuality {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Self { points, redundancy, rms_m, .. } = self;
        write!(f, "{points} points, redundancy {redundancy}, RMS {}", length(*rms_m))?;
        match &self.worst {
            Some((name, distance_m)) => write!(f, ", worst `{name}` {}", length(*distance_m)),
            None => Ok(()),
        }
    }
}

/// A length with the digits that tell something.
fn length(metres: f64) -> String {
    match metres {
        m if m < 0.1 => format!("{m:.3} m"),
        m if m < 1e4 => format!("{m:.2} m"),
        m => format!("{:.0} km", m / 1e3),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fit_names_its_worst_point_and_those_left_out() {
        let points =
            [("a", 0.3, true), ("b", 0.4, true), ("c", 0.0, true), ("d", 2e6, false), ("e", 7.0, false)];
        let fit = FitQuality::of(points.into_iter(), 7);
        assert_eq!(fit.to_string(), "3 points, redundancy 2, RMS 0.29 m, worst `b` 0.40 m");
        assert_eq!(fit.left_out_text().unwrap(), "`d` (2000 km), `e` (7.00 m)");
        assert_eq!(FitQuality::of([("a", 0.0, true)].into_iter(), 3).redundancy, 0);
    }
}
