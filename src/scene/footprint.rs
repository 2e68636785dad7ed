//! Footprints of views on the map, and the ground that several views see.
//!
//! A footprint is the quadrilateral of the outer corners of an image on the ground at one height. Its sides are straight on
//! the map; for a full swath of 15 km the error is a few metres.

use super::{Scene, SceneError, UtmBox, View};
use crate::frame::{CornerPx, Pixel, SiteGrid};
use crate::rpc::Rpc;
use geo::{Area, BooleanOps, BoundingRect, LineString, MultiPolygon, Polygon};

/// Smallest overlap of a view with some other view, in percent of its footprint.
const LEAST_SHARED_PERCENT: f64 = 1.0;
/// Overlap in percent at the middle height above which other heights are not examined.
const MUCH_SHARED_PERCENT: f64 = 50.0;
/// Number of steps from the lowest to the highest height; height ranges of RPCs are at most a few kilometres.
const HEIGHTS: i32 = 64;

/// Footprint of an image of `width` x `height` pixels at an ellipsoidal height in metres, in metres of the UTM zone of
/// `grid`; `None` if a corner cannot be localised at that height.
#[must_use]
pub fn footprint(
    rpc: &Rpc,
    (width, height): (usize, usize),
    grid: &SiteGrid,
    height_m: f64,
) -> Option<Polygon<f64>> {
    let (w, h) = (width as f64, height as f64);
    let mut ring = Vec::with_capacity(5);
    for (col, row) in [(0.0, 0.0), (w, 0.0), (w, h), (0.0, h)] {
        let ground = rpc.localize(Pixel::<CornerPx>::new(col, row).into(), height_m).ok()?;
        let p = grid.utm_from_geodetic(ground);
        if !p.is_finite() {
            return None;
        }
        ring.push((p.x(), p.y()));
    }
    Some(Polygon::new(LineString::from(ring), Vec::new()))
}

/// The area inside at least `min_views` of the footprints, in their coordinates.
///
/// Footprints are added one by one: with `seen[k]` the area inside at least `k + 1` of those before, a footprint `F` adds
/// `seen[k - 1] ∩ F` to `seen[k]`.
#[must_use]
pub fn ground_seen(footprints: &[Polygon<f64>], min_views: usize) -> MultiPolygon<f64> {
    let levels = min_views.max(1);
    let mut seen = vec![MultiPolygon::<f64>(Vec::new()); levels];
    for footprint in footprints {
        let footprint = MultiPolygon(vec![footprint.clone()]);
        for k in (1..levels).rev() {
            let again = seen[k - 1].intersection(&footprint);
            seen[k] = seen[k].union(&again);
        }
        seen[0] = seen[0].union(&footprint);
    }
    seen.swap_remove(levels - 1)
}

/// Number of views that must see a place for it to count as common ground: three, or two if there are fewer than four
/// views.
#[must_use]
pub const fn views_needed(views: usize) -> usize {
    if views < 4 { 2 } else { 3 }
}

