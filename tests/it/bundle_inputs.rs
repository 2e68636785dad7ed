//! Bundle adjustment of inputs that are wrong: a clear error or a right answer, never a wrong one in silence. What it
//! leaves on disk, and what ground control does.

use crate::common::{disagreement_px, satgs};
use gdal::vector::LayerAccess;
use satgs::bundle::{
    Adjustment, BundleError, BundleOptions, ControlPoint, adjust, check_control, read_control,
};
use satgs::frame::{Pixel, Point, SiteGrid};
use satgs::io::{Cog, Grid2, MapGrid, SensorImage, VerticalReference, Window};
use satgs::progress::{Event, NoProgress, Recorder};
use satgs::rpc::Rpc;
use satgs::rpc::formats::{self, to_gdal};
use satgs::scene::{ReadOptions, Scene, SceneError, View, read};
use satgs::simulate::{self, simulate};
use std::path::Path;

const SIZE: usize = 300;
/// Heights of the simulated town and its surroundings, metres.
const HEIGHTS: (f64, f64) = (120.0, 220.0);

/// A simulated scene of five views, its folder beside it.
fn town() -> (tempfile::TempDir, Scene) {
    town_of(5)
}

fn town_of(views: usize) -> (tempfile::TempDir, Scene) {
    let folder = tempfile::tempdir().unwrap();
    let options = simulate::SimulateOptions { views, size_px: SIZE, ..simulate::SimulateOptions::default() };
    simulate(folder.path(), &options, &NoProgress).unwrap();
    let scene = read(folder.path(), &ReadOptions::default()).unwrap();
    (folder, scene)
}

fn adjusted(scene: &Scene) -> Result<Adjustment, BundleError> {
    let options = BundleOptions { height_range: Some(HEIGHTS), ..BundleOptions::default() };
    adjust(scene, &options, &NoProgress)
}

/// Writes a grey image with a view's RPC.
fn write(scene: &Scene, view: usize, path: &Path, pixels: Vec<u8>) {
    let rpc = to_gdal(&scene.views[view].rpc);
    let image = SensorImage { width: SIZE, height: SIZE, rpc: &rpc, metadata: &[] };
    image.write_u8(path, vec![pixels]).unwrap();
}

fn true_cameras(folder: &Path, made: &Adjustment) -> Vec<(Rpc, Rpc)> {
    let truth = |name: &str| formats::read(&folder.join(format!("truth/rpcs/{name}.json"))).unwrap().rpc;
    made.cameras.iter().map(|(name, rpc)| (rpc.clone(), truth(name))).collect()
}

#[test]
fn images_with_exchanged_cameras_are_refused() {
    let (_folder, mut scene) = town();
    let images: Vec<_> = scene.views.iter().map(|v| v.image.clone()).collect();
    for (i, view) in scene.views.iter_mut().enumerate() {
        view.image.clone_from(&images[(i + 1) % images.len()]);
    }
    let error = adjusted(&scene).unwrap_err();
    assert!(matches!(error, BundleError::NotConnected { .. }), "{error}");
}

/// Two views with each other's cameras agree in themselves: roofs are pits to them.
#[test]
fn views_with_exchanged_cameras_are_left_out() {
    let (_folder, mut scene) = town_of(6);
    let second = scene.views[1].rpc.clone();
    scene.views[1].rpc = std::mem::replace(&mut scene.views[0].rpc, second);
    let made = adjusted(&scene).unwrap();
    let mut left_out: Vec<&str> = made.report.left_out.iter().map(|(name, _)| name.as_str()).collect();
    left_out.sort_unstable();
    assert_eq!(left_out, ["VIEW_01", "VIEW_02"]);
}

#[test]
fn a_copy_of_an_image_in_another_file_is_left_out() {
    let (folder, mut scene) = town();
    let mut copy = scene.views[0].clone();
    copy.image = folder.path().join("copy.tif");
    copy.name = "copy".into();
    let file = satgs::io::ImageFile::open(&scene.views[0].image).unwrap();
    let pixels: Vec<u8> = file.read(1).unwrap().data.iter().map(|v| *v as u8).collect();
    (copy.rpc, copy.bands) = (scene.views[1].rpc.clone(), vec![1]);
    write(&scene, 1, &copy.image, pixels);
    scene.views[0].bands = vec![1];
    scene.views.push(copy);
    let made = adjusted(&scene).unwrap();
    assert_eq!(made.report.left_out, [("copy".to_owned(), "its pixels are those of `VIEW_01`".to_owned())]);
}

