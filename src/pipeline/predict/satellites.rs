//! Prediction of satellite scenes.

use super::points::{of_surface, read_points};
use super::splats::of_points;
use super::{Output, PredictOptions, Predicted, read_model};
use crate::affine::{SiteScene, SiteSceneError};
use crate::bundle::Adjustment;
use crate::io::{WriteError, write_json};
use crate::mvs::MatchedSurface;
use crate::pipeline::cameras::require_images;
use crate::pipeline::stage::{Outcome, adjustment_fingerprint, hash_file};
use crate::pipeline::{PipelineError, TrainOptions, TrainedCameras, read_scene, relocation};
use crate::predict::FEWEST_POINTS;
use crate::progress::{Event, Progress};
use crate::run_files::{ADJUSTMENT, CAMERAS, FIRST_SURFACE, PREDICTED, PREDICTED_LIGHTS, SCENE, SURFACE};
use crate::scene::Scene;
use crate::splat::appearance::Appearance;
use crate::splat::ply;
use crate::splat::train::recipe::Recipe;
use crate::stats::quantile;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Points and tie points at the same place, in level cells of this side, metres, differ by less unless heights are of different
/// vertical references.
const MOST_OFFSET_M: f64 = 3.0;
const OFFSET_CELL_M: f64 = 2.0;

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
    made_from.insert("alignment".into(), hash_file(&run.join(relocation::RECORD)));
    let (output, kept) = Output::open(out, made_from, options, progress)?;
    if let Some(kept) = kept {
        return Ok(kept);
    }
    require_images(&scene)?;
    let model = read_model(options)?;
    let (setup, recipe, sparse) = setup_of(run, &scene)?;
    let views = setup.training_views(&scene)?;
    if views.is_empty() {
        return Err(SiteSceneError::NoViews.into());
    }
    let points = match &source {
        Source::File(path) => read_points(path, Some(&setup.site))?,
        Source::Matched(path) => of_surface(&MatchedSurface::read(path, &setup.site)?),
        Source::Sparse => {
            let text = "predicting from the sparse points, which are few: --points takes a surface model or a point cloud, and a \
                        run that was trained has a matched surface";
            progress.event(Event::Warning(text.into()));
            sparse.clone()
        }
    };
    if let Some(above_m) = offset_m(&points, &sparse).filter(|offset| offset.abs() > MOST_OFFSET_M) {
        progress.event(Event::Warning(format!(
            "the points lie {:.1} m {} the tie points of the adjustment (median): are their heights above the ellipsoid? `satgs align` \
             moves a trained run onto a surface",
            above_m.abs(),
            if above_m > 0.0 { "above" } else { "below" },
        )));
    }
    let start = Instant::now();
    let made = of_points(&setup, &views, &points, &model, options.without_network, progress)?;
    let seconds = start.elapsed().as_secs_f64();
    output.clear()?;
    let names = views.iter().map(|v| v.name.clone());
    let appearances: Vec<(String, Appearance)> = names.zip(made.lights).collect();
    write_json(&out.join(PREDICTED_LIGHTS), &appearances)?;
    ply::write(&out.join(PREDICTED), &made.splats, &setup.site)?;
    copy_adjustment(run, output.folder)?;
    let cameras = TrainedCameras { appearances, setup, recipe, is_matched: false };
    cameras.write_splats(out, &made.splats)?;
    write_json(&out.join(CAMERAS), &cameras)?;
    output.complete(Predicted {
        points: source.text(),
        clean_up: made.clean_up,
        spacing_m: made.spacing_m,
        splats: made.splats.len(),
        seconds,
    })
}

/// The training scene, a recipe for what follows, and the sparse points. The scene of a trained run is kept.
fn setup_of(run: &Path, scene: &Scene) -> Result<(SiteScene, Recipe, Vec<[f64; 3]>), PipelineError> {
    let adjustment = Adjustment::read(&run.join(ADJUSTMENT))?;
    let points = adjustment.positions();
    let recipe = TrainOptions::default().satellite_recipe()?;
    let mut setup = if run.join(CAMERAS).exists() {
        TrainedCameras::read(run)?.setup
    } else {
        SiteScene::new(scene, &adjustment.cameras_of(scene)?, &points)?
    };
    // Of a trained run it may be that of another recipe.
    setup.transfer_function = setup.transfer_function.with_white(recipe.white);
    let sparse = setup.sparse(&points).iter().map(|p| p.xyz()).collect();
    Ok((setup, recipe, sparse))
}

/// Median height of points above the sparse points at the same place, metres; none if too few lie at the same places.
fn offset_m(points: &[[f64; 3]], sparse: &[[f64; 3]]) -> Option<f64> {
    let cell = |p: &[f64; 3]| [p[0], p[1]].map(|v| (v / OFFSET_CELL_M).floor() as i64);
    let mut sums: HashMap<[i64; 2], (f64, f64)> = HashMap::new();
    for p in points.iter().filter(|p| p.iter().all(|v| v.is_finite())) {
        let (sum, count) = sums.entry(cell(p)).or_default();
        (*sum, *count) = (*sum + p[2], *count + 1.0);
    }
    let above = |p: &[f64; 3]| sums.get(&cell(p)).map(|(sum, count)| sum / count - p[2]);
    let offsets: Vec<f64> = sparse.iter().filter_map(above).collect();
    (offsets.len() >= FEWEST_POINTS).then(|| quantile(offsets, 0.5)).flatten()
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
