//! Where the colour camera of RGB-D frames is seen from that of their depth maps, by edges of the images.
//!
//! Where a near surface ends in front of a far one, the image mostly has an edge. So the near pixels at jumps of the depth maps are
//! projected with other focal lengths and other places of the colour camera, and those are taken for which the image is brightest
//! there, as a map of its edges. They are kept only if they fit far better than the stated ones.

use super::error::PerspectiveError;
use super::view::PerspectiveView;
use crate::io::Grid2;
use crate::stats::quantile;
use glam::DVec2;
use rayon::prelude::*;

/// Number of points of a frame.
const POINTS: usize = 3000;
/// Fewest points that say anything.
const FEWEST_POINTS: usize = 2000;
/// A depth map jumps where it is farther by this, metres, so many pixels away.
const JUMP_M: f32 = 0.15;
const JUMP_PX: usize = 3;
/// Edges are as strong as this quantile of the gradients at most, so that a few do not decide.
const STRONGEST: f64 = 0.97;
/// Half the side of the window in which edges are averaged, pixels.
const BLUR_PX: usize = 2;
/// Of the first search: the largest change of the focal length as a share, the largest shift to the side, metres, and their steps.
const FOCAL: (f64, f64) = (0.2, 0.01);
const SHIFT_M: (f64, f64) = (0.06, 0.005);
/// Steps of the second search begin at half of those and are halved so many times.
const HALVINGS: usize = 4;
/// The edges at the points must be stronger than with the stated camera by this factor, and than those of the image by this number
/// of standard deviations.
const BETTER: f64 = 1.3;
const CLEAR: f64 = 0.15;

/// The colour camera as edges show it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct EdgeFit {
    /// Focal length of the colours over that of the depth maps.
    pub focal_ratio: f64,
    /// Place of the depth camera in the axes (right, down) of the colour camera, metres, if the stated camera is that of the depths.
    pub offset_m: [f64; 2],
    /// Mean strength of the image's edges at jumps of the depth, over their standard deviation, with the stated camera and with
    /// this one.
    pub edges: [f64; 2],
}

impl EdgeFit {
    /// The camera of the colours of frames if edges say that it is another one than that of their depths.
    ///
    /// Frames that cannot be read are passed over: whoever needs them says what is wrong with them.
    pub(super) fn find(frames: &[&PerspectiveView]) -> Option<Self> {
        let read = frames.par_iter().map(|view| Frame::read(view).ok());
        search(&read.collect::<Vec<_>>().into_iter().flatten().collect::<Vec<_>>())
    }
}

/// The edges of an image and the near pixels at jumps of its depth map.
struct Frame {
    /// Strengths of edges with mean zero and standard deviation one.
    edges: Grid2,
    /// Directions (right, down; at depth one) and depths of the pixels, metres.
    points: Vec<(DVec2, f64)>,
    focal: DVec2,
    principal: DVec2,
}

/// The colour camera that fits far better than the stated one.
fn search(frames: &[Frame]) -> Option<EdgeFit> {
    if frames.iter().map(|frame| frame.points.len()).sum::<usize>() < FEWEST_POINTS {
        return None;
    }
    // Every second frame is not searched with, and decides whether what was found is better.
    let half = |first: usize| frames.iter().skip(first).step_by(2).collect::<Vec<&Frame>>();
    let (searched, others) = (half(0), half(1));
    let score_of = |frames: &[&Frame], c: &[f64; 3]| {
        let points = frames.iter().map(|frame| frame.points.len()).sum::<usize>();
        frames.iter().map(|frame| frame.edges_at(c)).sum::<f64>() / points.max(1) as f64
    };
    let score = |c: &[f64; 3]| score_of(&searched, c);
    // The largest score, and of equal ones the first.
    let best = |candidates: Vec<[f64; 3]>| {
        let scores: Vec<f64> = candidates.par_iter().map(score).collect();
        let first = (0..scores.len()).rev().max_by(|a, b| scores[*a].total_cmp(&scores[*b]));
        first.map_or((f64::MIN, [1.0, 0.0, 0.0]), |i| (scores[i], candidates[i]))
    };
    let grid = |(most, step): (f64, f64)| {
        let count = (most / step).round() as i32;
        (-count..=count).map(move |k| f64::from(k) * step)
    };
    let coarse = grid(FOCAL).flat_map(|f| grid(SHIFT_M).map(move |x| [1.0 + f, x, 0.0]));
    let mut found = best(coarse.collect());
    let mut steps = [FOCAL.1, SHIFT_M.1, SHIFT_M.1];
    for _ in 0..HALVINGS {
        steps = steps.map(|s| 0.5 * s);
        loop {
            let signs = [-1.0, 0.0, 1.0];
            let [f, x, y] = found.1;
            let near =
                signs.iter().flat_map(|a| signs.iter().flat_map(|b| signs.iter().map(|c| [*a, *b, *c])));
            let near = near.map(|[a, b, c]| [f + a * steps[0], x + b * steps[1], y + c * steps[2]]);
            let near = near.filter(|[f, x, y]| {
                (f - 1.0).abs() <= FOCAL.0 && x.abs() <= SHIFT_M.0 && y.abs() <= SHIFT_M.0
            });
            let next = best(near.collect());
            if next.0 <= found.0 {
                break;
            }
            found = next;
        }
    }
    let [focal_ratio, x, y] = found.1;
    let (fitted, stated) = (score_of(&others, &found.1), score_of(&others, &[1.0, 0.0, 0.0]));
    let is_better = fitted > CLEAR && fitted > BETTER * stated;
    is_better.then_some(EdgeFit { focal_ratio, offset_m: [x, y], edges: [stated, fitted] })
}

