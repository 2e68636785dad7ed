//! Heights of an elevation model at the points of an adjustment, as priors with a Cauchy loss.

/// Height of the elevation model at each point.
#[derive(Clone, Debug)]
pub struct PointHeights {
    /// Standard deviation of the heights, metres.
    pub(super) sigma_m: f64,
    /// Metres above the centre, and the weight of the point; none where the model has no height.
    pub(super) of_points: Vec<Option<(f64, f64)>>,
}

impl PointHeights {
    /// Height of the model above a point, metres, and the weight of this residual.
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
