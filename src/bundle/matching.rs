//! Matching along epipolar segments.
//!
//! A keypoint of one view, localised at the lowest and at the highest height of the scene, projects to the two ends of
//! a segment in the other view. RPCs are wrong by a shift that is nearly constant over an image, so that correct
//! matches all lie at one signed distance across their segments. This distance is estimated first, and matches at other
//! distances are dropped.

use super::features::{Keypoint, VALUES, similarity};
use crate::frame::{Geodetic, Pixel, Point};
use crate::rpc::Rpc;
use multiversion::multiversion;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Side of the cells of the search grid, pixels.
const CELL_PX: f64 = 24.0;
/// Ratio test: largest ratio of the best descriptor distance to the second best.
const RATIO: f32 = 0.8;
/// Largest descriptor distance of a match.
const MAX_DISTANCE: f32 = 0.75;
/// Keypoints nearer than this show the same place and do not compete in the ratio test, pixels.
const SAME_PLACE_PX: f64 = 2.0;
/// Largest ratio of the scales of matching keypoints.
const MAX_SCALE_RATIO: f32 = 1.8;
/// Largest deviation of a match from the common distance across the segments, pixels.
const CONSENSUS_PX: f64 = 1.5;
/// Smallest number of matches that define a common distance.
const FEWEST: usize = 10;
/// Keypoints that a thread matches at a time.
const CHUNK: usize = 512;

/// A view prepared for matching.
pub struct MatchView<'a> {
    /// Its camera.
    pub rpc: &'a Rpc,
    /// Its keypoints.
    pub keypoints: &'a [Keypoint],
    /// Ground positions of each keypoint at the lowest and at the highest height.
    ground: Vec<Option<[Point<Geodetic>; 2]>>,
    columns: usize,
    rows: usize,
    /// Indices of the keypoints in each cell of the search grid.
    cells: Vec<Vec<u32>>,
}

/// A pair of matching keypoints, by index.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Match {
    /// Keypoint of the first view.
    pub a: u32,
    /// Keypoint of the second view.
    pub b: u32,
    /// Scalar product of the descriptors.
    pub similarity: f32,
}

impl<'a> MatchView<'a> {
    /// Prepares a view for ground heights from `low` to `high`, metres.
    #[must_use]
    pub fn new(
        rpc: &'a Rpc,
        keypoints: &'a [Keypoint],
        (width, height): (usize, usize),
        (low, high): (f64, f64),
    ) -> Self {
        let columns = (width as f64 / CELL_PX).ceil() as usize;
        let rows = (height as f64 / CELL_PX).ceil() as usize;
        let mut cells = vec![Vec::new(); columns * rows];
        for (i, k) in keypoints.iter().enumerate() {
            let cell = |v: f64, n: usize| ((v / CELL_PX) as usize).min(n - 1);
            cells[cell(k.px.row, rows) * columns + cell(k.px.col, columns)].push(i as u32);
        }
        let ground = keypoints
            .par_iter()
            .map(|k| {
                let lowest = rpc.localize(k.px, low).ok()?;
                let highest = rpc.localize_from(k.px, lowest.at_height(high)).ok()?;
                Some([lowest, highest])
            })
            .collect();
        Self { rpc, keypoints, ground, columns, rows, cells }
    }

