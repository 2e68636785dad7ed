//! Training of a small made perspective scene, from its COLMAP project to scores, pictures and a report.

use glam::{DMat3, DQuat, DVec2, DVec3};
use satgs::io::{NpyArray, NumberKind};
use satgs::perspective::{PerspectiveOptions, PinholeCamera};
use satgs::pipeline::{
    DsmOptions, NvsOptions, Outcome, PipelineError, RenderOptions, TrainOptions, Viewpoint, dsm, nvs_eval,
    render, train,
};
use satgs::prior::PriorSource;
use satgs::progress::{Event, NoProgress, Progress, Recorder};
use satgs::random::CounterRng;
use satgs::run::{AnyScene, RunError, RunOptions, StageResult};
use satgs::splat::pinhole::{NEAREST, PinholePicture};
use satgs::splat::ply;
use satgs::splat::recipe::StartPoints;
use satgs::splat::splats::Splats;
use std::fmt::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};

const SIZE: (usize, usize) = (64, 48);
const VIEWS: u32 = 9;

/// Cameras on a circle of 4 m that look at the origin from above.
fn camera(k: u32) -> PinholeCamera {
    let (sin, cos) = (f64::from(k) * 0.35).sin_cos();
    let center = DVec3::new(4.0 * cos, 4.0 * sin, 1.5);
    let forward = (-center).normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let cam_from_site = DMat3::from_cols(right, forward.cross(right), forward).transpose();
    let principal = DVec2::new(31.5, 23.5);
    PinholeCamera { cam_from_site, center, focal: DVec2::splat(55.0), principal, size: SIZE }
}

/// A ball of coloured splats, photographed from all cameras, as a COLMAP project in text form.
fn make_scene(folder: &Path) -> PathBuf {
    let scene = folder.join("scene");
    let model = scene.join("sparse/0");
    std::fs::create_dir_all(&model).unwrap();
    std::fs::create_dir_all(scene.join("images")).unwrap();
    let mut splats = Splats::default();
    let mut points = String::new();
    for i in 0..400 {
        let mut draw = CounterRng::new(5, 0, 0, i);
        let p = draw.direction();
        let rgb = p.map(|v| (0.5 + 0.45 * (3.0 * v).sin()) as f32);
        splats.push(p.map(|v| v as f32), 0.12, 0.95, rgb);
        let [r, g, b] = rgb.map(|v| (255.0 * v) as u8);
        let near = p.map(|v| v + 0.02 * draw.normal());
        writeln!(points, "{} {} {} {} {r} {g} {b} 0.5", i + 1, near[0], near[1], near[2]).unwrap();
    }
    let mut images = String::new();
    for k in 0..VIEWS {
        let camera = camera(k);
        let picture = PinholePicture::render(&splats, &camera, NEAREST);
        let pixels = 0..SIZE.0 * SIZE.1;
        let rgb: Vec<u8> = pixels
            .flat_map(|i| picture.colors.each_ref().map(|c| (255.0 * c.data[i]).round() as u8))
            .collect();
        satgs::io::write_png_rgb(&scene.join(format!("images/{k}.png")), SIZE.0, SIZE.1, &rgb).unwrap();
        let q = DQuat::from_mat3(&camera.cam_from_site);
        let t = -(camera.cam_from_site * camera.center);
        writeln!(images, "{} {} {} {} {} {} {} {} 1 {k}.png\n", k + 1, q.w, q.x, q.y, q.z, t.x, t.y, t.z)
            .unwrap();
    }
    std::fs::write(model.join("cameras.txt"), "1 PINHOLE 64 48 55 55 32 24\n").unwrap();
    std::fs::write(model.join("images.txt"), images).unwrap();
    std::fs::write(model.join("points3D.txt"), points).unwrap();
    scene
}

fn options(iterations: u32) -> RunOptions {
    let defaults = RunOptions::of_photographs();
    let train = TrainOptions { iterations: Some(iterations), checkpoint_every: 50, ..defaults.train };
    RunOptions { train, ..defaults }
}

