//! Multi-resolution hash encoding of positions (Müller et al., Instant Neural Graphics Primitives, 2022), and its gradient.
//!
//! Each level is a cubic grid with features at its corners; the features of a position are interpolated linearly between the
//! eight corners around it. Corners of fine grids share entries of a table, by a hash of their indices. Positions are in the
//! unit cube. The gradient is by the tables only: colours do not pull at positions.

use super::linear::BLOCK;
use crate::random::CounterRng;
use crate::simd::Real;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Features of a corner, one level.
pub const FEATURES: usize = 4;
/// Initial entries are uniform between minus and plus this.
const START: f64 = 1e-4;
/// Factors of the hash of a corner's indices.
const PRIMES: [u32; 3] = [1, 2_654_435_761, 805_459_861];

/// The shape of the encoding.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HashGrid {
    /// Number of levels.
    pub levels: usize,
    /// Number of entries of each level's table: two to this power.
    pub log2_entries: u32,
    /// Number of cells along each axis of the coarsest and of the finest level.
    pub cells: [u32; 2],
}

/// The eight corners around a position: indices of their entries, and their weights.
type Corners<T> = [(usize, T); 8];

impl HashGrid {
    /// Number of features of a position.
    #[must_use]
    pub fn outputs(&self) -> usize {
        self.levels * FEATURES
    }

    /// Number of values of a level's table.
    #[must_use]
    pub fn level_parameters(&self) -> usize {
        FEATURES << self.log2_entries
    }

    /// Number of values of all tables.
    #[must_use]
    pub fn parameters(&self) -> usize {
        self.levels * self.level_parameters()
    }

    /// Initial values of the tables.
    #[must_use]
    pub fn start<T: Real>(&self, seed: u64, purpose: u64) -> Vec<T> {
        let mut draw = CounterRng::new(seed, purpose, 0, 0);
        (0..self.parameters()).map(|_| T::from_f64(START * (2.0 * draw.uniform() - 1.0))).collect()
    }

    /// Number of cells along each axis of a level; it grows geometrically from the first to the last.
    fn cells_of(&self, level: usize) -> u32 {
        let [first, last] = self.cells.map(f64::from);
        let share = level as f64 / (self.levels.max(2) - 1) as f64;
        // The power may fall just below a whole number.
        (first * (last / first).powf(share) + 1e-6) as u32
    }

    /// Computes the features of positions in the unit cube: for each block of [`BLOCK`] positions, feature by feature.
    /// Features of the last block beyond the last position are zero.
    pub fn encode<T: Real>(&self, tables: &[T], positions: &[[T; 3]], features: &mut Vec<T>) {
        let block_size = self.outputs() * BLOCK;
        features.resize(positions.len().div_ceil(BLOCK) * block_size, T::zero());
        let blocks = features.par_chunks_mut(block_size).zip(positions.par_chunks(BLOCK));
        blocks.for_each(|(features, positions)| {
            let levels = features.chunks_mut(FEATURES * BLOCK).zip(tables.chunks(self.level_parameters()));
            for (level, (features, table)) in levels.enumerate() {
                let cells = self.cells_of(level);
                for (i, position) in positions.iter().enumerate() {
                    let sum = interpolate(table, &self.corners(cells, *position));
                    (0..FEATURES).for_each(|f| features[f * BLOCK + i] = sum[f]);
                }
                for rest in features.chunks_mut(BLOCK) {
                    rest[positions.len()..].fill(T::zero());
                }
            }
        });
    }

    /// Computes the derivatives by the tables from those by the features, which are laid out as [`HashGrid::encode`] writes
    /// them. One task has one level and adds in the order of the positions.
    pub fn encode_backward<T: Real>(&self, positions: &[[T; 3]], by_features: &[T], by_tables: &mut [T]) {
        let block_size = self.outputs() * BLOCK;
        let levels = by_tables.par_chunks_mut(self.level_parameters()).enumerate();
        levels.with_max_len(1).for_each(|(level, by_table)| {
            let cells = self.cells_of(level);
            by_table.fill(T::zero());
            for (by_features, positions) in by_features.chunks(block_size).zip(positions.chunks(BLOCK)) {
                let by_features = &by_features[level * FEATURES * BLOCK..][..FEATURES * BLOCK];
                for (i, position) in positions.iter().enumerate() {
                    let by: [T; FEATURES] = std::array::from_fn(|f| by_features[f * BLOCK + i]);
                    if by == [T::zero(); FEATURES] {
                        continue;
                    }
                    for (entry, weight) in self.corners(cells, *position) {
                        let entry = &mut by_table[entry * FEATURES..][..FEATURES];
                        (0..FEATURES).for_each(|f| entry[f] = entry[f] + weight * by[f]);
                    }
                }
            }
        });
    }

