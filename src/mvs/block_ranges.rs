//! The planes that are tested on the rays of a view's pixels, block by block, and the strips in which the view is matched.

use super::plane_ranges::{Blocks, PlaneRanges};
use std::ops::Range;

/// Blocks of pixels with a common range of planes.
pub(super) const BLOCKS: Blocks = Blocks { columns: 64, rows: 32 };
/// Rows of blocks above and below a strip that are matched with it, so that the paths of semi-global matching have settled
/// where the strip begins: 64 rows of pixels.
const STRIP_MARGIN: usize = 64 / BLOCKS.rows;

/// The ranges of planes of the pixels of a view.
pub(super) struct BlockRanges {
    size: (usize, usize),
    /// Of each block, row by row.
    ranges: Vec<Range<usize>>,
}

impl BlockRanges {
    /// The ranges of all blocks of a view of this size (columns, rows), row by row.
    pub fn new(size: (usize, usize), ranges: Vec<Range<usize>>) -> Self {
        Self { size, ranges }
    }

    /// The ranges of some rows of blocks, as those of an image of their own.
    pub fn of_rows(&self, rows: Range<usize>) -> PlaneRanges {
        let across = BLOCKS.count(self.size).0;
        let height = (rows.end * BLOCKS.rows).min(self.size.1) - rows.start * BLOCKS.rows;
        let ranges = &self.ranges[rows.start * across..rows.end * across];
        PlaneRanges::of_blocks((self.size.0, height), BLOCKS, ranges)
    }

    /// Number of planes of all pixels of a row of blocks.
    fn volume(&self, row: usize) -> usize {
        let across = BLOCKS.count(self.size).0;
        let widths = (0..across).map(|k| BLOCKS.columns.min(self.size.0 - k * BLOCKS.columns));
        let of_row = self.ranges[row * across..(row + 1) * across].iter().zip(widths);
        BLOCKS.rows * of_row.map(|(range, width)| range.len() * width).sum::<usize>()
    }

    /// The rows of blocks of strips, and those that are matched with them: as many as fit into a volume of `most` entries, and at
    /// least one.
    pub fn strips(&self, most: f64) -> Vec<(Range<usize>, Range<usize>)> {
        let rows = BLOCKS.count(self.size).1;
        let with_margins =
            |own: &Range<usize>| own.start.saturating_sub(STRIP_MARGIN)..(own.end + STRIP_MARGIN).min(rows);
        let volume = |own: &Range<usize>| with_margins(own).map(|row| self.volume(row)).sum::<usize>() as f64;
        let mut out = Vec::new();
        let mut own = 0..1;
        while own.start < rows {
            while own.end < rows && volume(&(own.start..own.end + 1)) <= most {
                own.end += 1;
            }
            out.push((own.clone(), with_margins(&own)));
            own = own.end..own.end + 1;
        }
        out
    }
}
