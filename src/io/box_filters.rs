//! Sums, means, ranges and openings over the squares around the cells of a raster.

use super::Grid2;
use rayon::prelude::*;

/// Sums over the squares of `radius` cells around every cell, as far as they lie in the grid.
#[must_use]
pub fn box_sums(values: &Grid2, radius: usize) -> Grid2 {
    along_both_axes(values, |row, line| {
        let mut sum: f32 = row.iter().take(radius).sum();
        for (col, out) in line.iter_mut().enumerate() {
            sum += row.get(col + radius).unwrap_or(&0.0);
            *out = sum;
            sum -= col.checked_sub(radius).map_or(0.0, |first| row[first]);
        }
    })
}

/// Means over the squares of `radius` cells around every cell, as far as they lie in the grid.
#[must_use]
pub fn box_means(values: &Grid2, radius: usize) -> Grid2 {
    let mut means = box_sums(values, radius);
    let count = |at: usize, cells: usize| (at + radius + 1).min(cells) - at.saturating_sub(radius);
    for (i, mean) in means.data.iter_mut().enumerate() {
        let (col, row) = (i % values.width, i / values.width);
        *mean /= (count(col, values.width) * count(row, values.height)) as f32;
    }
    means
}

/// Highest minus lowest value of the squares of `radius` cells around every cell; NaN counts for nothing.
#[must_use]
pub fn box_ranges(values: &Grid2, radius: usize) -> Grid2 {
    let (mut range, low) = (extremes(values, radius, f32::max), extremes(values, radius, f32::min));
    range.data.iter_mut().zip(&low.data).for_each(|(high, low)| *high -= low);
    range
}

/// Morphological openings by squares of `radius` cells around every cell: the highest of the lowest values of the squares that
/// a cell lies in. What is narrower than such a square and higher than all around it is cut off; NaN counts for nothing.
#[must_use]
pub fn box_openings(values: &Grid2, radius: usize) -> Grid2 {
    extremes(&extremes(values, radius, f32::min), radius, f32::max)
}

/// Lowest or highest values of the squares, by `f32::min` or `f32::max`.
fn extremes(values: &Grid2, radius: usize, of_two: impl Fn(f32, f32) -> f32 + Copy + Sync) -> Grid2 {
    along_both_axes(values, |row, line| extremes_of_row(row, radius, of_two, line))
}

/// Extremes of the windows of `radius` cells around each cell of a row. The time does not depend on the radius: windows are
/// made of the end of one block of their length and the beginning of the next (van Herk 1992, doi:10.1016/0167-8655(92)90069-C).
fn extremes_of_row(row: &[f32], radius: usize, of_two: impl Fn(f32, f32) -> f32, line: &mut [f32]) {
    let window = 2 * radius + 1;
    // NaN is the neutral element of both. Cell `i` of the row is cell `i + radius` of this one.
    let mut padded = vec![f32::NAN; (row.len() + 2 * radius).next_multiple_of(window)];
    padded[radius..radius + row.len()].copy_from_slice(row);
    let mut backwards = padded.clone();
    for block in padded.chunks_mut(window) {
        let mut so_far = f32::NAN;
        for value in block {
            so_far = of_two(so_far, *value);
            *value = so_far;
        }
    }
    for block in backwards.chunks_mut(window) {
        let mut so_far = f32::NAN;
        for value in block.iter_mut().rev() {
            so_far = of_two(so_far, *value);
            *value = so_far;
        }
    }
    for (out, (end, start)) in line.iter_mut().zip(backwards.iter().zip(&padded[window - 1..])) {
        *out = of_two(*end, *start);
    }
}

/// Applies a filter of rows, which gets a row and writes another one, to the rows and then to the columns.
fn along_both_axes(values: &Grid2, of_row: impl Fn(&[f32], &mut [f32]) + Sync) -> Grid2 {
    let along_rows =
        |grid: &Grid2| Grid2::from_rows(grid.width, grid.height, |row, line| of_row(grid.row(row), line));
    transposed(&along_rows(&transposed(&along_rows(values))))
}

/// The grid with rows and columns exchanged. Some rows of the result are made together, so that the memory is read in lines.
fn transposed(grid: &Grid2) -> Grid2 {
    const ROWS_TOGETHER: usize = 16;
    let mut data = vec![0.0; grid.data.len()];
    data.par_chunks_mut(ROWS_TOGETHER * grid.height.max(1)).enumerate().for_each(|(block, rows)| {
        let first = block * ROWS_TOGETHER;
        let last = (first + ROWS_TOGETHER).min(grid.width);
        for row in 0..grid.height {
            for (line, value) in grid.row(row)[first..last].iter().enumerate() {
                rows[line * grid.height + row] = *value;
            }
        }
    });
    Grid2 { width: grid.height, height: grid.width, data }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The values within two cells of a place.
    fn near(values: &Grid2, col: usize, row: usize) -> Vec<f32> {
        let cells = (0..values.width).flat_map(|c| (0..values.height).map(move |r| (c, r)));
        let near = cells.filter(|(c, r)| c.abs_diff(col) <= 2 && r.abs_diff(row) <= 2);
        near.map(|(c, r)| values.at(c, r)).collect()
    }

    #[test]
    fn sums_means_and_ranges_are_those_of_the_squares_around_the_cells() {
        let values = Grid2::from_fn(7, 5, |col, row| ((3 * col + 10 * row) % 11) as f32);
        let (sums, means, ranges) = (box_sums(&values, 2), box_means(&values, 2), box_ranges(&values, 2));
        for (col, row) in [(0, 0), (3, 2), (6, 4), (1, 3)] {
            let near = near(&values, col, row);
            let sum = near.iter().sum::<f32>();
            assert_eq!(sums.at(col, row), sum, "{col} {row}");
            assert_eq!(means.at(col, row), sum / near.len() as f32, "{col} {row}");
            let high = near.iter().copied().fold(f32::NAN, f32::max);
            let low = near.iter().copied().fold(f32::NAN, f32::min);
            assert_eq!(ranges.at(col, row), high - low, "{col} {row}");
        }
    }

    #[test]
    fn openings_cut_off_what_is_narrower_than_their_squares() {
        let values = Grid2::from_fn(20, 12, |col, row| match (col, row) {
            (3..=5, 3..=5) => 9.0,
            (10..=14, 4..=9) => 7.0,
            _ => col as f32 * 0.1,
        });
        let opened = box_openings(&values, 2);
        for (i, (before, after)) in values.data.iter().zip(&opened.data).enumerate() {
            assert!(after <= before, "{i}");
        }
        assert!(opened.at(4, 4) < 1.0);
        assert_eq!(opened.at(12, 6), 7.0);
    }

    #[test]
    fn unknown_values_have_no_part_in_ranges() {
        let values = Grid2::from_fn(3, 1, |col, _| [2.0, f32::NAN, 5.0][col]);
        assert_eq!(box_ranges(&values, 1).data[1], 3.0);
        assert!(box_ranges(&Grid2::filled(3, 3, f32::NAN), 1).data[4].is_nan());
    }
}
