//! From the numbers that the network gives for each query to splats, and the derivatives of this (Point2GS, equation 6).
//!
//! | numbers | splat | all zero |
//! |---|---|---|
//! | 0 to 2 | centre = query + `most_offset_m` · tanh(·), site axes | at the query |
//! | 3 to 5 | ln of the standard deviations = that of a splat of this spacing + 3 tanh(· / 3); along the surface at least half a spacing | flat along the normal |
//! | 6 to 9 | orientation = that of the normal + · | third axis along the normal |
//! | 10 | logit of the opacity = logit 0.8 + · | 0.8 |
//! | 11 to 13 | linear colour = that which the images show + `most_color` · tanh(·) | as seen |
//!
//! An untrained network thus gives splats that lie flat on the surface in the colours of the images.

use super::network::{FeatureBlocks, OUTPUTS};
use super::queries::Query;
use crate::simd::Real;
use crate::splat::splats::{SH_C0, Splats, f_dc_from_color, logit, rotation_to};
use glam::DVec3;
use rayon::prelude::*;

/// Standard deviations along and across the surface, in spacings of the queries: neighbours overlap.
const ALONG: f64 = 0.6;
const ACROSS: f64 = 0.2;
/// Smallest standard deviation along the surface, in spacings of the queries: smaller ones leave gaps where images are finer than
/// those that the network was trained with.
const LEAST_ALONG: f64 = 0.5;
/// Largest change of the logarithm of a standard deviation.
const MOST_LOG_SCALE: f64 = 3.0;
/// Opacity at the start: one pass needs opaque surfaces.
const OPACITY: f64 = 0.8;
/// Number of splats that one task works on at least.
const PIECE: usize = 1024;

/// What a splat is relative to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Base<T = f32> {
    /// Position of the query, metres in the site frame.
    pub position: [T; 3],
    /// Quaternion (w, x, y, z) that turns the third axis to the normal.
    pub rotation: [T; 4],
    /// Linear colour.
    pub color: [T; 3],
}

impl Base {
    /// What the splat of a query in this linear colour is relative to.
    #[must_use]
    pub fn new(query: &Query, color: [f32; 3]) -> Self {
        let position = query.position.map(|v| v as f32);
        Self { position, rotation: rotation_to(DVec3::from_array(query.normal)).map(|v| v as f32), color }
    }
}

/// The sizes of splats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Head {
    /// Spacing of the queries, metres.
    pub spacing_m: f64,
    /// Largest offset from the query along each axis, metres; zero without offsets.
    pub most_offset_m: f64,
    /// Largest change of a linear colour.
    pub most_color: f64,
}

impl Head {
    /// The splats of these queries.
    #[must_use]
    pub fn splats<T: Real>(&self, outputs: &FeatureBlocks<T>, bases: &[Base<T>]) -> Splats<T> {
        let c = T::from_f64;
        let (unit, across) = (c(self.most_offset_m), c((ACROSS / ALONG).ln()));
        let (scale, color) = (c((ALONG * self.spacing_m).ln()), c(self.most_color));
        let least = c((LEAST_ALONG * self.spacing_m).ln());
        let mut out = Splats::zeros(bases.len());
        let rows = out.position.par_iter_mut().zip(&mut out.log_scale).zip(&mut out.rotation);
        let rows = rows.zip(&mut out.opacity_logit).zip(&mut out.f_dc).zip(bases).enumerate();
        rows.with_min_len(PIECE).for_each(|(i, (((((p, s), q), opacity), f_dc), base))| {
            let o = |k: usize| outputs.at(k, i);
            *p = std::array::from_fn(|k| base.position[k] + unit * o(k).tanh());
            let log_scale = |k: usize| scale + c(MOST_LOG_SCALE) * (o(3 + k) / c(MOST_LOG_SCALE)).tanh();
            *s = [log_scale(0).max(least), log_scale(1).max(least), log_scale(2) + across];
            *q = std::array::from_fn(|k| base.rotation[k] + o(6 + k));
            *opacity = [logit(c(OPACITY)) + o(10)];
            *f_dc = f_dc_from_color(std::array::from_fn(|k| base.color[k] + color * o(11 + k).tanh()));
        });
        out
    }