    /// The corners around a position; positions outside of the unit cube are moved to its surface.
    #[inline(always)]
    fn corners<T: Real>(&self, cells: u32, position: [T; 3]) -> Corners<T> {
        let (mut low, mut part) = ([0u32; 3], [T::zero(); 3]);
        for k in 0..3 {
            let scaled = position[k].max(T::zero()).min(T::one()) * T::from_f64(f64::from(cells));
            low[k] = scaled.as_u32().min(cells - 1);
            part[k] = scaled - T::from_f64(f64::from(low[k]));
        }
        let mask = (1u32 << self.log2_entries) - 1;
        let is_dense = u64::from(cells + 1).pow(3) <= 1 << self.log2_entries;
        let mut corners = [(0, T::zero()); 8];
        for (c, corner) in corners.iter_mut().enumerate() {
            let (mut at, mut weight) = (low, T::one());
            for k in 0..3 {
                let is_high = c >> k & 1 == 1;
                at[k] += u32::from(is_high);
                weight = weight * if is_high { part[k] } else { T::one() - part[k] };
            }
            let index = if is_dense {
                at[0] + (cells + 1) * (at[1] + (cells + 1) * at[2])
            } else {
                let [x, y, z] = [0, 1, 2].map(|k| at[k].wrapping_mul(PRIMES[k]));
                (x ^ y ^ z) & mask
            };
            *corner = (index as usize, weight);
        }
        corners
    }
}

/// The features between corners.
#[inline(always)]
fn interpolate<T: Real>(table: &[T], corners: &Corners<T>) -> [T; FEATURES] {
    let mut sum = [T::zero(); FEATURES];
    for (entry, weight) in corners {
        let entry = &table[entry * FEATURES..][..FEATURES];
        (0..FEATURES).for_each(|f| sum[f] = sum[f] + *weight * entry[f]);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: HashGrid = HashGrid { levels: 4, log2_entries: 9, cells: [4, 37] };

    fn positions(n: usize) -> Vec<[f64; 3]> {
        let mut draw = CounterRng::new(1, 1, 0, 0);
        (0..n).map(|_| std::array::from_fn(|_| 1.1 * draw.uniform() - 0.05)).collect()
    }

    /// Tables with entries of the order of 1.
    fn tables() -> Vec<f64> {
        GRID.start::<f64>(0, 0).iter().map(|v| v / START).collect()
    }

    #[test]
    fn the_gradient_agrees_with_central_differences() {
        let (positions, tables) = (positions(700), tables());
        let mut features = Vec::new();
        GRID.encode(&tables, &positions, &mut features);
        let by: Vec<f64> = (0..features.len()).map(|i| (i as f64 * 0.37).sin()).collect();
        let mut by_tables = vec![f64::NAN; tables.len()];
        GRID.encode_backward(&positions, &by, &mut by_tables);
        let loss = |k: usize, step: f64| {
            let (mut tables, mut features) = (tables.clone(), Vec::new());
            tables[k] += step;
            GRID.encode(&tables, &positions, &mut features);
            let inside = |i: usize| i / (GRID.outputs() * BLOCK) * BLOCK + i % BLOCK < positions.len();
            let terms = features.iter().zip(&by).enumerate().filter(|(i, _)| inside(*i));
            terms.map(|(_, (f, by))| f * by).sum::<f64>()
        };
        for k in (0..tables.len()).step_by(97) {
            // The loss is linear in the tables.
            let expected = (loss(k, 0.5) - loss(k, -0.5)).abs();
            assert!((by_tables[k].abs() - expected).abs() < 1e-6 * expected.max(1.0), "{k}");
        }
    }

    #[test]
    fn features_are_continuous_across_cells_and_equal_the_corner_s_entry_at_a_corner() {
        let tables = tables();
        let at = |p: [f64; 3]| {
            let mut features = Vec::new();
            GRID.encode(&tables, &[p], &mut features);
            (0..GRID.outputs()).map(|f| features[f * BLOCK]).collect::<Vec<f64>>()
        };
        for x in [0.25, 0.5, 0.75, 1.0] {
            let (before, after) = (at([x - 1e-9, 0.4, 0.3]), at([x + 1e-9, 0.4, 0.3]));
            assert!(before.iter().zip(&after).all(|(a, b)| (a - b).abs() < 1e-6), "{x}");
        }
        let corner = at([0.5, 0.25, 0.75]);
        let entry = (2 + 5 * (1 + 5 * 3)) * FEATURES;
        assert!(corner[..FEATURES].iter().zip(&tables[entry..]).all(|(a, b)| (a - b).abs() < 1e-12));
    }
}
