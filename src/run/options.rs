//! Options of all stages of a run.

use crate::metrics::Truth;
use crate::pipeline::{AdjustOptions, DsmOptions, EvaluateOptions, PipelineError, TrainOptions};
use crate::splat::backend::DeviceChoice;
use crate::splat::recipe::Recipe;
use crate::tiles::{PlanOptions, TileSurface, TilesError};
use std::path::{Path, PathBuf};

/// Options of all stages. Photographs, which have no adjustment, truth or tiles, use `train` and `dsm` only.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Of the adjustment.
    pub adjust: AdjustOptions,
    /// Of the training.
    pub train: TrainOptions,
    /// Of the surface model.
    pub dsm: DsmOptions,
    /// A surface model or points to score the result against.
    pub truth: Option<PathBuf>,
    /// How the truth is read.
    pub evaluate: EvaluateOptions,
    /// Largest side of the core of a tile, metres; an area of up to 1.5 times this side is not cut.
    pub core_m: f64,
    /// Width of the ground around the core that is trained, too, metres.
    pub overlap_m: f64,
    /// Memory that a tile may take, megabytes.
    pub max_memory_mb: Option<f64>,
}

impl Default for RunOptions {
    fn default() -> Self {
        let PlanOptions { core_m, overlap_m, max_memory_mb, .. } = PlanOptions::default();
        Self {
            adjust: AdjustOptions::default(),
            train: TrainOptions::default(),
            dsm: DsmOptions::default(),
            truth: None,
            evaluate: EvaluateOptions::default(),
            core_m,
            overlap_m,
            max_memory_mb,
        }
    }
}

impl RunOptions {
    /// The defaults of photographs: their own recipe.
    #[must_use]
    pub fn of_photographs() -> Self {
        let recipe = Recipe::OF_PERSPECTIVE_SCENES.into();
        Self { train: TrainOptions { recipe, ..TrainOptions::default() }, ..Self::default() }
    }

    /// Opens the files that late stages of a satellite scene read, so that errors are found before a long training.
    ///
    /// # Errors
    /// [`TilesError`] of the option that is wrong.
    pub fn check_satellites(&self, run: &Path) -> Result<(), TilesError> {
        self.train.satellite_recipe()?;
        self.dsm.check(run)?;
        if let Some(truth) = &self.truth {
            Truth::check(truth, &self.evaluate.truth_options()?).map_err(PipelineError::from)?;
        }
        Ok(self.planning().check()?)
    }

    /// How an area is cut into tiles.
    pub(super) fn planning(&self) -> PlanOptions {
        // All fields are named, so that none is forgotten: the others are refused by `require_options_of_tiles`.
        let DsmOptions {
            resolution_m,
            area: _,
            like: _,
            vertical,
            fill_m,
            no_fill,
            hillshade: _,
            dtm: _,
            points: _,
            mesh: _,
            overwrite,
        } = self.dsm.clone();
        PlanOptions {
            core_m: self.core_m,
            overlap_m: self.overlap_m,
            max_memory_mb: self.max_memory_mb,
            resolution_m,
            surface: TileSurface { vertical, fill_m, no_fill, ..TileSurface::default() },
            train: self.train.clone(),
            overwrite,
        }
    }

    /// An error if an option is given that only areas of one tile have.
    pub(super) fn require_options_of_tiles(&self) -> Result<(), TilesError> {
        let dsm = &self.dsm;
        let products = "the tools of GDAL make it from RUN/dsm.tif";
        let grid = "--resolution and --aoi set the grid, `gdalwarp` makes another of RUN/dsm.tif";
        let asked = [
            (dsm.like.is_some() || dsm.area.is_some(), "--like", grid),
            (dsm.hillshade, "--hillshade", products),
            (dsm.dtm, "--dtm", "`satgs dsm RUN/tiles/ID --dtm` makes it of a tile"),
            (dsm.points.is_some(), "--points", products),
            (dsm.mesh.is_some(), "--mesh", products),
            (matches!(self.train.device, DeviceChoice::Gpu(_)), "--device", "the processor trains tiles"),
        ];
        match asked.into_iter().find(|(is_asked, ..)| *is_asked) {
            Some((_, option, instead)) => Err(TilesError::OneTileOnly { option, instead }),
            None => Ok(()),
        }
    }
}
