//! Matching of a simulated scene: a block on level ground, seen by six views.

use super::surface::CONFIDENT;
use super::*;
use crate::affine::{SiteScene, TrainingView, ViewCamera};
use crate::frame::{Pixel, Point, Site, SiteGrid};
use crate::io::Grid2;
use crate::progress::NoProgress;
use crate::random::CounterRng;

pub(super) const BLOCK_M: f64 = 12.0;

pub(super) fn height(x: f64, y: f64) -> f64 {
    if x.abs() < 8.0 && y.abs() < 6.0 { BLOCK_M } else { 0.0 }
}

/// Smooth noise from 0 to 1.
pub(super) fn texture(x: f64, y: f64, z: f64) -> f64 {
    let knot =
        |i: f64, j: f64| CounterRng::new(3, i as i64 as u64, j as i64 as u64, (z > 0.1).into()).uniform();
    let (i, j) = (x.floor(), y.floor());
    let (fx, fy) = (x - i, y - j);
    let line = |j: f64| knot(i, j) * (1.0 - fx) + knot(i + 1.0, j) * fx;
    line(j) * (1.0 - fy) + line(j + 1.0) * fy
}

/// Gray value of the surface at a place.
pub(super) type Paint = fn(f64, f64, f64) -> f64;

pub(super) fn textureless(_: f64, _: f64, _: f64) -> f64 {
    0.5
}

/// Textured except for the middle of the block's roof.
fn white_roof(x: f64, y: f64, z: f64) -> f64 {
    if z > 0.1 && x.abs() < 5.0 && y.abs() < 3.5 { 0.9 } else { texture(x, y, z) }
}

pub(super) fn view(slope: [f64; 2], paint: Paint) -> TrainingView {
    view_of(camera(slope), paint)
}

fn camera(slope: [f64; 2]) -> ViewCamera {
    let linear = [[2.0, 0.0, -2.0 * slope[0]], [0.0, -2.0, 2.0 * slope[1]]];
    ViewCamera::affine(linear, [79.5, 69.5])
}

/// A view whose camera has a quadratic term of up to three pixels, more over this area than that of any satellite.
pub(super) fn curved_view(slope: [f64; 2], paint: Paint) -> TrainingView {
    let s = 1.0 + slope[0] - 2.0 * slope[1];
    let quadratic =
        [[3e-3, -1e-3, 6e-3 * s, 1e-3, -3e-3, 2e-3], [-1e-3, 2e-3, -3e-3, -3e-3, 5e-3 * s, -1e-3]];
    view_of(ViewCamera { quadratic, ..view(slope, paint).camera }, paint)
}

fn view_of(camera: ViewCamera, paint: Paint) -> TrainingView {
    view_over(camera, paint, (height, 0.0, BLOCK_M))
}

/// Height of the surface at a place, and the lowest and highest one.
type Relief = (fn(f64, f64) -> f64, f64, f64);

fn view_over(camera: ViewCamera, paint: Paint, (height, low, high): Relief) -> TrainingView {
    // A pixel shows the highest point of its ray on the surface, because rays rise towards the camera.
    let color = |col: usize, row: usize| {
        let at = |z: f64| camera.localize(Pixel::new(col as f64, row as f64), z);
        let steps = (10.0 * (high - low)).clamp(1.0, 240.0) as i32;
        let steps = (0..=steps).rev().map(|k| low + f64::from(k) * (high - low) / f64::from(steps));
        let z = steps.into_iter().find(|z| height(at(*z)[0], at(*z)[1]) >= *z).unwrap_or(low);
        paint(at(z)[0], at(z)[1], z) as f32
    };
    let plane = Grid2::from_fn(160, 140, color);
    TrainingView::new("v".into(), camera, None, &[plane], (-30.0, -25.0, 30.0, 25.0), (0.0, 0.0))
}

pub(super) fn setup() -> SiteScene {
    let site = SiteGrid { epsg: 32617, origin: Point::new(436_200.0, 3_357_600.0, 10.0) };
    let area = (-25.0, -20.0, 25.0, 20.0);
    SiteScene {
        site,
        area,
        altitudes: (-5.0, 20.0),
        searched: (-5.0, 20.0),
        views: Vec::new(),
        reference: 0,
        is_framed: false,
        transfer_function: crate::scene::TransferFunction::default(),
    }
}

const SLOPES: [[f64; 2]; 6] = [[0.0, 0.0], [0.3, 0.05], [-0.3, 0.0], [0.05, 0.3], [0.0, -0.3], [0.2, -0.2]];

const PAIR: [[f64; 2]; 2] = [[-0.2, 0.0], [0.2, 0.0]];

fn views(paint: Paint) -> Vec<TrainingView> {
    SLOPES.into_iter().map(|slope| view(slope, paint)).collect()
}

pub(super) fn sparse() -> Vec<Point<Site>> {
    let grid = |i: i32| (f64::from(i % 25) * 2.0 - 24.0, f64::from(i / 25) * 2.0 - 19.0);
    (0..500).map(|i| Point::new(grid(i).0, grid(i).1, height(grid(i).0, grid(i).1))).collect()
}

