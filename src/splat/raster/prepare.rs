//! What all cameras of an iteration share: the altitude order, covariances, opacities; and the way back from
//! their gradients to the parameters.

use crate::camera::CameraKernel;
use crate::simd::Real;
use crate::simd::{Arithmetic, MAX_LANES, Simd, SimdKernel, SimdMask, SimdReal, SimdVec, broadcast_each};
use crate::splat::splats::Splats;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};

/// Splats that one task works on.
const PIECE: usize = 64 * MAX_LANES;

/// Splats in order of altitude, highest first, ready to be projected.
#[derive(Default)]
pub struct SortedSplats<T> {
    /// Index of the splat at each rank.
    order: Vec<u32>,
    /// Rank of each splat.
    rank: Vec<AtomicU32>,
    sorted: Order,
    pub(super) blocks: Vec<SplatBlock<T>>,
    /// Sum of the opacities of each piece.
    opacities: Vec<f64>,
}

/// Splats of [`MAX_LANES`] successive ranks as every camera needs them, a lane each. Aligned: a row is a register.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(super) struct SplatBlock<T> {
    pub position: [[T; MAX_LANES]; 3],
    /// xx, xy, xz, yy, yz, zz; m².
    pub covariance: [[T; MAX_LANES]; 6],
    /// Zero beyond the last splat.
    pub opacity: [T; MAX_LANES],
}

impl<T: Real> Default for SplatBlock<T> {
    fn default() -> Self {
        let zero = [T::zero(); MAX_LANES];
        Self { position: [zero; 3], covariance: [zero; 6], opacity: zero }
    }
}

/// Derivatives of the loss by what [`SortedSplats`] holds of one splat.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SplatGradient<T> {
    /// By the centre.
    pub position: [T; 3],
    /// By the covariance's elements xx, xy, xz, yy, yz, zz, the matrix taken as nine independent numbers.
    pub covariance: [T; 6],
    /// By the opacity's logarithm.
    pub log_opacity: T,
}

/// Bits of a digit that splats are sorted by.
const DIGIT: u32 = 11;
/// Digits of a key.
const DIGITS: usize = 2;
/// Altitudes that are told apart: 0.05 mm where splats span 200 m. Splats closer than that keep their order.
const STEPS: u32 = 1 << (DIGIT * DIGITS as u32);

/// From altitudes to whole numbers below [`STEPS`], the highest first.
struct Keys {
    highest: f32,
    steps_per_m: f32,
}

impl Keys {
    /// For these altitudes.
    fn new(altitudes: impl ParallelIterator<Item = f32>) -> Self {
        let span = |a: (f32, f32), b: (f32, f32)| (a.0.min(b.0), a.1.max(b.1));
        let (lowest, highest) = altitudes.map(|z| (z, z)).reduce(|| (f32::INFINITY, f32::NEG_INFINITY), span);
        Self { highest, steps_per_m: STEPS as f32 / (highest - lowest) }
    }

    fn of(&self, altitude: f32) -> u32 {
        (((self.highest - altitude) * self.steps_per_m) as u32).min(STEPS - 1)
    }
}

/// Values of a digit.
const VALUES: usize = 1 << DIGIT;
/// Most pieces that are sorted side by side.
const SORTED_PIECES: usize = 16;
/// Least splats of a piece: each costs a sum over all values of a digit.
const SORTED_SPLATS: usize = 1 << 15;

/// Splats in order of their keys, ties left as they come.
///
/// Keys stand above indices in one number. Every piece of them counts its digits, and so knows where its own go;
/// that all threads write into one array takes atomic numbers, though none is written twice.
#[derive(Default)]
struct Order {
    entries: Vec<AtomicU64>,
    spare: Vec<AtomicU64>,
    /// Of each piece, where the next entry of each digit goes.
    places: Vec<[u32; VALUES]>,
}

