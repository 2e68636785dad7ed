//! Other readings of poses and focal lengths, of which one may fit where what is stated does not.

use super::super::pose::Pose;
use super::matched_pair::MatchedPair;
use crate::stats::median;
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use std::fmt;

/// Factors of the focal length that are tried: from the lowest to the highest, in steps of this share, and then finer ones.
const FACTORS: (f64, f64) = (0.4, 2.5);
const STEP: f64 = 0.02;
const HALVINGS: usize = 4;
/// Least share by which a focal length differs from the stated one, so that it is worth a word, and the largest share of the stated
/// distance that may be left; the difference of both is at least so many pixels.
const WORTH: f64 = 0.02;
const LEFT: f64 = 0.75;
const CLEAR_PX: f64 = 0.3;

/// A reading of the matrices of poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reading {
    /// Whether they are the inverse of what they are taken for.
    inverse: bool,
    /// Signs of the camera axes right, down, forward.
    signs: DVec3,
}

impl Reading {
    /// All readings but that as stated.
    pub(super) fn others() -> impl Iterator<Item = Self> {
        let signs = (0..8u8)
            .map(|k| DVec3::from_array([0, 1, 2].map(|bit| if (k >> bit) & 1 == 1 { -1.0 } else { 1.0 })));
        signs
            .flat_map(|signs| [false, true].map(|inverse| Self { inverse, signs }))
            .filter(|r| r.inverse || r.signs != DVec3::ONE)
    }

    pub(super) fn of(&self, pose: &Pose) -> Pose {
        let Pose { cam_from_world, center } = *pose;
        let signs = DMat3::from_diagonal(self.signs);
        match self.inverse {
            false => Pose { cam_from_world: signs * cam_from_world, center },
            true => Pose {
                cam_from_world: signs * cam_from_world.transpose(),
                center: -(cam_from_world * center),
            },
        }
    }
}

impl fmt::Display for Reading {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let mut parts = Vec::new();
        if self.inverse {
            parts.push("their matrices are inverted (camera to world for world to camera)".to_owned());
        }
        if self.signs != DVec3::ONE {
            let words = [["right", "left"], ["down", "up"], ["forward", "backward"]];
            let word = |k: usize| words[k][usize::from(self.signs[k] < 0.0)];
            let mirrored = if self.signs.element_product() < 0.0 { ", a mirrored frame," } else { "" };
            parts.push(format!(
                "the camera axes that are read as right, down, forward are taken{mirrored} as {}, {}, {}",
                word(0),
                word(1),
                word(2)
            ));
        }
        write!(f, "{}", parts.join(" and "))
    }
}

/// A factor of all focal lengths that fits matches better.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FocalFit {
    pub(super) factor: f64,
    /// Median distance from epipolar lines as stated and with the factor, pixels.
    pub(super) px: [f64; 2],
}

/// Median distance of all matches from their epipolar lines with a factor of the focal length, pixels.
pub(super) fn pooled_px(pairs: &[&MatchedPair], poses: &[Pose], factor: f64) -> Option<f64> {
    let of = |pair: &&MatchedPair| pair.distances_px(pair.views.map(|v| &poses[v]), factor);
    median(pairs.iter().flat_map(of).collect())
}

/// The factor with the least median distance.
fn best_factor(pairs: &[&MatchedPair], poses: &[Pose]) -> Option<f64> {
    let px = |factor: f64| pooled_px(pairs, poses, factor).unwrap_or(f64::INFINITY);
    let least = |factors: Vec<f64>| {
        let scored: Vec<(f64, f64)> = factors.into_par_iter().map(|factor| (px(factor), factor)).collect();
        scored.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, factor)| factor)
    };
    let count = ((FACTORS.1 / FACTORS.0).ln() / STEP).ceil() as i32;
    let mut best = least((0..=count).map(|k| FACTORS.0 * (STEP * f64::from(k)).exp()).collect())?;
    let mut step = STEP;
    for _ in 0..HALVINGS {
        step *= 0.5;
        best = least(vec![best, best * (1.0 - step), best * (1.0 + step)])?;
    }
    let is_inside = best > FACTORS.0 * (1.0 + STEP) && best < FACTORS.1 * (1.0 - STEP);
    is_inside.then_some(best)
}

/// The factor of the focal lengths that fits clearly better than 1, if both halves of the pairs say so.
pub(super) fn other_focal(all: &[&MatchedPair], poses: &[Pose]) -> Option<FocalFit> {
    let factor = best_factor(all, poses)?;
    let px = [pooled_px(all, poses, 1.0)?, pooled_px(all, poses, factor)?];
    let agrees = |first: usize| {
        let half: Vec<&MatchedPair> = all.iter().skip(first).step_by(2).copied().collect();
        best_factor(&half, poses)
            .is_some_and(|f| (f - 1.0) * (factor - 1.0) > 0.0 && (f - 1.0).abs() > 0.5 * WORTH)
    };
    let is_clear = (factor - 1.0).abs() > WORTH && px[1] < LEFT * px[0] && px[0] - px[1] > CLEAR_PX;
    (is_clear && agrees(0) && agrees(1)).then_some(FocalFit { factor, px })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_of_the_inverse_pose_is_the_pose() {
        let pose = Pose {
            cam_from_world: DMat3::from_rotation_x(0.4) * DMat3::from_rotation_z(1.0),
            center: DVec3::new(1.0, 2.0, -3.0),
        };
        let inverse = Reading { inverse: true, signs: DVec3::ONE };
        let back = inverse.of(&inverse.of(&pose));
        assert!((back.center - pose.center).length() < 1e-12);
        assert!((back.cam_from_world - pose.cam_from_world).to_cols_array().iter().all(|v| v.abs() < 1e-12));
        assert_eq!(Reading::others().count(), 15);
        let gl = Reading { inverse: false, signs: DVec3::new(1.0, -1.0, -1.0) };
        assert!(gl.to_string().ends_with("are taken as right, up, backward"), "{gl}");
    }
}
