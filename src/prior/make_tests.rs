//! Maps by networks and commands, and how each of them may fail.

use super::make::Work;
use super::tests::{SIZE, view};
use super::*;
use crate::io::{NpyArray, NumberKind, write_png_rgb};
use crate::nn::onnx::OnnxError;
use crate::nn::onnx::made_graph::Graph;
use crate::nn::onnx::writer::{int, int64_tensor, ints, node};
use crate::perspective::PerspectiveView;
use crate::progress::{Event, NoProgress, Progress, Recorder};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Views with images in which red grows with the column.
fn views(folder: &Path, count: usize) -> Vec<PerspectiveView> {
    let of = |k| {
        let image = folder.join(format!("photo.{k}.png"));
        let pixel = |i: usize| [(4 * (i % SIZE.0)) as u8, 100, k as u8];
        let rgb: Vec<u8> = (0..SIZE.0 * SIZE.1).flat_map(pixel).collect();
        write_png_rgb(&image, SIZE.0, SIZE.1, &rgb).unwrap();
        PerspectiveView { image, ..view(k) }
    };
    (0..count).map(of).collect()
}

/// A network whose depths are the largest of the three normalised colours.
fn largest_color(input: &'static [i64]) -> Graph {
    let largest = node("ReduceMax", &["x"], &["y"], &[ints("axes", &[1]), int("keepdims", 0)]);
    Graph { input, nodes: vec![largest], output: "y", ..Graph::default() }
}

fn make(
    maker: &PriorMaker,
    content: PriorContent,
    views: &[PerspectiveView],
    folder: &Path,
    existing: ExistingMaps,
    progress: &dyn Progress,
) -> Result<MadeMaps, PriorError> {
    std::fs::create_dir_all(folder).unwrap();
    let work = Work { maker, content, folder, limit: Duration::from_millis(400) };
    let views: Vec<&PerspectiveView> = views.iter().collect();
    work.make(&views, &PriorDescription::default(), existing, progress)
}

fn counts(made: usize, kept: usize) -> MadeMaps {
    MadeMaps { made, kept, left_out: 0 }
}

#[test]
fn a_network_gives_maps_in_the_shape_of_their_images() {
    let folder = tempfile::tempdir().unwrap();
    let views = views(folder.path(), 2);
    for (input, shape) in [
        (&[1, 3, 28, 28][..], vec![28, 37]),
        (&[1, 3, 96, 128], vec![48, 64]),
        (&[1, 3, -1, -1], vec![48, 64]),
        (&[-1, 3, 24, -1], vec![24, 32]),
    ] {
        let (_graph, path) = largest_color(input).write();
        let (maker, maps) = (PriorMaker::Network(path), tempfile::tempdir().unwrap());
        let made = make(&maker, PriorContent::Depths, &views, maps.path(), ExistingMaps::Keep, &NoProgress);
        assert_eq!(made.unwrap(), counts(2, 0));
        let map = NpyArray::read(&maps.path().join("photo.1.npy")).unwrap();
        assert_eq!(map.shape, shape, "{input:?}");
        // Red is the largest of the colours at the right.
        let (width, place) = (shape[1], shape[0] / 2 * shape[1] + shape[1] * 3 / 4);
        let col = ((place % width) as f32 + 0.5) * 64.0 / width as f32 - 0.5;
        let expected = (4.0 * col / 255.0 - 0.485) / 0.229;
        assert!((map.values[place] - expected).abs() < 0.02, "{input:?}: {} {expected}", map.values[place]);
    }
}

#[test]
fn normals_of_a_network_may_have_their_components_first_or_last() {
    let folder = tempfile::tempdir().unwrap();
    let views = views(folder.path(), 1);
    let first = node("Tanh", &["x"], &["y"], &[]);
    let last = node("Transpose", &["y"], &["z"], &[ints("perm", &[0, 2, 3, 1])]);
    let maps = [(vec![first.clone()], "y"), (vec![first, last], "z")].map(|(nodes, output)| {
        let (_graph, path) = Graph { input: &[1, 3, 48, 64], nodes, output, ..Graph::default() }.write();
        let (maker, maps) = (PriorMaker::Network(path), tempfile::tempdir().unwrap());
        make(&maker, PriorContent::Normals, &views, maps.path(), ExistingMaps::Keep, &NoProgress).unwrap();
        NpyArray::read(&maps.path().join("photo.0.npy")).unwrap()
    });
    assert_eq!(maps[0].shape, [48, 64, 3]);
    assert_eq!(maps[0], maps[1]);
}

