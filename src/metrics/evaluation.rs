//! A prediction scored against the truth, with every registration.

use super::breakdown::Groups;
use super::error_ranking::ErrorRanking;
use super::ground::GroundSteps;
use super::registered::registered;
use super::registration::{Method, Registration, registrations};
use super::resample::{Sampling, onto_grid};
use super::{HeightRaster, MetricsError, PartScores, Scores, Truth, filled_by_nearest};
use crate::frame::{Point, SiteGrid, metres_of_unit};
use crate::io::{GeoidDifference, Grid2, MapGrid, VerticalReference};
use rayon::prelude::*;
use serde::Serialize;
use std::path::PathBuf;

/// Smallest number of common cells.
const LEAST_COMMON_CELLS: usize = 100;
/// Registered heights are clipped to the truth's range widened by this, in metres (EOGS).
const CLIP_MARGIN_M: f32 = 10.0;

/// A registration and the scores after it.
#[derive(Clone, Debug, Serialize)]
pub struct RegisteredScores {
    /// The registration.
    #[serde(flatten)]
    pub registration: Registration,
    /// Metres the prediction is moved east.
    pub east_m: f64,
    /// Metres the prediction is moved north.
    pub north_m: f64,
    /// Standard deviation of `east_m`; none where the heights do not determine it, and for methods without a shift.
    pub east_sigma_m: Option<f64>,
    /// The same of `north_m`.
    pub north_sigma_m: Option<f64>,
    /// Scores of all land.
    #[serde(flatten)]
    pub scores: Scores,
    /// Scores of the cells that at least two views confirm, as if the others were nodata; none where the numbers of views
    /// are not known.
    pub confirmed: Option<Scores>,
    /// Scores of the other predicted cells, whose heights are filled in from the cells around them.
    pub filled: Option<Scores>,
    /// Scores of parts of the land.
    pub breakdown: Vec<PartScores>,
}

/// A prediction scored against the truth.
#[derive(Clone, Debug, Serialize)]
pub struct Evaluation {
    /// File of the prediction.
    pub prediction: PathBuf,
    /// File of the truth.
    pub truth: PathBuf,
    /// Grid of the truth, on which all scores are computed.
    pub grid: MapGrid,
    /// Side of a cell of that grid on the ground, metres.
    pub cell_m: f64,
    /// How the prediction was resampled to that grid.
    pub sampling: Sampling,
    /// Number of cells of the truth that are valid and not water.
    pub land_cells: usize,
    /// Number of cells of water, which are not scored.
    pub water_cells: usize,
    /// Scores after each registration, in the order of [`Method::ALL`].
    pub registered_scores: Vec<RegisteredScores>,
    /// How well the expected errors of the prediction predict the true ones after registration `xyz`; none without expected
    /// errors.
    pub expected_errors: Option<ErrorRanking>,
    /// Remarks that matter for the interpretation of the scores.
    pub notes: Vec<String>,
    #[serde(skip)]
    predicted: Grid2,
    /// The predicted cells that at least two views confirm.
    #[serde(skip)]
    confirmed: Option<Grid2>,
    #[serde(skip)]
    predicted_grid: MapGrid,
    #[serde(skip)]
    land: Grid2,
    #[serde(skip)]
    classes: Option<Vec<u8>>,
    #[serde(skip)]
    bounds: (f32, f32),
}

impl Evaluation {
    /// The scores after one registration.
    #[must_use]
    pub fn registered_scores(&self, method: Method) -> Option<&RegisteredScores> {
        self.registered_scores.iter().find(|v| v.registration.method == method)
    }

    /// Heights of the truth on its grid, NaN where not scored.
    #[must_use]
    pub fn land(&self) -> &Grid2 {
        &self.land
    }

    /// Class of every cell of the truth; none without classes.
    #[must_use]
    pub fn classes(&self) -> Option<&[u8]> {
        self.classes.as_deref()
    }

    /// Registered prediction minus truth in metres on the truth's grid, NaN where not scored.
    ///
    /// # Errors
    /// As [`evaluate`].
    pub fn error_map(&self, registration: &Registration) -> Result<Grid2, MetricsError> {
        let mut map = self.registered(&self.predicted, registration)?;
        self.subtract_land(&mut map);
        Ok(map)
    }

    /// Predicted heights moved by a registration and resampled to the truth's grid. They are sampled from their own raster,
    /// so that a shift loses no predicted cells at the edges.
    fn registered(&self, heights: &Grid2, r: &Registration) -> Result<Grid2, MetricsError> {
        registered(heights, &self.predicted_grid, &self.grid, r)
    }

    /// Replaces heights by errors, `clip(height) - land`.
    fn subtract_land(&self, heights: &mut Grid2) {
        let (low, high) = self.bounds;
        heights.data.par_iter_mut().zip(&self.land.data).for_each(|(v, t)| *v = v.clamp(low, high) - t);
    }