    /// For every keypoint of both views the best and the second best keypoint of the other view, among those within
    /// `epipolar_tolerance_px` of the epipolar segment. The segments are those of this view's keypoints; one search
    /// serves both directions.
    fn best_two(&self, other: &Self, epipolar_tolerance_px: f64) -> [Vec<BestTwo>; 2] {
        let chunks: Vec<_> = (0..self.keypoints.len().div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                let own = chunk * CHUNK..((chunk + 1) * CHUNK).min(self.keypoints.len());
                let mut there = vec![BestTwo::default(); other.keypoints.len()];
                let mut near = Vec::new();
                let here = own.map(|i| {
                    let mut best = BestTwo::default();
                    let Some(segment) = Segment::new(self, i, other) else { return best };
                    let own = &self.keypoints[i];
                    near.clear();
                    other.for_each_near(&segment, epipolar_tolerance_px, |j| {
                        let ratio = other.keypoints[j as usize].scale / own.scale;
                        if (1.0 / MAX_SCALE_RATIO..=MAX_SCALE_RATIO).contains(&ratio) {
                            near.push((j, 0.0));
                        }
                    });
                    compare(own, other.keypoints, &mut near);
                    for (j, similarity) in &near {
                        best.enter(*j, *similarity, other.keypoints);
                        there[*j as usize].enter(i as u32, *similarity, self.keypoints);
                    }
                    best
                });
                (here.collect::<Vec<_>>(), there)
            })
            .collect();
        let mut out =
            [Vec::with_capacity(self.keypoints.len()), vec![BestTwo::default(); other.keypoints.len()]];
        for (here, there) in chunks {
            out[0].extend(here);
            for (all, part) in out[1].iter_mut().zip(there) {
                all.join(part, self.keypoints);
            }
        }
        out
    }

    fn for_each_near(&self, segment: &Segment, epipolar_tolerance_px: f64, mut visit: impl FnMut(u32)) {
        let [(c0, c1), (r0, r1)] =
            [(segment.ends[0].col, segment.ends[1].col), (segment.ends[0].row, segment.ends[1].row)];
        let cell_range = |a: f64, b: f64, n: usize| {
            let (lo, hi) =
                ((a.min(b) - epipolar_tolerance_px) / CELL_PX, (a.max(b) + epipolar_tolerance_px) / CELL_PX);
            (hi >= 0.0 && lo < n as f64).then(|| (lo.max(0.0) as usize, (hi as usize).min(n - 1)))
        };
        let (Some((c0, c1)), Some((r0, r1))) =
            (cell_range(c0, c1, self.columns), cell_range(r0, r1, self.rows))
        else {
            return;
        };
        for row in r0..=r1 {
            for col in c0..=c1 {
                for &j in &self.cells[row * self.columns + col] {
                    let (along, off) = segment.measure(self.keypoints[j as usize].px);
                    if off.abs() <= epipolar_tolerance_px
                        && along >= -epipolar_tolerance_px
                        && along <= segment.length + epipolar_tolerance_px
                    {
                        visit(j);
                    }
                }
            }
        }
    }
}

/// The epipolar segment of a keypoint: its possible positions in the other view.
struct Segment {
    ends: [Pixel<crate::frame::CenterPx>; 2],
    direction: [f64; 2],
    length: f64,
}

impl Segment {
    fn new(from: &MatchView, keypoint: usize, to: &MatchView) -> Option<Self> {
        let ends = from.ground[keypoint]?.map(|p| to.rpc.project(p));
        let (dc, dr) = (ends[1].col - ends[0].col, ends[1].row - ends[0].row);
        let length = dc.hypot(dr);
        if !length.is_finite() {
            return None;
        }
        // For parallel lines of sight the segment is a point, and any direction will do.
        let direction = if length > 1e-6 { [dc / length, dr / length] } else { [1.0, 0.0] };
        Some(Self { ends, direction, length })
    }

    /// Distance along the segment from its low end, and signed distance across it, pixels.
    fn measure(&self, px: Pixel<crate::frame::CenterPx>) -> (f64, f64) {
        let (dc, dr) = (px.col - self.ends[0].col, px.row - self.ends[0].row);
        let [c, r] = self.direction;
        (dc * c + dr * r, c * dr - r * dc)
    }
}

/// Computes the similarity of a keypoint to others.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx2+fma", "x86_64+avx2+fma"))]
pub(super) fn compare(own: &Keypoint, others: &[Keypoint], near: &mut [(u32, f32)]) {
    for (j, s) in near {
        *s = similarity(&own.descriptor, &others[*j as usize].descriptor);
    }
}

/// The most similar keypoint, its similarity, and the similarity of the second best, which lies elsewhere.
#[derive(Clone, Copy)]
pub(super) struct BestTwo {
    best: u32,
    similarity: f32,
    second: f32,
}

impl Default for BestTwo {
    fn default() -> Self {
        Self { best: u32::MAX, similarity: -1.0, second: -1.0 }
    }
}

