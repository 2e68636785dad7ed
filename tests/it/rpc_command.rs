//! `satgs rpc`: points, formats, comparisons, through the binary.
use crate::common::{camera, image, satgs};
use satgs::rpc::formats::{self, to_rpb, to_text};
use serde_json::Value;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Output, Stdio};

fn said(output: &Output) -> (Option<i32>, String, String) {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

fn numbers(text: &str) -> Vec<f64> {
    text.split_whitespace().map(|w| w.parse().unwrap()).collect()
}

/// A folder with a camera as text.
fn text_camera() -> (tempfile::TempDir, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a_RPC.TXT");
    std::fs::write(&path, to_text(&camera(5.44, 0.2))).unwrap();
    let path = path.to_str().unwrap().to_owned();
    (folder, path)
}

#[test]
fn a_file_in_utf_16_is_read_as_text() {
    let (folder, path) = text_camera();
    let text = std::fs::read_to_string(&path).unwrap();
    let words = std::iter::once(0xfeff).chain(text.encode_utf16());
    let utf16 = folder.path().join("b_RPC.TXT");
    std::fs::write(&utf16, words.flat_map(u16::to_le_bytes).collect::<Vec<u8>>()).unwrap();
    let project = |path: &str| said(&satgs(&["rpc", "project", path, "5.44 43.26 100"]));
    let (code, px, error) = project(utf16.to_str().unwrap());
    assert_eq!((code, &px), (Some(0), &project(&path).1), "{error}");
}

#[test]
fn project_and_localize_are_inverse() {
    let (_folder, rpc) = text_camera();
    let (code, ground, _) = said(&satgs(&["rpc", "localize", &rpc, "10,20,130", "3.5 4.25 90"]));
    assert_eq!((code, ground.lines().count()), (Some(0), 2));
    let lines: Vec<&str> = ground.lines().collect();
    let input = format!("# lon lat h\n{} 130\n\n{},90\n", lines[0], lines[1].replace(' ', ","));
    let mut child = Command::new(env!("CARGO_BIN_EXE_satgs"))
        .args(["rpc", "project", &rpc])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(input.as_bytes()).unwrap();
    let (code, pixels, _) = said(&child.wait_with_output().unwrap());
    assert_eq!(code, Some(0));
    for (a, b) in numbers(&pixels).iter().zip([10.0, 20.0, 3.5, 4.25]) {
        assert!((a - b).abs() < 1e-6, "{pixels}");
    }
}

#[test]
fn json_output_keeps_every_bit() {
    let (_folder, rpc) = text_camera();
    let (_, out, _) = said(&satgs(&["rpc", "project", &rpc, "5.4401,43.2599,130", "--json"]));
    let json: Value = serde_json::from_str(&out).unwrap();
    let px = camera(5.44, 0.2).project(satgs::frame::Point::new(5.4401, 43.2599, 130.0));
    assert!((json["col"][0].as_f64().unwrap() - px.col).abs() < 1e-9, "{out}");
    assert_eq!(json["outside_volume"], 0);
}

#[test]
fn n13_a_pixel_without_ground_is_reported_once_with_point_and_height() {
    let (_folder, rpc) = text_camera();
    let (code, out, err) = said(&satgs(&["rpc", "localize", &rpc, "1e9,0,100", "10,10,100", "0,1e9,100"]));
    assert_eq!(code, Some(3), "{err}");
    assert_eq!((out.lines().count(), out.matches("NaN NaN").count()), (3, 2), "{out}");
    assert_eq!(err.matches("error: ").count(), 1);
    assert!(
        err.contains("2 of 3 points") && err.contains("point 1: no ground point at height 100 m"),
        "{err}"
    );
}

#[test]
fn invalid_points_are_refused() {
    let (_folder, rpc) = text_camera();
    for bad in ["5.44,43.26", "5.44,43.26,nan", "a b c", "1,2,3,4"] {
        let (code, out, err) = said(&satgs(&["rpc", "project", &rpc, bad]));
        assert_eq!((code, out.as_str()), (Some(2), ""), "{bad}");
        assert!(err.contains(&format!("point 1 is `{bad}`, expected three numbers")), "{err}");
    }
    let (code, _, err) = said(&satgs(&["rpc", "project", &rpc, "--", "-5.5,43.26,100"]));
    assert!(code == Some(0) && err.contains("1 of 1 points are outside the volume"), "{err}");
}

#[test]
fn conversion_of_cameras_keeps_every_bit() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let exact = camera(5.44, 1.0 / 3.0).shifted(1.0 / 7.0, 2.0 / 7.0);
    std::fs::write(at("a.rpb"), to_rpb(&exact)).unwrap();
    image(Path::new(&at("plain.tif")), 1, None, &[]);
    for (from, to) in [("a.rpb", "a.txt"), ("a.txt", "b.json"), ("b.json", "b.RPB")] {
        let (code, _, err) = said(&satgs(&["rpc", "convert", &at(from), &at(to)]));
        assert_eq!(code, Some(0), "{err}");
        assert_eq!(formats::read(Path::new(&at(to))).unwrap().rpc, exact, "{to}");
    }
    let tagged = ["rpc", "convert", &at("b.RPB"), &at("t.tif"), "--image", &at("plain.tif")];
    assert_eq!(said(&satgs(&tagged)).0, Some(0));
    assert_eq!(formats::from_tiff(Path::new(&at("t.tif"))).unwrap(), Some(exact));
    assert!(!Path::new(&at("plain.tif.aux.xml")).exists(), "the image is left as it was");
    let (code, _, err) = said(&satgs(&["rpc", "convert", &at("a.rpb"), &at("a.txt")]));
    assert!(code == Some(2) && err.contains("--overwrite"), "{err}");
    let (code, _, err) = said(&satgs(&["rpc", "convert", &at("a.rpb"), &at("a.xyz")]));
    assert!(code == Some(2) && err.contains("does not end in a known format"), "{err}");
}

#[test]
fn two_cameras_are_compared_over_the_first_ones_volume() {
    let (folder, rpc) = text_camera();
    let other = folder.path().join("b.rpb");
    std::fs::write(&other, to_rpb(&camera(5.44, 0.2).shifted(3.0, -4.0))).unwrap();
    let (code, out, _) = said(&satgs(&["rpc", "compare", &rpc, other.to_str().unwrap(), "--json"]));
    let json: Value = serde_json::from_str(&out).unwrap();
    let number = |key: &str| json[key].as_f64().unwrap();
    assert_eq!(code, Some(0));
    assert!((number("rms_px") - 5.0).abs() < 1e-6 && (number("max_px") - 5.0).abs() < 1e-6, "{out}");
    assert!((number("mean_col_px") - 3.0).abs() < 1e-6 && (number("mean_row_px") + 4.0).abs() < 1e-6);
}

#[test]
fn help_contains_an_example() {
    let (code, out, _) = said(&satgs(&["rpc", "project", "--help"]));
    assert_eq!(code, Some(0));
    assert!(out.contains("satgs rpc project img_RPC.TXT 5.4401,43.2603,120"), "{out}");
}

#[test]
fn a_height_outside_of_the_validity_volume_gives_a_warning() {
    let (_folder, rpc) = text_camera();
    let (code, _, err) = said(&satgs(&["rpc", "localize", &rpc, "10,20,300"]));
    assert!(code == Some(0) && err.contains("1 of 1 points are outside the volume"), "{err}");
}
