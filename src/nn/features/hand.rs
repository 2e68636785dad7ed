//! Features without weights: orientations of edges, colours and contrast of cells, relative to the whole picture.

use super::FeatureError;
use super::cells::{Cell, Cells, ORIENTATIONS};
use super::map::{DenseFeatures, FeatureMap, picture_size};
use crate::io::Grid2;
use rayon::prelude::*;

/// Values that describe a cell alone: the histogram of orientations, mean and deviation of two chromaticities, and two of
/// contrast.
const OWN: usize = ORIENTATIONS + 6;
/// Smallest cell, pixels.
const LEAST_CELL_PX: usize = 2;
/// Weight of the chromaticities against the histogram.
const CHROMA_WEIGHT: f32 = 0.5;
/// Least gradient, contrast of neighbouring cells and chromaticity that count as typical of a picture, so that noise is not
/// amplified where there is nothing else.
const LEAST_GRADIENT: f32 = 1e-3;
const LEAST_CONTRAST: f32 = 2e-3;
const LEAST_CHROMATICITY: f32 = 0.03;

/// Dense features that need no weights.
///
/// A cell is described by a histogram of the orientations of its gradients, weighted by the square root of their magnitude (in
/// the spirit of Dalal & Triggs 2005), by mean and deviation of its log-chromaticity, by how flat it is and by how much brighter
/// than its neighbours; this vector has length 1, and the mean of the neighbours' vectors follows it.
///
/// Contrast and chromaticity are measured in units of what is typical of the picture. A gain of the light and a constant added to
/// it therefore change the gradients' part not at all, and a gain of one colour hardly changes the rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HandFeatures {
    /// Side of a cell, pixels; at least 2. The default 8 suits satellite images of 0.3 to 0.5 m, where a car is about 15 x 6 px.
    pub cell_px: usize,
}

impl Default for HandFeatures {
    fn default() -> Self {
        Self { cell_px: 8 }
    }
}

impl DenseFeatures for HandFeatures {
    fn patch_px(&self) -> usize {
        self.cell_px
    }

    fn channels(&self) -> usize {
        2 * OWN
    }

    /// Cells at the right and lower border are described by the pixels and the neighbours that they have.
    fn extract(&mut self, rgb: &[Grid2; 3]) -> Result<FeatureMap, FeatureError> {
        picture_size(rgb)?;
        if self.cell_px < LEAST_CELL_PX {
            return Err(FeatureError::Cell { found: self.cell_px, least: LEAST_CELL_PX });
        }
        let cells = Cells::of(rgb, self.cell_px);
        let contrasts = contrasts(&cells);
        let typical = Typical::of(&cells, &contrasts);
        let each = cells.cells.par_iter().zip(&contrasts);
        let own: Vec<[f32; OWN]> = each.map(|(cell, contrast)| typical.describe(cell, *contrast)).collect();
        Ok(with_neighbours(&own, cells.width, cells.height))
    }
}

/// How much brighter each cell is than the mean of itself and its neighbours.
fn contrasts(cells: &Cells) -> Vec<f32> {
    let contrast = |(col, row): (usize, usize)| {
        let (mut sum, mut n) = (0.0, 0.0);
        for (c, r) in neighbourhood(col, row, cells.width, cells.height) {
            sum += cells.at(c, r).luminance;
            n += 1.0;
        }
        cells.at(col, row).luminance - sum / n
    };
    (0..cells.height).flat_map(|row| (0..cells.width).map(move |col| (col, row))).map(contrast).collect()
}

/// A cell and those around it that are in the picture, row by row.
fn neighbourhood(
    col: usize,
    row: usize,
    width: usize,
    height: usize,
) -> impl Iterator<Item = (usize, usize)> {
    let around = |at: usize, end: usize| at.saturating_sub(1)..(at + 2).min(end);
    around(row, height).flat_map(move |r| around(col, width).map(move |c| (c, r)))
}

