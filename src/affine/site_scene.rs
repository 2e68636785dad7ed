//! From adjusted cameras and sparse points to what training needs: the site, its area and heights, affine cameras.

use super::{AffineCamera, FitError, TrainingView, fit, sun_direction};
use crate::frame::{FrameError, Geodetic, Point, Site, SiteBox, SiteGrid};
use crate::io::{RasterError, ValidPixels};
use crate::rpc::Rpc;
use crate::scene::{Role, Scene, TransferFunction, View, default_aoi};
use crate::stats::quantile;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Shares of the sparse points below and above the heights that are swept and trained in, and the margins around
/// them.
const HEIGHT_SHARES: (f64, f64) = (0.005, 0.995);
const MARGIN_BELOW_M: f64 = 5.0;
const MARGIN_ABOVE_M: f64 = 15.0;
/// Views and suns lower than this are refused: their shears have no end.
const LOWEST_ELEVATION_DEG: f64 = crate::scene::LOWEST_SUN_DEG;

/// Why training cannot be set up.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum SiteSceneError {
    /// Adjustment left too few points.
    #[error("{found} sparse points are too few to train from (at least {needed})")]
    #[diagnostic(help("`satgs ba` reports what was matched"))]
    FewPoints {
        /// Points there are.
        found: usize,
        /// Points it takes.
        needed: usize,
    },
    /// No ground is seen often enough.
    #[error("no ground is seen by enough views")]
    #[diagnostic(help("`satgs info` shows the footprints"))]
    NoCommonGround,
    /// No view may be trained on.
    #[error("no training view is left")]
    #[diagnostic(help("`test.txt` holds views back, `train.txt` lists those to train on"))]
    NoViews,
    /// A view looks too flatly.
    #[error(
        "view `{view}` looks from {elevation_deg:.1}° above the horizon, at least {LOWEST_ELEVATION_DEG}° are needed"
    )]
    LowView {
        /// The view.
        view: String,
        /// Its elevation.
        elevation_deg: f64,
    },
    /// A view's RPC has no affine stand-in.
    #[error("view `{view}`")]
    Fit {
        /// The view.
        view: String,
        /// Why.
        #[source]
        source: FitError,
    },
    /// No map zone.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Frame(#[from] FrameError),
    /// An image cannot be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Raster(#[from] RasterError),
}

/// A view's camera in the site frame.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SiteView {
    /// Its name.
    pub name: String,
    /// Training or test.
    pub role: Role,
    /// Columns and rows of its image.
    pub size: (usize, usize),
    /// Whether some of the image's pixels are not valid.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_masked: bool,
    /// The camera.
    pub camera: AffineCamera,
    /// Root mean square distance to the RPC, pixels.
    pub rms_px: f64,
    /// Largest distance to the RPC, pixels.
    pub max_px: f64,
    /// Shear towards the sun, pixels per metre; none without a usable sun.
    pub sun_shear: Option<[f64; 2]>,
}

/// Where training takes place.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SiteScene {
    /// The site.
    pub site: SiteGrid,
    /// The area, site metres: west, south, east, north.
    pub area: SiteBox,
    /// Lowest and highest altitude, metres above the site's origin.
    pub altitudes: (f64, f64),
    /// All views.
    pub views: Vec<SiteView>,
    /// Index of the view whose colours the orthophoto takes.
    pub reference: usize,
    /// Relation between the images' pixel values and linear radiance.
    #[serde(default, skip_serializing_if = "TransferFunction::is_linear")]
    pub transfer_function: TransferFunction,
}

/// Sparse points fewer than this start nothing.
const FEWEST_POINTS: usize = 20;

