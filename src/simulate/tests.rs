//! Tests of whole scenes: reproducible bytes, statistics, delivered files.

use super::geodesy::PLACE;
use super::town::Town;
use super::*;
use crate::frame::Point;
use crate::io::ImageFile;
use crate::progress::NoProgress;
use std::collections::BTreeMap;
use std::path::PathBuf;

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
    // Images, RPCs; surface, ground, classes, list of test views.
    assert_eq!(first.len(), 4 + 4 + 4);
    assert!(first == again, "bytes differ");
    let other = run(2, &SimulateOptions { overwrite: true, seed: 1, views: 3, ..small() });
    assert_eq!(other.len(), 3 + 3 + 4, "files of the earlier simulation are gone");
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
        let options = SimulateOptions { seed, terrain: Terrain::Town(relief), ..SimulateOptions::default() };
        // The nodes are coarser than in the scene, which does not change the statistics.
        let town = Town::new(seed, 150.0, 0.5, 100.0, relief);
        let landscape = Landscape::at(PLACE, town.field, Some(town.plan)).unwrap();
        let views = plan_views(&options, &landscape).unwrap();
        let truth = truth::ExactDsm::sample(&landscape, &views, options.size_px, 1.0);
        let f = truth.figures(&landscape);
        assert!(truth.grid.width >= 170, "{}", truth.grid.width);
        assert!(f.mean_absolute_deviation_m >= 5.0, "{f:?}");
        assert!((0.22..0.34).contains(&f.roofs_share), "{f:?}");
        assert!(f.trees_share > 0.03 && f.water_share > 0.005, "{f:?}");
        assert!(f.tallest_building_m > 25.0 && f.relief_m > relief_m, "{f:?}");
    }
}

/// A small scene with everything that can be asked for.
fn varied() -> SimulateOptions {
    SimulateOptions { views: 5, seasons: true, cars_percent: Some(2.0), held_out: 2, ..small() }
}

/// A picture in `truth/appearance/`, row by row.
fn gray(path: &Path) -> Vec<u8> {
    image::open(path).unwrap().to_luma8().into_raw()
}

/// Grey levels of a band of an image.
fn levels(path: &Path, band: usize) -> Vec<f32> {
    ImageFile::open(path).unwrap().read(band).unwrap().data
}

/// The scene in the repository was made by the first version of the simulator.
#[test]
fn a_plain_scene_is_that_of_the_first_version() {
    /// Grey levels that another mathematics library may round differently, of 76,800 in an image.
    const ROUNDED: usize = 8;
    let dir = tempfile::tempdir().unwrap();
    let options = SimulateOptions { seed: 1, views: 3, size_px: 160, ..SimulateOptions::default() };
    simulate(dir.path(), &options, &NoProgress).unwrap();
    let kept = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/town");
    for name in ["VIEW_01.tif", "VIEW_02.tif", "VIEW_03.tif"] {
        let both =
            |band| levels(&dir.path().join(name), band).into_iter().zip(levels(&kept.join(name), band));
        let differences: Vec<f32> =
            (1..=3).flat_map(both).map(|(a, b)| (a - b).abs()).filter(|d| *d > 0.0).collect();
        assert!(
            differences.len() <= ROUNDED && differences.iter().all(|d| *d <= 1.0),
            "{name} {differences:?}"
        );
    }
    let shifts = |folder: &Path| std::fs::read_to_string(folder.join("truth/shifts.json")).unwrap();
    assert_eq!(shifts(dir.path()), shifts(&kept));
    assert!(!dir.path().join("truth/appearance").exists() && !dir.path().join("test.txt").exists());
}

#[test]
fn appearance_truth_is_the_same_for_any_number_of_threads_and_goes_with_the_options() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("scene");
    let run = |threads: usize, options: &SimulateOptions| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| simulate(&out, options, &NoProgress).unwrap());
        files(&out)
    };
    let first = run(1, &varied());
    assert_eq!(first.len(), 7 + 7 + 4 + 1 + 3 * 7 + 1, "{:?}", first.keys());
    assert!(first == run(3, &SimulateOptions { overwrite: true, ..varied() }), "bytes differ");
    let plain = run(2, &SimulateOptions { overwrite: true, ..small() });
    assert_eq!(plain.len(), 4 + 4 + 4, "{:?}", plain.keys());
    assert!(!out.join("truth/appearance").exists());
}

