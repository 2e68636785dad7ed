//! One gain and one offset a tile and colour band, so that the orthophotos of neighbouring tiles have the same colours.
//!
//! Tiles take the colours of one reference view, so that they nearly agree by construction; what is left is settled here,
//! from the colours of both tiles in each strip. The corrections are computed when all tiles are done, hence they cannot be
//! applied when tiles are blended, which is done as soon as the neighbours of a tile are done. They are applied when the
//! mosaic is assembled: blending keeps each tile's share of every cell, from which [`ColorCorrection`]s of up to four tiles
//! give the correction of the cell. Heights are not touched.

use super::seams::Seam;
use crate::stats::quantile;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Weight of the pull towards no correction, as a share of the weight of a tile's seams. It fixes what differences between
/// tiles leave open, and limits the sum of small errors over many tiles.
const PULL: f64 = 1e-3;
/// Difference of colours, of 1, beyond which an equation loses weight.
const HUBER: f64 = 0.02;
/// Number of times that the weights of the equations are recomputed.
const REWEIGHTINGS: usize = 6;
/// Quantiles of the colours of a strip that are compared. Quantiles of either tile do not need pairs of cells that show
/// exactly the same place, and have no noise that would pull gains towards 0.
const QUANTILES: [f64; 9] = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9];
/// Smallest number of pairs of colours of a strip that is used.
const FEWEST_PAIRS: usize = 30;
/// The colour at which the unknown offset is defined, of 1; in the middle of the colours, offset and gain are independent.
const MIDDLE: f64 = 0.5;
/// Largest change of a gain. Tiles that differ more do not differ in their colours only.
const LARGEST_GAIN_CHANGE: f64 = 0.5;
/// Conjugate gradients stop after this many iterations, or when the residual has fallen by this factor.
const MOST_ITERATIONS: usize = 500;
const SMALLEST_RESIDUAL: f64 = 1e-9;

/// Correction of a tile's colours: gain times value plus offset, per band; values from 0 to 255.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ColorCorrection {
    /// Gain of red, green, blue.
    pub gain: [f64; 3],
    /// Offset of red, green, blue, of 255.
    pub offset: [f64; 3],
}

impl Default for ColorCorrection {
    fn default() -> Self {
        Self { gain: [1.0; 3], offset: [0.0; 3] }
    }
}

impl ColorCorrection {
    /// The corrected colour; both from 0 to 255.
    #[must_use]
    pub fn corrected(&self, color: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|i| self.gain[i] * color[i] + self.offset[i])
    }

    /// The corrected value of a cell that is a mixture of tiles which show the same colour: `sum of shares of (true - offset) /
    /// gain` is inverted. `tiles` holds the share and the correction of each tile; the shares add up to 1.
    #[must_use]
    pub fn corrected_mixture(value: f64, band: usize, tiles: &[(f64, Self)]) -> f64 {
        let slope: f64 = tiles.iter().map(|(share, c)| share / c.gain[band]).sum();
        let lift: f64 = tiles.iter().map(|(share, c)| share * c.offset[band] / c.gain[band]).sum();
        (value + lift) / slope
    }
}

/// Differences of grey values across a seam, of 255.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColorStep {
    /// Absolute value of the median difference before colours are corrected: how visible the seam would be.
    pub before: f64,
    /// The same after the correction.
    pub after: f64,
    /// Median of the absolute differences after the correction, with what two trainings of the same ground differ by in each
    /// cell.
    pub spread: f64,
}

/// The corrections of all tiles: `colour.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TileColors {
    /// Hash of the seams that the corrections were computed from.
    pub input_hash: String,
    /// Correction by ID of the tile.
    pub tiles: BTreeMap<String, ColorCorrection>,
}

impl TileColors {
    /// The correction of a tile; none is made to a tile without seams.
    #[must_use]
    pub fn of(&self, id: &str) -> ColorCorrection {
        self.tiles.get(id).copied().unwrap_or_default()
    }

    /// How far the grey values of two tiles differ across a seam; none without colours of both tiles.
    #[must_use]
    pub fn step(&self, seam: &Seam) -> Option<ColorStep> {
        let [a, b] = [0, 1].map(|i| self.of(&seam.tiles[i]));
        let gray = |c: [f64; 3]| (c[0] + c[1] + c[2]) / 3.0;
        let of = |pair: &[u8; 6], at: usize| [0, 1, 2].map(|i| f64::from(pair[at + i]));
        let pairs = || seam.colors.0.iter();
        let before = pairs().map(|p| gray(of(p, 0)) - gray(of(p, 3)));
        let after: Vec<f64> =
            pairs().map(|p| gray(a.corrected(of(p, 0))) - gray(b.corrected(of(p, 3)))).collect();
        Some(ColorStep {
            before: quantile(before.collect(), 0.5)?.abs(),
            after: quantile(after.clone(), 0.5)?.abs(),
            spread: quantile(after.into_iter().map(f64::abs).collect(), 0.5)?,
        })
    }