/// Share of the cells within half a metre of the truth.
fn share_right(surface: &MatchedSurface) -> f64 {
    let (width, height_) = (surface.grid.width, surface.grid.height);
    let cells = (0..width * height_).map(|i| surface.point(i % width, i / width));
    let right = cells.filter(|p| (p.z() - height(p.x(), p.y())).abs() < 0.5).count();
    right as f64 / (width * height_) as f64
}

#[test]
fn a_block_and_the_ground_around_it_are_found() {
    let views = views(texture);
    let sweep = PlaneSweep::new(&setup(), &views, &sparse()).unwrap();
    let surface = sweep.run(None, &NoProgress).unwrap();
    assert!(share_right(&surface) > 0.95, "{}", share_right(&surface));
    assert!(surface.score.data.iter().filter(|s| **s > CONFIDENT).count() * 2 > surface.score.data.len());
}

#[test]
fn cameras_with_a_quadratic_term_find_the_same_surface() {
    let views: Vec<_> = SLOPES.into_iter().map(|slope| curved_view(slope, texture)).collect();
    let surface = PlaneSweep::new(&setup(), &views, &sparse()).unwrap().run(None, &NoProgress).unwrap();
    assert!(share_right(&surface) > 0.95, "{}", share_right(&surface));
}

#[test]
fn a_scene_without_sparse_points_is_matched_over_the_altitudes_that_are_searched() {
    let surface = PlaneSweep::new(&setup(), &views(texture), &[]).unwrap().run(None, &NoProgress).unwrap();
    assert!(share_right(&surface) > 0.95, "{}", share_right(&surface));
}

const TOWER_M: f64 = 60.0;

/// A tower of 8 x 8 m.
fn tower(x: f64, y: f64) -> f64 {
    if x.abs() < 4.0 && y.abs() < 4.0 { TOWER_M } else { 0.0 }
}

/// A pit of 28 x 28 m.
fn pit(x: f64, y: f64) -> f64 {
    if x.abs() < 14.0 && y.abs() < 14.0 { -TOWER_M } else { 0.0 }
}

/// A block of 8 x 8 m, half as high.
fn block(x: f64, y: f64) -> f64 {
    if x.abs() < 4.0 && y.abs() < 4.0 { 0.5 * TOWER_M } else { 0.0 }
}

/// Matches views of a relief with tie points on the ground around it only; returns the shares of the cells within `half_m`
/// metres of the middle that are right, and that are also confident.
fn found(relief: fn(f64, f64) -> f64, slopes: &[[f64; 2]], half_m: f64, searched: (f64, f64)) -> [f64; 2] {
    let middle = relief(0.0, 0.0);
    let relief_and_bounds = (relief, middle.min(0.0), middle.max(0.0));
    let of = |slope: &[f64; 2]| view_over(camera(*slope), texture, relief_and_bounds);
    let views: Vec<TrainingView> = slopes.iter().map(of).collect();
    let is_ground = |p: &Point<Site>| relief(p.x(), p.y()) == 0.0;
    let sparse: Vec<Point<Site>> = sparse().into_iter().map(|p| p.at_height(0.0)).filter(is_ground).collect();
    let scene = SiteScene { searched, ..setup() };
    let surface = PlaneSweep::new(&scene, &views, &sparse).unwrap().run(None, &NoProgress).unwrap();
    let (width, height) = (surface.grid.width, surface.grid.height);
    let cells = (0..width * height).map(|i| (i, surface.point(i % width, i / width)));
    let meant: Vec<_> = cells.filter(|(_, p)| p.x().abs() < half_m && p.y().abs() < half_m).collect();
    let right = || meant.iter().filter(|(_, p)| (p.z() - relief(p.x(), p.y())).abs() < 1.0);
    let confident = right().filter(|(i, _)| surface.score.data[*i] > 0.0).count();
    [right().count(), confident].map(|n| n as f64 / meant.len() as f64)
}

#[test]
fn towers_pits_and_blocks_without_tie_points_are_found_by_many_views_and_by_two() {
    for slopes in [&SLOPES[..], &PAIR[..]] {
        for (relief, half_m) in [(tower as fn(f64, f64) -> f64, 3.0), (pit, 2.0), (block, 3.0)] {
            let [right, confident] = found(relief, slopes, half_m, (-90.0, 120.0));
            let top = relief(0.0, 0.0);
            assert!(right > 0.9 && confident > 0.8, "{} views, {top} m: {right} {confident}", slopes.len());
        }
    }
}

