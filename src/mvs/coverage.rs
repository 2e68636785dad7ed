//! How many images cover a cell of the map grid.

/// Share of the views that see a cell at some altitude that must also see its ground.
const GROUND_SHARE: f64 = 0.55;
/// Number of altitudes of the plane stack at which images are counted.
pub(super) const ALTITUDES: usize = 8;

/// Number of views in whose valid pixels a cell lies, by altitude.
#[derive(Clone, Copy, Default)]
pub(super) struct Coverage {
    /// At [`ALTITUDES`] evenly spaced altitudes, from the lowest plane of the stack to the highest.
    counts: [f32; ALTITUDES],
    /// The largest of the counts and of the count at the ground, at least one.
    largest: f32,
    /// Whether the ground is seen by most of the views that see the cell at a greater altitude.
    ///
    /// Just outside the area that the images cover, they still see the space above the ground. Matching would
    /// find false surfaces there.
    pub covers_ground: bool,
}

impl Coverage {
    /// From the number of views that see the cell at the ground and at each of the altitudes; at least
    /// `needed` views must see the ground.
    pub fn new(ground: usize, counts: [usize; ALTITUDES], needed: usize) -> Self {
        let largest = counts.into_iter().fold(ground, usize::max);
        let covers_ground = ground >= needed && ground as f64 >= GROUND_SHARE * largest as f64;
        Self { counts: counts.map(|n| n as f32), largest: largest.max(1) as f32, covers_ground }
    }

    /// The number of views at a relative altitude, from 0 at the lowest plane to 1 at the highest, as a share
    /// of the largest number.
    pub fn share(&self, relative: f32) -> f32 {
        let at = relative * (ALTITUDES - 1) as f32;
        let below = (at as usize).min(ALTITUDES - 2);
        let [low, high] = [self.counts[below], self.counts[below + 1]];
        (low + (high - low) * (at - below as f32)) / self.largest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn altitudes_that_fewer_images_cover_have_a_smaller_share() {
        let of = |ground: usize, needed: usize| Coverage::new(ground, [10, 10, 8, 8, 5, 5, 5, 0], needed);
        let coverage = of(8, 8);
        assert_eq!(coverage.share(0.0), 1.0);
        assert!((coverage.share(1.5 / 7.0) - 0.9).abs() < 1e-6);
        assert_eq!((coverage.share(5.0 / 7.0), coverage.share(1.0)), (0.5, 0.0));
        assert!(coverage.covers_ground && !of(8, 9).covers_ground);
        assert!(!of(5, 3).covers_ground, "5 of 10 views are too few");
    }
}
