//! How well heights determine a horizontal shift: from the curvature of its own minimum.
//!
//! Errors of heights are alike over tens of metres, so that cells do not count one by one. The costs of blocks of ground at nine
//! shifts around the minimum give the curvature of their sum and the scatter of their slopes, and these the covariance
//! (sandwich estimator: White, Maximum likelihood estimation of misspecified models, 1982, theorem 3.2). Other shifts that fit as
//! well, by the scatter of the differences between blocks, make it larger.

use crate::stats::{MAD_TO_SIGMA, interpolated_quantile};
use nalgebra::{Matrix2, Vector2};

/// Blocks along each axis of the ground that two surfaces share.
const BLOCKS: usize = 8;
/// The shifts around a minimum, in steps of the stencil, row by row.
pub(crate) const STENCIL: [[f64; 2]; 9] = [
    [-1.0, -1.0],
    [0.0, -1.0],
    [1.0, -1.0],
    [-1.0, 0.0],
    [0.0, 0.0],
    [1.0, 0.0],
    [-1.0, 1.0],
    [0.0, 1.0],
    [1.0, 1.0],
];
/// Standard deviation of a median as a multiple of that of a mean (large samples, normal errors).
pub(crate) const MEDIAN_TO_MEAN: f64 = 1.2533;
/// A shift fits as well as the best one if it is worse by fewer standard deviations of the difference.
const RIVAL_SIGMAS: f64 = 3.0;
/// A shift whose costs are larger by this share on the same ground does not fit as well, however few blocks tell so: a few
/// buildings determine a shift. Shifts whose costs are larger by the smaller share only differ by rounding.
const CLEARLY_WORSE: f64 = 0.2;
const ROUNDING: f64 = 1e-3;
/// A shift of more than this multiple of its standard deviation is one, however large that is.
const SIGNIFICANT: f64 = 4.0;

/// Sums of costs of the blocks at the shifts of [`STENCIL`].
pub(crate) type BlockCosts = [f64; STENCIL.len()];

/// The standard deviations of a shift along the principal axes of the curvature.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ShiftPrecision {
    axes: [Vector2<f64>; 2],
    /// Along the axes; infinite where nothing determines it.
    sigma: [f64; 2],
}

impl ShiftPrecision {
    /// The precision of a minimum from the costs around it, in the unit of the stencil's step.
    pub fn new(costs: &[BlockCosts], step: f64) -> Self {
        let sum = |k: usize| costs.iter().map(|c| c[k]).sum::<f64>();
        let second = |a: usize, b: usize| (sum(a) + sum(b) - 2.0 * sum(4)) / (step * step);
        let mixed = (sum(0) + sum(8) - sum(2) - sum(6)) / (4.0 * step * step);
        let curvature = Matrix2::new(second(3, 5), mixed, mixed, second(1, 7)).symmetric_eigen();
        let slope = |c: &BlockCosts| Vector2::new(c[5] - c[3], c[7] - c[1]) / (2.0 * step);
        let clearly_worse = CLEARLY_WORSE * sum(4);
        let n = costs.len() as f64;
        let mean = costs.iter().map(slope).sum::<Vector2<f64>>() / n;
        let axes = [0, 1].map(|k| curvature.eigenvectors.column(k).into_owned());
        let sigma = [0, 1].map(|k| {
            let scatter =
                costs.iter().map(|c| (slope(c) - mean).dot(&axes[k]).powi(2)).sum::<f64>() * n / (n - 1.0);
            let bend = curvature.eigenvalues[k];
            // Less than the rounding of the costs is no curvature.
            let is_bent = n > 1.0 && bend * step * step > ROUNDING * sum(4);
            if is_bent {
                (scatter.sqrt() / bend).min((2.0 * clearly_worse / bend).sqrt())
            } else {
                f64::INFINITY
            }
        });
        Self { axes, sigma }
    }