#[test]
fn cells_whose_best_altitude_lies_at_an_end_of_the_range_are_not_confident() {
    let plateau: fn(f64, f64) -> f64 = |_, _| 10.0;
    let of = |slope: [f64; 2]| view_over(camera(slope), texture, (plateau, 0.0, 10.0));
    for slopes in [&SLOPES[..], &PAIR[..]] {
        let views: Vec<TrainingView> = slopes.iter().map(|slope| of(*slope)).collect();
        let scene = SiteScene { searched: (-5.0, 9.0), ..setup() };
        let surface = PlaneSweep::new(&scene, &views, &sparse()).unwrap().run(None, &NoProgress).unwrap();
        let seen = surface.score.data.iter().filter(|s| **s > CONFIDENT).count();
        let share = seen as f64 / surface.score.data.len() as f64;
        assert!(share < 0.2, "{} views: {share}", slopes.len());
    }
}

/// The true surface, raised.
fn raised(sweep: &PlaneSweep, up: f64) -> Grid2 {
    Grid2::from_fn(sweep.grid.width, sweep.grid.height, |col, row| {
        let p = setup().site.site_from_utm(sweep.grid.cell_center(col, row));
        (height(p.x(), p.y()) + up) as f32
    })
}

#[test]
fn textureless_cells_follow_the_prior_if_there_is_no_first_surface() {
    let views = views(textureless);
    let mut sweep = PlaneSweep::new(&setup(), &views, &sparse()).unwrap();
    let mut first = sweep.run(None, &NoProgress).unwrap();
    first.altitude.data.fill(f32::NAN);
    let prior = raised(&sweep, 0.0);
    let surface = sweep.refine(&prior, &first);
    assert!(share_right(&surface) > 0.95, "{}", share_right(&surface));
}

#[test]
fn textureless_cells_stay_on_the_first_surface_if_training_drifted() {
    let views = views(textureless);
    let mut sweep = PlaneSweep::new(&setup(), &views, &sparse()).unwrap();
    let mut first = sweep.run(None, &NoProgress).unwrap();
    first.altitude = raised(&sweep, 0.0);
    let prior = raised(&sweep, 4.0);
    let surface = sweep.refine(&prior, &first);
    assert!(share_right(&surface) > 0.95, "{}", share_right(&surface));
}

#[test]
fn a_prior_is_used_near_the_first_surface_and_where_views_see_it() {
    let views = views(texture);
    let sweep = PlaneSweep::new(&setup(), &views, &sparse()).unwrap();
    let first = raised(&sweep, 0.0);
    let kept = |up: f64| {
        let prior = sweep.plausible_prior(&raised(&sweep, up), &first);
        prior.valid().count() as f64 / prior.data.len() as f64
    };
    assert_eq!(kept(0.0), 1.0);
    assert!(kept(4.0) > 0.9, "{}", kept(4.0));
    // The first surface reaches this altitude near the block only.
    assert!(kept(BLOCK_M) < 0.6, "{}", kept(BLOCK_M));
    assert_eq!(kept(BLOCK_M + 6.0), 0.0);
    let unknown = Grid2::filled(first.width, first.height, f32::NAN);
    assert_eq!(sweep.plausible_prior(&first, &unknown), first);
}

#[test]
fn the_prior_weight_is_high_only_where_a_textureless_roof_is_interpolated_from_its_edges() {
    let of = |paint: Paint| {
        let views = views(paint);
        PlaneSweep::new(&setup(), &views, &sparse()).unwrap().run(None, &NoProgress).unwrap()
    };
    let mean = |surface: &MatchedSurface, is_meant: fn(Point<Site>) -> bool| {
        let (width, cells) = (surface.grid.width, surface.prior_weight.data.iter().enumerate());
        let meant: Vec<f32> =
            cells.filter(|(i, _)| is_meant(surface.point(i % width, i / width))).map(|(_, h)| *h).collect();
        meant.iter().sum::<f32>() / meant.len() as f32
    };
    let white = of(white_roof);
    let middle = |p: Point<Site>| p.x().abs() < 3.5 && p.y().abs() < 2.0;
    assert!(mean(&white, middle) > 0.9, "{}", mean(&white, middle));
    let ground = |p: Point<Site>| p.x().abs() > 12.0;
    assert!(mean(&white, ground) < 0.1, "{}", mean(&white, ground));
    assert!(mean(&of(textureless), |_| true) < 0.01, "there is no confident cell to interpolate from");
}

#[test]
fn views_with_the_same_direction_make_no_pair() {
    let same = [view([0.1, 0.0], texture), view([0.1, 0.0], texture)];
    assert!(PlaneSweep::new(&setup(), &same, &sparse()).is_none());
    assert_eq!(angle_warning(&same), None);
}

#[test]
fn views_of_a_poor_angle_are_matched_with_a_warning_if_there_are_no_better_ones() {
    for lean in [0.06, 1.2] {
        let poor = [view([0.0, 0.0], texture), view([lean, 0.0], texture)];
        assert!(PlaneSweep::new(&setup(), &poor, &sparse()).is_some(), "{lean}");
        assert!(angle_warning(&poor).is_some(), "{lean}");
    }
    let good = [view([0.0, 0.0], texture), view([0.3, 0.0], texture), view([1.2, 0.0], texture)];
    assert_eq!(angle_warning(&good), None);
}
