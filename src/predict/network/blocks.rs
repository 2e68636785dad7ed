//! Values of many items in the blocks that layers of networks take, and sums over blocks in a fixed order.

use crate::nn::linear::BLOCK;
use crate::simd::Real;
use rayon::prelude::*;

/// Number of stripes of blocks whose sums are made side by side; fixed, so that sums do not depend on the number of threads.
const STRIPES: usize = 8;

/// Values of items, feature by feature within blocks of [`BLOCK`] items; those after the last item are zero.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FeatureBlocks<T> {
    features: usize,
    items: usize,
    data: Vec<T>,
}

impl<T: Real> FeatureBlocks<T> {
    /// Zeros for so many features and items.
    #[must_use]
    pub fn zeros(features: usize, items: usize) -> Self {
        let mut out = Self::default();
        out.resize(features, items);
        out
    }

    /// The items' values, a row of equal length for each.
    pub fn of_rows(rows: &[impl AsRef<[T]>]) -> Self {
        let mut out = Self::zeros(rows.first().map_or(0, |row| row.as_ref().len()), rows.len());
        for (item, row) in rows.iter().enumerate() {
            for (feature, value) in row.as_ref().iter().enumerate() {
                *out.at_mut(feature, item) = *value;
            }
        }
        out
    }

    /// Gives the blocks a size. Values are unspecified if there were some before.
    pub fn resize(&mut self, features: usize, items: usize) {
        (self.features, self.items) = (features, items);
        self.data.resize(features * items.div_ceil(BLOCK) * BLOCK, T::zero());
    }

    /// Number of features.
    #[must_use]
    pub fn features(&self) -> usize {
        self.features
    }

    /// Number of items.
    #[must_use]
    pub fn items(&self) -> usize {
        self.items
    }

    /// Number of blocks.
    #[must_use]
    pub fn count(&self) -> usize {
        self.items.div_ceil(BLOCK)
    }

    /// One value.
    #[must_use]
    pub fn at(&self, feature: usize, item: usize) -> T {
        self.data[(item / BLOCK * self.features + feature) * BLOCK + item % BLOCK]
    }

    /// One value, mutable.
    pub fn at_mut(&mut self, feature: usize, item: usize) -> &mut T {
        &mut self.data[(item / BLOCK * self.features + feature) * BLOCK + item % BLOCK]
    }

    /// The blocks.
    pub fn par_blocks(&self) -> impl IndexedParallelIterator<Item = &[T]> {
        self.data.par_chunks_exact((self.features * BLOCK).max(1))
    }

    /// The blocks, mutable.
    pub fn par_blocks_mut(&mut self) -> impl IndexedParallelIterator<Item = &mut [T]> {
        self.data.par_chunks_exact_mut((self.features * BLOCK).max(1))
    }

    /// Copies the features of as many items to the rows from `first` on.
    pub fn copy_rows(&mut self, first: usize, from: &Self) {
        self.par_blocks_mut().zip(from.par_blocks()).for_each(|(to, from)| {
            to[first * BLOCK..][..from.len()].copy_from_slice(from);
        });
    }
}

/// Calls `add` for each item, with a vector of sums to add to, and adds all of these to `sums` in a fixed order.
pub fn sum_stripes<T: Real, I: Send>(
    items: impl IndexedParallelIterator<Item = I>,
    sums: &mut [T],
    add: impl Fn(I, &mut [T]) + Sync,
) {
    let items: Vec<I> = items.collect();
    let each = items.len().div_ceil(STRIPES).max(1);
    let mut stripes: Vec<Vec<I>> = Vec::new();
    let mut items = items.into_iter().peekable();
    while items.peek().is_some() {
        stripes.push(items.by_ref().take(each).collect());
    }
    let length = sums.len();
    let own: Vec<Vec<T>> = stripes
        .into_par_iter()
        .map(|stripe| {
            let mut own = vec![T::zero(); length];
            stripe.into_iter().for_each(|item| add(item, &mut own));
            own
        })
        .collect();
    for own in own {
        sums.iter_mut().zip(own).for_each(|(sum, by)| *sum = *sum + by);
    }
}