#[test]
fn networks_that_take_or_give_something_else_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let views = views(folder.path(), 1);
    let refusal = |path: PathBuf, content| {
        let maps = tempfile::tempdir().unwrap();
        let maker = PriorMaker::Network(path);
        let error = make(&maker, content, &views, maps.path(), ExistingMaps::Keep, &NoProgress).unwrap_err();
        let left: Vec<_> = std::fs::read_dir(maps.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert_eq!(left, ["prior.json"], "{error}");
        error
    };
    let (_graph, path) = largest_color(&[1, 4, 28, 28]).write();
    let error = refusal(path, PriorContent::Depths);
    assert!(matches!(error, PriorError::Network(OnnxError::Input { .. })), "{error}");
    assert!(error.to_string().contains("expected one picture, f32 [1, 3, rows, columns]"), "{error}");
    let (_graph, path) = largest_color(&[1, 3, 28, 28]).write();
    let error = refusal(path.clone(), PriorContent::Normals);
    assert!(matches!(error, PriorError::Output { .. }), "{error}");
    assert!(error.to_string().contains("expected normals of the whole picture, f32 [1, 3, rows"), "{error}");
    // Vectors of patches, and a map of a part.
    for shape in [[1, 16, 147], [1, 14, 168]] {
        let nodes = vec![node("Reshape", &["x", "shape"], &["y"], &[])];
        let constants = vec![int64_tensor("shape", &shape)];
        let (_graph, path) = Graph { input: &[1, 3, 28, 28], nodes, constants, output: "y" }.write();
        let error = refusal(path, PriorContent::Depths).to_string();
        assert!(error.contains(&format!("{shape:?}")) && error.contains("28 x 28 pixels"), "{error}");
    }
    let whole = std::fs::read(&path).unwrap();
    std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    let error = refusal(path, PriorContent::Depths);
    assert!(matches!(error, PriorError::Network(OnnxError::Damaged { .. })), "{error}");
}

#[test]
fn a_text_names_a_folder_a_network_or_a_command() {
    let folder = tempfile::tempdir().unwrap();
    let (_graph, model) = largest_color(&[1, 3, 28, 28]).write();
    let of = |text: &str| PriorSource::parse(text);
    let path = folder.path().to_str().unwrap();
    assert_eq!(of(path).unwrap(), PriorSource::Folder(folder.path().into()));
    let expected = PriorSource::Maker(PriorMaker::Network(model.clone()));
    assert_eq!(of(model.to_str().unwrap()).unwrap(), expected);
    let command = of("python3 depth.py {image} {out}").unwrap();
    assert!(matches!(&command, PriorSource::Maker(PriorMaker::Command(_))));
    assert_eq!(command.to_string(), "python3 depth.py {image} {out}");
    for text in ["missing.onnx", "missing", "depth.py {image}", ""] {
        let error = of(text).unwrap_err().to_string();
        for form in ["existing folder", ".onnx", "{image} and {out}"] {
            assert!(error.contains(form), "{text}: {error}");
        }
    }
}

/// A shell script, as the command that calls it with image and output.
#[cfg(unix)]
fn command(folder: &Path, script: &str) -> PriorMaker {
    let path = folder.join("make it.sh");
    std::fs::write(&path, script).unwrap();
    let text = format!("/bin/sh '{}' {{image}} {{out}}", path.display());
    PriorMaker::Command(PriorCommand::parse(&text).unwrap())
}

/// A script that writes depths of these rows and columns, which change from pixel to pixel.
#[cfg(unix)]
fn copying(folder: &Path, shape: [usize; 2]) -> PriorMaker {
    let map = folder.join("map.npy");
    let values = (0..shape[0] * shape[1]).map(|i| 1.0 + i as f32).collect();
    NpyArray { shape: shape.into(), values, kind: NumberKind::Float }.write(&map).unwrap();
    let (map, calls) = (map.display(), folder.join("calls").display().to_string());
    command(folder, &format!("echo \"$1\" >> '{calls}'\ncp '{map}' \"$2\"\n"))
}

