//! Invalid input gives one line that names file and field, a hint and exit code 2, and leaves no files.
use crate::common::{camera, dem_grid, image, resampled, satgs, two_views};
use satgs::io::Window;
use satgs::rpc::formats::{ViewTags, to_json, to_rpb, to_text};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn listing(folder: &Path) -> BTreeSet<PathBuf> {
    std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect()
}

/// Runs `satgs info` on a scene; returns exit code and standard error. The folder must be unchanged afterwards.
fn info(scene: &Path, more: &[&str]) -> (Option<i32>, String) {
    let before = scene.is_dir().then(|| listing(scene));
    let mut args = vec!["info", scene.to_str().unwrap()];
    args.extend(more);
    let out = satgs(&args);
    assert_eq!(before, scene.is_dir().then(|| listing(scene)), "nothing may be left behind");
    (out.status.code(), String::from_utf8(out.stderr).unwrap())
}

/// Asserts that the scene is refused with exit code 2 and these words in the error and the hint.
#[track_caller]
fn refused(scene: &Path, more: &[&str], error: &str, hint: &str) {
    let (code, said) = info(scene, more);
    assert_eq!(code, Some(2), "{said}");
    let lines: Vec<&str> = said.lines().filter(|l| !l.starts_with("warning: ")).collect();
    assert_eq!(lines.len(), 2, "one line and a hint: {said}");
    assert!(lines[0].starts_with("error: ") && lines[0].contains(error), "{said}");
    assert!(lines[1].starts_with("hint: ") && lines[1].contains(hint), "{said}");
}

#[test]
fn n01_an_image_without_rpc_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    image(&folder.path().join("ortho.tif"), 1, None, &[]);
    refused(folder.path(), &[], "ortho.tif` has no RPC, neither inside nor beside it", "`satgs info SCENE`");
    let empty = tempfile::tempdir().unwrap();
    refused(empty.path(), &[], "no images found in", "images end in .tif");
}

#[test]
fn n02_a_missing_field_is_named() {
    let folder = two_views();
    let text = to_text(&camera(5.44, 0.2));
    let without: Vec<&str> = text.lines().filter(|l| !l.starts_with("LINE_OFF")).collect();
    std::fs::write(folder.path().join("a_RPC.TXT"), without.join("\n")).unwrap();
    let error = "a_RPC.TXT`: RPC field `LINE_OFF` is missing (found 89 of 90 fields)";
    refused(folder.path(), &[], error, "ask for the original metadata");
}

#[test]
fn n03_n04_n06_known_spellings_are_read_and_others_refused() {
    let folder = two_views();
    let text = to_text(&camera(5.44, 0.2));
    let put = |changed: String| std::fs::write(folder.path().join("a_RPC.TXT"), changed).unwrap();
    for good in [
        text.clone(),
        text.replace("LINE_OFF: ", "LINE_OFF: +0000").replace('\n', "\r\n"),
        format!("\u{feff}{}", text.to_lowercase()),
        text.replace("SAMP_SCALE: 40 pixels", "SAMP_SCALE: 4.0D+01"),
    ] {
        put(good);
        let (code, said) = info(folder.path(), &[]);
        assert!(code == Some(0) && !said.contains("differ by"), "{said}");
    }
    for (from, to, error) in [
        ("LINE_NUM_COEFF_20: 0\n", "", "`LINE_NUM_COEFF_20` is missing (found 89 of 90"),
        ("LINE_NUM_COEFF_20:", "LINE_NUM_COEFF_21:", "`LINE_NUM_COEFF` has 21 coefficients"),
        ("SAMP_SCALE: 40", "SAMP_SCALE: 40,5", "`SAMP_SCALE` is `40,5 pixels`"),
    ] {
        assert!(text.contains(from), "{from}");
        put(text.replacen(from, to, 1));
        refused(folder.path(), &[], error, "");
    }
}

#[test]
fn n05_a_sidecar_that_differs_from_the_tag_is_used_with_a_warning() {
    let folder = two_views();
    let moved = camera(5.44, 0.2).shifted(3.0, 4.0);
    std::fs::write(folder.path().join("a_RPC.TXT"), to_text(&moved)).unwrap();
    let (code, said) = info(folder.path(), &[]);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("its RPC tag and a_RPC.TXT differ by 5.0 px; a_RPC.TXT is used"), "{said}");
}

