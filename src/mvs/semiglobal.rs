//! Semi-global matching (SGM): aggregation of matching costs along eight paths.
//!
//! H. Hirschmüller, "Stereo Processing by Semiglobal Matching and Mutual Information", IEEE TPAMI 30(2),
//! 2008, equations 13 and 14. Planes take the place of disparities. It is written by hand, because libraries
//! match rectified pairs of images only, and the cells here may be those of a map grid. Cells may have different planes: a
//! path enters a plane that the cell before lacks as from a plane far away.

use super::plane_ranges::PlaneRanges;
use multiversion::multiversion;
use rayon::prelude::*;
use std::ops::Range;

/// Number of cells of a row that one thread processes.
const RUN: usize = 64;
/// Cost of a plane below the lowest or above the highest.
const NO_PLANE: u16 = u16::MAX / 2;

/// Penalties for a difference of plane between neighbours on a path, in the unit of the costs.
#[derive(Clone, Copy)]
pub(super) struct Penalties<'a> {
    /// For a difference of one plane.
    pub p1: u16,
    /// For a larger difference.
    pub p2: P2<'a>,
}

/// The penalty for a difference of more than one plane between neighbours.
#[derive(Clone, Copy)]
pub(super) enum P2<'a> {
    /// The same everywhere.
    Constant(u16),
    /// A penalty for each cell that a path enters, row by row.
    PerCell(&'a [u16]),
}

/// The aggregated costs: sums over the eight paths, in the order of `costs`, which holds the planes of `ranges`.
pub(super) fn aggregate(costs: &[u8], ranges: &PlaneRanges, penalties: Penalties) -> Vec<u16> {
    let paths = Paths { ranges, penalties };
    let (width, rows) = (ranges.width, ranges.rows());
    let mut sums = vec![0u16; costs.len()];
    let lengths = |row: usize| ranges.entries(ranges.row(row)).len();
    PlaneRanges::split(&mut sums, (0..rows).map(lengths)).into_par_iter().enumerate().for_each(
        |(row, sums)| {
            let costs = &costs[ranges.entries(ranges.row(row))];
            along(&paths, sums, costs, ranges.row(row), false);
            along(&paths, sums, costs, ranges.row(row), true);
        },
    );
    let longest = (0..rows).map(lengths).max().unwrap_or(0) + MARGINS * width;
    for upwards in [false, true] {
        for shift in [-1, 0, 1] {
            let (mut before, mut now) = (vec![0; longest], vec![0; longest]);
            let mut row_before = None;
            for i in 0..rows {
                let row = if upwards { rows - 1 - i } else { i };
                let cells = ranges.row(row);
                let end = cells.end;
                let runs = || cells.clone().step_by(RUN).map(move |first| first..(first + RUN).min(end));
                let entries = |run: Range<usize>| ranges.entries(run).len();
                let sums = &mut sums[ranges.entries(cells.clone())];
                let sums = PlaneRanges::split(sums, runs().map(entries));
                let states = runs().map(|run| entries(run.clone()) + MARGINS * run.len());
                let states = PlaneRanges::split(&mut now, states);
                let all: Vec<_> = runs().zip(sums).zip(states).collect();
                all.into_par_iter().for_each(|((run, sums), now)| {
                    let costs = &costs[ranges.entries(run.clone())];
                    across(&paths, sums, costs, now, (before.as_slice(), row_before), (run, shift));
                });
                std::mem::swap(&mut before, &mut now);
                row_before = Some(row);
            }
        }
    }
    sums
}

/// Planes of cost [`NO_PLANE`] in the state of a cell: one below its planes and one above.
const MARGINS: usize = 2;

/// What is the same for all paths.
struct Paths<'a> {
    ranges: &'a PlaneRanges,
    penalties: Penalties<'a>,
}

/// The state of a path in a cell: the costs of its planes, with [`MARGINS`].
struct State<'a> {
    costs: &'a [u16],
    /// The planes.
    planes: Range<usize>,
}

impl Paths<'_> {
    /// The penalties P1 and P2 for entering a cell.
    #[inline(always)]
    fn penalties(&self, cell: usize) -> [u16; 2] {
        let p2 = match self.penalties.p2 {
            P2::Constant(p2) => p2,
            P2::PerCell(p2) => p2[cell],
        };
        [self.penalties.p1, p2]
    }
}

