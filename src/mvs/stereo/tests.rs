//! The block of the plane sweep's tests, seen by two and three views.

use super::*;
use crate::mvs::MatchedSurface;
use crate::mvs::tests::{BLOCK_M, curved_view, height, setup, sparse, texture, textureless, view};
use crate::progress::NoProgress;

/// The share of cells within half a metre of the truth, among those for which `is_meant` holds: it takes the
/// position of a cell, and whether it was matched.
fn share_right(surface: &MatchedSurface, is_meant: impl Fn([f64; 3], bool) -> bool) -> f64 {
    let grid = surface.grid;
    let (mut right, mut all) = (0.0, 0.0f64);
    for i in 0..grid.width * grid.height {
        let p = surface.point(i % grid.width, i / grid.width).xyz();
        if is_meant(p, surface.score.data[i] > 0.0) {
            all += 1.0;
            right += f64::from((p[2] - height(p[0], p[1])).abs() < 0.5);
        }
    }
    right / all.max(1.0)
}

#[test]
fn a_pair_finds_a_block_and_the_ground_and_marks_cells_that_only_one_view_sees() {
    let views = [view([-0.2, 0.0], texture), view([0.2, 0.0], texture)];
    let surface = PlaneSweep::new(&setup(), &views, &sparse()).unwrap().run(None, &NoProgress).unwrap();
    let everywhere = share_right(&surface, |_, _| true);
    assert!(everywhere > 0.93, "{everywhere}");
    let matched = share_right(&surface, |_, is_matched| is_matched);
    assert!(matched > 0.97, "{matched}");
    let blobs = surface.altitude.valid().filter(|z| f64::from(*z) > BLOCK_M + 1.0).count();
    assert_eq!(blobs, 0, "nothing stands higher than the block");
    // The western view does not see 2.4 m of ground east of the block, the eastern one none west of it.
    let hidden = |p: [f64; 3], _| (8.5..10.0).contains(&p[0].abs()) && p[1].abs() < 5.0;
    let matched_there = share_right(&surface, |p, is_matched| hidden(p, is_matched) && is_matched);
    let filled = |p, is_matched: bool| hidden(p, is_matched) && !is_matched;
    assert!(share_right(&surface, filled) > 0.9, "filled by the ground: {}", share_right(&surface, filled));
    let count = |is_meant: &dyn Fn([f64; 3], bool) -> bool| {
        let cells = surface.grid.width * surface.grid.height;
        let meant = (0..cells).filter(|i| {
            let p = surface.point(i % surface.grid.width, i / surface.grid.width).xyz();
            is_meant(p, surface.score.data[*i] > 0.0)
        });
        meant.count()
    };
    let (all, marked) = (count(&hidden), count(&filled));
    assert!(marked as f64 > 0.7 * all as f64, "{marked} of {all}, matched and right {matched_there}");
}

#[test]
fn a_pair_of_cameras_with_a_quadratic_term_finds_the_same_surface() {
    let views = [[-0.2, 0.0], [0.2, 0.0]].map(|slope| curved_view(slope, texture));
    let surface = PlaneSweep::new(&setup(), &views, &sparse()).unwrap().run(None, &NoProgress).unwrap();
    let (everywhere, matched) = (share_right(&surface, |_, _| true), share_right(&surface, |_, m| m));
    assert!(everywhere > 0.93 && matched > 0.97, "{everywhere} {matched}");
}

#[test]
fn a_third_view_matches_cells_that_the_pair_did_not_see() {
    let pair = [view([-0.2, 0.0], texture), view([0.2, 0.0], texture)];
    let three = [pair[0].clone(), pair[1].clone(), view([0.0, 0.0], texture)];
    let share = |views: &[_]| {
        let surface = PlaneSweep::new(&setup(), views, &sparse()).unwrap().run(None, &NoProgress).unwrap();
        let matched = surface.score.data.iter().filter(|s| **s > 0.0).count();
        (matched as f64 / surface.score.data.len() as f64, share_right(&surface, |_, is_matched| is_matched))
    };
    let ((of_two, _), (of_three, exact)) = (share(&pair), share(&three));
    assert!(of_three > of_two && exact > 0.97, "{of_two} {of_three} {exact}");
}

#[test]
fn textureless_surfaces_are_not_matched() {
    let views = [view([-0.2, 0.0], textureless), view([0.2, 0.0], textureless)];
    let surface = PlaneSweep::new(&setup(), &views, &sparse()).unwrap().run(None, &NoProgress).unwrap();
    assert!(surface.score.data.iter().all(|s| *s == 0.0), "no cell is matched");
}

#[test]
fn a_map_matched_in_strips_is_nearly_the_same_as_a_whole_one() {
    let views = [view([-0.2, 0.0], texture), view([0.2, 0.0], texture)];
    let sweep = PlaneSweep::new(&setup(), &views, &sparse()).unwrap();
    let reference = &reference_views(&sweep)[0];
    let whole = altitude_map(&sweep, reference, MAX_VOLUME).value;
    let strips = altitude_map(&sweep, reference, 1.0).value;
    let both = whole.data.iter().zip(&strips.data).filter(|(a, b)| !a.is_nan() && !b.is_nan());
    let near = both.clone().filter(|(a, b)| (*a - *b).abs() < 0.3).count();
    let all = both.count();
    assert!(near as f64 > 0.98 * all as f64 && 2 * all > whole.data.len(), "{near} of {all}");
}
