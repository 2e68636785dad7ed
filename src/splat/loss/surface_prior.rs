//! The surface prior: splats stay near the matched surface where the images do not determine their altitude.
//!
//! On a surface without texture, such as a white roof, the photometric loss lets splats drift by metres although the roof's
//! edges are right. Dense matching has interpolated such areas from their edges. The term is the mean over the splats of
//! `w r² / (r² + 1)` (the robust loss of Geman and McClure), with `r` the vertical distance from the surface in metres and
//! `w` the surface's weight at the splat, [`MatchedSurface::prior_weight`](crate::mvs::MatchedSurface::prior_weight). Anchored splats
//! count as zero: those of walls do not lie on the surface, and would pull their anchors away from it.

use super::prior::Prior;
use super::term::{LossTerm, Rendered, TermInfo, TermScope};
use super::terms::TermInputs;
use crate::simd::{MAX_LANES, Real, Simd, SimdKernel, SimdReal};
use crate::splat::anchored::Anchoring;
use crate::splat::splats::Splats;
use rayon::prelude::*;
use std::sync::Arc;

/// One weight, and one column: the mean robust distance.
pub const INFO: TermInfo =
    TermInfo { weights: &["surface_prior"], columns: &["surface_prior"], scope: TermScope::Any };
/// Number of splats that one task sums over; fixed, so that sums do not depend on the number of threads.
const PIECE: usize = 4096;

/// The term; zero without a prior.
pub struct SurfacePrior<T> {
    prior: Option<Arc<Prior>>,
    /// Weight of one splat's robust distance.
    factor: T,
    /// Derivative of each splat's robust distance with respect to its altitude; empty where the term is zero.
    slopes: Vec<T>,
    sums: Vec<f64>,
}

impl<T: SimdReal> SurfacePrior<T> {
    /// The term with this prior; zero without one.
    #[must_use]
    pub fn new(inputs: &mut TermInputs<T>) -> Self {
        Self { prior: inputs.prior.take(), factor: T::zero(), slopes: Vec::new(), sums: Vec::new() }
    }
}

impl<T: SimdReal> LossTerm<T> for SurfacePrior<T> {
    fn evaluate(&mut self, rendered: &Rendered<T>, weights: &[f64], columns: &mut [f64]) -> f64 {
        columns[0] = 0.0;
        self.slopes.clear();
        let Some(prior) = self.prior.as_deref().filter(|_| weights[0] != 0.0) else { return 0.0 };
        let splats = rendered.splats;
        self.factor = T::from_f64(weights[0] / splats.len().max(1) as f64);
        self.sums.resize(splats.len().div_ceil(PIECE), 0.0);
        self.slopes.resize(splats.len(), T::zero());
        let pieces = splats.position.par_chunks(PIECE).zip(self.slopes.par_chunks_mut(PIECE));
        pieces.zip(&mut self.sums).for_each(|((positions, slopes), sum)| {
            T::dispatch(RobustDistances { prior, positions, slopes, sum });
        });
        for Anchoring { splat, .. } in rendered.anchored {
            let i = *splat as usize;
            let ([distance], _) = robust_distances(prior, &[splats.position[i]]);
            self.sums[i / PIECE] -= distance.as_f64();
            self.slopes[i] = T::zero();
        }
        columns[0] = self.sums.iter().sum::<f64>() / splats.len().max(1) as f64;
        weights[0] * columns[0]
    }

    fn add_by_splats(&self, _: &Splats<T>, by: &mut Splats<T>) {
        let rows = self.slopes.par_iter().zip(&mut by.position).with_min_len(1024);
        rows.for_each(|(slope, by)| by[2] = by[2] + self.factor * *slope);
    }
}

/// The robust distances of splats from the surface: their sum, and the derivative of each by the altitude.
struct RobustDistances<'a, T> {
    prior: &'a Prior,
    positions: &'a [[T; 3]],
    slopes: &'a mut [T],
    sum: &'a mut f64,
}

impl<T: SimdReal> SimdKernel<T> for RobustDistances<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, _: S) {
        let Self { prior, positions, slopes, sum } = self;
        let (blocks, rest) = positions.as_chunks::<MAX_LANES>();
        let (slopes_of_blocks, slopes_of_rest) = slopes.as_chunks_mut::<MAX_LANES>();
        *sum = 0.0;
        for (block, slopes) in blocks.iter().zip(slopes_of_blocks) {
            let (distances, of_block) = robust_distances(prior, block);
            *slopes = of_block;
            distances.iter().for_each(|distance| *sum += distance.as_f64());
        }
        for (position, slope) in rest.iter().zip(slopes_of_rest) {
            let ([distance], [of_splat]) = robust_distances(prior, &[*position]);
            *slope = of_splat;
            *sum += distance.as_f64();
        }
    }
}

