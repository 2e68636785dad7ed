//! A prediction scored against the truth, with every registration.

use super::registration::{Method, Registration, register};
use super::resample::{Sampling, onto_grid};
use super::scores::{Scores, errors, score};
use super::{MetricsError, Surface, Truth};
use crate::raster::{MapGrid, Plane};
use serde::Serialize;

/// Fewer common cells than this tell nothing.
const LEAST_COMMON_CELLS: usize = 100;
/// Registered heights are clipped to the truth's range widened by this, in metres (EOGS).
const CLIP_MARGIN_M: f32 = 10.0;

/// One registration and its scores.
#[derive(Clone, Debug, Serialize)]
pub struct Verdict {
    /// What was added to the prediction.
    #[serde(flatten)]
    pub registration: Registration,
    /// Metres the prediction is moved east.
    pub east_m: f64,
    /// Metres the prediction is moved north.
    pub north_m: f64,
    /// What is left.
    #[serde(flatten)]
    pub scores: Scores,
}

/// A prediction scored against the truth.
#[derive(Clone, Debug, Serialize)]
pub struct Evaluation {
    /// The truth's grid, on which cells are counted.
    pub grid: MapGrid,
    /// How the prediction came to that grid.
    pub sampling: Sampling,
    /// Cells of the truth that are valid and not water.
    pub land_cells: usize,
    /// Cells of water, which are not scored.
    pub water_cells: usize,
    /// Scores after each registration, in the order of [`Method::ALL`].
    pub verdicts: Vec<Verdict>,
    /// What a reader of the figures should know.
    pub notes: Vec<String>,
    #[serde(skip)]
    prediction: Plane,
    #[serde(skip)]
    prediction_grid: MapGrid,
    #[serde(skip)]
    land: Plane,
    #[serde(skip)]
    bounds: (f32, f32),
}

impl Evaluation {
    /// The verdict of one registration.
    #[must_use]
    pub fn verdict(&self, method: Method) -> Option<&Verdict> {
        self.verdicts.iter().find(|v| v.registration.method == method)
    }

    /// Registered prediction minus truth in metres on the truth's grid, NaN where not scored.
    ///
    /// # Errors
    /// As [`evaluate`].
    pub fn error_map(&self, registration: &Registration) -> Result<Plane, MetricsError> {
        let registered = registered(&self.prediction, &self.prediction_grid, &self.grid, registration)?;
        let data = errors(&registered, &self.land, self.bounds);
        Ok(Plane { width: self.land.width, height: self.land.height, data })
    }
}

/// Scores `prediction` against `truth` with every registration.
///
/// # Errors
/// [`MetricsError::NoOverlap`] with fewer than 100 common cells, [`MetricsError::Frame`] when the two systems
/// cannot be brought together.
pub fn evaluate(prediction: &Surface, truth: &Truth) -> Result<Evaluation, MetricsError> {
    let grid = truth.surface.grid;
    let (plane, sampling) = onto_grid(&prediction.height, &prediction.grid, &grid)?;
    let land = truth.land();
    let land_cells = land.valid().count();
    let common = plane.data.iter().zip(&land.data).filter(|(p, t)| !(**p - **t).is_nan()).count();
    if common < LEAST_COMMON_CELLS {
        return Err(MetricsError::NoOverlap {
            prediction: prediction.path.clone(),
            truth: truth.surface.path.clone(),
            common,
            needed: LEAST_COMMON_CELLS,
            predicted: plane.valid().count(),
            land: land_cells,
            extents: format!("{}, the truth {}", extent(&prediction.grid), extent(&grid)),
        });
    }
    let (low, high) =
        truth.surface.height.valid().fold((f32::MAX, f32::MIN), |(l, h), v| (l.min(v), h.max(v)));
    let bounds = (low - CLIP_MARGIN_M, high + CLIP_MARGIN_M);
    let verdicts = Method::ALL
        .into_iter()
        .map(|method| {
            let registration = register(method, &plane, &land, bounds);
            let (east_m, north_m) = registration.moved_m(grid.cell);
            let registered = registered(&prediction.height, &prediction.grid, &grid, &registration)?;
            let scores = score(&registered, &land, truth.classes.as_deref(), bounds);
            Ok(Verdict { registration, east_m, north_m, scores })
        })
        .collect::<Result<Vec<_>, MetricsError>>()?;
    let notes = notes(prediction, truth, sampling, verdicts.first());
    let water_cells = truth.surface.height.valid().count() - land_cells;
    Ok(Evaluation {
        grid,
        sampling,
        land_cells,
        water_cells,
        verdicts,
        notes,
        prediction: prediction.height.clone(),
        prediction_grid: prediction.grid,
        land,
        bounds,
    })
}

/// The prediction moved by a registration, on the truth's grid. It is sampled where it is, also beyond the truth's
/// edges: a shift costs no cells that were predicted.
fn registered(
    prediction: &Plane,
    from: &MapGrid,
    truth: &MapGrid,
    r: &Registration,
) -> Result<Plane, MetricsError> {
    let moved = MapGrid {
        west: truth.west + r.dx_cells * truth.cell,
        north: truth.north - r.dy_cells * truth.cell,
        ..*truth
    };
    let (mut plane, _) = onto_grid(prediction, from, &moved)?;
    for v in &mut plane.data {
        *v = (f64::from(*v) + r.dz_m) as f32;
    }
    Ok(plane)
}

fn extent(grid: &MapGrid) -> String {
    let (w, s, e, n) = grid.bounds();
    format!("{w:.0}, {s:.0}, {e:.0}, {n:.0} of EPSG:{}", grid.epsg)
}

fn notes(prediction: &Surface, truth: &Truth, sampling: Sampling, z: Option<&Verdict>) -> Vec<String> {
    let mut notes = Vec::new();
    for s in [prediction, &truth.surface] {
        if s.undeclared_nodata > 0 {
            let (n, path) = (s.undeclared_nodata, s.path.display());
            notes.push(format!(
                "`{path}`: {n} cells of -9999 or infinity, not declared as nodata, are left out"
            ));
        }
    }
    match sampling {
        Sampling::WholeCells => {}
        Sampling::Bilinear => notes.push("the prediction is interpolated onto the truth's grid".into()),
        Sampling::Reprojected => notes.push(format!(
            "the prediction (EPSG:{}) is reprojected onto the truth's grid (EPSG:{})",
            prediction.grid.epsg, truth.surface.grid.epsg
        )),
    }
    if truth.classes.is_none() {
        notes.push("no class raster: water, if there is any, is scored; --classes names one".into());
    }
    if prediction.vertical != truth.surface.vertical || truth.surface.vertical.is_none() {
        let of = |s: &Surface| s.vertical.clone().unwrap_or_else(|| "not stated".into());
        let dz = z.map_or(f64::NAN, |z| z.registration.dz_m);
        notes.push(format!(
            "vertical reference: prediction {}, truth {}; heights are compared as they are \
             (median of prediction minus truth {:+.2} m)",
            of(prediction),
            of(&truth.surface),
            -dz
        ));
    }
    notes
}