impl Order {
    /// Sorts keys below [`STEPS`] digit by digit from the lowest. Its time does not depend on how much is left of the
    /// last iteration's order: as steps are wider than the distance of splats in altitude, that is little.
    fn sort(&mut self, keys: impl IndexedParallelIterator<Item = u32>) {
        let n = keys.len();
        self.entries.resize_with(n, AtomicU64::default);
        self.spare.resize_with(n, AtomicU64::default);
        self.entries.par_iter_mut().zip(keys).enumerate().for_each(|(i, (entry, key))| {
            *entry.get_mut() = u64::from(key) << u32::BITS | i as u64;
        });
        let piece = n.div_ceil(SORTED_PIECES).max(SORTED_SPLATS);
        self.places.resize(n.div_ceil(piece), [0; VALUES]);
        for d in 0..DIGITS as u32 {
            let digit = |entry: u64| (entry >> (u32::BITS + d * DIGIT)) as usize % VALUES;
            let pieces = || self.entries.par_chunks(piece);
            self.places.par_iter_mut().zip(pieces()).for_each(|(counts, entries)| {
                counts.fill(0);
                for entry in entries {
                    counts[digit(entry.load(Relaxed))] += 1;
                }
            });
            let mut start = 0;
            for value in 0..VALUES {
                for places in &mut self.places {
                    start += std::mem::replace(&mut places[value], start);
                }
            }
            self.places.par_iter_mut().zip(pieces()).for_each(|(places, entries)| {
                for entry in entries {
                    let entry = entry.load(Relaxed);
                    let place = &mut places[digit(entry)];
                    self.spare[*place as usize].store(entry, Relaxed);
                    *place += 1;
                }
            });
            std::mem::swap(&mut self.entries, &mut self.spare);
        }
    }
}

impl<T: Real> SortedSplats<T> {
    /// Centre (m) and covariance (xx, xy, xz, yy, yz, zz; m²) of the splat at a rank.
    #[inline(always)]
    pub(super) fn position_and_covariance(&self, rank: usize) -> ([T; 3], [T; 6]) {
        let (block, lane) = (&self.blocks[rank / MAX_LANES], rank % MAX_LANES);
        (block.position.map(|p| p[lane]), block.covariance.map(|c| c[lane]))
    }
}

impl<T: SimdReal> SortedSplats<T> {
    /// Number of splats.
    #[must_use]
    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.order.is_empty()
    }

    /// Index of the splat at each rank.
    #[must_use]
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// Orders the splats by altitude, as all parallel projections see them, and computes what cameras share.
    pub fn update(&mut self, gaussians: &Splats<T>) {
        self.update_by(gaussians, |position| position[2]);
    }

    /// Orders the splats for one camera, and computes what cameras share.
    pub fn update_for(&mut self, gaussians: &Splats<T>, camera: &impl CameraKernel<T>) {
        self.update_by(gaussians, |position| camera.depth_key(position));
    }

    /// Orders the splats by a depth key, the largest first.
    fn update_by(&mut self, gaussians: &Splats<T>, key: impl Fn([T; 3]) -> T + Sync) {
        let n = gaussians.len();
        let depths = gaussians.position.par_iter().with_min_len(PIECE).map(|p| key(*p).as_f64() as f32);
        let keys = Keys::new(depths.clone());
        self.sorted.sort(depths.map(|depth| keys.of(depth)));
        self.order.resize(n, 0);
        self.rank.resize_with(n, AtomicU32::default);
        let order = self.order.par_iter_mut().zip(&self.sorted.entries).with_min_len(PIECE);
        order.enumerate().for_each(|(rank, (splat, entry))| {
            *splat = entry.load(Relaxed) as u32;
            self.rank[*splat as usize].store(rank as u32, Relaxed);
        });
        let order = &self.order;
        self.blocks.resize(n.div_ceil(MAX_LANES), SplatBlock::default());
        self.opacities.resize(n.div_ceil(PIECE), 0.0);
        let blocks = self.blocks.par_chunks_mut(PIECE / MAX_LANES).zip(&mut self.opacities);
        blocks.zip(order.par_chunks(PIECE)).for_each(|((blocks, opacity), order)| {
            T::dispatch(Share { gaussians, order, blocks, opacity });
        });
    }

    /// Opacity of the splat at a rank.
    #[must_use]
    pub fn opacity(&self, rank: usize) -> T {
        self.blocks[rank / MAX_LANES].opacity[rank % MAX_LANES]
    }

    /// Mean opacity of all splats.
    #[must_use]
    pub fn mean_opacity(&self) -> f64 {
        self.opacities.iter().sum::<f64>() / self.len().max(1) as f64
    }

    /// Writes into `out` the derivatives by the parameters (colour excepted), from those by what cameras share.
    pub fn parameter_gradients(
        &self,
        gaussians: &Splats<T>,
        gradients: &[SplatGradient<T>],
        out: &mut Splats<T>,
    ) {
        let scales = out.log_scale.par_chunks_mut(PIECE).zip(out.rotation.par_chunks_mut(PIECE));
        let others = out.position.par_chunks_mut(PIECE).zip(out.opacity_logit.par_chunks_mut(PIECE));
        scales.zip(others).zip(self.rank.par_chunks(PIECE)).enumerate().for_each(
            |(k, (((log_scale, rotation), (position, logit)), rank))| {
                for ((position, logit), rank) in position.iter_mut().zip(logit).zip(rank) {
                    let rank = rank.load(Relaxed) as usize;
                    let g = &gradients[rank];
                    *position = g.position;
                    // The opacity is the logit's sigmoid.
                    *logit = [g.log_opacity * (T::one() - self.opacity(rank))];
                }
                let first = k * PIECE;
                T::dispatch(Unshare { gaussians, gradients, first, rank, log_scale, rotation });
            },
        );
    }

    /// Rank of a splat.
    #[must_use]
    pub fn rank(&self, splat: usize) -> usize {
        self.rank[splat].load(Relaxed) as usize
    }
}

