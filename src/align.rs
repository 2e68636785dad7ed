//! The one translation that brings a scene to a reference: tie points leave it open, and delivered cameras know it to
//! metres.
//!
//! To a surface: the horizontal shift of the smallest mean distance between heights, from a grid of shifts and a
//! pattern search, heights less their median difference; large distances count no more than [`CLIP_M`], as what was
//! built or cut down since says nothing of the shift. To surveyed points: the median of theirs.

use crate::frame::{FrameError, Geodetic, Point, SiteGrid, Transform, Utm};
use crate::io::Grid2;
use crate::metrics::{MetricsError, Surface, quantile};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Reach of the search, and its first step, metres.
const REACH_M: f64 = 24.0;
const STEP_M: f64 = 1.5;
/// Step at which it ends, metres.
const FINEST_M: f64 = 1e-3;
/// Points looked at for every shift of the grid, and for the best of them.
const SCREENED: usize = 4_000;
const REFINED: usize = 60_000;
/// Shifts of the grid that the search goes on from: heights have several minima. And grids that are tried, each around
/// the best shift so far.
const STARTS: usize = 6;
const ROUNDS: usize = 5;
/// Distances between heights count up to this, metres.
const CLIP_M: f32 = 3.0;
/// Points that must lie on the reference, and the share of the most that lie there under any shift.
const FEWEST: usize = 100;
const LEAST_SHARE: f64 = 0.5;

/// Why no shift is found.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum AlignError {
    /// The reference is elsewhere or empty.
    #[error("{common} of the run's points lie on heights of `{reference}`, {FEWEST} are needed")]
    #[diagnostic(help("is the reference of the same place, its CRS right, and does it hold heights?"))]
    NoOverlap {
        /// The reference.
        reference: PathBuf,
        /// Points that lie on it.
        common: usize,
    },
    /// The best shift is as far as the search goes.
    #[error("`{reference}` fits no better anywhere within {REACH_M} m of where the run stands")]
    #[diagnostic(help("is it of the same place, and does it show buildings or relief?"))]
    TooFar {
        /// The reference.
        reference: PathBuf,
    },
    /// No ground control point is seen twice.
    #[error("no point of `{reference}` is seen by two views of the run")]
    #[diagnostic(help("a point needs a line for each of two images or more"))]
    NoControl {
        /// The reference.
        reference: PathBuf,
    },
    /// The reference cannot be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Reference(#[from] MetricsError),
    /// The systems cannot be brought together.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Frame(#[from] FrameError),
}

/// How far a scene is moved on its map, metres.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Shift {
    /// East.
    pub east_m: f64,
    /// North.
    pub north_m: f64,
    /// Up.
    pub up_m: f64,
}

impl Shift {
    /// East, north, up.
    #[must_use]
    pub fn enu(&self) -> [f64; 3] {
        [self.east_m, self.north_m, self.up_m]
    }

    /// Its length, metres.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        self.enu().iter().map(|v| v * v).sum::<f64>().sqrt()
    }

    /// This shift after another.
    #[must_use]
    pub fn after(&self, first: &Self) -> Self {
        Self {
            east_m: self.east_m + first.east_m,
            north_m: self.north_m + first.north_m,
            up_m: self.up_m + first.up_m,
        }
    }

    /// The same at a place of the map in degrees of longitude and latitude and metres of height. A step in degrees and
    /// one in metres differ by less than a centimetre in 10 m over 50 km.
    #[must_use]
    pub fn on_ground(&self, map: &SiteGrid, at: Point<Geodetic>) -> [f64; 3] {
        let here = map.utm_from_geodetic(at);
        let there = Point::new(here.x() + self.east_m, here.y() + self.north_m, here.z());
        let there = map.geodetic_from_utm(there);
        [there.lon_deg() - at.lon_deg(), there.lat_deg() - at.lat_deg(), self.up_m]
    }
}

/// A shift and what it leaves.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Alignment {
    /// How far the scene is to be moved.
    pub shift: Shift,
    /// Points that were compared.
    pub points: usize,
    /// Median distance from the reference after it, metres: of heights, or of surveyed points in space.
    pub left_m: f64,
}

