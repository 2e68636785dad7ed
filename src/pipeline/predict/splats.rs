//! From points and views to splats, of satellite scenes and of photographs.

use crate::affine::{SiteScene, TrainingView};
use crate::frame::SiteBox;
use crate::pipeline::PipelineError;
use crate::predict::input::SeenCloud;
use crate::predict::light::{Light, calibrate};
use crate::predict::observer::SatelliteImages;
use crate::predict::photographs::{EnlargedCloud, reduced};
use crate::predict::{CleanUp, Cloud, Predictor, predict, reference};
use crate::progress::{Event, Progress};
use crate::splat::appearance::Appearance;
use crate::splat::pinhole::PinholeView;
use crate::splat::splats::Splats;
use serde::{Deserialize, Serialize};

/// Share of dropped points from which they look like those of something else.
const MANY_DROPPED: f64 = 0.15;

/// Splats of points without a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Untrained {
    /// An isotropic one for each point.
    Isotropic,
    /// A flat one along the surface for each point.
    Flat,
}

/// How splats of photographs are made unless a model is named: the model of the program has seen towns from above, and of
/// photographs its splats are worse than flat ones.
pub const OF_PHOTOGRAPHS: Option<Untrained> = Some(Untrained::Flat);

/// Splats of points, and the colour models of the views.
pub struct SplatsOfPoints {
    pub splats: Splats,
    pub lights: Vec<Appearance>,
    pub clean_up: CleanUp,
    pub spacing_m: f64,
}

/// The splats of points (site frame, metres) of a satellite scene, by a model, or without one.
pub fn of_points(
    setup: &SiteScene,
    views: &[TrainingView],
    points: &[[f64; 3]],
    model: &Predictor,
    untrained: Option<Untrained>,
    progress: &dyn Progress,
) -> Result<SplatsOfPoints, PipelineError> {
    let sampling = *model.sampling();
    let (west, south, east, north) = setup.area;
    let (low, high) = setup.altitudes;
    let is_inside = |p: &&[f64; 3]| {
        (west..=east).contains(&p[0]) && (south..=north).contains(&p[1]) && (low..=high).contains(&p[2])
    };
    let inside: Vec<[f64; 3]> = points.iter().filter(is_inside).copied().collect();
    let (cloud, clean_up) = Cloud::new(&inside, sampling.spacing_m)?;
    let surface = reference::surface(&cloud, &sampling, setup.area, true);
    let images = SatelliteImages::new(views, &surface, setup.altitudes);
    let lights = calibrate(&images, cloud.positions(), setup.reference_among_training());
    let maps = model.image_network().map(|n| n.maps_of(views, progress)).transpose()?;
    let seen = SeenCloud::new(&cloud, &images, &lights).with_maps(maps.as_ref());
    warn_of_dropped(&clean_up, progress);
    let splats = splats(&seen, setup.area, true, model, untrained, progress)?;
    let lights = lights.iter().map(Light::appearance).collect();
    Ok(SplatsOfPoints { splats, lights, clean_up, spacing_m: cloud.spacing_m() })
}

/// The splats of points (site frame) of photographs, by a model, or without one.
pub fn of_photographed_points(
    views: &[PinholeView],
    points: &[[f64; 3]],
    model: &Predictor,
    untrained: Option<Untrained>,
    progress: &dyn Progress,
) -> Result<SplatsOfPoints, PipelineError> {
    let sampling = *model.sampling();
    let enlarged = EnlargedCloud::new(points, &sampling)?;
    let views: Vec<&PinholeView> = views.iter().collect();
    let maps = model.image_network().map(|n| n.maps_of_photographs(&views, progress)).transpose()?;
    warn_of_dropped(&enlarged.clean_up, progress);
    let larger = enlarged.with_views(&views, &sampling, maps.as_ref(), |seen| {
        splats(seen, enlarged.area, false, model, untrained, progress)
    })?;
    let EnlargedCloud { cloud, clean_up, scale, .. } = enlarged;
    let splats = reduced(larger, scale);
    Ok(SplatsOfPoints { splats, lights: Vec::new(), clean_up, spacing_m: cloud.spacing_m() / scale })
}

/// Splats by a model, or without one.
fn splats(
    seen: &SeenCloud,
    area: SiteBox,
    has_walls: bool,
    model: &Predictor,
    untrained: Option<Untrained>,
    progress: &dyn Progress,
) -> Result<Splats, PipelineError> {
    Ok(match untrained {
        Some(Untrained::Isotropic) => reference::isotropic(seen),
        Some(Untrained::Flat) => reference::flattened(seen),
        None => predict(model, seen, area, has_walls, progress)?,
    })
}

fn warn_of_dropped(clean_up: &CleanUp, progress: &dyn Progress) {
    if clean_up.dropped_share() > MANY_DROPPED {
        let (dropped, percent) = (clean_up.dropped, 100.0 * clean_up.dropped_share());
        progress.event(Event::Warning(format!(
            "{dropped} points ({percent:.0} %) are far from all others and were dropped: are the points of this area?"
        )));
    }
}
