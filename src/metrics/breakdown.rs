//! Parts of the land that are scored separately: classes, the mask, roof edges, slopes of the truth.

use super::scores::{PIECE, Sample};
use super::truth::class_codes;
use super::{Scores, Truth, class_name};
use crate::io::Grid2;
use rayon::prelude::*;
use serde::Serialize;

/// Class of buildings in DFC2019 and LAS.
pub(super) const BUILDING: u8 = 6;
/// Width of roof edges on either side of a building's outline, metres.
const EDGE_M: f64 = 1.0;
/// Limits of the classes of slope, degrees.
const SLOPES_DEG: [f64; 5] = [0.0, 5.0, 20.0, 45.0, 90.0];
/// Label of cells that belong to no part.
const NONE: u8 = u8::MAX;

/// Criterion by which the land is divided.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Division {
    /// The truth's classes.
    Class,
    /// Inside and outside of the user's mask.
    Mask,
    /// Within 1 m of the border between building and another class, and farther away.
    RoofEdge,
    /// Slope of the truth.
    Slope,
}

/// Scores of a part of the land.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PartScores {
    /// Criterion of the division.
    pub by: Division,
    /// Name of the part, for example `6 building`.
    pub name: String,
    /// Scores of the part.
    #[serde(flatten)]
    pub scores: Scores,
}

/// One division of the cells: names of the parts, and the part of each cell.
struct Labels {
    by: Division,
    names: Vec<String>,
    label: Vec<u8>,
}

impl Labels {
    /// Every division that the truth permits, water excluded; `cell` is the side of a cell, metres.
    fn all(truth: &Truth, cell: f64) -> Vec<Self> {
        let land = &truth.surface.height;
        let classes = truth.classes.as_ref();
        let edges = classes.filter(|c| c.contains(&BUILDING)).map(|c| Self::roof_edges(c, land, cell));
        [classes.map(|c| Self::classes(c)), truth.mask.as_ref().map(|m| Self::mask(m)), edges]
            .into_iter()
            .flatten()
            .chain([Self::slopes(land, cell)])
            .collect()
    }

    fn classes(classes: &[u8]) -> Self {
        let found = class_codes(classes);
        let mut place = [NONE; 256];
        for (i, class) in found.iter().enumerate().take(NONE.into()) {
            place[usize::from(*class)] = i as u8;
        }
        let names = found.iter().map(|c| format!("{c} {}", class_name(*c))).collect();
        let label = classes.par_iter().map(|c| place[usize::from(*c)]).collect();
        Self { by: Division::Class, names, label }
    }

    fn mask(inside: &[bool]) -> Self {
        let names = vec!["inside mask".into(), "outside mask".into()];
        Self { by: Division::Mask, names, label: inside.iter().map(|i| u8::from(!i)).collect() }
    }

    /// Labels the cells whose centre is within [`EDGE_M`] of a border between building and another class.
    fn roof_edges(classes: &[u8], land: &Grid2, cell: f64) -> Self {
        let (w, h) = (land.width, land.height);
        let is_building = |i: usize| classes[i] == BUILDING;
        // The change lies half a cell from the centres on its two sides.
        let reach = (EDGE_M / cell - 0.5).max(0.0);
        let span = reach.floor() as isize;
        let disc: Vec<(isize, isize)> = (-span..=span)
            .flat_map(|dy| (-span..=span).map(move |dx| (dx, dy)))
            .filter(|(dx, dy)| ((dx * dx + dy * dy) as f64) <= reach * reach)
            .collect();
        let mut is_rim = vec![false; w * h];
        is_rim.par_chunks_mut(w).enumerate().for_each(|(row, line)| {
            for (col, is_rim) in line.iter_mut().enumerate() {
                let i = row * w + col;
                let changes = |there: bool, j: usize| there && is_building(i) != is_building(j);
                *is_rim = changes(col + 1 < w, i + 1)
                    || changes(row + 1 < h, i + w)
                    || changes(col > 0, i.wrapping_sub(1))
                    || changes(row > 0, i.wrapping_sub(w));
            }
        });
        let mut label = vec![1; w * h];
        label.par_chunks_mut(w).enumerate().for_each(|(row, line)| {
            for (dx, dy) in &disc {
                let Some(rim) = row.checked_add_signed(*dy).filter(|r| *r < h).map(|r| &is_rim[r * w..][..w])
                else {
                    continue;
                };
                for (col, _) in rim.iter().enumerate().filter(|(_, is_rim)| **is_rim) {
                    if let Some(label) = col.checked_add_signed(*dx).and_then(|c| line.get_mut(c)) {
                        *label = 0;
                    }
                }
            }
        });
        let names = vec![format!("within {EDGE_M} m of a roof's edge"), "farther from roofs' edges".into()];
        Self { by: Division::RoofEdge, names, label }
    }