    /// The corrections that make the colours of tiles agree along seams with the least change: least squares with Huber
    /// weights over quantiles of the colours of each strip. Corrections that do not make the steps at the seams smaller are
    /// left out: where tiles agree as they are, the fit follows what differs between two trainings.
    #[must_use]
    pub fn solve(seams: &[Seam], input_hash: String) -> Self {
        let used = || seams.iter().filter(|s| s.colors.0.len() >= FEWEST_PAIRS);
        let ids: Vec<&String> = {
            let all: std::collections::BTreeSet<_> = used().flat_map(|s| &s.tiles).collect();
            all.into_iter().collect()
        };
        let place = |id: &String| ids.binary_search(&id).unwrap_or_default();
        let mut tiles: BTreeMap<String, ColorCorrection> =
            ids.iter().map(|id| ((*id).clone(), ColorCorrection::default())).collect();
        for band in 0..3 {
            let equations = used().flat_map(|s| {
                let colors = [band, band + 3].map(|at| quantiles(s.colors.0.iter().map(|p| p[at])));
                let at = [place(&s.tiles[0]), place(&s.tiles[1])];
                (0..QUANTILES.len())
                    .map(move |q| Equation { tiles: at, colors: [colors[0][q], colors[1][q]] })
            });
            let solved = Band { equations: equations.collect(), tiles: ids.len() }.solve();
            for (id, [offset, gain]) in ids.iter().zip(solved) {
                if let Some(c) = tiles.get_mut(*id) {
                    let gain = gain.clamp(-LARGEST_GAIN_CHANGE, LARGEST_GAIN_CHANGE);
                    c.gain[band] = 1.0 + gain;
                    c.offset[band] = 255.0 * (offset - MIDDLE * gain);
                }
            }
        }
        let used: Vec<&Seam> = used().collect();
        Self { input_hash, tiles }.where_it_helps(&used)
    }

    /// Without the corrections of tiles whose seams have smaller steps without them: of all tiles that seams connect at once,
    /// then of single tiles, as long as there are such.
    fn where_it_helps(mut self, seams: &[&Seam]) -> Self {
        for tiles in connected(seams) {
            self.drop_unless_it_helps(&tiles, seams);
        }
        let ids: Vec<String> = self.tiles.keys().cloned().collect();
        while ids.iter().any(|id| self.drop_unless_it_helps(std::slice::from_ref(id), seams)) {}
        self
    }

    /// Drops the corrections of tiles if the steps at their seams are not larger without them; whether there was something to
    /// drop.
    fn drop_unless_it_helps(&mut self, ids: &[String], seams: &[&Seam]) -> bool {
        let is_corrected = ids.iter().any(|id| self.of(id) != ColorCorrection::default());
        let own: Vec<&Seam> =
            seams.iter().copied().filter(|seam| seam.tiles.iter().any(|id| ids.contains(id))).collect();
        let steps = |colors: &Self| own.iter().filter_map(|seam| Some(colors.step(seam)?.after)).sum::<f64>();
        let mut without = self.clone();
        without.tiles.extend(ids.iter().map(|id| (id.clone(), ColorCorrection::default())));
        let is_dropped = is_corrected && steps(&without) <= steps(self);
        if is_dropped {
            *self = without;
        }
        is_dropped
    }
}

/// The IDs of tiles in groups that seams connect.
fn connected(seams: &[&Seam]) -> Vec<Vec<String>> {
    let mut groups: Vec<Vec<String>> = Vec::new();
    for seam in seams {
        let (joined, apart): (Vec<_>, Vec<_>) =
            groups.into_iter().partition(|group| seam.tiles.iter().any(|id| group.contains(id)));
        let mut group = joined.concat();
        group.extend(seam.tiles.iter().filter(|id| !group.contains(id)).cloned().collect::<Vec<_>>());
        groups = apart;
        groups.push(group);
    }
    groups
}

/// Quantiles of values, of 1.
fn quantiles(values: impl Iterator<Item = u8>) -> [f64; QUANTILES.len()] {
    let mut sorted: Vec<u8> = values.collect();
    sorted.sort_unstable();
    QUANTILES.map(|q| f64::from(sorted[(q * (sorted.len() - 1) as f64).round() as usize]) / 255.0)
}

/// A pair of colours, of 1, that should be the same after correction.
struct Equation {
    tiles: [usize; 2],
    colors: [f64; 2],
}

