//! Which planes are tested where: a range of planes for every cell of a volume, the same within a block of cells.
//!
//! A volume holds the planes of one cell after those of the other, row by row (as tSGM; Rothermel et al. 2012).

use std::ops::Range;

/// The tested planes of every cell of a grid, or of every pixel of an image.
pub(super) struct PlaneRanges {
    /// Number of columns.
    pub width: usize,
    /// First plane of every cell.
    first: Vec<u16>,
    /// Index in the volume of the first plane of every cell, and the length of the volume.
    starts: Vec<usize>,
}

/// A grid cut into blocks of `columns` x `rows` cells, from the first column and row on.
#[derive(Clone, Copy)]
pub(super) struct Blocks {
    pub columns: usize,
    pub rows: usize,
}

impl Blocks {
    /// Number of blocks across and down a grid.
    pub fn count(self, (width, height): (usize, usize)) -> (usize, usize) {
        (width.div_ceil(self.columns), height.div_ceil(self.rows))
    }
}

impl PlaneRanges {
    /// All `planes` in every cell.
    pub fn uniform((width, height): (usize, usize), planes: usize) -> Self {
        let starts = (0..=width * height).map(|cell| cell * planes).collect();
        Self { width, first: vec![0; width * height], starts }
    }

    /// The ranges of the blocks of a grid, block by block from the upper left one on.
    pub fn of_blocks(size: (usize, usize), blocks: Blocks, ranges: &[Range<usize>]) -> Self {
        let (width, height) = size;
        let across = blocks.count(size).0;
        let (mut first, mut starts) = (Vec::with_capacity(width * height), vec![0]);
        let mut length = 0;
        for row in 0..height {
            for col in 0..width {
                let range = &ranges[row / blocks.rows * across + col / blocks.columns];
                first.push(range.start as u16);
                length += range.len();
                starts.push(length);
            }
        }
        Self { width, first, starts }
    }

    /// The range of each block of a grid that was made of these blocks.
    pub fn blocks(&self, blocks: Blocks) -> Vec<Range<usize>> {
        let (across, down) = blocks.count((self.width, self.rows()));
        let first =
            |block: usize| block / across * blocks.rows * self.width + block % across * blocks.columns;
        (0..across * down).map(|block| self.planes(first(block))).collect()
    }

    /// The planes that are tested in a cell.
    #[inline]
    pub fn planes(&self, cell: usize) -> Range<usize> {
        let first = usize::from(self.first[cell]);
        first..first + self.entries(cell..cell + 1).len()
    }

    /// The place of consecutive cells in the volume.
    #[inline]
    pub fn entries(&self, cells: Range<usize>) -> Range<usize> {
        self.starts[cells.start]..self.starts[cells.end]
    }

    /// The cells of a row.
    #[inline]
    pub fn row(&self, row: usize) -> Range<usize> {
        row * self.width..(row + 1) * self.width
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.first.len() / self.width.max(1)
    }

    /// Number of cells.
    pub fn cells(&self) -> usize {
        self.first.len()
    }

    /// Number of planes of all cells.
    pub fn volume(&self) -> usize {
        self.starts.last().copied().unwrap_or(0)
    }

    /// Cuts a volume, or a part of it, into consecutive pieces of these lengths.
    pub fn split<T>(mut volume: &mut [T], lengths: impl Iterator<Item = usize>) -> Vec<&mut [T]> {
        lengths
            .map(|length| {
                let (piece, rest) = std::mem::take(&mut volume).split_at_mut(length);
                volume = rest;
                piece
            })
            .collect()
    }
}

/// Where the surface may lie in a block, and the ground there.
pub(super) struct BlockAltitudes {
    /// Lowest and highest altitude that is tested, site metres; none where nothing is.
    pub tested: Option<(f64, f64)>,
    /// Lowest and highest altitude of the ground, site metres.
    pub ground: (f32, f32),
}

impl BlockAltitudes {
    /// Lowest and highest altitude of ground.
    pub fn bounds(ground: impl Iterator<Item = f32>) -> (f32, f32) {
        ground.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), z| (low.min(z), high.max(z)))
    }
}

/// The planes parallel to the ground that the altitudes of all blocks need, `step` metres apart: the height of the first one
/// above the ground, their number, and the range of each block.
pub(super) fn planes_for(blocks: &[BlockAltitudes], step: f32) -> (f32, usize, Vec<Range<usize>>) {
    let above = |block: &BlockAltitudes| {
        let (low, high) = block.tested?;
        Some((low as f32 - block.ground.1, high as f32 - block.ground.0))
    };
    let all = blocks.iter().filter_map(above).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
    let (low, high) = all.unwrap_or((0.0, 0.0));
    let plane = |height: f32| (height - low) / step;
    let range = |block: &BlockAltitudes| {
        above(block).map_or(0..0, |(low, high)| plane(low) as usize..plane(high).ceil() as usize + 1)
    };
    (low, plane(high).ceil() as usize + 1, blocks.iter().map(range).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_reach_from_the_lowest_altitude_over_high_ground_to_the_highest_over_low_ground() {
        let block = |tested, ground| BlockAltitudes { tested, ground };
        let blocks = [
            block(Some((8.0, 20.0)), (9.0, 12.0)),
            block(None, (0.0, 90.0)),
            block(Some((-7.0, 60.0)), (-10.0, -5.0)),
        ];
        let (low, planes, ranges) = planes_for(&blocks, 2.0);
        assert_eq!((low, planes), (-4.0, 38));
        assert_eq!(ranges, [0..9, 0..0, 1..38]);
    }

    #[test]
    fn cells_of_a_block_have_its_planes() {
        let blocks = Blocks { columns: 2, rows: 1 };
        assert_eq!(blocks.count((3, 2)), (2, 2));
        let ranges = PlaneRanges::of_blocks((3, 2), blocks, &[0..4, 2..3, 5..5, 1..3]);
        let planes: Vec<_> = (0..6).map(|cell| ranges.planes(cell)).collect();
        assert_eq!(planes, [0..4, 0..4, 2..3, 5..5, 5..5, 1..3]);
        assert_eq!(ranges.blocks(blocks), [0..4, 2..3, 5..5, 1..3]);
        assert_eq!((ranges.entries(ranges.row(0)), ranges.entries(ranges.row(1))), (0..9, 9..11));
        assert_eq!((ranges.rows(), ranges.volume()), (2, 11));
        assert_eq!(PlaneRanges::uniform((3, 2), 7).planes(4), 0..7);
    }
}
