//! Smooth surfaces over cells without values.

use crate::io::Grid2;

/// Sweeps over each level of the pyramid, which let the values of neighbouring blocks run into each other.
const SWEEPS: usize = 20;

/// Fills all NaN cells with a smooth surface through the others: values of a pyramid of means, relaxed towards the mean of
/// their four neighbours (a membrane) at each level from the coarsest one. A grid without any value is left as it is.
pub(super) fn fill_smoothly(values: Grid2) -> Grid2 {
    let unknown = values.data.iter().filter(|v| v.is_nan()).count();
    if unknown == 0 || unknown == values.data.len() {
        return values;
    }
    let coarse = fill_smoothly(values.halved_to_the_border());
    let last = [coarse.width, coarse.height].map(|n| n as f64 - 1.0);
    let mut filled = Grid2::from_rows(values.width, values.height, |row, line| {
        let y = ((row as f64 - 0.5) / 2.0).clamp(0.0, last[1]);
        for (col, out) in line.iter_mut().enumerate() {
            let value = values.at(col, row);
            let x = ((col as f64 - 0.5) / 2.0).clamp(0.0, last[0]);
            *out = if value.is_nan() { coarse.bilinear(x, y) } else { value };
        }
    });
    for _ in 0..SWEEPS {
        filled = relaxed(&filled, &values);
    }
    filled
}

/// One sweep: cells that are NaN in `values` get the mean of their neighbours.
fn relaxed(filled: &Grid2, values: &Grid2) -> Grid2 {
    let (width, height) = (filled.width, filled.height);
    Grid2::from_rows(width, height, |row, line| {
        let [above, here, below] =
            [row.saturating_sub(1), row, (row + 1).min(height - 1)].map(|r| filled.row(r));
        for (col, out) in line.iter_mut().enumerate() {
            *out = if values.at(col, row).is_nan() {
                let (left, right) = (here[col.saturating_sub(1)], here[(col + 1).min(width - 1)]);
                0.25 * (above[col] + below[col] + left + right)
            } else {
                here[col]
            };
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hole_of_a_plane_is_filled_with_the_plane_and_known_cells_stay() {
        let plane = Grid2::from_fn(41, 30, |col, row| 0.2 * col as f32 - 0.1 * row as f32);
        let mut holed = plane.clone();
        for (i, value) in holed.data.iter_mut().enumerate() {
            let (col, row) = (i % 41, i / 41);
            if (10..24).contains(&col) && (8..20).contains(&row) {
                *value = f32::NAN;
            }
        }
        let filled = fill_smoothly(holed.clone());
        let worst = filled.data.iter().zip(&plane.data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 0.15, "{worst}");
        let known = holed.data.iter().zip(&filled.data).filter(|(v, _)| !v.is_nan());
        assert!(known.clone().count() > 0 && known.into_iter().all(|(v, f)| v.to_bits() == f.to_bits()));
    }

    #[test]
    fn nothing_is_made_of_nothing_and_one_value_fills_all() {
        assert!(fill_smoothly(Grid2::filled(5, 3, f32::NAN)).data.iter().all(|v| v.is_nan()));
        let mut one = Grid2::filled(7, 5, f32::NAN);
        one.data[12] = 3.5;
        assert!(fill_smoothly(one).data.iter().all(|v| *v == 3.5));
    }
}
