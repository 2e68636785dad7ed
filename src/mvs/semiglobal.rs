//! Semi-global matching (Hirschmüller 2008, eqs. 13 and 14): costs summed along eight paths into every cell.

use multiversion::multiversion;
use rayon::prelude::*;

/// Cells that one thread takes of a row.
const RUN: usize = 64;
/// Cost of a plane that does not exist.
const BEYOND: u16 = u16::MAX / 2;

/// What changes of the plane cost along a path.
#[derive(Clone, Copy)]
pub(super) struct Steps<'a> {
    /// Cost of a step of one plane between neighbours (Hirschmüller's P1).
    pub step: u16,
    /// Cost of a larger one (P2).
    pub jump: Jump<'a>,
}

/// The cost of a step of more than one plane between neighbours.
#[derive(Clone, Copy)]
pub(super) enum Jump<'a> {
    /// The same everywhere.
    Constant(u16),
    /// That of the cell which a path enters, row by row.
    OfCell(&'a [u16]),
}

/// Costs summed over the eight paths, cell by cell as in `costs`, which holds `planes` values a cell, in rows of `width`
/// cells.
pub(super) fn aggregate(costs: &[u8], width: usize, planes: usize, steps: Steps) -> Vec<u16> {
    let paths = Paths { planes, steps };
    let length = width * paths.planes;
    let rows: Vec<&[u8]> = costs.chunks_exact(length).collect();
    let border = paths.start(1);
    let mut sums = vec![0u16; rows.len() * length];
    sums.par_chunks_mut(length).zip(&rows).enumerate().for_each(|(row, (sums, costs))| {
        along(&paths, sums, costs, row * width, false);
        along(&paths, sums, costs, row * width, true);
    });
    for upwards in [false, true] {
        for lean in [-1, 0, 1] {
            let (mut before, mut now) = (paths.start(width), paths.start(width));
            for i in 0..rows.len() {
                let row = if upwards { rows.len() - 1 - i } else { i };
                let sums = &mut sums[row * length..(row + 1) * length];
                let runs =
                    sums.par_chunks_mut(RUN * paths.planes).zip(rows[row].par_chunks(RUN * paths.planes));
                let runs = runs.zip(now.par_chunks_mut(RUN * paths.stride())).enumerate();
                runs.for_each(|(run, ((sums, costs), now))| {
                    let cells = Run { first: row * width + run * RUN, from: (run * RUN) as i64 + lean };
                    across(&paths, sums, costs, now, (&before, &border), cells);
                });
                std::mem::swap(&mut before, &mut now);
            }
        }
    }
    sums
}

struct Paths<'a> {
    planes: usize,
    steps: Steps<'a>,
}

/// Cells of a row.
struct Run {
    /// The first of them.
    first: usize,
    /// The cell of the row before from which its path comes, if there is one.
    from: i64,
}

impl Paths<'_> {
    /// What steps into a cell cost: of one plane, and of more.
    #[inline(always)]
    fn costs(&self, cell: usize) -> [u16; 2] {
        let jump = match self.steps.jump {
            Jump::Constant(jump) => jump,
            Jump::OfCell(jumps) => jumps[cell],
        };
        [self.steps.step, jump]
    }

    /// A border that costs nothing, or the state of `cells` cells before a path has begun.
    fn start(&self, cells: usize) -> Vec<u16> {
        let mut state = vec![BEYOND; self.stride() * cells];
        state.chunks_mut(self.stride()).for_each(|s| s[1..=self.planes].fill(0));
        state
    }

    /// A cell's state has one impossible plane below and one above.
    fn stride(&self) -> usize {
        self.planes + 2
    }
}

/// The path along a row whose first cell is `first`.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx2", "x86_64+avx2"))]
fn along(paths: &Paths, sums: &mut [u16], costs: &[u8], first: usize, backwards: bool) {
    let planes = paths.planes;
    let cells = costs.len() / planes;
    let (mut before, mut now) = (paths.start(1), paths.start(1));
    for i in 0..cells {
        let cell = if backwards { cells - 1 - i } else { i };
        let at = cell * planes..(cell + 1) * planes;
        step(paths.costs(first + cell), &costs[at.clone()], &before, &mut now, &mut sums[at]);
        std::mem::swap(&mut before, &mut now);
    }
}

/// A run of cells whose paths come from the row `before`, those beyond it from the border.
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
        step(paths.costs(run.first + i), costs, before.unwrap_or(border), now, sums);
    }
}

/// One cell of a path, added to its sums.
#[inline(always)]
fn step([one, jump]: [u16; 2], costs: &[u8], before: &[u16], now: &mut [u16], sums: &mut [u16]) {
    let mut least = BEYOND;
    for b in before {
        least = least.min(*b);
    }
    let n = costs.len();
    let (below, same, above) = (&before[..n], &before[1..=n], &before[2..n + 2]);
    let (now, sums) = (&mut now[1..=n], &mut sums[..n]);
    for k in 0..n {
        let neighbour = below[k].min(above[k]) + one;
        now[k] = same[k].min(neighbour).min(least + jump) - least + u16::from(costs[k]);
        sums[k] += now[k];
    }
}
