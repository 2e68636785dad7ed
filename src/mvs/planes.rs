//! Planes in textureless segments of a surface.
//!
//! Views agree on no altitude inside white roofs, courtyards and streets; what is found there drifts by metres, while the
//! edges of the same surface are right. A segment is a connected set of cells with little texture and similar gray values.
//! Its plane is the one near which most of its altitudes lie, weighted by their scores (RANSAC, Fischler and Bolles 1981); the two
//! sides of a roof, and roofs that look alike, are further planes. Cells on none of them that have a low score are moved onto the
//! nearest, within the altitudes of the cells that lie on it; if no plane is near enough of them, nothing is moved.

use super::surface::MatchedSurface;
use super::visibility::Visibility;
use crate::random::CounterRng;
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// [`Visibility::texture`] below which a cell can begin a segment.
const SMOOTH_TEXTURE: f32 = 0.7;
/// Largest difference of gray values between neighbouring cells of a segment, in standard deviations of an image.
const NEIGHBOUR_DIFFERENCE: f32 = 0.2;
/// Smallest area of a segment, square metres.
const MIN_AREA_M2: f64 = 100.0;
/// Distance by which segments grow at the end, metres, because texture is measured in windows: into cells whose gray value
/// differs by less than `GROWTH_DIFFERENCE` from the median of the segment.
const GROWTH_M: f64 = 4.0;
const GROWTH_DIFFERENCE: f32 = 0.5;
/// Cells within this distance of a plane lie on it, metres.
const TOLERANCE_M: f64 = 0.35;
/// Share of the weight of a segment that must lie on its plane, times `LEVEL_FACTOR` if it is level.
const MIN_SHARE: f64 = 0.4;
/// Share of the weight of a segment that must lie on each further plane, and not on those before it.
const FURTHER_SHARE: f64 = 0.15;
/// Smallest weight of a cell; above it the weight is the score.
const MIN_WEIGHT: f32 = 0.1;
/// Number of planes that are tried: every third is level, the others pass through three cells.
const TRIALS: u64 = 300;
/// Largest number of cells of a segment that trials look at.
const MOST_CELLS: usize = 20_000;
/// Factor by which the weight on a level plane counts more: tilted ones fit noise better by chance.
const LEVEL_FACTOR: f64 = 1.15;
/// Largest slope of a plane, metres per metre.
const MAX_SLOPE: f64 = 0.5;
/// Smallest area of the parallelogram of three cells that define a plane, in cells.
const MIN_BASE: f64 = 20.0;
/// Score below which cells are moved. The scores of refined surfaces include the distance from the prior: at the prior
/// this one stands for a mean cube of correlations of 0.4.
const MAX_SCORE: f32 = 0.6;
/// Key of the random numbers of this module.
const DRAW: u64 = 0x706c_616e;

/// A cell of a segment.
struct Cell {
    index: usize,
    /// Column, row and altitude.
    at: [f64; 3],
    weight: f64,
}

/// Altitude as a function of column and row: `slope[0] * column + slope[1] * row + offset`.
#[derive(Clone, Copy)]
struct Plane {
    slope: [f64; 2],
    offset: f64,
}

impl Plane {
    fn level(altitude: f64) -> Self {
        Self { slope: [0.0; 2], offset: altitude }
    }

    fn is_level(self) -> bool {
        self.slope == [0.0; 2]
    }

    /// The plane through three cells; none if they lie close to each other or to a line, or if it is too steep. `cell_m` is
    /// the side of a cell.
    fn through([a, b, c]: [[f64; 3]; 3], cell_m: f64) -> Option<Self> {
        let [u, v]: [[f64; 3]; 2] = [b, c].map(|p| std::array::from_fn(|k| p[k] - a[k]));
        let base = u[0] * v[1] - u[1] * v[0];
        let slope = [(u[2] * v[1] - v[2] * u[1]) / base, (u[0] * v[2] - v[0] * u[2]) / base];
        let is_usable = base.abs() >= MIN_BASE && slope[0].hypot(slope[1]) <= MAX_SLOPE * cell_m;
        is_usable.then(|| Self { slope, offset: a[2] - slope[0] * a[0] - slope[1] * a[1] })
    }

