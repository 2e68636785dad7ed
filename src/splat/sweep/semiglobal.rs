//! Semi-global matching (Hirschmüller 2008, eqs. 13 and 14): costs summed along eight paths into every cell.

use super::correlation::Volume;
use rayon::prelude::*;

/// Cost of a step of one plane between neighbours.
const STEP: u16 = 30;
/// Cells that one thread takes of a row.
const RUN: usize = 64;

/// Costs summed over the eight paths, cell by cell as in `volume`, whose rows are `width` cells long. A step of more
/// than one plane between neighbours costs `jump`.
pub(super) fn aggregate(volume: &Volume, width: usize, jump: u16) -> Vec<u16> {
    let paths = Paths { planes: volume.planes(), jump };
    let rows: Vec<&[u8]> = volume.rows(width).collect();
    let length = width * paths.planes;
    let mut sums = vec![0u16; rows.len() * length];
    sums.par_chunks_mut(length).zip(&rows).for_each(|(sums, costs)| {
        paths.along(sums, costs, false);
        paths.along(sums, costs, true);
    });
    for upwards in [false, true] {
        for lean in [-1, 0, 1] {
            let mut before = vec![0u16; length];
            let mut now = vec![0u16; length];
            for i in 0..rows.len() {
                let row = if upwards { rows.len() - 1 - i } else { i };
                let sums = &mut sums[row * length..(row + 1) * length];
                paths.across(sums, rows[row], lean, &before, &mut now);
                std::mem::swap(&mut before, &mut now);
            }
        }
    }
    sums
}

struct Paths {
    planes: usize,
    jump: u16,
}

impl Paths {
    /// The path along a row.
    fn along(&self, sums: &mut [u16], costs: &[u8], backwards: bool) {
        let planes = self.planes;
        let cells = costs.len() / planes;
        let (mut before, mut now) = (vec![0u16; planes], vec![0u16; planes]);
        for i in 0..cells {
            let cell = if backwards { cells - 1 - i } else { i };
            let at = cell * planes..(cell + 1) * planes;
            self.step(&costs[at.clone()], &before, &mut now, &mut sums[at]);
            std::mem::swap(&mut before, &mut now);
        }
    }

    /// The paths from one row to the next, from the cell `lean` columns to the right.
    fn across(&self, sums: &mut [u16], costs: &[u8], lean: i64, before: &[u16], now: &mut [u16]) {
        let planes = self.planes;
        let border = vec![0u16; planes];
        let runs = sums.par_chunks_mut(RUN * planes).zip(costs.par_chunks(RUN * planes));
        runs.zip(now.par_chunks_mut(RUN * planes)).enumerate().for_each(|(run, ((sums, costs), now))| {
            let cells = sums.chunks_mut(planes).zip(costs.chunks(planes)).zip(now.chunks_mut(planes));
            for (i, ((sums, costs), now)) in cells.enumerate() {
                let from = usize::try_from((run * RUN + i) as i64 + lean).ok();
                let before = from.and_then(|cell| before.get(cell * planes..(cell + 1) * planes));
                self.step(costs, before.unwrap_or(&border), now, sums);
            }
        });
    }

    /// One cell of a path, added to its sums.
    fn step(&self, costs: &[u8], before: &[u16], now: &mut [u16], sums: &mut [u16]) {
        let least = before.iter().copied().min().unwrap_or(0);
        let n = now.len();
        for k in 0..n {
            now[k] = before[k].min(least + self.jump);
        }
        for k in 1..n {
            now[k] = now[k].min(before[k - 1] + STEP);
            now[k - 1] = now[k - 1].min(before[k] + STEP);
        }
        for k in 0..n {
            now[k] = now[k] - least + u16::from(costs[k]);
            sums[k] += now[k];
        }
    }
}
