//! Bundle adjustment of real images: tracks, residuals, and agreement with an independent adjustment.

use crate::common::{data_dir, disagreement_px};
use satgs::bundle::{Adjustment, BundleOptions, adjust};
use satgs::frame::{Pixel, SiteGrid};
use satgs::io::MapGrid;
use satgs::metrics::{Truth, TruthOptions};
use satgs::progress::NoProgress;
use satgs::rpc::{Rpc, formats};
use satgs::scene::{ReadOptions, read};
use satgs::stats::{MAD_TO_SIGMA, interpolated_quantile};
use std::path::Path;

/// How far a camera may be from sat-bundleadjust's, pixels, once the common translation is taken out.
const AGREEMENT_PX: f64 = 0.15;

fn adjusted(folder: &Path, rpcs: Option<&str>) -> Adjustment {
    let options = ReadOptions { rpcs: rpcs.map(str::to_owned), ..ReadOptions::default() };
    adjust(&read(folder, &options).unwrap(), &BundleOptions::default(), &NoProgress).unwrap()
}

/// Spread of the points' heights over the lidar's below them, not registered.
fn nmad_to_lidar_m(folder: &Path, made: &Adjustment) -> f64 {
    let site = SiteGrid::at(made.points[0].position).unwrap();
    // The truth's text file names no CRS: only that of this grid counts.
    let grid = MapGrid { epsg: site.epsg, west: 0.0, north: 0.0, cell: 1.0, width: 1, height: 1 };
    let path = folder.join("truth/JAX_068_DSM.tif");
    let truth = Truth::read(&path, &TruthOptions::default(), &grid).unwrap().surface;
    let off: Vec<f32> = made
        .points
        .iter()
        .map(|p| {
            let place = site.utm_from_geodetic(p.position);
            let px = truth.grid.corner_px_from_utm(place);
            let lidar = truth.height.get(px.col.floor() as i64, px.row.floor() as i64);
            p.position.height_m() as f32 - lidar
        })
        .filter(|d| d.is_finite())
        .collect();
    let median = interpolated_quantile(&off, 0.5);
    let deviations: Vec<f32> = off.iter().map(|d| (f64::from(*d) - median).abs() as f32).collect();
    MAD_TO_SIGMA * interpolated_quantile(&deviations, 0.5)
}

#[test]
fn a_pleiades_pair_is_adjusted_to_a_tenth_of_a_pixel() {
    let Some(data) = data_dir() else { return };
    let report = adjusted(&data.join("s2p/input_pair"), None).report;
    println!("{}", report.table());
    assert!(report.tracks >= 2000 && report.mean_px <= 0.10);
}

#[test]
fn a_pleiades_triplet_is_adjusted_to_a_tenth_of_a_pixel() {
    let Some(data) = data_dir() else { return };
    let report = adjusted(&data.join("s2p/input_triplet"), None).report;
    println!("{}", report.table());
    assert!(report.tracks >= 6000 && report.mean_px <= 0.10);
}

#[test]
fn nineteen_dates_agree_with_an_independent_adjustment_although_one_view_is_36_pixels_off() {
    let Some(data) = data_dir() else { return };
    let folder = data.join("jax068");
    let made = adjusted(&folder, Some("rpcs_raw"));
    println!("{}", made.report.table());
    assert_eq!(made.report.views.len(), 19);
    assert!(made.report.tracks >= 6000 && made.report.mean_px <= 0.18);
    assert!(made.report.views.iter().all(|v| v.observations >= 250));
    let pairs: Vec<(Rpc, Rpc)> = made
        .cameras
        .iter()
        .map(|(name, rpc)| {
            let theirs = formats::read(&folder.join("rpcs_ba_v2").join(format!("{name}.json"))).unwrap().rpc;
            (rpc.clone(), theirs)
        })
        .collect();
    let mut off = disagreement_px(&pairs, Pixel::new(400.0, 400.0));
    for ((name, _), d) in made.cameras.iter().zip(&off) {
        println!("{name}: {d:.3} px");
    }
    off.sort_by(f64::total_cmp);
    println!("median {:.3} px, largest {:.3} px", off[off.len() / 2], off[off.len() - 1]);
    assert!(off[off.len() - 1] < AGREEMENT_PX);
    let nmad = nmad_to_lidar_m(&folder, &made);
    println!("NMAD of the points' heights against lidar: {nmad:.3} m");
    assert!(nmad < 1.0);
}
