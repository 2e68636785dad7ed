//! The cut along a strip that two tiles have in common, and the mixture of both tiles on its sides.

use crate::io::Grid2;

/// Largest difference of height in metres at which two tiles are taken to show the same surface, and are averaged. The
/// average of a roof and the ground beside it would be a surface that does not exist.
pub(super) const SAME_SURFACE_M: f32 = 0.5;
/// Cost of cutting through a cell that one of the tiles lacks, as that of a difference of as many metres.
const MISSING_M: f32 = 1.0;
/// Cost of a step of the cut to the side, and of a cell's distance from the middle of the strip, metres. They decide only
/// where the tiles agree.
const SIDEWAYS_M: f32 = 1e-3;
const OFF_MIDDLE_M: f32 = 1e-4;
/// Width of the transition at the cut, cells.
const TRANSITION_CELLS: f32 = 2.0;
/// Smallest weight of a cell of which both tiles have a height, so that a transparent cell is no missing one.
const LEAST_CONFIDENCE: f32 = 0.01;

/// Number of bands that are blended: height, red, green, blue, opacity, spread of altitudes, number of views,
/// expected error.
pub(super) const BANDS: usize = 8;
const HEIGHT: usize = 0;
const OPACITY: usize = 4;

/// The cut along a strip: for each line across the strip, the first cell that belongs to the second tile.
pub(super) type Cut = Vec<usize>;

/// The cut of least cost: the sum along the strip of the absolute difference of heights, found by dynamic programming; it
/// moves by at most one cell from line to line.
///
/// `difference` holds the difference of heights of the first and second tile in metres, NaN where one is missing; its
/// columns run across the strip, from the first tile to the second, its rows along it. `first` and `last` fix the cut at the
/// ends of the strip.
pub(super) fn least_cost_cut(difference: &Grid2, first: Option<usize>, last: Option<usize>) -> Cut {
    let (across, along) = (difference.width, difference.height);
    if across < 2 || along == 0 {
        return vec![across / 2; along];
    }
    let cell = |d: f32| if d.is_nan() { MISSING_M } else { d.abs() };
    // The cut lies between two cells.
    let cost = |line: usize, at: usize| {
        let off_middle = (at as f32 - 0.5 * across as f32).abs() * OFF_MIDDLE_M;
        0.5 * (cell(difference.at(at - 1, line)) + cell(difference.at(at, line))) + off_middle
    };
    let allowed = |fixed: Option<usize>, at: usize| fixed.is_none_or(|f| f.clamp(1, across - 1) == at);
    let start = |at: usize| if allowed(first, at) { f64::from(cost(0, at)) } else { f64::INFINITY };
    let mut total: Vec<f64> = (0..across).map(|at| if at == 0 { f64::INFINITY } else { start(at) }).collect();
    let mut came_from = vec![0i8; across * along];
    for line in 1..along {
        let mut next = vec![f64::INFINITY; across];
        for at in 1..across {
            let mut best = (total[at], 0i8);
            for (side, from) in [(-1, at.wrapping_sub(1)), (1, at + 1)] {
                let sideways = total.get(from).map_or(f64::INFINITY, |t| t + f64::from(SIDEWAYS_M));
                if sideways < best.0 {
                    best = (sideways, side);
                }
            }
            next[at] = best.0 + f64::from(cost(line, at));
            came_from[line * across + at] = best.1;
        }
        total = next;
    }
    let ends = (1..across).filter(|at| allowed(last, *at));
    let mut at = ends.min_by(|a, b| total[*a].total_cmp(&total[*b])).unwrap_or(across / 2);
    let mut cut = vec![at; along];
    for line in (1..along).rev() {
        at = at.saturating_add_signed(isize::from(came_from[line * across + at]));
        cut[line - 1] = at;
    }
    cut
}

/// Share of the second tile at a cell across the strip by the cut at that line.
pub(super) fn owned_share(cell: usize, cut: usize) -> f32 {
    ((cell as f32 + 0.5 - cut as f32) / TRANSITION_CELLS + 0.5).clamp(0.0, 1.0)
}

/// Share of the second tile at a cell across a strip of `width` cells that grows linearly from 0 to 1.
pub(super) fn linear_share(cell: usize, width: usize) -> f32 {
    (cell as f32 + 0.5) / width as f32
}

