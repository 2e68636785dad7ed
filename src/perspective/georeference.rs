//! Where a perspective scene lies on Earth: a similarity from the frame of its file to a site frame.

use super::error::PerspectiveError;
use super::pose::Pose;
use super::similarity::SimilarityTransform;
use crate::frame::{Point, Site, SiteGrid, Transform, Utm, utm_epsg};
use crate::io::is_metric_map;
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// EPSG code of longitude, latitude in degrees.
pub(super) const LON_LAT: u32 = 4326;
/// Largest height above the ellipsoid that is taken for one, metres.
const HIGHEST_M: f64 = 100e3;

/// A similarity from the frame of a file to the site frame: `site = scale * rotation * file + translation`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Georeference {
    /// The site frame.
    pub grid: SiteGrid,
    /// Metres of a unit of the file.
    pub scale: f64,
    /// Rotation from file axes to site axes, row by row.
    pub rotation: [[f64; 3]; 3],
    /// Site position of the file's origin, metres.
    pub translation: [f64; 3],
    /// Root mean square distance of camera centres from the positions to which they were fitted, metres; none if the
    /// similarity was given.
    pub rms_m: Option<f64>,
    /// Number of positions to which it was fitted.
    pub positions: usize,
}

/// A similarity to map coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct MapSimilarity {
    /// EPSG code of the map projection, metres.
    pub epsg: u32,
    /// The similarity from file to map coordinates.
    pub fitted: SimilarityTransform,
    /// See [`Georeference::positions`]; 0 if the similarity was given.
    pub positions: usize,
}

impl Georeference {
    /// The georeference whose site has its origin at the median of some points in the frame of the file, on whole metres.
    pub(super) fn new(map: MapSimilarity, points: &[DVec3]) -> Result<Self, PerspectiveError> {
        let MapSimilarity { epsg, fitted, positions } = map;
        let mapped: Vec<DVec3> = points.iter().map(|p| fitted.apply(*p)).collect();
        let middle = |axis: usize| {
            crate::stats::quantile(mapped.iter().map(|p| p[axis]).collect(), 0.5).unwrap_or(0.0).round()
        };
        let origin = DVec3::new(middle(0), middle(1), middle(2));
        // A code that PROJ cannot convert would only fail later.
        Transform::new(epsg, LON_LAT)?;
        let translation = (fitted.translation - origin).to_array();
        Ok(Self {
            grid: SiteGrid { epsg, origin: Point::<Utm>::new(origin.x, origin.y, origin.z) },
            scale: fitted.scale,
            rotation: fitted.rotation.transpose().to_cols_array_2d(),
            translation,
            rms_m: (positions > 0).then_some(fitted.rms),
            positions,
        })
    }

    fn matrix(&self) -> DMat3 {
        DMat3::from_cols_array_2d(&self.rotation).transpose()
    }

    /// Site position of a position in the frame of the file.
    #[must_use]
    pub fn site_from_file(&self, p: [f64; 3]) -> Point<Site> {
        let site = self.scale * (self.matrix() * DVec3::from_array(p)) + DVec3::from_array(self.translation);
        Point::new(site.x, site.y, site.z)
    }

    /// The pose in the site frame of a pose in the frame of the file.
    pub(super) fn pose(&self, pose: Pose) -> Pose {
        Pose {
            cam_from_world: pose.cam_from_world * self.matrix().transpose(),
            center: DVec3::from_array(self.site_from_file(pose.center.to_array()).xyz()),
        }
    }
}

/// A position of a camera as a list or a photograph states it: in the coordinates of an EPSG code (longitude and latitude
/// in this order), with a height in metres above the ellipsoid.
pub(super) type Position = [f64; 3];

/// The similarity that brings camera centres nearest to stated positions.
pub(super) fn fit_positions(
    source: &Path,
    epsg: u32,
    pairs: &[(DVec3, Position)],
) -> Result<MapSimilarity, PerspectiveError> {
    let refused = |reason: String| PerspectiveError::Georeference { path: source.into(), reason };
    for (_, [x, y, height]) in pairs {
        let sound = x.is_finite() && y.is_finite() && height.abs() < HIGHEST_M;
        let on_earth = epsg != LON_LAT || (x.abs() <= 180.0 && y.abs() <= 90.0);
        if !sound || !on_earth {
            return Err(refused(format!("{x} {y} {height} is no position in EPSG:{epsg}")));
        }
    }
    let Some((_, [x, y, _])) = pairs.first() else {
        return Err(refused("no image of the scene has a position".into()));
    };
    let (map_epsg, transform) = if epsg == LON_LAT {
        let zone = utm_epsg(*x, *y)?;
        (zone, Some(Transform::new(LON_LAT, zone)?))
    } else if is_metric_map(epsg) {
        (epsg, None)
    } else {
        return Err(refused(format!("EPSG:{epsg} is neither a map projection in metres nor 4326")));
    };
    let map = |[x, y, height]: Position| {
        let (east, north) = transform.as_ref().map_or((x, y), |t| t.convert(x, y));
        DVec3::new(east, north, height)
    };
    let pairs: Vec<(DVec3, DVec3)> = pairs.iter().map(|(c, p)| (*c, map(*p))).collect();
    let fitted = SimilarityTransform::to(&pairs).map_err(refused)?;
    Ok(MapSimilarity { epsg: map_epsg, fitted, positions: pairs.len() })
}