    /// The derivatives by the numbers of the network, from those by the splats.
    #[must_use]
    pub fn backward<T: Real>(&self, outputs: &FeatureBlocks<T>, by: &Splats<T>) -> FeatureBlocks<T> {
        let c = T::from_f64;
        let slope = |tanh: T| T::one() - tanh * tanh;
        let mut out = FeatureBlocks::zeros(OUTPUTS, outputs.items());
        let mut put = |k: usize, i: usize, v: T| *out.at_mut(k, i) = v;
        for i in 0..outputs.items() {
            let o = |k: usize| outputs.at(k, i);
            for k in 0..3 {
                put(k, i, by.position[i][k] * c(self.most_offset_m) * slope(o(k).tanh()));
                let tanh = (o(3 + k) / c(MOST_LOG_SCALE)).tanh();
                let is_least = k < 2 && c(MOST_LOG_SCALE) * tanh < c((LEAST_ALONG / ALONG).ln());
                put(3 + k, i, if is_least { T::zero() } else { by.log_scale[i][k] * slope(tanh) });
                put(11 + k, i, by.f_dc[i][k] / c(SH_C0) * c(self.most_color) * slope(o(11 + k).tanh()));
            }
            (0..4).for_each(|k| put(6 + k, i, by.rotation[i][k]));
            put(10, i, by.opacity_logit[i][0]);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::CounterRng;
    use glam::DQuat;

    #[test]
    fn the_derivatives_agree_with_central_differences() {
        let head = Head { spacing_m: 0.5, most_offset_m: 1.5, most_color: 0.4 };
        let mut draw = CounterRng::new(2, 0, 0, 0);
        let base = Base { position: [1.0, 2.0, 3.0], rotation: [1.0, 0.0, 0.0, 0.0], color: [0.3, 0.2, 0.4] };
        let bases = vec![base; 3];
        let mut outputs = FeatureBlocks::zeros(OUTPUTS, 3);
        let mut weights = Splats::<f64>::zeros(3);
        weights.groups_mut().into_iter().flatten().for_each(|v| *v = draw.normal());
        (0..3 * OUTPUTS).for_each(|i| *outputs.at_mut(i % OUTPUTS, i / OUTPUTS) = draw.normal());
        let loss = |outputs: &FeatureBlocks<f64>| {
            let splats = head.splats(outputs, &bases);
            let pairs = splats.groups().into_iter().zip(weights.groups());
            pairs.flat_map(|(a, b)| a.iter().zip(b)).map(|(a, b)| a * b).sum::<f64>()
        };
        let by = head.backward(&outputs, &weights);
        for i in 0..3 * OUTPUTS {
            let (feature, item) = (i % OUTPUTS, i / OUTPUTS);
            let at = |step: f64| {
                let mut moved = outputs.clone();
                *moved.at_mut(feature, item) += step;
                loss(&moved)
            };
            let expected = (at(1e-6) - at(-1e-6)) / 2e-6;
            assert!((by.at(feature, item) - expected).abs() < 1e-6 * expected.abs().max(0.1), "{feature}");
        }
    }

    #[test]
    fn without_training_splats_lie_flat_on_the_surface_in_the_colours_of_the_images() {
        let head = Head { spacing_m: 0.5, most_offset_m: 1.0, most_color: 0.5 };
        let normal = DVec3::new(0.6, 0.0, 0.8);
        let rotation = rotation_to(normal);
        let bases = [Base { position: [4.0, 5.0, 6.0], rotation, color: [0.1, 0.2, 0.3] }];
        let splats = head.splats(&FeatureBlocks::zeros(OUTPUTS, 1), &bases);
        assert_eq!(splats.position[0], [4.0, 5.0, 6.0]);
        let [w, x, y, z] = splats.rotation[0];
        assert!((DQuat::from_xyzw(x, y, z, w) * DVec3::Z - normal).length() < 1e-12);
        assert!((splats.log_scale[0][0].exp() - 0.3).abs() < 1e-12);
        assert!((splats.log_scale[0][2].exp() - 0.1).abs() < 1e-12);
        assert!(splats.is_whole(1));
    }
}