#[test]
fn images_differ_from_the_clean_pictures_only_by_noise_and_by_cars_in_the_mask() {
    let dir = tempfile::tempdir().unwrap();
    let summary =
        simulate(dir.path(), &SimulateOptions { size_px: 160, gsd_m: 0.5, ..varied() }, &NoProgress).unwrap();
    for view in &summary.views {
        let appearance = view.appearance.as_ref().unwrap();
        let shown = levels(&dir.path().join(format!("{}.tif", view.name)), 1);
        let clean = image::open(&appearance.clean).unwrap().to_rgb8();
        let cars = gray(&appearance.cars);
        let differences: Vec<f32> =
            shown.iter().zip(clean.pixels()).map(|(s, c)| (s - f32::from(c.0[0])).abs()).collect();
        if view.role == Role::Test {
            assert!(differences.iter().all(|d| *d == 0.0), "{} is not clean", view.name);
            assert_eq!(appearance.cars_percent, 0.0);
            continue;
        }
        assert!((appearance.cars_percent - 2.0).abs() < 0.3, "{} {}", view.name, appearance.cars_percent);
        let share = |in_mask: bool, from: f32| {
            let there = differences.iter().zip(&cars).filter(|(_, c)| (**c > 0) == in_mask);
            let (total, large) = there.fold((0, 0), |(n, k), (d, _)| (n + 1, k + i32::from(*d > from)));
            f64::from(large) / f64::from(total)
        };
        // Noise has at most 1.8 grey levels.
        assert_eq!(share(false, 10.0), 0.0, "{}", view.name);
        assert!(share(true, 10.0) > 0.5, "{} {}", view.name, share(true, 10.0));
    }
}

#[test]
fn streets_have_room_for_the_highest_percentage_of_cars() {
    let dir = tempfile::tempdir().unwrap();
    let options = SimulateOptions { cars_percent: Some(8.0), size_px: 120, views: 3, ..small() };
    for view in simulate(dir.path(), &options, &NoProgress).unwrap().views {
        let percent = view.appearance.unwrap().cars_percent;
        assert!((percent - 8.0).abs() < 0.3, "{} {percent}", view.name);
    }
}

#[test]
fn options_outside_of_their_ranges_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let wrong =
        |options: SimulateOptions| simulate(dir.path(), &options, &NoProgress).unwrap_err().to_string();
    let cars = |percent| SimulateOptions { cars_percent: Some(percent), ..small() };
    assert_eq!(wrong(cars(-1.0)), "`--cars` is -1, expected 0 to 8 percent of the pixels");
    assert!(wrong(cars(50.0)).contains("50") && wrong(cars(f64::NAN)).contains("NaN"));
    assert!(wrong(SimulateOptions { held_out: 100, ..small() }).contains("`--held-out` is 100"));
}

