//! Densification and pruning: which splats are doubled, which are removed (BAEOGS §3.3).

use crate::random::CounterRng;
use crate::splat::adam::SplatAdam;
use crate::splat::splats::{Splats, logit, rotation_matrix, sigmoid};
use crate::splat::train::recipe::Densification;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// A split splat's parts are this much smaller (gsplat).
const SPLIT_SHRINKS: f32 = 1.6;
/// Standard deviations in a projected radius (3DGS).
const RADIUS_SIGMAS: f64 = 3.0;
const DRAW_SPLIT: u64 = 3;

/// What the training views said of each splat since the last check.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DensifyStats {
    gradient: Vec<f32>,
    views: Vec<u32>,
    /// Largest radius of any view, pixels per metre over the longer side.
    magnification: f64,
}

impl DensifyStats {
    /// Number of splats that it is about.
    #[must_use]
    pub fn splats(&self) -> usize {
        self.views.len().min(self.gradient.len())
    }

    /// Forgets, for `n` splats.
    pub fn reset(&mut self, n: usize) {
        self.gradient.clear();
        self.gradient.resize(n, 0.0);
        self.views.clear();
        self.views.resize(n, 0);
        self.magnification = 0.0;
    }

    /// Adds a view of so many pixels per metre and so long a side; `seen` gives, of a splat that it saw, the
    /// derivative by the image position, in half image sides.
    pub fn rendered(
        &mut self,
        seen: impl Fn(usize) -> Option<[f32; 2]> + Sync,
        pixels_per_m: f64,
        longer_side: f64,
    ) {
        self.magnification = self.magnification.max(pixels_per_m / longer_side);
        let sums = self.gradient.par_iter_mut().zip(&mut self.views).with_min_len(1024).enumerate();
        sums.for_each(|(splat, (gradient, views))| {
            if let Some([x, y]) = seen(splat) {
                *gradient += x.hypot(y);
                *views += 1;
            }
        });
    }
}

/// How many splats a check added and removed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Change {
    /// Doubled splats.
    pub grown: usize,
    /// Removed splats.
    pub pruned: usize,
}

/// Doubles the splats that ask for it, in a cube of this half side; `draw` is (seed, iteration).
pub fn grow(
    splats: &mut Splats,
    adam: &mut SplatAdam,
    statistics: &DensifyStats,
    rule: &Densification,
    half_side_m: f64,
    draw: (u64, u64),
) -> usize {
    let n = splats.len();
    let mut keep = vec![true; n];
    let mut grown = 0;
    for i in 0..n {
        if splats.len() >= rule.max_splats as usize {
            break;
        }
        let scale = splats.log_scale[i].iter().fold(f32::MIN, |m, s| m.max(*s)).exp();
        let mean = statistics.gradient[i] / statistics.views[i].max(1) as f32;
        let radius = RADIUS_SIGMAS * f64::from(scale) * statistics.magnification;
        let wants = f64::from(mean) > rule.gradient
            || f64::from(scale) > rule.max_scale * half_side_m
            || radius > rule.max_radius;
        if !wants {
            continue;
        }
        grown += 1;
        if f64::from(scale) < rule.copy_below * half_side_m {
            let copy = splats.clone_one(i);
            splats.push_copy(&copy, 0);
            adam.push_zero();
        } else {
            keep[i] = false;
            for part in 0..2 {
                let child = split(splats, i, CounterRng::new(draw.0, DRAW_SPLIT + part, draw.1, i as u64));
                splats.push_copy(&child, 0);
                adam.push_zero();
            }
        }
    }
    keep.resize(splats.len(), true);
    splats.retain(&keep);
    adam.retain(&keep);
    grown
}

/// A part of a splat: drawn from it, smaller.
fn split(splats: &Splats, i: usize, mut draw: CounterRng) -> Splats {
    let mut child = splats.clone_one(i);
    let (r, _) = rotation_matrix(splats.rotation[i]);
    let along: [f32; 3] = std::array::from_fn(|k| draw.normal() as f32 * splats.log_scale[i][k].exp());
    for a in 0..3 {
        child.position[0][a] += (0..3).map(|k| r[a][k] * along[k]).sum::<f32>();
        child.log_scale[0][a] -= SPLIT_SHRINKS.ln();
    }
    child
}

/// Removes splats that are fainter than `opacity`, not finite, or outside `altitudes`.
pub fn prune(splats: &mut Splats, adam: &mut SplatAdam, opacity: f64, altitudes: (f64, f64)) -> usize {
    let n = splats.len();
    let keep: Vec<bool> = (0..n)
        .map(|i| {
            let z = f64::from(splats.position[i][2]);
            let sound = splats.position[i].iter().chain(&splats.log_scale[i]).all(|v| v.is_finite());
            sound && z >= altitudes.0 && z <= altitudes.1 && f64::from(sigmoid(splats.logit[i])) >= opacity
        })
        .collect();
    splats.retain(&keep);
    adam.retain(&keep);
    n - splats.len()
}

/// Lowers every opacity to `opacity` and forgets the opacities' moments.
pub fn reset_opacity(splats: &mut Splats, adam: &mut SplatAdam, opacity: f64) {
    let top = logit(opacity as f32);
    for l in &mut splats.logit {
        *l = l.min(top);
    }
    adam.first.logit.fill(0.0);
    adam.second.logit.fill(0.0);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splat::train::recipe::Recipe;

    fn set() -> (Splats, SplatAdam, DensifyStats) {
        let mut g = Splats::default();
        g.push([0.0; 3], 0.3, 0.9, [0.5; 3]);
        g.push([1.0, 0.0, 0.0], 4.0, 0.9, [0.5; 3]);
        g.push([2.0, 0.0, 0.0], 0.3, 0.001, [0.5; 3]);
        let mut s = DensifyStats::default();
        s.reset(3);
        (g, SplatAdam::new(3), s)
    }

    #[test]
    fn small_splats_are_copied_large_ones_split_and_faint_ones_removed() {
        let recipe = Recipe::named("baeogs").unwrap();
        let (mut g, mut adam, mut s) = set();
        s.rendered(|i| [Some([0.01, 0.0]), Some([0.0, 0.01]), None][i], 0.0, 1.0);
        assert_eq!(grow(&mut g, &mut adam, &s, &recipe.growth.unwrap(), 226.0, (0, 100)), 2);
        // The copy and the original, the faint one, and the two halves.
        assert_eq!(g.len(), 5);
        assert_eq!(adam.first.len(), 5);
        let halves = g.log_scale.iter().filter(|l| (l[0].exp() - 4.0 / 1.6).abs() < 1e-4).count();
        assert_eq!(halves, 2);
        assert_eq!(prune(&mut g, &mut adam, recipe.prune_below, (-50.0, 50.0)), 1);
        assert_eq!(g.len(), 4);
    }

    #[test]
    fn a_reset_lowers_only_what_is_higher() {
        let (mut g, mut adam, _) = set();
        reset_opacity(&mut g, &mut adam, 0.005);
        let o: Vec<f32> = g.logit.iter().map(|l| sigmoid(*l)).collect();
        assert!((o[0] - 0.005).abs() < 1e-6 && (o[2] - 0.001).abs() < 1e-6, "{o:?}");
    }
}
