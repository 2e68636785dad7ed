//! Co-registration: the translation that brings a scene to a reference. Tie points do not determine it, and delivered
//! cameras know it to some metres only.
//!
//! To a height raster, it is the shift with the smallest mean absolute difference of heights after removal of their
//! median difference. It is found on a grid of shifts and refined by pattern search. Differences are clipped at
//! `CLIP_M`, because buildings that changed say nothing about the shift. To surveyed points, it is the median of
//! their differences.

use crate::frame::{FrameError, Geodetic, Point, SiteGrid, Transform, Utm};
use crate::io::Grid2;
use crate::metrics::{HeightRaster, MetricsError, PatternSearch};
use crate::stats::interpolated_quantile;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Half the side of the grid of shifts and its step, metres.
const REACH_M: f64 = 24.0;
const STEP_M: f64 = 1.5;
/// Last step of the refinement, metres.
const FINEST_M: f64 = 1e-3;
/// Number of points that are evaluated for every shift of the grid, and during the refinement.
const SCREENED: usize = 4_000;
const REFINED: usize = 60_000;
/// Number of shifts of the grid that are refined, because the differences have several minima; and largest number of
/// grids, each around the best shift so far.
const STARTS: usize = 6;
const ROUNDS: usize = 5;
/// Half the side and step of the last grid, around the best shift, metres: few points have minima that are close to each other.
const NEAR_M: f64 = 2.0;
const NEAR_STEP_M: f64 = 0.25;
/// Differences of heights are clipped at this, metres.
const CLIP_M: f32 = 3.0;
/// Smallest number of points on the reference, and smallest fraction of the most points that any shift has on it.
const FEWEST: usize = 100;
const LEAST_SHARE: f64 = 0.5;

/// Why no translation was found.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum CoregisterError {
    /// Too few points lie on the reference.
    #[error("{common} of the run's points lie on heights of `{reference}`, {FEWEST} are needed")]
    #[diagnostic(help(
        "does the reference show the same place, is its CRS right, and does it hold heights?"
    ))]
    NoOverlap {
        /// The reference.
        reference: PathBuf,
        /// Points that lie on it.
        common: usize,
    },
    /// The best shift lies at the limit of the search.
    #[error("the best shift to `{reference}` lies at the limit of the search, {REACH_M} m")]
    #[diagnostic(help("does it show the same place, and buildings or relief?"))]
    TooFar {
        /// The reference.
        reference: PathBuf,
    },
    /// No ground control point is observed in two views.
    #[error("no point of `{reference}` is observed in two views of the run")]
    #[diagnostic(help("a point needs a line for each of two images or more"))]
    NoControl {
        /// The reference.
        reference: PathBuf,
    },
    /// The reference cannot be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Reference(#[from] MetricsError),
    /// The coordinate systems cannot be transformed into each other.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Frame(#[from] FrameError),
}

/// Translation of a scene on its map, metres.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Shift {
    /// To the east, metres.
    pub east_m: f64,
    /// To the north, metres.
    pub north_m: f64,
    /// Upwards, metres.
    pub up_m: f64,
}

impl Shift {
    /// The components east, north and up, metres.
    #[must_use]
    pub fn enu(&self) -> [f64; 3] {
        [self.east_m, self.north_m, self.up_m]
    }

    /// Its length, metres.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        self.enu().iter().map(|v| v * v).sum::<f64>().sqrt()
    }

    /// This translation applied after another one.
    #[must_use]
    pub fn after(&self, first: &Self) -> Self {
        Self {
            east_m: self.east_m + first.east_m,
            north_m: self.north_m + first.north_m,
            up_m: self.up_m + first.up_m,
        }
    }

    /// The translation at a place as a step in degrees of longitude, degrees of latitude and metres of height. Over 50
    /// km, the same step in degrees differs from that in metres by less than a centimetre for a translation of 10 m.
    #[must_use]
    pub fn on_ground(&self, map: &SiteGrid, at: Point<Geodetic>) -> [f64; 3] {
        let here = map.utm_from_geodetic(at);
        let there = Point::new(here.x() + self.east_m, here.y() + self.north_m, here.z());
        let there = map.geodetic_from_utm(there);
        [there.lon_deg() - at.lon_deg(), there.lat_deg() - at.lat_deg(), self.up_m]
    }
}