/// What is typical of the cells of a picture.
struct Typical {
    gradient: f32,
    contrast: f32,
    /// Mean chromaticity: the colour of the light.
    chromaticity: [f32; 2],
    /// Mean absolute difference from it.
    saturation: f32,
}

impl Typical {
    fn of(cells: &Cells, contrasts: &[f32]) -> Self {
        let mean = |value: &dyn Fn(&Cell) -> f32| {
            let sum: f64 = cells.cells.iter().map(|cell| f64::from(value(cell))).sum();
            (sum / cells.cells.len() as f64) as f32
        };
        let chromaticity = [0, 1].map(|k| mean(&|cell| cell.chromaticity[k]));
        let differences = [0, 1].map(|k| mean(&|cell| (cell.chromaticity[k] - chromaticity[k]).abs()));
        let contrast = contrasts.iter().map(|c| f64::from(c.abs())).sum::<f64>() / contrasts.len() as f64;
        Self {
            gradient: mean(&|cell| cell.gradient).max(LEAST_GRADIENT),
            contrast: (contrast as f32).max(LEAST_CONTRAST),
            chromaticity,
            saturation: (0.5 * (differences[0] + differences[1])).max(LEAST_CHROMATICITY),
        }
    }

    /// The unit vector of a cell that is brighter than its neighbourhood by `contrast`.
    fn describe(&self, cell: &Cell, contrast: f32) -> [f32; OWN] {
        let mut own = [0.0; OWN];
        let (histogram, rest) = own.split_at_mut(ORIENTATIONS);
        // The histogram's length and the flatness are cosine and sine of one angle, as if being flat were an orientation more.
        let length = norm(&cell.orientations).max(f32::MIN_POSITIVE);
        let busy = share(cell.gradient, self.gradient) / length;
        for (value, orientation) in histogram.iter_mut().zip(cell.orientations) {
            *value = busy * orientation;
        }
        for k in 0..2 {
            rest[k] = CHROMA_WEIGHT * share(cell.chromaticity[k] - self.chromaticity[k], self.saturation);
            rest[2 + k] = CHROMA_WEIGHT * share(cell.deviation[k], self.saturation);
        }
        rest[4] = share(self.gradient, cell.gradient);
        rest[5] = share(contrast, self.contrast);
        let scale = norm(&own).recip();
        own.map(|value| scale * value)
    }
}

/// A value as a share of itself and what is typical, between -1 and 1.
fn share(value: f32, typical: f32) -> f32 {
    value / value.hypot(typical)
}

fn norm(values: &[f32]) -> f32 {
    values.iter().map(|v| v * v).sum::<f32>().sqrt()
}

