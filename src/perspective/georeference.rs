//! Where a perspective scene lies on Earth: a similarity from the frame of its file to a site frame.

use super::error::PerspectiveError;
use super::pose::Pose;
use super::similarity::SimilarityTransform;
use super::similarity_fit::{DETERMINED_DEG, DirectionPair, MOST_SIGMAS, PointPair, SimilarityFit};
use super::stated_position::StatedPosition;
use crate::frame::{Point, Site, SiteGrid, Transform, Utm, metres_of_unit, utm_epsg, utm_of_map};
use crate::io::is_metric_map;
use crate::stats::{FitQuality, median};
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::Path;

/// EPSG code of longitude, latitude in degrees.
pub(super) const LON_LAT: u32 = 4326;
/// Largest height above the ellipsoid that is taken for one, metres.
const HIGHEST_M: f64 = 100e3;
/// Coordinate of places that a map cannot show, metres: twice the circumference of the Earth.
const BEYOND_MAP_M: f64 = 8e7;
/// Standard deviation of the attitude that a drone's gimbal states, degrees.
const GIMBAL_SIGMA_DEG: f64 = 1.0;
/// Photographs whose lines of sight are all within this angle of their mean are taken as nadir photographs, and the
/// standard deviation of the mean of such from the vertical, degrees: stabilised mounts stay within 3.
const NADIR_SPREAD_DEG: f64 = 10.0;
const NADIR_SIGMA_DEG: f64 = 2.0;
/// Cameras whose lines of sight rise by more than this on average look upwards (sine of 30 degrees).
const UPWARDS: f64 = 0.5;

/// A similarity from the frame of a file to the site frame: `site = scale * rotation * file + translation`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Georeference {
    /// The site frame.
    pub grid: SiteGrid,
    /// Metres of a unit of the file.
    pub scale: f64,
    /// Rotation from file axes to site axes, row by row.
    pub rotation: [[f64; 3]; 3],
    /// Site position of the file's origin, metres.
    pub translation: [f64; 3],
    /// The fit of camera centres to stated positions; none if the similarity was given.
    #[serde(default)]
    pub fit: Option<PositionFit>,
}

/// How well stated positions determine a georeference.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PositionFit {
    /// Agreement of the camera centres with the positions.
    #[serde(flatten)]
    pub quality: FitQuality,
    /// Standard deviation of the vertical, degrees.
    pub tilt_sigma_deg: f64,
    /// Standard deviation of the heading, degrees.
    pub heading_sigma_deg: f64,
    /// What completes the vertical, where the positions leave it open.
    pub prior: Option<String>,
    /// Images whose position is 0, 0.
    pub without_fix: Vec<String>,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// A similarity to map coordinates.
#[derive(Clone, Debug)]
pub(super) struct MapSimilarity {
    /// EPSG code of the map projection, metres.
    pub epsg: u32,
    /// The similarity from file to map coordinates.
    pub transform: SimilarityTransform,
    /// See [`Georeference::fit`].
    pub fit: Option<PositionFit>,
}

impl Georeference {
    /// The georeference whose site has its origin at the median of some points in the frame of the file, on whole metres.
    pub(super) fn new(map: MapSimilarity, points: &[DVec3]) -> Result<Self, PerspectiveError> {
        let MapSimilarity { epsg, transform: fitted, fit } = map;
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
            fit,
        })
    }

    /// What the user should know about it.
    pub fn warnings(&self) -> impl Iterator<Item = &String> {
        self.fit.iter().flat_map(|fit| &fit.warnings)
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

impl fmt::Display for Georeference {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let [east, north, height] = self.grid.origin.xyz();
        write!(
            f,
            "georeference: EPSG:{}, origin {east:.0} {north:.0} {height:.0}, {:.4} m a unit of the file",
            self.grid.epsg, self.scale
        )?;
        let Some(PositionFit { quality, tilt_sigma_deg, heading_sigma_deg, .. }) = &self.fit else {
            return Ok(());
        };
        let FitQuality { points, redundancy, rms_m, worst, .. } = quality;
        write!(f, "; {points} camera positions fitted with an RMS of {rms_m:.2} m, redundancy {redundancy}")?;
        if let Some((name, distance_m)) = worst {
            write!(f, ", worst `{name}` {distance_m:.2} m")?;
        }
        write!(
            f,
            "; vertical to {tilt_sigma_deg:.2}°, heading to {heading_sigma_deg:.2}° (standard deviations)"
        )
    }
}