#[test]
fn an_image_upside_down_is_left_out() {
    let (folder, mut scene) = town();
    let view = &scene.views[2];
    let whole = Window { col: 0, row: 0, width: view.width, height: view.height };
    let gray = view.gray_image().unwrap().read(whole).unwrap();
    let turned = folder.path().join("turned.tif");
    write(&scene, 2, &turned, gray.data.iter().rev().map(|v| (255.0 * v) as u8).collect());
    scene.views[2].image = turned;
    scene.views[2].bands = vec![1];
    let left_out = adjusted(&scene).unwrap().report.left_out;
    assert_eq!(left_out.len(), 1, "{left_out:?}");
    let (name, reason) = &left_out[0];
    assert!(*name == scene.views[2].name && reason.contains("no match connects"), "{left_out:?}");
}

#[test]
fn a_constant_image_is_left_out_and_constant_images_are_refused() {
    let (folder, mut scene) = town();
    let plain = folder.path().join("plain.tif");
    write(&scene, 1, &plain, vec![90; SIZE * SIZE]);
    scene.views[1].image.clone_from(&plain);
    scene.views[1].bands = vec![1];
    let made = adjusted(&scene).unwrap();
    assert_eq!(made.cameras.len(), 4);
    assert_eq!(made.report.left_out[0].0, scene.views[1].name);
    assert!(made.report.left_out[0].1.contains("constant"));
    for view in &mut scene.views {
        view.image.clone_from(&plain);
        view.bands = vec![1];
    }
    assert!(matches!(adjusted(&scene), Err(BundleError::TooFewViews { usable: 0, all: 5, .. })));
}

#[test]
fn an_adjustment_that_leaves_out_a_view_reports_so_every_time() {
    let (folder, scene) = town();
    let image = &scene.views[1].image;
    write(&scene, 1, image, vec![90; SIZE * SIZE]);
    let (scene_path, run) = (folder.path().to_str().unwrap(), folder.path().join("run"));
    let name = &scene.views[1].name;
    for again in [false, true] {
        let output = satgs(&["ba", scene_path, "-o", run.to_str().unwrap(), "--json"]);
        let (told, json) = (String::from_utf8_lossy(&output.stderr), String::from_utf8_lossy(&output.stdout));
        assert_eq!(output.status.code(), Some(3), "{told}");
        assert!(told.contains(&format!("adjusted without `{name}`")), "{told}");
        assert_eq!(told.contains("is adjusted already"), again, "{told}");
        assert!(again || json.contains(&format!("[\"{name}\",")), "{json}");
    }
    assert!(run.join("ba/points.laz").exists());
}

#[test]
fn heights_wrong_by_a_kilometre_are_refused() {
    let (_folder, scene) = town();
    for off in [-1000.0, 1000.0] {
        let options = BundleOptions {
            height_range: Some((HEIGHTS.0 + off, HEIGHTS.1 + off)),
            ..BundleOptions::default()
        };
        let made = adjust(&scene, &options, &NoProgress);
        assert!(made.is_err(), "{off}: {:?}", made.map(|m| m.report.table()));
    }
}

#[test]
fn fixed_cameras_are_unchanged_and_bad_ones_are_reported() {
    let (folder, mut scene) = town();
    for view in &mut scene.views {
        view.rpc = formats::read(&folder.path().join(format!("truth/rpcs/{}.json", view.name))).unwrap().rpc;
    }
    let fixed = BundleOptions { fixed: true, height_range: Some(HEIGHTS), ..BundleOptions::default() };
    let good = adjust(&scene, &fixed, &NoProgress).unwrap();
    assert!(good.report.mean_px < 0.2, "{}", good.report.table());
    scene.views[3].rpc = scene.views[3].rpc.shifted(-1.0, -36.0);
    let bad = adjust(&scene, &fixed, &NoProgress).unwrap();
    for (view, (_, rpc)) in scene.views.iter().zip(&bad.cameras) {
        assert_eq!(&view.rpc, rpc);
    }
    let report = &bad.report;
    assert!(report.mean_px > 1.0 && report.mean_px == report.mean_before_px, "{}", report.table());
    let [col, row] = report.views[3].shift_px;
    assert!((col - 1.0).abs() < 1.0 && (row - 36.0).abs() < 1.5, "{}", report.table());
    assert!(report.views.iter().enumerate().all(|(v, r)| v == 3 || r.shift_px[1].abs() < 1.5));
}