/// The default area of interest: the bounding box of the ground at ellipsoidal height `height_m`, in metres, that at least
/// [`views_needed`] views see; `None` if there is no such ground.
///
/// `views` holds the camera, columns and rows of each view. The box is in metres of the UTM zone of `grid` and is not
/// aligned with cells. Its corners may be seen by fewer views than its centre.
#[must_use]
pub fn default_aoi(views: &[(&Rpc, usize, usize)], grid: &SiteGrid, height_m: f64) -> Option<UtmBox> {
    let footprints: Vec<_> =
        views.iter().filter_map(|(rpc, w, h)| footprint(rpc, (*w, *h), grid, height_m)).collect();
    let seen = ground_seen(&footprints, views_needed(views.len()));
    let r = seen.bounding_rect()?;
    Some((r.min().x, r.min().y, r.max().x, r.max().y))
}

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
    /// Other heights are needed where the terrain is far from the middle of the range: at a wrong height, footprints of the
    /// same place are apart, by 1.7 m for each degree between the lines of sight and 100 m of height. The nearest view
    /// is determined over all heights.
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
        let at_middle = self.overlap_at(&grid, middle).ok_or_else(|| blind(first))?;
        let share = |o: &Overlap, i: usize| o.nearest[i].map_or(100.0, |n| n.1);
        let is_half = |o: &Overlap| (0..self.views.len()).all(|i| share(o, i) >= MUCH_SHARED_PERCENT);
        if is_half(&at_middle) || low >= high {
            return Ok(at_middle);
        }
        let mut best = at_middle;
        for k in 0..=HEIGHTS {
            let height_m = low + (high - low) * f64::from(k) / f64::from(HEIGHTS);
            let Some(mut other) = self.overlap_at(&grid, height_m) else { continue };
            for i in 0..self.views.len() {
                if share(&best, i) > share(&other, i) {
                    other.nearest[i] = best.nearest[i];
                }
            }
            if other.common_m2 > best.common_m2 {
                best = other;
            } else {
                best.nearest = other.nearest;
            }
        }
        Ok(best)
    }

    /// Footprints and their overlap at one height; `None` if a camera cannot be localised there.
    fn overlap_at(&self, grid: &SiteGrid, height_m: f64) -> Option<Overlap> {
        let polygons: Vec<_> = self.views.iter().map(|v| v.outline(grid, height_m)).collect::<Option<_>>()?;
        let footprint_m2: Vec<f64> = polygons.iter().map(Area::unsigned_area).collect();
        let nearest = (0..polygons.len())
            .map(|i| {
                let shares = (0..polygons.len()).filter(|j| *j != i).map(|j| {
                    let shared = polygons[i].intersection(&polygons[j]).unsigned_area();
                    (j, 100.0 * shared / footprint_m2[i])
                });
                shares.max_by(|a, b| a.1.total_cmp(&b.1))
            })
            .collect();
        let min_views = views_needed(self.views.len()).min(self.views.len());
        let common = ground_seen(&polygons, min_views);
        Some(Overlap {
            epsg: grid.epsg,
            height_m,
            nearest,
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

#[cfg(test)]
mod tests {
    use super::*;
    use geo::Rect;

    fn square(x: f64, y: f64) -> Polygon<f64> {
        Rect::new((x, y), (x + 10.0, y + 10.0)).to_polygon()
    }

    #[test]
    fn ground_seen_by_at_least_n_views_has_the_right_area() {
        let footprints = [square(0.0, 0.0), square(5.0, 0.0), square(0.0, 5.0), square(100.0, 0.0)];
        let area = |n| ground_seen(&footprints, n).unsigned_area();
        // Expected areas by inclusion and exclusion: four squares, the overlapping pairs, the triple.
        let union = 4.0 * 100.0 - (50.0 + 50.0 + 25.0) + 25.0;
        assert!((area(1) - union).abs() < 1e-6, "{}", area(1));
        assert!((area(2) - 75.0).abs() < 1e-6, "{}", area(2));
        assert!((area(3) - 25.0).abs() < 1e-6);
        assert_eq!(area(4), 0.0);
        assert!(ground_seen(&footprints, 4).bounding_rect().is_none());
    }

    #[test]
    fn the_default_area_of_interest_is_the_footprint() {
        let rpc = crate::rpc::test_camera();
        let grid = SiteGrid::at(rpc.center()).unwrap();
        let shifted = rpc.shifted(100.0, 0.0);
        let (w, s, e, n) = default_aoi(&[(&rpc, 1000, 1000), (&shifted, 1000, 1000)], &grid, 190.0).unwrap();
        let o = grid.origin;
        assert!(w < o.x() && o.x() < e && s < o.y() && o.y() < n);
        let area = footprint(&rpc, (1000, 1000), &grid, 190.0).unwrap().unsigned_area();
        assert!((e - w) * (n - s) < area);
    }
}