    fn altitude(self, [col, row, _]: [f64; 3]) -> f64 {
        self.slope[0] * col + self.slope[1] * row + self.offset
    }

    /// Distance of a cell from the plane, metres of altitude.
    fn distance(self, cell: &Cell) -> f64 {
        (cell.at[2] - self.altitude(cell.at)).abs()
    }

    fn holds(self, cell: &Cell) -> bool {
        self.distance(cell) < TOLERANCE_M
    }
}

/// A plane with the lowest and highest altitude of the cells on it.
struct Patch {
    plane: Plane,
    altitudes: (f64, f64),
}

impl Patch {
    /// Whether the plane has an altitude of the patch at a cell: a segment may go on where its plane does not.
    fn reaches(&self, cell: &Cell) -> bool {
        let (low, high) = self.altitudes;
        (low..=high).contains(&self.plane.altitude(cell.at))
    }
}

impl MatchedSurface {
    /// Moves the cells of textureless segments that have a low score onto the planes of their segments. `visibility` is that
    /// of this surface, which is a refined one.
    pub(super) fn flatten(&mut self, visibility: &Visibility) {
        let segments: Vec<(Vec<Cell>, Vec<Patch>)> = self
            .segments(visibility)
            .into_par_iter()
            .map(|cells| {
                let patches = patches(&cells, self.grid.cell);
                (cells, patches)
            })
            .collect();
        for (cells, patches) in &segments {
            let is_free = |c: &&Cell| !patches.iter().any(|patch| patch.plane.holds(c));
            for cell in cells.iter().filter(is_free).filter(|c| self.score.data[c.index] < MAX_SCORE) {
                let reached = patches.iter().filter(|patch| patch.reaches(cell));
                let nearest =
                    reached.min_by(|a, b| a.plane.distance(cell).total_cmp(&b.plane.distance(cell)));
                if let Some(patch) = nearest {
                    self.altitude.data[cell.index] = patch.plane.altitude(cell.at) as f32;
                }
            }
        }
    }

    /// The segments, each with the cells that it grew into.
    fn segments(&self, visibility: &Visibility) -> Vec<Vec<Cell>> {
        let count = self.altitude.data.len();
        let is_known = |i: usize| !self.altitude.data[i].is_nan();
        let is_smooth: Vec<bool> = (0..count)
            .into_par_iter()
            .map(|i| is_known(i) && visibility.texture(i) < SMOOTH_TEXTURE)
            .collect();
        let size = (self.altitude.width, self.altitude.height);
        let (min_cells, growth) = (MIN_AREA_M2 / self.grid.cell.powi(2), (GROWTH_M / self.grid.cell).ceil());
        let mut is_taken = vec![false; count];
        let mut segments = Vec::new();
        for first in 0..count {
            if !is_smooth[first] || is_taken[first] {
                continue;
            }
            is_taken[first] = true;
            let mut cells = vec![first];
            let is_alike =
                |i: usize, j: usize| is_smooth[j] && visibility.gray_difference(i, j) < NEIGHBOUR_DIFFERENCE;
            grow(&mut cells, usize::MAX, size, &mut is_taken, is_alike);
            if (cells.len() as f64) >= min_cells {
                segments.push(cells);
            }
        }
        for cells in &mut segments {
            let gray = visibility.median_gray(cells);
            let is_alike = |_, j: usize| is_known(j) && (visibility.gray(j) - gray).abs() < GROWTH_DIFFERENCE;
            grow(cells, growth as usize, size, &mut is_taken, is_alike);
        }
        let cell = |index: usize| {
            let at = [(index % size.0) as f64, (index / size.0) as f64, f64::from(self.altitude.data[index])];
            Cell { index, at, weight: f64::from(self.score.data[index].max(MIN_WEIGHT)) }
        };
        segments.into_iter().map(|cells| cells.into_iter().map(cell).collect()).collect()
    }
}

/// The cells of a grid beside a cell: left, right, above and below; none beyond the grid.
fn neighbours((width, height): (usize, usize), cell: usize) -> [Option<usize>; 4] {
    [
        (!cell.is_multiple_of(width)).then(|| cell - 1),
        (!(cell + 1).is_multiple_of(width)).then_some(cell + 1),
        cell.checked_sub(width),
        Some(cell + width).filter(|below| *below < width * height),
    ]
}

