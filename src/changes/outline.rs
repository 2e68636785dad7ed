//! The outline of connected cells.

use crate::io::MapGrid;
use std::collections::HashSet;

/// Steps along the sides of cells, columns and rows: east, south, west, north.
const STEPS: [(i64, i64); 4] = [(1, 0), (0, 1), (-1, 0), (0, -1)];

/// The outer outline of cells that are connected along their sides, clockwise on the map from the corner that is north-west of the
/// first cell; corners in the middle of a straight side are left out. `cells` are indices in order.
pub(super) fn outline(cells: &[usize], grid: &MapGrid) -> Vec<(f64, f64)> {
    let Some(&first) = cells.first() else { return Vec::new() };
    let place = |cell: usize| ((cell % grid.width) as i64, (cell / grid.width) as i64);
    let inside: HashSet<(i64, i64)> = cells.iter().map(|cell| place(*cell)).collect();
    let start = place(first);
    let (mut at, mut direction) = (start, 0);
    let mut corners = Vec::new();
    loop {
        corners.push(at);
        // Straight on with the region on the right, up to the next corner.
        loop {
            at = (at.0 + STEPS[direction].0, at.1 + STEPS[direction].1);
            let [right, left] = cells_ahead(at, direction);
            if !inside.contains(&right) {
                direction = (direction + 1) % 4;
                break;
            }
            if inside.contains(&left) {
                direction = (direction + 3) % 4;
                break;
            }
        }
        if at == start && direction == 0 {
            break;
        }
    }
    let on_map =
        |(col, row): (i64, i64)| (grid.west + col as f64 * grid.cell, grid.north - row as f64 * grid.cell);
    corners.into_iter().map(on_map).collect()
}

/// The cells on the right and on the left in front of a corner of cells, for a walk in one of the [`STEPS`].
fn cells_ahead((col, row): (i64, i64), direction: usize) -> [(i64, i64); 2] {
    match direction {
        0 => [(col, row), (col, row - 1)],
        1 => [(col - 1, row), (col, row)],
        2 => [(col - 1, row - 1), (col - 1, row)],
        _ => [(col, row - 1), (col - 1, row - 1)],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outline_of(rows: &[&str]) -> Vec<(f64, f64)> {
        let width = rows[0].len();
        let grid = MapGrid { epsg: 32631, west: 0.0, north: 0.0, cell: 1.0, width, height: rows.len() };
        let all: String = rows.concat();
        let cells: Vec<usize> = all.bytes().enumerate().filter(|(_, c)| *c == b'#').map(|(i, _)| i).collect();
        outline(&cells, &grid)
    }

    /// Area inside of a ring (shoelace formula); negative if it is clockwise.
    fn area(ring: &[(f64, f64)]) -> f64 {
        let next = ring.iter().cycle().skip(1);
        0.5 * ring.iter().zip(next).map(|(a, b)| a.0 * b.1 - b.0 * a.1).sum::<f64>()
    }

    #[test]
    fn an_outline_has_the_corners_and_the_area_of_its_cells() {
        assert_eq!(outline_of(&["#"]), [(0.0, 0.0), (1.0, 0.0), (1.0, -1.0), (0.0, -1.0)]);
        let shape = outline_of(&[".##.", "####", ".#.."]);
        assert_eq!(area(&shape), -7.0);
        assert_eq!(shape.len(), 12);
        // A hole is not cut out, unless it reaches the outside at a corner.
        assert_eq!(area(&outline_of(&["###", "#.#", "###"])), -9.0);
        assert_eq!(area(&outline_of(&["##.", "#.#", "###"])), -7.0);
    }
}