#[test]
fn ground_control_determines_the_position_of_the_scene() {
    let (folder, scene) = town();
    let file = folder.path().join("gcps.csv");
    let mut text = String::from("lon, lat, h, image, col, row, sigma_xy_m, sigma_h_m, sigma_px\n");
    let center = scene.center().unwrap();
    let site = SiteGrid::at(center).unwrap();
    for (i, [e, n]) in [[-40.0, -40.0], [40.0, -40.0], [0.0, 45.0], [-40.0, 30.0]].into_iter().enumerate() {
        let p = site.geodetic_from_site(Point::new(e, n, 4.0 * i as f64));
        for view in &scene.views[i % 2..4] {
            let truth = formats::read(&folder.path().join(format!("truth/rpcs/{}.json", view.name)));
            let px = truth.unwrap().rpc.project(p);
            let [lon, lat, h] = p.xyz();
            text +=
                &format!("{lon:.9},{lat:.9},{h:.3},{},{:.3},{:.3},0.1,0.1,0.3\n", view.name, px.col, px.row);
        }
    }
    std::fs::write(&file, &text).unwrap();
    let control = read_control(&file).unwrap();
    assert_eq!(control.len(), 14);
    check_control(&file, &control, &scene).unwrap();
    let refused = |change: fn(&mut ControlPoint), words: &[&str]| {
        let mut wrong = control.clone();
        change(&mut wrong[2]);
        let error = check_control(&file, &wrong, &scene).unwrap_err();
        let help = miette::Diagnostic::help(&error).map(|h| h.to_string()).unwrap_or_default();
        let said = format!("{error} {help}");
        assert!(["gcps.csv", "line 4"].iter().chain(words).all(|w| said.contains(w)), "{said}");
    };
    refused(
        |c| c.place = Point::new(c.place.lat_deg(), c.place.lon_deg(), c.place.height_m()),
        &["km from where", "lon and lat are swapped"],
    );
    refused(
        |c| c.place = Point::new(c.place.lon_deg() + 0.05, c.place.lat_deg(), c.place.height_m()),
        &[" m from where", "datum"],
    );
    refused(|c| c.px.col += 5000.0, &["is outside of", "crop"]);
    refused(|c| c.image = "elsewhere".into(), &["`elsewhere` is not in the scene"]);

    // Nothing is held by points that agree with nothing.
    let off = control.iter().map(|c| {
        let [lon, lat, h] = c.place.xyz();
        let sign = if c.line % 2 == 0 { 0.004 } else { -0.004 };
        ControlPoint { place: Point::new(lon + sign, lat - sign, h), ..c.clone() }
    });
    let options =
        BundleOptions { height_range: Some(HEIGHTS), control: off.collect(), ..BundleOptions::default() };
    let made = adjust(&scene, &options, &NoProgress).unwrap();
    assert!(made.report.control.iter().all(|c| !c.agrees && c.line > 1), "{:?}", made.report.control);
    assert!(!made.report.gauge.starts_with("ground control"), "{}", made.report.gauge);
    assert!(made.report.table().contains("line 2 ("), "{}", made.report.table());

    let options = BundleOptions { height_range: Some(HEIGHTS), control, ..BundleOptions::default() };
    let made = adjust(&scene, &options, &NoProgress).unwrap();
    assert_eq!(made.report.control.len(), 14);
    assert!(made.report.control.iter().all(|c| c.agrees), "{:?}", made.report.control);
    assert_eq!(made.report.gauge, "ground control");
    // Not a common translation apart, as without control, but where they are.
    for (found, exact) in true_cameras(folder.path(), &made) {
        let off = found.project(center).distance(exact.project(center));
        assert!(off < 0.15, "{off} px");
    }

    let stray = vec![ControlPoint { image: "elsewhere".into(), ..read_control(&file).unwrap()[0].clone() }];
    let error = adjust(&scene, &BundleOptions { control: stray, ..options }, &NoProgress).unwrap_err();
    assert!(error.to_string().contains("`elsewhere`"), "{error}");
}