#[test]
fn n07_nan_and_zero_are_refused() {
    let folder = two_views();
    let text = to_text(&camera(5.44, 0.2));
    for (from, to, error, hint) in [
        ("LAT_OFF: 43.26", "LAT_OFF: NaN", "`LAT_OFF` is not a finite number", "damaged"),
        ("SAMP_SCALE: 40", "SAMP_SCALE: 0", "`SAMP_SCALE` is zero", "damaged"),
        ("LAT_OFF: 43.26", "LAT_OFF: 143.26", "`LAT_OFF` is 143.26, outside ±90", "swapped"),
        ("SAMP_DEN_COEFF_2: 0", "SAMP_DEN_COEFF_2: 2", "RPC's column changes sign", "RPC00B"),
        ("LAT_OFF: 43.26", "LAT_OFF: 43,26", "`LAT_OFF` is `43,26 degrees`", "decimal point"),
    ] {
        let changed = text.replace(from, to);
        assert_ne!(changed, text);
        std::fs::write(folder.path().join("a_RPC.TXT"), changed).unwrap();
        refused(folder.path(), &[], error, hint);
    }
}

#[test]
fn n08_swapped_latitude_and_longitude_are_recognised() {
    let folder = two_views();
    let swapped =
        to_text(&camera(105.44, 0.2)).replace("LAT_", "XX_").replace("LONG_", "LAT_").replace("XX_", "LONG_");
    std::fs::write(folder.path().join("a_RPC.TXT"), swapped).unwrap();
    refused(folder.path(), &[], "`LAT_OFF` is 105.44, outside ±90", "are latitude and longitude swapped?");
}

#[test]
fn n10_rpc00a_is_refused() {
    let folder = two_views();
    let rpb = to_rpb(&camera(5.44, 0.2)).replace("RPC00B", "RPC00A");
    std::fs::write(folder.path().join("a.RPB"), rpb).unwrap();
    refused(
        folder.path(),
        &[],
        "a.RPB` holds an RPC00A, satgs reads RPC00B",
        "orders the polynomial terms differently",
    );
}

#[test]
fn n11_an_area_that_no_view_sees_is_refused() {
    let folder = two_views();
    let error =
        "no view sees the area (lon 5.5000 to 5.5100, lat 43.2600 to 43.2700); the first sees lon 5.43";
    refused(
        folder.path(),
        &["--aoi", "5.5,43.26,5.51,43.27"],
        error,
        "a cropped image needs an RPC that was shifted",
    );
}

#[test]
fn n12_an_image_resampled_without_its_rpc_gives_a_warning() {
    let folder = two_views();
    std::fs::write(folder.path().join("a_RPC.TXT"), to_text(&resampled(&camera(5.44, 0.2), 2.0))).unwrap();
    let (code, said) = info(folder.path(), &[]);
    assert_eq!(code, Some(0), "{said}");
    assert!(
        said.contains("a: its RPC is for an image of about 160 x 160 pixels, this one has 64 x 64"),
        "{said}"
    );
    std::fs::write(folder.path().join("b.IMD"), "BEGIN_GROUP = IMAGE_1\n\tmeanProductGSD = 0.25;\nEND;")
        .unwrap();
    let (_, said) = info(folder.path(), &[]);
    assert!(said.contains("b: its metadata state a GSD of 0.25 m, that of its camera is 0.5"), "{said}");
    std::fs::write(folder.path().join("b.IMD"), "BEGIN_GROUP = IMAGE_1\n\tmeanSatEl = 60.0;\nEND;").unwrap();
    let (_, said) = info(folder.path(), &[]);
    assert!(
        said.contains("b: its metadata state an off-nadir angle of 30.0°, that of its camera is 5.8°"),
        "{said}"
    );
}

#[test]
fn n14_a_tile_without_its_product_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    image(&at("IMG_PHR1A_X_R2C1.TIF"), 1, None, &[]);
    let whole = camera(5.44, 0.2);
    std::fs::write(at("RPC_PHR1A_X.XML"), dimap(&whole)).unwrap();
    let error =
        "IMG_PHR1A_X_R2C1.TIF` is tile R2C1 of a mosaic, and no file beside it states the size of the tiles";
    refused(folder.path(), &[], error, "DIM_*.XML");
    let product = "<Dimap_Document><Raster_Dimensions><NROWS>128</NROWS><NCOLS>64</NCOLS><Regular_Tiling>\
                   <NTILES_SIZE nrows=\"64\" ncols=\"64\"/><NTILES_COUNT ntiles_R=\"2\" ntiles_C=\"1\"/>\
                   </Regular_Tiling></Raster_Dimensions></Dimap_Document>";
    std::fs::write(at("DIM_PHR1A_X.XML"), product).unwrap();
    let scene = satgs::scene::read(folder.path(), &satgs::scene::ReadOptions::default()).unwrap();
    assert_eq!(scene.views[0].rpc, whole.cropped(0, 64));
    assert!(scene.warnings.iter().any(|w| w.contains("is one of 2 tiles")), "{:?}", scene.warnings);
    std::fs::rename(at("IMG_PHR1A_X_R2C1.TIF"), at("IMG_PHR1A_X_R9999999C9999999.TIF")).unwrap();
    refused(folder.path(), &[], "of a mosaic, and its product has 2 x 1 tiles", "DIM_*.XML");
}

