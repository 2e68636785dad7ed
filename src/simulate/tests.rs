//! Tests of whole scenes: reproducible bytes, statistics, delivered files.

use super::*;
use crate::io::ImageFile;
use crate::progress::NoProgress;
use std::collections::BTreeMap;

fn small() -> SimulateOptions {
    SimulateOptions { views: 4, size_px: 72, gsd_m: 1.0, ..SimulateOptions::default() }
}

fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            all.extend(files(&path));
        } else {
            all.insert(path.clone(), std::fs::read(&path).unwrap());
        }
    }
    all
}

#[test]
fn the_same_seed_gives_the_same_bytes_for_any_number_of_threads() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("scene");
    let run = |threads: usize, options: &SimulateOptions| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| simulate(&out, options, &NoProgress).unwrap());
        files(&out)
    };
    let first = run(1, &small());
    let again = run(3, &SimulateOptions { overwrite: true, ..small() });
    assert_eq!(first.len(), 4 + 4 + 3);
    assert!(first == again, "bytes differ");
    let other = run(2, &SimulateOptions { overwrite: true, seed: 1, views: 3, ..small() });
    assert_eq!(other.len(), 3 + 3 + 3, "files of the earlier simulation are gone");
    assert!(other.iter().all(|(path, bytes)| first.get(path) != Some(bytes)));
}

#[test]
fn a_folder_with_other_files_is_not_changed() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("thesis.txt"), "years of work").unwrap();
    let error = simulate(dir.path(), &small(), &NoProgress).unwrap_err();
    assert!(matches!(error, SimulateError::NotEmpty { .. }));
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
}

#[test]
fn a_delivered_image_states_its_rpc_and_its_sun() {
    let dir = tempfile::tempdir().unwrap();
    let summary = simulate(dir.path(), &small(), &NoProgress).unwrap();
    let file = ImageFile::open(&dir.path().join("VIEW_02.tif")).unwrap();
    assert_eq!((file.size(), file.bands()), ((72, 72), 3));
    assert!(!file.has_geotransform());
    let number = |key, domain| file.metadata(key, domain).unwrap().parse::<f64>().unwrap();
    let view = &summary.views[1];
    assert!((number("SUN_AZIMUTH", "") - view.sun_azimuth_deg).abs() < 1e-4);
    let text = std::fs::read_to_string(dir.path().join("truth/rpcs/VIEW_02.json")).unwrap();
    let truth: serde_json::Value = serde_json::from_str(&text).unwrap();
    let true_offset = truth["rpc"]["col_offset"].as_f64().unwrap();
    assert!((number("SAMP_OFF", "RPC") - true_offset - view.d_col).abs() < 1e-9);
    assert_eq!(truth["rpc"]["row_num"].as_array().unwrap().len(), 20);
}

#[test]
fn scenes_have_relief_buildings_trees_and_water() {
    for (seed, relief, relief_m) in
        [(0, Relief::Rolling, 8.0), (0, Relief::Hilly, 60.0), (1, Relief::Rolling, 8.0)]
    {
        let options = SimulateOptions { seed, relief, ..SimulateOptions::default() };
        let map = SiteGrid::at(PLACE).unwrap();
        let grid = SiteGrid { epsg: map.epsg, origin: map.origin.at_height(0.0) };
        // The nodes are coarser than in the scene, which does not change the statistics.
        let town = Town::new(seed, 150.0, 0.5, 100.0, relief);
        let views = plan_views(&options, &town, &grid).unwrap();
        let truth = truth::ExactDsm::sample(&town.field, &grid, &views, options.size_px, 1.0);
        let f = truth.figures(&town.plan, &grid);
        assert!(truth.grid.width >= 170, "{}", truth.grid.width);
        assert!(f.mean_absolute_deviation_m >= 5.0, "{f:?}");
        assert!((0.22..0.34).contains(&f.roofs_share), "{f:?}");
        assert!(f.trees_share > 0.03 && f.water_share > 0.005, "{f:?}");
        assert!(f.tallest_building_m > 25.0 && f.relief_m > relief_m, "{f:?}");
    }
}
