//! Matches of two images whose cameras are not used.

use super::features::Keypoint;
use super::matching::{BestTwo, compare};

/// Pairs of keypoints, by index, that are each other's most similar one and pass the ratio test (Lowe 2004, section 7.1).
///
/// Every keypoint of one image is compared with every one of the other: the number should stay below some thousand.
#[must_use]
pub fn pair_matches(a: &[Keypoint], b: &[Keypoint]) -> Vec<[usize; 2]> {
    let mut there = vec![BestTwo::default(); b.len()];
    let mut all: Vec<(u32, f32)> = (0..b.len() as u32).map(|j| (j, 0.0)).collect();
    let mut here = Vec::with_capacity(a.len());
    for (i, own) in a.iter().enumerate() {
        let mut best = BestTwo::default();
        compare(own, b, &mut all);
        for (j, similarity) in &all {
            best.enter(*j, *similarity, b);
            there[*j as usize].enter(i as u32, *similarity, a);
        }
        here.push(best);
    }
    let mutual = here.iter().enumerate().filter_map(|(i, best)| {
        let j = best.winner()? as usize;
        (there[j].winner()? as usize == i).then_some([i, j])
    });
    mutual.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bundle::features::VALUES;
    use crate::frame::Pixel;

    /// A keypoint whose descriptor points along one axis, a little towards the next one.
    fn keypoint(axis: usize, aside: f32) -> Keypoint {
        let mut descriptor = [0.0; VALUES];
        descriptor[axis] = (1.0 - aside * aside).sqrt();
        descriptor[axis + 1] = aside;
        Keypoint { px: Pixel::new(10.0 * axis as f64, 0.0), scale: 2.0, gray: 0, descriptor }
    }

    #[test]
    fn keypoints_match_that_are_each_others_best_and_not_ambiguous() {
        let a = [keypoint(0, 0.0), keypoint(10, 0.0), keypoint(20, 0.0)];
        // Two keypoints at different places are equally similar to the last one.
        let mut twin = keypoint(20, 0.2);
        twin.px.row = 50.0;
        let b = [keypoint(10, 0.1), keypoint(20, 0.2), keypoint(0, 0.1), twin];
        assert_eq!(pair_matches(&a, &b), [[0, 2], [1, 0]]);
        assert!(pair_matches(&a, &[]).is_empty());
    }
}
