//! A pair of views with their matches, and how poses fit it.

use super::super::pose::Pose;
use super::features::{RigidMatches, ViewFeatures};
use super::motion::{Motion, RayPair};
use crate::stats::median;
use rayon::prelude::*;

/// Largest distance from epipolar lines at which poses agree with matches: so many pixels of the reduced image, or so large a share
/// of the focal length. Poses of sensors and of cameras on vehicles are no better.
const AGREE_PX: f64 = 2.0;
const AGREE_SHARE: f64 = 0.006;

/// Fewest matches by which it is told whether points lie behind the cameras.
const FEWEST_WIDE: usize = 8;

/// Matches of two views.
pub(super) struct MatchedPair {
    /// Numbers of the views.
    pub(super) views: [usize; 2],
    pub(super) matches: RigidMatches,
    /// Largest distance at which poses agree, pixels of the images as read.
    agree_px: f64,
}

impl MatchedPair {
    /// The pairs that have matches, in the order given.
    pub(super) fn find(features: &[Option<ViewFeatures>], pairs: &[[usize; 2]]) -> Vec<Self> {
        let of = |views: &[usize; 2]| {
            let [i, j] = *views;
            Self::of([features.get(i)?.as_ref()?, features.get(j)?.as_ref()?], *views)
        };
        pairs.par_iter().map(of).collect::<Vec<_>>().into_iter().flatten().collect()
    }

    /// The pair of two views, if it has matches.
    pub(super) fn of([a, b]: [&ViewFeatures; 2], views: [usize; 2]) -> Option<Self> {
        let item = ((views[0] as u64) << 32) | views[1] as u64;
        let matches = a.rigid_matches(b, item)?;
        let agree_px = (AGREE_PX * a.reduced_by.max(b.reduced_by)).max(AGREE_SHARE * matches.focal_px);
        Some(Self { views, matches, agree_px })
    }

    /// Distances of the matches from the epipolar lines of two poses, pixels of the images as read, if the focal lengths are those
    /// stated times a factor. None without a distance between the cameras.
    pub(super) fn distances_px(&self, poses: [&Pose; 2], focal: f64) -> Vec<f64> {
        let motion = Motion::between(poses[0], poses[1]);
        let px = |rays: &RayPair| focal * self.matches.focal_px * motion.distance(&rays.map(|r| r / focal));
        self.matches.rays.iter().map(px).filter(|d| d.is_finite()).collect()
    }

    /// Median distance from the epipolar lines of two poses, pixels; infinite if most points would lie behind the cameras. None
    /// without a distance between the cameras.
    pub(super) fn residual_px(&self, poses: [&Pose; 2]) -> Option<f64> {
        let px = median(self.distances_px(poses, 1.0))?;
        let motion = Motion::between(poses[0], poses[1]);
        // Of directions that are nearly parallel, errors decide on which side they meet.
        let wide = |rays: &&RayPair| motion.parallax(rays) > self.agree_px / self.matches.focal_px;
        let (mut seen, mut behind) = (0, 0);
        for rays in self.matches.rays.iter().filter(wide) {
            seen += 1;
            behind += usize::from(!motion.is_in_front(rays));
        }
        let is_behind = seen >= FEWEST_WIDE && 2 * behind > seen;
        Some(if is_behind { f64::INFINITY } else { px })
    }

    /// Whether a residual is one of poses that agree with the matches.
    pub(super) fn agrees(&self, residual_px: f64) -> bool {
        residual_px <= self.agree_px
    }
}
