//! Matching along the epipolar segment that two cameras and a range of heights leave open.
//!
//! A keypoint of one view, localised at the lowest and the highest height, projects to the ends of a segment in the
//! other. RPCs err by a shift that is nearly the same for the whole image, so true matches lie at one distance
//! epipolar_tolerance_px the segments: that distance is found first, and what lies elsewhere is dropped.

use super::features::{Keypoint, VALUES, similarity};
use crate::frame::{Geodetic, Pixel, Point};
use crate::rpc::Rpc;
use multiversion::multiversion;
use rayon::prelude::*;

/// Side of the search grid's cells, pixels.
const CELL_PX: f64 = 24.0;
/// The second best must be this much worse (ratio of descriptor distances).
const RATIO: f32 = 0.8;
/// Descriptors further apart than this are no match, whatever the ratio.
const MAX_DISTANCE: f32 = 0.75;
/// Keypoints nearer than this are the same place seen twice, not a rival, pixels.
const SAME_PLACE_PX: f64 = 2.0;
/// Largest ratio of the scales of matching keypoints.
const MAX_SCALE_RATIO: f32 = 1.8;
/// Matches that agree on the distance epipolar_tolerance_px the segments, pixels from the consensus.
const CONSENSUS_PX: f64 = 1.5;
/// Fewest matches that make a consensus.
const FEWEST: usize = 10;
/// Keypoints searched for together.
const CHUNK: usize = 512;

/// A view ready to be matched.
pub struct MatchView<'a> {
    /// Its camera.
    pub rpc: &'a Rpc,
    /// Its keypoints.
    pub keypoints: &'a [Keypoint],
    /// Each keypoint's ground at the lowest and highest height.
    ground: Vec<Option<[Point<Geodetic>; 2]>>,
    columns: usize,
    rows: usize,
    /// Keypoints of each cell of the search grid.
    cells: Vec<Vec<u32>>,
}

/// A pair of keypoints, by index.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    /// In the first view.
    pub a: u32,
    /// In the second view.
    pub b: u32,
    /// Scalar product of the descriptors.
    pub similarity: f32,
}

impl<'a> MatchView<'a> {
    /// Prepares a view for heights `low..high` metres.
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

    /// Best and second best in each other of the keypoints of both views, `epipolar_tolerance_px` pixels from the segments of this
    /// view's; a keypoint of the other is weighed only where a segment passes, so that one search serves both.
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

/// Where a keypoint of one view can lie in another.
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
        // Views from one direction leave a point: any direction will do.
        let direction = if length > 1e-6 { [dc / length, dr / length] } else { [1.0, 0.0] };
        Some(Self { ends, direction, length })
    }

    /// Distance along the segment from its low end, and epipolar_tolerance_px it, pixels.
    fn measure(&self, px: Pixel<crate::frame::CenterPx>) -> (f64, f64) {
        let (dc, dr) = (px.col - self.ends[0].col, px.row - self.ends[0].row);
        let [c, r] = self.direction;
        (dc * c + dr * r, c * dr - r * dc)
    }
}

/// Fills in the similarities of a keypoint to others.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx2+fma", "x86_64+avx2+fma"))]
fn compare(own: &Keypoint, others: &[Keypoint], near: &mut [(u32, f32)]) {
    for (j, s) in near {
        *s = similarity(&own.descriptor, &others[*j as usize].descriptor);
    }
}

/// The keypoint most like another, and how like it is the next that is elsewhere.
#[derive(Clone, Copy)]
struct BestTwo {
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
    fn enter(&mut self, candidate: u32, similarity: f32, keypoints: &[Keypoint]) {
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

    /// The best, if it is good and better than its best.
    fn winner(&self) -> Option<u32> {
        // Descriptors have length one: their squared distance is 2 - 2 similarity.
        let distance = |s: f32| (2.0 - 2.0 * s).max(0.0).sqrt();
        let (d1, d2) = (distance(self.similarity), distance(self.second));
        (self.best != u32::MAX && d1 < RATIO * d2 && d1 < MAX_DISTANCE).then_some(self.best)
    }
}

/// Mutual matches of two views within `epipolar_tolerance_px` pixels of the epipolar segments that agree on one shift.
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

/// The centre of the window of `2 CONSENSUS_PX` that holds most of the offsets; none if it is no better than
/// chance would make it.
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
    // Evenly spread offsets put this many into a window.
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
