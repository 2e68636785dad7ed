//! A soft prior of points' heights from an elevation model: tie points leave the height of the whole scene open, and
//! this holds it.
//!
//! The loss is Cauchy's with the scale of one standard deviation: roofs and trees that stand above the model count
//! little. The model is looked up once before every search, as its slope is nothing beside its error.

use super::problem::{Block, Track};
use crate::scene::Dem;

/// An elevation model and how sure it is.
#[derive(Clone, Debug)]
pub struct HeightPrior {
    /// The model.
    pub dem: Dem,
    /// Standard deviation of its heights, metres.
    pub sigma_m: f64,
}

impl HeightPrior {
    /// The prior for points where they are now; ground control has better heights of its own.
    #[must_use]
    pub fn at(&self, block: &Block, points: &[[f64; 3]]) -> PointHeights {
        let of_track = |(track, point): (&Track, &[f64; 3])| {
            let place = block.geodetic(*point);
            let up_m = block.local(place.at_height(self.dem.height_m(place)))[2];
            // Points that hang on faint observations would go where the model is and hold nothing.
            let weight = track.observations.iter().map(|m| m.weight).fold(0.0, f64::max);
            (track.prior.is_none() && up_m.is_finite()).then_some((up_m, weight))
        };
        let of_points = block.tracks.iter().zip(points).map(of_track).collect();
        PointHeights { sigma_m: self.sigma_m, of_points }
    }
}

/// The model's height at each point.
#[derive(Clone, Debug)]
pub struct PointHeights {
    sigma_m: f64,
    /// Metres up of the centre, and how much the point counts; none where the model has no height.
    of_points: Vec<Option<(f64, f64)>>,
}

impl PointHeights {
    /// Height of the model over a point, metres, and the weight of this residual.
    #[must_use]
    pub fn residual_and_weight(&self, track: usize, point: [f64; 3]) -> Option<(f64, f64)> {
        let (up_m, weight) = self.of_points[track]?;
        let residual = up_m - point[2];
        Some((residual, weight / (self.sigma_m * self.sigma_m + residual * residual)))
    }

    /// The robust cost of a point's height.
    #[must_use]
    pub fn cost(&self, track: usize, point: [f64; 3]) -> f64 {
        let of =
            |(up_m, weight): (f64, f64)| 0.5 * weight * ((up_m - point[2]) / self.sigma_m).powi(2).ln_1p();
        self.of_points[track].map_or(0.0, of)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pull_is_the_slope_of_the_cost() {
        let prior = PointHeights { sigma_m: 3.0, of_points: vec![Some((10.0, 0.7)), None] };
        let step = 1e-5;
        for up in [-40.0, 8.0, 10.0, 12.5] {
            let cost = |up: f64| prior.cost(0, [0.0, 0.0, up]);
            let slope = (cost(up + step) - cost(up - step)) / (2.0 * step);
            let (residual, weight) = prior.residual_and_weight(0, [0.0, 0.0, up]).unwrap();
            assert!((slope + weight * residual).abs() < 1e-8, "{slope}");
        }
        assert_eq!((prior.residual_and_weight(1, [0.0; 3]), prior.cost(1, [0.0; 3])), (None, 0.0));
    }
}