/// Follows the path along a row of cells.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx2", "x86_64+avx2"))]
fn along(paths: &Paths, sums: &mut [u16], costs: &[u8], row: Range<usize>, backwards: bool) {
    let ranges = paths.ranges;
    let (start, length) = (ranges.entries(row.clone()).start, row.len());
    let longest = row.clone().map(|cell| ranges.planes(cell).len()).max().unwrap_or(0) + MARGINS;
    let (mut before, mut now, mut aligned) = (vec![0; longest], vec![0; longest], Vec::new());
    let mut planes_before = None;
    for i in 0..length {
        let cell = if backwards { row.end - 1 - i } else { row.start + i };
        let entries = ranges.entries(cell..cell + 1);
        let at = entries.start - start..entries.end - start;
        let planes = ranges.planes(cell);
        let from = planes_before
            .map(|planes: Range<usize>| State { costs: &before[..planes.len() + MARGINS], planes });
        let now_of_cell = &mut now[..planes.len() + MARGINS];
        let penalties = paths.penalties(cell);
        enter(
            penalties,
            &costs[at.clone()],
            from,
            (now_of_cell, planes.clone()),
            &mut sums[at],
            &mut aligned,
        );
        std::mem::swap(&mut before, &mut now);
        planes_before = Some(planes);
    }
}

/// Advances the paths from the row `before` into a run of cells; `shift` is the difference of column to the cell from which
/// a path comes.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx2", "x86_64+avx2"))]
fn across(
    paths: &Paths,
    sums: &mut [u16],
    costs: &[u8],
    now: &mut [u16],
    (before, row_before): (&[u16], Option<usize>),
    (run, shift): (Range<usize>, i64),
) {
    let ranges = paths.ranges;
    let (start, first) = (ranges.entries(run.clone()).start, run.start);
    let mut aligned = Vec::new();
    for cell in run {
        let entries = ranges.entries(cell..cell + 1);
        let at = entries.start - start..entries.end - start;
        let planes = ranges.planes(cell);
        let col = usize::try_from((cell % ranges.width) as i64 + shift).ok();
        let from = row_before.zip(col.filter(|col| *col < ranges.width)).map(|(row, col)| {
            let (row, cell) = (ranges.row(row), row * ranges.width + col);
            let planes = ranges.planes(cell);
            let begin = ranges.entries(row.start..cell).len() + MARGINS * col;
            State { costs: &before[begin..begin + planes.len() + MARGINS], planes }
        });
        let begin = at.start + MARGINS * (cell - first);
        let now_of_cell = &mut now[begin..begin + planes.len() + MARGINS];
        let penalties = paths.penalties(cell);
        enter(penalties, &costs[at.clone()], from, (now_of_cell, planes), &mut sums[at], &mut aligned);
    }
}

/// Advances a path into a cell, and adds its costs to the sums of the cell. A path begins with the cell if it comes from
/// nowhere. `aligned` is working memory.
#[inline(always)]
fn enter(
    penalties: [u16; 2],
    costs: &[u8],
    from: Option<State>,
    (now, planes): (&mut [u16], Range<usize>),
    sums: &mut [u16],
    aligned: &mut Vec<u16>,
) {
    let end = now.len() - 1;
    (now[0], now[end]) = (NO_PLANE, NO_PLANE);
    let Some(State { costs: before, planes: planes_before }) = from else {
        begin(costs, now, sums);
        return;
    };
    let mut least = NO_PLANE;
    for b in before {
        least = least.min(*b);
    }
    if planes_before == planes {
        step(penalties, costs, (before, least), now, sums);
        return;
    }
    aligned.clear();
    aligned.resize(now.len(), NO_PLANE);
    // Both states begin one plane below the first of their cell; planes are counted from one here.
    let both = planes.start.max(planes_before.start + 1)..(planes.end + MARGINS).min(planes_before.end + 1);
    if !both.is_empty() {
        let (own, theirs) = (both.start - planes.start, both.start - planes_before.start);
        aligned[own..own + both.len()].copy_from_slice(&before[theirs..theirs + both.len()]);
    }
    step(penalties, costs, (aligned.as_slice(), least), now, sums);
}

