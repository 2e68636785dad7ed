//! Priors of the points' heights from an elevation model, which determine the height of the scene that tie points leave
//! open.
//!
//! The loss is the Cauchy loss with a scale of one standard deviation, so that roofs and trees above the model have
//! little weight. The heights of the model are looked up once before every solution, because its slope is negligible.

use super::point_heights::PointHeights;
use super::problem::{Block, Track};
use crate::scene::Dem;

/// An elevation model and its accuracy.
#[derive(Clone, Debug)]
pub struct HeightPrior {
    /// The elevation model.
    pub dem: Dem,
    /// Standard deviation of its heights, metres.
    pub sigma_m: f64,
}

impl HeightPrior {
    /// The priors of points at their present positions; points of ground control have none.
    #[must_use]
    pub fn at(&self, block: &Block, points: &[[f64; 3]]) -> PointHeights {
        let of_track = |(track, point): (&Track, &[f64; 3])| {
            let place = block.geodetic(*point);
            let up_m = block.local(place.at_height(self.dem.height_m(place)))[2];
            // Points with weak observations only would follow the model without determining the scene's height.
            let weight = track.observations.iter().map(|m| m.weight).fold(0.0, f64::max);
            (track.prior.is_none() && up_m.is_finite()).then_some((up_m, weight))
        };
        let of_points = block.tracks.iter().zip(points).map(of_track).collect();
        PointHeights { sigma_m: self.sigma_m, of_points }
    }
}
