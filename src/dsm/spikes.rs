//! Spikes of a matched surface: single heights that the cells around them contradict.
//!
//! Matching compares windows of pixels, so that a surface which is real covers several cells. Where images have no texture, on
//! water for example, views may agree on anything: single cells stand tens of metres above or below all others.

use crate::io::Grid2;

/// Half the side of the square of cells around a cell that are compared with it, metres.
const RADIUS_M: f64 = 4.0;
/// Difference from the median of these cells from which on a cell stands out, metres.
const OUTSTANDING_M: f32 = 4.0;
/// Smallest area of a surface, square metres: a chimney, or a window of matching of 3 x 3 pixels of half a metre.
const LEAST_AREA_M2: f64 = 2.25;
/// Where few cells around are known, this part of them is enough: the corner of a slope has as many on its side.
const LEAST_PART: usize = 10;
/// Largest radius in cells, which limits the time for fine grids.
const MOST_CELLS: i64 = 16;

/// 1 in the cells of a surface that are spikes, otherwise 0: they stand out from the median of the cells around them, of which
/// too few are nearer to their height than to the median. `altitude` is in metres, NaN where it is not known, `cell_m` the side of a cell.
pub(super) fn spikes(altitude: &Grid2, cell_m: f64) -> Grid2 {
    let radius = ((RADIUS_M / cell_m).ceil() as i64).clamp(2, MOST_CELLS);
    let least = (LEAST_AREA_M2 / cell_m.powi(2)).ceil().max(2.0) as usize;
    let is_spike = |col: i64, row: i64, around: &mut Vec<f32>| {
        let z = altitude.get(col, row);
        if z.is_nan() {
            return false;
        }
        around.clear();
        for r in row - radius..=row + radius {
            let line = (col - radius..=col + radius).map(|c| altitude.get(c, r));
            around.extend(line.filter(|z| !z.is_nan()));
        }
        let middle = around.len() / 2;
        let median = *around.select_nth_unstable_by(middle, f32::total_cmp).1;
        if (z - median).abs() <= OUTSTANDING_M {
            return false;
        }
        let alike = around.iter().filter(|other| (*other - z).abs() < (*other - median).abs()).count();
        alike < least.min(around.len() / LEAST_PART)
    };
    Grid2::from_rows(altitude.width, altitude.height, |row, line| {
        let mut around = Vec::new();
        for (col, out) in line.iter_mut().enumerate() {
            *out = f32::from(u8::from(is_spike(col as i64, row as i64, &mut around)));
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Level ground with a block and things on it, in cells of half a metre.
    fn town(extra: impl Fn(usize, usize) -> Option<f32>) -> Grid2 {
        Grid2::from_fn(60, 60, |col, row| {
            let is_block = (30..50).contains(&col) && (10..40).contains(&row);
            extra(col, row).unwrap_or(if is_block { 12.0 } else { 0.1 * (col % 3) as f32 })
        })
    }

    fn found(altitude: &Grid2) -> Vec<(usize, usize)> {
        let spikes = spikes(altitude, 0.5);
        (0..3600).filter(|i| spikes.data[*i] > 0.0).map(|i| (i % 60, i / 60)).collect()
    }

    #[test]
    fn needles_and_pits_are_spikes_and_blocks_chimneys_and_steps_are_none() {
        assert!(found(&town(|_, _| None)).is_empty(), "walls are no spikes");
        let needle = |col: usize, row: usize| match (col, row) {
            (10, 10) => Some(24.6),
            (10, 11) => Some(18.0),
            (11, 10) => Some(9.0),
            (20, 50) => Some(-15.0),
            _ => None,
        };
        assert_eq!(found(&town(needle)), [(10, 10), (11, 10), (10, 11), (20, 50)]);
        let chimney =
            |col: usize, row: usize| ((12..15).contains(&col) && (20..23).contains(&row)).then_some(20.0);
        assert!(found(&town(chimney)).is_empty());
        // A slope has few cells of one height, and none that stands out.
        let slope = Grid2::from_fn(60, 60, |col, row| 0.8 * (col + row) as f32);
        assert!(found(&slope).is_empty());
        // Crowns of trees vary from cell to cell, and are many.
        let crown = |col: usize, row: usize| {
            let apart = (col as f32 - 15.0).hypot(row as f32 - 15.0);
            (apart < 6.0).then(|| 9.0 - 0.5 * apart + ((col * 7 + row * 5) % 5) as f32 * 0.6)
        };
        assert!(found(&town(crown)).is_empty());
    }

    #[test]
    fn unknown_heights_are_no_spikes_and_do_not_count() {
        let lonely = Grid2::from_fn(60, 60, |col, row| if (col, row) == (5, 5) { 30.0 } else { f32::NAN });
        assert!(found(&lonely).is_empty());
    }
}
