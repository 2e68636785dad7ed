//! Keyword arguments of the Python functions as the options of the library. An argument that is `None` takes the
//! option's default.

use pyo3::prelude::*;
use satgs::perspective::PerspectiveScene;
use satgs::pipeline::{
    AdjustOptions, DemOptions, DsmOptions, EvaluateOptions, PipelineError, RunOptions, TrainOptions,
};
use satgs::scene::{Aoi, ReadOptions, Scene, Sun, TransferFunction};
use satgs::tiles::SceneOptions;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// An area of interest: west, south, east, north in degrees, or a GeoJSON file.
#[derive(FromPyObject)]
pub enum Area {
    Box([f64; 4]),
    File(PathBuf),
}

/// How a scene is read.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct SceneArgs {
    rpcs: Option<String>,
    suns: Option<BTreeMap<String, (f64, f64)>>,
    aoi: Option<Area>,
    bands: Option<Vec<usize>>,
    stretch_percent: Option<f64>,
    gamma: Option<f32>,
    trust_rpc: Option<bool>,
    height_range: Option<(f64, f64)>,
}

impl SceneArgs {
    /// Reads the scene.
    pub fn read(&self, path: &Path) -> Result<Scene, PipelineError> {
        let mut options = ReadOptions { rpcs: self.rpcs.clone(), ..ReadOptions::default() };
        for (name, (azimuth, elevation)) in self.suns.iter().flatten() {
            let sun = Sun::new(*azimuth, *elevation);
            let expected = "an azimuth within ±360° and an elevation within ±90°";
            let sun = sun.ok_or_else(|| wrong("suns", (azimuth, elevation), expected))?;
            options.suns.push((name.clone(), sun));
        }
        options.aoi = match &self.aoi {
            Some(Area::Box(degrees)) => Some(Aoi::from_box(*degrees)?),
            Some(Area::File(path)) => Some(Aoi::from_geojson(path)?),
            None => None,
        };
        if let Some(bands) = &self.bands {
            if ![1, 3].contains(&bands.len()) || bands.contains(&0) {
                return Err(wrong("bands", bands, "one band or three, counted from 1"));
            }
            options.bands.clone_from(bands);
        }
        if let Some(percent) = self.stretch_percent {
            if !(0.0..50.0).contains(&percent) {
                return Err(wrong("stretch_percent", percent, "a percentage from 0 to below 50"));
            }
            options.stretch_percent = Some(percent);
        }
        if let Some(gamma) = self.gamma {
            let function = TransferFunction::new(gamma);
            options.transfer_function =
                Some(function.ok_or_else(|| wrong("gamma", gamma, "a number from 1 to 4"))?);
        }
        options.trust_rpc = self.trust_rpc.unwrap_or(options.trust_rpc);
        options.height_range = self.height_range;
        PerspectiveScene::require_satellite(path)?;
        Ok(satgs::scene::read(path, &options)?)
    }
}

/// How a scene is adjusted.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct AdjustArgs {
    model: Option<String>,
    fixed: Option<bool>,
    height_range: Option<(f64, f64)>,
    dem: Option<PathBuf>,
    dem_vertical: Option<String>,
    dem_sigma_m: Option<f64>,
    gcps: Option<PathBuf>,
    reference_views: Option<Vec<String>>,
    overwrite: Option<bool>,
}

impl AdjustArgs {
    pub fn options(&self) -> Result<AdjustOptions, PipelineError> {
        let mut options = AdjustOptions {
            height_range: self.height_range,
            gcps: self.gcps.clone(),
            reference_views: self.reference_views.clone().unwrap_or_default(),
            ..AdjustOptions::default()
        };
        if let Some(model) = &self.model {
            let read = serde_json::from_value(model.as_str().into());
            options.model = read.map_err(|_| wrong("model", model, "`shift`, `shift-scale` or `affine`"))?;
        }
        options.fixed = self.fixed.unwrap_or(options.fixed);
        options.overwrite = self.overwrite.unwrap_or(options.overwrite);
        options.dem = self.dem.as_ref().map(|path| DemOptions {
            path: path.clone(),
            vertical: self.dem_vertical.clone(),
            sigma_m: self.dem_sigma_m,
        });
        if options.dem.is_none() && (self.dem_vertical.is_some() || self.dem_sigma_m.is_some()) {
            return Err(wrong(
                "dem",
                "None",
                "an elevation model, because dem_vertical or dem_sigma_m is given",
            ));
        }
        Ok(options)
    }
}

