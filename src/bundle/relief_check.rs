//! Whether pairs of views see the relief upside down.
//!
//! Two views whose RPCs are exchanged agree perfectly with each other, with roofs as pits: their parallax has the wrong sign, which
//! residuals do not tell. Two pairs without a common view measure the heights of the same tracks independently of each other, so
//! that these must rise and fall together.

use super::correction::Parameters;
use super::network::{LEAST_ANGLE_DEG, Network, triangulate};
use super::problem::Track;
use crate::scene::angle_between_deg;
use crate::stats::median;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Numbers of tracks of four or more views with which pairs are compared.
const FEWEST_TRACKS: usize = 50;
const MOST_TRACKS: usize = 500;
/// Median correlation with the heights of other pairs below which a pair sees the relief upside down. That of sound pairs is
/// positive; where the ground is flat, it is 0 with a standard deviation of 0.14 for the fewest tracks.
const OPPOSITE: f64 = -0.5;

/// Pairs of views, by index, whose heights fall where those of most other pairs rise. `tracks` are those of the matches, before any are
/// rejected for their residuals.
pub(super) fn upside_down(
    network: &Network,
    tracks: &[Track],
    corrections: &[Parameters],
) -> Vec<(usize, usize)> {
    let seen: Vec<&Track> = tracks.iter().filter(|t| t.observations.len() >= 4).take(MOST_TRACKS).collect();
    if seen.len() < FEWEST_TRACKS {
        return Vec::new();
    }
    let block = network.block();
    // Heights by pair, each with the number of its track.
    let of_track = |(k, track): (usize, &&Track)| {
        let mut heights = Vec::new();
        for (i, a) in track.observations.iter().enumerate() {
            for b in &track.observations[i + 1..] {
                let directions = [a.view, b.view].map(|view| network.directions[view]);
                if angle_between_deg(directions[0], directions[1]) < LEAST_ANGLE_DEG {
                    continue;
                }
                let pair = Track { observations: vec![*a, *b], ..Track::default() };
                if let Some(point) = triangulate(&block, &pair, corrections) {
                    heights.push(((a.view.min(b.view), a.view.max(b.view)), (k, point[2])));
                }
            }
        }
        heights
    };
    let all: Vec<_> = seen.par_iter().enumerate().flat_map_iter(of_track).collect();
    let mut by_pair: BTreeMap<(usize, usize), BTreeMap<usize, f64>> = BTreeMap::new();
    for (pair, (track, height)) in all {
        by_pair.entry(pair).or_default().insert(track, height);
    }
    let is_opposite = |(pair, heights): &(&(usize, usize), &BTreeMap<usize, f64>)| {
        let is_apart = |other: &&(usize, usize)| {
            ![other.0, other.1].contains(&pair.0) && ![other.0, other.1].contains(&pair.1)
        };
        let others = by_pair.iter().filter(|(other, _)| is_apart(other));
        let alike = others.filter_map(|(_, of_other)| correlation(heights, of_other)).collect();
        median(alike).is_some_and(|alike| alike < OPPOSITE)
    };
    by_pair.iter().filter(is_opposite).map(|(pair, _)| *pair).collect()
}

/// Correlation of heights of the same tracks; none of too few, or of level ones.
fn correlation(a: &BTreeMap<usize, f64>, b: &BTreeMap<usize, f64>) -> Option<f64> {
    let both: Vec<[f64; 2]> =
        a.iter().filter_map(|(track, height)| Some([*height, *b.get(track)?])).collect();
    if both.len() < FEWEST_TRACKS {
        return None;
    }
    let mean = [0, 1].map(|k| both.iter().map(|h| h[k]).sum::<f64>() / both.len() as f64);
    let product = |j: usize, k: usize| both.iter().map(|h| (h[j] - mean[j]) * (h[k] - mean[k])).sum::<f64>();
    let r = product(0, 1) / (product(0, 0) * product(1, 1)).sqrt();
    r.is_finite().then_some(r)
}
