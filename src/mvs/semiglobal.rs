//! Semi-global matching (SGM): aggregation of matching costs along eight paths.
//!
//! H. Hirschmüller, "Stereo Processing by Semiglobal Matching and Mutual Information", IEEE TPAMI 30(2),
//! 2008, equations 13 and 14. Planes take the place of disparities. It is written by hand, because libraries
//! match rectified pairs of images only, and the cells here may be those of a map grid.

use multiversion::multiversion;
use rayon::prelude::*;

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

/// The aggregated costs: sums over the eight paths, in the order of `costs`. This is row by row of `width`
/// cells, with `planes` values for each cell.
pub(super) fn aggregate(costs: &[u8], width: usize, planes: usize, penalties: Penalties) -> Vec<u16> {
    let paths = Paths { planes, penalties };
    let length = width * paths.planes;
    let rows: Vec<&[u8]> = costs.chunks_exact(length).collect();
    let border = paths.start(1);
    let mut sums = vec![0u16; rows.len() * length];
    sums.par_chunks_mut(length).zip(&rows).enumerate().for_each(|(row, (sums, costs))| {
        along(&paths, sums, costs, row * width, false);
        along(&paths, sums, costs, row * width, true);
    });
    for upwards in [false, true] {
        for shift in [-1, 0, 1] {
            let (mut before, mut now) = (paths.start(width), paths.start(width));
            for i in 0..rows.len() {
                let row = if upwards { rows.len() - 1 - i } else { i };
                let sums = &mut sums[row * length..(row + 1) * length];
                let runs =
                    sums.par_chunks_mut(RUN * paths.planes).zip(rows[row].par_chunks(RUN * paths.planes));
                let runs = runs.zip(now.par_chunks_mut(RUN * paths.stride())).enumerate();
                runs.for_each(|(run, ((sums, costs), now))| {
                    let cells = Run { first: row * width + run * RUN, from: (run * RUN) as i64 + shift };
                    across(&paths, sums, costs, now, (&before, &border), cells);
                });
                std::mem::swap(&mut before, &mut now);
            }
        }
    }
    sums
}

/// What is the same for all paths.
struct Paths<'a> {
    planes: usize,
    penalties: Penalties<'a>,
}

/// Consecutive cells of a row.
struct Run {
    /// Index of the first cell.
    first: usize,
    /// Column from which the path of the first cell comes, in the previous row; it may lie outside.
    from: i64,
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

    /// The state of `cells` cells before a path has begun: all planes cost 0.
    fn start(&self, cells: usize) -> Vec<u16> {
        let mut state = vec![NO_PLANE; self.stride() * cells];
        state.chunks_mut(self.stride()).for_each(|s| s[1..=self.planes].fill(0));
        state
    }

    /// Length of the state of a cell: its planes, and one plane of cost [`NO_PLANE`] below and one above.
    fn stride(&self) -> usize {
        self.planes + 2
    }
}

/// Follows the path along a row whose first cell has the index `first`.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx2", "x86_64+avx2"))]
fn along(paths: &Paths, sums: &mut [u16], costs: &[u8], first: usize, backwards: bool) {
    let planes = paths.planes;
    let cells = costs.len() / planes;
    let (mut before, mut now) = (paths.start(1), paths.start(1));
    for i in 0..cells {
        let cell = if backwards { cells - 1 - i } else { i };
        let at = cell * planes..(cell + 1) * planes;
        step(paths.penalties(first + cell), &costs[at.clone()], &before, &mut now, &mut sums[at]);
        std::mem::swap(&mut before, &mut now);
    }
}

/// Advances the paths from the row `before` into a run of cells. Paths that come from outside of the image
/// start from `border`.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx2", "x86_64+avx2"))]
fn across(
    paths: &Paths,
    sums: &mut [u16],
    costs: &[u8],
    now: &mut [u16],
    (before, border): (&[u16], &[u16]),
    run: Run,
) {
    let (planes, stride) = (paths.planes, paths.stride());
    let cells = sums.chunks_mut(planes).zip(costs.chunks(planes)).zip(now.chunks_mut(stride));
    for (i, ((sums, costs), now)) in cells.enumerate() {
        let from = usize::try_from(run.from + i as i64).ok();
        let before = from.and_then(|cell| before.get(cell * stride..(cell + 1) * stride));
        step(paths.penalties(run.first + i), costs, before.unwrap_or(border), now, sums);
    }
}

/// Advances a path by one cell, and adds its costs to the sums of the cell.
#[inline(always)]
fn step([p1, p2]: [u16; 2], costs: &[u8], before: &[u16], now: &mut [u16], sums: &mut [u16]) {
    let mut least = NO_PLANE;
    for b in before {
        least = least.min(*b);
    }
    let n = costs.len();
    let (below, same, above) = (&before[..n], &before[1..=n], &before[2..n + 2]);
    let (now, sums) = (&mut now[1..=n], &mut sums[..n]);
    for k in 0..n {
        let neighbour = below[k].min(above[k]) + p1;
        now[k] = same[k].min(neighbour).min(least + p2) - least + u16::from(costs[k]);
        sums[k] += now[k];
    }
}