#[test]
fn invalid_ground_control_is_refused_by_line_and_field() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("gcps.csv");
    let header = "lon,lat,h,image,col,row,sigma_xy_m,sigma_h_m,sigma_px\n";
    for (text, said) in [
        ("lon,lat,h,image,col,row\n5.4,43.2,100,a,1,2\n", "sigma_xy_m"),
        (&*format!("{header}5.4,43.2,100,a,1,2,0.1,0.1,0\n"), "line 2: `sigma_px` is 0"),
        (&*format!("{header}5.4,143.2,100,a,1,2,0.1,0.1,1\n"), "line 2: `lat` is 143.2"),
        (&*format!("{header}5.4,43.2,NaN,a,1,2,0.1,0.1,1\n"), "line 2: `h` is NaN"),
        (header, "no point"),
        (
            &*format!("{header}5.4,43.2,100,a,1,2,0.1,0.1,1\n").replace(',', ";"),
            "line 1: the columns are separated by semicolons",
        ),
    ] {
        std::fs::write(&file, text).unwrap();
        let error = read_control(&file).unwrap_err().to_string();
        assert!(error.contains("gcps.csv") && error.contains(said), "{error}");
    }
}

#[test]
fn the_command_writes_cameras_tie_points_and_figures() {
    let (folder, _) = town();
    let run = tempfile::tempdir().unwrap();
    let (input, output) = (folder.path().to_str().unwrap(), run.path().to_str().unwrap());
    let done = satgs(&["ba", input, "-o", output, "--model", "affine"]);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let ba = run.path().join("ba");
    let made = Adjustment::read(&ba).unwrap();
    let csv = std::fs::read_to_string(ba.join("tie_points.csv")).unwrap();
    assert_eq!(csv.lines().count(), made.report.observations + 1);
    let package = gdal::Dataset::open(ba.join("tie_points.gpkg")).unwrap();
    assert_eq!(package.layer(0).unwrap().feature_count() as usize, made.report.tracks);
    for picture in ["residuals.svg", "histogram.svg", "graph.svg", "angles.svg"] {
        assert!(std::fs::metadata(ba.join(picture)).unwrap().len() > 1000, "{picture}");
    }
    let counted: usize = made.report.histogram.iter().map(|bin| bin[1]).sum();
    assert_eq!(counted, made.report.observations);
    let middle = Pixel::new(SIZE as f64 / 2.0, SIZE as f64 / 2.0);
    let off = disagreement_px(&true_cameras(folder.path(), &made), middle);
    assert!(off.iter().all(|d| *d < 0.15), "{off:?}");
}

/// Its only neighbour looks from the same direction: their tracks have no heights, and none is left.
#[test]
fn a_view_that_keeps_no_track_is_left_out() {
    let (_folder, mut scene) = town();
    let part = |view: usize, name: &str, col: usize, width: usize| {
        let whole = &scene.views[view];
        let window = Some(Window { col, row: 0, width, height: SIZE });
        View { name: name.into(), width, window, rpc: whole.rpc.cropped(col, 0), ..whole.clone() }
    };
    let views = vec![scene.views[0].clone(), part(1, "left", 0, 112), part(0, "right", 220, 80)];
    scene.views = views;
    let progress = Recorder::default();
    let options = BundleOptions { height_range: Some(HEIGHTS), ..BundleOptions::default() };
    let report = adjust(&scene, &options, &progress).unwrap().report;
    assert!(report.left_out.iter().any(|l| l.0 == "right"), "{}", report.table());
    let warnings = progress.events().into_iter().filter_map(|e| match e {
        Event::Warning(text) => Some(text),
        _ => None,
    });
    assert_eq!(warnings.collect::<Vec<_>>(), ["view `right` is left out: it has only 0 tie points"]);
}

#[test]
fn an_adjustment_can_be_cancelled() {
    let (_folder, scene) = town();
    let options = BundleOptions { height_range: Some(HEIGHTS), ..BundleOptions::default() };
    for stage in ["finding features", "matching", "measuring patches"] {
        let begins = move |e: &Event| matches!(e, Event::Started { stage: s, .. } if *s == stage);
        let progress = Recorder::cancelling(begins);
        let error = adjust(&scene, &options, &progress).unwrap_err();
        assert!(matches!(error, BundleError::Interrupted(_)), "{stage}: {error}");
        assert!(begins(progress.events().last().unwrap()), "{stage} goes on");
    }
}