/// The first cell of a path.
#[inline(always)]
fn begin(costs: &[u8], now: &mut [u16], sums: &mut [u16]) {
    for ((cost, now), sum) in costs.iter().zip(&mut now[1..]).zip(sums) {
        *now = u16::from(*cost);
        *sum += *now;
    }
}

/// Advances a path by one cell. `before` holds the costs of the same planes in the cell before, and the least cost there.
#[inline(always)]
fn step([p1, p2]: [u16; 2], costs: &[u8], (before, least): (&[u16], u16), now: &mut [u16], sums: &mut [u16]) {
    let n = costs.len();
    let (below, same, above) = (&before[..n], &before[1..=n], &before[2..n + 2]);
    let (now, sums) = (&mut now[1..=n], &mut sums[..n]);
    for k in 0..n {
        let neighbour = below[k].min(above[k]) + p1;
        now[k] = same[k].min(neighbour).min(least + p2) - least + u16::from(costs[k]);
        sums[k] += now[k];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mvs::plane_ranges::Blocks;
    use crate::random::CounterRng;

    const SIZE: (usize, usize) = (150, 40);
    const PLANES: usize = 24;
    const PENALTIES: Penalties = Penalties { p1: 30, p2: P2::Constant(200) };

    /// Noise, in which cells of a stripe match best at plane 18 and others at plane 5.
    fn cost(cell: usize, plane: usize) -> u8 {
        let best = if (60..80).contains(&(cell % SIZE.0)) { 18 } else { 5 };
        let noise = 100.0 * CounterRng::new(1, 2, cell as u64, plane as u64).uniform();
        let mean = if plane == best { 20.0 } else { 120.0 };
        (mean + noise) as u8
    }

    fn best_planes(ranges: &PlaneRanges) -> Vec<usize> {
        let cells = SIZE.0 * SIZE.1;
        let costs: Vec<u8> =
            (0..cells).flat_map(|cell| ranges.planes(cell).map(move |plane| cost(cell, plane))).collect();
        let sums = aggregate(&costs, ranges, PENALTIES);
        let best = |cell: usize| {
            let start = ranges.entries(cell..cell + 1).start;
            ranges.planes(cell).enumerate().min_by_key(|(i, _)| sums[start + i]).map_or(0, |(_, plane)| plane)
        };
        (0..cells).map(best).collect()
    }

    #[test]
    fn cells_with_the_planes_near_the_surface_find_the_same_as_with_all() {
        let all = best_planes(&PlaneRanges::uniform(SIZE, PLANES));
        let blocks = Blocks { columns: 10, rows: 8 };
        let (across, down) = blocks.count(SIZE);
        let of_block = |block: usize| if (6..8).contains(&(block % across)) { 3..22 } else { block % 3..9 };
        let ranges: Vec<_> = (0..across * down).map(of_block).collect();
        let some = best_planes(&PlaneRanges::of_blocks(SIZE, blocks, &ranges));
        let is_right =
            |cell: usize, plane: usize| plane == if (60..80).contains(&(cell % SIZE.0)) { 18 } else { 5 };
        let right = |found: &[usize]| found.iter().enumerate().filter(|(i, p)| is_right(*i, **p)).count();
        assert!(right(&some) >= right(&all) && right(&all) > 5990, "{} {}", right(&some), right(&all));
    }

    #[test]
    fn a_path_goes_on_through_cells_without_planes_and_planes_that_are_not_shared() {
        let blocks = Blocks { columns: 10, rows: 8 };
        let (across, down) = blocks.count(SIZE);
        let of_block = |block: usize| match block % 4 {
            0 => 5..5,
            1 => 4..8,
            2 => 9..12,
            _ => 3..6,
        };
        let ranges: Vec<_> = (0..across * down).map(of_block).collect();
        let found = best_planes(&PlaneRanges::of_blocks(SIZE, blocks, &ranges));
        assert!(
            (0..SIZE.0).filter(|col| col / 10 % 4 == 1).all(|col| found[col] == 5 || (60..80).contains(&col))
        );
    }
}
