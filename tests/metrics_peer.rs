//! Scores against figures that another implementation found, on real lidar.

// Helpers of tests are tests.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

use satgs::metrics::{Evaluation, Method, Surface, Truth, Verdict, WATER, evaluate};
use satgs::raster::Plane;
use std::path::PathBuf;

/// The oracle's figures are rounded to a millimetre and computed in another order.
const TOLERANCE_M: f64 = 0.002;

/// The benchmark scene, or a line that says why the test is skipped.
fn jax_068() -> Option<PathBuf> {
    let data = std::env::var_os("SATGS_DATA")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let scene = data.join("jax068");
    if scene.join("truth/JAX_068_DSM.tif").exists() {
        return Some(scene);
    }
    println!("skipped: no JAX_068 at `{}` (set SATGS_DATA)", scene.display());
    None
}

fn verdict(evaluation: &Evaluation, method: Method) -> &Verdict {
    evaluation.verdict(method).unwrap()
}

fn assert_near(what: &str, found: f64, expected: f64) {
    assert!((found - expected).abs() <= TOLERANCE_M, "{what}: {found}, expected {expected}");
}

#[test]
fn scores_of_the_peer_dsm_are_those_of_the_peer() {
    let Some(scene) = jax_068() else { return };
    let prediction = Surface::read(&scene.join("peer_s2p_dsm.tif")).unwrap();
    let truth = Truth::read(&scene.join("truth/JAX_068_DSM.tif"), None, prediction.grid.epsg).unwrap();
    assert!(truth.classes.is_some(), "JAX_068_CLS.tif is found by its name");
    let evaluation = evaluate(&prediction, &truth).unwrap();

    let z = verdict(&evaluation, Method::Z);
    assert_near("z MAE", z.scores.mae_m, 1.213);
    assert_near("z RMSE", z.scores.rmse_m, 3.457);
    assert_near("z NMAD", z.scores.nmad_m, 0.394);
    assert_near("z dz", z.registration.dz_m, 1.044);
    assert!((z.scores.completeness - 0.9935).abs() < 1e-4);
    assert_near("z filled", z.scores.filled_mae_m, 1.262);

    let ncc = verdict(&evaluation, Method::Ncc);
    assert_eq!((ncc.registration.dx_cells, ncc.registration.dy_cells), (-1.0, -3.0));
    assert_near("ncc dz", ncc.registration.dz_m, 0.354);
    assert_near("ncc MAE", ncc.scores.mae_m, 1.470);

    let xyz = verdict(&evaluation, Method::Xyz);
    assert!(xyz.scores.mae_m <= 1.113 + TOLERANCE_M, "xyz MAE {}", xyz.scores.mae_m);
    assert!((xyz.registration.dx_cells + 0.29).abs() < 0.1, "{:?}", xyz.registration);
    assert!((xyz.registration.dy_cells + 1.38).abs() < 0.1, "{:?}", xyz.registration);
}

#[test]
fn lidar_moved_by_whole_cells_is_brought_back_exactly() {
    let Some(scene) = jax_068() else { return };
    let truth = Truth::read(&scene.join("truth/JAX_068_DSM.tif"), None, 32617).unwrap();
    let mut prediction = truth.surface.clone();
    let lidar = &truth.surface.height;
    prediction.height =
        Plane::from_fn(lidar.width, lidar.height, |c, r| lidar.get(c as i64 - 2, r as i64 - 3) + 3.7);
    let evaluation = evaluate(&prediction, &truth).unwrap();
    for method in [Method::Ncc, Method::Xyz] {
        let v = verdict(&evaluation, method);
        assert_eq!((v.registration.dx_cells, v.registration.dy_cells), (2.0, 3.0), "{method:?}");
        assert!((v.registration.dz_m + 3.7).abs() < 1e-4, "{method:?}: {:?}", v.registration);
        assert!(v.scores.mae_m < 1e-4, "{method:?}: {}", v.scores.mae_m);
        assert_eq!((v.east_m, v.north_m), (-1.0, 1.5));
    }
}

#[test]
fn water_is_not_scored() {
    let Some(scene) = jax_068() else { return };
    let mut truth = Truth::read(&scene.join("truth/JAX_068_DSM.tif"), None, 32617).unwrap();
    let mut prediction = truth.surface.clone();
    let classes = truth.classes.as_mut().unwrap();
    classes[..200 * 512].fill(WATER);
    for (i, height) in prediction.height.data[..200 * 512].iter_mut().enumerate() {
        *height += if i % 2 == 0 { 5.0 } else { -7.0 };
    }
    let evaluation = evaluate(&prediction, &truth).unwrap();
    assert_eq!(evaluation.water_cells, 200 * 512);
    for v in &evaluation.verdicts {
        assert_eq!((v.scores.mae_m, v.scores.completeness), (0.0, 1.0), "{:?}", v.registration);
        assert!(!v.scores.by_class.contains_key(&WATER));
    }
    truth.classes = None;
    let unmasked = evaluate(&prediction, &truth).unwrap();
    assert!(verdict(&unmasked, Method::Z).scores.mae_m > 2.0);
}
