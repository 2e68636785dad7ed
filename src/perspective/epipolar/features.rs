//! Keypoints of a view, and the matches of two views that are those of one rigid scene.

use super::super::view::PerspectiveView;
use super::consensus::consensus;
use super::motion::RayPair;
use crate::bundle::{Keypoint, detect, pair_matches};
use crate::io::Grid2;
use glam::DVec2;
use std::convert::Infallible;

/// Images are reduced to at most so many pixels along the longer side: errors of poses that matter are larger than a pixel of it.
const LONGEST_PX: usize = 640;
/// Largest number of keypoints of a view.
const KEYPOINTS: usize = 800;
/// Distance from a common motion up to which matches belong to it, pixels of the reduced image.
const TOLERANCE_PX: f64 = 1.5;
/// Least number of matches of one motion, and their share of all matches: wrong matches alone give some ten of a hundred.
const FEWEST: usize = 20;
const LEAST_SHARE: f64 = 0.3;

/// The keypoints of a view.
pub(in crate::perspective) struct ViewFeatures {
    keypoints: Vec<Keypoint>,
    /// Directions (right, down; at depth one) of the keypoints.
    rays: Vec<DVec2>,
    /// Mean focal length of the image as read, pixels.
    pub(super) focal_px: f64,
    /// Pixels of the image as read in a side of a pixel of the reduced one.
    pub(super) reduced_by: f64,
}

/// Matches of two views that fit one rigid scene.
#[derive(Clone, Debug)]
pub(in crate::perspective) struct RigidMatches {
    /// Directions in both cameras.
    pub(in crate::perspective) rays: Vec<RayPair>,
    /// Mean focal length, pixels of the images as read.
    pub(in crate::perspective) focal_px: f64,
}

impl ViewFeatures {
    /// The keypoints of the image; none if the image cannot be read, which whoever needs it explains.
    pub(in crate::perspective) fn of(view: &PerspectiveView) -> Option<Self> {
        let image = view.read_image().ok()?;
        let [red, green, blue] = &image.planes;
        let longest = red.width.max(red.height);
        let factor = longest.div_ceil(LONGEST_PX).max(1);
        let gray = |i: usize| (red.data[i] + green.data[i] + blue.data[i]) / 3.0;
        let (width, height) = (red.width / factor, red.height / factor);
        let reduced = Grid2::from_fn(width, height, |col, row| {
            let rows = row * factor..(row + 1) * factor;
            let cells = rows.flat_map(|r| (col * factor..(col + 1) * factor).map(move |c| r * red.width + c));
            cells.map(gray).sum::<f32>() / (factor * factor) as f32
        });
        // The reduced image is smaller than a tile of the search, which is read at once.
        let Ok(mut keypoints) = detect((width, height), |_| Ok::<_, Infallible>(reduced.clone()));
        keypoints.truncate(KEYPOINTS);
        let by = factor as f64;
        let pixel = |k: &Keypoint| (DVec2::new(k.px.col, k.px.row) + 0.5) * by - 0.5;
        let camera = &view.camera;
        let rays = keypoints.iter().map(|k| (pixel(k) - camera.principal) / camera.focal).collect();
        Some(Self { keypoints, rays, focal_px: 0.5 * camera.focal.element_sum(), reduced_by: by })
    }

    /// Number of keypoints.
    pub(super) fn len(&self) -> usize {
        self.keypoints.len()
    }

    /// The matches with another view that fit one rigid scene; none if there are too few to say so. `item` numbers the pair.
    pub(in crate::perspective) fn rigid_matches(&self, other: &Self, item: u64) -> Option<RigidMatches> {
        let all = pair_matches(&self.keypoints, &other.keypoints);
        let rays: Vec<RayPair> = all.iter().map(|[i, j]| [self.rays[*i], other.rays[*j]]).collect();
        let pixel = (self.reduced_by / self.focal_px).max(other.reduced_by / other.focal_px);
        let found = consensus(&rays, TOLERANCE_PX * pixel, item);
        let are_enough = found.len() >= FEWEST && found.len() as f64 >= LEAST_SHARE * all.len() as f64;
        are_enough.then(|| RigidMatches {
            rays: found.iter().map(|k| rays[*k]).collect(),
            focal_px: 0.5 * (self.focal_px + other.focal_px),
        })
    }
}