    fn scores_after(
        &self,
        registration: Registration,
        groups: &Groups,
        ground: &GroundSteps,
    ) -> Result<RegisteredScores, MetricsError> {
        let (errors, without_holes) = self.errors(&self.predicted, &registration)?;
        let (scores, breakdown) = groups.scores(&self.land, &errors, &without_holes);
        let (confirmed, filled) = self.scores_by_evidence(&registration, &errors)?.unzip();
        let of_grid = self.grid.cell;
        let [east_m, north_m] = ground.metres(registration.moved_cells().map(|cells| cells * of_grid));
        let sigma = [registration.dx_sigma_cells, registration.dy_sigma_cells];
        let [east_sigma_m, north_sigma_m] = ground.sigma_m(sigma.map(|cells| Some(cells? * of_grid)));
        Ok(RegisteredScores {
            registration,
            east_m,
            north_m,
            east_sigma_m,
            north_sigma_m,
            scores,
            confirmed,
            filled,
            breakdown,
        })
    }

    /// Expected errors compared with those after registration `xyz`.
    fn ranking(&self, expected: &Grid2) -> Result<Option<ErrorRanking>, MetricsError> {
        let Some(scores) = self.registered_scores(Method::Xyz) else { return Ok(None) };
        let registration = scores.registration;
        let expected = self.registered(expected, &Registration { dz_m: 0.0, ..registration })?;
        Ok(ErrorRanking::of(&expected, &self.error_map(&registration)?))
    }

    /// Errors of predicted heights after a registration, and the same after holes are filled with the nearest cell.
    fn errors(&self, heights: &Grid2, registration: &Registration) -> Result<(Grid2, Grid2), MetricsError> {
        let mut errors = self.registered(heights, registration)?;
        let mut without_holes = filled_by_nearest(&errors);
        self.subtract_land(&mut errors);
        self.subtract_land(&mut without_holes);
        Ok((errors, without_holes))
    }

    /// Scores of the confirmed cells and of the others, of which `all` holds the errors; none if it is not known which are
    /// confirmed.
    fn scores_by_evidence(
        &self,
        registration: &Registration,
        all: &Grid2,
    ) -> Result<Option<(Scores, Scores)>, MetricsError> {
        let Some(confirmed) = &self.confirmed else { return Ok(None) };
        let (confirmed, without_holes) = self.errors(confirmed, registration)?;
        let only_filled = |(all, confirmed): (&f32, &f32)| if confirmed.is_nan() { *all } else { f32::NAN };
        let filled = all.data.iter().zip(&confirmed.data).map(only_filled).collect();
        let filled = Grid2 { data: filled, ..*all };
        // Holes of what is filled in are not what its MAE could be computed without.
        let none = Grid2::filled(all.width, all.height, f32::NAN);
        let scores = |errors, without_holes| Scores::of_land(&self.land, errors, without_holes);
        Ok(Some((scores(&confirmed, &without_holes), scores(&filled, &none))))
    }
}

/// What is known of the heights of a prediction, on its grid.
pub struct Evidence {
    /// Whether two views or more confirm a cell.
    pub confirmed: Vec<bool>,
    /// Expected errors, metres.
    pub expected_error: Option<Grid2>,
}