/// One lane a splat: number `k` of the arrays that `of` finds.
#[inline(always)]
fn gather<S: Simd, const K: usize>(
    simd: S,
    count: usize,
    of: impl Fn(usize) -> [S::Scalar; K],
) -> [SimdVec<S>; K] {
    let mut values = [[S::Scalar::from_f64(1.0); MAX_LANES]; K];
    for i in 0..count.min(S::WIDTH) {
        let found = of(i);
        for k in 0..K {
            values[k][i] = found[k];
        }
    }
    let mut out = [SimdVec::load(simd, &values[0]); K];
    for k in 1..K {
        out[k] = SimdVec::load(simd, &values[k]);
    }
    out
}

/// The arrays of each splat from rows with one lane a splat.
#[inline(always)]
fn scatter<S: Simd, const K: usize>(
    rows: [SimdVec<S>; K],
    count: usize,
    mut to: impl FnMut(usize, [S::Scalar; K]),
) {
    let mut values = [[S::Scalar::from_f64(0.0); MAX_LANES]; K];
    for k in 0..K {
        rows[k].store_to(&mut values[k], 0);
    }
    for i in 0..count.min(S::WIDTH) {
        let mut of = [S::Scalar::from_f64(0.0); K];
        for k in 0..K {
            of[k] = values[k][i];
        }
        to(i, of);
    }
}

/// Computes what cameras share of some splats.
struct Share<'a, T> {
    gaussians: &'a Splats<T>,
    order: &'a [u32],
    blocks: &'a mut [SplatBlock<T>],
    /// The sum of their opacities.
    opacity: &'a mut f64,
}

impl<T: SimdReal> SimdKernel<T> for Share<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let g = self.gaussians;
        let [zero, one] = broadcast_each(simd, [T::zero(), T::one()]);
        *self.opacity = 0.0;
        for (block, order) in self.blocks.iter_mut().zip(self.order.chunks(MAX_LANES)) {
            for first in (0..MAX_LANES).step_by(S::WIDTH) {
                let order = order.get(first..).unwrap_or_default();
                let n = order.len();
                let position = gather(simd, n, |i| g.position[order[i] as usize]);
                let log_scale = gather(simd, n, |i| g.log_scale[order[i] as usize]);
                let rotation = gather(simd, n, |i| g.rotation[order[i] as usize]);
                let [logit] = gather(simd, n, |i| g.opacity_logit[order[i] as usize]);
                let mut variance = log_scale;
                for k in 0..3 {
                    variance[k] = (log_scale[k] + log_scale[k]).exp();
                    position[k].store_to(&mut block.position[k], first);
                }
                let covariance = Rotation::new(simd, rotation).covariance(variance);
                for k in 0..6 {
                    covariance[k].store_to(&mut block.covariance[k], first);
                }
                let opacity = (one + (zero - logit).exp()).reciprocal();
                let opacity = opacity.select_or_zero(SimdMask::first(simd, n));
                opacity.store_to(&mut block.opacity, first);
                *self.opacity += opacity.sum().as_f64();
            }
        }
    }
}