/// A translation and the differences that remain.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Coregistration {
    /// The translation to apply to the scene.
    pub shift: Shift,
    /// Number of compared points.
    pub points: usize,
    /// Median absolute difference after the translation, metres: of heights, or of positions of surveyed points.
    pub left_m: f64,
}

/// The translation of points, whose map has the code EPSG `epsg`, to a height raster.
///
/// # Errors
/// [`CoregisterError::NoOverlap`], [`CoregisterError::TooFar`], [`CoregisterError::Frame`].
pub fn to_surface(
    points: &[Point<Utm>],
    epsg: u32,
    reference: &HeightRaster,
) -> Result<Coregistration, CoregisterError> {
    let search = TranslationSearch::new(points, epsg, reference)?;
    let no_overlap = |common| CoregisterError::NoOverlap { reference: reference.path.clone(), common };
    let mut best = search.best_around([0.0; 2], REACH_M, STEP_M).map_err(no_overlap)?;
    // The search is repeated until no shift around the best one is better, so that an aligned scene has the shift zero.
    for (reach_m, step_m) in [(REACH_M, STEP_M), (NEAR_M, NEAR_STEP_M)] {
        for _ in 0..ROUNDS {
            let next = search.best_around(best.at, reach_m, step_m).map_err(no_overlap)?;
            if next.mean_m >= best.mean_m {
                break;
            }
            best = next;
        }
    }
    if best.at.iter().any(|v| v.abs() >= REACH_M) {
        return Err(CoregisterError::TooFar { reference: reference.path.clone() });
    }
    let shift = Shift { east_m: best.at[0], north_m: best.at[1], up_m: f64::from(best.up_m) };
    let left = search.differences(best.at, REFINED).iter().map(|d| (d - best.up_m).abs()).collect::<Vec<_>>();
    Ok(Coregistration { shift, points: best.common, left_m: interpolated_quantile(&left, 0.5) })
}

/// The translation between pairs of (triangulated, surveyed) positions: the median along each axis of the map.
///
/// # Errors
/// [`CoregisterError::NoControl`] without any.
pub fn to_control(
    pairs: &[[Point<Geodetic>; 2]],
    map: &SiteGrid,
    reference: &Path,
) -> Result<Coregistration, CoregisterError> {
    if pairs.is_empty() {
        return Err(CoregisterError::NoControl { reference: reference.into() });
    }
    let off: Vec<[f64; 3]> = pairs
        .iter()
        .map(|[ours, exact]| (map.utm_from_geodetic(*exact) - map.utm_from_geodetic(*ours)).xyz())
        .collect();
    let median = |k: usize| interpolated_quantile(&off.iter().map(|d| d[k] as f32).collect::<Vec<_>>(), 0.5);
    let shift = Shift { east_m: median(0), north_m: median(1), up_m: median(2) };
    let left: Vec<f32> = off
        .iter()
        .map(|d| d.iter().zip(shift.enu()).map(|(d, s)| (d - s).powi(2)).sum::<f64>().sqrt() as f32)
        .collect();
    Ok(Coregistration { shift, points: pairs.len(), left_m: interpolated_quantile(&left, 0.5) })
}

/// A horizontal shift with the differences of heights that it leaves.
#[derive(Clone, Copy)]
struct Translation {
    at: [f64; 2],
    up_m: f32,
    mean_m: f64,
    common: usize,
}

impl Translation {
    /// Orders by the mean difference; of equal ones the smaller shift comes first.
    fn order(a: &Self, b: &Self) -> std::cmp::Ordering {
        let size = |c: &Self| c.at[0].hypot(c.at[1]);
        a.mean_m.total_cmp(&b.mean_m).then(size(a).total_cmp(&size(b)))
    }
}

/// Points in the pixel coordinates of the reference.
struct TranslationSearch<'a> {
    heights: &'a Grid2,
    /// Column, row and height of each point.
    cells: Vec<([f64; 2], f32)>,
    /// Columns and rows per metre east and per metre north on the points' map.
    by_metre: [[f64; 2]; 2],
}

