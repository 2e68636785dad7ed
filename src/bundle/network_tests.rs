//! The solve against known truth: shifts, datum, derivatives, gauge, threads.

use super::super::problem::PositionPrior;
use super::*;
use crate::rpc::{Axis, RpcCoefficients};

/// Leans of the cameras: pixels east and south per metre of height.
const LEANS: [[f64; 2]; 8] =
    [[0.8, 0.1], [-0.7, 0.3], [0.1, 0.9], [0.2, -0.8], [-0.5, -0.5], [0.6, 0.6], [0.0, 0.0], [-0.9, 0.0]];
const HEIGHTS: (f64, f64) = (60.0, 140.0);
/// Distances that are not rejected, pixels.
const ALLOWED_PX: f64 = 0.4;

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

fn network(delivered: &[Rpc]) -> Network<'_> {
    Network {
        rpcs: delivered.iter().collect(),
        frames: vec![ImageFrame::new((512, 512)); delivered.len()],
        is_fixed: vec![false; delivered.len()],
        directions: LEANS
            .iter()
            .map(|lean| {
                let azimuth = lean[0].atan2(-lean[1]).to_degrees();
                (azimuth, (0.5 * lean[0].hypot(lean[1])).atan().to_degrees())
            })
            .collect(),
        center: Point::new(5.44, 43.26, 100.0),
        heights: HEIGHTS,
        height_prior: None,
    }
}

/// Points seen through the true cameras: five views each, noise and outliers as asked, flags for the outliers.
fn observe(exact: &[Rpc], noise_px: f64, outliers: f64) -> (Vec<Track>, Vec<Point<Geodetic>>) {
    let mut noise = Noise(11);
    (0..1500)
        .map(|_| {
            let p = Point::new(
                5.44 + 0.0015 * noise.next(),
                43.26 + 0.0011 * noise.next(),
                100.0 + 25.0 * noise.next(),
            );
            let first = ((noise.next() + 1.0) * 4.0) as usize % 8;
            let seen = (0..5)
                .map(|k| {
                    let view = (first + k * 3) % 8;
                    let seen = exact[view].project(p);
                    let reach = if noise.next() * 0.5 + 0.5 < outliers { 20.0 } else { noise_px * 1.732 };
                    let px = Pixel::new(seen.col + reach * noise.next(), seen.row + reach * noise.next());
                    Observation { view, px, weight: 1.0 }
                })
                .collect();
            (Track { observations: seen, ..Track::default() }, p)
        })
        .unzip()
}

/// Solves from the delivered cameras.
fn adjusted(delivered: &[Rpc], tracks: &[Track]) -> Estimate {
    let network = network(delivered);
    let mut estimate = Estimate::start(delivered.len());
    network.triangulate_tracks(&mut estimate, tracks.to_vec());
    network.refine(&mut estimate, &LOSS_SCALES_PX, CorrectionModel::Shift, ALLOWED_PX).unwrap();
    estimate
}

/// Cameras that point wrong by known shifts, and the shifts that correct them.
fn disturbed(exact: &[Rpc]) -> (Vec<Rpc>, Vec<[f64; 2]>) {
    let mut noise = Noise(5);
    let shifts: Vec<[f64; 2]> = exact.iter().map(|_| [8.0 * noise.next(), 8.0 * noise.next()]).collect();
    (exact.iter().zip(&shifts).map(|(r, s)| r.shifted(-s[0], -s[1])).collect(), shifts)
}