/// The shift of points, which count in EPSG `epsg`, to a surface.
///
/// # Errors
/// [`AlignError::NoOverlap`], [`AlignError::TooFar`], [`AlignError::Frame`].
pub fn to_surface(points: &[Point<Utm>], epsg: u32, reference: &Surface) -> Result<Alignment, AlignError> {
    let search = Search::new(points, epsg, reference)?;
    let no_overlap = |common| AlignError::NoOverlap { reference: reference.path.clone(), common };
    let mut best = search.best_around([0.0; 2]).map_err(no_overlap)?;
    // Until nothing around it is better, so that an aligned scene is found to be aligned.
    for _ in 0..ROUNDS {
        let next = search.best_around(best.at).map_err(no_overlap)?;
        if next.mean_m >= best.mean_m {
            break;
        }
        best = next;
    }
    if best.at.iter().any(|v| v.abs() >= REACH_M) {
        return Err(AlignError::TooFar { reference: reference.path.clone() });
    }
    let shift = Shift { east_m: best.at[0], north_m: best.at[1], up_m: f64::from(best.up_m) };
    let left = search.differences(best.at, REFINED).iter().map(|d| (d - best.up_m).abs()).collect::<Vec<_>>();
    Ok(Alignment { shift, points: best.common, left_m: quantile(&left, 0.5) })
}

/// The shift of (ours, surveyed) places: the median along each axis of the map.
///
/// # Errors
/// [`AlignError::NoControl`] without any.
pub fn to_control(
    pairs: &[[Point<Geodetic>; 2]],
    map: &SiteGrid,
    reference: &Path,
) -> Result<Alignment, AlignError> {
    if pairs.is_empty() {
        return Err(AlignError::NoControl { reference: reference.into() });
    }
    let off: Vec<[f64; 3]> = pairs
        .iter()
        .map(|[ours, exact]| (map.utm_from_geodetic(*exact) - map.utm_from_geodetic(*ours)).xyz())
        .collect();
    let median = |k: usize| quantile(&off.iter().map(|d| d[k] as f32).collect::<Vec<_>>(), 0.5);
    let shift = Shift { east_m: median(0), north_m: median(1), up_m: median(2) };
    let left: Vec<f32> = off
        .iter()
        .map(|d| d.iter().zip(shift.enu()).map(|(d, s)| (d - s).powi(2)).sum::<f64>().sqrt() as f32)
        .collect();
    Ok(Alignment { shift, points: pairs.len(), left_m: quantile(&left, 0.5) })
}

/// A horizontal shift and how well heights agree under it.
#[derive(Clone, Copy)]
struct Candidate {
    at: [f64; 2],
    up_m: f32,
    mean_m: f64,
    common: usize,
}

impl Candidate {
    /// By distance; of equal ones the smaller shift comes first.
    fn order(a: &Self, b: &Self) -> std::cmp::Ordering {
        let size = |c: &Self| c.at[0].hypot(c.at[1]);
        a.mean_m.total_cmp(&b.mean_m).then(size(a).total_cmp(&size(b)))
    }
}

/// Points on the reference's grid, ready to be shifted.
struct Search<'a> {
    heights: &'a Grid2,
    /// Column, row and height of each point.
    cells: Vec<([f64; 2], f32)>,
    /// Columns and rows a metre east and a metre north of the points' map are.
    by_metre: [[f64; 2]; 2],
}