#[test]
#[cfg(unix)]
fn a_command_is_called_once_for_each_image_until_its_input_changes() {
    let folder = tempfile::tempdir().unwrap();
    let (mut views, maps) = (views(folder.path(), 3), folder.path().join("maps"));
    views[2].name = "kitchen/2".into();
    let maker = copying(folder.path(), [24, 32]);
    let calls = || std::fs::read_to_string(folder.path().join("calls")).map_or(0, |t| t.lines().count());
    let depths = |views: &[PerspectiveView], existing| {
        make(&maker, PriorContent::Depths, views, &maps, existing, &NoProgress)
    };
    assert_eq!(depths(&views[..2], ExistingMaps::Keep).unwrap(), counts(2, 0));
    assert_eq!(depths(&views, ExistingMaps::Keep).unwrap(), counts(1, 2));
    assert!(maps.join("photo.0.npy").exists() && maps.join("kitchen/2.npy").exists());
    assert_eq!((depths(&views, ExistingMaps::Update).unwrap(), calls()), (counts(0, 3), 3));

    // Another image, another script, and a map that is not known.
    write_png_rgb(&views[1].image, SIZE.0, SIZE.1, &[7; 3 * 64 * 48]).unwrap();
    let error = depths(&views, ExistingMaps::Keep).unwrap_err();
    assert!(matches!(&error, PriorError::OtherMap { path, .. } if path.ends_with("photo.1.npy")), "{error}");
    assert_eq!((depths(&views, ExistingMaps::Update).unwrap(), calls()), (counts(1, 2), 4));
    let script = folder.path().join("make it.sh");
    let text = std::fs::read_to_string(&script).unwrap() + "# otherwise\n";
    std::fs::write(&script, text).unwrap();
    assert_eq!((depths(&views, ExistingMaps::Update).unwrap(), calls()), (counts(3, 0), 7));
    assert_eq!((depths(&views, ExistingMaps::Replace).unwrap(), calls()), (counts(3, 0), 10));
    std::fs::remove_file(maps.join("photo.0.npy")).unwrap();
    assert_eq!((depths(&views, ExistingMaps::Keep).unwrap(), calls()), (counts(1, 2), 11));
    std::fs::write(maps.join("made_from.json"), "{").unwrap();
    assert!(matches!(depths(&views, ExistingMaps::Keep), Err(PriorError::OtherMap { .. })));
}

#[test]
#[cfg(unix)]
fn priors_by_a_command_are_kept_beside_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let (views, cache) = (views(folder.path(), 1), folder.path().join("priors"));
    std::fs::create_dir(&cache).unwrap();
    let depths = Some(PriorSource::Maker(copying(folder.path(), [48, 64])));
    let sources = PriorSources { depths, kind: Some(DepthKind::Metric), normals: None };
    for _ in 0..2 {
        let priors = read_priors(&sources, &[&views[0]], &[], &cache, &NoProgress).unwrap();
        assert_eq!(priors[0].depth.as_ref().unwrap().values.at(3, 0), 4.0);
    }
    let said = std::fs::read_to_string(cache.join("depths/prior.json")).unwrap();
    assert!(said.contains("metric"), "{said}");
    assert_eq!(std::fs::read_to_string(folder.path().join("calls")).unwrap().lines().count(), 1);
}

#[test]
#[cfg(unix)]
fn a_command_that_gives_no_usable_map_is_named_with_its_image() {
    let folder = tempfile::tempdir().unwrap();
    let views = views(folder.path(), 2);
    let refusal = |maker: &PriorMaker| {
        let maps = tempfile::tempdir().unwrap();
        make(maker, PriorContent::Depths, &views, maps.path(), ExistingMaps::Keep, &NoProgress).unwrap_err()
    };
    let error = refusal(&command(folder.path(), "echo one >&2\necho 'no weights' >&2\nexit 3\n"));
    assert!(matches!(error, PriorError::CommandFailed { .. }), "{error}");
    let text = error.to_string();
    assert!(text.contains("photo.0.png") && text.contains("exit status: 3"), "{text}");
    assert!(text.ends_with("one | no weights"), "{text}");
    let error = refusal(&command(folder.path(), "true\n"));
    assert!(matches!(error, PriorError::CommandSilent { .. }), "{error}");
    let error = refusal(&copying(folder.path(), [48, 48])).to_string();
    assert!(error.contains("photo.0.png` is of 48 x 48 pixels, expected the shape of 64 x 48"), "{error}");
    let error = refusal(&command(folder.path(), "echo text > \"$2\"\n")).to_string();
    assert!(error.contains("cannot be read: the file is no NumPy array"), "{error}");
    let absent = PriorMaker::Command(PriorCommand::parse("no-such-program {image} {out}").unwrap());
    let error = refusal(&absent);
    assert!(matches!(&error, PriorError::CommandStart { program, .. } if program == "no-such-program"));
}