    fn slopes(land: &Grid2, cell: f64) -> Self {
        let mut label = vec![NONE; land.data.len()];
        // Tangents are compared, because arc tangents of a hundred million cells would take noticeable time.
        let steeper = SLOPES_DEG[1..SLOPES_DEG.len() - 1].iter().map(|s| s.to_radians().tan());
        let steeper: Vec<f64> = steeper.collect();
        label.par_chunks_mut(land.width).enumerate().for_each(|(row, line)| {
            for (col, label) in line.iter_mut().enumerate() {
                let slope = slope(land, col, row, cell);
                if !slope.is_nan() {
                    *label = steeper.iter().filter(|s| slope >= **s).count() as u8;
                }
            }
        });
        let names = SLOPES_DEG.windows(2).map(|s| format!("slope {} to {}°", s[0], s[1])).collect();
        Self { by: Division::Slope, names, label }
    }
}

/// All divisions combined: every cell belongs to one group, and every part of a division is a set of groups.
pub(super) struct Groups {
    divisions: Vec<(Division, Vec<String>)>,
    /// Group of each cell: its labels in all divisions as the digits of a number.
    group: Vec<u16>,
    groups: usize,
}

impl Groups {
    /// The groups of every division that the truth permits, water excluded; `cell_m` is the side of a cell, metres.
    pub(super) fn of(truth: &Truth, cell_m: f64) -> Self {
        Self::by(Labels::all(truth, cell_m), truth.surface.height.data.len())
    }

    fn by(divisions: Vec<Labels>, cells: usize) -> Self {
        let mut all = Self { divisions: Vec::new(), group: vec![0; cells], groups: 1 };
        for Labels { by, names, label } in divisions {
            // The last digit is for cells of no part.
            let digits = names.len() + 1;
            let add = |(group, label): (&mut u16, &u8)| {
                *group = *group * digits as u16 + u16::from(*label).min(names.len() as u16);
            };
            all.group.par_iter_mut().zip(&label).for_each(add);
            all.groups *= digits;
            all.divisions.push((by, names));
        }
        all
    }

    /// Scores of all land and of every part with land; errors are NaN where not scored.
    pub(super) fn scores(&self, land: &Grid2, errors: &Grid2, filled: &Grid2) -> (Scores, Vec<PartScores>) {
        let of_piece = |first: usize| {
            let mut samples = vec![Sample::default(); self.groups];
            for i in (first..(first + PIECE).min(self.group.len())).filter(|i| !land.data[*i].is_nan()) {
                samples[usize::from(self.group[i])].add(errors.data[i], filled.data[i]);
            }
            samples.iter_mut().for_each(Sample::sort);
            samples
        };
        let pieces: Vec<_> = (0..self.group.len()).into_par_iter().step_by(PIECE).map(of_piece).collect();
        let scores_of = |is_part: &dyn Fn(usize) -> bool| {
            let own = pieces.iter().flat_map(|samples| samples.iter().enumerate());
            Scores::of(
                &own.filter(|(group, _)| is_part(*group)).map(|(_, sample)| sample).collect::<Vec<_>>(),
            )
        };
        let mut place = self.groups;
        let mut parts = Vec::new();
        for (by, names) in &self.divisions {
            let digits = names.len() + 1;
            place /= digits;
            parts.extend(names.iter().enumerate().map(|(digit, name)| (by, name, place, digits, digit)));
        }
        let score = |(by, name, place, digits, digit): (&Division, &String, usize, usize, usize)| {
            let scores = scores_of(&|group| group / place % digits == digit);
            (scores.cells > 0).then(|| PartScores { by: *by, name: name.clone(), scores })
        };
        (scores_of(&|_| true), parts.into_par_iter().filter_map(score).collect())
    }
}