impl<'a> Search<'a> {
    fn new(points: &[Point<Utm>], epsg: u32, reference: &'a Surface) -> Result<Self, AlignError> {
        let grid = reference.grid;
        let transform = (epsg != grid.epsg).then(|| Transform::new(epsg, grid.epsg)).transpose()?;
        let cell_of = |x: f64, y: f64| {
            let (x, y) = transform.map_or((x, y), |t| t.convert(x, y));
            // Cell centres are whole numbers.
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

    /// Reference minus point, of some `at_most` points that lie on it under a shift.
    fn differences(&self, [east, north]: [f64; 2], at_most: usize) -> Vec<f32> {
        let moved: [f64; 2] =
            std::array::from_fn(|k| east * self.by_metre[0][k] + north * self.by_metre[1][k]);
        let some = self.cells.iter().step_by(self.cells.len().div_ceil(at_most).max(1));
        let off = some.map(|(px, z)| self.heights.bilinear(px[0] + moved[0], px[1] + moved[1]) - z);
        off.filter(|d| d.is_finite()).collect()
    }

    fn candidate(&self, at: [f64; 2], at_most: usize) -> Candidate {
        let off = self.differences(at, at_most);
        let up_m = quantile(&off, 0.5) as f32;
        let sum: f64 = off.iter().map(|d| f64::from((d - up_m).abs().min(CLIP_M))).sum();
        Candidate { at, up_m, mean_m: sum / off.len() as f64, common: off.len() }
    }

    /// The best shift from a grid around one; else the number of points that lie on the reference.
    fn best_around(&self, middle: [f64; 2]) -> Result<Candidate, usize> {
        let steps = (REACH_M / STEP_M) as i32;
        let axis = |k: usize| (-steps..=steps).map(move |i| middle[k] + f64::from(i) * STEP_M);
        let grid: Vec<[f64; 2]> = axis(1).flat_map(|north| axis(0).map(move |east| [east, north])).collect();
        let (ranked, most) = self.ranked(&grid, SCREENED);
        if most * self.cells.len().div_ceil(SCREENED) < FEWEST {
            return Err(most);
        }
        let starts: Vec<[f64; 2]> = ranked.iter().take(STARTS).map(|c| c.at).chain([middle]).collect();
        let refined = starts.into_par_iter().filter_map(|s| self.refined(s));
        refined.min_by(Candidate::order).ok_or(most)
    }

    /// Candidates, the best first, without those that lose points; and the most points that any has.
    fn ranked(&self, shifts: &[[f64; 2]], at_most: usize) -> (Vec<Candidate>, usize) {
        let mut all: Vec<Candidate> = shifts.par_iter().map(|s| self.candidate(*s, at_most)).collect();
        let most = all.iter().map(|c| c.common).max().unwrap_or(0);
        all.retain(|c| c.common > 0 && c.common as f64 >= LEAST_SHARE * most as f64);
        all.sort_by(Candidate::order);
        (all, most)
    }

    /// Pattern search: to the best of eight neighbours while one is better, then with half the step.
    fn refined(&self, start: [f64; 2]) -> Option<Candidate> {
        let mut best = self.candidate(start, REFINED);
        if best.common < FEWEST {
            return None;
        }
        let least = LEAST_SHARE * best.common as f64;
        let mut step = 0.5 * STEP_M;
        while step >= FINEST_M {
            let around = (0..9).filter(|k| *k != 4).map(|k| [k % 3 - 1, k / 3 - 1].map(f64::from));
            let next = around
                .map(|d| self.candidate([best.at[0] + step * d[0], best.at[1] + step * d[1]], REFINED))
                .filter(|c| c.common as f64 >= least && c.mean_m < best.mean_m)
                .min_by(Candidate::order);
            match next {
                Some(better) => best = better,
                None => step *= 0.5,
            }
        }
        Some(best)
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

    fn reference() -> Surface {
        let grid =
            MapGrid { epsg: EPSG, west: 700_000.0, north: 4_800_400.0, cell: 0.5, width: 800, height: 800 };
        let raster =
            Grid2::from_fn(800, 800, |c, r| height(0.5 * c as f64 + 0.25, 399.75 - 0.5 * r as f64) as f32);
        Surface {
            path: "reference.tif".into(),
            grid,
            height: raster,
            vertical: None,
            undeclared_nodata: 0,
            converted_from: None,
        }
    }

    /// The town's points, `shift` away from where they belong; a tenth of them is something else.
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
    fn a_known_shift_is_found_among_what_has_changed() {
        for shift in [[0.0, 0.0, 0.0], [3.3, -7.1, 12.4], [-14.2, 9.6, -48.0]] {
            let found = to_surface(&points(shift), EPSG, &reference()).unwrap();
            for (f, s) in found.shift.enu().iter().zip(shift) {
                assert!((f - s).abs() < 0.1, "{found:?} {shift:?}");
            }
        }
    }

    #[test]
    fn another_zone_is_no_matter() {
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
    fn a_reference_that_is_elsewhere_empty_or_plain_is_refused() {
        let mut away = reference();
        away.grid.west += 5000.0;
        assert!(matches!(
            to_surface(&points([0.0; 3]), EPSG, &away),
            Err(AlignError::NoOverlap { common: 0, .. })
        ));
        let mut empty = reference();
        empty.height.data.fill(f32::NAN);
        assert!(matches!(to_surface(&points([0.0; 3]), EPSG, &empty), Err(AlignError::NoOverlap { .. })));
        let far = to_surface(&points([60.0, 0.0, 0.0]), EPSG, &reference());
        assert!(!far.is_ok_and(|a| a.left_m < 0.1));
        assert!(matches!(to_surface(&[], EPSG, &reference()), Err(AlignError::NoOverlap { .. })));
    }

    #[test]
    fn surveyed_points_outvote_a_wrong_one() {
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
        assert!(matches!(to_control(&[], &map, Path::new("gcps.csv")), Err(AlignError::NoControl { .. })));
    }
}
