//! Shiftable windows (Bobick and Intille 1999): a cell may be matched by the window of a cell beside it.
//!
//! Around a cell at the foot of a wall every centred window shows the roof too, whose texture is stronger: the roof grows, and the
//! ground beside it is lost. A window moved away from the wall shows the ground alone.

use super::correlation::CostVolume;
use super::plane_ranges::PlaneRanges;
use super::plane_sweep::PlaneStack;
use rayon::prelude::*;

/// Cost of the window of a neighbour beside that of the cell itself, which is taken where both fit about as well.
const SHIFT_COST: u8 = 5;
/// Offsets (right, down) of the cells whose windows are taken.
const NEIGHBOURS: [(i64, i64); 4] = [(1, 0), (-1, 0), (0, 1), (0, -1)];

impl CostVolume<'_> {
    /// Lowers the cost of each cell at each altitude to that of the best of its own window and those of its four neighbours.
    /// `width` is the number of columns of the grid. Planes that no pair of views sees stay so.
    pub(super) fn shift_windows(&mut self, stack: &PlaneStack, width: usize) {
        let ranges = self.ranges;
        let height = ranges.cells() / width.max(1);
        let mut shifted = self.costs.clone();
        let lengths = (0..ranges.cells()).map(|cell| ranges.planes(cell).len());
        PlaneRanges::split(&mut shifted, lengths).into_par_iter().enumerate().for_each(|(cell, costs)| {
            let (col, row) = ((cell % width) as i64, (cell / width) as i64);
            for (right, down) in NEIGHBOURS {
                let (c, r) = (col + right, row + down);
                if !(0..width as i64).contains(&c) || !(0..height as i64).contains(&r) {
                    continue;
                }
                let neighbour = r as usize * width + c as usize;
                // Planes are parallel to the ground, whose altitude differs from cell to cell.
                let rise = (stack.ground.data[cell] - stack.ground.data[neighbour]) / stack.step;
                let (own, of_other) =
                    (ranges.planes(cell).start as i64, ranges.planes(neighbour).start as i64);
                take_better(costs, self.cell(neighbour), own + rise.round() as i64 - of_other);
            }
            for (cost, before) in costs.iter_mut().zip(self.cell(cell)) {
                *cost = if *before == Self::UNSEEN { Self::UNSEEN } else { *cost };
            }
        });
        self.costs = shifted;
    }
}

/// Lowers the costs to those of a neighbour, whose plane `k + offset` is at the altitude of plane `k`.
fn take_better(costs: &mut [u8], of_neighbour: &[u8], offset: i64) {
    let (skipped, skipped_there) = ((-offset).max(0) as usize, offset.max(0) as usize);
    let costs = costs.iter_mut().skip(skipped);
    for (cost, other) in costs.zip(of_neighbour.iter().skip(skipped_there)) {
        *cost = (*cost).min(other.saturating_add(SHIFT_COST));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::Grid2;

    /// The costs of two cells side by side with four planes each, the ground of the second `rise` metres above that of the first.
    fn shifted(costs: [[u8; 4]; 2], rise: f32) -> Vec<u8> {
        let ranges = PlaneRanges::uniform((2, 1), 4);
        let stack =
            PlaneStack { ground: Grid2 { width: 2, height: 1, data: vec![0.0, rise] }, low: 0.0, step: 0.5 };
        let mut volume = CostVolume { ranges: &ranges, costs: costs.concat() };
        volume.shift_windows(&stack, 2);
        volume.costs
    }

    #[test]
    fn a_cell_takes_the_better_window_of_its_neighbour_at_the_same_altitude() {
        let level = shifted([[200, 200, 200, 200], [250, 20, 250, 250]], 0.0);
        assert_eq!(level, [200, 25, 200, 200, 205, 20, 205, 205]);
        let raised = shifted([[200, 200, 200, 200], [250, 20, 250, 250]], 0.5);
        assert_eq!(raised, [200, 200, 25, 200, 205, 20, 205, 250]);
    }

    #[test]
    fn what_no_pair_of_views_sees_stays_unseen_and_lends_nothing() {
        let unseen = CostVolume::UNSEEN;
        assert_eq!(
            shifted([[unseen, 100, 100, 254], [30, unseen, 100, 254]], 0.0),
            [unseen, 100, 100, 254, 30, unseen, 100, 254]
        );
    }
}