/// The camera as a Pléiades RPC file, whose pixels count from 1.
fn dimap(rpc: &satgs::rpc::Rpc) -> String {
    let fields = satgs::rpc::formats::to_gdal(&rpc.shifted(1.0, 1.0));
    let (mut validity, mut model) = (String::new(), String::new());
    for (name, value) in fields.iter().filter(|(name, _)| !name.starts_with("ERR")) {
        if name.ends_with("COEFF") {
            for (i, term) in value.split(' ').enumerate() {
                model += &format!("<{name}_{0}>{term}</{name}_{0}>", i + 1);
            }
        } else {
            validity += &format!("<{name}>{value}</{name}>");
        }
    }
    format!(
        "<Dimap_Document><METADATA_PROFILE>PHR_SENSOR</METADATA_PROFILE><Global_RFM><Inverse_Model>{model}\
         </Inverse_Model><RFM_Validity>{validity}</RFM_Validity></Global_RFM></Dimap_Document>"
    )
}

#[test]
fn orthorectified_images_are_recognised() {
    let folder = two_views();
    let grid = |west: f64| satgs::io::MapGrid {
        epsg: 32631,
        west,
        north: 4_792_000.0,
        cell: 0.5,
        width: 64,
        height: 64,
    };
    let ortho = satgs::io::Cog { grid: grid(700_000.0), metadata: &[], heights_from: None };
    let path = folder.path().join("ortho.tif");
    ortho.write_u8(&path, vec![(0..64 * 64).map(|i| (i % 251) as u8).collect()], None).unwrap();
    let (code, said) = info(folder.path(), &[]);
    assert!(
        code == Some(0) && said.contains("ortho.tif` is left out, because it is a map without an RPC"),
        "{said}"
    );
    std::fs::write(folder.path().join("ortho_RPC.TXT"), to_text(&camera(5.44, 0.2))).unwrap();
    let error = "ortho.tif` is orthorectified: it has a map projection, from which its RPC differs by";
    refused(folder.path(), &[], error, "use the sensor");
}

#[test]
fn n15_damaged_images_are_refused() {
    let folder = two_views();
    let bad = folder.path().join("c.tif");
    let whole = std::fs::read(folder.path().join("a.tif")).unwrap();
    std::fs::write(&bad, &whole[..whole.len() / 2]).unwrap();
    refused(folder.path(), &[], "c.tif", "");
    std::fs::write(&bad, b"not a TIFF at all").unwrap();
    refused(folder.path(), &[], "c.tif` cannot be opened as a raster", "gdalinfo");
    std::fs::write(&bad, b"").unwrap();
    refused(folder.path(), &[], "c.tif` cannot be opened as a raster", "gdalinfo");
    std::fs::write(&bad, tiff_header(1, 1)).unwrap();
    refused(folder.path(), &[], "c.tif` is 1 x 1 pixels", "complete");
    std::fs::write(&bad, tiff_header(65_536, 65_536)).unwrap();
    refused(folder.path(), &[], "c.tif` is 65536 x 65536 pixels in 1024 bytes", "complete");
}

/// A TIFF of 1 kB that claims to be one uncompressed 8-bit strip of any size.
fn tiff_header(width: u32, height: u32) -> Vec<u8> {
    let entries: [(u16, u32); 8] = [
        (256, width),
        (257, height),
        (258, 8),
        (259, 1),
        (262, 1),
        (273, 256),
        (278, height),
        (279, width.saturating_mul(height).max(1)),
    ];
    let mut bytes = b"II*\0\x08\0\0\0".to_vec();
    bytes.extend((entries.len() as u16).to_le_bytes());
    for (tag, value) in entries {
        bytes.extend(tag.to_le_bytes());
        bytes.extend(4u16.to_le_bytes());
        bytes.extend(1u32.to_le_bytes());
        bytes.extend(value.to_le_bytes());
    }
    bytes.resize(1024, 0);
    bytes
}