/// The similarity that brings camera centres nearest to stated positions.
pub(super) fn fit_positions(
    source: &Path,
    epsg: u32,
    positions: &[StatedPosition],
) -> Result<MapSimilarity, PerspectiveError> {
    let refused = |reason: String| PerspectiveError::Georeference { path: source.into(), reason };
    for StatedPosition { name, position: [x, y, height], .. } in positions {
        let sound = x.is_finite() && y.is_finite() && height.abs() < HIGHEST_M;
        let on_earth = epsg != LON_LAT || (x.abs() <= 180.0 && y.abs() <= 90.0);
        if !sound || !on_earth {
            return Err(refused(format!("{x} {y} {height} of `{name}` is no position in EPSG:{epsg}")));
        }
    }
    // Receivers without a fix write zeros.
    let (fixed, without_fix): (Vec<&StatedPosition>, Vec<_>) =
        positions.iter().partition(|p| p.position[..2] != [0.0, 0.0]);
    let without_fix: Vec<String> = without_fix.iter().map(|p| p.name.clone()).collect();
    if fixed.is_empty() {
        return Err(refused("no image of the scene has a position".into()));
    }
    let (map_epsg, transform) = if epsg == LON_LAT {
        let zone = robust_zone(&fixed)?;
        (zone, Some(Transform::new(LON_LAT, zone)?))
    } else if is_metric_map(epsg) {
        let at = [0, 1].map(|k| median(fixed.iter().map(|p| p.position[k]).collect()).unwrap_or(0.0));
        // Units of Web Mercator are no metres on the ground, and heights are.
        if metres_of_unit(epsg, at)? == 1.0 {
            (epsg, None)
        } else {
            let zone = utm_of_map(epsg, at)?;
            (zone, Some(Transform::new(epsg, zone)?))
        }
    } else {
        return Err(refused(format!("EPSG:{epsg} is neither a map projection in metres nor 4326")));
    };
    let pair = |p: &&StatedPosition| {
        let [x, y, height] = p.position;
        let (east, north) = transform.as_ref().map_or((x, y), |t| t.convert(x, y));
        // Places that the zone cannot show are as far away as can be.
        let on_map = |v: f64| if v.is_finite() { v } else { BEYOND_MAP_M };
        let to = DVec3::new(on_map(east), on_map(north), height);
        PointPair { name: p.name.clone(), from: p.pose.center, to, sigma_m: p.sigma_m }
    };
    let pairs: Vec<PointPair> = fixed.iter().map(pair).collect();
    let (fitted, prior) = fit_with_vertical(&pairs, &fixed).map_err(refused)?;
    let up =
        fixed.iter().map(|p| (fitted.transform.rotation * p.forward()).z).sum::<f64>() / fixed.len() as f64;
    let mut warnings = Vec::new();
    if let Some(names) = fitted.quality.left_out_text() {
        warnings.push(format!("positions that disagree with the others are left out: {names}"));
    }
    if !without_fix.is_empty() {
        warnings
            .push(format!("positions of 0, 0 are no fix and are left out: `{}`", without_fix.join("`, `")));
    }
    if let Some(prior) = &prior {
        warnings.push(format!(
            "the camera positions alone do not determine the vertical; {prior} completes it, to {:.1}°",
            fitted.tilt_sigma_deg()
        ));
    }
    if up > UPWARDS {
        warnings.push(format!(
            "the cameras look upwards, by {:.0}° on average: are easting and northing, or longitude and latitude, swapped?",
            up.min(1.0).asin().to_degrees()
        ));
    }
    let (tilt_sigma_deg, heading_sigma_deg) = (fitted.tilt_sigma_deg(), fitted.heading_sigma_deg());
    let fit = PositionFit {
        quality: fitted.quality,
        tilt_sigma_deg,
        heading_sigma_deg,
        prior,
        without_fix,
        warnings,
    };
    Ok(MapSimilarity { epsg: map_epsg, transform: fitted.transform, fit: Some(fit) })
}

