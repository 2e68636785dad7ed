//! Features that match between RGB-D frames: how well cameras of colours and depths fit them.

use super::epipolar::{Motion, RigidMatches, ViewFeatures, neighbours};
use super::pinhole::PinholeCamera;
use super::pose::Pose;
use super::view::PerspectiveView;
use crate::io::Grid2;
use crate::stats::median;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// Frames with which each frame is compared, and the largest number of frames from which they are chosen.
const COMPARED: usize = 2;
const CHOSEN_FROM: usize = 400;
/// Fewest pairs of frames with matches that say something.
const FEWEST_PAIRS: usize = 4;
/// Matches that two pairs of cameras place differently, pixels, and the fewest of them that say which is right.
const DIFFERENT_PX: f64 = 0.5;
const FEWEST_DIFFERENT: usize = 30;
/// Steps in which the depth along a ray of the colour camera is found in a map of the depth camera.
const STEPS: usize = 4;

/// The cameras of a sensor, relative to the stated one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SensorCameras {
    /// Focal length of the colours over the stated one.
    pub color_focal: f64,
    /// Focal length of the depth maps over the stated one.
    pub depth_focal: f64,
    /// Place of the depth camera in the axes (right, down) of the colour camera, metres.
    pub offset_m: [f64; 2],
    /// Whether the stated poses are those of the depth camera.
    pub poses_of_depths: bool,
}

impl SensorCameras {
    /// One camera, the stated one.
    pub(super) const STATED: Self =
        Self { color_focal: 1.0, depth_focal: 1.0, offset_m: [0.0; 2], poses_of_depths: false };

    fn offset(&self) -> DVec2 {
        DVec2::from_array(self.offset_m)
    }

    /// The pose of the colour camera.
    fn color_pose(&self, stated: &Pose) -> Pose {
        let moved = stated.cam_from_world.transpose() * self.offset().extend(0.0);
        let center = if self.poses_of_depths { stated.center - moved } else { stated.center };
        Pose { center, ..*stated }
    }
}

/// A frame as stated.
struct Frame {
    pose: Pose,
    depth: Grid2,
    focal: DVec2,
    principal: DVec2,
}

/// Matches of pairs of frames.
pub(super) struct FrameMatches {
    frames: BTreeMap<usize, Frame>,
    pairs: Vec<([usize; 2], RigidMatches)>,
}

impl FrameMatches {
    /// Matches of every `step`-th frame with others that see the same from elsewhere; none if there are too few.
    pub(super) fn find(views: &[&PerspectiveView], step: usize) -> Option<Self> {
        let fewer = views.len().div_ceil(CHOSEN_FROM).max(1);
        let views: Vec<&PerspectiveView> = views.iter().step_by(fewer).copied().collect();
        let chosen: Vec<usize> = (0..views.len()).step_by(step.div_ceil(fewer).max(1)).collect();
        let cameras: Vec<PinholeCamera> = views.iter().map(|v| v.camera).collect();
        let usual = |i: &usize| {
            let depth = views[*i].depth_of_file().ok()?;
            median(depth.data.iter().step_by(97).filter(|z| !z.is_nan()).map(|z| f64::from(*z)).collect())
        };
        let depth = median(chosen.par_iter().filter_map(usual).collect())?;
        let beside = neighbours(&cameras, &vec![depth; cameras.len()], COMPARED);
        let wanted: BTreeSet<[usize; 2]> =
            chosen.iter().flat_map(|i| beside[*i].iter().map(|j| [*i.min(j), *i.max(j)])).collect();
        let used: BTreeSet<usize> = wanted.iter().flatten().copied().collect();
        let read = |i: &usize| {
            let view = views[*i];
            let camera = &view.camera;
            let frame = Frame {
                pose: Pose { cam_from_world: camera.cam_from_site, center: camera.center },
                depth: view.depth_of_file().ok()?,
                focal: view.lens_camera.focal,
                principal: view.lens_camera.principal,
            };
            Some((*i, (frame, ViewFeatures::of(view)?)))
        };
        let used: Vec<usize> = used.into_iter().collect();
        let read: BTreeMap<usize, (Frame, ViewFeatures)> = used.par_iter().filter_map(read).collect();
        let wanted: Vec<[usize; 2]> = wanted.into_iter().collect();
        let matched = |pair: &[usize; 2]| {
            let [i, j] = *pair;
            let found = read.get(&i)?.1.rigid_matches(&read.get(&j)?.1, ((i as u64) << 32) | j as u64)?;
            Some((*pair, found))
        };
        let pairs: Vec<([usize; 2], RigidMatches)> = wanted.par_iter().filter_map(matched).collect();
        let frames = read.into_iter().map(|(i, (frame, _))| (i, frame)).collect();
        (pairs.len() >= FEWEST_PAIRS).then_some(Self { frames, pairs })
    }

    /// Median distance of matches from their epipolar lines, pixels of the images as read.
    pub(super) fn epipolar_px(&self, cameras: &SensorCameras) -> Option<f64> {
        let of = |(pair, matches): &([usize; 2], RigidMatches)| {
            let [a, b] = pair.map(|i| self.frames.get(&i).map(|f| cameras.color_pose(&f.pose)));
            let (Some(a), Some(b)) = (a, b) else { return Vec::new() };
            let motion = Motion::between(&a, &b);
            let focal = cameras.color_focal;
            let px = |rays: &[DVec2; 2]| focal * matches.focal_px * motion.distance(&rays.map(|r| r / focal));
            matches.rays.iter().map(px).filter(|d| d.is_finite()).collect()
        };
        median(self.pairs.iter().flat_map(of).collect())
    }

