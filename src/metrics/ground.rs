//! Lengths on the ground of steps on the grid of a truth, whose unit may not be the metre and whose axes may be rotated.

use crate::frame::{FrameError, map_step, metres_of_unit, utm_of_map};
use crate::io::MapGrid;

/// Metres east and north of a step on a grid. East and north are those of the prediction's map; if that is not in metres on the
/// ground, those of the UTM zone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct GroundSteps {
    /// Of a unit along x, and of one along y.
    steps: [[f64; 2]; 2],
}

impl GroundSteps {
    /// The steps of a truth's grid at its middle.
    pub fn new(truth: &MapGrid, prediction: &MapGrid) -> Result<Self, FrameError> {
        let middle = |grid: &MapGrid| {
            let p = grid.middle();
            [p.x(), p.y()]
        };
        let is_metric = metres_of_unit(prediction.epsg, middle(prediction))? == 1.0;
        let map = if is_metric { prediction.epsg } else { utm_of_map(prediction.epsg, middle(prediction))? };
        Ok(Self {
            steps: if map == truth.epsg {
                [[1.0, 0.0], [0.0, 1.0]]
            } else {
                map_step(truth.epsg, map, middle(truth))?
            },
        })
    }

    /// Metres of a unit of the grid.
    pub fn unit_m(&self) -> f64 {
        let [[a, b], [c, d]] = self.steps;
        (a * d - b * c).abs().sqrt()
    }

    /// Metres east and north of a step in units of the grid.
    pub fn metres(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|k| x * self.steps[0][k] + y * self.steps[1][k])
    }

    /// Standard deviations east and north, metres, of independent ones along the axes of the grid.
    pub fn sigma_m(&self, sigma: [Option<f64>; 2]) -> [Option<f64>; 2] {
        [0, 1].map(|k| {
            let along = |axis: usize| match (sigma[axis], self.steps[axis][k]) {
                (_, 0.0) => Some(0.0),
                (sigma, step) => Some(sigma? * step),
            };
            Some(along(0)?.hypot(along(1)?))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_of_the_own_map_is_a_metre_and_of_web_mercator_less() {
        let utm =
            MapGrid { epsg: 32631, west: 697_000.0, north: 4_797_000.0, cell: 0.5, width: 200, height: 200 };
        let own = GroundSteps::new(&utm, &utm).unwrap();
        assert_eq!((own.unit_m(), own.metres([3.0, -2.0])), (1.0, [3.0, -2.0]));
        assert_eq!(own.sigma_m([Some(0.5), None]), [Some(0.5), None]);
        let (x, y) = crate::frame::Transform::new(32631, 3857).unwrap().convert(697_050.0, 4_796_950.0);
        let web = MapGrid { epsg: 3857, west: x - 50.0, north: y + 50.0, ..utm };
        let steps = GroundSteps::new(&web, &utm).unwrap();
        assert!((steps.unit_m() - 0.729).abs() < 2e-3, "{steps:?}");
        // Between two maps of which neither has metres, those of the zone.
        assert!((GroundSteps::new(&web, &web).unwrap().unit_m() - steps.unit_m()).abs() < 1e-9);
    }
}
