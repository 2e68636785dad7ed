//! Satellite images, their cameras and metadata, heights, tiles.

use super::input;
use crate::common::web_server::{Folders, WebServer};
use crate::common::{copy_folder, satgs, succeeds, text};
use satgs::io::ImageFile;
use serde_json::Value;
use std::path::{Path, PathBuf};

pub const FOLDERS: &[&str] = &[
    "ansi_in_logs",
    "aoi-several-polygons",
    "las_return_number_0",
    "mapprojected-with-rpc",
    "maxar-tiles-product-xml",
    "nitf-ichipb",
    "nodata-margin",
    "nodata16-interior",
    "nodata_counts_as_seen",
    "one_turned_view",
    "other-rasters-skipped",
    "other_input_message",
    "planet-udm2",
    "rough-geotransform",
    "rpc-text-variants",
    "signed_url",
    "stac_assets",
    "stdout_lost",
    "test-txt-bom",
    "truth",
    "two_views",
    "upsampled-without-rpc",
    "vrt-sidecar",
];

/// A file or folder of an input as text.
fn path(input: &Path, name: &str) -> String {
    input.join(name).to_str().unwrap().to_owned()
}

/// What `satgs info` says, warnings included.
fn info(args: &[&str]) -> String {
    let output = succeeds(&[&["info"], args].concat());
    format!("{}{}", String::from_utf8_lossy(&output.stdout), text(&output))
}

/// The views that `satgs info --json` lists.
fn views(args: &[&str]) -> Vec<Value> {
    let output = succeeds(&[&["info", "--json"], args].concat());
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
    summary["views"].as_array().unwrap().clone()
}

#[test]
fn names_of_sidecars_are_made_of_the_path_of_a_signed_url() {
    let Some(input) = input("signed_url") else { return };
    let server = WebServer::of(&input.join("scene"), Folders::Hidden);
    let folder = tempfile::tempdir().unwrap();
    let list = folder.path().join("list.toml");
    let view = |name: &str| format!("[[view]]\nimage = \"{}?sig=a/b%2Fc&se=2030.5\"\n", server.url(name));
    std::fs::write(&list, ["V01.tif", "V02.tif"].map(view).concat()).unwrap();
    let views = views(&[list.to_str().unwrap()]);
    assert_eq!([&views[0]["name"], &views[1]["name"]], ["V01", "V02"]);
    let requests = server.requests();
    assert!(requests.iter().all(|line| line.ends_with("?sig=a%2Fb%2Fc&se=2030.5")), "{requests:?}");
}