/// Turns derivatives by covariances into those by scales and rotations, for some splats.
struct Unshare<'a, T> {
    gaussians: &'a Splats<T>,
    gradients: &'a [SplatGradient<T>],
    first: usize,
    rank: &'a [AtomicU32],
    log_scale: &'a mut [[T; 3]],
    rotation: &'a mut [[T; 4]],
}

impl<T: SimdReal> SimdKernel<T> for Unshare<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let Self { gaussians, gradients, .. } = self;
        let outputs = self.log_scale.chunks_mut(S::WIDTH).zip(self.rotation.chunks_mut(S::WIDTH));
        for (k, ((by_log_scale, by_rotation), rank)) in outputs.zip(self.rank.chunks(S::WIDTH)).enumerate() {
            let (n, first) = (rank.len(), self.first + k * S::WIDTH);
            let log_scale = gather(simd, n, |i| gaussians.log_scale[first + i]);
            let rotation = gather(simd, n, |i| gaussians.rotation[first + i]);
            let by_covariance = gather(simd, n, |i| gradients[rank[i].load(Relaxed) as usize].covariance);
            let mut scale = log_scale;
            for k in 0..3 {
                scale[k] = log_scale[k].exp();
            }
            let (by_scale, by_turn) = Rotation::new(simd, rotation).gradient(scale, by_covariance);
            scatter(by_scale, n, |i, v| by_log_scale[i] = v);
            scatter(by_turn, n, |i, v| by_rotation[i] = v);
        }
    }
}

/// A rotation by a quaternion of any length.
struct Rotation<N> {
    quaternion: [N; 4],
    /// One over its squared length.
    inverse: N,
    matrix: [[N; 3]; 3],
}

impl<S: Simd> Rotation<SimdVec<S>> {
    #[inline(always)]
    fn new(simd: S, [w, x, y, z]: [SimdVec<S>; 4]) -> Self {
        let [least, one] = broadcast_each(simd, [1e-24, 1.0].map(S::Scalar::from_f64));
        Self::of([w, x, y, z], (w * w + x * x + y * y + z * z).max(least).reciprocal(), one)
    }
}

impl<N: Arithmetic> Rotation<N> {
    #[inline(always)]
    fn of(quaternion: [N; 4], inverse: N, one: N) -> Self {
        let [w, x, y, z] = quaternion;
        let two = inverse + inverse;
        let matrix = [
            [one - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)],
            [two * (x * y + w * z), one - two * (x * x + z * z), two * (y * z - w * x)],
            [two * (x * z - w * y), two * (y * z + w * x), one - two * (x * x + y * y)],
        ];
        Self { quaternion, inverse, matrix }
    }

    /// `R S² Rᵀ`.
    #[inline(always)]
    fn covariance(&self, variance: [N; 3]) -> [N; 6] {
        let r = &self.matrix;
        let mut out = [variance[0]; 6];
        for (e, (i, j)) in ELEMENTS.into_iter().enumerate() {
            out[e] = r[i][0] * r[j][0] * variance[0]
                + r[i][1] * r[j][1] * variance[1]
                + r[i][2] * r[j][2] * variance[2];
        }
        out
    }

    /// Derivatives by log scale and quaternion from those by the covariance (`g`).
    #[inline(always)]
    fn gradient(&self, scale: [N; 3], g: [N; 6]) -> ([N; 3], [N; 4]) {
        let r = &self.matrix;
        let full = [[g[0], g[1], g[2]], [g[1], g[3], g[4]], [g[2], g[4], g[5]]];
        // With L = R S: dL/dL = 2 G L; here times the scale.
        let mut m = *r;
        let mut by_log_scale = scale;
        for j in 0..3 {
            let twice = (scale[j] + scale[j]) * scale[j];
            for i in 0..3 {
                m[i][j] = twice * (full[i][0] * r[0][j] + full[i][1] * r[1][j] + full[i][2] * r[2][j]);
            }
            by_log_scale[j] = r[0][j] * m[0][j] + r[1][j] * m[1][j] + r[2][j] * m[2][j];
        }
        let [w, x, y, z] = self.quaternion;
        // By the unit quaternion, times half the length.
        let by = [
            x * (m[2][1] - m[1][2]) + y * (m[0][2] - m[2][0]) + z * (m[1][0] - m[0][1]),
            w * (m[2][1] - m[1][2]) + y * (m[0][1] + m[1][0]) + z * (m[0][2] + m[2][0])
                - (x + x) * (m[1][1] + m[2][2]),
            w * (m[0][2] - m[2][0]) + x * (m[0][1] + m[1][0]) + z * (m[1][2] + m[2][1])
                - (y + y) * (m[0][0] + m[2][2]),
            w * (m[1][0] - m[0][1]) + x * (m[0][2] + m[2][0]) + y * (m[1][2] + m[2][1])
                - (z + z) * (m[0][0] + m[1][1]),
        ];
        let along = (w * by[0] + x * by[1] + y * by[2] + z * by[3]) * self.inverse;
        let mut by_quaternion = by;
        for k in 0..4 {
            by_quaternion[k] = (self.inverse + self.inverse) * (by[k] - self.quaternion[k] * along);
        }
        (by_log_scale, by_quaternion)
    }
}

