//! What the views of a scene see together, and whether each shares ground with another one.

use super::footprint::{footprint, ground_seen, views_needed};
use super::shared_ground::{Footprints, SharedGround, heights_within};
use super::{Scene, SceneError, UtmBox, View};
use crate::frame::SiteGrid;
use geo::{Area, BoundingRect, Polygon};

/// Smallest overlap of a view with some other view, in percent of its footprint.
const LEAST_SHARED_PERCENT: f64 = 1.0;
/// Overlap in percent at the middle height above which other heights are not examined.
const MUCH_SHARED_PERCENT: f64 = 50.0;

/// Footprints of the views of a scene at one height, and their overlap.
#[derive(Clone, Debug, PartialEq)]
pub struct Overlap {
    /// EPSG code of the UTM zone.
    pub epsg: u32,
    /// Ellipsoidal height of the footprints, metres.
    pub height_m: f64,
    /// Each view's footprint at that height, square metres.
    pub footprint_m2: Vec<f64>,
    /// For each view, the index of the view with the largest overlap and that overlap in percent of its own footprint, at
    /// the height where it is largest.
    pub nearest: Vec<Option<(usize, f64)>>,
    /// Number of views that must see a place for it to count as common ground.
    pub min_views: usize,
    /// Ground that at least `min_views` views see, square metres.
    pub common_m2: f64,
    /// Ground that all views see, square metres.
    pub all_m2: f64,
    /// Bounding box of the common ground.
    pub common_box: Option<UtmBox>,
}

impl Scene {
    /// [`Scene::overlap_within`] the height range of the scene.
    ///
    /// # Errors
    /// As [`Scene::overlap_within`].
    pub fn overlap(&self) -> Result<Overlap, SceneError> {
        self.overlap_within(self.height_range())
    }

    /// Footprints and their overlap at the middle of a range of ellipsoidal heights in metres; if some view shares less than
    /// half of its footprint there, at the height of the range with the largest common ground.
    ///
    /// Other heights are needed where the terrain is far from the middle of the range. The nearest view is determined over all
    /// heights, by [`Footprints::shared`].
    ///
    /// # Errors
    /// [`SceneError`] if a camera cannot be localised in the range, or the scene is outside of UTM.
    pub fn overlap_within(&self, (low, high): (f64, f64)) -> Result<Overlap, SceneError> {
        let middle = 0.5 * (low + high);
        let blind = |v: &View| SceneError::SeesNoGround {
            view: v.name.clone(),
            source_file: v.rpc_source.clone(),
            height_m: middle,
        };
        let Some(first) = self.views.first() else {
            return Err(SceneError::TooFewViews { found: 0, needed: 1 });
        };
        let center = self.center().ok_or_else(|| blind(first))?;
        let grid = SiteGrid::at(center)?;
        if let Some(view) = self.views.iter().find(|v| v.outline(&grid, middle).is_none()) {
            return Err(blind(view));
        }
        let cameras = self.views.iter().map(|v| (&v.rpc, (v.width, v.height))).collect();
        let footprints = Footprints::new(cameras, &grid, (low, high));
        let nearest_by = |i: usize, shared: &dyn Fn(usize) -> Option<SharedGround>| {
            let others = (0..self.views.len()).filter(|j| *j != i);
            let shares = others.filter_map(|j| Some((j, 100.0 * shared(j)?.shares[0])));
            shares.max_by(|a, b| a.1.total_cmp(&b.1))
        };
        let is_half = |nearest: &Option<(usize, f64)>| nearest.is_none_or(|n| n.1 >= MUCH_SHARED_PERCENT);
        let nearest_of = |i: usize| {
            let at_middle = nearest_by(i, &|j| footprints.shared_at_middle(i, j));
            if is_half(&at_middle) {
                (at_middle, true)
            } else {
                (nearest_by(i, &|j| footprints.shared(i, j)), false)
            }
        };
        let (nearest, is_half): (Vec<_>, Vec<bool>) = (0..self.views.len()).map(nearest_of).unzip();
        let mut best = self.overlap_at(&grid, middle).ok_or_else(|| blind(first))?;
        if is_half.contains(&false) && low < high {
            for other in heights_within((low, high)).filter_map(|h| self.overlap_at(&grid, h)) {
                if other.common_m2 > best.common_m2 {
                    best = other;
                }
            }
        }
        Ok(Overlap { nearest, ..best })
    }

    /// Footprints and the ground that views see together at one height; `None` if a camera cannot be localised there.
    fn overlap_at(&self, grid: &SiteGrid, height_m: f64) -> Option<Overlap> {
        let polygons: Vec<_> = self.views.iter().map(|v| v.outline(grid, height_m)).collect::<Option<_>>()?;
        let footprint_m2: Vec<f64> = polygons.iter().map(Area::unsigned_area).collect();
        let min_views = views_needed(self.views.len()).min(self.views.len());
        let common = ground_seen(&polygons, min_views);
        Some(Overlap {
            epsg: grid.epsg,
            height_m,
            nearest: Vec::new(),
            min_views,
            common_m2: common.unsigned_area(),
            all_m2: ground_seen(&polygons, polygons.len()).unsigned_area(),
            common_box: common.bounding_rect().map(|r| (r.min().x, r.min().y, r.max().x, r.max().y)),
            footprint_m2,
        })
    }

    /// Checks that every view overlaps with another one at some height of a range of ellipsoidal heights in metres, and
    /// returns the overlap.
    ///
    /// # Errors
    /// [`SceneError::NoSharedGround`] names a view that does not; also the errors of [`Scene::overlap_within`].
    pub fn require_shared_ground(&self, heights: (f64, f64)) -> Result<Overlap, SceneError> {
        let overlap = self.overlap_within(heights)?;
        for (i, nearest) in overlap.nearest.iter().enumerate() {
            let Some((j, percent)) = *nearest else { continue };
            if percent < LEAST_SHARED_PERCENT {
                let place = |v: &View| v.place(overlap.height_m);
                return Err(SceneError::NoSharedGround {
                    view: self.views[i].name.clone(),
                    footprint: place(&self.views[i]),
                    nearest: self.views[j].name.clone(),
                    nearest_footprint: place(&self.views[j]),
                    percent,
                });
            }
        }
        Ok(overlap)
    }
}

impl View {
    fn outline(&self, grid: &SiteGrid, height_m: f64) -> Option<Polygon<f64>> {
        footprint(&self.rpc, (self.width, self.height), grid, height_m)
    }

    /// Extent of the footprint at an ellipsoidal height in metres, as text: `lon 5.4401 to 5.4523, lat 43.2611 to 43.2688`.
    #[must_use]
    pub fn place(&self, height_m: f64) -> String {
        let Some(corners) = self.footprint(height_m) else { return "nowhere".into() };
        let span = |k: usize| {
            let values = corners.map(|p| p.xyz()[k]);
            let (low, high) = (
                values.into_iter().fold(f64::INFINITY, f64::min),
                values.into_iter().fold(f64::NEG_INFINITY, f64::max),
            );
            format!("{low:.4} to {high:.4}")
        };
        format!("lon {}, lat {}", span(0), span(1))
    }
}
