//! Splats in depth order with their 3-D covariances and opacities, which all cameras of an iteration share, and the
//! gradient from those quantities to the splats' parameters.

use super::covariance::{CovarianceBackward, CovarianceForward, NormalForward};
use super::depth_sort::{DepthKeys, RadixSort};
use super::splat_block::{SplatBlock, SplatGradient};
use crate::camera::CameraKernel;
use crate::simd::{MAX_LANES, Real, SimdReal};
use crate::splat::primitive::PrimitiveKind;
use crate::splat::splats::Splats;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Number of splats that one task works on; fixed, so that sums do not depend on the number of threads.
const PIECE: usize = 64 * MAX_LANES;

/// Splats in depth order, nearest first, with what every camera needs of them. A splat's place in the order is its rank.
#[derive(Default)]
pub struct SortedSplats<T> {
    /// Index in [`Splats`] of the splat at each rank.
    order: Vec<u32>,
    /// Rank of the splat with each index; atomic, as tasks write it in any order.
    rank: Vec<AtomicU32>,
    depth_sort: RadixSort,
    pub(super) blocks: Vec<SplatBlock<T>>,
    primitive: PrimitiveKind,
    /// Normals of discs in blocks as above; empty for ellipsoids.
    pub(super) normals: Vec<[[T; MAX_LANES]; 3]>,
    /// Sum of the opacities of each task's splats.
    opacities: Vec<f64>,
}

impl<T: Real> SortedSplats<T> {
    /// Centre (metres) and covariance (xx, xy, xz, yy, yz, zz; m²) of the splat at a rank, in the site frame.
    #[inline(always)]
    pub(super) fn position_and_covariance(&self, rank: usize) -> ([T; 3], [T; 6]) {
        let (block, lane) = (&self.blocks[rank / MAX_LANES], rank % MAX_LANES);
        (block.position.map(|p| p[lane]), block.covariance.map(|c| c[lane]))
    }

    /// Normal of the disc at a rank, a unit vector in the site frame.
    #[inline(always)]
    pub fn normal(&self, rank: usize) -> [T; 3] {
        self.normals[rank / MAX_LANES].map(|n| n[rank % MAX_LANES])
    }
}

impl<T: SimdReal> SortedSplats<T> {
    /// No splats yet, of this kind.
    #[must_use]
    pub fn of(primitive: PrimitiveKind) -> Self {
        Self { primitive, ..Self::default() }
    }

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

    /// Index in [`Splats`] of the splat at each rank.
    #[must_use]
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// Sorts the splats by altitude, the highest first, and computes covariances and opacities. Every parallel projection
    /// uses this order.
    pub fn update(&mut self, splats: &Splats<T>) {
        self.update_by(splats, |position| position[2]);
    }

    /// Sorts the splats by the depth key of one camera and computes covariances and opacities.
    pub fn update_for(&mut self, splats: &Splats<T>, camera: &impl CameraKernel<T>) {
        self.update_by(splats, |position| camera.depth_key(position));
    }

    /// Sorts the splats by a depth key, the largest first.
    fn update_by(&mut self, splats: &Splats<T>, key: impl Fn([T; 3]) -> T + Sync) {
        let n = splats.len();
        let depths = splats.position.par_iter().with_min_len(PIECE).map(|p| key(*p).as_f64() as f32);
        let keys = DepthKeys::new(depths.clone());
        self.depth_sort.sort(depths.map(|depth| keys.key(depth)));
        self.order.resize(n, 0);
        self.rank.resize_with(n, AtomicU32::default);
        let order = self.order.par_iter_mut().zip(self.depth_sort.indices()).with_min_len(PIECE);
        order.enumerate().for_each(|(rank, (splat, index))| {
            *splat = index;
            self.rank[*splat as usize].store(rank as u32, Relaxed);
        });
        let order = &self.order;
        self.blocks.resize(n.div_ceil(MAX_LANES), SplatBlock::default());
        self.opacities.resize(n.div_ceil(PIECE), 0.0);
        let blocks = self.blocks.par_chunks_mut(PIECE / MAX_LANES).zip(&mut self.opacities);
        blocks.zip(order.par_chunks(PIECE)).for_each(|((blocks, opacity_sum), order)| {
            T::dispatch(CovarianceForward { splats, order, blocks, opacity_sum });
        });
        if self.primitive == PrimitiveKind::Disc {
            self.normals.resize(n.div_ceil(MAX_LANES), [[T::zero(); MAX_LANES]; 3]);
            let normals = self.normals.par_chunks_mut(PIECE / MAX_LANES);
            normals.zip(order.par_chunks(PIECE)).for_each(|(normals, order)| {
                T::dispatch(NormalForward { splats, order, normals });
            });
        }
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

    /// Begins the sums of `gradients`, in the order of ranks: zero but for the derivative `by_opacity` with respect to the
    /// opacity of each splat.
    pub fn begin_gradients(&self, by_opacity: T, gradients: &mut Vec<SplatGradient<T>>) {
        gradients.resize(self.len(), SplatGradient::default());
        gradients.par_iter_mut().with_min_len(1024).enumerate().for_each(|(rank, by)| {
            *by = SplatGradient { log_opacity: by_opacity * self.opacity(rank), ..SplatGradient::default() };
        });
    }

    /// Writes to `out` the derivatives with respect to the splats' parameters, except colours, from `gradients`, which are in
    /// the order of ranks. `by_normal` are those with respect to the normals of discs, in the same order; empty for ellipsoids.
    /// The extent of a disc along its normal has none.
    pub fn parameter_gradients(
        &self,
        splats: &Splats<T>,
        gradients: &[SplatGradient<T>],
        by_normal: &[[T; 3]],
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
                    // d log(sigmoid(x)) / dx = 1 - sigmoid(x).
                    *logit = [g.log_opacity * (T::one() - self.opacity(rank))];
                }
                let first = k * PIECE;
                T::dispatch(CovarianceBackward {
                    splats,
                    gradients,
                    first,
                    rank,
                    by_normal,
                    log_scale,
                    rotation,
                });
            },
        );
    }

    /// Rank of the splat with this index.
    #[must_use]
    pub fn rank(&self, splat: usize) -> usize {
        self.rank[splat].load(Relaxed) as usize
    }
}