/// Writes a raster of any type with an RPC beside it.
fn raster<T: gdal::raster::GdalType + Copy>(
    path: &Path,
    bands: usize,
    rpc: &satgs::rpc::Rpc,
    value: impl Fn(usize) -> T,
) {
    let driver = gdal::DriverManager::get_driver_by_name("GTiff").unwrap();
    let dataset = driver.create_with_band_type::<T, _>(path, 64, 64, bands).unwrap();
    for band in 1..=bands {
        let data = (0..64 * 64).map(|i| value(i * band)).collect();
        let mut buffer = gdal::raster::Buffer::new((64, 64), data);
        dataset.rasterband(band).unwrap().write((0, 0), (64, 64), &mut buffer).unwrap();
    }
    dataset.close().unwrap();
    std::fs::write(path.with_extension("rpb"), to_rpb(rpc)).unwrap();
}

#[test]
fn images_that_are_bright_in_their_shadows_too_are_taken_for_those_with_a_display_gamma() {
    let gamma = |first: u8, more: &[&str]| {
        let folder = tempfile::tempdir().unwrap();
        raster(&folder.path().join("a.tif"), 3, &camera(5.44, 0.1), |i| first + (i % 50) as u8);
        raster(&folder.path().join("b.tif"), 3, &camera(5.44, 0.3), |i| first + (i % 47) as u8);
        let out = satgs(&[&["info", folder.path().to_str().unwrap(), "--json"], more].concat());
        assert!(out.status.success());
        serde_json::from_slice::<serde_json::Value>(&out.stdout).unwrap()["gamma"].as_f64().unwrap()
    };
    assert_eq!(gamma(110, &[]), 2.2, "values from 110 to 160");
    assert_eq!(gamma(20, &[]), 1.0, "values from 20 to 70");
    assert_eq!((gamma(110, &["--gamma", "1"]), gamma(20, &["--gamma", "1.8"])), (1.0, 1.8));
}

#[test]
fn black_pixels_are_nodata_only_if_connected_with_the_border() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tif");
    // A margin of ten columns with a bulge, and a shadow of 3 x 3 pixels inside of the image.
    let is_black = |col: usize, row: usize| {
        col < 10 || (col < 20 && row == 40) || ((30..33).contains(&col) && (30..33).contains(&row))
    };
    raster(&path, 3, &camera(5.44, 0.1), |_| 0u8);
    let dataset = gdal::Dataset::open_ex(
        &path,
        gdal::DatasetOptions { open_flags: gdal::GdalOpenFlags::GDAL_OF_UPDATE, ..Default::default() },
    );
    let dataset = dataset.unwrap();
    // Beside other dark pixels, 0 is a value of the image.
    let pixels: Vec<u8> =
        (0..64 * 64).map(|i| if is_black(i % 64, i / 64) { 0 } else { 1 + (i % 150) as u8 }).collect();
    for band in 1..=3 {
        let mut band = dataset.rasterband(band).unwrap();
        band.set_no_data_value(Some(0.0)).unwrap();
        band.write((0, 0), (64, 64), &mut gdal::raster::Buffer::new((64, 64), pixels.clone())).unwrap();
    }
    dataset.close().unwrap();
    image(&folder.path().join("b.tif"), 2, Some(&camera(5.44, -0.1)), &[]);
    let scene = satgs::scene::read(folder.path(), &satgs::scene::ReadOptions::default()).unwrap();
    let view = scene.views.iter().find(|v| v.name == "a").unwrap();
    let whole = Window { col: 0, row: 0, width: 64, height: 64 };
    let raster = view.gray_image().unwrap().read(whole).unwrap();
    assert_eq!(raster.at(31, 31), 0.0);
    assert!(raster.at(5, 5).is_nan() && raster.at(19, 40).is_nan());
    assert_eq!(raster.data.iter().filter(|v| v.is_nan()).count(), 64 * 10 + 10);
    assert_eq!(view.read_colors().unwrap()[0].at(31, 31), 0.0);
}