    /// With another shift that fits as well, at a distance from the best one.
    pub fn with_rival(mut self, away: [f64; 2]) -> Self {
        for (axis, sigma) in self.axes.iter().zip(&mut self.sigma) {
            *sigma = sigma.max(axis.dot(&Vector2::from(away)).abs());
        }
        self
    }

    /// Whether a shift at a distance from the best one is another one, not a part of its minimum of a width.
    pub fn is_apart(&self, away: [f64; 2], width: f64) -> bool {
        let along = |k: usize| self.axes[k].dot(&Vector2::from(away)).abs();
        (0..2).any(|k| along(k) > width + RIVAL_SIGMAS * self.sigma[k])
    }

    /// Standard deviations along the two coordinates; none where one is infinite.
    pub fn sigma(&self) -> [Option<f64>; 2] {
        [0, 1].map(|k| {
            let of = |j: usize| if self.axes[j][k] == 0.0 { 0.0 } else { self.axes[j][k] * self.sigma[j] };
            Some(of(0).hypot(of(1))).filter(|s| s.is_finite())
        })
    }

    /// The part of a shift in the directions that are determined, to `fine` or to a fraction of the shift; and their number.
    pub fn determined(&self, shift: [f64; 2], fine: f64) -> ([f64; 2], usize) {
        let along = |k: usize| self.axes[k].dot(&Vector2::from(shift));
        let is_known = |k: &usize| self.sigma[*k] <= fine || along(*k).abs() > SIGNIFICANT * self.sigma[*k];
        let known: Vec<usize> = (0..2).filter(is_known).collect();
        match known.as_slice() {
            [_, _] => (shift, 2),
            [k] => ((self.axes[*k] * along(*k)).into(), 1),
            _ => ([0.0; 2], 0),
        }
    }
}

/// Sums of the costs of each block of ground under some shifts, of the items that have costs under all of them. `block` is the
/// block of each item.
pub(crate) fn block_costs<const N: usize>(costs: [&[f32]; N], block: &[u8]) -> Vec<[f64; N]> {
    let mut sums = vec![None; BLOCKS * BLOCKS];
    for (i, block) in block.iter().enumerate() {
        let of_item = costs.map(|c| f64::from(c[i]));
        if of_item.iter().all(|c| c.is_finite()) {
            let sum: &mut [f64; N] = sums[usize::from(*block)].get_or_insert([0.0; N]);
            sum.iter_mut().zip(of_item).for_each(|(sum, cost)| *sum += cost);
        }
    }
    sums.into_iter().flatten().collect()
}

/// The block of a place in a box, for each axis from its share of the box, 0 to 1.
pub(crate) fn block_of([x, y]: [f64; 2]) -> u8 {
    let part = |v: f64| ((BLOCKS as f64 * v) as usize).min(BLOCKS - 1);
    (part(y) * BLOCKS + part(x)) as u8
}

/// Standard deviation of the median of all differences, from the scatter of the medians of blocks; none of a single block.
pub(crate) fn median_sigma(differences: impl Iterator<Item = (u8, f32)>, median: f64) -> Option<f64> {
    let mut of_blocks = vec![Vec::new(); BLOCKS * BLOCKS];
    for (block, d) in differences.filter(|(_, d)| d.is_finite()) {
        of_blocks[usize::from(block)].push(d);
    }
    let off = |block: &Vec<f32>| (interpolated_quantile(block, 0.5) - median).abs() as f32;
    let off: Vec<f32> = of_blocks.iter().filter(|block| !block.is_empty()).map(off).collect();
    let scatter = MAD_TO_SIGMA * interpolated_quantile(&off, 0.5);
    (off.len() > 1).then(|| MEDIAN_TO_MEAN * scatter / (off.len() as f64).sqrt())
}