    /// Median distances of matches from where the depth map of the other frame carries them, with each of two pairs of cameras, pixels
    /// of the images as read: of those matches that they place differently. None if these are few.
    pub(super) fn carried_px(&self, of: [&SensorCameras; 2]) -> Option<[f64; 2]> {
        let [first, second] = of.map(|cameras| self.carried_all_px(cameras));
        let both = first.into_iter().zip(second).filter(|(a, b)| (a - b).abs() > DIFFERENT_PX);
        let (first, second): (Vec<f64>, Vec<f64>) = both.unzip();
        let are_enough = first.len() >= FEWEST_DIFFERENT;
        Some([median(first)?, median(second)?]).filter(|_| are_enough)
    }

    /// Distances of all matches from where the depth map of the other frame carries them, pixels; NaN where it has no depth.
    fn carried_all_px(&self, cameras: &SensorCameras) -> Vec<f64> {
        let mut all = Vec::new();
        for ([i, j], matches) in &self.pairs {
            let (Some(a), Some(b)) = (self.frames.get(i), self.frames.get(j)) else { continue };
            let scale = cameras.color_focal * matches.focal_px;
            for [x, y] in matches.rays.iter().map(|rays| rays.map(|r| r / cameras.color_focal)) {
                let px = |at: Option<DVec2>, to: DVec2| at.map_or(f64::NAN, |at| scale * at.distance(to));
                all.extend([px(a.carried(x, b, cameras), y), px(b.carried(y, a, cameras), x)]);
            }
        }
        all
    }
}

impl Frame {
    /// The depth along a ray of the colour camera.
    fn depth_along(&self, ray: DVec2, cameras: &SensorCameras) -> Option<f64> {
        let mut depth = f64::INFINITY;
        for _ in 0..STEPS {
            let of_sensor = ray - cameras.offset() / depth;
            let at = self.principal + cameras.depth_focal * self.focal * of_sensor;
            depth = f64::from(self.depth.get(at.x.round() as i64, at.y.round() as i64));
            if depth.is_nan() || depth <= 0.0 {
                return None;
            }
        }
        Some(depth)
    }

    /// Where what a ray of this frame's colour camera shows is seen by that of another frame.
    fn carried(&self, ray: DVec2, to: &Self, cameras: &SensorCameras) -> Option<DVec2> {
        let point: DVec3 = self.depth_along(ray, cameras)? * ray.extend(1.0);
        let (from, to) = (cameras.color_pose(&self.pose), cameras.color_pose(&to.pose));
        let world = from.center + from.cam_from_world.transpose() * point;
        let there = to.cam_from_world * (world - to.center);
        (there.z > 0.0).then(|| there.truncate() / there.z)
    }
}

#[cfg(test)]
pub(super) mod test_frames {
    use super::*;
    use crate::random::CounterRng;
    use glam::DMat3;

    const SIZE: (usize, usize) = (160, 120);
    const FOCAL: f64 = 150.0;

    /// Frames of a slanting wall with a step, whose colours and depths are of cameras with these focal lengths over the stated one, and
    /// exact matches of places on it.
    pub(in crate::perspective) fn of_sensor(color_focal: f64, depth_focal: f64) -> FrameMatches {
        let principal = 0.5 * DVec2::new(SIZE.0 as f64 - 1.0, SIZE.1 as f64 - 1.0);
        let depth_at = |from: DVec3, along: DVec3| {
            // z = 3 + 0.8 x; beyond x = 0.3 the wall is 0.5 farther.
            let on = |step: f64| (3.0 + step + 0.8 * from.x - from.z) / (along.z - 0.8 * along.x);
            let near = on(0.0);
            if from.x + near * along.x < 0.3 { near } else { on(0.5) }
        };
        let pose = |k: usize| {
            let turn = 0.05 * k as f64;
            Pose {
                cam_from_world: DMat3::from_rotation_y(turn) * DMat3::from_rotation_x(0.5 * turn),
                center: DVec3::new(0.6 * k as f64 - 1.2, 0.05 * (k % 2) as f64, 0.1 * (k % 3) as f64),
            }
        };
        let frame = |k: usize| {
            let pose = pose(k);
            let world_from_cam = pose.cam_from_world.transpose();
            let depth = Grid2::from_fn(SIZE.0, SIZE.1, |col, row| {
                let ray = (DVec2::new(col as f64, row as f64) - principal) / (FOCAL * depth_focal);
                depth_at(pose.center, world_from_cam * ray.extend(1.0)) as f32
            });
            (k, Frame { pose, depth, focal: DVec2::splat(FOCAL), principal })
        };
        let frames: BTreeMap<usize, Frame> = (0..5).map(frame).collect();
        let mut draw = CounterRng::new(7, 0, 0, 0);
        let mut pair = |a: usize| {
            let (from, to) = (pose(a), pose(a + 1));
            let rays = (0..60).map(|_| {
                let ray = DVec2::new(0.8 * draw.uniform() - 0.4, 0.6 * draw.uniform() - 0.3);
                let along = from.cam_from_world.transpose() * ray.extend(1.0);
                let there =
                    to.cam_from_world * (from.center + depth_at(from.center, along) * along - to.center);
                // Directions as the stated focal length gives them.
                [color_focal * ray, color_focal * there.truncate() / there.z]
            });
            ([a, a + 1], RigidMatches { rays: rays.collect(), focal_px: FOCAL })
        };
        let pairs = (0..4).map(&mut pair).collect();
        FrameMatches { frames, pairs }
    }
}