/// Reads the photographs and runs all stages.
fn run_photographs(
    scene: &Path,
    reading: &PerspectiveOptions,
    options: &RunOptions,
    run: &Path,
    progress: &dyn Progress,
) -> Result<(), RunError> {
    let scene = AnyScene::read_photographs(scene, reading)?;
    satgs::run::run(scene, options, run, progress, &mut |_| {})
}

fn run(
    scene: &Path,
    run: &Path,
    iterations: u32,
    threads: usize,
    progress: &dyn Progress,
) -> Result<f64, RunError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let mut psnr_db = 0.0;
    let mut completed = |result: StageResult| {
        if let StageResult::Scored(scores) = result {
            psnr_db = scores.mean.unwrap().psnr_db;
        }
    };
    let photographs = AnyScene::read_photographs(scene, &PerspectiveOptions::default())?;
    pool.install(|| satgs::run::run(photographs, &options(iterations), run, progress, &mut completed))?;
    Ok(psnr_db)
}

#[test]
fn a_run_gives_the_same_bytes_for_any_number_of_threads_and_after_an_interruption() {
    let folder = tempfile::tempdir().unwrap();
    let scene = make_scene(folder.path());
    let splats = |name: &str| std::fs::read(folder.path().join(name).join("splats.ply")).unwrap();
    let path = |name: &str| folder.path().join(name);
    let psnr_db = run(&scene, &path("one"), 240, 1, &NoProgress).unwrap();
    assert!(psnr_db > 22.0, "{psnr_db}");
    // Two threads until the interruption, then three.
    let stop = Recorder::cancelling(|e| matches!(e, Event::Advanced { done: 130, .. }));
    let interrupted = run(&scene, &path("two"), 240, 2, &stop).unwrap_err();
    assert!(
        matches!(interrupted, RunError::Pipeline(PipelineError::TrainingInterrupted { .. })),
        "{interrupted}"
    );
    assert!(path("two/train/checkpoint.bin").exists());
    run(&scene, &path("two"), 240, 3, &NoProgress).unwrap();
    assert!(splats("one") == splats("two"), "other threads or an interruption give different splats");
    assert!(!path("two/train/checkpoint.bin").exists());

    // The splats have harmonics, the number of splats changes, and the products are there.
    let trained = ply::read(&path("one/splats.ply")).unwrap();
    assert!(trained.f_rest.len() == trained.len() && trained.len() > 100);
    for file in
        ["scene.json", "cameras.json", "train/train.csv", "train/curves.svg", "eval/nvs.json", "report.html"]
    {
        assert!(path("one").join(file).exists(), "{file}");
    }
    assert!(!path("one/splats.georef.json").exists() && !path("one/dsm.tif").exists());
    let page = std::fs::read_to_string(path("one/report.html")).unwrap();
    assert!(page.contains("Views held back") && page.contains("data:image/png"));

    // The same again is kept, another number of iterations is refused.
    let same = train(&path("one"), &options(240).train, &NoProgress).unwrap();
    assert!(matches!(same, Outcome::Kept(Some(_))));
    let other = train(&path("one"), &options(100).train, &NoProgress).unwrap_err().to_string();
    assert!(other.contains("--iterations was 240, is 100"), "{other}");
    let smaller = PerspectiveOptions { downsampling: 2, ..PerspectiveOptions::default() };
    let refused = run_photographs(&scene, &smaller, &options(240), &path("one"), &NoProgress);
    let refused = refused.unwrap_err().to_string();
    assert!(refused.contains("--downsampling was 1, is 2"), "{refused}");
    // The refused call has changed nothing: the run is scored with the images that it was trained on.
    render_and_refuse(&path("one"));
}

