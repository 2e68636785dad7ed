//! Splats from coarse to fine: the first of them are a picture with little detail, and more of them one with more.

use crate::splat::splats::{Splats, sigmoid};
use rayon::prelude::*;
use std::iter::successors;
use std::ops::Range;

/// Number of splats of the first part. Without a graphics card, a picture takes about 20 µs for each.
const FIRST_PART: usize = 15_000;

/// Indices of splats from coarse to fine: by opacity times area, the product of the two largest scales. Of equal ones the first
/// comes first.
#[must_use]
pub fn coarse_to_fine(splats: &Splats) -> Vec<u32> {
    let importance = |i: &u32| {
        let mut scales = splats.log_scale[*i as usize];
        scales.sort_by(f32::total_cmp);
        sigmoid(splats.opacity_logit[*i as usize][0]).ln() + scales[1] + scales[2]
    };
    let mut keyed: Vec<(f32, u32)> =
        (0..splats.len() as u32).into_par_iter().map(|i| (importance(&i), i)).collect();
    keyed.par_sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    keyed.into_par_iter().map(|(_, i)| i).collect()
}

/// The parts that so many splats are shown in, one after the other: each as large as all before it, the last one what is left.
#[must_use]
pub fn parts(count: usize) -> Vec<Range<usize>> {
    let next = |part: &Range<usize>| (part.end < count).then(|| part.end..count.min(2 * part.end));
    successors(Some(0..count.min(FIRST_PART)), next).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_and_opaque_splats_come_first() {
        let mut splats = Splats::default();
        for (scale, opacity) in [(0.1, 0.5), (3.0, 0.9), (3.0, 0.01), (0.1, 0.5), (1.0, 0.9)] {
            splats.push([0.0; 3], scale, opacity, [0.5; 3]);
        }
        assert_eq!(coarse_to_fine(&splats), [1, 4, 2, 0, 3]);
    }

    #[test]
    fn parts_hold_every_splat_once() {
        for count in [0, 1, 14_999, 15_000, 15_001, 123_456, 5_000_000] {
            let parts = parts(count);
            assert_eq!((parts[0].start, parts[parts.len() - 1].end), (0, count));
            assert!(parts.windows(2).all(|two| two[0].end == two[1].start));
            assert!(parts.iter().all(|part| part.len() <= count.min(part.start.max(FIRST_PART))));
        }
        assert_eq!(parts(5_000_000).len(), 10);
    }
}
