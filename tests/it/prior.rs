//! `satgs prior`, and training with priors by a command, through the binary.

#![cfg(unix)]

#[path = "../../src/nn/onnx/made_graph.rs"]
mod made_graph;
#[allow(dead_code)]
#[path = "../../src/nn/onnx/writer.rs"]
mod writer;

use crate::common::perspective::{SIZE, model, project};
use crate::common::{refused, succeeds, text};
use made_graph::Graph;
use satgs::io::{NpyArray, NumberKind};
use satgs::perspective::LensModel;
use satgs::perspective::colmap::Format;
use std::path::{Path, PathBuf};
use writer::{int, ints, node};

/// A scene of four images and a script that copies one map for each of them.
struct Case {
    folder: tempfile::TempDir,
}

impl Case {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        project(
            &folder.path().join("scene"),
            &model(LensModel::Pinhole, &[30.0, 30.0, 16.0, 12.0]),
            Format::Binary,
        );
        let values = (0..SIZE.0 * SIZE.1).map(|i| 3.0 + 0.1 * (i / SIZE.0) as f32).collect();
        let map = NpyArray { shape: vec![SIZE.1, SIZE.0], values, kind: NumberKind::Float };
        map.write(&folder.path().join("map.npy")).unwrap();
        let case = Self { folder };
        let (map, calls) = (case.path("map.npy"), case.path("calls"));
        case.script("depth.sh", &format!("echo \"$1\" >> '{calls}'\ncp '{map}' \"$2\"\n"));
        case
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    fn script(&self, name: &str, content: &str) -> String {
        std::fs::write(self.path(name), content).unwrap();
        self.command(name)
    }

    fn command(&self, name: &str) -> String {
        format!("sh '{}' {{image}} {{out}}", self.path(name))
    }

    /// How often the script was called.
    fn calls(&self) -> usize {
        std::fs::read_to_string(self.path("calls")).map_or(0, |text| text.lines().count())
    }
}

fn json(output: &std::process::Output) -> serde_json::Value {
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn maps_are_made_once_and_described() {
    let case = Case::new();
    let (scene, out, command) = (case.path("scene"), case.path("depths"), case.command("depth.sh"));
    let args = ["prior", &scene, "-o", &out, "--command", &command, "--kind", "metric", "--json"];
    let first = json(&succeeds(&args));
    assert_eq!((first["made"].as_u64(), first["kept"].as_u64()), (Some(4), Some(0)), "{first}");
    assert!(Path::new(&out).join("view 3.npy").exists());
    std::fs::remove_file(Path::new(&out).join("view 2.npy")).unwrap();
    let again = json(&succeeds(&["prior", &scene, "-o", &out, "--command", &command, "--json"]));
    assert_eq!((again["made"].as_u64(), again["kept"].as_u64()), (Some(1), Some(3)), "{again}");
    assert_eq!(case.calls(), 5);
    let said = std::fs::read_to_string(Path::new(&out).join("prior.json")).unwrap();
    assert!(said.contains("\"metric\""), "{said}");
    let left: Vec<String> = std::fs::read_dir(&out)
        .unwrap()
        .map(|e| e.unwrap().file_name().to_string_lossy().into_owned())
        .filter(|name| name.starts_with('.'))
        .collect();
    assert!(left.is_empty(), "{left:?}");

    // Another maker replaces them only if it may.
    let largest = node("ReduceMax", &["x"], &["y"], &[ints("axes", &[1]), int("keepdims", 1)]);
    let graph = Graph { input: &[1, 3, 28, 28], nodes: vec![largest], output: "y", ..Graph::default() };
    let (_graph, network): (_, PathBuf) = graph.write();
    let network = network.to_str().unwrap();
    let args = ["prior", &scene, "-o", &out, "--model", network];
    refused(&args, 2, &["view 0.npy` exists, and was not made", "graph.onnx", "--overwrite"]);
    succeeds(&[&args[..], &["--overwrite"]].concat());
    let map = NpyArray::read(&Path::new(&out).join("view 0.npy")).unwrap();
    assert_eq!(map.shape, [24, 32]);
}

#[test]
fn what_cannot_make_maps_is_refused() {
    let case = Case::new();
    let (scene, out, good) = (case.path("scene"), case.path("depths"), case.command("depth.sh"));
    let args = ["prior", scene.as_str(), "-o", out.as_str()];
    let refuse = |more: &[&str], code, says: &[&str]| refused(&[&args[..], more].concat(), code, says);
    refuse(&[], 2, &["--model", "--command"]);
    refuse(&["--model", "a.onnx", "--command", &good], 2, &["cannot be used with"]);
    refuse(&["--command", "depth {image}"], 2, &["{image} and {out}", "an existing folder"]);
    refuse(&["--model", "absent.onnx"], 2, &["absent.onnx"]);
    refuse(&["--command", &good, "--normals"], 2, &["view 0.png` is of 1 values a pixel, expected three"]);
    refuse(&["--command", &good, "--normals", "--kind", "metric"], 2, &["cannot be used with"]);
    let failing = case.script("fail.sh", "echo 'out of memory' >&2\nexit 7\n");
    refuse(&["--command", &failing], 1, &["view 0.png", "exit status: 7", "out of memory"]);
    refuse(&["--command", "no-such-program {image} {out}"], 2, &["no-such-program", "PATH"]);
    refused(&["prior", &case.path("nowhere"), "-o", &out, "--command", &good], 2, &["nowhere"]);
}

#[test]
fn training_calls_a_command_once_for_each_training_image() {
    let case = Case::new();
    let (scene, run, command) = (case.path("scene"), case.path("run"), case.command("depth.sh"));
    let args = ["run", &scene, "-o", &run, "--recipe", "indoor", "--iterations", "6"];
    let priors = ["--depth-prior", &command, "--prior-kind", "relative"];
    let all = [&args[..], &priors].concat();
    let output = succeeds(&all);
    assert!(text(&output).contains("without --normal-prior"), "{}", text(&output));
    assert!(Path::new(&run).join("priors/depths/view 1.npy").exists());
    assert_eq!(case.calls(), 3);
    let report = std::fs::read_to_string(Path::new(&run).join("report.html")).unwrap();
    assert!(report.contains("rendered depths and those of the prior"), "no picture of priors");
    // The same call has nothing to do; trained anew, the maps are there.
    succeeds(&all);
    succeeds(&[&all[..], &["--overwrite"]].concat());
    assert_eq!(case.calls(), 3);
    // The folder of maps may be given as one.
    let maps = format!("{run}/priors/depths");
    let other = case.path("other");
    succeeds(&[
        "run",
        &scene,
        "-o",
        &other,
        "--recipe",
        "indoor",
        "--iterations",
        "6",
        "--depth-prior",
        &maps,
    ]);
    refused(&[&all[..], &["--seed", "1"]].concat(), 2, &["--seed was 0, is 1"]);
    case.script("depth.sh", "exit 1\n");
    refused(&all, 2, &["--depth-prior has changed"]);
    let nothing = [&args[..], &["--depth-prior", "nothing"]].concat();
    refused(&nothing, 2, &["--depth-prior", "existing folder", ".onnx", "{image} and {out}"]);
}
