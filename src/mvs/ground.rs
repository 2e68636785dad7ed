//! The altitude of the ground, estimated from the sparse points of a scene.

use crate::frame::{Point, Site, SiteBox};
use crate::stats::quantile;

/// Quantile of the altitudes of all sparse points that is taken for a level ground plane.
const PLANE_QUANTILE: f64 = 0.02;
/// Side of the cells in which the ground is estimated, metres, and the quantile of the altitudes in a cell
/// that is taken for it.
const GROUND_CELL_M: f64 = 30.0;
const GROUND_QUANTILE: f64 = 0.1;

/// Altitude of a level ground plane, site metres: 2 % of the sparse points lie below it. It is 0 without points.
#[must_use]
pub fn ground_plane(sparse: &[Point<Site>]) -> f64 {
    quantile(sparse.iter().map(|p| p.z()).collect(), PLANE_QUANTILE).unwrap_or(0.0)
}

/// The altitude of the ground: a low quantile of the sparse points in each cell of 30 m, smoothed.
pub struct Ground {
    west: f64,
    south: f64,
    columns: usize,
    rows: usize,
    /// Altitudes at cell centres, row by row from the south.
    altitudes: Vec<f64>,
}

impl Ground {
    /// Estimates the ground of an area (site metres) from sparse points.
    #[must_use]
    pub fn new(sparse: &[Point<Site>], (west, south, east, north): SiteBox) -> Self {
        let plane = ground_plane(sparse);
        let columns = (((east - west) / GROUND_CELL_M).ceil() as usize).max(1);
        let rows = (((north - south) / GROUND_CELL_M).ceil() as usize).max(1);
        let mut cells = vec![Vec::new(); columns * rows];
        for p in sparse {
            let c = ((p.x() - west) / GROUND_CELL_M).floor();
            let r = ((p.y() - south) / GROUND_CELL_M).floor();
            if c >= 0.0 && r >= 0.0 && c < columns as f64 && r < rows as f64 {
                cells[r as usize * columns + c as usize].push(p.z());
            }
        }
        let low: Vec<Option<f64>> = cells.into_iter().map(|z| quantile(z, GROUND_QUANTILE)).collect();
        // Cells without points take the mean of the nearest cells with points.
        let filled: Vec<f64> = (0..columns * rows)
            .map(|i| nearest_mean(&low, columns, rows, i % columns, i / columns).unwrap_or(plane))
            .collect();
        let altitudes =
            (0..columns * rows).map(|i| smoothed(&filled, columns, rows, i % columns, i / columns));
        Self { west, south, columns, rows, altitudes: altitudes.collect() }
    }

    /// Altitude of the ground at a place (east and north, site metres): bilinear between the centres of
    /// cells, constant beyond them.
    #[must_use]
    pub fn altitude(&self, x: f64, y: f64) -> f64 {
        let axis = |v: f64, start: f64, n: usize| {
            let t = ((v - start) / GROUND_CELL_M - 0.5).clamp(0.0, n as f64 - 1.0);
            let i = (t.floor() as usize).min(n.saturating_sub(2));
            (i, (i + 1).min(n - 1), t - i as f64)
        };
        let (c0, c1, fx) = axis(x, self.west, self.columns);
        let (r0, r1, fy) = axis(y, self.south, self.rows);
        let at = |c: usize, r: usize| self.altitudes[r * self.columns + c];
        let line = |r: usize| at(c0, r) + (at(c1, r) - at(c0, r)) * fx;
        line(r0) + (line(r1) - line(r0)) * fy
    }
}

/// Mean of the known values in the smallest square of cells around a cell that contains any.
fn nearest_mean(cells: &[Option<f64>], columns: usize, rows: usize, col: usize, row: usize) -> Option<f64> {
    (0..columns.max(rows)).find_map(|reach| {
        let square = window(cells, columns, rows, col, row, reach);
        let known: Vec<f64> = square.flatten().collect();
        (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
    })
}

/// Mean of a cell and its eight neighbours.
fn smoothed(cells: &[f64], columns: usize, rows: usize, col: usize, row: usize) -> f64 {
    let values: Vec<f64> = window(cells, columns, rows, col, row, 1).collect();
    values.iter().sum::<f64>() / values.len() as f64
}

/// The values in the square of cells up to `reach` cells around a cell.
fn window<V: Copy>(
    cells: &[V],
    columns: usize,
    rows: usize,
    col: usize,
    row: usize,
    reach: usize,
) -> impl Iterator<Item = V> + '_ {
    let (r0, r1) = (row.saturating_sub(reach), (row + reach).min(rows - 1));
    let (c0, c1) = (col.saturating_sub(reach), (col + reach).min(columns - 1));
    (r0..=r1).flat_map(move |r| (c0..=c1).map(move |c| cells[r * columns + c]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::CounterRng;

    fn slope() -> Vec<Point<Site>> {
        (0..4000)
            .map(|i| {
                let mut d = CounterRng::new(5, 0, 0, i);
                let (x, y) = (200.0 * d.uniform() - 100.0, 160.0 * d.uniform() - 80.0);
                Point::new(x, y, 0.3 * x)
            })
            .collect()
    }

    #[test]
    fn the_ground_follows_a_slope() {
        let sparse = slope();
        let ground = Ground::new(&sparse, (-100.0, -80.0, 100.0, 80.0));
        for x in [-70.0, -20.0, 35.0, 70.0] {
            assert!((ground.altitude(x, 10.0) - 0.3 * x).abs() < 5.0, "{x}");
        }
    }
}