impl BestTwo {
    pub(super) fn enter(&mut self, candidate: u32, similarity: f32, keypoints: &[Keypoint]) {
        if similarity <= self.second {
            return;
        }
        let place = |i: u32| keypoints[i as usize].px;
        let elsewhere = self.best != u32::MAX && place(self.best).distance(place(candidate)) > SAME_PLACE_PX;
        if similarity > self.similarity {
            if elsewhere {
                self.second = self.similarity;
            }
            (self.best, self.similarity) = (candidate, similarity);
        } else if elsewhere {
            self.second = self.second.max(similarity);
        }
    }

    fn join(&mut self, other: Self, keypoints: &[Keypoint]) {
        if other.best != u32::MAX {
            self.enter(other.best, other.similarity, keypoints);
            self.second = self.second.max(other.second);
        }
    }

    /// The best keypoint if it passes the distance threshold and the ratio test.
    pub(super) fn winner(&self) -> Option<u32> {
        // Descriptors have length 1, so that their squared distance is 2 - 2 similarity.
        let distance = |s: f32| (2.0 - 2.0 * s).max(0.0).sqrt();
        let (d1, d2) = (distance(self.similarity), distance(self.second));
        (self.best != u32::MAX && d1 < RATIO * d2 && d1 < MAX_DISTANCE).then_some(self.best)
    }
}

/// Mutual best matches of two views within `epipolar_tolerance_px` of their epipolar segments that agree on one
/// distance across the segments.
#[must_use]
pub fn matches(a: &MatchView, b: &MatchView, epipolar_tolerance_px: f64) -> Vec<Match> {
    let [ab, ba] = a.best_two(b, epipolar_tolerance_px);
    let mutual: Vec<(Match, f64)> = ab
        .iter()
        .enumerate()
        .filter_map(|(i, best)| {
            let j = best.winner()?;
            let back = ba[j as usize].winner()?;
            let off = Segment::new(a, i, b)?.measure(b.keypoints[j as usize].px).1;
            let found = Match { a: i as u32, b: j, similarity: best.similarity };
            (back as usize == i).then_some((found, off))
        })
        .collect();
    let Some(shift) = consensus(mutual.iter().map(|m| m.1).collect()) else { return Vec::new() };
    mutual.into_iter().filter(|m| (m.1 - shift).abs() <= CONSENSUS_PX).map(|m| m.0).collect()
}

/// Centre of the window of width `2 CONSENSUS_PX` that holds the most offsets; none if evenly spread offsets would fill
/// it as well.
fn consensus(mut offsets: Vec<f64>) -> Option<f64> {
    offsets.sort_by(f64::total_cmp);
    let mut end = 0;
    let mut best = (0, 0);
    for start in 0..offsets.len() {
        while end < offsets.len() && offsets[end] - offsets[start] <= 2.0 * CONSENSUS_PX {
            end += 1;
        }
        if end - start > best.1 - best.0 {
            best = (start, end);
        }
    }
    let inside = best.1 - best.0;
    let span = offsets.last()? - offsets.first()?;
    // Number of offsets in the window if they were evenly spread.
    let by_chance = offsets.len() as f64 * (2.0 * CONSENSUS_PX / span.max(2.0 * CONSENSUS_PX));
    let enough = inside >= FEWEST && (inside as f64 > 2.0 * by_chance || span < 8.0 * CONSENSUS_PX);
    enough.then(|| offsets[best.0 + inside / 2])
}

const _: () = assert!(VALUES.is_multiple_of(16), "similarity sums sixteen values at a time");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn consensus_finds_a_shift_among_outliers() {
        let mut offsets: Vec<f64> = (0..100).map(|i| 36.2 + 0.01 * f64::from(i)).collect();
        offsets.extend((0..150).map(|i| -60.0 + 0.8 * f64::from(i)));
        assert!((consensus(offsets).unwrap() - 36.7).abs() < 0.6);
    }

    #[test]
    fn even_offsets_have_no_consensus() {
        assert!(consensus((0..200).map(|i| -60.0 + 0.6 * f64::from(i)).collect()).is_none());
    }
}
