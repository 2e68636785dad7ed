//! Scenes that are listed, cropped and shown: TOML, STAC, areas, footprints, pictures.
use crate::common::{camera, image, resampled, satgs, two_views};
use satgs::scene::{Aoi, ReadOptions, Role, Scene, read};
use std::path::Path;

fn scene(path: &Path) -> Result<Scene, String> {
    read(path, &ReadOptions::default()).map_err(|e| e.to_string())
}

#[test]
fn a_toml_list_names_images_cameras_suns_and_masks() {
    let folder = two_views();
    let at = |name: &str| folder.path().join(name);
    let text = satgs::rpc::formats::to_text(&camera(5.44, 0.4));
    std::fs::write(at("other.txt"), text).unwrap();
    image(&at("mask.tif"), 9, None, &[]);
    let list = at("scene.toml");
    let toml = "aoi = [5.4398, 43.2599, 5.4401, 43.2601]\n\n[[view]]\nimage = \"a.tif\"\nrpc = \"other.txt\"\n\
                name = \"first\"\nsun = [150.3, 50.8]\nacquired = \"2014-10-05T16:01:38Z\"\nmask = \"mask.tif\"\n\n\
                [[view]]\nimage = \"b.tif\"\ntest = true\n";
    std::fs::write(&list, toml).unwrap();
    let read = scene(&list).unwrap();
    let [b, first] = &read.views[..] else { panic!("two views") };
    assert_eq!(
        (first.name.as_str(), first.rpc_source.as_str(), first.role),
        ("first", "other.txt", Role::Train)
    );
    assert_eq!((first.sun.unwrap().elevation_deg, b.role), (50.8, Role::Test));
    assert!(read.aoi.is_some() && b.window.is_some());
    let masked = &first.read_colors().unwrap()[0];
    assert!(masked.data.iter().any(|v| v.is_nan()) && masked.data.iter().any(|v| v.is_finite()));

    std::fs::write(&list, toml.replace("sun =", "sum =")).unwrap();
    let error = scene(&list).unwrap_err();
    assert!(error.contains("unknown field `sum`") && error.contains("scene.toml"), "{error}");
    std::fs::write(&list, toml.replace("b.tif", "c.tif")).unwrap();
    assert!(scene(&list).unwrap_err().contains("c.tif` cannot be opened as a raster"));
    let driver = gdal::DriverManager::get_driver_by_name("GTiff").unwrap();
    driver.create_with_band_type::<u8, _>(at("small.tif"), 10, 12, 1).unwrap().close().unwrap();
    std::fs::write(&list, toml.replace("mask.tif", "small.tif")).unwrap();
    let error = scene(&list).unwrap_err();
    assert!(error.contains("small.tif` is 10 x 12 pixels") && error.contains("a.tif` is 64 x 64"), "{error}");
}

#[test]
fn a_stac_item_collection_is_a_scene() {
    let folder = two_views();
    let list = folder.path().join("items.json");
    let item = |name: &str, href: &str| {
        format!(
            r#"{{"type": "Feature", "id": "{name}", "properties": {{"datetime": "2020-06-21T11:00:00Z",
            "view:sun_azimuth": 170.5, "view:sun_elevation": 69.0}},
            "assets": {{"analytic": {{"href": "{href}", "roles": ["data"]}}}}}}"#
        )
    };
    let collection = format!(
        r#"{{"type": "FeatureCollection", "features": [{}, {}]}}"#,
        item("one", "a.tif"),
        item("two", "./b.tif")
    );
    std::fs::write(&list, &collection).unwrap();
    let read = scene(&list).unwrap();
    assert_eq!(read.views.iter().map(|v| v.name.as_str()).collect::<Vec<_>>(), ["one", "two"]);
    assert_eq!(read.views[0].acquired.as_deref(), Some("2020-06-21T11:00:00Z"));
    assert_eq!(read.views[1].sun.unwrap().azimuth_deg, 170.5);
    std::fs::write(&list, item("one", "a.tif")).unwrap();
    assert_eq!(scene(&list).unwrap().views.len(), 1);
    std::fs::write(&list, item("one", "odd://example.org/a.tif")).unwrap();
    assert!(scene(&list).unwrap_err().contains("URLs of `odd` cannot be read"));
    std::fs::write(&list, "{\"type\": \"Catalog\"}").unwrap();
    assert!(scene(&list).unwrap_err().contains("neither a STAC Item nor an ItemCollection"));
}

