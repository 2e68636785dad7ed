//! Prediction of satellite scenes.

use super::belonging::{KnownPoint, require_near};
use super::points::{of_surface, read_points};
use super::splats::of_points;
use super::{Output, PredictOptions, Predicted, read_model};
use crate::affine::{SiteScene, SiteSceneError, SiteView};
use crate::bundle::Adjustment;
use crate::coregister::{self, Shift};
use crate::frame::{Point, SiteGrid};
use crate::io::{Grid2, MapGrid, WriteError, write_json};
use crate::metrics::HeightRaster;
use crate::mvs::MatchedSurface;
use crate::pipeline::run_folder::satellite_cameras::require_images;
use crate::pipeline::run_folder::stage::{Outcome, adjustment_fingerprint, hash_file};
use crate::pipeline::{PipelineError, TrainOptions, TrainedCameras, read_scene, relocation};
use crate::progress::{Event, Progress};
use crate::run_files::{ADJUSTMENT, CAMERAS, FIRST_SURFACE, PREDICTED, PREDICTED_LIGHTS, SCENE, SURFACE};
use crate::scene::Scene;
use crate::splat::appearance::Appearance;
use crate::splat::ply;
use crate::stats::median;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Points are compared with tie points in cells of this side, metres, of an area of at most so many square metres.
const CELL_M: f64 = 1.0;
const MOST_AREA_M2: f64 = 4e8;
/// Points that are moved further upwards have another vertical reference, metres.
const MOST_UP_M: f64 = 5.0;

/// Where points come from.
enum Source<'a> {
    File(&'a Path),
    /// The surface that a training of the run has matched.
    Matched(PathBuf),
    /// The sparse points of the adjustment.
    Sparse,
}

impl<'a> Source<'a> {
    fn of(run: &Path, options: &'a PredictOptions) -> Self {
        let surfaces = [SURFACE, FIRST_SURFACE].map(|name| run.join(name));
        match (&options.points, surfaces.into_iter().find(|path| path.exists())) {
            (Some(path), _) => Self::File(path),
            (None, Some(path)) => Self::Matched(path),
            (None, None) => Self::Sparse,
        }
    }

    fn text(&self) -> String {
        match self {
            Self::File(path) => format!("`{}`", path.display()),
            Self::Matched(_) => "the matched surface".into(),
            Self::Sparse => "the sparse points".into(),
        }
    }
}

/// As [`super::predict`], of an adjusted run, whose lock the caller holds.
pub fn predict(
    run: &Path,
    out: &Path,
    options: &PredictOptions,
    progress: &dyn Progress,
) -> Result<Outcome<Predicted>, PipelineError> {
    relocation::finish_locked(run)?;
    let scene = read_scene(run)?;
    let source = Source::of(run, options);
    let points = match &source {
        Source::File(path) => hash_file(path),
        Source::Matched(path) => hash_file(path),
        Source::Sparse => source.text(),
    };
    let mut made_from = adjustment_fingerprint(run);
    made_from.insert("--points".into(), points);
    made_from.insert("--keep-place".into(), options.keeps_place.to_string());
    made_from.insert("alignment".into(), hash_file(&run.join(relocation::RECORD)));
    let (output, kept) = Output::open(out, made_from, options, progress)?;
    if let Some(kept) = kept {
        return Ok(kept);
    }
    require_images(&scene)?;
    let model = read_model(options)?;
    let recipe = TrainOptions::default().satellite_recipe()?;
    let (setup, sparse) = setup_of(run, &scene, recipe.kind.white)?;
    let views = setup.training_views(&scene)?;
    if views.is_empty() {
        return Err(SiteSceneError::NoViews.into());
    }
    let points = match &source {
        Source::File(path) => {
            let points = read_points(path, Some(&setup.site))?;
            let points = if options.keeps_place {
                points
            } else {
                registered(points, &sparse, &setup.site, path, progress)
            };
            require_near(path, &points, &known_points(&setup, &sparse), "m", options.keeps_place, progress)?;
            points
        }
        Source::Matched(path) => of_surface(&MatchedSurface::read(path, &setup.site)?),
        Source::Sparse => {
            let text = "predicting from the sparse points, which are few: --points takes a surface model or a point cloud, and a \
                        run that was trained has a matched surface";
            progress.event(Event::Warning(text.into()));
            sparse
        }
    };
    let start = Instant::now();
    let made = of_points(&setup, &views, &points, &model, options.without_network, progress)?;
    let seconds = start.elapsed().as_secs_f64();
    output.clear()?;
    let names = views.iter().map(|v| v.name.clone());
    let appearances: Vec<(String, Appearance)> = names.zip(made.lights).collect();
    ply::write(&out.join(PREDICTED), &made.splats, &setup.site)?;
    write_json(&out.join(PREDICTED_LIGHTS), &appearances)?;
    copy_adjustment(run, output.folder)?;
    let cameras = TrainedCameras { appearances, setup, recipe, is_matched: false };
    cameras.write_splats(out, &made.splats)?;
    write_json(&out.join(CAMERAS), &cameras)?;
    let predicted = Predicted {
        points: source.text(),
        clean_up: made.clean_up,
        spacing_m: made.spacing_m,
        splats: made.splats.len(),
        seconds,
    };
    output.complete(predicted, progress)
}

