//! The solve against known truth: shifts, datum, derivatives, gauge, threads.

use super::*;
use crate::frame::Pixel;
use crate::rpc::{Axis, RpcCoefficients};

/// Leans of the cameras: pixels east and south per metre of height.
const LEANS: [[f64; 2]; 8] =
    [[0.8, 0.1], [-0.7, 0.3], [0.1, 0.9], [0.2, -0.8], [-0.5, -0.5], [0.6, 0.6], [0.0, 0.0], [-0.9, 0.0]];
const HEIGHTS: (f64, f64) = (60.0, 140.0);

/// Uniform numbers in [-1, 1).
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// Cameras of half a metre a pixel over Marseille, with a little of every quadratic term.
fn cameras() -> Vec<Rpc> {
    let mut noise = Noise(3);
    let mut polynomial = |lead: [f64; 4]| -> [f64; 20] {
        std::array::from_fn(|i| if i < 4 { lead[i] } else { 2e-5 * noise.next() })
    };
    LEANS
        .iter()
        .map(|lean| {
            let (px, h) = (300.0, 50.0);
            Rpc::new(RpcCoefficients {
                col: Axis { offset: 256.0, scale: px },
                row: Axis { offset: 256.0, scale: px },
                lon: Axis { offset: 5.44, scale: 0.00185 },
                lat: Axis { offset: 43.26, scale: 0.00135 },
                height: Axis { offset: 100.0, scale: h },
                col_num: polynomial([0.0, 1.0, 0.02, lean[0] * h / px]),
                col_den: polynomial([1.0, 0.0, 0.0, 0.0]),
                row_num: polynomial([0.0, 0.01, -1.0, lean[1] * h / px]),
                row_den: polynomial([1.0, 0.0, 0.0, 0.0]),
                err_bias_m: None,
                err_rand_m: None,
            })
            .unwrap()
        })
        .collect()
}

fn work(delivered: &[Rpc]) -> Work<'_> {
    let views = delivered
        .iter()
        .zip(LEANS)
        .map(|(rpc, lean)| WorkView {
            name: "view",
            rpc,
            size: (512, 512),
            keypoints: Vec::new(),
            image: Plane::filled(1, 1, 0.0),
            direction: (
                lean[0].atan2(-lean[1]).to_degrees(),
                (0.5 * lean[0].hypot(lean[1])).atan().to_degrees(),
            ),
        })
        .collect();
    let center = Point::new(5.44, 43.26, 100.0);
    Work { views, pairs: Vec::new(), left_out: Vec::new(), center, events: &crate::event::ignore }
}

/// Points seen through the true cameras: five views each, noise and outliers as asked, flags for the outliers.
fn observe(exact: &[Rpc], noise_px: f64, outliers: f64) -> (Vec<Vec<Measurement>>, Vec<Point<Geodetic>>) {
    let mut noise = Noise(11);
    (0..1500)
        .map(|_| {
            let p = Point::new(
                5.44 + 0.0015 * noise.next(),
                43.26 + 0.0011 * noise.next(),
                100.0 + 25.0 * noise.next(),
            );
            let first = ((noise.next() + 1.0) * 4.0) as usize % 8;
            let track = (0..5)
                .map(|k| {
                    let view = (first + k * 3) % 8;
                    let seen = exact[view].project(p);
                    let reach = if noise.next() * 0.5 + 0.5 < outliers { 20.0 } else { noise_px * 1.732 };
                    let px = Pixel::new(seen.col + reach * noise.next(), seen.row + reach * noise.next());
                    Measurement { view, px, weight: 1.0 }
                })
                .collect();
            (track, p)
        })
        .unzip()
}

/// Solves from the delivered cameras.
fn adjusted(delivered: &[Rpc], tracks: &[Vec<Measurement>]) -> Progress {
    let work = work(delivered);
    let block = Block::new(work.rpcs(), Vec::new(), work.center);
    let shifts = vec![[0.0; 2]; delivered.len()];
    let pairs = tracks.iter().filter_map(|t| Some((t.clone(), triangulate(&block, t, &shifts)?)));
    let (tracks, points) = pairs.unzip();
    let mut state = Progress { shifts, tracks, points };
    work.refine(&mut state, &LOSS_SCALES_PX, HEIGHTS, true).unwrap();
    state
}

/// Cameras that point wrong by known shifts, and the shifts that correct them.
fn disturbed(exact: &[Rpc]) -> (Vec<Rpc>, Vec<[f64; 2]>) {
    let mut noise = Noise(5);
    let shifts: Vec<[f64; 2]> = exact.iter().map(|_| [8.0 * noise.next(), 8.0 * noise.next()]).collect();
    (exact.iter().zip(&shifts).map(|(r, s)| r.shifted(-s[0], -s[1])).collect(), shifts)
}

