//! Scores against figures that another implementation found, on real lidar.

use satgs::io::{Grid2, MapGrid};
use satgs::metrics::{
    Division, Evaluation, HeightRaster, Method, RegisteredScores, Truth, TruthOptions, WATER, evaluate,
};
use std::path::{Path, PathBuf};

/// The oracle's figures are rounded to a millimetre and computed in another order.
const TOLERANCE_M: f64 = 0.002;

/// The benchmark scene, or a line that says why the test is skipped.
pub fn jax_068() -> Option<PathBuf> {
    let data = std::env::var_os("SATGS_DATA")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let scene = data.join("jax068");
    if scene.join("truth/JAX_068_DSM.tif").exists() {
        return Some(scene);
    }
    println!("skipped: no JAX_068 at `{}` (set SATGS_DATA)", scene.display());
    None
}

/// A grid in the truth's zone, which its text file does not name.
const ZONE: MapGrid = MapGrid { epsg: 32617, west: 0.0, north: 0.0, cell: 0.5, width: 1, height: 1 };

pub fn lidar(scene: &Path) -> Truth {
    Truth::read(&scene.join("truth/JAX_068_DSM.tif"), &TruthOptions::default(), &ZONE).unwrap()
}

fn registered_scores(evaluation: &Evaluation, method: Method) -> &RegisteredScores {
    evaluation.registered_scores(method).unwrap()
}

fn assert_near(what: &str, found: f64, expected: f64) {
    assert!((found - expected).abs() <= TOLERANCE_M, "{what}: {found}, expected {expected}");
}

#[test]
fn scores_agree_with_the_other_implementation() {
    let Some(scene) = jax_068() else { return };
    let prediction = HeightRaster::read(&scene.join("peer_s2p_dsm.tif")).unwrap();
    let truth = lidar(&scene);
    assert!(truth.classes.is_some(), "JAX_068_CLS.tif is found by its name");
    let evaluation = evaluate(prediction, None, truth).unwrap();

    let z = registered_scores(&evaluation, Method::Z);
    assert_near("z MAE", z.scores.mae_m, 1.213);
    assert_near("z RMSE", z.scores.rmse_m, 3.457);
    assert_near("z NMAD", z.scores.nmad_m, 0.394);
    assert_near("z dz", z.registration.dz_m, 1.044);
    assert!((z.scores.completeness - 0.9935).abs() < 1e-4);
    assert_near("z filled", z.scores.filled_mae_m, 1.262);

    let ncc = registered_scores(&evaluation, Method::Ncc);
    assert_eq!((ncc.registration.dx_cells, ncc.registration.dy_cells), (-1.0, -3.0));
    assert_near("ncc dz", ncc.registration.dz_m, 0.354);
    assert_near("ncc MAE", ncc.scores.mae_m, 1.470);

    let xyz = registered_scores(&evaluation, Method::Xyz);
    // The smallest error of all bilinear shifts is 1.113 m, at (-0.29, -1.38): interpolation half-way between cells
    // smooths the noise of this surface, and loses the cells around its holes. Without that reward:
    assert_near("xyz MAE", xyz.scores.mae_m, 1.169);
    assert!((xyz.registration.dx_cells - 0.06).abs() < 0.1, "{:?}", xyz.registration);
    assert!((xyz.registration.dy_cells + 1.18).abs() < 0.1, "{:?}", xyz.registration);
    assert!((xyz.scores.completeness - 0.992).abs() < 1e-3);

    // Every division shares the same land out, and its parts' errors make the whole's.
    for v in &evaluation.registered_scores {
        for by in [Division::Class, Division::RoofEdge, Division::Slope] {
            let parts: Vec<_> = v.breakdown.iter().filter(|s| s.by == by).map(|s| &s.scores).collect();
            assert_eq!(parts.iter().map(|s| s.cells).sum::<usize>(), 512 * 512, "{by:?}");
            assert_eq!(parts.iter().map(|s| s.predicted).sum::<usize>(), v.scores.predicted, "{by:?}");
            let sum: f64 = parts.iter().map(|s| s.mae_m * s.predicted as f64).sum();
            assert!((sum / v.scores.predicted as f64 - v.scores.mae_m).abs() < 1e-9, "{by:?}");
        }
    }
    let part = |name: &str| xyz.breakdown.iter().find(|s| s.name.contains(name)).unwrap();
    assert!(part("within 1 m").scores.mae_m > 1.5 * part("farther").scores.mae_m, "edges are hard");
}

#[test]
fn lidar_shifted_by_whole_cells_is_registered_exactly() {
    let Some(scene) = jax_068() else { return };
    let truth = lidar(&scene);
    let mut prediction = truth.surface.clone();
    let heights = &truth.surface.height;
    prediction.height =
        Grid2::from_fn(heights.width, heights.height, |c, r| heights.get(c as i64 - 2, r as i64 - 3) + 3.7);
    let evaluation = evaluate(prediction, None, truth).unwrap();
    for method in [Method::Ncc, Method::Xyz] {
        let v = registered_scores(&evaluation, method);
        assert_eq!((v.registration.dx_cells, v.registration.dy_cells), (2.0, 3.0), "{method:?}");
        assert!((v.registration.dz_m + 3.7).abs() < 1e-4, "{method:?}: {:?}", v.registration);
        assert!(v.scores.mae_m < 1e-4, "{method:?}: {}", v.scores.mae_m);
        assert_eq!((v.east_m, v.north_m), (-1.0, 1.5));
    }
}

#[test]
fn water_is_not_scored() {
    let Some(scene) = jax_068() else { return };
    let mut truth = lidar(&scene);
    let mut prediction = truth.surface.clone();
    let classes = truth.classes.as_mut().unwrap();
    classes[..200 * 512].fill(WATER);
    for (i, height) in prediction.height.data[..200 * 512].iter_mut().enumerate() {
        *height += if i % 2 == 0 { 5.0 } else { -7.0 };
    }
    let mut unmasked = truth.clone();
    unmasked.classes = None;
    let evaluation = evaluate(prediction.clone(), None, truth).unwrap();
    assert_eq!(evaluation.water_cells, 200 * 512);
    for v in &evaluation.registered_scores {
        assert_eq!((v.scores.mae_m, v.scores.completeness), (0.0, 1.0), "{:?}", v.registration);
        assert!(!v.breakdown.iter().any(|s| s.name.starts_with('9')));
    }
    let unmasked = evaluate(prediction, None, unmasked).unwrap();
    assert!(registered_scores(&unmasked, Method::Z).scores.mae_m > 2.0);
}