/// How a run is trained.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct TrainArgs {
    recipe: Option<PathBuf>,
    iterations: Option<u32>,
    no_splats: Option<bool>,
    seed: Option<u64>,
    checkpoint_every: Option<u32>,
    resume: Option<bool>,
    snapshots: Option<u32>,
    features: Option<PathBuf>,
    lpips: Option<PathBuf>,
    overwrite: Option<bool>,
}

impl TrainArgs {
    pub fn options(&self) -> Result<TrainOptions, PipelineError> {
        let default = TrainOptions::default();
        let recipe = self.recipe.as_ref().map(|recipe| recipe.to_string_lossy().into_owned());
        let options = TrainOptions {
            recipe: recipe.unwrap_or(default.recipe),
            iterations: self.iterations.or(default.iterations),
            no_splats: self.no_splats.unwrap_or(default.no_splats),
            seed: self.seed.unwrap_or(default.seed),
            checkpoint_every: self.checkpoint_every.unwrap_or(default.checkpoint_every),
            resume: self.resume.unwrap_or(default.resume),
            snapshots: self.snapshots.unwrap_or(default.snapshots),
            features: self.features.clone(),
            lpips: self.lpips.clone(),
            overwrite: self.overwrite.unwrap_or(default.overwrite),
            ..default
        };
        if options.checkpoint_every == 0 {
            return Err(wrong("checkpoint_every", 0, "a number from 1 on"));
        }
        Ok(options)
    }
}

/// What is rendered of a trained run.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct DsmArgs {
    resolution_m: Option<f64>,
    like: Option<PathBuf>,
    vertical: Option<String>,
    fill_m: Option<f64>,
    no_fill: Option<bool>,
    hillshade: Option<bool>,
    points: Option<PathBuf>,
    mesh: Option<PathBuf>,
    overwrite: Option<bool>,
}

impl DsmArgs {
    pub fn options(self) -> DsmOptions {
        let default = DsmOptions::default();
        DsmOptions {
            resolution_m: self.resolution_m.unwrap_or(default.resolution_m),
            like: self.like.or(default.like),
            vertical: self.vertical.or(default.vertical),
            fill_m: self.fill_m.or(default.fill_m),
            no_fill: self.no_fill.unwrap_or(default.no_fill),
            hillshade: self.hillshade.unwrap_or(default.hillshade),
            points: self.points.or(default.points),
            mesh: self.mesh.or(default.mesh),
            overwrite: self.overwrite.unwrap_or(default.overwrite),
            ..default
        }
    }
}

/// How a truth is read.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct TruthArgs {
    classes: Option<PathBuf>,
    mask: Option<PathBuf>,
    truth_vertical: Option<String>,
    truth_epsg: Option<u32>,
    confidence: Option<PathBuf>,
    overwrite: Option<bool>,
}

impl TruthArgs {
    pub fn options(self) -> EvaluateOptions {
        let default = EvaluateOptions::default();
        EvaluateOptions {
            classes: self.classes.or(default.classes),
            mask: self.mask.or(default.mask),
            vertical: self.truth_vertical.or(default.vertical),
            epsg: self.truth_epsg.or(default.epsg),
            confidence: self.confidence.or(default.confidence),
            overwrite: self.overwrite.unwrap_or(default.overwrite),
        }
    }
}

/// All stages of a scene of any size.
pub struct RunArgs {
    adjust: AdjustArgs,
    train: TrainArgs,
    dsm: DsmArgs,
    evaluate: TruthArgs,
    own: SizeArgs,
}

/// Arguments of `run` that no other call has.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct SizeArgs {
    truth: Option<PathBuf>,
    core_m: Option<f64>,
    overlap_m: Option<f64>,
    max_memory_mb: Option<f64>,
}

impl<'py> FromPyObject<'_, 'py> for RunArgs {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        Ok(Self {
            adjust: given.extract()?,
            train: given.extract()?,
            dsm: given.extract()?,
            evaluate: given.extract()?,
            own: given.extract()?,
        })
    }
}

impl RunArgs {
    pub fn options(self) -> Result<SceneOptions, PipelineError> {
        let stages = RunOptions {
            adjust: self.adjust.options()?,
            train: self.train.options()?,
            dsm: self.dsm.options(),
            truth: self.own.truth,
            evaluate: self.evaluate.options(),
        };
        let default = SceneOptions::default();
        Ok(SceneOptions {
            stages,
            core_m: self.own.core_m.unwrap_or(default.core_m),
            overlap_m: self.own.overlap_m.unwrap_or(default.overlap_m),
            max_memory_mb: self.own.max_memory_mb.or(default.max_memory_mb),
        })
    }
}

/// The error of an option.
fn wrong(option: &'static str, found: impl std::fmt::Debug, expected: &'static str) -> PipelineError {
    PipelineError::Option { option, found: format!("{found:?}"), expected }
}