/// Largest difference of the shifts from the true ones once the scene's translation is taken out.
fn worst_shift(exact: &[Rpc], found: &[[f64; 2]], truth: &[[f64; 2]]) -> f64 {
    let block = Block::new(exact.iter().collect(), Vec::new(), Point::new(5.44, 43.26, 100.0));
    let mut a = nalgebra::DMatrix::zeros(2 * found.len(), 3);
    let mut b = nalgebra::DVector::zeros(2 * found.len());
    for (v, (f, t)) in found.iter().zip(truth).enumerate() {
        let m = Measurement { view: v, px: Pixel::new(0.0, 0.0), weight: 1.0 };
        let by_point = block.linearise(&m, [0.0; 2], [0.0; 3]).by_point;
        for k in 0..2 {
            for c in 0..3 {
                a[(2 * v + k, c)] = by_point[k][c];
            }
            b[2 * v + k] = f[k] - t[k];
        }
    }
    let t = a.clone().svd(true, true).solve(&b, 1e-12).unwrap();
    (b - a * t).amax()
}

fn mean_place(state: &Progress) -> [f64; 3] {
    let n = state.points.len() as f64;
    std::array::from_fn(|k| state.points.iter().map(|p| p[k]).sum::<f64>() / n)
}

#[test]
fn without_noise_the_shifts_are_exact() {
    let exact = cameras();
    let (delivered, truth) = disturbed(&exact);
    let state = adjusted(&delivered, &observe(&exact, 0.0, 0.0).0);
    assert!(worst_shift(&exact, &state.shifts, &truth) < 1e-3);
    let block = Block::new(delivered.iter().collect(), Vec::new(), Point::new(5.44, 43.26, 100.0));
    let worst =
        state.tracks.iter().zip(&state.points).flat_map(|(t, p)| {
            t.iter().map(|m| block.distance(m, state.shifts[m.view], *p)).collect::<Vec<_>>()
        });
    assert!(worst.fold(0.0, f64::max) < 2e-3);
}

#[test]
fn shifts_are_found_among_noise_and_outliers_and_these_are_rejected() {
    let exact = cameras();
    let (delivered, truth) = disturbed(&exact);
    let (tracks, _) = observe(&exact, 0.1, 0.1);
    let all: usize = tracks.iter().map(Vec::len).sum();
    let state = adjusted(&delivered, &tracks);
    let worst = worst_shift(&exact, &state.shifts, &truth);
    assert!(worst < 0.02, "{worst}");
    let left: usize = state.tracks.iter().map(Vec::len).sum();
    assert!(left > all * 8 / 10 && left < all * 93 / 100, "{left} of {all}");
}

#[test]
fn one_bad_view_does_not_move_the_datum() {
    let exact = cameras();
    let (delivered, _) = disturbed(&exact);
    let (tracks, _) = observe(&exact, 0.1, 0.0);
    let before = adjusted(&delivered, &tracks);
    let mut bad = delivered.clone();
    bad[7] = bad[7].shifted(-0.6, -36.0);
    let after = adjusted(&bad, &tracks);
    let (a, b) = (mean_place(&before), mean_place(&after));
    for k in 0..3 {
        // The mean of the shifts would move by 4.5 px, 2 m and more.
        assert!((a[k] - b[k]).abs() < 1.0, "{a:?} {b:?}");
    }
}

#[test]
fn moving_the_scene_and_the_shifts_together_changes_no_residual() {
    let exact = cameras();
    let (tracks, points) = observe(&exact, 0.1, 0.0);
    let block = Block::new(exact.iter().collect(), tracks.clone(), Point::new(5.44, 43.26, 100.0));
    let step = [0.03, -0.02, 0.05];
    for (track, p) in tracks.iter().zip(&points).take(100) {
        let p = block.local(*p);
        for m in track {
            let o = block.linearise(m, [0.0; 2], p);
            let shift: [f64; 2] =
                std::array::from_fn(|k| -(0..3).map(|c| o.by_point[k][c] * step[c]).sum::<f64>());
            let moved = block.linearise(m, shift, std::array::from_fn(|c| p[c] + step[c]));
            for k in 0..2 {
                assert!((moved.residual[k] - o.residual[k]).abs() < 1e-6);
            }
        }
    }
}

#[test]
fn derivatives_agree_with_central_differences() {
    let exact = cameras();
    let block = Block::new(exact.iter().collect(), Vec::new(), Point::new(5.44, 43.26, 100.0));
    let p = [40.0, -25.0, 12.0];
    for view in 0..exact.len() {
        let m = Measurement { view, px: Pixel::new(200.0, 300.0), weight: 1.0 };
        let o = block.linearise(&m, [0.3, -0.7], p);
        for c in 0..3 {
            let at = |d: f64| {
                let mut q = p;
                q[c] += d;
                block.linearise(&m, [0.3, -0.7], q).residual
            };
            let (a, b) = (at(0.01), at(-0.01));
            for k in 0..2 {
                // The residual is observed minus predicted.
                let numeric = -(a[k] - b[k]) / 0.02;
                assert!((numeric - o.by_point[k][c]).abs() < 1e-6 * o.by_point[k][c].abs().max(0.1));
            }
        }
    }
}

#[test]
fn the_result_does_not_depend_on_the_number_of_threads() {
    let exact = cameras();
    let (delivered, _) = disturbed(&exact);
    let (tracks, _) = observe(&exact, 0.1, 0.1);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| adjusted(&delivered, &tracks))
    };
    let (one, two) = (with(1), with(2));
    assert_eq!(one.shifts, two.shifts);
    assert_eq!(one.points, two.points);
}