#[test]
fn n17_pixels_of_every_type_become_colours() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let rpc = |lean| camera(5.44, lean);
    raster(&at("float.tif"), 1, &rpc(0.1), |i| if i == 7 { f32::NAN } else { (i % 1000) as f32 / 1000.0 });
    raster(&at("bits11.tif"), 1, &rpc(0.2), |i| (i % 2047) as u16);
    raster(&at("signed.tif"), 1, &rpc(0.3), |i| (i % 500) as i16 - 250);
    let scene = satgs::scene::read(folder.path(), &satgs::scene::ReadOptions::default()).unwrap();
    for view in &scene.views {
        let raster = &view.read_colors().unwrap()[0];
        let valid: Vec<f32> = raster.data.iter().copied().filter(|v| v.is_finite()).collect();
        assert_eq!(valid.len(), 64 * 64 - usize::from(view.name == "float"), "{}", view.name);
        let (low, high) = valid.iter().fold((1.0f32, 0.0f32), |(l, h), v| (l.min(*v), h.max(*v)));
        assert!(low == 0.0 && high == 1.0, "{}: {low} {high}", view.name);
    }
    let out = satgs(&["info", folder.path().to_str().unwrap()]);
    let table = String::from_utf8(out.stdout).unwrap();
    for (view, bands, values) in
        [("float", "1x32", "0 to 0.999"), ("bits11", "1x16", "0 to 2046"), ("signed", "1x16", "-250 to 249")]
    {
        let row = table.lines().find(|l| l.starts_with(view)).unwrap();
        assert!(row.contains(&format!("  {bands}   {values}, ")), "{row}");
    }
}

#[test]
fn n18_bands_of_multispectral_images_are_chosen() {
    let folder = tempfile::tempdir().unwrap();
    raster(&folder.path().join("msi.tif"), 8, &camera(5.44, 0.1), |i| (i % 999) as u16);
    raster(&folder.path().join("pan.tif"), 1, &camera(5.44, 0.3), |i| (i % 999) as u16);
    let (code, said) = info(folder.path(), &[]);
    assert!(
        code == Some(0)
            && said
                .contains("--bands R,G,B chooses others (5,3,2 for the eight bands of WorldView-3): msi (8)"),
        "{said}"
    );
    let (_, said) = info(folder.path(), &["--bands", "5,3,2"]);
    assert!(!said.contains("first bands"), "{said}");
    refused(
        folder.path(),
        &["--bands", "5,3,9"],
        "msi.tif` has 8 bands, band 9 was asked for",
        "counts from 1",
    );
    let (code, said) = info(folder.path(), &["--bands", "5,3"]);
    assert!(code == Some(2) && said.contains("one band or three"), "{said}");
    let options =
        satgs::scene::ReadOptions { bands: vec![5, 3, 2], stretch_percent: Some(2.0), ..Default::default() };
    let scene = satgs::scene::read(folder.path(), &options).unwrap();
    let colors = scene.views[0].read_colors().unwrap();
    assert_eq!((colors.len(), scene.views[1].read_colors().unwrap().len()), (3, 1));
    let saturated = colors.iter().flat_map(|p| &p.data).filter(|v| **v == 0.0).count() as f64;
    assert!((saturated / (3.0 * 4096.0) - 0.02).abs() < 0.005, "{saturated}");
}

#[test]
fn n22_invalid_areas_are_refused() {
    let folder = two_views();
    for (area, error) in [
        ("5.44,43.26,5.44,43.27", "the area is empty (0 x 1112 m)"),
        ("5,43,7,43.1", "is too large, at most 100 km a side"),
        ("43.26,105.44,43.27,105.45", "is not a place on Earth; are the axes swapped?"),
        ("5.44,43.26,5.45", "cannot be read"),
    ] {
        refused(folder.path(), &["--aoi", area], error, "");
    }
}

#[test]
fn n23_scenes_outside_of_utm_are_refused() {
    let mut c = satgs::rpc::RpcCoefficients::from(camera(5.44, 0.2));
    c.lat.offset = 86.0;
    let polar = satgs::rpc::Rpc::new(c).unwrap();
    let folder = tempfile::tempdir().unwrap();
    image(&folder.path().join("polar.tif"), 1, Some(&polar), &[]);
    refused(folder.path(), &[], "86", "");
}

#[test]
fn n24_heights_below_the_sea_and_on_everest_are_valid() {
    for height in [-430.0, 8849.0] {
        let folder = tempfile::tempdir().unwrap();
        for (name, seed, lean) in [("a.tif", 1, 0.2), ("b.tif", 2, -0.2)] {
            let mut c = satgs::rpc::RpcCoefficients::from(camera(5.44, lean));
            c.height.offset = height;
            let rpc = satgs::rpc::Rpc::new(c).unwrap();
            image(&folder.path().join(name), seed, Some(&rpc), &[]);
        }
        let scene = satgs::scene::read(folder.path(), &satgs::scene::ReadOptions::default()).unwrap();
        assert_eq!(scene.height_range(), (height - 50.0, height + 50.0));
        assert_eq!(info(folder.path(), &[]).0, Some(0));
    }
}