#[test]
fn a_mountain_is_imaged_from_planned_directions_in_sixteen_bits() {
    let dir = tempfile::tempdir().unwrap();
    let view = |azimuth_deg, time: &str| PlannedView {
        off_nadir_deg: 11.0,
        azimuth_deg,
        acquired: Some(time.into()),
    };
    let options = SimulateOptions {
        terrain: Terrain::Mountains,
        depth: BitDepth::Sixteen,
        planned: vec![view(11.0, "2024-08-20T10:30"), view(191.0, "2024-08-20T10:31:00Z")],
        ..small()
    };
    let summary = simulate(dir.path(), &options, &NoProgress).unwrap();
    assert_eq!(summary.views.len(), 2);
    assert_eq!(summary.views[0].acquired, "2024-08-20T10:30:00Z");
    // From the almanac: the sun culminates at 11:41 UTC there, 59 degrees high.
    assert!((summary.views[1].sun_elevation_deg - 55.8).abs() < 0.5, "{:?}", summary.views[1]);
    let image = levels(&dir.path().join("VIEW_01.tif"), 1);
    let (low, high) = image.iter().fold((f32::MAX, f32::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
    assert!(low >= 1.0 && high > 600.0 && high < 4095.0, "{low} {high}");
    assert!(summary.truth.ends_with("truth/MOUNTAINS_DSM.tif") && summary.truth.exists());
    let night = SimulateOptions {
        planned: vec![view(11.0, "2024-08-20T22:00"); 2],
        overwrite: true,
        ..options.clone()
    };
    assert!(simulate(dir.path(), &night, &NoProgress).unwrap_err().to_string().contains("degrees high"));
    let never = SimulateOptions { planned: vec![view(11.0, "noon"); 2], overwrite: true, ..options };
    assert_eq!(
        simulate(dir.path(), &never, &NoProgress).unwrap_err().to_string(),
        "`noon` is no time of an image"
    );
}

/// A surface of 140 x 120 m in Lambert-93 with a block of 20 x 20 m, 12 m high, and a hole; and a picture of its western part.
fn surface(folder: &Path, epsg: u32) -> SurfaceFiles {
    use crate::io::{Cog, Grid2, MapGrid};
    let grid = MapGrid { epsg, west: 700_000.0, north: 6_600_000.0, cell: 1.0, width: 140, height: 120 };
    let height = |col: usize, row: usize| match (col, row) {
        (60..80, 40..60) => 212.0,
        (95..105, 55..65) => f32::NAN,
        _ => 200.0,
    };
    let cog = Cog { grid, metadata: &[], heights_from: None };
    let (dsm, ortho) = (folder.join("dsm.tif"), folder.join("ortho.tif"));
    cog.write_f32(&dsm, &[("height", "m", &Grid2::from_fn(140, 120, height))]).unwrap();
    let west = Cog { grid: MapGrid { width: 70, ..grid }, ..cog };
    let band = |by: usize| (0..70 * 120).map(|k| (40 + by + (k * 37) % 90) as u8).collect();
    west.write_u8(&ortho, vec![band(0), band(30), band(10)], None).unwrap();
    SurfaceFiles { surface: dsm, texture: Some(ortho), vertical: None }
}

#[test]
fn a_users_surface_is_imaged_where_it_has_heights() {
    let dir = tempfile::tempdir().unwrap();
    let files = surface(dir.path(), 2154);
    let terrain = Terrain::Surface(files.clone());
    let options =
        SimulateOptions { terrain, size_px: 120, gsd_m: 1.0, views: 3, ..SimulateOptions::default() };
    let out = dir.path().join("scene");
    let summary = simulate(&out, &options, &NoProgress).unwrap();
    let figures = summary.surface.clone().unwrap();
    assert!(figures.vertical_is_assumed && figures.vertical.contains("ellipsoid"), "{figures:?}");
    assert!((0.004..0.02).contains(&figures.holes_share), "{figures:?}");
    assert!((0.4..0.6).contains(&figures.untextured_share), "{figures:?}");
    // The exact surface is the given one, in its CRS; the hole stays one.
    let truth = ImageFile::open(&summary.truth).unwrap();
    let (grid, heights) = (truth.map_grid().unwrap(), truth.read(1).unwrap());
    assert_eq!(grid.epsg, 2154);
    let at = |col: f64, row: f64| {
        let px = grid.corner_px_from_utm(Point::new(700_000.0 + col, 6_600_000.0 - row, 0.0));
        heights.at(px.col as usize, px.row as usize)
    };
    assert_eq!((at(70.5, 50.5), at(50.5, 80.5)), (212.0, 200.0));
    assert!(at(100.5, 60.5).is_nan());
    assert!(!out.join("truth/SURFACE_CLS.tif").exists(), "what lies where is not known");
    // The images have no data in the hole, and data beside it.
    let image = ImageFile::open(&out.join("VIEW_01.tif")).unwrap();
    assert_eq!(image.band(1).unwrap().nodata, Some(0.0));
    let holes = image.read(1).unwrap().data.iter().filter(|v| v.is_nan()).count();
    assert!((60..400).contains(&holes), "{holes}");

    // Heights above a geoid are converted with its height at the middle.
    let above = SurfaceFiles { vertical: Some("EGM96".into()), ..files };
    let raised = SimulateOptions { terrain: Terrain::Surface(above), overwrite: true, ..options };
    match simulate(&out, &raised, &NoProgress) {
        Ok(summary) => {
            let up = f64::from(
                ImageFile::open(&summary.truth).unwrap().read(1).unwrap().valid().fold(f32::MAX, f32::min),
            );
            assert!(
                (240.0..255.0).contains(&up),
                "the geoid lies 45 to 50 m above the ellipsoid there: {up}"
            );
        }
        Err(error) => assert!(error.to_string().contains("EGM96"), "{error}"),
    }
}

#[test]
fn surfaces_that_cannot_be_used_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let files = surface(dir.path(), 2154);
    let out = dir.path().join("scene");
    let wrong = |files: SurfaceFiles| {
        let options = SimulateOptions { terrain: Terrain::Surface(files), overwrite: true, ..small() };
        simulate(&out, &options, &NoProgress).unwrap_err().to_string()
    };
    let elsewhere = tempfile::tempdir().unwrap();
    let other_crs = SurfaceFiles { texture: surface(elsewhere.path(), 32631).texture, ..files.clone() };
    let text = wrong(other_crs);
    assert!(text.contains("EPSG:32631") && text.contains("gdalwarp -t_srs EPSG:2154"), "{text}");
    assert!(wrong(surface(elsewhere.path(), 2225)).contains("not in metres"));
    let mercator = SurfaceFiles { texture: None, ..surface(elsewhere.path(), 3857) };
    assert!(wrong(mercator).contains("stretches the ground by 1.5"));
    let degrees = surface(elsewhere.path(), 4326);
    assert!(wrong(degrees).contains("degrees"));
    let empty = SurfaceFiles { texture: None, vertical: Some("nonsense".into()), ..files.clone() };
    assert!(wrong(empty).contains("`nonsense` is not a known vertical reference"));
    let missing = SurfaceFiles { surface: dir.path().join("none.tif"), texture: None, vertical: None };
    assert!(wrong(missing).contains("none.tif"));
    let cars =
        SimulateOptions { terrain: Terrain::Mountains, cars_percent: Some(1.0), overwrite: true, ..small() };
    assert!(simulate(&out, &cars, &NoProgress).unwrap_err().to_string().contains("--cars"));
}
