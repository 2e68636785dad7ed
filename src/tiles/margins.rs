//! How far the box in which a tile's splats live extends beyond the overlap box.
//!
//! Projection is parallel within a tile, so the extent can be computed exactly: a line of sight that climbs from the lowest
//! to the highest altitude moves by its slope times the difference, and a ray of the sun likewise.

use super::cells::MapBox;

/// Largest margin for shadows, metres. What casts a longer one lies outside of the box, and its shadow is not modelled.
pub const SHADOW_CAP_M: f64 = 200.0;

/// Margins of a box on its four sides, metres.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Margins {
    west: f64,
    south: f64,
    east: f64,
    north: f64,
}

impl Margins {
    /// Margins for a range of heights of `height_m` metres.
    ///
    /// `sight` holds for every view the ground displacement (east, north) of its line of sight in metres per metre of
    /// height, `sun` the same for the rays towards the sun. Along lines of sight both directions count: what lies higher
    /// occludes, and what lies lower is seen beside. Towards the sun only what lies higher counts, because it casts
    /// shadows.
    pub fn new(height_m: f64, sight: &[[f64; 2]], sun: &[[f64; 2]]) -> Self {
        let mut margins = Self::default();
        for slope in sight {
            let reach = slope.map(|s| s.abs() * height_m);
            margins.extend([reach[0], reach[1]]);
            margins.extend([-reach[0], -reach[1]]);
        }
        for slope in sun {
            margins.extend(capped(slope.map(|s| s * height_m)));
        }
        margins
    }

    /// Extends the margins so that a displacement (east, north, metres) from the edge stays inside.
    fn extend(&mut self, [east, north]: [f64; 2]) {
        self.east = self.east.max(east);
        self.west = self.west.max(-east);
        self.north = self.north.max(north);
        self.south = self.south.max(-north);
    }

    /// A box with the margins around it, enlarged to whole multiples of `step` metres.
    pub fn around(&self, [west, south, east, north]: MapBox, step: f64) -> MapBox {
        let down = |v: f64| (v / step + 1e-6).floor() * step;
        let up = |v: f64| (v / step - 1e-6).ceil() * step;
        [down(west - self.west), down(south - self.south), up(east + self.east), up(north + self.north)]
    }
}

/// The displacement shortened to [`SHADOW_CAP_M`].
fn capped([east, north]: [f64; 2]) -> [f64; 2] {
    let scale = (SHADOW_CAP_M / east.hypot(north)).min(1.0);
    [east * scale, north * scale]
}

/// Whether some shadow of a range of heights is longer than [`SHADOW_CAP_M`].
pub fn exceeds_cap(height_m: f64, sun: &[[f64; 2]]) -> bool {
    sun.iter().any(|[e, n]| e.hypot(*n) * height_m > SHADOW_CAP_M)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn slopes(largest: f64) -> impl Strategy<Value = Vec<[f64; 2]>> {
        proptest::collection::vec([-largest..largest, -largest..largest], 1..6)
    }

    proptest! {
        #[test]
        fn every_ray_through_the_overlap_box_between_the_heights_stays_in_the_splat_box(
            sight in slopes(0.6),
            sun in slopes(4.0),
            height in 1.0..200.0f64,
            place in [0.0..1.0f64, 0.0..1.0, 0.0..1.0],
        ) {
            let overlap = [1000.0, 2000.0, 1576.0, 2576.0];
            let splat_box = Margins::new(height, &sight, &sun).around(overlap, 0.5);
            let [x, y] = [1000.0 + 576.0 * place[0], 2000.0 + 576.0 * place[1]];
            let inside = |x: f64, y: f64| {
                (splat_box[0]..=splat_box[2]).contains(&x) && (splat_box[1]..=splat_box[3]).contains(&y)
            };
            let z = height * place[2];
            for s in &sight {
                for to in [0.0, height] {
                    prop_assert!(inside(x + s[0] * (to - z), y + s[1] * (to - z)));
                }
            }
            for s in &sun {
                let length = s[0].hypot(s[1]) * (height - z);
                let share = if length > SHADOW_CAP_M { SHADOW_CAP_M / length } else { 1.0 };
                prop_assert!(inside(x + share * s[0] * (height - z), y + share * s[1] * (height - z)));
            }
        }
    }

    #[test]
    fn the_sides_without_suns_have_no_margin_for_shadows() {
        let margins = Margins::new(60.0, &[[0.0, 0.0]], &[[0.0, -1.0]]);
        assert_eq!(margins.around([0.0, 0.0, 100.0, 100.0], 1.0), [0.0, -60.0, 100.0, 100.0]);
        assert!(!exceeds_cap(60.0, &[[0.0, -1.0]]) && exceeds_cap(60.0, &[[0.0, -4.0]]));
    }
}