#[test]
fn n19_the_same_image_twice_is_refused() {
    let folder = two_views();
    std::fs::copy(folder.path().join("a.tif"), folder.path().join("c.tif")).unwrap();
    refused(folder.path(), &[], "c.tif` are the same image", "remove one of them");
    let (_, said) = info(folder.path(), &[]);
    assert!(said.contains("a.tif` and `"), "{said}");
}

#[test]
fn n20_views_of_different_places_are_refused() {
    let folder = two_views();
    image(&folder.path().join("far.tif"), 3, Some(&camera(5.54, 0.0)), &[]);
    let error = "views do not share ground: `far` (lon 5.53";
    refused(folder.path(), &[], error, "`satgs info` lists the footprints");
    let (_, said) = info(folder.path(), &[]);
    assert!(said.contains("by 0.0 %"), "{said}");
}

#[test]
fn n21_implausible_suns_and_dates_give_warnings() {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, seed, items: &[(&str, &str)]| {
        image(&folder.path().join(name), seed, Some(&camera(5.44, f64::from(seed) * 0.05)), items);
    };
    put("none.tif", 1, &[]);
    put("night.tif", 2, &[("SUN_AZIMUTH", "10"), ("SUN_ELEVATION", "-3")]);
    let noon =
        [("SUN_AZIMUTH", "180"), ("SUN_ELEVATION", "70"), ("ACQUISITION_TIME", "2016-06-21T11:40:00Z")];
    put("noon.tif", 3, &noon);
    let wrong =
        [("SUN_AZIMUTH", "90"), ("SUN_ELEVATION", "70"), ("ACQUISITION_TIME", "2021-06-21T11:40:00Z")];
    put("wrong.tif", 4, &wrong);
    let (code, said) = info(folder.path(), &[]);
    assert_eq!(code, Some(0), "{said}");
    for words in [
        "warning: the sun direction is unknown, so that no shadows are modelled (--sun NAME=AZ,EL sets it): none\n",
        "warning: night: its sun is below the horizon (-3.0°), no shadows are modelled",
        "warning: wrong: its sun (azimuth 90.0°, elevation 70.0°) is ",
        "warning: the views are 5.0 years apart",
    ] {
        assert!(said.contains(words), "{words}: {said}");
    }
    assert!(!said.contains("warning: noon"), "{said}");
    let (_, said) = info(folder.path(), &["--sun", "none=170,60"]);
    assert!(!said.contains("the sun direction is unknown"), "{said}");
    refused(
        folder.path(),
        &["--sun", "nobody=170,60"],
        "the view `nobody`, which does not exist",
        "night, none, noon, wrong",
    );
    let (code, said) = info(folder.path(), &["--sun", "none=170"]);
    assert!(code == Some(2) && said.contains("NAME=AZ,EL"), "{said}");
}

