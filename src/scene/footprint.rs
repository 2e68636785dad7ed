//! Footprints of views on the map, and the ground that several views see.
//!
//! A footprint is the quadrilateral of the outer corners of an image on the ground at one height. Its sides are straight on
//! the map; for a full swath of 15 km the error is a few metres.

use super::UtmBox;
use crate::frame::{CornerPx, Pixel, SiteGrid};
use crate::rpc::Rpc;
use geo::{BooleanOps, BoundingRect, LineString, MultiPolygon, Polygon};

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

#[cfg(test)]
mod tests {
    use super::*;
    use geo::{Area, Rect};

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