#[test]
fn an_area_crops_images_and_shifts_their_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let rpc = resampled(&camera(5.44, 0.0), 5.0);
    // A large image whose pixel values encode their position.
    let path = folder.path().join("a.tif");
    let driver = gdal::DriverManager::get_driver_by_name("GTiff").unwrap();
    let dataset = driver.create_with_band_type::<u16, _>(&path, 400, 400, 1).unwrap();
    let data = (0..400 * 400).map(|i| (i % 400 + i / 400) as u16).collect();
    dataset
        .rasterband(1)
        .unwrap()
        .write((0, 0), (400, 400), &mut gdal::raster::Buffer::new((400, 400), data))
        .unwrap();
    dataset.close().unwrap();
    std::fs::write(folder.path().join("a.rpb"), satgs::rpc::formats::to_rpb(&rpc)).unwrap();
    let place = |col, row| rpc.localize(satgs::frame::Pixel::new(col, row), 100.0).unwrap();
    let (nw, se) = (place(200.0, 150.0), place(220.0, 180.0));
    let aoi = Aoi::from_box([nw.lon_deg(), se.lat_deg(), se.lon_deg(), nw.lat_deg()]).unwrap();
    let scene = read(path.parent().unwrap(), &ReadOptions { aoi: Some(aoi), ..Default::default() }).unwrap();
    let view = &scene.views[0];
    let window = view.window.unwrap();
    assert_eq!((window.col, window.row), (200 - 48, 150 - 48));
    assert!((window.width as i64 - 116).abs() <= 2 && (window.height as i64 - 126).abs() <= 2, "{window:?}");
    assert_eq!((view.width, view.height), (window.width, window.height));
    let moved = view.rpc.project(place(210.0, 160.0));
    assert!((moved.col - (210.0 - 152.0)).abs() < 1e-6 && (moved.row - (160.0 - 102.0)).abs() < 1e-6);
    let raster = &view.read_colors().unwrap()[0];
    assert_eq!((raster.width, raster.height), (window.width, window.height));
}

#[test]
fn footprints_and_a_picture_are_written() {
    let folder = two_views();
    let out = tempfile::tempdir().unwrap();
    let at = |name: &str| out.path().join(name).to_str().unwrap().to_owned();
    let place = folder.path().to_str().unwrap();
    for file in ["f.geojson", "f.gpkg"] {
        let run =
            satgs(&["info", place, "--footprints", &at(file), "--skyplot", &at(&format!("{file}.svg"))]);
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
        let dataset = gdal::Dataset::open_ex(
            at(file),
            gdal::DatasetOptions { open_flags: gdal::GdalOpenFlags::GDAL_OF_VECTOR, ..Default::default() },
        )
        .unwrap();
        use gdal::vector::LayerAccess;
        let mut layer = dataset.layer(0).unwrap();
        let areas: Vec<f64> = layer.features().map(|f| f.geometry().unwrap().area()).collect();
        // The sides have 64 pixels of 0.5 m.
        assert_eq!(areas.len(), 2);
        assert!(
            areas.iter().all(|a| (a * 111_200f64.powi(2) * 0.728 / 1024.0 - 1.0).abs() < 0.1),
            "{areas:?}"
        );
    }
    let again = satgs(&["info", place, "--footprints", &at("f.gpkg")]);
    assert_eq!(again.status.code(), Some(2));
    let drawing = std::fs::read_to_string(out.path().join("f.gpkg.svg")).unwrap();
    assert!(drawing.starts_with("<svg") && drawing.matches("<polygon").count() >= 2, "{drawing}");
}

#[test]
fn a_list_beside_the_images_of_a_folder_holds_views_back() {
    let folder = two_views();
    let roles = |path: &Path| scene(path).unwrap().views.iter().map(|v| v.role).collect::<Vec<_>>();
    assert_eq!(roles(folder.path()), [Role::Train, Role::Train]);
    std::fs::write(folder.path().join("test.txt"), "b.tif\nc.tif\n").unwrap();
    assert_eq!(roles(folder.path()), [Role::Train, Role::Test]);
    let warnings = scene(folder.path()).unwrap().warnings.join("\n");
    assert!(warnings.contains("lists views that do not exist: c"), "{warnings}");
}

#[test]
fn the_rpc_of_an_image_named_test_is_no_list() {
    let folder = tempfile::tempdir().unwrap();
    let rpc = camera(5.44, 0.4);
    image(&folder.path().join("test.tif"), 9, None, &[]);
    image(&folder.path().join("other.tif"), 8, Some(&rpc), &[]);
    std::fs::write(folder.path().join("test.txt"), satgs::rpc::formats::to_text(&rpc)).unwrap();
    let read = scene(folder.path()).unwrap();
    assert_eq!(read.views.len(), 2);
    assert!(!read.warnings.iter().any(|w| w.contains("do not exist")), "{:?}", read.warnings);
}

/// Only a part of each image is read, but its corrected camera is that of the whole image.
#[test]
fn corrected_cameras_are_those_of_whole_images_for_any_area() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let run = |args: &[&str]| {
        let out = satgs(args);
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    };
    run(&["simulate", &at("scene"), "--size", "300", "--views", "5", "-q"]);
    let center = scene(&folder.path().join("scene")).unwrap().center().unwrap();
    let (lon, lat) = (center.lon_deg(), center.lat_deg());
    // The area has 80 m x 90 m, the images cover about 150 m.
    let area = format!("{},{},{},{}", lon - 5e-4, lat - 4e-4, lon + 5e-4, lat + 4e-4);
    run(&["ba", &at("scene"), "-o", &at("whole"), "-q"]);
    run(&["ba", &at("scene"), "-o", &at("part"), "--aoi", &area, "-q"]);
    let file = |run: &str, view: usize| folder.path().join(run).join(format!("ba/rpcs/VIEW_{view:02}.json"));
    let camera = |path: &Path| satgs::rpc::formats::read(path).unwrap();
    for view in 1..=5 {
        let (whole, part) = (camera(&file("whole", view)), camera(&file("part", view)));
        let apart = whole.rpc.difference(&part.rpc).unwrap();
        assert!(apart.max_px < 1.0, "view {view}: {apart:?}");
        assert_eq!((whole.tags.size, part.tags.size), (Some((300, 300)), None));
    }
}