#[test]
fn n25_an_elevation_model_must_state_its_vertical_reference() {
    let folder = two_views();
    let dem = tempfile::tempdir().unwrap();
    let path = dem.path().join("dem.tif");
    let grid = dem_grid();
    let raster = satgs::io::Grid2::from_fn(60, 300, |_, row| 80.0 + row as f32 * 0.1);
    let write = |grid| {
        let cog = satgs::io::Cog { grid, metadata: &[], heights_from: None };
        cog.write_f32(&path, &[("height", "m", &raster)]).unwrap();
    };
    write(grid);
    let (scene, run) = (folder.path().to_str().unwrap(), dem.path().join("run"));
    let ba = |more: &[&str]| {
        let args =
            [&["ba", scene, "-o", run.to_str().unwrap(), "--dem", path.to_str().unwrap()], more].concat();
        let out = satgs(&args);
        (out.status.code(), String::from_utf8(out.stderr).unwrap())
    };
    let (code, said) = ba(&[]);
    assert!(code == Some(2) && said.contains("dem.tif` does not state a known vertical reference"), "{said}");
    assert!(said.contains("hint: name it: --dem-vertical ellipsoid"), "{said}");
    let scene = satgs::scene::read(folder.path(), &satgs::scene::ReadOptions::default()).unwrap();
    let vertical = satgs::io::VerticalReference::Ellipsoid;
    let (low, high) = scene.dem(&path, Some(&vertical)).unwrap().heights_to_search();
    assert!(60.0 < low && low < high && high < 190.0, "{low} {high}");
    // The same model in feet, with an undeclared nodata value.
    let feet = satgs::io::Grid2::from_fn(60, 300, |col, row| {
        if (col, row) == (30, 150) { -32768.0 } else { (80.0 + row as f32 * 0.1) / 0.3048 }
    });
    let cog = satgs::io::Cog { grid, metadata: &[], heights_from: None };
    cog.write_f32(&path, &[("height", "ft", &feet)]).unwrap();
    let (low_ft, high_ft) = scene.dem(&path, Some(&vertical)).unwrap().heights_to_search();
    assert!((low_ft - low).abs() < 0.01 && (high_ft - high).abs() < 0.01, "{low_ft} {high_ft}");
    // An unknown nodata value is not a height on Earth.
    let void =
        satgs::io::Grid2::from_fn(60, 300, |col, row| if (col + row) % 5 == 0 { -999.0 } else { 80.0 });
    cog.write_f32(&path, &[("height", "m", &void)]).unwrap();
    let error = scene.dem(&path, Some(&vertical)).unwrap_err().to_string();
    assert!(error.contains("height of -999 m"), "{error}");
    // The error names an unknown datum.
    let metadata = [("VERTICAL_REFERENCE", "NAVD88".to_owned())];
    satgs::io::Cog { metadata: &metadata, ..cog }.write_f32(&path, &[("height", "m", &raster)]).unwrap();
    let (code, said) = ba(&[]);
    assert!(code == Some(2) && said.contains("`NAVD88`"), "{said}");
    let far = satgs::io::MapGrid { west: 600_000.0, ..grid };
    write(far);
    let error = scene.dem(&path, Some(&vertical)).unwrap_err().to_string();
    assert!(error.contains("has no heights in the area of the scene"), "{error}");
}

#[test]
fn n34_unusual_paths_are_handled() {
    let folder = tempfile::tempdir().unwrap();
    let odd = folder.path().join("a b: é'");
    std::fs::create_dir(&odd).unwrap();
    image(&odd.join("vue d'été.tif"), 1, Some(&camera(5.44, 0.1)), &[]);
    let (code, said) = info(&odd, &[]);
    assert_eq!(code, Some(0), "{said}");

    refused(
        &folder.path().join("missing"),
        &[],
        "missing` cannot be read: No such file",
        "SCENE is a folder",
    );
    let file = odd.join("vue d'été.tif");
    refused(&file, &[], "été.tif` is a file, a folder is expected", "the folder that holds the images");
    #[cfg(unix)]
    {
        let around = folder.path().join("loop");
        std::os::unix::fs::symlink(&around, &around).unwrap();
        refused(&around, &[], "loop` cannot be read", "SCENE is a folder");
        let pipe = odd.join("pipe.tif");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        refused(&odd, &[], "pipe.tif` cannot be opened as a raster: not a regular file", "");
    }
}

#[test]
fn info_accepts_a_single_view() {
    let folder = tempfile::tempdir().unwrap();
    image(&folder.path().join("a.tif"), 1, Some(&camera(5.44, 0.1)), &[]);
    assert_eq!(info(folder.path(), &[]).0, Some(0));
    let scene = satgs::scene::read(folder.path(), &satgs::scene::ReadOptions::default()).unwrap();
    let error = scene.require_views(2).unwrap_err();
    assert_eq!(error.to_string(), "the scene has 1 view, at least 2 are needed");
}