#[test]
#[cfg(unix)]
fn views_that_do_not_match_keep_no_maps_of_another_maker() {
    let folder = tempfile::tempdir().unwrap();
    let (views, maps) = (views(folder.path(), 2), folder.path().join("maps"));
    let by = |maker: &PriorMaker| {
        make(maker, PriorContent::Depths, &views, &maps, ExistingMaps::Update, &NoProgress)
    };
    assert_eq!(by(&copying(folder.path(), [48, 64])).unwrap(), counts(2, 0));
    for view in &views {
        write_png_rgb(&view.image, SIZE.0, SIZE.1, &[90; 3 * SIZE.0 * SIZE.1]).unwrap();
    }
    // The same again says the same.
    for _ in 0..2 {
        let error = by(&PriorMaker::Stereo).unwrap_err();
        assert!(matches!(error, PriorError::Unusable { .. }), "{error}");
        assert!(!maps.join("photo.0.npy").exists() && !maps.join("photo.1.npy").exists());
    }
}

#[test]
#[cfg(unix)]
fn images_without_a_usable_map_are_left_out_unless_all_are() {
    let folder = tempfile::tempdir().unwrap();
    let views = views(folder.path(), 2);
    copying(folder.path(), [48, 64]);
    let flat = NpyArray { shape: vec![48, 64], values: vec![2.0; 48 * 64], kind: NumberKind::Float };
    flat.write(&folder.path().join("flat.npy")).unwrap();
    let here = folder.path().display();
    let script = format!("case \"$1\" in *0.png) f=flat;; *) f=map;; esac\ncp \"{here}/$f.npy\" \"$2\"\n");
    let maker = command(folder.path(), &script);
    let (maps, told) = (folder.path().join("maps"), Recorder::default());
    let made = make(&maker, PriorContent::Depths, &views, &maps, ExistingMaps::Keep, &told).unwrap();
    assert_eq!(made, MadeMaps { made: 1, kept: 0, left_out: 1 });
    let is_said = |text: &str| text.contains("photo.0.png` has the same depth everywhere");
    assert!(told.events().iter().any(|e| matches!(e, Event::Warning(text) if is_said(text))));
    let none = make(&maker, PriorContent::Depths, &views[..1], &maps, ExistingMaps::Keep, &told);
    assert!(matches!(none, Err(PriorError::Unusable { .. })));
}

/// Asks to stop after a time.
#[cfg(unix)]
struct After(Instant);

#[cfg(unix)]
impl Progress for After {
    fn event(&self, _: Event) {}

    fn is_cancelled(&self) -> bool {
        self.0.elapsed() > Duration::from_millis(200)
    }
}

#[test]
#[cfg(unix)]
fn a_command_that_hangs_is_stopped_with_all_that_it_has_started() {
    let folder = tempfile::tempdir().unwrap();
    let views = views(folder.path(), 1);
    let (late, maps) = (folder.path().join("late"), folder.path().join("maps"));
    let script = format!("echo waiting >&2\n(sleep 1.5; touch '{}') &\nwait\n", late.display());
    let maker = command(folder.path(), &script);
    let depths = |progress: &dyn Progress| {
        make(&maker, PriorContent::Depths, &views, &maps, ExistingMaps::Keep, progress)
    };
    let error = depths(&NoProgress).unwrap_err();
    assert!(matches!(&error, PriorError::CommandTime { said, .. } if said == "waiting"), "{error}");
    let error = depths(&After(Instant::now())).unwrap_err();
    assert!(matches!(error, PriorError::Interrupted { made: 0, total: 1 }), "{error}");
    std::thread::sleep(Duration::from_secs(2));
    assert!(!late.exists(), "what the command has started runs on");
}