/// Mixes a cell of two tiles; returns also the share of the second tile. NaN is missing: such a cell takes the other
/// tile's value. Where both show the same surface, weights are linear shares times confidences; elsewhere the cut decides.
pub(super) fn mixed(
    a: &[f32; BANDS],
    b: &[f32; BANDS],
    linear_share: f32,
    owned_share: f32,
) -> ([f32; BANDS], f32) {
    let confidence = |v: &[f32; BANDS]| {
        if v[OPACITY].is_nan() { LEAST_CONFIDENCE } else { v[OPACITY].clamp(LEAST_CONFIDENCE, 1.0) }
    };
    let share = match (a[HEIGHT].is_nan(), b[HEIGHT].is_nan()) {
        (true, false) => 1.0,
        (false, true) => 0.0,
        (false, false) if (a[HEIGHT] - b[HEIGHT]).abs() <= SAME_SURFACE_M => {
            let (of_a, of_b) = ((1.0 - linear_share) * confidence(a), linear_share * confidence(b));
            of_b / (of_a + of_b)
        }
        _ => owned_share,
    };
    let mix = |a: f32, b: f32| match (a.is_nan(), b.is_nan()) {
        (true, _) => b,
        (_, true) => a,
        // The value of a tile that has all the weight is kept exactly.
        _ if share == 0.0 => a,
        _ if share == 1.0 => b,
        _ => a + (b - a) * share,
    };
    (std::array::from_fn(|i| mix(a[i], b[i])), share)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall of differences with one gap, and the cut that goes through the gap.
    #[test]
    fn the_cut_goes_around_differences_and_through_the_gap_between_them() {
        let gap = 3;
        let d = Grid2::from_fn(
            16,
            41,
            |col, row| if row == 20 && !(gap..gap + 2).contains(&col) { 4.0 } else { 0.0 },
        );
        let cut = least_cost_cut(&d, None, None);
        assert_eq!(cut[20], gap + 1);
        assert!(cut.windows(2).all(|w| w[0].abs_diff(w[1]) <= 1));
        assert_eq!((cut[0], cut[40]), (8, 8), "elsewhere it is in the middle");
    }

    #[test]
    fn the_cut_of_tiles_that_agree_is_straight_and_avoids_missing_cells() {
        assert_eq!(least_cost_cut(&Grid2::filled(10, 5, 0.0), None, None), vec![5; 5]);
        let d = Grid2::from_fn(10, 5, |col, _| if (4..6).contains(&col) { f32::NAN } else { 0.0 });
        let cut = least_cost_cut(&d, None, None);
        assert!(cut.iter().all(|c| *c == 3 || *c == 7), "{cut:?}");
    }

    #[test]
    fn the_cut_starts_and_ends_where_it_is_fixed() {
        let cut = least_cost_cut(&Grid2::filled(12, 30, 0.0), Some(2), Some(11));
        assert_eq!((cut[0], cut[29]), (2, 11));
        assert!(cut.windows(2).all(|w| w[0].abs_diff(w[1]) <= 1));
    }

    #[test]
    fn a_cell_of_two_surfaces_is_never_between_them() {
        let cell = |height: f32| [height, 0.5, 0.5, 0.5, 1.0, 0.1, 4.0, 0.2];
        for (k, expected) in [(0, 30.0), (19, 22.0)] {
            assert_eq!(
                mixed(&cell(30.0), &cell(22.0), linear_share(k, 20), owned_share(k, 10)).0[0],
                expected
            );
        }
        let (half, share) = mixed(&cell(30.0), &cell(30.4), 0.5, 0.0);
        assert!((half[0] - 30.2).abs() < 1e-5 && (share - 0.5).abs() < 1e-6);
    }

    #[test]
    fn a_missing_cell_takes_the_other_tile_and_an_opaque_one_outweighs_a_transparent_one() {
        let cell = |height: f32, opacity: f32| [height, 0.5, 0.5, 0.5, opacity, 0.1, 4.0, 0.2];
        let none = [f32::NAN; BANDS];
        assert_eq!(mixed(&none, &cell(5.0, 0.9), 0.1, 0.0), (cell(5.0, 0.9), 1.0));
        assert_eq!(mixed(&cell(5.0, 0.9), &none, 0.9, 1.0), (cell(5.0, 0.9), 0.0));
        let (height, _) = mixed(&cell(5.0, 0.75), &cell(5.4, 0.25), 0.5, 0.5);
        assert!((height[0] - 5.1).abs() < 1e-5);
    }
}