fn render_and_refuse(run: &Path) {
    let like =
        |name: &str| RenderOptions { viewpoint: Viewpoint::Like(name.into()), ..RenderOptions::default() };
    render(run, &run.join("view.png"), &like("3"), &NoProgress).unwrap();
    render(run, &run.join("depth.tif"), &RenderOptions { depth: true, ..like("3") }, &NoProgress).unwrap();
    let file = satgs::io::ImageFile::open(&run.join("depth.tif")).unwrap();
    assert_eq!((file.size(), file.bands()), (SIZE, 1));
    let depth = file.read(1).unwrap();
    // The ball's nearest point is 1 m nearer than its middle.
    let middle = camera(3).center.length();
    assert!((f64::from(depth.at(31, 23)) - (middle - 1.0)).abs() < 0.3, "{}", depth.at(31, 23));
    assert!(depth.at(0, 0).is_nan());

    let scores =
        nvs_eval(run, &NvsOptions { views: vec!["1".to_owned()], ..NvsOptions::default() }, &NoProgress)
            .unwrap();
    assert!(scores.views.len() == 1 && scores.views[0].score.pixels == SIZE.0 * SIZE.1);
    let refusals = [
        render(run, &run.join("a.png"), &like("none"), &NoProgress).err().unwrap().to_string(),
        render(run, &run.join("a.png"), &RenderOptions::default(), &NoProgress).err().unwrap().to_string(),
        dsm(run, &DsmOptions::default(), &NoProgress).err().unwrap().to_string(),
        train(run, &TrainOptions::default(), &NoProgress).err().unwrap().to_string(),
        satgs::pipeline::read_scene(run).err().unwrap().to_string(),
    ];
    let says =
        ["none", "--view", "georeference", "recipe `best` is for satellite scenes", "perspective scene"];
    for (refusal, says) in refusals.iter().zip(says) {
        assert!(refusal.contains(says), "{refusal}");
    }
}

#[test]
fn what_cannot_be_trained_is_refused_before_training() {
    let folder = tempfile::tempdir().unwrap();
    let scene = make_scene(folder.path());
    let out = folder.path().join("run");
    let usual = PerspectiveOptions::default();
    let refused = |options: &RunOptions| {
        run_photographs(&scene, &usual, options, &out, &NoProgress).unwrap_err().to_string()
    };
    let mut other = options(10);
    other.train.recipe = "baeogs".into();
    assert!(refused(&other).contains("recipe `baeogs` is for satellite scenes"));
    other.train.recipe = "4dgs".into();
    assert!(refused(&other).contains("4dgs"));
    let listed = satgs::perspective::TestViews::List(folder.path().join("no.txt"));
    let missing = PerspectiveOptions { test_views: listed, ..usual.clone() };
    let missing = run_photographs(&scene, &missing, &options(10), &out, &NoProgress).unwrap_err();
    assert!(missing.to_string().contains("no.txt"));
    assert!(!out.join("scene.json").exists());
    std::fs::write(scene.join("images/4.png"), "no image").unwrap();
    let broken = refused(&options(10));
    assert!(broken.contains("4.png"), "{broken}");
}

/// Writes the depth of the ball at each pixel of all images.
fn write_depths(folder: &Path, scale: f64) {
    std::fs::create_dir_all(folder).unwrap();
    for k in 0..VIEWS {
        let camera = camera(k);
        let pixel = |i: usize| {
            let px = satgs::frame::Pixel::new((i % SIZE.0) as f64, (i / SIZE.0) as f64);
            let ray = DVec3::from_array(camera.ray(px));
            let middle = ray.dot(camera.center);
            let p = ray * (-middle - (middle * middle - camera.center.length_squared() + 1.0).sqrt());
            (scale * (camera.cam_from_site * p).z) as f32
        };
        let values = (0..SIZE.0 * SIZE.1).map(pixel).collect();
        let array = NpyArray { shape: vec![SIZE.1, SIZE.0], values, kind: NumberKind::Float };
        array.write(&folder.join(format!("{k}.npy"))).unwrap();
    }
}