/// Largest difference of the shifts from the true ones once the scene's translation is taken out.
fn worst_shift(block: &Block, found: &[Parameters], truth: &[[f64; 2]]) -> f64 {
    let mut a = nalgebra::DMatrix::zeros(2 * found.len(), 3);
    let mut b = nalgebra::DVector::zeros(2 * found.len());
    for (v, (f, t)) in found.iter().zip(truth).enumerate() {
        let m = Observation { view: v, px: Pixel::new(0.0, 0.0), weight: 1.0 };
        let by_point = block.linearise(&m, &[0.0; MOST], [0.0; 3]).by_point;
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

fn mean_place(estimate: &Estimate) -> [f64; 3] {
    let n = estimate.points.len() as f64;
    std::array::from_fn(|k| estimate.points.iter().map(|p| p[k]).sum::<f64>() / n)
}

fn observations(tracks: &[Track]) -> usize {
    tracks.iter().map(|t| t.observations.len()).sum()
}

#[test]
fn without_noise_the_shifts_are_exact() {
    let exact = cameras();
    let (delivered, truth) = disturbed(&exact);
    let estimate = adjusted(&delivered, &observe(&exact, 0.0, 0.0).0);
    let network = network(&delivered);
    assert!(worst_shift(&network.block(), &estimate.corrections, &truth) < 1e-3);
    let worst = network.distances(&estimate).into_iter().map(|d| d.1).fold(0.0, f64::max);
    assert!(worst < 2e-3, "{worst}");
}

#[test]
fn shifts_are_found_among_noise_and_outliers_and_these_are_rejected() {
    let exact = cameras();
    let (delivered, truth) = disturbed(&exact);
    let (tracks, _) = observe(&exact, 0.1, 0.1);
    let all = observations(&tracks);
    let estimate = adjusted(&delivered, &tracks);
    let worst = worst_shift(&network(&delivered).block(), &estimate.corrections, &truth);
    assert!(worst < 0.02, "{worst}");
    let left = observations(&estimate.tracks);
    assert!(left > all * 8 / 10 && left < all * 93 / 100, "{left} of {all}");
}

/// Root mean square of errors in units of their standard deviations: one, if these are right.
fn normalised_rms(errors_and_sigmas: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (sum, n) =
        errors_and_sigmas.fold((0.0, 0.0), |(s, n), (e, sigma)| (s + (e / sigma).powi(2), n + 1.0));
    f64::sqrt(sum / n)
}

#[test]
fn errors_are_as_large_as_their_standard_deviations_say_and_the_translation_is_open() {
    let exact = cameras();
    let (delivered, truth) = disturbed(&exact);
    let (tracks, points) = observe(&exact, 0.1, 0.0);
    let network = network(&delivered);
    let block = network.block();
    let estimate = adjusted(&delivered, &tracks);
    assert_eq!(estimate.tracks.len(), tracks.len());
    let precision = network.precision(&estimate, CorrectionModel::Shift, false).unwrap();
    assert_eq!(precision.rank_defect, 3);
    assert!((precision.sigma_px - 0.1).abs() < 0.01, "{}", precision.sigma_px);

    // Both are compared with the mean over the scene taken out, as its translation is open.
    let off = |k: usize| move |(p, exact): (&[f64; 3], &[f64; 3])| p[k] - exact[k];
    let exact_places: Vec<[f64; 3]> = points.iter().map(|p| block.local(*p)).collect();
    for k in 0..3 {
        let errors: Vec<f64> = estimate.points.iter().zip(&exact_places).map(off(k)).collect();
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        let sigmas = precision.points.iter().map(|s| s[k]);
        let rms = normalised_rms(errors.iter().map(|e| e - mean).zip(sigmas));
        assert!((0.85..1.15).contains(&rms), "{k}: {rms}");
    }
    // The shifts of eight views are few: their largest error is within four standard deviations.
    let largest = precision.corrections.iter().flat_map(|c| &c[..2]).fold(0.0, |m: f64, s| m.max(*s));
    let worst = worst_shift(&block, &estimate.corrections, &truth);
    assert!((0.25..4.0).contains(&(worst / largest)), "{worst} {largest}");
}

#[test]
fn reference_views_stay_as_they_are_and_fix_the_datum() {
    let exact = cameras();
    let (mut delivered, truth) = disturbed(&exact);
    delivered[..2].clone_from_slice(&exact[..2]);
    let mut network = network(&delivered);
    network.is_fixed[..2].fill(true);
    let mut estimate = Estimate::start(delivered.len());
    network.triangulate_tracks(&mut estimate, observe(&exact, 0.1, 0.0).0);
    network.refine(&mut estimate, &LOSS_SCALES_PX, CorrectionModel::Shift, ALLOWED_PX).unwrap();
    assert_eq!(estimate.corrections[..2], [[0.0; MOST]; 2]);
    for (found, exact) in estimate.corrections.iter().zip(&truth).skip(2) {
        for k in 0..2 {
            assert!((found[k] - exact[k]).abs() < 0.05, "{found:?} {exact:?}");
        }
    }
    let precision = network.precision(&estimate, CorrectionModel::Shift, false).unwrap();
    assert_eq!((precision.rank_defect, precision.corrections[0]), (0, [0.0; MOST]));
    assert_eq!(network.precision(&estimate, CorrectionModel::Shift, true).unwrap().rank_defect, 0);
}

#[test]
fn ground_control_fixes_the_datum_and_one_wrong_pixel_does_not_move_it() {
    let exact = cameras();
    let (delivered, truth) = disturbed(&exact);
    let (mut tracks, points) = observe(&exact, 0.1, 0.0);
    let network = network(&delivered);
    let block = network.block();
    for (track, p) in tracks.iter_mut().zip(&points).take(6) {
        track.prior = Some(PositionPrior { place: block.local(*p), sigma_m: [0.05; 3] });
    }
    tracks[0].observations[0].px.col += 12.0;
    let estimate = adjusted(&delivered, &tracks);
    // Without control the datum would be off by the mean of the shifts: pixels.
    for (found, exact) in estimate.corrections.iter().zip(&truth) {
        for k in 0..2 {
            assert!((found[k] - exact[k]).abs() < 0.1, "{found:?} {exact:?}");
        }
    }
    assert_eq!(estimate.tracks.iter().filter(|t| t.prior.is_some()).count(), 6);
}

#[test]
fn an_affine_model_finds_what_stretches_and_turns_the_image() {
    let exact = cameras();
    let frame = ImageFrame::new((512, 512));
    // The correction that the camera needs is the inverse of what is done to it; small ones add up.
    let edge = [0.06, -0.04, 0.08, -0.07];
    let mut bent = exact.clone();
    bent[2] =
        frame.corrected(&exact[2], &[0.0, 0.0, -edge[0], -edge[1], -edge[2], -edge[3]], HEIGHTS).unwrap();
    let network = network(&bent);
    let mut estimate = Estimate::start(bent.len());
    network.triangulate_tracks(&mut estimate, observe(&exact, 0.05, 0.0).0);
    network.refine(&mut estimate, &LOSS_SCALES_PX, CorrectionModel::Affine, ALLOWED_PX).unwrap();
    // The whole scene may bend a little with it: priors share it out.
    for k in 0..4 {
        let found = estimate.corrections[2][2 + k];
        assert!((found - edge[k]).abs() < 0.03, "{k}: {found} is not {}", edge[k]);
    }
}

#[test]
fn moving_the_scene_and_the_shifts_together_changes_no_residual() {
    let exact = cameras();
    let (tracks, points) = observe(&exact, 0.1, 0.0);
    let block = network(&exact).block();
    let step = [0.03, -0.02, 0.05];
    for (track, p) in tracks.iter().zip(&points).take(100) {
        let p = block.local(*p);
        for m in &track.observations {
            let o = block.linearise(m, &[0.0; MOST], p);
            let mut shift = [0.0; MOST];
            for k in 0..2 {
                shift[k] = -(0..3).map(|c| o.by_point[k][c] * step[c]).sum::<f64>();
            }
            let moved = block.linearise(m, &shift, std::array::from_fn(|c| p[c] + step[c]));
            for k in 0..2 {
                assert!((moved.residual[k] - o.residual[k]).abs() < 1e-6);
            }
        }
    }
}

#[test]
fn derivatives_agree_with_central_differences() {
    let exact = cameras();
    let block = network(&exact).block();
    let (p, correction) = ([40.0, -25.0, 12.0], [0.3, -0.7, 4.0, -3.0, 2.0, 5.0]);
    for view in 0..exact.len() {
        let m = Observation { view, px: Pixel::new(200.0, 300.0), weight: 1.0 };
        let o = block.linearise(&m, &correction, p);
        for c in 0..3 {
            let at = |d: f64| {
                let mut q = p;
                q[c] += d;
                block.linearise(&m, &correction, q).residual
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
    assert_eq!(one.corrections, two.corrections);
    assert_eq!(one.points, two.points);
}

/// The simulated truth: real RPCs, 43 views, 20,000 tracks of five observations on average.
mod omaha {
    use super::*;
    use crate::rpc::formats;

    const TRACKS: usize = 20_000;
    const SHIFT_PX: f64 = 5.0;
    const NOISE_PX: f64 = 0.1;
    const OUTLIER_PX: f64 = 20.0;

    struct Truth {
        exact: Vec<Rpc>,
        delivered: Vec<Rpc>,
        shifts: Vec<[f64; 2]>,
        tracks: Vec<Track>,
        /// (track, view) and size of what was added to an observation, pixels.
        outliers: Vec<(usize, usize, f64)>,
    }

    /// Gaussian by the central limit.
    fn normal(noise: &mut Noise) -> f64 {
        (0..12).map(|_| 0.5 * noise.next()).sum::<f64>()
    }

    fn truth() -> Option<Truth> {
        let here = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
        let data = std::env::var_os("SATGS_DATA").map_or(here, std::path::PathBuf::from);
        let folder = data.join("wv3-omaha/OMA_203");
        let Ok(entries) = std::fs::read_dir(&folder) else {
            #[allow(clippy::print_stdout)]
            {
                println!("skipped: no real data at {}", folder.display());
            }
            return None;
        };
        let mut files: Vec<_> = entries.map(|e| e.unwrap().path()).collect();
        files.retain(|f| f.to_string_lossy().ends_with("corrected.ikono"));
        files.sort();
        let exact: Vec<Rpc> = files
            .iter()
            .map(|f| formats::parse("RPC.TXT".as_ref(), &std::fs::read_to_string(f).unwrap()).unwrap().rpc)
            .collect();
        let mut noise = Noise(17);
        let shifts: Vec<[f64; 2]> =
            exact.iter().map(|_| [(); 2].map(|()| SHIFT_PX * normal(&mut noise))).collect();
        let delivered = exact.iter().zip(&shifts).map(|(r, s)| r.shifted(-s[0], -s[1])).collect();
        let center = exact[0].localize(Pixel::new(1024.0, 1024.0), 300.0).unwrap();
        let mut outliers = Vec::new();
        let tracks = (0..TRACKS)
            .map(|t| {
                let p = Point::new(
                    center.lon_deg() + 0.003 * noise.next(),
                    center.lat_deg() + 0.002 * noise.next(),
                    300.0 + 20.0 * noise.next(),
                );
                let count = 3 + ((noise.next() + 1.0) * 2.5) as usize;
                let mut views: Vec<usize> = Vec::new();
                while views.len() < count {
                    let view = ((noise.next() + 1.0) * 0.5 * exact.len() as f64) as usize;
                    if !views.contains(&view) {
                        views.push(view);
                    }
                }
                let seen = views
                    .into_iter()
                    .map(|view| {
                        let mut off = [(); 2].map(|()| NOISE_PX * normal(&mut noise));
                        if noise.next() < -0.8 {
                            let wrong = [(); 2].map(|()| OUTLIER_PX * noise.next());
                            outliers.push((t, view, wrong[0].hypot(wrong[1])));
                            off = [off[0] + wrong[0], off[1] + wrong[1]];
                        }
                        let px = exact[view].project(p);
                        Observation { view, px: Pixel::new(px.col + off[0], px.row + off[1]), weight: 1.0 }
                    })
                    .collect();
                Track { observations: seen, ..Track::default() }
            })
            .collect();
        Some(Truth { exact, delivered, shifts, tracks, outliers })
    }

    fn network<'a>(delivered: &'a [Rpc], exact: &[Rpc]) -> Network<'a> {
        let center = exact[0].localize(Pixel::new(1024.0, 1024.0), 300.0).unwrap();
        let direction = |rpc: &Rpc| {
            let high = rpc.localize_from(rpc.project(center), center.at_height(400.0)).unwrap();
            let east = (high.lon_deg() - center.lon_deg()) * 111_320.0 * center.lat_deg().to_radians().cos();
            let north = (high.lat_deg() - center.lat_deg()) * 111_320.0;
            (east.atan2(north).to_degrees(), east.hypot(north).atan2(100.0).to_degrees())
        };
        Network {
            rpcs: delivered.iter().collect(),
            frames: vec![ImageFrame::new((2048, 2048)); delivered.len()],
            is_fixed: vec![false; delivered.len()],
            directions: exact.iter().map(direction).collect(),
            center,
            heights: (270.0, 330.0),
            height_prior: None,
        }
    }

    fn solved(network: &Network, tracks: &[Track]) -> (Estimate, f64) {
        let start = std::time::Instant::now();
        let mut estimate = Estimate::start(network.rpcs.len());
        network.triangulate_tracks(&mut estimate, tracks.to_vec());
        network.refine(&mut estimate, &LOSS_SCALES_PX, CorrectionModel::Shift, ALLOWED_PX).unwrap();
        (estimate, start.elapsed().as_secs_f64())
    }

    #[test]
    #[allow(clippy::print_stdout)]
    fn forty_three_real_cameras_are_recovered_and_a_bad_one_leaves_the_datum() {
        let Some(truth) = truth() else { return };
        let network_of = |delivered| network(delivered, &truth.exact);
        let good = network_of(&truth.delivered);
        let (found, seconds) = solved(&good, &truth.tracks);
        let worst = worst_shift(&good.block(), &found.corrections, &truth.shifts);
        // An observation is known by its track's first: tracks keep their order, and their observations' pixels.
        let kept: std::collections::BTreeSet<[u64; 2]> = found
            .tracks
            .iter()
            .flat_map(|t| t.observations.iter().map(|m| [m.px.col.to_bits(), m.px.row.to_bits()]))
            .collect();
        let large: Vec<_> = truth.outliers.iter().filter(|o| o.2 > 1.0).collect();
        let is_dropped = |o: &&&(usize, usize, f64)| {
            let m = truth.tracks[o.0].observations.iter().find(|m| m.view == o.1).unwrap();
            !kept.contains(&[m.px.col.to_bits(), m.px.row.to_bits()])
        };
        let recall = large.iter().filter(is_dropped).count() as f64 / large.len() as f64;
        println!(
            "{} views, {} observations: worst shift {worst:.4} px, recall {recall:.4}, kept {}, {seconds:.2} s",
            truth.exact.len(),
            observations(&truth.tracks),
            kept.len()
        );
        assert!(worst < 0.02, "{worst}");
        assert!(recall > 0.99, "{recall}");
        assert!(kept.len() * 100 > observations(&truth.tracks) * 80);

        let mut bad = truth.delivered.clone();
        bad[7] = bad[7].shifted(-0.6, -36.0);
        let (moved, _) = solved(&network_of(&bad), &truth.tracks);
        let (a, b) = (mean_place(&found), mean_place(&moved));
        println!("datum moves by {:?} m", [0, 1, 2].map(|k| b[k] - a[k]));
        for k in 0..3 {
            assert!((a[k] - b[k]).abs() < 0.1, "{a:?} {b:?}");
        }
    }
}

/// Single precision would round this to 0.002 px.
#[test]
fn residuals_far_out_in_a_large_image_are_not_rounded() {
    let far: Vec<Rpc> = cameras().iter().map(|r| r.shifted(30_000.0, 20_000.0)).collect();
    let block = network(&far).block();
    let p = [40.0, -25.0, 12.0];
    let seen = far[0].project(block.geodetic(p));
    let m = Observation { view: 0, px: Pixel::new(seen.col + 1e-4, seen.row - 2e-4), weight: 1.0 };
    let [col, row] = block.linearise(&m, &[0.0; MOST], p).residual;
    assert!((col - 1e-4).abs() < 1e-9 && (row + 2e-4).abs() < 1e-9, "{col} {row}");
}

#[test]
fn tracks_of_nearly_one_direction_are_not_placed() {
    let exact = cameras();
    let (tracks, _) = observe(&exact, 0.1, 0.0);
    let mut network = network(&exact);
    let mut estimate = Estimate::start(exact.len());
    network.directions.fill((90.0, 20.0));
    network.directions[7] = (90.0, 20.0 + 0.9 * LEAST_ANGLE_DEG);
    network.triangulate_tracks(&mut estimate, tracks.clone());
    assert!(estimate.tracks.is_empty());
    network.directions[7] = (90.0, 20.0 + 1.1 * LEAST_ANGLE_DEG);
    network.triangulate_tracks(&mut estimate, tracks);
    assert!(!estimate.tracks.is_empty());
    assert!(estimate.tracks.iter().all(|t| t.observations.iter().any(|m| m.view == 7)));
}

#[test]
fn a_view_of_which_half_is_wrong_keeps_the_good_half() {
    let exact = cameras();
    let (delivered, truth) = disturbed(&exact);
    let (mut tracks, _) = observe(&exact, 0.1, 0.0);
    let mut noise = Noise(23);
    for m in tracks.iter_mut().flat_map(|t| &mut t.observations).filter(|m| m.view == 3) {
        if noise.next() > 0.0 {
            m.px = Pixel::new(m.px.col + 20.0 * noise.next(), m.px.row + 20.0 * noise.next());
        }
    }
    let estimate = adjusted(&delivered, &tracks);
    let network = network(&delivered);
    let worst = worst_shift(&network.block(), &estimate.corrections, &truth);
    assert!(worst < 0.05, "{worst}");
    let left: Vec<f64> = network.distances(&estimate).iter().filter(|d| d.0 == 3).map(|d| d.1).collect();
    assert!(left.len() > 400 && left.iter().all(|d| *d < 1.0), "{} left", left.len());
}

/// Near-affine cameras that stretch freely would leave the scene free to tilt.
#[test]
fn an_affine_model_does_not_tilt_the_scene() {
    let exact = cameras();
    let (delivered, _) = disturbed(&exact);
    let (tracks, points) = observe(&exact, 0.1, 0.0);
    let network = network(&delivered);
    let block = network.block();
    let mut estimate = Estimate::start(delivered.len());
    network.triangulate_tracks(&mut estimate, tracks.clone());
    network.refine(&mut estimate, &LOSS_SCALES_PX, CorrectionModel::Affine, ALLOWED_PX).unwrap();
    assert_eq!(estimate.tracks.len(), tracks.len());
    for axis in 0..2 {
        let (mut sums, mut counts) = ([0.0; 2], [0.0; 2]);
        for (found, exact) in estimate.points.iter().zip(&points) {
            let exact = block.local(*exact);
            let side = usize::from(exact[axis] > 0.0);
            sums[side] += found[2] - exact[2];
            counts[side] += 1.0;
        }
        let tilt_m = sums[1] / counts[1] - sums[0] / counts[0];
        assert!(tilt_m.abs() < 0.1, "{axis}: {tilt_m} m");
    }
}