/// Appends to `cells` their neighbours that are not taken and are alike, and the neighbours of these, in so many rounds.
fn grow(
    cells: &mut Vec<usize>,
    rounds: usize,
    size: (usize, usize),
    is_taken: &mut [bool],
    is_alike: impl Fn(usize, usize) -> bool,
) {
    let mut front = 0;
    for _ in 0..rounds {
        let end = cells.len();
        for k in front..end {
            let cell = cells[k];
            for next in neighbours(size, cell).into_iter().flatten() {
                if !is_taken[next] && is_alike(cell, next) {
                    is_taken[next] = true;
                    cells.push(next);
                }
            }
        }
        if cells.len() == end {
            return;
        }
        front = end;
    }
}

/// The planes of a segment, each with the cells on it that are on none before it.
fn patches(cells: &[Cell], cell_m: f64) -> Vec<Patch> {
    let total: f64 = cells.iter().map(|c| c.weight).sum();
    let mut free: Vec<&Cell> = cells.iter().collect();
    let (mut out, mut share) = (Vec::new(), MIN_SHARE);
    while let Some(plane) = fitted(&free, share * total, cell_m) {
        let (held, others): (Vec<&Cell>, Vec<&Cell>) = free.into_iter().partition(|c| plane.holds(c));
        if held.is_empty() {
            break;
        }
        let bounds = |(l, h): (f64, f64), c: &&Cell| (l.min(c.at[2]), h.max(c.at[2]));
        let altitudes = held.iter().fold((f64::INFINITY, f64::NEG_INFINITY), bounds);
        out.push(Patch { plane, altitudes });
        (free, share) = (others, FURTHER_SHARE);
    }
    out
}

/// The plane of least squares of the cells that lie on the plane on which most of the weight of these cells lies, if that is at
/// least so much.
fn fitted(cells: &[&Cell], least: f64, cell_m: f64) -> Option<Plane> {
    let all: f64 = cells.iter().map(|c| c.weight).sum();
    if cells.is_empty() || all < least {
        return None;
    }
    let looked_at = || cells.iter().step_by(cells.len().div_ceil(MOST_CELLS));
    let trial = |k: u64| {
        let mut random = CounterRng::new(0, DRAW, cells[0].index as u64, k);
        let mut draw = || cells[random.below(cells.len())].at;
        let is_level = k.is_multiple_of(3);
        let plane = if is_level {
            Plane::level(draw()[2])
        } else {
            Plane::through(std::array::from_fn(|_| draw()), cell_m)?
        };
        let on_it: f64 = looked_at().filter(|c| plane.holds(c)).map(|c| c.weight).sum();
        Some((if is_level { LEVEL_FACTOR * on_it } else { on_it }, k, plane))
    };
    let trials: Vec<_> = (0..TRIALS).into_par_iter().filter_map(trial).collect();
    let best = trials.into_iter().max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
    let (on_it, _, plane) = best?;
    let seen: f64 = looked_at().map(|c| c.weight).sum();
    let held: Vec<&Cell> = cells.iter().copied().filter(|c| plane.holds(c)).collect();
    (on_it * all >= least * seen).then(|| least_squares(&held, plane.is_level()).unwrap_or(plane))
}