/// Turns a view's image and leaves its camera as it was.
fn turn(folder: &Path, scene: &mut Scene, view: usize, degrees: f64) {
    let whole = Window { col: 0, row: 0, width: SIZE, height: SIZE };
    let gray = scene.views[view].gray_image().unwrap().read(whole).unwrap();
    let middle = 0.5 * (SIZE as f64 - 1.0);
    let (sin, cos) = degrees.to_radians().sin_cos();
    let pixel = |i: usize| {
        let (x, y) = ((i % SIZE) as f64 - middle, (i / SIZE) as f64 - middle);
        (255.0 * gray.bilinear(middle + cos * x + sin * y, middle + cos * y - sin * x)) as u8
    };
    let turned = folder.join(format!("turned{degrees}.tif"));
    write(scene, view, &turned, (0..SIZE * SIZE).map(pixel).collect());
    scene.views[view].image = turned;
    scene.views[view].bands = vec![1];
}

#[test]
fn a_turned_image_is_left_out_or_named_whatever_the_angle() {
    let (folder, scene) = town();
    for degrees in [2.0, 10.0, 90.0] {
        let mut scene = scene.clone();
        turn(folder.path(), &mut scene, 2, degrees);
        let name = &scene.views[2].name;
        match adjusted(&scene) {
            Err(e) => assert!(e.to_string().contains(&format!("{{{name}}}")), "{degrees}°: {e}"),
            Ok(made) => {
                let is_left_out = made.report.left_out.iter().any(|l| l.0 == *name);
                assert!(is_left_out, "{degrees}°:\n{}", made.report.table());
            }
        }
    }
}

#[test]
fn a_camera_a_kilometre_too_high_is_named() {
    let (_folder, mut scene) = town();
    scene.views[4].rpc = scene.views[4].rpc.moved_on_ground([0.0, 0.0, 1000.0]);
    let error = adjust(&scene, &BundleOptions::default(), &NoProgress).unwrap_err();
    let BundleError::Scene(SceneError::NoSharedHeights { view, .. }) = error else { panic!("{error}") };
    assert_eq!(view, scene.views[4].name);
}

#[test]
fn views_of_one_direction_are_refused() {
    let (_folder, mut scene) = town();
    scene.views.truncate(2);
    scene.views[1].rpc = scene.views[0].rpc.clone();
    assert!(matches!(adjusted(&scene), Err(BundleError::NoBaseline { .. })));
}

/// A view before it is left out: the reference is known by its name, not by its number.
#[test]
fn a_reference_view_is_unchanged_and_must_exist() {
    let (folder, mut scene) = town();
    let plain = folder.path().join("plain.tif");
    write(&scene, 0, &plain, vec![90; SIZE * SIZE]);
    scene.views[0].image = plain;
    scene.views[0].bands = vec![1];
    let with = |name: &str| {
        let options = BundleOptions {
            reference: vec![name.into()],
            height_range: Some(HEIGHTS),
            ..BundleOptions::default()
        };
        adjust(&scene, &options, &NoProgress)
    };
    let made = with(&scene.views[3].name).unwrap();
    assert_eq!(made.cameras.len(), 4);
    for (view, (name, rpc)) in scene.views[1..].iter().zip(&made.cameras) {
        assert_eq!(&view.name, name);
        assert_eq!(view.rpc == *rpc, *name == scene.views[3].name, "{name}");
    }
    for (name, said) in [("elsewhere", "is not in the scene"), (&*scene.views[0].name, "is left out")] {
        let error = with(name).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains(said), "{error}");
    }
}

/// What the elevation model tells is what is searched.
#[test]
fn an_elevation_model_a_kilometre_off_is_refused() {
    let (folder, scene) = town();
    let work = tempfile::tempdir().unwrap();
    let site = SiteGrid::at(scene.center().unwrap()).unwrap();
    let (west, north) = (site.origin.x().round() - 500.0, site.origin.y().round() + 500.0);
    let grid = MapGrid { epsg: site.epsg, west, north, cell: 10.0, width: 100, height: 100 };
    for (off, code) in [(0.0, 0), (1000.0, 2)] {
        let (dem, run) = (work.path().join("dem.tif"), work.path().join(format!("run{off}")));
        let cog = Cog { grid, metadata: &[], heights_from: Some(&VerticalReference::Ellipsoid) };
        cog.write_f32(&dem, &[("height", "m", &Grid2::filled(100, 100, 150.0 + off))]).unwrap();
        let [scene, run, dem] = [folder.path(), &run, &dem].map(|p| p.to_str().unwrap());
        let done = satgs(&["ba", scene, "-o", run, "--dem", dem, "-q"]);
        assert_eq!(done.status.code(), Some(code), "{}", String::from_utf8_lossy(&done.stderr));
    }
}