impl SiteScene {
    /// Lays out the site of a scene whose views have the cameras `rpcs` (in the views' order).
    ///
    /// # Errors
    /// [`SiteSceneError`].
    pub fn new(scene: &Scene, rpcs: &[Rpc], sparse: &[Point<Geodetic>]) -> Result<Self, SiteSceneError> {
        let (found, needed) = (sparse.len(), FEWEST_POINTS);
        if found < needed {
            return Err(SiteSceneError::FewPoints { found, needed });
        }
        let heights: Vec<f64> = sparse.iter().map(|p| p.height_m()).collect();
        let too_few = || SiteSceneError::FewPoints { found, needed };
        let median = quantile(heights.clone(), 0.5).ok_or_else(too_few)?;
        let (low, high) = height_range(heights).ok_or_else(too_few)?;

        let provisional =
            SiteGrid::at(scene.center().ok_or(SiteSceneError::NoCommonGround)?.at_height(median))?;
        let valid = scene.views.par_iter().map(View::valid_pixels).collect::<Result<Vec<_>, _>>()?;
        let (west, south, east, north) = match &scene.aoi {
            Some(aoi) => aoi.utm_box(&provisional),
            None => {
                let seen: Vec<(Rpc, usize, usize)> =
                    scene.views.iter().zip(rpcs).zip(&valid).filter_map(seen_part).collect();
                let footprints: Vec<_> = seen.iter().map(|(rpc, w, h)| (rpc, *w, *h)).collect();
                default_aoi(&footprints, &provisional, median).ok_or(SiteSceneError::NoCommonGround)?
            }
        };
        // A whole-metre origin keeps the site readable.
        let origin = Point::new((0.5 * (west + east)).round(), (0.5 * (south + north)).round(), median);
        let site = SiteGrid { epsg: provisional.epsg, origin };
        let area = (west - origin.x(), south - origin.y(), east - origin.x(), north - origin.y());

        let views = scene
            .views
            .iter()
            .zip(rpcs)
            .zip(&valid)
            .map(|((view, rpc), valid)| {
                let elevation_deg = view.direction_deg(median).map_or(0.0, |(_, off_nadir)| 90.0 - off_nadir);
                if elevation_deg < LOWEST_ELEVATION_DEG {
                    return Err(SiteSceneError::LowView { view: view.name.clone(), elevation_deg });
                }
                let f = fit(rpc, (view.width, view.height), (low, high), &site)
                    .map_err(|source| SiteSceneError::Fit { view: view.name.clone(), source })?;
                let sun = view.sun.filter(|s| s.elevation_deg >= LOWEST_ELEVATION_DEG);
                Ok(SiteView {
                    name: view.name.clone(),
                    role: view.role,
                    size: (view.width, view.height),
                    is_masked: valid.is_some(),
                    camera: f.camera,
                    rms_px: f.rms_px,
                    max_px: f.max_px,
                    sun_shear: sun.map(|s| f.camera.shear_towards(sun_direction(s, &site))),
                })
            })
            .collect::<Result<Vec<_>, SiteSceneError>>()?;
        let reference = reference_view(scene, median).ok_or(SiteSceneError::NoViews)?;
        Ok(Self {
            site,
            area,
            altitudes: (low - median, high - median),
            views,
            reference,
            transfer_function: scene.transfer_function,
        })
    }

    /// Sparse points in the site frame, those within the altitudes.
    #[must_use]
    pub fn sparse(&self, points: &[Point<Geodetic>]) -> Vec<Point<Site>> {
        let all = points.iter().map(|p| self.site.site_from_geodetic(*p));
        let (west, south, east, north) = self.area;
        all.filter(|p| {
            (west..=east).contains(&p.x())
                && (south..=north).contains(&p.y())
                && (self.altitudes.0..=self.altitudes.1).contains(&p.z())
        })
        .collect()
    }

    /// Reads the training views' pixels.
    ///
    /// # Errors
    /// [`SiteSceneError::Raster`].
    pub fn training_views(&self, scene: &Scene) -> Result<Vec<TrainingView>, SiteSceneError> {
        let pairs = self.views.iter().zip(&scene.views).filter(|(f, _)| f.role == Role::Train);
        pairs
            .map(|(f, view)| {
                let planes = view.read_colors()?;
                let view = TrainingView::new(f.name.clone(), f.camera, f.sun_shear, &planes, self.area);
                Ok(view.with_transfer_function(self.transfer_function))
            })
            .collect()
    }

    /// Half the diagonal of the area: half the side of the papers' cube, metres.
    #[must_use]
    pub fn half_side_m(&self) -> f64 {
        let (west, south, east, north) = self.area;
        0.5 * (east - west).hypot(north - south)
    }

    /// Where the reference view stands among the training views.
    #[must_use]
    pub fn reference_among_training(&self) -> usize {
        self.views[..self.reference].iter().filter(|v| v.role == Role::Train).count()
    }
}

/// From the heights of sparse points to those in which a surface is looked for, metres.
#[must_use]
pub fn height_range(heights: Vec<f64>) -> Option<(f64, f64)> {
    let low = quantile(heights.clone(), HEIGHT_SHARES.0)?;
    let high = quantile(heights, HEIGHT_SHARES.1)?;
    Some((low - MARGIN_BELOW_M, high + MARGIN_ABOVE_M))
}

/// The camera, columns and rows of the part of a view's image that holds all valid pixels; none without any.
fn seen_part(((view, rpc), valid): ((&View, &Rpc), &Option<ValidPixels>)) -> Option<(Rpc, usize, usize)> {
    let Some(valid) = valid else { return Some((rpc.clone(), view.width, view.height)) };
    let part = valid.bounds()?;
    Some((rpc.cropped(part.col, part.row), part.width, part.height))
}

/// The training view nearest to nadir with a high sun: one degree off nadir weighs as much as one of the sun.
fn reference_view(scene: &Scene, height_m: f64) -> Option<usize> {
    let cost = |i: &usize| {
        let v = &scene.views[*i];
        let off_nadir = v.direction_deg(height_m).map_or(90.0, |d| d.1);
        let sun_from_zenith = 90.0 - v.sun.map_or(45.0, |s| s.elevation_deg);
        off_nadir + sun_from_zenith
    };
    (0..scene.views.len())
        .filter(|i| scene.views[*i].role == Role::Train)
        .min_by(|a, b| cost(a).total_cmp(&cost(b)))
}