/// Rows and columns of a symmetric matrix's elements.
pub(super) const ELEMENTS: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_put_the_highest_first() {
        let mut heights = vec![3.0f32, -2.0, 0.0, -7.5, 100.0];
        let keys = Keys::new(heights.clone().into_par_iter());
        heights.sort_by_key(|h| keys.of(*h));
        assert_eq!(heights, [100.0, 3.0, 0.0, -2.0, -7.5]);
        assert_eq!([100.0, -7.5].map(|h| keys.of(h)), [0, STEPS - 1]);
    }

    #[test]
    fn altitudes_without_a_span_or_a_number_have_keys() {
        for heights in [vec![], vec![2.5f32], vec![f32::NAN, 1.0, f32::INFINITY]] {
            let keys = Keys::new(heights.clone().into_par_iter());
            assert!(heights.iter().all(|h| keys.of(*h) < STEPS));
        }
    }

    #[test]
    fn splats_are_in_the_order_of_their_keys_and_ties_stay_as_they_come() {
        // Few keys for many splats, in more than one piece.
        let keys: Vec<u32> = (0..100_000u32).map(|i| i.wrapping_mul(2_654_435_761) & 0x3F_F00F).collect();
        let mut expected: Vec<u32> = (0..keys.len() as u32).collect();
        expected.sort_by_key(|i| keys[*i as usize]);
        let mut order = Order::default();
        order.sort(keys.into_par_iter());
        let sorted: Vec<u32> = order.entries.iter().map(|e| e.load(Relaxed) as u32).collect();
        assert_eq!(sorted, expected);
    }

    #[test]
    fn covariance_gradient_agrees_with_central_differences() {
        let (s, q) = ([-0.3, 0.4, 0.1], [0.8, -0.3, 0.5, 0.2]);
        let g = [0.3, -0.2, 0.5, 0.7, 0.1, -0.4];
        // Off-diagonal elements count twice, once for each place in the matrix.
        let weight = [1.0, 2.0, 2.0, 1.0, 2.0, 1.0];
        let turn = |q: [f64; 4]| Rotation::of(q, 1.0 / q.iter().map(|v| v * v).sum::<f64>(), 1.0);
        let loss = |s: [f64; 3], q| -> f64 {
            let covariance = turn(q).covariance(s.map(|s| (2.0 * s).exp()));
            (0..6).map(|k| weight[k] * g[k] * covariance[k]).sum()
        };
        let (by_s, by_q) = turn(q).gradient(s.map(f64::exp), g);
        let e = 1e-6;
        for k in 0..3 {
            let (mut a, mut b) = (s, s);
            a[k] += e;
            b[k] -= e;
            assert!(((loss(a, q) - loss(b, q)) / (2.0 * e) - by_s[k]).abs() < 1e-8);
        }
        for k in 0..4 {
            let (mut a, mut b) = (q, q);
            a[k] += e;
            b[k] -= e;
            assert!(((loss(s, a) - loss(s, b)) / (2.0 * e) - by_q[k]).abs() < 1e-8);
        }
    }
}