impl Frame {
    fn read(view: &PerspectiveView) -> Result<Self, PerspectiveError> {
        let (colors, depth) = (view.read_file()?, view.depth_of_file()?);
        let gray: Vec<f32> = (0..depth.data.len()).map(|i| colors.iter().map(|c| c.data[i]).sum()).collect();
        let lens = &view.lens_camera;
        let gray = Grid2 { data: gray, ..depth };
        Ok(Self {
            edges: edges(&gray),
            points: near_points(&depth, lens.focal, lens.principal),
            focal: lens.focal,
            principal: lens.principal,
        })
    }

    /// Sum of the edges at the points, seen with a share of the focal length from a shifted place; points outside of the image add
    /// nothing.
    fn edges_at(&self, [ratio, x, y]: &[f64; 3]) -> f64 {
        let mut sum = 0.0;
        for (direction, depth) in &self.points {
            let at = self.principal + *ratio * self.focal * (*direction + DVec2::new(*x, *y) / *depth);
            let (col, row) = (at.x.round(), at.y.round());
            if col >= 0.0 && row >= 0.0 && col < self.edges.width as f64 && row < self.edges.height as f64 {
                sum += f64::from(self.edges.data[row as usize * self.edges.width + col as usize]);
            }
        }
        sum
    }
}

/// Strengths of the edges of an image, averaged in a window, with mean zero and standard deviation one; zero at its margin.
fn edges(gray: &Grid2) -> Grid2 {
    let (width, height) = (gray.width, gray.height);
    let at = |col: usize, row: usize| gray.data[row * width + col];
    let inside = |col: usize, row: usize, by: usize| {
        (by..width.saturating_sub(by)).contains(&col) && (by..height.saturating_sub(by)).contains(&row)
    };
    let gradient = Grid2::from_fn(width, height, |col, row| {
        if !inside(col, row, 1) {
            return 0.0;
        }
        let steepness = (at(col + 1, row) - at(col - 1, row)).hypot(at(col, row + 1) - at(col, row - 1));
        if steepness.is_nan() { 0.0 } else { steepness }
    });
    let most =
        quantile(gradient.data.iter().map(|v| f64::from(*v)).collect(), STRONGEST).unwrap_or(0.0) as f32;
    let windowed = Grid2::from_fn(width, height, |col, row| {
        if !inside(col, row, BLUR_PX) {
            return 0.0;
        }
        let rows = row - BLUR_PX..=row + BLUR_PX;
        rows.flat_map(|r| &gradient.data[r * width + col - BLUR_PX..=r * width + col + BLUR_PX])
            .map(|v| v.min(most))
            .sum()
    });
    let (values, count) = (|| windowed.data.iter().map(|v| f64::from(*v)), windowed.data.len().max(1) as f64);
    let mean = values().sum::<f64>() / count;
    let deviation = (values().map(|v| (v - mean).powi(2)).sum::<f64>() / count).sqrt();
    let scale = if deviation > 0.0 { deviation.recip() } else { 0.0 };
    let (mean, scale) = (mean as f32, scale as f32);
    Grid2::from_fn(width, height, |col, row| (windowed.data[row * width + col] - mean) * scale)
}