impl<'a> TranslationSearch<'a> {
    fn new(points: &[Point<Utm>], epsg: u32, reference: &'a HeightRaster) -> Result<Self, CoregisterError> {
        let grid = reference.grid;
        let transform = (epsg != grid.epsg).then(|| Transform::new(epsg, grid.epsg)).transpose()?;
        let cell_of = |x: f64, y: f64| {
            let (x, y) = transform.map_or((x, y), |t| t.convert(x, y));
            // Centres of cells are at whole numbers.
            [(x - grid.west) / grid.cell - 0.5, (grid.north - y) / grid.cell - 0.5]
        };
        let cells = points.iter().map(|p| (cell_of(p.x(), p.y()), p.z() as f32)).collect();
        let by_metre = points.first().map_or([[0.0; 2]; 2], |p| {
            let here = cell_of(p.x(), p.y());
            [cell_of(p.x() + 1.0, p.y()), cell_of(p.x(), p.y() + 1.0)]
                .map(|there| [there[0] - here[0], there[1] - here[1]])
        });
        Ok(Self { heights: &reference.height, cells, by_metre })
    }

    /// Reference minus point for at most `at_most` of the points that lie on the reference under a shift.
    fn differences(&self, [east, north]: [f64; 2], at_most: usize) -> Vec<f32> {
        let moved: [f64; 2] =
            std::array::from_fn(|k| east * self.by_metre[0][k] + north * self.by_metre[1][k]);
        let some = self.cells.iter().step_by(self.cells.len().div_ceil(at_most).max(1));
        let off = some.map(|(px, z)| self.heights.bilinear(px[0] + moved[0], px[1] + moved[1]) - z);
        off.filter(|d| d.is_finite()).collect()
    }

    fn candidate(&self, at: [f64; 2], at_most: usize) -> Translation {
        let off = self.differences(at, at_most);
        let up_m = interpolated_quantile(&off, 0.5) as f32;
        let sum: f64 = off.iter().map(|d| f64::from((d - up_m).abs().min(CLIP_M))).sum();
        Translation { at, up_m, mean_m: sum / off.len() as f64, common: off.len() }
    }

    /// The best shift of a grid around a position, of which half the side and the step are given in metres; else the number
    /// of points on the reference.
    fn best_around(&self, middle: [f64; 2], reach_m: f64, step_m: f64) -> Result<Translation, usize> {
        let steps = (reach_m / step_m) as i32;
        let axis = |k: usize| (-steps..=steps).map(move |i| middle[k] + f64::from(i) * step_m);
        let grid: Vec<[f64; 2]> = axis(1).flat_map(|north| axis(0).map(move |east| [east, north])).collect();
        let (ranked, most) = self.ranked(&grid, SCREENED);
        if most * self.cells.len().div_ceil(SCREENED) < FEWEST {
            return Err(most);
        }
        let starts: Vec<[f64; 2]> = ranked.iter().take(STARTS).map(|c| c.at).chain([middle]).collect();
        let refined = starts.into_par_iter().filter_map(|s| self.refined(s));
        refined.min_by(Translation::order).ok_or(most)
    }

    /// The shifts ordered by their differences, those that lose many points excepted; and the most points that any has.
    fn ranked(&self, shifts: &[[f64; 2]], at_most: usize) -> (Vec<Translation>, usize) {
        let mut all: Vec<Translation> = shifts.par_iter().map(|s| self.candidate(*s, at_most)).collect();
        let most = all.iter().map(|c| c.common).max().unwrap_or(0);
        all.retain(|c| c.common > 0 && c.common as f64 >= LEAST_SHARE * most as f64);
        all.sort_by(Translation::order);
        (all, most)
    }