/// The equations of one colour band. Unknowns are offset and gain minus 1 of each tile.
struct Band {
    equations: Vec<Equation>,
    tiles: usize,
}

type Unknowns = Vec<[f64; 2]>;

impl Equation {
    /// The difference that a change of the unknowns makes.
    fn change(&self, x: &[[f64; 2]]) -> f64 {
        let side = |i: usize| {
            let [offset, gain] = x[self.tiles[i]];
            offset + gain * (self.colors[i] - MIDDLE)
        };
        side(0) - side(1)
    }

    fn add_transposed(&self, value: f64, to: &mut [[f64; 2]]) {
        for (i, sign) in [(0, 1.0), (1, -1.0)] {
            let at = &mut to[self.tiles[i]];
            at[0] += sign * value;
            at[1] += sign * value * (self.colors[i] - MIDDLE);
        }
    }
}

impl Band {
    fn solve(&self) -> Unknowns {
        let mut x = vec![[0.0; 2]; self.tiles];
        for _ in 0..REWEIGHTINGS {
            let weight = |e: &Equation| {
                let residual = (e.colors[0] - e.colors[1] + e.change(&x)).abs();
                if residual <= HUBER { 1.0 } else { HUBER / residual }
            };
            let weights: Vec<f64> = self.equations.iter().map(weight).collect();
            x = self.conjugate_gradients(&weights, x);
        }
        x
    }