#[test]
fn recipe_indoor_trains_with_priors_and_notices_when_they_change() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, run, depths) =
        (make_scene(folder.path()), folder.path().join("run"), folder.path().join("depths"));
    write_depths(&depths, 1.0);
    let mut with_depths = options(60);
    with_depths.train.recipe = "indoor".into();
    with_depths.train.priors.depths = Some(PriorSource::Folder(depths.clone()));
    let told = Recorder::default();
    run_photographs(&scene, &PerspectiveOptions::default(), &with_depths, &run, &told).unwrap();
    let notes = format!("{:?}", told.events());
    assert!(notes.contains("are relative, as the points of the scene show"), "{notes}");
    assert!(
        notes.contains("depths of 7 views are aligned") && notes.contains("and with each other"),
        "{notes}"
    );
    assert!(
        notes.contains("without --normal-prior the recipe's loss term normal_prior is left out"),
        "{notes}"
    );
    let log = std::fs::read_to_string(run.join("train/train.csv")).unwrap();
    let column = log.lines().next().unwrap().split(',').position(|name| name == "depth_prior").unwrap();
    let values = log.lines().skip(1).map(|line| line.split(',').nth(column).unwrap().parse::<f64>().unwrap());
    let values: Vec<f64> = values.collect();
    assert!(values[..10].iter().all(|v| *v == 0.0) && values[50..].iter().all(|v| *v > 0.0), "{values:?}");

    let again = train(&run, &with_depths.train, &NoProgress).unwrap();
    assert!(matches!(again, Outcome::Kept(_)));
    write_depths(&depths, 2.0);
    let changed = train(&run, &with_depths.train, &NoProgress).unwrap_err().to_string();
    assert!(changed.contains("--depth-prior has changed"), "{changed}");
    let mut without_terms = options(60);
    without_terms.train.priors.depths = Some(PriorSource::Folder(depths));
    let refused = run_photographs(
        &scene,
        &PerspectiveOptions::default(),
        &without_terms,
        &folder.path().join("2"),
        &NoProgress,
    );
    let refused = refused.unwrap_err().to_string();
    assert!(
        refused.contains("`--depth-prior` is") && refused.contains("indoor and geoprop use it"),
        "{refused}"
    );
}

#[test]
fn recipe_geoprop_starts_from_aligned_depths() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, run, depths) =
        (make_scene(folder.path()), folder.path().join("run"), folder.path().join("depths"));
    write_depths(&depths, 0.2);
    let mut with_depths = options(40);
    with_depths.train.recipe = "geoprop".into();
    with_depths.train.priors.depths = Some(PriorSource::Folder(depths));
    let told = Recorder::default();
    run_photographs(&scene, &PerspectiveOptions::default(), &with_depths, &run, &told).unwrap();
    let notes = format!("{:?}", told.events());
    assert!(notes.contains("depths of 7 views are aligned"), "{notes}");
    assert!(!notes.contains("and with each other"), "{notes}");
    let share_from_middle = |run: &Path, distances: Range<f32>| {
        let splats = ply::read(&run.join("splats.ply")).unwrap();
        assert!(splats.len() > 1500, "{} splats", splats.len());
        let distance = |p: &[f32; 3]| p[0].hypot(p[1]).hypot(p[2]);
        let within = splats.position.iter().filter(|p| distances.contains(&distance(p))).count();
        within as f64 / splats.len() as f64
    };
    let on_ball = share_from_middle(&run, 0.9..1.1);
    assert!(on_ball > 0.9, "{on_ball}");
    assert!(run.join("train/start/1.png").exists());
    assert!(std::fs::read_to_string(run.join("report.html")).unwrap().contains("Aligned depths"));

    // Any recipe may start so, and geoprop runs without priors, and says so.
    with_depths.train.recipe = "3dgs".into();
    with_depths.train.start = Some(StartPoints::Hdd);
    run_photographs(
        &scene,
        &PerspectiveOptions::default(),
        &with_depths,
        &folder.path().join("2"),
        &NoProgress,
    )
    .unwrap();
    let mut without = options(20);
    without.train.recipe = "geoprop".into();
    let told = Recorder::default();
    run_photographs(&scene, &PerspectiveOptions::default(), &without, &folder.path().join("3"), &told)
        .unwrap();
    let notes = format!("{:?}", told.events());
    assert!(notes.contains("depths are interpolated between the points"), "{notes}");
    assert!(notes.contains("depths of 7 views are aligned"), "{notes}");
    // Pixels beside the ball have depths of its rim.
    let near_ball = share_from_middle(&folder.path().join("3"), 0.0..3.0);
    assert!(near_ball > 0.95, "{near_ball}");
}