/// Scores `prediction` against `truth` with every registration. Where there is evidence, the cells that two views or more
/// confirm and the others are also scored separately.
///
/// # Errors
/// [`MetricsError::NoOverlap`] with fewer than 100 common cells, [`MetricsError::Frame`] when the two systems
/// cannot be brought together.
pub fn evaluate(
    mut prediction: HeightRaster,
    evidence: Option<Evidence>,
    mut truth: Truth,
) -> Result<Evaluation, MetricsError> {
    truth.notes.extend(to_one_reference(&mut prediction, &mut truth.surface)?);
    let grid = truth.surface.grid;
    let heights = truth.surface.height.data.par_iter();
    // The comparisons pass over NaN.
    let range =
        heights.map(|v| (*v, *v)).reduce(|| (f32::MAX, f32::MIN), |a, b| (a.0.min(b.0), a.1.max(b.1)));
    let (low, high) = range;
    let bounds = (low - CLIP_MARGIN_M, high + CLIP_MARGIN_M);
    let water_cells = truth.drop_water();
    let land = &truth.surface.height;
    let land_cells = land.data.par_iter().filter(|v| !v.is_nan()).count();
    let (raster, sampling) = onto_grid(&prediction.height, &prediction.grid, &grid)?;
    let common = raster.data.par_iter().zip(&land.data).filter(|(p, t)| !(**p - **t).is_nan()).count();
    if common < LEAST_COMMON_CELLS {
        return Err(MetricsError::NoOverlap {
            common,
            needed: LEAST_COMMON_CELLS,
            predicted: raster.valid().count(),
            land: land_cells,
            extents: format!("{}, the truth {}", prediction.grid.extent(), grid.extent()),
            prediction: prediction.path,
            truth: truth.surface.path,
        });
    }
    let registrations = registrations(&raster, land, bounds);
    drop(raster);
    let mut notes = notes(&prediction, &truth, sampling, -registrations[0].dz_m);
    for open in registrations.iter().filter(|r| !r.is_determined) {
        notes.push(format!(
            "{}: the heights do not determine the horizontal shift; in the directions that they leave open the surface is not moved",
            open.method.name()
        ));
    }
    let ground = GroundSteps::new(&grid, &prediction.grid)?;
    let cell_m = grid.cell * ground.unit_m();
    let middle = grid.middle();
    if metres_of_unit(grid.epsg, [middle.x(), middle.y()])? != 1.0 {
        notes.push(format!(
            "a unit of the truth's map (EPSG:{}) is {:.3} m on the ground here: lengths, slopes and distances are converted",
            grid.epsg,
            ground.unit_m()
        ));
    }
    let groups = Groups::of(&truth, cell_m);
    let (confirmed, expected_error) = evidence.map(|e| (e.confirmed, e.expected_error)).unzip();
    let confirmed = confirmed.map(|confirmed| {
        let heights = prediction.height.data.iter().zip(confirmed);
        let data = heights.map(|(z, is_confirmed)| if is_confirmed { *z } else { f32::NAN }).collect();
        Grid2 { data, ..prediction.height }
    });
    let mut evaluation = Evaluation {
        prediction: prediction.path,
        truth: truth.surface.path,
        grid,
        cell_m,
        sampling,
        land_cells,
        water_cells,
        registered_scores: Vec::new(),
        expected_errors: None,
        notes,
        predicted: prediction.height,
        confirmed,
        predicted_grid: prediction.grid,
        land: truth.surface.height,
        classes: truth.classes,
        bounds,
    };
    let registered_scores = registrations.into_iter().map(|r| evaluation.scores_after(r, &groups, &ground));
    evaluation.registered_scores = registered_scores.collect::<Result<_, _>>()?;
    if let Some(expected) = expected_error.flatten() {
        evaluation.expected_errors = evaluation.ranking(&expected)?;
    }
    Ok(evaluation)
}

/// Converts both rasters to ellipsoidal heights if their files state different vertical references. If one states none,
/// or an unknown one, heights stay as they are. Returns sentences that say what was converted.
///
/// # Errors
/// As [`HeightRaster::to_ellipsoid`].
pub fn to_one_reference(a: &mut HeightRaster, b: &mut HeightRaster) -> Result<Vec<String>, MetricsError> {
    let (Some(of_a), Some(of_b)) = (&a.vertical, &b.vertical) else { return Ok(Vec::new()) };
    if of_a == of_b || [of_a, of_b].into_iter().any(|name| VerticalReference::read(name).is_err()) {
        return Ok(Vec::new());
    }
    let done = [a.to_ellipsoid()?, b.to_ellipsoid()?];
    Ok(done.into_iter().flatten().collect())
}

/// The notes of an evaluation; `difference_m` is the median of prediction minus truth.
fn notes(prediction: &HeightRaster, truth: &Truth, sampling: Sampling, difference_m: f64) -> Vec<String> {
    let mut notes = truth.notes.clone();
    for s in [prediction, &truth.surface] {
        let path = s.path.display();
        if s.undeclared_nodata > 0 {
            let n = s.undeclared_nodata;
            notes.push(format!(
                "`{path}`: {n} cells of -9999, -32768 or infinity, not declared as nodata, are left out"
            ));
        }
        if let Some(unit) = &s.converted_from {
            notes.push(format!("`{path}`: heights in `{unit}` are converted to metres"));
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
        let of = |s: &HeightRaster| s.vertical.clone().unwrap_or_else(|| "not stated".into());
        notes.push(format!(
            "vertical reference: prediction {}, truth {}; heights are compared as they are \
             (median of prediction minus truth {difference_m:+.2} m{})",
            of(prediction),
            of(&truth.surface),
            geoid_hint(&truth.surface.grid, difference_m)
        ));
    }
    notes
}

/// A hint for a median difference that is near the height of the geoid.
fn geoid_hint(grid: &MapGrid, difference_m: f64) -> String {
    let map = SiteGrid { epsg: grid.epsg, origin: Point::new(0.0, 0.0, 0.0) };
    let middle = map.geodetic_from_utm(grid.middle());
    let Some(GeoidDifference { geoid_m, is_near }) =
        GeoidDifference::at(middle.lon_deg(), middle.lat_deg(), difference_m)
    else {
        return String::new();
    };
    let hint =
        ", about the same: is one of them above a geoid? --truth-vertical sets the reference of the truth";
    format!("; the geoid lies {geoid_m:+.2} m from the ellipsoid here{}", if is_near { hint } else { "" })
}