    /// Solves the normal equations from a first solution.
    fn conjugate_gradients(&self, weights: &[f64], mut x: Unknowns) -> Unknowns {
        let mut pull = vec![0.0; self.tiles];
        let mut right = vec![[0.0; 2]; self.tiles];
        for (e, w) in self.equations.iter().zip(weights) {
            e.tiles.iter().for_each(|t| pull[*t] += PULL * w);
            e.add_transposed(-w * (e.colors[0] - e.colors[1]), &mut right);
        }
        let normal = |x: &Unknowns| {
            let mut out: Unknowns = x.iter().zip(&pull).map(|(x, p)| x.map(|v| v * p)).collect();
            for (e, w) in self.equations.iter().zip(weights) {
                e.add_transposed(w * e.change(x), &mut out);
            }
            out
        };
        let dot = |a: &Unknowns, b: &Unknowns| -> f64 {
            a.iter().zip(b).map(|(a, b)| a[0] * b[0] + a[1] * b[1]).sum()
        };
        let add = |a: &mut Unknowns, b: &Unknowns, factor: f64| {
            a.iter_mut().zip(b).for_each(|(a, b)| (0..2).for_each(|i| a[i] += factor * b[i]));
        };
        let mut residual = right.clone();
        add(&mut residual, &normal(&x), -1.0);
        let (mut direction, goal) = (residual.clone(), SMALLEST_RESIDUAL.powi(2) * dot(&right, &right));
        let mut size = dot(&residual, &residual);
        for _ in 0..MOST_ITERATIONS {
            if size <= goal || size == 0.0 {
                break;
            }
            let along = normal(&direction);
            let step = size / dot(&direction, &along);
            add(&mut x, &direction, step);
            add(&mut residual, &along, -step);
            let next = dot(&residual, &residual);
            let mut turned = residual.clone();
            add(&mut turned, &direction, next / size);
            (direction, size) = (turned, next);
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::super::seams::ColorPairs;
    use super::*;

    /// A seam between two tiles that show the same colours with their own gain and offset, and some noise.
    fn seam(a: usize, b: usize, seen: impl Fn(usize, f64) -> f64) -> Seam {
        let value = |tile: usize, k: usize| {
            let noise = 2.0 * ((k * 7919 + tile * 104_729) % 101) as f64 / 101.0 - 1.0;
            (seen(tile, 30.0 + 160.0 * (k % 97) as f64 / 97.0) + noise).round().clamp(0.0, 255.0) as u8
        };
        let pairs =
            (0..600).map(|k| [value(a, k), value(a, k), value(a, k), value(b, k), value(b, k), value(b, k)]);
        Seam {
            tiles: [a, b].map(|t| format!("t{t:02}")),
            line: [[0.0; 2]; 2],
            median_m: None,
            nmad_m: None,
            over_1m: None,
            cells: 0,
            colors: ColorPairs(pairs.collect()),
        }
    }

    /// The seams of a square of tiles.
    fn square(side: usize, seen: impl Fn(usize, f64) -> f64) -> Vec<Seam> {
        let at = |col, row| row * side + col;
        let across = (0..side).flat_map(|r| (1..side).map(move |c| (at(c - 1, r), at(c, r))));
        let down = (1..side).flat_map(|r| (0..side).map(move |c| (at(c, r - 1), at(c, r))));
        across.chain(down).map(|(a, b)| seam(a, b, &seen)).collect()
    }

    #[test]
    fn tiles_of_different_gains_and_offsets_agree_after_correction() {
        let gain = |t: usize| 0.85 + 0.3 * ((t * 37) % 11) as f64 / 11.0;
        let offset = |t: usize| 12.0 * ((t * 53) % 7) as f64 / 7.0 - 6.0;
        let seams = square(6, |t, v| gain(t) * v + offset(t));
        let colors = TileColors::solve(&seams, String::new());
        let steps: Vec<ColorStep> = seams.iter().filter_map(|s| colors.step(s)).collect();
        let worst = |of: fn(&ColorStep) -> f64| steps.iter().map(of).fold(0.0, f64::max);
        let (before, after, spread) = (worst(|s| s.before), worst(|s| s.after), worst(|s| s.spread));
        assert!(before > 10.0 && after < 2.0 && spread < 2.0, "{before} {after} {spread}");
        // The mean of all corrections is no change.
        let mean = colors.tiles.values().map(|c| c.gain[0]).sum::<f64>() / 36.0;
        assert!((mean - 1.0).abs() < 0.03, "{mean}");
    }

    #[test]
    fn tiles_that_agree_keep_their_colours() {
        let colors = TileColors::solve(&square(4, |_, v| v), String::new());
        for c in colors.tiles.values() {
            assert!(c.gain.iter().all(|g| (g - 1.0).abs() < 0.02), "{c:?}");
            assert!(c.offset.iter().all(|o| o.abs() < 2.0), "{c:?}");
        }
    }

    #[test]
    fn a_correction_that_makes_steps_larger_is_left_out() {
        // Four of ten places have changed between the trainings, always to the bright side of the same tiles: the tiles agree
        // in most places, and quantiles do not.
        let seams: Vec<Seam> = square(3, |_, v| v)
            .into_iter()
            .enumerate()
            .map(|(k, mut seam)| {
                for pair in seam.colors.0.iter_mut().step_by(5) {
                    (0..3).for_each(|band| pair[band] = pair[band].saturating_add(30 + 7 * (k % 3) as u8));
                }
                for pair in seam.colors.0.iter_mut().skip(1).step_by(5) {
                    (0..3).for_each(|band| pair[band] = pair[band].saturating_add(60));
                }
                seam
            })
            .collect();
        let colors = TileColors::solve(&seams, String::new());
        for step in seams.iter().filter_map(|s| colors.step(s)) {
            assert!(step.after <= step.before, "{step:?}");
        }
        // A tile that differs is corrected all the same.
        let differing = square(3, |t, v| if t == 4 { v + 9.0 } else { v });
        let colors = TileColors::solve(&differing, String::new());
        let steps: Vec<ColorStep> = differing.iter().filter_map(|s| colors.step(s)).collect();
        let total = |of: fn(&ColorStep) -> f64| steps.iter().map(of).sum::<f64>();
        assert!(total(|s| s.after) < 0.25 * total(|s| s.before), "{steps:?}");
    }

    #[test]
    fn a_strip_of_another_season_does_not_spoil_the_others() {
        let mut seams = square(4, |t, v| v + if t % 2 == 0 { 4.0 } else { -4.0 });
        seams[5] = seam(6, 7, |t, v| if t == 6 { v } else { 255.0 - v });
        let colors = TileColors::solve(&seams, String::new());
        let mut steps: Vec<f64> = seams.iter().filter_map(|s| Some(colors.step(s)?.after)).collect();
        steps.sort_by(f64::total_cmp);
        assert!(steps[seams.len() / 2] < 2.0, "{steps:?}");
    }

    #[test]
    fn a_mixture_of_tiles_is_corrected_exactly() {
        let of = |gain: f64, offset: f64| ColorCorrection { gain: [gain; 3], offset: [offset; 3] };
        let (a, b) = (of(1.25, -3.0), of(0.8, 7.0));
        let truth = 120.0;
        let seen = |c: &ColorCorrection| (truth - c.offset[0]) / c.gain[0];
        let mixture = 0.3 * seen(&a) + 0.7 * seen(&b);
        let corrected = ColorCorrection::corrected_mixture(mixture, 0, &[(0.3, a), (0.7, b)]);
        assert!((corrected - truth).abs() < 1e-9);
    }

    #[test]
    fn strips_of_too_few_colours_are_left_out() {
        let mut seams = square(2, |_, v| v);
        seams.iter_mut().for_each(|s| s.colors.0.truncate(3));
        assert!(TileColors::solve(&seams, String::new()).tiles.is_empty());
    }
}