/// Whether another shift fits about as well as the best one, from pairs of the costs of blocks under both. The scatter of the
/// differences between blocks is at most that of the differences themselves, which grows with what a few blocks tell, and at
/// most that of the costs that the best shift leaves.
pub(crate) fn is_rival(pairs: &[[f64; 2]]) -> bool {
    let n = pairs.len() as f64;
    let variance = |of: fn(&[f64; 2]) -> f64| {
        let mean = pairs.iter().map(of).sum::<f64>() / n;
        pairs.iter().map(|p| (of(p) - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0)
    };
    let scatter = variance(|p| p[1] - p[0]).min(2.0 * variance(|p| p[0]));
    let own = pairs.iter().map(|p| p[0]).sum::<f64>();
    let more = pairs.iter().map(|p| p[1] - p[0]).sum::<f64>();
    more <= (RIVAL_SIGMAS * (n * scatter).sqrt()).clamp(ROUNDING * own, CLEARLY_WORSE * own)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::CounterRng;

    /// Costs of blocks whose minima scatter around zero: the closed form of the standard deviation is that of their mean.
    fn bowls(bend: [f64; 2], scatter: f64, step: f64) -> Vec<BlockCosts> {
        let mut random = CounterRng::new(3, 0, 0, 0);
        let bowl = |_| {
            let at = [scatter * random.normal(), scatter * random.normal()];
            STENCIL.map(|s| (0..2).map(|k| 0.5 * bend[k] * (step * s[k] - at[k]).powi(2)).sum())
        };
        (0..64).map(bowl).collect()
    }

    #[test]
    fn the_deviation_is_that_of_the_mean_of_the_blocks() {
        let precision = ShiftPrecision::new(&bowls([2.0, 0.5], 0.8, 0.5), 0.5);
        let [east, north] = precision.sigma().map(Option::unwrap);
        for sigma in [east, north] {
            assert!((sigma / (0.8 / 8.0) - 1.0).abs() < 0.25, "{sigma}");
        }
        assert_eq!(precision.determined([0.01, 0.02], 0.2), ([0.01, 0.02], 2));
        assert_eq!(precision.determined([0.01, 0.02], 0.01), ([0.0; 2], 0));
        assert_eq!(precision.determined([2.0, 3.0], 0.01).1, 2);
    }

    #[test]
    fn a_direction_without_curvature_is_not_determined() {
        let precision = ShiftPrecision::new(&bowls([2.0, 0.0], 0.8, 0.5), 0.5);
        assert_eq!(precision.sigma()[1], None);
        let (shift, count) = precision.determined([4.0, 9.0], 0.5);
        assert!(count == 1 && (shift[0] - 4.0).abs() < 1e-9 && shift[1].abs() < 1e-9, "{shift:?}");
    }

    #[test]
    fn another_minimum_counts_along_its_direction() {
        let precision = ShiftPrecision::new(&bowls([2.0, 0.5], 0.8, 0.5), 0.5);
        assert!(precision.is_apart([0.0, 7.0], 0.5) && !precision.is_apart([0.3, 0.3], 0.5));
        let wide = precision.with_rival([0.0, 7.0]);
        assert!(wide.sigma()[1].unwrap() >= 7.0 && wide.sigma()[0].unwrap() < 0.2);
        assert!(is_rival(&[[1.0, 2.0], [3.0, 1.8], [0.2, 0.9], [2.0, 1.6]]));
        assert!(!is_rival(&[[1.0, 2.0], [3.0, 4.2], [0.2, 1.1], [2.0, 3.1]]), "all blocks agree");
        assert!(is_rival(&[[10.0, 9.0], [30.0, 33.0], [12.0, 11.0], [20.0, 21.0]]), "blocks differ");
        assert!(is_rival(&[[1.0, 1.000_1]; 4]), "rounding");
        assert!(!is_rival(&[[1.0, 1.0], [1.1, 9.0], [1.0, 1.0], [0.9, 0.9]]), "one tells, and fits");
        assert!(is_rival(&[[1.0, 1.0]; 4]));
    }
}
