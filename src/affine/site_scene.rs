//! The training scene: the site, its area and altitudes, and the views' cameras, from adjusted RPCs and sparse points.

use super::site_frame::REFERENCE_HALF_DIAGONAL_M;
use super::{FitError, Order, SiteFrame, TrainingView, ViewCamera, fit, sun_direction};
use crate::fault::ErrorKind;
use crate::frame::{FrameError, Geodetic, Point, Site, SiteBox, SiteGrid};
use crate::io::{RasterError, Window};
use crate::rpc::Rpc;
use crate::scene::{Role, Scene, TransferFunction, View, default_aoi};
use crate::stats::{bounds, quantile};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Quantiles of the heights of the sparse points between which, with margins, splats may lie as long as no surface is known.
const SPARSE_QUANTILES: (f64, f64) = (0.005, 0.995);
/// Depth below and height above the surface and the sparse points in which splats may lie, metres.
const MARGIN_BELOW_M: f64 = 5.0;
const MARGIN_ABOVE_M: f64 = 15.0;
/// Smallest elevation of views and suns: at lower ones, shears (the cotangent of the elevation) become too
/// large. Lower views are an error, lower suns are not used.
const LOWEST_ELEVATION_DEG: f64 = crate::scene::LOWEST_SUN_DEG;

/// Why a training scene cannot be set up.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum SiteSceneError {
    /// The bundle adjustment has left too few sparse points.
    #[error("found {found} sparse points, but training needs at least {needed}")]
    #[diagnostic(help("`satgs ba` reports the matches that it found between the views"))]
    FewPoints {
        /// Number of sparse points.
        found: usize,
        /// Smallest number of sparse points.
        needed: usize,
    },
    /// The footprints of the views do not overlap enough.
    #[error("no part of the ground is seen by enough views")]
    #[diagnostic(help("`satgs info` shows the footprints of the views"))]
    NoCommonGround,
    /// The scene has no training view.
    #[error("no training view is left")]
    #[diagnostic(help("`test.txt` holds views back, and `train.txt` lists those to train on"))]
    NoViews,
    /// A view is too oblique.
    #[error(
        "view `{view}` has an elevation of {elevation_deg:.1}° above the horizon, but at least {LOWEST_ELEVATION_DEG}° are needed"
    )]
    #[diagnostic(help("leave the view out, or check that its RPC belongs to its image"))]
    LowView {
        /// Name of the view.
        view: String,
        /// Elevation of the satellite, degrees.
        elevation_deg: f64,
    },
    /// The frame of the scene names a reference view that is not trained on.
    #[error("the reference view `{view}` is not among the training views")]
    #[diagnostic(help("name a training view of the scene, or none"))]
    NoReference {
        /// Name of the view.
        view: String,
    },
    /// The RPC of a view cannot be approximated by a [`ViewCamera`].
    #[error("view `{view}`: the RPC has no quadratic approximation")]
    Fit {
        /// Name of the view.
        view: String,
        /// The reason.
        #[source]
        source: FitError,
    },
    /// The site lies outside of UTM.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Frame(#[from] FrameError),
    /// An image cannot be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Raster(#[from] RasterError),
}

impl SiteSceneError {
    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Raster(e) => e.kind(),
            _ => ErrorKind::Input,
        }
    }
}

/// A view of the training scene, without its pixels.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SiteView {
    /// Name of the view.
    pub name: String,
    /// Whether it is a training or a test view.
    pub role: Role,
    /// Columns and rows of the image.
    pub size: (usize, usize),
    /// Whether some pixels of the image are not valid.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_masked: bool,
    /// The camera in the site frame.
    pub camera: ViewCamera,
    /// Root mean square distance to the RPC, pixels.
    pub rms_px: f64,
    /// Largest distance to the RPC, pixels.
    pub max_px: f64,
    /// Shear of the camera towards the sun, pixels per metre of altitude; none if the sun is unknown or too low.
    pub sun_shear: Option<[f64; 2]>,
}

/// The training scene: what matching, training and the DSM share.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SiteScene {
    /// The site, whose frame all coordinates are in.
    pub site: SiteGrid,
    /// The area, site metres: west, south, east, north.
    pub area: SiteBox,
    /// Lowest and highest altitude of splats, metres above the site's origin: those of the sparse points and of the surface, as
    /// soon as it is known, with margins.
    pub altitudes: (f64, f64),
    /// Lowest and highest altitude between which the surface is searched, metres above the site's origin.
    #[serde(default)]
    pub searched: (f64, f64),
    /// All views.
    pub views: Vec<SiteView>,
    /// Index of the view whose colours the orthophoto takes.
    pub reference: usize,
    /// Whether site, area and altitudes are those of a [`SiteFrame`].
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_framed: bool,
    /// Relation between the images' pixel values and linear radiance.
    #[serde(default, skip_serializing_if = "TransferFunction::is_linear")]
    pub transfer_function: TransferFunction,
}

