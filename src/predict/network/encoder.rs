//! The encoder of groups of points: a PointNet (Qi et al. 2017) in the form of Point-BERT (Yu et al. 2022, `dvae.py`).
//!
//! A perceptron encodes each point of a group; the largest values over the group are appended to the code of each of its points;
//! a second perceptron follows, and the largest values over the group are the group's features (Point2GS, equation 3).

use super::blocks::{FeatureBlocks, sum_stripes};
use crate::nn::linear::BLOCK;
use crate::nn::mlp::{Mlp, MlpBlock, SharedMlp};
use crate::simd::{Real, Simd, SimdKernel, SimdReal};
use rayon::prelude::*;

/// Number of points of a group.
pub const GROUP: usize = 16;
/// Numbers of a point of a group: its place relative to the key point, and its colour.
pub const MEMBER_INPUTS: usize = 6;
/// Number of groups of a block of points, and number of blocks of points that have the groups of a block of key points.
const GROUPS: usize = BLOCK / GROUP;
const POINT_BLOCKS: usize = BLOCK / GROUPS;

/// The shape of the encoder.
pub struct Encoder {
    /// Number of features of a group.
    pub width: usize,
}

impl Encoder {
    pub fn points(&self) -> Mlp {
        Mlp { inputs: MEMBER_INPUTS, shared: 0, hidden: vec![self.width / 2], outputs: self.width }
    }

    pub fn groups(&self) -> Mlp {
        Mlp { inputs: 2 * self.width, shared: 0, hidden: vec![self.width], outputs: self.width }
    }

    /// Number of parameters.
    pub fn parameters(&self) -> usize {
        self.points().parameters() + self.groups().parameters()
    }

    /// Initial parameters.
    pub fn start<T: Real>(&self, seed: u64, purposes: [u64; 2]) -> Vec<T> {
        let mut values = self.points().start_all(seed, purposes[0]);
        values.extend(self.groups().start_all::<T>(seed, purposes[1]));
        values
    }

    /// Both perceptrons with their values.
    fn with<T: Real>(&self, values: &[T]) -> [SharedMlp<T>; 2] {
        let (points, groups) = values.split_at(self.points().parameters());
        [self.points().with(points, &[]), self.groups().with(groups, &[])]
    }
}

/// What the gradient needs of an evaluation.
pub struct EncoderState<T> {
    blocks: Vec<GroupBlock<T>>,
}

impl<T> Default for EncoderState<T> {
    fn default() -> Self {
        Self { blocks: Vec::new() }
    }
}

/// The values of a block of points, which are [`GROUPS`] groups.
#[derive(Default)]
struct GroupBlock<T> {
    points: MlpBlock<T>,
    /// Inputs of the second perceptron: codes of the points, and the largest ones of their group.
    joined: Vec<T>,
    groups: MlpBlock<T>,
    /// Which point of its group has the largest value, of each feature and group: after the first and the second perceptron.
    largest: [Vec<u8>; 2],
    /// The features of the groups.
    features: Vec<T>,
    /// Derivatives by the outputs of a perceptron.
    by: Vec<T>,
}

impl<T: SimdReal> EncoderState<T> {
    /// Writes the features of the groups to the first rows of `out`, an item for each group.
    pub fn forward(
        &mut self,
        encoder: &Encoder,
        values: &[T],
        members: &FeatureBlocks<T>,
        out: &mut FeatureBlocks<T>,
    ) {
        let networks = encoder.with(values);
        self.blocks.resize_with(members.count(), GroupBlock::default);
        self.blocks.par_iter_mut().zip(members.par_blocks()).for_each(|(block, members)| {
            T::dispatch(Forward { networks: &networks, block, members });
        });
        let width = encoder.width;
        let blocks = &self.blocks;
        out.par_blocks_mut().enumerate().for_each(|(k, out)| {
            for (part, block) in blocks[k * POINT_BLOCKS..].iter().take(POINT_BLOCKS).enumerate() {
                for feature in 0..width {
                    let to = feature * BLOCK + part * GROUPS;
                    out[to..to + GROUPS].copy_from_slice(&block.features[feature * GROUPS..][..GROUPS]);
                }
            }
        });
    }

