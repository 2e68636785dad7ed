//! Resampling of a prediction to the grid of the truth: a window of whole cells is copied if the cells coincide, otherwise
//! values are interpolated bilinearly.

use super::MetricsError;
use crate::frame::{CenterPx, Pixel, Point, Transform};
use crate::io::{Grid2, MapGrid};

/// Largest offset between two grids that counts as none, cells (0.008 for the truth of JAX_068).
const WHOLE_CELL: f64 = 0.02;
/// Largest relative difference of cell sizes that counts as none: 0.01 cells over 10,000 cells.
const SAME_CELL: f64 = 1e-6;

/// How a raster was resampled to another grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Sampling {
    /// Cells were copied without interpolation.
    WholeCells,
    /// Values were interpolated bilinearly between cell centres.
    Bilinear,
    /// Values were interpolated bilinearly after a transform between two map projections.
    Reprojected,
}

/// Resamples `raster`, which lies on the grid `from`, to the grid `to`; NaN outside of `from`, and where the nearest cell is
/// NaN.
///
/// # Errors
/// [`MetricsError::Frame`] if PROJ knows no transform between the coordinate systems of the grids.
pub fn onto_grid(raster: &Grid2, from: &MapGrid, to: &MapGrid) -> Result<(Grid2, Sampling), MetricsError> {
    if from.epsg != to.epsg {
        let transform = Transform::new(to.epsg, from.epsg)?;
        let at = |p: Point<_>| {
            let (e, n) = transform.convert(p.x(), p.y());
            Point::new(e, n, 0.0)
        };
        return Ok((interpolated(raster, from, to, at), Sampling::Reprojected));
    }
    let (dx, dy) = ((to.west - from.west) / from.cell, (from.north - to.north) / from.cell);
    let near = |d: f64| (d - d.round()).abs() <= WHOLE_CELL;
    if (from.cell - to.cell).abs() <= SAME_CELL * to.cell && near(dx) && near(dy) {
        let (dx, dy) = (dx.round() as i64, dy.round() as i64);
        let cut = Grid2::from_rows(to.width, to.height, |row, line| {
            for (col, v) in line.iter_mut().enumerate() {
                *v = raster.get(col as i64 + dx, row as i64 + dy);
            }
        });
        return Ok((cut, Sampling::WholeCells));
    }
    Ok((interpolated(raster, from, to, |p| p), Sampling::Bilinear))
}

fn interpolated(
    raster: &Grid2,
    from: &MapGrid,
    to: &MapGrid,
    map: impl Fn(Point<crate::frame::Utm>) -> Point<crate::frame::Utm> + Sync,
) -> Grid2 {
    Grid2::from_rows(to.width, to.height, |row, line| {
        for (col, v) in line.iter_mut().enumerate() {
            let px: Pixel<CenterPx> = from.corner_px_from_utm(map(to.cell_center(col, row))).into();
            let is_place = px.col.is_finite() && px.row.is_finite();
            *v = if is_place { interpolate(raster, px.col, px.row) } else { f32::NAN };
        }
    })
}

/// Value at a position, interpolated bilinearly between those of the four surrounding cells that are valid; centres of
/// cells are at whole numbers. NaN if the nearest cell is NaN, so that a hole has the same size for every shift.
pub(super) fn interpolate(raster: &Grid2, col: f64, row: f64) -> f32 {
    let nearest = raster.get(col.round() as i64, row.round() as i64);
    if nearest.is_nan() {
        return f32::NAN;
    }
    let value = raster.bilinear(col, row);
    if !value.is_nan() {
        return value;
    }
    let (c, r) = (col.floor(), row.floor());
    let (fc, fr) = ((col - c) as f32, (row - r) as f32);
    let (c, r) = (c as i64, r as i64);
    let (mut sum, mut weight) = (0.0, 0.0);
    for (i, j, w) in
        [(0, 0, (1.0 - fc) * (1.0 - fr)), (1, 0, fc * (1.0 - fr)), (0, 1, (1.0 - fc) * fr), (1, 1, fc * fr)]
    {
        let v = raster.get(c + i, r + j);
        if !v.is_nan() {
            sum += w * v;
            weight += w;
        }
    }
    sum / weight
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(west: f64, north: f64, cell: f64, width: usize) -> MapGrid {
        MapGrid { epsg: 32617, west, north, cell, width, height: width }
    }

    fn ramp(g: &MapGrid) -> Grid2 {
        Grid2::from_fn(g.width, g.height, |c, r| {
            let p = g.cell_center(c, r);
            ((p.x() - 436_000.0) * 0.1 + (p.y() - 3_357_000.0) * 0.2) as f32
        })
    }

    #[test]
    fn a_window_of_whole_cells_keeps_its_values() {
        let from = grid(436_000.0, 3_357_100.0, 0.5, 40);
        let to = grid(436_002.004, 3_357_098.999, 0.5, 50);
        let (out, how) = onto_grid(&ramp(&from), &from, &to).unwrap();
        assert_eq!(how, Sampling::WholeCells);
        assert_eq!(out.at(0, 0), ramp(&from).at(4, 2));
        assert!(out.at(49, 0).is_nan());
    }

    #[test]
    fn other_grids_are_interpolated_at_cell_centres() {
        let from = grid(436_000.0, 3_357_100.0, 0.5, 40);
        let to = grid(436_003.1, 3_357_096.2, 0.3, 20);
        let (out, how) = onto_grid(&ramp(&from), &from, &to).unwrap();
        assert_eq!(how, Sampling::Bilinear);
        let expected = ramp(&to);
        for (a, b) in out.data.iter().zip(&expected.data) {
            assert!((a - b).abs() < 1e-4, "{a} {b}");
        }
    }

    #[test]
    fn a_hole_has_the_same_size_under_any_shift() {
        let from = grid(436_000.0, 3_357_100.0, 0.5, 40);
        let mut raster = ramp(&from);
        raster.data[20 * 40 + 20] = f32::NAN;
        for part in [0.05, 0.1, 0.2, 0.24] {
            let to = grid(436_005.0 + part, 3_357_095.0 - part, 0.5, 20);
            let (out, _) = onto_grid(&raster, &from, &to).unwrap();
            assert_eq!(out.valid().count(), 399, "{part}");
        }
    }

    #[test]
    fn another_zone_is_reprojected() {
        let from = grid(436_000.0, 3_357_100.0, 0.5, 400);
        let (e, n) = Transform::new(32617, 32616).unwrap().convert(436_100.0, 3_357_000.0);
        let to = MapGrid { epsg: 32616, ..grid(e - 5.0, n + 5.0, 0.5, 20) };
        let (out, how) = onto_grid(&ramp(&from), &from, &to).unwrap();
        assert_eq!(how, Sampling::Reprojected);
        let p = to.cell_center(3, 7);
        let (e, n) = Transform::new(32616, 32617).unwrap().convert(p.x(), p.y());
        let expected = (e - 436_000.0) * 0.1 + (n - 3_357_000.0) * 0.2;
        assert!((f64::from(out.at(3, 7)) - expected).abs() < 1e-3);
    }
}
