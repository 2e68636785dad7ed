//! How far two tiles differ in the strip that they have in common.

use super::cut::SAME_SURFACE_M;
use crate::io::Grid2;
use crate::stats::{MAD_TO_SIGMA, quantile};
use base64::prelude::{BASE64_STANDARD, Engine};
use serde::{Deserialize, Serialize};

/// A difference of heights that is a gross error, metres.
const GROSS_M: f64 = 1.0;
/// Approximate number of cells of a strip whose colours are kept.
const COLOR_SAMPLES: usize = 1000;

/// A seam: the strip that two tiles have in common, and how far they differ there.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Seam {
    /// IDs of the tiles: the western and the eastern one, or the northern and the southern one.
    pub tiles: [String; 2],
    /// Ends of the border between the cores, (east, north) in metres.
    pub line: [[f64; 2]; 2],
    /// Median difference of heights, first minus second tile, metres; none without a common cell.
    pub median_m: Option<f64>,
    /// NMAD of the differences, metres: see [`MAD_TO_SIGMA`].
    pub nmad_m: Option<f64>,
    /// Share of the cells that differ by more than 1 m.
    pub over_1m: Option<f64>,
    /// Number of cells with heights of both tiles.
    pub cells: usize,
    /// Colours of both tiles in a part of the cells.
    pub colors: ColorPairs,
}

/// Pairs of colours of two tiles at the same cells: red, green, blue of the first, then of the second tile.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct ColorPairs(pub Vec<[u8; 6]>);

impl From<ColorPairs> for String {
    fn from(pairs: ColorPairs) -> Self {
        BASE64_STANDARD.encode(pairs.0.concat())
    }
}

impl TryFrom<String> for ColorPairs {
    type Error = base64::DecodeError;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        let bytes = BASE64_STANDARD.decode(text)?;
        let pairs = bytes.chunks_exact(6).map(|c| [c[0], c[1], c[2], c[3], c[4], c[5]]);
        Ok(Self(pairs.collect()))
    }
}

impl Seam {
    /// Compares two tiles over their common strip; grids hold heights in metres and red, green, blue as stored (1 to 255),
    /// NaN where there is none.
    pub(super) fn new(tiles: [String; 2], line: [[f64; 2]; 2], a: [&Grid2; 4], b: [&Grid2; 4]) -> Self {
        let pairs = a[0].data.iter().zip(&b[0].data);
        let differences: Vec<f64> =
            pairs.map(|(a, b)| f64::from(*a) - f64::from(*b)).filter(|d| !d.is_nan()).collect();
        let cells = differences.len();
        let gross = differences.iter().filter(|d| d.abs() > GROSS_M).count();
        let median_m = quantile(differences.clone(), 0.5);
        let deviations = |m: f64| quantile(differences.iter().map(|d| (d - m).abs()).collect(), 0.5);
        Self {
            tiles,
            line,
            median_m,
            nmad_m: median_m.and_then(deviations).map(|mad| MAD_TO_SIGMA * mad),
            over_1m: (cells > 0).then(|| gross as f64 / cells as f64),
            cells,
            colors: color_pairs(a, b),
        }
    }
}

/// Colours at regular intervals where both tiles show the same surface.
fn color_pairs(a: [&Grid2; 4], b: [&Grid2; 4]) -> ColorPairs {
    let (width, height) = (a[0].width, a[0].height);
    let step = (((width * height) as f64 / COLOR_SAMPLES as f64).sqrt() as usize).max(1);
    let cells = (0..height).step_by(step).flat_map(|row| (0..width).step_by(step).map(move |col| (col, row)));
    let pair = |(col, row): (usize, usize)| {
        let same = (a[0].at(col, row) - b[0].at(col, row)).abs() <= SAME_SURFACE_M;
        let values: [f32; 6] = std::array::from_fn(|i| [a, b][i / 3][1 + i % 3].at(col, row));
        (same && values.iter().all(|v| !v.is_nan()))
            .then(|| values.map(|v| v.round().clamp(0.0, 255.0) as u8))
    };
    ColorPairs(cells.filter_map(pair).collect())
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in crate::tiles) fn seam(height: impl Fn(usize) -> f32) -> Seam {
        let a = Grid2::from_fn(20, 10, |col, _| height(col));
        let (b, gray) = (Grid2::filled(20, 10, 10.0), Grid2::filled(20, 10, 100.0));
        let bright = Grid2::filled(20, 10, 104.0);
        let line = [[0.0, 0.0], [0.0, 5.0]];
        Seam::new(["a".into(), "b".into()], line, [&a, &gray, &gray, &gray], [&b, &bright, &bright, &bright])
    }

    #[test]
    fn the_step_is_the_median_and_gross_differences_are_counted() {
        let s = seam(|col| {
            if col == 0 {
                14.0
            } else if col == 1 {
                f32::NAN
            } else {
                10.25
            }
        });
        assert_eq!((s.median_m, s.nmad_m, s.cells), (Some(0.25), Some(0.0), 190));
        assert!((s.over_1m.unwrap() - 10.0 / 190.0).abs() < 1e-12);
        assert_eq!(s.colors.0.len(), 180, "cells that show the same surface");
    }

    #[test]
    fn a_seam_is_the_same_after_it_was_written_and_read() {
        let s = seam(|_| 10.1);
        let text = serde_json::to_string(&s).unwrap();
        assert_eq!(serde_json::from_str::<Seam>(&text).unwrap(), s);
    }
}