    /// Adds the derivatives by the parameters that follow from those by the features of the groups, the first rows of
    /// `by_features`.
    pub fn backward(
        &mut self,
        encoder: &Encoder,
        values: &[T],
        members: &FeatureBlocks<T>,
        by_features: &FeatureBlocks<T>,
        by_values: &mut [T],
    ) {
        let networks = encoder.with(values);
        let of_points = networks[0].parameters();
        let items = self.blocks.par_iter_mut().zip(members.par_blocks()).enumerate();
        sum_stripes(items, by_values, |(k, (block, members)), by_values| {
            let by = by_values.split_at_mut(of_points);
            T::dispatch(Backward { networks: &networks, block, members, by_features, first: k * GROUPS, by });
        });
    }
}

/// The largest values over each group, of each feature of a block, and which of its points has them; the first of equal ones.
fn pool<T: Real>(values: &[T], largest: &mut Vec<u8>, out: &mut Vec<T>) {
    let features = values.len() / BLOCK;
    largest.resize(features * GROUPS, 0);
    out.resize(features * GROUPS, T::zero());
    let outputs = largest.chunks_exact_mut(GROUPS).zip(out.chunks_exact_mut(GROUPS));
    for (values, (largest, out)) in values.chunks_exact(BLOCK).zip(outputs) {
        for (group, values) in values.chunks_exact(GROUP).enumerate() {
            let mut best = 0;
            for k in 1..GROUP {
                if values[k] > values[best] {
                    best = k;
                }
            }
            (largest[group], out[group]) = (best as u8, values[best]);
        }
    }
}

/// The features of a block's groups.
struct Forward<'a, T> {
    networks: &'a [SharedMlp<T>; 2],
    block: &'a mut GroupBlock<T>,
    members: &'a [T],
}

impl<T: SimdReal> SimdKernel<T> for Forward<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let GroupBlock { points, joined, groups, largest, features, .. } = self.block;
        let codes = points.forward(simd, &self.networks[0], self.members);
        pool(codes, &mut largest[0], features);
        joined.resize(2 * codes.len(), T::zero());
        let (own, of_group) = joined.split_at_mut(codes.len());
        own.copy_from_slice(codes);
        for (points, largest) in of_group.chunks_exact_mut(GROUP).zip(&*features) {
            points.fill(*largest);
        }
        pool(groups.forward(simd, &self.networks[1], joined), &mut largest[1], features);
    }
}

/// The derivatives of a block by the parameters.
struct Backward<'a, T> {
    networks: &'a [SharedMlp<T>; 2],
    block: &'a mut GroupBlock<T>,
    members: &'a [T],
    by_features: &'a FeatureBlocks<T>,
    /// Index of the block's first group.
    first: usize,
    by: (&'a mut [T], &'a mut [T]),
}

impl<T: SimdReal> SimdKernel<T> for Backward<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let GroupBlock { points, joined, groups, largest, by, .. } = self.block;
        let width = joined.len() / (2 * BLOCK);
        by.clear();
        by.resize(width * BLOCK, T::zero());
        let existing = self.by_features.items().saturating_sub(self.first).min(GROUPS);
        for feature in 0..width {
            for group in 0..existing {
                let point = group * GROUP + usize::from(largest[1][feature * GROUPS + group]);
                by[feature * BLOCK + point] = self.by_features.at(feature, self.first + group);
            }
        }
        let by_joined = groups.backward(simd, &self.networks[1], joined, by, self.by.1);
        let (own, of_group) = by_joined.split_at(width * BLOCK);
        by.copy_from_slice(own);
        for (place, of_points) in of_group.chunks_exact(GROUP).enumerate() {
            let sum = of_points.iter().copied().sum::<T>();
            let point = place * GROUP + usize::from(largest[0][place]);
            by[point] = by[point] + sum;
        }
        points.backward(simd, &self.networks[0], self.members, by, self.by.0);
    }
}