/// The training scene, with the white of a recipe, and the sparse points. The scene of a trained run is kept.
fn setup_of(run: &Path, scene: &Scene, white: f32) -> Result<(SiteScene, Vec<[f64; 3]>), PipelineError> {
    let adjustment = Adjustment::read(&run.join(ADJUSTMENT))?;
    let points = adjustment.positions();
    let mut setup = if run.join(CAMERAS).exists() {
        TrainedCameras::read(run)?.setup
    } else {
        SiteScene::new(scene, &adjustment.cameras_of(scene)?, &points)?
    };
    // Of a trained run it may be that of another recipe.
    setup.transfer_function = setup.transfer_function.with_white(white);
    let sparse = setup.sparse(&points).iter().map(|p| p.xyz()).collect();
    Ok((setup, sparse))
}

/// The sparse points, with the resolution of the views.
fn known_points(setup: &SiteScene, sparse: &[[f64; 3]]) -> Vec<KnownPoint> {
    let step_px = |view: &SiteView| {
        let at = |east: f64| view.camera.project(Point::new(east, 0.0, 0.0));
        at(0.0).distance(at(1.0))
    };
    let px_per_unit = median(setup.views.iter().map(step_px).collect()).unwrap_or(0.0);
    sparse.iter().map(|place| KnownPoint { place: *place, px_per_unit }).collect()
}

/// The points of a file, moved such that they agree with the sparse points: tie points leave the place of a run open by some metres,
/// and a shift of a pixel blurs all colours.
fn registered(
    mut points: Vec<[f64; 3]>,
    sparse: &[[f64; 3]],
    site: &SiteGrid,
    path: &Path,
    progress: &dyn Progress,
) -> Vec<[f64; 3]> {
    let places: Vec<_> = sparse.iter().map(|[x, y, z]| site.utm_from_site(Point::new(*x, *y, *z))).collect();
    let reference = highest_points(&points, site, path);
    let found = reference.map(|reference| coregister::to_surface(&places, site.epsg, &reference));
    let Some(Ok(found)) = found else {
        let text = "the points cannot be registered to the tie points of the adjustment, and are not moved";
        progress.event(Event::Warning(text.into()));
        return points;
    };
    let (Shift { east_m, north_m, up_m }, left_m) = (found.shift, found.left_m);
    let text = format!(
        "the points are moved by {:.2} m east, {:.2} m north and {:.2} m up, onto the tie points of the adjustment, which then differ \
         by {left_m:.2} m (median)",
        -east_m, -north_m, -up_m
    );
    if let Some(open) = found.open_text() {
        progress.event(Event::Warning(format!("registration of the points: {open}")));
    }
    let is_far = up_m.abs() > MOST_UP_M;
    progress.event(if is_far {
        Event::Warning(format!(
            "{text}: are their heights above the vertical reference that the file states?"
        ))
    } else {
        Event::Note(text)
    });
    points.iter_mut().for_each(|p| *p = [p[0] - east_m, p[1] - north_m, p[2] - up_m]);
    points
}

/// The highest point in each cell of the map; none without finite points.
fn highest_points(points: &[[f64; 3]], site: &SiteGrid, path: &Path) -> Option<HeightRaster> {
    let finite = || points.iter().filter(|p| p.iter().all(|v| v.is_finite()));
    let [x, y, z] = site.origin.xyz();
    let range =
        |k: usize| finite().fold((f64::MAX, f64::MIN), |(low, high), p| (low.min(p[k]), high.max(p[k])));
    let ((west, east), (south, north)) = (range(0), range(1));
    let is_sound = west < east && south < north && (east - west) * (north - south) < MOST_AREA_M2;
    if !is_sound {
        return None;
    }
    let grid = MapGrid::covering(site.epsg, (x + west, y + south, x + east, y + north), CELL_M);
    let mut height = Grid2::filled(grid.width, grid.height, f32::NAN);
    for p in finite() {
        let (col, row) = ((x + p[0] - grid.west) / CELL_M, (grid.north - y - p[1]) / CELL_M);
        let (col, row) = ((col as usize).min(grid.width - 1), (row as usize).min(grid.height - 1));
        let cell = &mut height.data[row * grid.width + col];
        *cell = cell.max((p[2] + z) as f32);
    }
    let path = path.into();
    Some(HeightRaster { path, grid, height, converted_from: None, vertical: None, undeclared_nodata: 0 })
}

/// Copies what `train` and `dsm` read of an adjusted run.
fn copy_adjustment(run: &Path, out: &Path) -> Result<(), PipelineError> {
    let failed = |path: &Path| {
        let path = path.to_owned();
        move |e: std::io::Error| WriteError::new(&path, e)
    };
    let copy = |from: &Path, to: &Path| std::fs::copy(from, to).map(drop).map_err(failed(to));
    copy(&run.join(SCENE), &out.join(SCENE))?;
    if run.join(relocation::RECORD).exists() {
        copy(&run.join(relocation::RECORD), &out.join(relocation::RECORD))?;
    }
    let mut folders = vec![PathBuf::from(ADJUSTMENT)];
    while let Some(folder) = folders.pop() {
        let (from, to) = (run.join(&folder), out.join(&folder));
        std::fs::create_dir_all(&to).map_err(failed(&to))?;
        for entry in std::fs::read_dir(&from).map_err(failed(&from))? {
            let entry = entry.map_err(failed(&from))?;
            let name = folder.join(entry.file_name());
            if entry.path().is_dir() {
                folders.push(name);
            } else {
                copy(&entry.path(), &out.join(&name))?;
            }
        }
    }
    Ok(())
}