/// Some of the pixels of a depth map that are much nearer than others close by.
fn near_points(depth: &Grid2, focal: DVec2, principal: DVec2) -> Vec<(DVec2, f64)> {
    let (width, height) = (depth.width, depth.height);
    let at = |col: usize, row: usize| depth.data[row * width + col];
    let is_near = |col: usize, row: usize| {
        let limit = at(col, row) + JUMP_M;
        let others = [(col - JUMP_PX, row), (col + JUMP_PX, row), (col, row - JUMP_PX), (col, row + JUMP_PX)];
        others.into_iter().any(|(c, r)| at(c, r) > limit)
    };
    let rows = JUMP_PX..height.saturating_sub(JUMP_PX);
    let pixels = rows.flat_map(|row| (JUMP_PX..width.saturating_sub(JUMP_PX)).map(move |col| (col, row)));
    let points = pixels.filter(|(col, row)| is_near(*col, *row)).map(|(col, row)| {
        let pixel = DVec2::new(col as f64, row as f64);
        ((pixel - principal) / focal, f64::from(at(col, row)))
    });
    let points: Vec<(DVec2, f64)> = points.collect();
    let step = points.len().div_ceil(POINTS).max(1);
    points.into_iter().step_by(step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::perspective::{LensCamera, SensorCamera};
    use crate::random::CounterRng;
    use glam::DVec3;

    const SIZE: (usize, usize) = (320, 240);
    const PRINCIPAL: DVec2 = DVec2::new(159.5, 119.5);

    /// Boards of random size, shade and depth before a wall; of a pixel of a camera the nearest board's shade and depth.
    struct Boards(Vec<([f64; 4], f64, f32)>);

    impl Boards {
        fn random(seed: u64) -> Self {
            let mut draw = CounterRng::new(seed, 0, 0, 0);
            let mut within = |low: f64, high: f64| low + (high - low) * draw.uniform();
            let board = |_| {
                let z = within(1.0, 3.0);
                let (x, y) = (within(-0.6, 0.6) * z, within(-0.45, 0.45) * z);
                let half = [within(0.05, 0.25), within(0.05, 0.25)];
                ([x - half[0], x + half[0], y - half[1], y + half[1]], z, within(0.0, 1.0) as f32)
            };
            let mut boards: Vec<_> = (0..25).map(board).collect();
            boards.sort_by(|a, b| a.1.total_cmp(&b.1));
            boards.push(([-9.0, 9.0, -9.0, 9.0], 4.0, 0.5));
            Self(boards)
        }

        fn seen(&self, col: usize, row: usize, focal: f64, from: [f64; 2]) -> (f32, f32) {
            let at = (DVec2::new(col as f64, row as f64) - PRINCIPAL) / focal;
            let hit = |(box_, z, _): &&([f64; 4], f64, f32)| {
                let (x, y) = (at.x * z + from[0], at.y * z + from[1]);
                x >= box_[0] && x <= box_[1] && y >= box_[2] && y <= box_[3]
            };
            self.0.iter().find(hit).map_or((0.0, f32::NAN), |b| (b.2, b.1 as f32))
        }

        /// A frame whose colour camera has another focal length and sees the depth camera at an offset.
        fn frame(&self, ratio: f64, offset: [f64; 2], is_flat: bool) -> Frame {
            let focal = 290.0;
            let depth = Grid2::from_fn(SIZE.0, SIZE.1, |col, row| self.seen(col, row, focal, [0.0; 2]).1);
            let from = offset.map(|v| -v);
            let gray = Grid2::from_fn(SIZE.0, SIZE.1, |col, row| match is_flat {
                true => ((col * 7919 + row * 104_729) % 97) as f32 / 97.0,
                false => self.seen(col, row, ratio * focal, from).0,
            });
            let focal = DVec2::splat(focal);
            let points = near_points(&depth, focal, PRINCIPAL);
            Frame { edges: edges(&gray), points, focal, principal: PRINCIPAL }
        }
    }

    fn frames(ratio: f64, offset: [f64; 2], is_flat: bool) -> Vec<Frame> {
        (0..4).map(|seed| Boards::random(seed).frame(ratio, offset, is_flat)).collect()
    }

    #[test]
    fn the_colour_camera_of_a_sensor_is_found_from_edges() {
        for (ratio, offset) in [(0.9, [-0.02, -0.004]), (1.08, [0.03, 0.005])] {
            let found = search(&frames(ratio, offset, false)).expect("another camera");
            assert!((found.focal_ratio - ratio).abs() < 0.006, "{found:?}");
            let off = [0, 1].map(|k| (found.offset_m[k] - offset[k]).abs());
            assert!(off.iter().all(|v| *v < 0.006), "{found:?}");
        }
    }

    #[test]
    fn registered_frames_and_images_without_edges_at_jumps_keep_the_stated_camera() {
        assert_eq!(search(&frames(1.0, [0.0; 2], false)), None);
        assert_eq!(search(&frames(1.0, [0.002, 0.0], false)), None);
        assert_eq!(search(&frames(0.9, [-0.02, 0.0], true)), None);
        assert_eq!(search(&[]), None);
    }

    #[test]
    fn depths_are_brought_to_the_colour_camera() {
        let boards = Boards::random(3);
        let depth = |focal: f64, from: [f64; 2]| {
            Grid2::from_fn(SIZE.0, SIZE.1, |col, row| boards.seen(col, row, focal, from).1)
        };
        let focal = DVec2::splat(290.0);
        let camera = SensorCamera { focal, principal: PRINCIPAL, center: DVec3::new(-0.02, -0.004, 0.0) };
        let lens = LensCamera::pinhole(0.9 * focal, PRINCIPAL, SIZE);
        let (found, expected) = (camera.seen_by(&lens, &depth(290.0, [0.0; 2])), depth(261.0, [0.02, 0.004]));
        let known = found.data.iter().zip(&expected.data).filter(|(a, _)| !a.is_nan());
        let off = known.clone().filter(|(a, b)| (*a - *b).abs() > 1e-4).count();
        let (off, all) = (off as f64, known.count() as f64);
        assert!(all > 0.9 * 0.8 * (SIZE.0 * SIZE.1) as f64 && off < 0.05 * all, "{off} of {all} pixels");
    }
}
