//! Scenes of real data as the reader sees them.
use crate::common;
use satgs::frame::SiteGrid;
use satgs::scene::{ReadOptions, default_aoi, read};

/// The lidar truth of JAX_068: 256 m from its lower-left corner (JAX_068_DSM.txt).
#[test]
fn jax_068_has_17_training_views_and_its_three_view_ground_holds_the_truth() {
    let Some(data) = common::data_dir() else { return };
    let options = ReadOptions { rpcs: Some("rpcs_raw".into()), ..Default::default() };
    let scene = read(&data.join("jax068"), &options).unwrap();
    assert_eq!((scene.views.len(), scene.training().count()), (19, 17));
    assert_eq!(scene.warnings, Vec::<String>::new());
    assert_eq!(scene.height_range(), (-27.0, 30.0));
    let text = std::fs::read_to_string(data.join("jax068/truth/JAX_068_DSM.txt")).unwrap();
    let numbers: Vec<f64> = text.split_whitespace().map(|w| w.parse().unwrap()).collect();
    let (west, south, side) = (numbers[0], numbers[1], numbers[2] * numbers[3]);
    let grid = SiteGrid::at(scene.center().unwrap()).unwrap();
    let views: Vec<_> = scene.views.iter().map(|v| (&v.rpc, v.width, v.height)).collect();
    let (w, s, e, n) = default_aoi(&views, &grid, -20.0).unwrap();
    assert!(w <= west && s <= south && e >= west + side && n >= south + side, "{w} {s} {e} {n}");
}

#[test]
fn jax_068_requires_a_choice_of_cameras() {
    let Some(data) = common::data_dir() else { return };
    let error = read(&data.join("jax068"), &ReadOptions::default()).unwrap_err().to_string();
    assert!(error.ends_with("several folders of RPC files: rpcs_ba_v2, rpcs_raw"), "{error}");
}

#[test]
fn pleiades_triplet_is_read_from_its_tags() {
    let Some(data) = common::data_dir() else { return };
    let scene = read(&data.join("s2p/input_triplet"), &ReadOptions::default()).unwrap();
    assert!(scene.views.iter().all(|v| v.rpc_source == "RPC tag" && v.sun.is_none()));
    assert_eq!((scene.views.len(), scene.warnings.len()), (3, 1));
}
