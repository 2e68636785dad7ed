//! What views share on the ground, asked at every height of a range.
//!
//! At a wrong height, footprints of the same place are apart: by 1.7 m for each degree between the lines of sight and 100 m
//! of height. Whoever asks whether two views show the same ground therefore asks here, over all heights that the ground
//! may have.

use super::footprint::footprint;
use crate::frame::SiteGrid;
use crate::rpc::Rpc;
use geo::{Area, BooleanOps, BoundingRect, Intersects, MultiPolygon, Polygon};
use std::cell::OnceCell;

/// Share of both footprints at the middle height from which on other heights are not examined.
const MUCH_SHARED: f64 = 0.5;
/// Number of steps from the lowest to the highest height; height ranges of RPCs are at most a few kilometres.
const STEPS: u32 = 64;

/// Heights of a range in metres that are examined, the lowest first.
pub(super) fn heights_within((low, high): (f64, f64)) -> impl Iterator<Item = f64> {
    (0..=STEPS).map(move |k| low + (high - low) * f64::from(k) / f64::from(STEPS))
}

/// Footprints of views at the heights of a range.
pub struct Footprints<'a> {
    views: Vec<(&'a Rpc, (usize, usize))>,
    grid: &'a SiteGrid,
    heights: (f64, f64),
    /// Of each view, at the middle height, and at all heights as soon as they are needed; none where a camera cannot be
    /// localised.
    middle: Vec<Option<Polygon<f64>>>,
    all: Vec<OnceCell<Vec<Option<Polygon<f64>>>>>,
}

/// The ground that two views share at the height at which it is most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SharedGround {
    /// Ellipsoidal height, metres.
    pub height_m: f64,
    /// Shares of the footprints of the first and of the second view, from 0 to 1.
    pub shares: [f64; 2],
}

impl SharedGround {
    /// The share of the smaller footprint.
    #[must_use]
    pub fn of_smaller(&self) -> f64 {
        self.shares[0].max(self.shares[1])
    }
}

impl<'a> Footprints<'a> {
    /// Footprints of views, given by their camera, columns and rows, between two ellipsoidal heights in metres, on the map of
    /// `grid`.
    #[must_use]
    pub fn new(views: Vec<(&'a Rpc, (usize, usize))>, grid: &'a SiteGrid, heights: (f64, f64)) -> Self {
        let at = 0.5 * (heights.0 + heights.1);
        let middle = views.iter().map(|(rpc, size)| footprint(rpc, *size, grid, at)).collect();
        let all = views.iter().map(|_| OnceCell::new()).collect();
        Self { views, grid, heights, middle, all }
    }

    /// What two views share at the height at which it is most; at the middle height if they share half of both footprints
    /// there. None where no height has both footprints.
    #[must_use]
    pub fn shared(&self, first: usize, second: usize) -> Option<SharedGround> {
        let at_middle = self.shared_at_middle(first, second);
        let (low, high) = self.heights;
        let is_much = at_middle.is_some_and(|s| s.shares.iter().all(|share| *share >= MUCH_SHARED));
        if is_much || low >= high {
            return at_middle;
        }
        let [a, b] = [first, second].map(|view| self.at_all_heights(view));
        let others =
            heights_within(self.heights).zip(a.iter().zip(b)).filter_map(|(h, (a, b))| shared_at(h, a, b));
        at_middle.into_iter().chain(others).reduce(|a, b| if b.of_smaller() > a.of_smaller() { b } else { a })
    }

    /// What two views share at the middle height; none where it lacks one of the footprints.
    #[must_use]
    pub fn shared_at_middle(&self, first: usize, second: usize) -> Option<SharedGround> {
        let (low, high) = self.heights;
        shared_at(0.5 * (low + high), &self.middle[first], &self.middle[second])
    }

    /// The largest share of an area, from 0 to 1, that a view shows at any height.
    #[must_use]
    pub fn share_of(&self, view: usize, area: &MultiPolygon<f64>) -> f64 {
        let share = |outline: &Option<Polygon<f64>>| {
            outline.as_ref().map_or(0.0, |f| f.intersection(area).unsigned_area() / area.unsigned_area())
        };
        let at_middle = share(&self.middle[view]);
        if at_middle >= MUCH_SHARED {
            return at_middle;
        }
        self.at_all_heights(view).iter().map(share).fold(at_middle, f64::max)
    }

    fn at_all_heights(&self, view: usize) -> &[Option<Polygon<f64>>] {
        let (rpc, size) = self.views[view];
        self.all[view].get_or_init(|| {
            heights_within(self.heights).map(|h| footprint(rpc, size, self.grid, h)).collect()
        })
    }
}

/// What two footprints at a height share.
fn shared_at(height_m: f64, a: &Option<Polygon<f64>>, b: &Option<Polygon<f64>>) -> Option<SharedGround> {
    let (a, b) = (a.as_ref()?, b.as_ref()?);
    // Most footprints that share nothing are told apart by their bounding boxes, which is much faster.
    let are_near = a.bounding_rect()?.intersects(&b.bounding_rect()?);
    let shared_m2 = if are_near { a.intersection(b).unsigned_area() } else { 0.0 };
    Some(SharedGround { height_m, shares: [a, b].map(|f| shared_m2 / f.unsigned_area()) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rpc::{Axis, RpcCoefficients};

    /// A camera with pixels of 0.5 m that leans east by `lean` pixels a metre, over ground at 900 m, where both cameras of this
    /// test see the same place.
    fn camera(lean: f64) -> Rpc {
        let linear = |c: [f64; 4]| std::array::from_fn(|i| if i < 4 { c[i] } else { 0.0 });
        Rpc::new(RpcCoefficients {
            col: Axis { offset: 249.5 - 900.0 * lean, scale: 500.0 },
            row: Axis { offset: 249.5, scale: 500.0 },
            lon: Axis { offset: 5.44, scale: 0.0031 },
            lat: Axis { offset: 43.26, scale: 0.00225 },
            height: Axis { offset: 0.0, scale: 1000.0 },
            col_num: linear([0.0, 1.0, 0.0, lean * 1000.0 / 500.0]),
            col_den: linear([1.0, 0.0, 0.0, 0.0]),
            row_num: linear([0.0, 0.0, -1.0, 0.0]),
            row_den: linear([1.0, 0.0, 0.0, 0.0]),
            err_bias_m: None,
            err_rand_m: None,
        })
        .unwrap()
    }

    #[test]
    fn views_of_a_summit_far_above_the_middle_height_share_their_ground() {
        let (a, b) = (camera(0.36), camera(-0.36));
        let grid = SiteGrid::at(a.center()).unwrap();
        let footprints = |heights| Footprints::new(vec![(&a, (500, 500)), (&b, (500, 500))], &grid, heights);
        let at_middle = footprints((0.0, 0.0)).shared(0, 1).unwrap();
        assert_eq!(at_middle.shares, [0.0; 2]);
        let anywhere = footprints((-1000.0, 1000.0)).shared(0, 1).unwrap();
        assert!(anywhere.of_smaller() > 0.9 && (anywhere.height_m - 900.0).abs() < 32.0, "{anywhere:?}");
        let near = footprints((800.0, 1000.0)).shared(0, 1).unwrap();
        assert_eq!(near.height_m, 900.0, "the middle is enough");
        let area = MultiPolygon(vec![footprint(&a, (500, 500), &grid, 900.0).unwrap()]);
        assert!(footprints((0.0, 0.0)).share_of(1, &area) < 0.4);
        assert!(footprints((-1000.0, 1000.0)).share_of(1, &area) > 0.9);
    }
}