/// The robust distances of splats from the surface, and their derivatives by the altitudes.
#[inline(always)]
fn robust_distances<T: Real, const N: usize>(prior: &Prior, positions: &[[T; 3]; N]) -> ([T; N], [T; N]) {
    let (mut distances, mut slopes) = prior.distances(positions);
    let (two, scale) = (T::from_f64(2.0), T::from_f64(Prior::SCALE_M));
    for (distance, slope) in distances.iter_mut().zip(&mut slopes) {
        let (r, weight) = (*distance, *slope);
        let robust = r * r + T::one();
        *slope = weight * (two * r / (scale * (robust * robust)));
        *distance = weight * r * r / robust;
    }
    (distances, slopes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{Point, SiteGrid};
    use crate::io::{Grid2, MapGrid};
    use crate::mvs::MatchedSurface;
    use crate::splat::raster::Image;

    /// Two cells of 2 m at an altitude of 5 m, of which only the western one has a weight.
    fn prior() -> Prior {
        let site = SiteGrid { epsg: 32617, origin: Point::new(1000.0, 2000.0, 10.0) };
        let grid = MapGrid { epsg: 32617, west: 998.0, north: 2001.0, cell: 2.0, width: 2, height: 1 };
        let plane = |data: [f32; 2]| Grid2 { width: 2, height: 1, data: data.into() };
        let altitude = plane([5.0; 2]);
        let (score, prior_weight) = (altitude.clone(), plane([1.0, 0.0]));
        Prior::new(&MatchedSurface { site, grid, altitude, score, prior_weight })
    }

    /// Value, and derivatives by the altitudes, for splats at these positions.
    fn evaluate(positions: &[[f64; 3]], weight: f64) -> (f64, Vec<f64>) {
        let mut splats = Splats::<f64>::default();
        positions.iter().for_each(|p| splats.push(*p, 1.0, 0.5, [0.5; 3]));
        let nothing = Image::default();
        let rendered = Rendered::of_splats(&splats, &nothing);
        let mut term = SurfacePrior::new(&mut TermInputs { prior: Some(Arc::new(prior())), lpips: None });
        let value = term.evaluate(&rendered, &[weight], &mut [0.0]);
        let mut by = Splats::zeros(splats.len());
        term.add_by_splats(&splats, &mut by);
        (value, by.position.iter().map(|p| p[2]).collect())
    }

    #[test]
    fn anchored_splats_count_as_zero() {
        let mut splats = Splats::<f64>::default();
        [[-1.0, 0.5, 5.4], [-1.0, 0.5, 2.0]].iter().for_each(|p| splats.push(*p, 1.0, 0.5, [0.5; 3]));
        let nothing = Image::default();
        let anchored = [Anchoring { splat: 1, anchor: 0 }];
        let rendered = Rendered { anchored: &anchored, ..Rendered::of_splats(&splats, &nothing) };
        let mut term = SurfacePrior::new(&mut TermInputs { prior: Some(Arc::new(prior())), lpips: None });
        let value = term.evaluate(&rendered, &[0.4], &mut [0.0]);
        let free = evaluate(&[[-1.0, 0.5, 5.4]], 0.2);
        assert!((value - free.0).abs() < 1e-12 && value > 0.0);
        let mut by = Splats::zeros(2);
        term.add_by_splats(&splats, &mut by);
        assert!((by.position[0][2] - free.1[0]).abs() < 1e-12 && by.position[1][2] == 0.0);
    }

    #[test]
    fn the_derivative_agrees_with_central_differences() {
        for z in [3.0, 4.6, 5.0, 5.3, 9.0] {
            let at = |z: f64| evaluate(&[[-1.0, 0.5, z], [1.0, 0.5, 5.5]], 0.4);
            let quotient = (at(z + 1e-6).0 - at(z - 1e-6).0) / 2e-6;
            assert!((at(z).1[0] - quotient).abs() < 1e-8, "{z}");
        }
    }

    #[test]
    fn splats_without_weight_or_beyond_the_grid_are_not_pulled() {
        let (value, by) = evaluate(&[[1.0, 0.5, 5.5], [-1.0, 3.0, 5.5]], 0.4);
        assert_eq!((value, by), (0.0, vec![0.0; 2]));
    }

    #[test]
    fn the_term_is_a_mean_over_the_splats() {
        let (value, by) = evaluate(&[[-1.0, 0.5, 5.5], [1.0, 0.5, 5.5]], 0.4);
        assert!((value - 0.2 * 0.25 / 1.25).abs() < 1e-12);
        assert!((by[0] - 0.2 / 1.5625).abs() < 1e-12 && by[1] == 0.0);
    }
}