/// The plane of least weighted squares of the altitudes of cells; none if they lie on a line.
fn least_squares(cells: &[&Cell], is_level: bool) -> Option<Plane> {
    let total: f64 = cells.iter().map(|c| c.weight).sum();
    let mean: [f64; 3] =
        std::array::from_fn(|k| cells.iter().map(|c| c.weight * c.at[k]).sum::<f64>() / total);
    if is_level {
        return Some(Plane::level(mean[2]));
    }
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for cell in cells {
        let row = Vector3::new(cell.at[0] - mean[0], cell.at[1] - mean[1], 1.0);
        normal += cell.weight * row * row.transpose();
        right += cell.weight * (cell.at[2] - mean[2]) * row;
    }
    let [x, y, z] = (normal.try_inverse()? * right).into();
    Some(Plane { slope: [x, y], offset: mean[2] + z - x * mean[0] - y * mean[1] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{Point, SiteGrid};
    use crate::io::{Grid2, MapGrid};

    const SIDE: usize = 40;

    /// A roof of 24 x 24 cells with the given altitudes on ground at 0 that is smooth and darker; the altitudes of the roof's edge, two
    /// cells wide, are certain.
    fn flattened(roof: impl Fn(usize, usize) -> f32) -> Grid2 {
        let is_roof = |col: usize, row: usize| (8..32).contains(&col) && (8..32).contains(&row);
        let is_inside = |col: usize, row: usize| (10..30).contains(&col) && (10..30).contains(&row);
        let raster = |f: &dyn Fn(usize, usize) -> f32| Grid2::from_fn(SIDE, SIDE, f);
        let site = SiteGrid { epsg: 32617, origin: Point::new(436_200.0, 3_357_600.0, 10.0) };
        let grid = MapGrid {
            epsg: 32617,
            west: 436_190.0,
            north: 3_357_610.0,
            cell: 0.5,
            width: SIDE,
            height: SIDE,
        };
        let mut surface = MatchedSurface {
            site,
            grid,
            altitude: raster(&|c, r| if is_roof(c, r) { roof(c, r) } else { 0.0 }),
            score: raster(&|c, r| if is_inside(c, r) { 0.2 } else { 0.9 }),
            prior_weight: Grid2::filled(SIDE, SIDE, 0.0),
        };
        let gray = raster(&|c, r| if is_roof(c, r) { 2.0 } else { -1.0 });
        surface.flatten(&Visibility::of_gray(gray));
        surface.altitude
    }

    fn worst_inside(surface: &Grid2, truth: impl Fn(usize, usize) -> f32) -> f32 {
        let cells = (8..32).flat_map(|row| (8..32).map(move |col| (col, row)));
        cells.map(|(c, r)| (surface.at(c, r) - truth(c, r)).abs()).fold(0.0, f32::max)
    }

    /// Errors of up to 3 m inside the roof.
    fn drift(col: usize, row: usize) -> f32 {
        let is_drifted = (14..26).contains(&col) && (14..26).contains(&row);
        if is_drifted { 1.0 + 2.0 * ((col * row) % 7) as f32 / 7.0 } else { 0.0 }
    }

    #[test]
    fn a_textureless_roof_that_drifted_inside_becomes_the_plane_of_its_edges() {
        let tilted = |c: usize, r: usize| 8.0 + 0.05 * c as f32 - 0.1 * r as f32;
        for truth in [&|_, _| 8.0, &tilted as &dyn Fn(usize, usize) -> f32] {
            let surface = flattened(|c, r| truth(c, r) + drift(c, r));
            assert!(worst_inside(&surface, truth) < 0.01, "{}", worst_inside(&surface, truth));
            let is_roof = |i: usize| (8..32).contains(&(i % SIDE)) && (8..32).contains(&(i / SIDE));
            assert!((0..SIDE * SIDE).all(|i| is_roof(i) || surface.data[i] == 0.0), "the ground has moved");
        }
    }

    #[test]
    fn both_sides_of_a_roof_are_planes_and_what_drifted_on_them_moves_to_its_own_side() {
        // The western side is larger, so that it holds most of the weight.
        let gable = |c: usize, _: usize| 10.0 - 0.2 * (c as f32 - 22.5).abs();
        let drifted = |c: usize, r: usize| (16..18).contains(&c) && (14..26).contains(&r);
        let surface = flattened(|c, r| gable(c, r) + if drifted(c, r) { 1.2 } else { 0.0 });
        assert!(worst_inside(&surface, gable) < 0.1, "{}", worst_inside(&surface, gable));
    }

    #[test]
    fn a_dome_is_no_plane_and_stays() {
        let dome = |c: usize, r: usize| 12.0 - 0.05 * ((c as f32 - 19.5).powi(2) + (r as f32 - 19.5).powi(2));
        assert_eq!(worst_inside(&flattened(dome), dome), 0.0);
    }

    #[test]
    fn altitudes_with_a_high_score_stay() {
        let step = |c: usize, _| if c < 10 { 9.0 } else { 8.0 };
        let surface = flattened(step);
        assert!((10..30).all(|row| surface.at(8, row) == 9.0 && surface.at(20, row) == 8.0));
    }
}
