//! Sums, means and ranges over the squares around the cells of a raster.

use super::Grid2;

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
    let extreme = |of_two: fn(f32, f32) -> f32| {
        along_both_axes(values, |row, line| {
            for (col, out) in line.iter_mut().enumerate() {
                let window = col.saturating_sub(radius)..(col + radius + 1).min(row.len());
                *out = row[window].iter().copied().fold(f32::NAN, of_two);
            }
        })
    };
    let (mut range, low) = (extreme(f32::max), extreme(f32::min));
    range.data.iter_mut().zip(&low.data).for_each(|(high, low)| *high -= low);
    range
}

/// Applies a filter of rows, which gets a row and writes another one, to the rows and then to the columns.
fn along_both_axes(values: &Grid2, of_row: impl Fn(&[f32], &mut [f32]) + Sync) -> Grid2 {
    let along_rows =
        |grid: &Grid2| Grid2::from_rows(grid.width, grid.height, |row, line| of_row(grid.row(row), line));
    let transposed = |grid: &Grid2| Grid2::from_fn(grid.height, grid.width, |col, row| grid.at(row, col));
    transposed(&along_rows(&transposed(&along_rows(values))))
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
    fn unknown_values_have_no_part_in_ranges() {
        let values = Grid2::from_fn(3, 1, |col, _| [2.0, f32::NAN, 5.0][col]);
        assert_eq!(box_ranges(&values, 1).data[1], 3.0);
        assert!(box_ranges(&Grid2::filled(3, 3, f32::NAN), 1).data[4].is_nan());
    }
}