#[test]
fn assets_of_stac_items_are_chosen_by_type_and_role() {
    let Some(input) = input("stac_assets") else { return };
    let images = |list: &str| -> Vec<String> {
        let file = |view: &Value| {
            PathBuf::from(view["image"].as_str().unwrap()).file_name().unwrap().to_str().unwrap().to_owned()
        };
        views(&[&path(&input, list)]).iter().map(file).collect()
    };
    assert_eq!(images("percent.json"), ["left image.tif", "V02.tif"]);
    assert_eq!(images("metadata_first.json"), ["V01.tif", "V02.tif"]);
    let left = &views(&[&path(&input, "time_zone.json")])[0];
    assert_eq!(left["acquired"], "2023-06-21T10:05:00Z", "{left}");

    // Of several images the panchromatic one is used, and the others are named.
    let list = std::fs::read_to_string(input.join("metadata_first.json")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    copy_folder(&input, folder.path());
    let several = folder.path().join("several.json");
    let blue = r#""blue": {"href": "scene/V02.tif", "roles": ["data"], "type": "image/tiff"}, "about""#;
    std::fs::write(&several, list.replace(r#""about""#, blue)).unwrap();
    let said = info(&[several.to_str().unwrap()]);
    assert!(said.contains("of several images `image_pan` is used, not blue"), "{said}");
}

#[test]
fn one_view_that_matches_no_other_is_left_out() {
    let Some(input) = input("one_turned_view") else { return };
    let run = tempfile::tempdir().unwrap();
    let output = satgs(&["ba", &path(&input, "scene"), "-o", run.path().to_str().unwrap(), "-q"]);
    assert_eq!(output.status.code(), Some(3), "{}", text(&output));
    assert!(text(&output).contains("adjusted without `VIEW_02`"), "{}", text(&output));
}

#[test]
fn an_area_of_several_polygons_holds_them_all() {
    let Some(input) = input("aoi-several-polygons") else { return };
    let scene = input.to_str().unwrap();
    let view = |area: &str| views(&[scene, "--aoi", &path(&input, area)])[0].clone();
    let (first, two) = (view("first.geojson"), view("two.geojson"));
    let size = |view: &Value| view["width"].as_f64().unwrap() * view["height"].as_f64().unwrap();
    assert!(size(&two) > 1.5 * size(&first), "{first} {two}");
    assert_eq!(view("bom.geojson"), first);
}

#[test]
fn images_on_a_map_with_the_camera_of_the_sensor_are_named() {
    let Some(input) = input("mapprojected-with-rpc") else { return };
    let output = satgs(&["info", input.to_str().unwrap()]);
    let said = format!("{}{}", String::from_utf8_lossy(&output.stdout), text(&output));
    assert!(said.contains("map"), "{said}");
}

#[test]
fn tiles_with_an_rpb_each_and_one_xml_are_read() {
    let Some(input) = input("maxar-tiles-product-xml") else { return };
    assert_eq!(views(&[input.to_str().unwrap()]).len(), 4);
}

#[test]
fn a_chip_of_a_nitf_has_its_own_place() {
    let Some(input) = input("nitf-ichipb") else { return };
    let place = "5.499763161 43.300094268 160";
    let output = succeeds(&["rpc", "project", &path(&input, "VIEW_01.ntf"), place]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let numbers: Vec<f64> = said.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    assert!(numbers.windows(2).any(|px| (px[0] - 50.0).abs() < 1.0 && (px[1] - 50.0).abs() < 1.0), "{said}");
}

#[test]
fn rasters_of_other_formats_are_named() {
    let Some(input) = input("other-rasters-skipped") else { return };
    let said = info(&[input.to_str().unwrap()]);
    assert!(said.contains("VIEW_03.dat") && said.contains("VIEW_04.pix"), "{said}");
}

#[test]
fn masks_of_planet_are_no_views() {
    let Some(input) = input("planet-udm2") else { return };
    assert_eq!(views(&[input.to_str().unwrap()]).len(), 2);
}

#[test]
fn a_rough_place_on_the_map_does_not_make_an_image_a_map() {
    let Some(input) = input("rough-geotransform") else { return };
    assert_eq!(views(&[input.to_str().unwrap(), "--trust-rpc"]).len(), 2);
}

#[test]
fn rpcs_with_blank_errors_in_other_encodings_and_with_two_values() {
    let Some(input) = input("rpc-text-variants") else { return };
    let project = |name: &str| satgs(&["rpc", "project", &path(&input, name), "5.5 43.3 160"]);
    for name in ["err_blank_RPC.TXT", "err_na_RPC.TXT", "utf16_RPC.TXT"] {
        let output = project(name);
        assert!(output.status.success(), "{name}: {}", text(&output));
    }
    let twice = project("twice_RPC.TXT");
    assert!(text(&twice).contains("SAMP_OFF"), "{}", text(&twice));
}

#[test]
fn a_list_of_views_may_begin_with_a_byte_order_mark() {
    let Some(input) = input("test-txt-bom") else { return };
    let views = views(&[input.to_str().unwrap()]);
    let role = |name: &str| views.iter().find(|v| v["name"] == name).unwrap()["role"].clone();
    assert_eq!([role("VIEW_01"), role("VIEW_03")], ["test", "train"]);
}

#[test]
fn images_that_were_resampled_without_their_camera_are_named() {
    let Some(input) = input("upsampled-without-rpc") else { return };
    let output = satgs(&["info", input.to_str().unwrap()]);
    assert!(text(&output).contains("resampled"), "{}", text(&output));
}

#[test]
fn the_camera_of_a_virtual_raster_is_its_own() {
    let Some(input) = input("vrt-sidecar") else { return };
    let own = |name: &str| {
        let output = succeeds(&["rpc", "project", &path(&input, name), "5.5 43.3 160"]);
        String::from_utf8(output.stdout).unwrap()
    };
    let whole = own("VIEW_01_RPC.TXT");
    assert_ne!(own("VIEW_01.vrt"), whole);
    for view in views(&[&path(&input, "scene.toml")]) {
        let source = view["rpc_source"].to_string();
        assert!(!source.contains("_RPC.TXT"), "{source}");
    }
}

/// A fast run of a folder of inputs; its folder.
fn run(scene: &Path, recipe: &str) -> tempfile::TempDir {
    let run = tempfile::tempdir().unwrap();
    let options = ["--iterations", "5", "--recipe", recipe, "-q"];
    let args = ["run", scene.to_str().unwrap(), "-o", run.path().to_str().unwrap()];
    let output = satgs(&[&args[..], &options[..]].concat());
    assert!(matches!(output.status.code(), Some(0 | 3)), "{}", text(&output));
    run
}

#[test]
fn ground_without_valid_pixels_is_not_seen() {
    let Some(input) = input("nodata-margin") else { return };
    let run = run(&input, "baeogs");
    let band = |name: &str, index| ImageFile::open(&run.path().join(name)).unwrap().read(index).unwrap();
    let (heights, views) = (band("dsm.tif", 1), band("confidence.tif", 3));
    // The columns from 150 on of 256 are margin in all views: a third of the map or more is seen by none.
    let unseen = views.data.iter().filter(|n| n.is_nan() || **n < 2.0).count();
    assert!(4 * unseen > views.data.len(), "{unseen} of {}", views.data.len());
    assert!(heights.data.iter().any(|z| z.is_nan()), "a height everywhere");

    // The points of the run have return numbers, as LAS 1.4 wants them.
    let mut cloud = las::Reader::from_path(run.path().join("ba/points.laz")).unwrap();
    let first = cloud.read_points(1).unwrap().points().next().unwrap().unwrap();
    assert_eq!((first.return_number, first.number_of_returns), (1, 1));

    // A log that is no terminal has no colours, and a lost output is a failure.
    let folder = run.path().to_str().unwrap();
    let output = satgs(&["dsm", folder, "--resolution", "1", "-v"]);
    let said = text(&output);
    assert!(!said.contains('\u{1b}'), "{said}");
    assert!(output.status.code() != Some(0) || !said.contains("32631"), "{said}");
    if output.status.code() != Some(0) {
        assert!(said.contains("resolution") && said.contains("--overwrite"), "{said}");
    }
}

#[test]
fn nodata_within_an_image_of_16_bits_is_no_colour() {
    let Some(input) = input("nodata16-interior") else { return };
    let run = run(&input, "best");
    let ortho = ImageFile::open(&run.path().join("ortho.tif")).unwrap().read(1).unwrap();
    let (sum, count) = ortho.valid().fold((0.0, 0), |(sum, n), v| (sum + v, n + 1));
    assert!(sum / count as f32 > 60.0, "mean {}", sum / count as f32);
}

#[test]
#[cfg(target_os = "linux")]
fn an_output_that_is_lost_is_a_failure() {
    let Some(input) = input("planet-udm2") else { return };
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_satgs"));
    let status = command.args(["info", input.to_str().unwrap(), "--json"]).stdout(full).status().unwrap();
    assert_eq!(status.code(), Some(1));
}