/// The UTM zone of the middle of positions in longitude and latitude, of which some may be wrong.
fn robust_zone(positions: &[&StatedPosition]) -> Result<u32, PerspectiveError> {
    // The medians of vectors from the Earth's centre pass the date line.
    let on_sphere = |p: &&StatedPosition| {
        let [lon, lat] = [p.position[0], p.position[1]].map(f64::to_radians);
        [lon.cos() * lat.cos(), lon.sin() * lat.cos(), lat.sin()]
    };
    let middle = |k: usize| median(positions.iter().map(|p| on_sphere(p)[k]).collect()).unwrap_or(0.0);
    let [x, y, z] = std::array::from_fn(middle);
    Ok(utm_epsg(y.atan2(x).to_degrees(), z.atan2(x.hypot(y)).to_degrees())?)
}

/// The fit of positions. Where they leave the vertical open, as those of one flight line do, it is completed by what the
/// photographs tell of it, which is the second value.
fn fit_with_vertical(
    pairs: &[PointPair],
    positions: &[&StatedPosition],
) -> Result<(SimilarityFit, Option<String>), String> {
    let alone = SimilarityFit::new(pairs, &[])?;
    let gimbals = of_gimbals(positions);
    let prior = match &gimbals {
        Some(known) => Some(known.clone()),
        None if alone.tilt_sigma_deg() > DETERMINED_DEG => of_nadir_views(positions),
        None => None,
    };
    if let Some((direction, what)) = &prior {
        let off_deg = (alone.transform.rotation * direction.from).angle_between(direction.to).to_degrees();
        let likely_deg = alone.tilt_sigma_deg().hypot(direction.sigma_deg);
        if off_deg > MOST_SIGMAS * likely_deg {
            return Err(format!(
                "the vertical of the camera positions and {what} differ by {off_deg:.0}°; {likely_deg:.1}° are likely ({})",
                alone.quality
            ));
        }
    }
    let (fit, prior) = match prior.filter(|_| alone.tilt_sigma_deg() > DETERMINED_DEG) {
        Some((direction, what)) => (SimilarityFit::new(pairs, &[direction])?, Some(what)),
        None => (alone, None),
    };
    let (tilt_deg, heading_deg) = (fit.tilt_sigma_deg(), fit.heading_sigma_deg());
    if (prior.is_none() && tilt_deg > DETERMINED_DEG) || heading_deg > DETERMINED_DEG {
        let degrees =
            |sigma: f64| if sigma < 90.0 { format!("to {sigma:.1}°") } else { "not at all".into() };
        return Err(format!(
            "the camera positions determine the vertical {}, the heading {}; {DETERMINED_DEG}° are needed ({})",
            degrees(tilt_deg),
            degrees(heading_deg),
            fit.quality
        ));
    }
    Ok((fit, prior))
}

/// The vertical by the gimbal angles that photographs state, if at least half of them do.
fn of_gimbals(positions: &[&StatedPosition]) -> Option<(DirectionPair, String)> {
    let ups: Vec<DVec3> = positions.iter().filter_map(|p| p.up()).collect();
    let from = ups.iter().sum::<DVec3>().try_normalize().filter(|_| 2 * ups.len() >= positions.len())?;
    let what = format!("the attitude of {} gimbals", ups.len());
    Some((DirectionPair { from, to: DVec3::Z, sigma_deg: GIMBAL_SIGMA_DEG }, what))
}

/// The vertical by the mean line of sight, if all cameras look in one direction as those of nadir photographs do.
fn of_nadir_views(positions: &[&StatedPosition]) -> Option<(DirectionPair, String)> {
    let from = positions.iter().map(|p| p.forward()).sum::<DVec3>().try_normalize()?;
    let widest = positions.iter().map(|p| p.forward().angle_between(from).to_degrees()).fold(0.0, f64::max);
    let what = "the assumption that the photographs look straight down".to_owned();
    let direction = DirectionPair { from, to: DVec3::NEG_Z, sigma_deg: NADIR_SIGMA_DEG };
    (widest <= NADIR_SPREAD_DEG).then_some((direction, what))
}