/// Smallest number of sparse points that determine a range of heights.
pub const MIN_POINTS: usize = 20;

impl SiteScene {
    /// Sets up the training scene. `rpcs` holds the adjusted cameras in the order of the scene's views,
    /// `sparse` the sparse points.
    ///
    /// # Errors
    /// [`SiteSceneError`] when there are too few points, no training view or no common ground, when a view is
    /// too oblique, has no approximation or cannot be read, or when the site lies outside of UTM.
    pub fn new(scene: &Scene, rpcs: &[Rpc], sparse: &[Point<Geodetic>]) -> Result<Self, SiteSceneError> {
        let (found, needed) = (sparse.len(), MIN_POINTS);
        if found < needed {
            return Err(SiteSceneError::FewPoints { found, needed });
        }
        let heights: Vec<f64> = sparse.iter().map(|p| p.height_m()).collect();
        let too_few = || SiteSceneError::FewPoints { found, needed };
        let median = quantile(heights.clone(), 0.5).ok_or_else(too_few)?;
        let found = bounds(heights.iter().copied()).ok_or_else(too_few)?;
        let searched = scene.heights().with_tie_points(found).range();
        let usual = (quantile(heights.clone(), SPARSE_QUANTILES.0), quantile(heights, SPARSE_QUANTILES.1));
        let (low, high) = with_margins(usual.0.zip(usual.1).ok_or_else(too_few)?, searched);

        let provisional =
            SiteGrid::at(scene.center().ok_or(SiteSceneError::NoCommonGround)?.at_height(median))?;
        let valid = valid_parts(scene)?;
        let (west, south, east, north) = match &scene.aoi {
            Some(aoi) => aoi.utm_box(&provisional),
            None => {
                let parts: Vec<(Rpc, usize, usize)> =
                    rpcs.iter().zip(&valid).filter_map(footprint_part).collect();
                let footprints: Vec<_> = parts.iter().map(|(rpc, w, h)| (rpc, *w, *h)).collect();
                default_aoi(&footprints, &provisional, median).ok_or(SiteSceneError::NoCommonGround)?
            }
        };
        // With an origin at whole metres, coordinates are easy to convert by hand.
        let origin = Point::new((0.5 * (west + east)).round(), (0.5 * (south + north)).round(), median);
        let site = SiteGrid { epsg: provisional.epsg, origin };
        let area = (west - origin.x(), south - origin.y(), east - origin.x(), north - origin.y());

        let altitudes = (low - median, high - median);
        let searched = (searched.0 - median, searched.1 - median);
        let frame = SiteFrame { site, area, altitudes, searched, reference: None };
        Ok(Self { is_framed: false, ..Self::with_cameras(scene, rpcs, &valid, frame)? })
    }

    /// Sets up the training scene in a given frame, as part of a larger scene. `rpcs` holds the adjusted cameras in the order
    /// of the scene's views.
    ///
    /// Pixels are trained on if their whole ray between the altitudes lies in the area.
    ///
    /// # Errors
    /// [`SiteSceneError`] when there is no training view or the frame names another one, when a view is too oblique, has no
    /// approximation or cannot be read.
    pub fn in_frame(scene: &Scene, rpcs: &[Rpc], frame: SiteFrame) -> Result<Self, SiteSceneError> {
        let valid = valid_parts(scene)?;
        Self::with_cameras(scene, rpcs, &valid, frame)
    }

    /// The training scene in a frame, with cameras that are fitted over its area and the altitudes that are searched. `valid` holds the valid part of
    /// every view.
    fn with_cameras(
        scene: &Scene,
        rpcs: &[Rpc],
        valid: &[ValidPart],
        frame: SiteFrame,
    ) -> Result<Self, SiteSceneError> {
        let SiteFrame { site, area, altitudes, searched, reference } = frame;
        let height = site.origin.z();
        let view = |((view, rpc), valid): ((&View, &Rpc), &ValidPart)| {
            let elevation_deg = view.direction_deg(height).map_or(0.0, |(_, off_nadir)| 90.0 - off_nadir);
            if elevation_deg < LOWEST_ELEVATION_DEG {
                return Err(SiteSceneError::LowView { view: view.name.clone(), elevation_deg });
            }
            let f = fit(rpc, area, searched, &site, Order::Quadratic)
                .map_err(|source| SiteSceneError::Fit { view: view.name.clone(), source })?;
            let sun = view.sun.filter(|s| s.elevation_deg >= LOWEST_ELEVATION_DEG);
            Ok(SiteView {
                name: view.name.clone(),
                role: view.role,
                size: (view.width, view.height),
                is_masked: valid.is_masked,
                camera: f.camera,
                rms_px: f.rms_px,
                max_px: f.max_px,
                sun_shear: sun.map(|s| f.camera.shear_towards(sun_direction(s, &site))),
            })
        };
        let views = scene.views.iter().zip(rpcs).zip(valid).map(view).collect::<Result<Vec<_>, _>>()?;
        let reference = match reference {
            Some(name) => {
                let is_named = |v: &SiteView| v.role == Role::Train && v.name == name;
                views.iter().position(is_named).ok_or(SiteSceneError::NoReference { view: name })?
            }
            None => reference_view(scene, height).ok_or(SiteSceneError::NoViews)?,
        };
        let transfer_function = scene.transfer_function;
        Ok(Self { site, area, altitudes, searched, views, reference, is_framed: true, transfer_function })
    }

