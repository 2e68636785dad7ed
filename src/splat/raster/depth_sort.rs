//! Sorting splats by depth with a least-significant-digit radix sort.
//!
//! The sort is written by hand because a comparison sort of `f32` keys takes several times as long, and because the order
//! must be the same for any number of threads: pieces have fixed bounds and equal keys keep their order.

use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Bits of one digit of a key.
const DIGIT_BITS: u32 = 11;
/// Digits of a key.
const DIGITS: usize = 2;
/// Number of different keys. Splats that span 200 m are told apart at 0.05 mm; splats closer than that share a key and
/// keep their order.
const KEYS: u32 = 1 << (DIGIT_BITS * DIGITS as u32);
/// Number of different values of a digit.
const BUCKETS: usize = 1 << DIGIT_BITS;
/// Largest number of pieces that are sorted in parallel.
const MAX_PIECES: usize = 16;
/// Smallest number of splats in a piece: every piece costs a sum over all buckets for each digit.
const MIN_PIECE: usize = 1 << 15;

/// The map from depths to integer keys below [`KEYS`]; the largest depth has key 0.
pub(super) struct DepthKeys {
    largest: f32,
    keys_per_unit: f32,
}

impl DepthKeys {
    /// The map whose keys span the range of these depths.
    pub fn new(depths: impl ParallelIterator<Item = f32>) -> Self {
        let span = |a: (f32, f32), b: (f32, f32)| (a.0.min(b.0), a.1.max(b.1));
        let (smallest, largest) = depths.map(|z| (z, z)).reduce(|| (f32::INFINITY, f32::NEG_INFINITY), span);
        Self { largest, keys_per_unit: KEYS as f32 / (largest - smallest) }
    }

    /// The key of a depth.
    pub fn key(&self, depth: f32) -> u32 {
        (((self.largest - depth) * self.keys_per_unit) as u32).min(KEYS - 1)
    }
}

/// Indices in the order of their keys, with the buffers of the sort.
///
/// An entry is a 64-bit integer with the key in its upper and the index in its lower half. Every piece counts the values of
/// a digit, and prefix sums of the counts tell each piece where its entries go. No place is written twice; the entries are
/// atomic only because several threads write to one array.
#[derive(Default)]
pub(super) struct RadixSort {
    entries: Vec<AtomicU64>,
    spare: Vec<AtomicU64>,
    /// Of each piece, the index at which the next entry of each bucket is written.
    offsets: Vec<[u32; BUCKETS]>,
}

impl RadixSort {
    /// Sorts keys below [`KEYS`], from the lowest digit to the highest; equal keys keep their order.
    ///
    /// The order of the previous iteration is not used: an optimiser step moves splats further in altitude than neighbours in
    /// the order lie apart, so little of it remains.
    pub fn sort(&mut self, keys: impl IndexedParallelIterator<Item = u32>) {
        let n = keys.len();
        self.entries.resize_with(n, AtomicU64::default);
        self.spare.resize_with(n, AtomicU64::default);
        self.entries.par_iter_mut().zip(keys).enumerate().for_each(|(i, (entry, key))| {
            *entry.get_mut() = u64::from(key) << u32::BITS | i as u64;
        });
        let piece = n.div_ceil(MAX_PIECES).max(MIN_PIECE);
        self.offsets.resize(n.div_ceil(piece), [0; BUCKETS]);
        for d in 0..DIGITS as u32 {
            let digit = |entry: u64| (entry >> (u32::BITS + d * DIGIT_BITS)) as usize % BUCKETS;
            let pieces = || self.entries.par_chunks(piece);
            self.offsets.par_iter_mut().zip(pieces()).for_each(|(counts, entries)| {
                counts.fill(0);
                for entry in entries {
                    counts[digit(entry.load(Relaxed))] += 1;
                }
            });
            let mut start = 0;
            for bucket in 0..BUCKETS {
                for offsets in &mut self.offsets {
                    start += std::mem::replace(&mut offsets[bucket], start);
                }
            }
            self.offsets.par_iter_mut().zip(pieces()).for_each(|(offsets, entries)| {
                for entry in entries {
                    let entry = entry.load(Relaxed);
                    let offset = &mut offsets[digit(entry)];
                    self.spare[*offset as usize].store(entry, Relaxed);
                    *offset += 1;
                }
            });
            std::mem::swap(&mut self.entries, &mut self.spare);
        }
    }

    /// The index at each place of the order.
    pub fn indices(&self) -> impl IndexedParallelIterator<Item = u32> + '_ {
        self.entries.par_iter().map(|entry| entry.load(Relaxed) as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_depth_has_the_smallest_key() {
        let mut depths = vec![3.0f32, -2.0, 0.0, -7.5, 100.0];
        let keys = DepthKeys::new(depths.clone().into_par_iter());
        depths.sort_by_key(|z| keys.key(*z));
        assert_eq!(depths, [100.0, 3.0, 0.0, -2.0, -7.5]);
        assert_eq!([100.0, -7.5].map(|z| keys.key(z)), [0, KEYS - 1]);
    }

    #[test]
    fn equal_and_non_finite_depths_have_keys_in_range() {
        for depths in [vec![], vec![2.5f32], vec![f32::NAN, 1.0, f32::INFINITY]] {
            let keys = DepthKeys::new(depths.clone().into_par_iter());
            assert!(depths.iter().all(|z| keys.key(*z) < KEYS));
        }
    }

    #[test]
    fn the_sort_is_stable_across_pieces() {
        // Few different keys for many splats, in more than one piece.
        let keys: Vec<u32> = (0..100_000u32).map(|i| i.wrapping_mul(2_654_435_761) & 0x3F_F00F).collect();
        let mut expected: Vec<u32> = (0..keys.len() as u32).collect();
        expected.sort_by_key(|i| keys[*i as usize]);
        let mut sort = RadixSort::default();
        sort.sort(keys.into_par_iter());
        assert_eq!(sort.indices().collect::<Vec<u32>>(), expected);
    }
}