/// Each cell's own vector, and the mean of those around it; zeros where there are none.
fn with_neighbours(own: &[[f32; OWN]], width: usize, height: usize) -> FeatureMap {
    let mut data = vec![0.0; 2 * OWN * own.len()];
    data.par_chunks_mut(2 * OWN * width).enumerate().for_each(|(row, line)| {
        for (col, vector) in line.chunks_exact_mut(2 * OWN).enumerate() {
            let (first, second) = vector.split_at_mut(OWN);
            first.copy_from_slice(&own[row * width + col]);
            let mut n = 0.0;
            for (c, r) in neighbourhood(col, row, width, height).filter(|at| *at != (col, row)) {
                n += 1.0;
                for (sum, value) in second.iter_mut().zip(own[r * width + c]) {
                    *sum += value;
                }
            }
            second.iter_mut().for_each(|sum| *sum /= f32::max(n, 1.0));
        }
    });
    FeatureMap { width, height, channels: 2 * OWN, data }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::uncertainty::{SCALE, dissimilarity};
    use crate::random::CounterRng;

    /// Streets, roofs and meadows, with the noise of a sensor; `car` is bright and 15 x 6 pixels large.
    fn town(car: bool, noise: u64, light: impl Fn(usize, f32) -> f32) -> [Grid2; 3] {
        let (width, height) = (203, 150);
        [0, 1, 2].map(|c| {
            let mut draw = CounterRng::new(3, c as u64, noise, 0);
            Grid2::from_fn(width, height, |col, row| {
                let roof = (col / 31 + row / 27) % 3 == 0;
                let meadow = !roof && (col / 31 + row / 27) % 3 == 1;
                let texture = 0.03 * ((0.7 * col as f32).sin() + (0.9 * row as f32 + 0.2 * col as f32).sin());
                let own = match (roof, meadow) {
                    (true, _) => [0.55, 0.42, 0.38][c],
                    (_, true) => [0.25, 0.33, 0.20][c] + texture,
                    _ => 0.35,
                };
                let is_car = car && (70..85).contains(&col) && (66..72).contains(&row);
                let value = if is_car { 0.75 } else { own };
                light(c, value) + 0.004 * draw.normal() as f32
            })
        })
    }

    fn differences(a: &[Grid2; 3], b: &[Grid2; 3]) -> Grid2 {
        let [a, b] = [a, b].map(|rgb| HandFeatures::default().extract(rgb).unwrap());
        dissimilarity(&a, &b, SCALE).unwrap()
    }

    #[test]
    fn other_light_is_hardly_seen_and_a_car_is() {
        let plain = town(false, 0, |_, v| v);
        let lights: [&dyn Fn(usize, f32) -> f32; 3] =
            [&|_, v| 0.7 * v + 0.1, &|_, v| 1.2 * v - 0.04, &|c, v| [0.9, 1.0, 1.1][c] * v];
        for (k, light) in lights.into_iter().enumerate() {
            let light_only = differences(&plain, &town(false, 1, light));
            let worst = light_only.data.iter().fold(0f32, |m, d| m.max(*d));
            assert!(worst < 0.04, "light {k}: {worst}");
            // The car covers parts of cells 8 to 10 in rows 8 and 9.
            let with_car = differences(&plain, &town(true, 1, light));
            let car = [8, 9, 10].map(|col| with_car.at(col, 8));
            assert!(car.iter().all(|d| *d > 0.5), "light {k}: {car:?}");
            assert!(with_car.at(4, 8) < 0.04 && with_car.at(9, 13) < 0.04);
        }
    }

    #[test]
    fn features_are_the_same_for_any_number_of_threads() {
        let rgb = town(true, 0, |_, v| v);
        let of = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| HandFeatures { cell_px: 5 }.extract(&rgb).unwrap())
        };
        let map = of(1);
        assert_eq!((map.width, map.height, map.data.len()), (41, 30, 28 * 41 * 30));
        assert_eq!(map, of(3));
    }

    #[test]
    fn pictures_without_content_have_features_and_wrong_ones_are_refused() {
        let mut features = HandFeatures::default();
        for value in [0.0, 1.0, f32::NAN, f32::INFINITY] {
            for (width, height) in [(1, 1), (17, 3)] {
                let plane = Grid2::filled(width, height, value);
                let map = features.extract(&[plane.clone(), plane.clone(), plane]).unwrap();
                assert!(map.data.iter().all(|v| v.is_finite()), "{value}, {width} x {height}");
                assert!((norm(&map.at(0, 0)[..OWN]) - 1.0).abs() < 1e-5);
            }
        }
        let (a, b) = (Grid2::filled(8, 6, 0.5), Grid2::filled(6, 8, 0.5));
        assert!(matches!(features.extract(&[a.clone(), b, a.clone()]), Err(FeatureError::Picture { .. })));
        let empty = Grid2::filled(0, 3, 0.5);
        assert!(matches!(
            features.extract(&[empty.clone(), empty.clone(), empty]),
            Err(FeatureError::Picture { .. })
        ));
        let mut fine = HandFeatures { cell_px: 1 };
        assert!(matches!(fine.extract(&[a.clone(), a.clone(), a]), Err(FeatureError::Cell { found: 1, .. })));
    }
}