/// Slope at a cell, metres per metre, by central differences, one-sided where a neighbour is missing; NaN without
/// neighbours.
fn slope(land: &Grid2, col: usize, row: usize, cell: f64) -> f64 {
    let (c, r) = (col as i64, row as i64);
    let middle = land.at(col, row);
    let along = |before: f32, after: f32| {
        let (a, b) =
            (if before.is_nan() { middle } else { before }, if after.is_nan() { middle } else { after });
        let steps = 2 - u8::from(before.is_nan()) - u8::from(after.is_nan());
        f64::from(b - a) / (f64::from(steps) * cell)
    };
    let (x, y) =
        (along(land.get(c - 1, r), land.get(c + 1, r)), along(land.get(c, r - 1), land.get(c, r + 1)));
    (x * x + y * y).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_are_those_of_a_plane_also_at_the_rim() {
        let ramp = Grid2::from_fn(6, 5, |c, r| 0.5 * (c as f32 + r as f32));
        for (col, row) in [(0, 0), (5, 4), (3, 2)] {
            let slope = slope(&ramp, col, row, 0.5);
            assert!((slope - 2f64.sqrt()).abs() < 1e-6, "{slope}");
        }
        let labels = Labels::slopes(&ramp, 0.5);
        assert!(labels.label.iter().all(|l| labels.names[usize::from(*l)] == "slope 45 to 90°"));
    }

    #[test]
    fn a_roof_edge_reaches_a_metre_to_either_side() {
        // A roof of 10 x 10 cells of 0.5 m: two cells inside and two outside of its outline are within 1 m.
        let land = Grid2::filled(30, 30, 0.0);
        let is_roof = |i: usize| (10..20).contains(&(i % 30)) && (10..20).contains(&(i / 30));
        let classes: Vec<u8> = (0..900).map(|i| if is_roof(i) { BUILDING } else { 2 }).collect();
        let labels = Labels::roof_edges(&classes, &land, 0.5);
        let row: Vec<usize> = (0..30).filter(|c| labels.label[15 * 30 + c] == 0).collect();
        assert_eq!(row, [8, 9, 10, 11, 18, 19, 20, 21]);
        // Cells of 3 m: the cells on the two sides of the change.
        let coarse = Labels::roof_edges(&classes, &land, 3.0);
        let row: Vec<usize> = (0..30).filter(|c| coarse.label[15 * 30 + c] == 0).collect();
        assert_eq!(row, [9, 10, 19, 20]);
    }

    #[test]
    fn parts_are_scored_apart_and_nothing_is_lost() {
        let land = Grid2::from_fn(20, 10, |c, _| if c == 0 { f32::NAN } else { 1.0 });
        let inside: Vec<bool> = (0..200).map(|i| i % 20 < 5).collect();
        let errors = Grid2::from_fn(20, 10, |c, _| if c < 5 { 2.0 } else { -0.5 });
        let labels = Labels::mask(&inside);
        // Rows of the north, of the south, and the last of neither.
        let label =
            (0..200).map(|i| [0, 1, NONE][usize::from(i / 20 >= 5) + usize::from(i / 20 == 9)]).collect();
        let rows = Labels { by: Division::Slope, names: vec!["north".into(), "south".into()], label };
        let (all, parts) = Groups::by(vec![labels, rows], 200).scores(&land, &errors, &errors);
        assert_eq!(parts.iter().map(|p| p.scores.cells).collect::<Vec<_>>(), [40, 150, 95, 76]);
        assert_eq!((parts[0].scores.bias_m, parts[1].scores.bias_m), (2.0, -0.5));
        assert_eq!(all.cells, 190);
    }
}