    /// Refines a shift by pattern search; none when too few points lie on the reference.
    fn refined(&self, start: [f64; 2]) -> Option<Translation> {
        let start = self.candidate(start, REFINED);
        if start.common < FEWEST {
            return None;
        }
        let least = LEAST_SHARE * start.common as f64;
        let search = PatternSearch { first_step: 0.5 * STEP_M, last_step: FINEST_M, max_moves: usize::MAX };
        let best_of = |best: &Translation, neighbours: Vec<Translation>| {
            let better =
                neighbours.into_iter().filter(|c| c.common as f64 >= least && c.mean_m < best.mean_m);
            better.min_by(Translation::order)
        };
        Some(search.run(start, |c| c.at, |at| self.candidate(at, REFINED), best_of))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::MapGrid;

    const EPSG: u32 = 32631;

    /// Heights of a town without a period: blocks on a slope.
    fn height(x: f64, y: f64) -> f64 {
        let (i, j) = ((x / 17.0).floor(), (y / 23.0).floor());
        let block = (i * 7.0 + j * 5.0 + i * j).rem_euclid(9.0);
        100.0 + 2.5 * block + 0.02 * x - 0.01 * y
    }

    fn reference() -> HeightRaster {
        let grid =
            MapGrid { epsg: EPSG, west: 700_000.0, north: 4_800_400.0, cell: 0.5, width: 800, height: 800 };
        let raster =
            Grid2::from_fn(800, 800, |c, r| height(0.5 * c as f64 + 0.25, 399.75 - 0.5 * r as f64) as f32);
        HeightRaster {
            path: "reference.tif".into(),
            grid,
            height: raster,
            vertical: None,
            undeclared_nodata: 0,
            converted_from: None,
        }
    }

    /// Points of the town, shifted by `shift`; a tenth of them have wrong heights.
    fn points(shift: [f64; 3]) -> Vec<Point<Utm>> {
        (0..20_000)
            .map(|i| {
                let (x, y) = (
                    60.0 + 280.0 * (f64::from(i) * 0.618_034).fract(),
                    60.0 + 280.0 * (f64::from(i) * 0.754_878).fract(),
                );
                let wrong = if i % 10 == 0 { 15.0 } else { 0.0 };
                Point::new(
                    700_000.0 + x - shift[0],
                    4_800_000.0 + y - shift[1],
                    height(x, y) + wrong - shift[2],
                )
            })
            .collect()
    }

    #[test]
    fn a_known_shift_is_found_although_some_buildings_changed() {
        for shift in [[0.0, 0.0, 0.0], [3.3, -7.1, 12.4], [-14.2, 9.6, -48.0]] {
            let found = to_surface(&points(shift), EPSG, &reference()).unwrap();
            for (f, s) in found.shift.enu().iter().zip(shift) {
                assert!((f - s).abs() < 0.1, "{found:?} {shift:?}");
            }
        }
    }

    #[test]
    fn points_and_reference_may_be_in_different_zones() {
        let to = Transform::new(EPSG, EPSG + 1).unwrap();
        let shift = [4.0, -2.0, 1.0];
        let moved: Vec<Point<Utm>> = points([0.0; 3])
            .iter()
            .map(|p| {
                let (x, y) = to.convert(p.x(), p.y());
                Point::new(x - shift[0], y - shift[1], p.z() - shift[2])
            })
            .collect();
        let found = to_surface(&moved, EPSG + 1, &reference()).unwrap();
        for (f, s) in found.shift.enu().iter().zip(shift) {
            assert!((f - s).abs() < 0.1, "{found:?}");
        }
    }

    #[test]
    fn a_reference_that_is_elsewhere_empty_or_flat_is_refused() {
        let mut away = reference();
        away.grid.west += 5000.0;
        assert!(matches!(
            to_surface(&points([0.0; 3]), EPSG, &away),
            Err(CoregisterError::NoOverlap { common: 0, .. })
        ));
        let mut empty = reference();
        empty.height.data.fill(f32::NAN);
        assert!(matches!(
            to_surface(&points([0.0; 3]), EPSG, &empty),
            Err(CoregisterError::NoOverlap { .. })
        ));
        let far = to_surface(&points([60.0, 0.0, 0.0]), EPSG, &reference());
        assert!(!far.is_ok_and(|a| a.left_m < 0.1));
        assert!(matches!(to_surface(&[], EPSG, &reference()), Err(CoregisterError::NoOverlap { .. })));
    }

    #[test]
    fn a_wrong_surveyed_point_does_not_change_the_median() {
        let map = SiteGrid::at(Point::new(5.44, 43.26, 100.0)).unwrap();
        let pair = |dx: f64| {
            let ours = Point::<Utm>::new(map.origin.x() + 10.0 * dx, map.origin.y(), 90.0);
            let exact = Point::new(ours.x() + dx, ours.y() - 2.0, 93.0);
            [map.geodetic_from_utm(ours), map.geodetic_from_utm(exact)]
        };
        let found = to_control(&[pair(1.0), pair(1.1), pair(50.0)], &map, Path::new("gcps.csv")).unwrap();
        for (f, s) in found.shift.enu().iter().zip([1.1, -2.0, 3.0]) {
            assert!((f - s).abs() < 1e-3, "{found:?}");
        }
        assert!(matches!(
            to_control(&[], &map, Path::new("gcps.csv")),
            Err(CoregisterError::NoControl { .. })
        ));
    }
}