#[test]
fn folders_of_rpc_files_are_chosen_by_name() {
    let scene = tempfile::tempdir().unwrap();
    let at = |p: &str| scene.path().join(p);
    for folder in ["images", "rpcs_raw", "rpcs_ba", "truth"] {
        std::fs::create_dir(at(folder)).unwrap();
    }
    for (name, lean) in [("a", 0.2), ("b", -0.2)] {
        image(&at(&format!("images/{name}.tif")), name.as_bytes()[0].into(), None, &[]);
        let tags = ViewTags { size: Some((64, 64)), ..ViewTags::default() };
        let json = to_json(&camera(5.44, lean), &tags);
        for folder in ["rpcs_raw", "rpcs_ba", "truth"] {
            std::fs::write(at(&format!("{folder}/{name}.json")), &json).unwrap();
        }
    }
    std::fs::write(at("rpcs_raw/test.txt"), "b.json\r\n").unwrap();
    refused(scene.path(), &[], "has several folders of RPC files: rpcs_ba, rpcs_raw", "--rpcs NAME");
    refused(scene.path(), &["--rpcs", "rpcs"], "has no folder `rpcs`", "rpcs_ba, rpcs_raw");
    let options = satgs::scene::ReadOptions { rpcs: Some("rpcs_raw".into()), ..Default::default() };
    let read = satgs::scene::read(scene.path(), &options).unwrap();
    let train: Vec<&str> = read.training().map(|v| v.name.as_str()).collect();
    assert_eq!((read.views.len(), train), (2, vec!["a"]));

    std::fs::remove_file(at("images/b.tif")).unwrap();
    let error = "rpcs_raw/b.json` is for the image";
    refused(scene.path(), &["--rpcs", "rpcs_raw"], error, "put the image there");
}

#[test]
fn one_view_cannot_be_adjusted() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene");
    std::fs::create_dir(&scene).unwrap();
    image(&scene.join("a.tif"), 1, Some(&camera(5.44, 0.2)), &[]);
    let run = folder.path().join("run");
    let output = satgs(&["ba", scene.to_str().unwrap(), "-o", run.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2));
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(text.contains("error:") && text.contains("hint:"), "{text}");
    assert!(!run.exists(), "nothing is written");
}

#[test]
fn a_reversed_height_range_is_refused() {
    let scene = two_views();
    let run = scene.path().join("../never-made");
    let (scene, run) = (scene.path().to_str().unwrap(), run.to_str().unwrap());
    let output = satgs(&["ba", scene, "-o", run, "--height-range", "150,50"]);
    assert_eq!(output.status.code(), Some(2));
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(text.contains("the height range 150 to 50 m is empty"), "{text}");
    assert!(!std::path::Path::new(run).exists());
}

#[test]
fn views_of_noise_are_refused_by_the_adjustment() {
    let scene = two_views();
    let run = tempfile::tempdir().unwrap();
    let run = run.path().join("run");
    let output = satgs(&["ba", scene.path().to_str().unwrap(), "-o", run.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2));
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(text.contains("error:") && text.contains("hint:"), "{text}");
    assert!(!run.exists(), "nothing is written");
}

#[test]
fn a_run_folder_must_not_be_the_scene() {
    let scene = two_views();
    let path = scene.path().to_str().unwrap();
    let output = satgs(&["ba", path, "-o", path]);
    assert_eq!(output.status.code(), Some(2));
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(text.contains("is the scene itself"), "{text}");
    assert_eq!(std::fs::read_dir(scene.path()).unwrap().count(), 2);
}

/// A limit on the size of files simulates a full disk: a write beyond the limit fails.
#[cfg(unix)]
#[test]
fn n35_a_full_disk_is_an_error_and_leaves_no_incomplete_file() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("scene");
    let program = env!("CARGO_BIN_EXE_satgs");
    let script = format!(
        "trap '' XFSZ; ulimit -f 8; exec {program} simulate {} --size 100 --views 3 -q",
        out.display()
    );
    let output = std::process::Command::new("sh").args(["-c", &script]).output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("VIEW_01.tif") && text.contains("too large"), "{text}");
    assert!(!out.join("VIEW_01.tif").exists(), "a torn image is left");
    assert!(listing(&out).iter().all(|p| p.is_dir()), "{:?}", listing(&out));
}

#[test]
fn n35_existing_files_are_replaced_only_with_overwrite() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("scene");
    std::fs::create_dir(&out).unwrap();
    std::fs::write(out.join("VIEW_01.tif"), "mine").unwrap();
    let output = satgs(&["simulate", out.to_str().unwrap(), "--size", "100", "--views", "3", "-q"]);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{text}");
    assert!(text.contains("hint: ") && text.contains("--overwrite"), "{text}");
    assert_eq!(std::fs::read(out.join("VIEW_01.tif")).unwrap(), b"mine");
}

#[test]
fn views_of_different_places_are_not_adjusted() {
    let scene = two_views();
    image(&scene.path().join("far.tif"), 3, Some(&camera(5.54, 0.0)), &[]);
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let output = satgs(&["ba", scene.path().to_str().unwrap(), "-o", run.to_str().unwrap()]);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{text}");
    assert!(text.contains("views do not share ground: `far`") && text.contains("hint:"), "{text}");
    assert!(!run.exists(), "nothing is written");
}
