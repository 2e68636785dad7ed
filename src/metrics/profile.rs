//! Height profiles through buildings: truth and prediction along a row of cells.

use super::Evaluation;
use super::breakdown::BUILDING;
use crate::io::Grid2;

/// Smallest building for a profile, square metres.
const LEAST_AREA_M2: f64 = 100.0;
/// Length of the profile on either side of the building, metres.
const AROUND_M: f64 = 15.0;

/// Heights along a row of the grid of the truth, from west to east.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// Mean absolute error over the building, metres.
    pub mae_m: f64,
    /// Easting and northing of the western end, metres.
    pub start: (f64, f64),
    /// Distance from the western end, true height and registered predicted height, metres; heights are NaN where there is
    /// none.
    pub heights: Vec<(f64, f32, f32)>,
}

/// The cells of one building.
struct Building {
    cells: Vec<usize>,
    mae_m: f64,
}

impl Evaluation {
    /// Profiles through the building with the largest MAE and through the one with the median MAE; `None` if the truth has no
    /// classes, or no building of at least 100 m².
    ///
    /// `errors` is the result of [`Evaluation::error_map`], in metres.
    #[must_use]
    pub fn profiles(&self, errors: &Grid2) -> Option<[Profile; 2]> {
        let least = (LEAST_AREA_M2 / (self.cell_m * self.cell_m)).ceil() as usize;
        let mut buildings = buildings(self.classes()?, errors, least);
        buildings.sort_by(|a, b| a.mae_m.total_cmp(&b.mae_m).then(a.cells[0].cmp(&b.cells[0])));
        let (worst, typical) = (buildings.last()?, &buildings[buildings.len() / 2]);
        Some([worst, typical].map(|b| self.profile(b, errors)))
    }

    /// The profile along the row with the most cells of the building.
    fn profile(&self, building: &Building, errors: &Grid2) -> Profile {
        let w = errors.width;
        let mut rows = std::collections::BTreeMap::<usize, usize>::new();
        for cell in &building.cells {
            *rows.entry(cell / w).or_default() += 1;
        }
        let longest = rows.iter().max_by_key(|(row, cells)| (**cells, std::cmp::Reverse(**row)));
        let row = longest.map_or(0, |(row, _)| *row);
        let cols = building.cells.iter().filter(|c| *c / w == row).map(|c| c % w);
        let (first, last) = cols.fold((w, 0), |(a, b), c| (a.min(c), b.max(c)));
        let around = (AROUND_M / self.cell_m) as usize;
        let cols = first.saturating_sub(around)..(last + around + 1).min(w);
        let start = self.grid.cell_center(cols.start, row);
        let heights = cols
            .clone()
            .map(|col| {
                let truth = self.land().at(col, row);
                ((col - cols.start) as f64 * self.cell_m, truth, truth + errors.at(col, row))
            })
            .collect();
        Profile { mae_m: building.mae_m, start: (start.x(), start.y()), heights }
    }
}

/// Buildings of at least `least` scored cells, as connected components (4-connectivity).
fn buildings(classes: &[u8], errors: &Grid2, least: usize) -> Vec<Building> {
    let (w, h) = (errors.width, errors.height);
    let mut is_new: Vec<bool> = classes.iter().map(|c| *c == BUILDING).collect();
    let mut found = Vec::new();
    for seed in 0..w * h {
        if !std::mem::take(&mut is_new[seed]) {
            continue;
        }
        let mut cells = vec![seed];
        let mut next = 0;
        while let Some(&cell) = cells.get(next) {
            next += 1;
            let (col, row) = (cell % w, cell / w);
            let mut visit = |there: bool, neighbour: usize| {
                if there && std::mem::take(&mut is_new[neighbour]) {
                    cells.push(neighbour);
                }
            };
            visit(col > 0, cell.wrapping_sub(1));
            visit(col + 1 < w, cell + 1);
            visit(row > 0, cell.wrapping_sub(w));
            visit(row + 1 < h, cell + w);
        }
        let scored = || cells.iter().map(|c| f64::from(errors.data[*c].abs())).filter(|e| !e.is_nan());
        let n = scored().count();
        if n >= least {
            let mae_m = scored().sum::<f64>() / n as f64;
            found.push(Building { cells, mae_m });
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buildings_that_touch_at_a_corner_are_separate() {
        // Buildings 1 and 2 touch at a corner; building 3 has a single cell.
        let map = ["11......", "11......", "..22...3", "..22...."].concat();
        let classes: Vec<u8> = map.bytes().map(|b| if b == b'.' { 2 } else { BUILDING }).collect();
        let data = map.bytes().map(|b| if b == b'1' { -2.0 } else { 0.5 }).collect();
        let found = buildings(&classes, &Grid2 { width: 8, height: 4, data }, 2);
        assert_eq!(found.iter().map(|b| (b.cells.len(), b.mae_m)).collect::<Vec<_>>(), [(4, 2.0), (4, 0.5)]);
    }
}