    /// Extends the altitudes of splats to those of a surface, of which the lowest and highest altitude are given (metres), with
    /// margins.
    pub fn include_surface(&mut self, surface: (f64, f64)) {
        let (low, high) = with_margins(surface, self.searched);
        self.altitudes = (self.altitudes.0.min(low), self.altitudes.1.max(high));
    }

    /// The sparse points in the site frame that lie within the area and the altitudes.
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

    /// The training views with their pixels, read from the images.
    ///
    /// # Errors
    /// [`SiteSceneError::Raster`] when an image cannot be read.
    pub fn training_views(&self, scene: &Scene) -> Result<Vec<TrainingView>, SiteSceneError> {
        let pairs = self.views.iter().zip(&scene.views).filter(|(f, _)| f.role == Role::Train);
        pairs
            .map(|(f, view)| {
                let planes = view.read_colors()?;
                let (area, altitudes) = (self.area, self.ray_altitudes());
                let view = TrainingView::new(f.name.clone(), f.camera, f.sun_shear, &planes, area, altitudes);
                Ok(view.with_transfer_function(self.transfer_function))
            })
            .collect()
    }

    /// The altitudes between which the ray of a pixel must lie in the area for the pixel to be used: all in a
    /// [`SiteFrame`], because pixels at its border also show what lies beyond; that of the site's origin otherwise.
    #[must_use]
    pub fn ray_altitudes(&self) -> (f64, f64) {
        if self.is_framed { self.altitudes } else { (0.0, 0.0) }
    }

    /// The extent of the scene in the sense of 3DGS, metres: half the diagonal of the area, or of a typical area if the scene
    /// is part of a larger one.
    #[must_use]
    pub fn half_side_m(&self) -> f64 {
        if self.is_framed {
            return REFERENCE_HALF_DIAGONAL_M;
        }
        let (west, south, east, north) = self.area;
        0.5 * (east - west).hypot(north - south)
    }

    /// Index of the reference view among the training views.
    #[must_use]
    pub fn reference_among_training(&self) -> usize {
        self.views[..self.reference].iter().filter(|v| v.role == Role::Train).count()
    }
}

/// Lowest and highest height of splats around a surface or points between two heights, within those that are searched, metres.
#[must_use]
pub fn with_margins((low, high): (f64, f64), searched: (f64, f64)) -> (f64, f64) {
    let (low, high) = (low - MARGIN_BELOW_M, high + MARGIN_ABOVE_M);
    (low.max(searched.0).min(searched.1), high.max(searched.0).min(searched.1))
}

/// Where the valid pixels of a view are.
struct ValidPart {
    /// Whether some pixels are not valid.
    is_masked: bool,
    /// Their bounding box; none without valid pixels.
    bounds: Option<Window>,
}

/// The valid parts of all views of a scene. Masks are as large as whole images and are dropped one by one.
fn valid_parts(scene: &Scene) -> Result<Vec<ValidPart>, RasterError> {
    let part = |view: &View| {
        let valid = view.valid_pixels()?;
        let whole = Window { col: 0, row: 0, width: view.width, height: view.height };
        Ok(ValidPart {
            is_masked: valid.is_some(),
            bounds: valid.map_or(Some(whole), |valid| valid.bounds()),
        })
    };
    scene.views.par_iter().map(part).collect()
}

/// The camera, columns and rows of the valid part of a view. None without valid pixels.
fn footprint_part((rpc, valid): (&Rpc, &ValidPart)) -> Option<(Rpc, usize, usize)> {
    let part = valid.bounds?;
    let rpc = if valid.is_masked { rpc.cropped(part.col, part.row) } else { rpc.clone() };
    Some((rpc, part.width, part.height))
}

/// The training view with the smallest sum of the angle off nadir and the angle of the sun from the zenith.
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
