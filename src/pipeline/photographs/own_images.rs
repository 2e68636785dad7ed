//! Whether the images of a scene show its points: a model may have been moved without its points, or be that of other images.

use super::super::PipelineError;
use crate::frame::{Point, Site};
use crate::perspective::{PerspectiveScene, PerspectiveView};
use crate::prior::seen_points;
use crate::progress::{Event, Progress};
use crate::splat::pinhole::PinholeView;
use crate::stats::quantile;
use rayon::prelude::*;
use std::path::Path;

/// Points of a model miss their keypoints by a pixel, and by four at most (COLMAP's filter): more is no error of measurement.
const MOST_MISSED_PX: f64 = 10.0;
/// Fewest points of a view that tell whether it shows their colours.
const FEWEST: usize = 30;
/// Least standard deviation of grey values, 0 to 255, of colours that tell something.
const LEAST_CONTRAST: f64 = 4.0;
/// Correlation of the colours of points with the image: those of other images have less, those of the points' own 0.6 and more.
const OF_OTHERS: f64 = 0.25;
const OF_OWN: f64 = 0.5;

/// Refuses images that do not show the colours of the points that a model says they show, and models whose points miss their
/// images. Where nothing says which points an image shows, their colours may not be those of the images, and this is a warning.
pub fn require_own_images(
    path: &Path,
    scene: &PerspectiveScene,
    views: &[PinholeView],
    progress: &dyn Progress,
) -> Result<(), PipelineError> {
    let by_name = |view: &PinholeView| scene.views.iter().find(|v| v.name == view.name);
    let points: Vec<_> = scene.points.iter().map(|p| p.position).collect();
    let agreements: Vec<f64> =
        views.par_iter().filter_map(|view| color_agreement(scene, &points, by_name(view)?, view)).collect();
    let count = agreements.len();
    let agreement = quantile(agreements, 0.5);
    let missed_px = PerspectiveScene::reprojection(path)?.map_or(0.0, |r| r.mean_px);
    let missed =
        format!("points miss the places in the images where the model has them by {missed_px:.0} px (mean)");
    tracing::debug!("correlation of the colours of points and images: {agreement:?} of {count} views");
    if let Some(agreement) = agreement.filter(|a| *a < OF_OTHERS) {
        let mut reason = format!(
            "the colours of the points and those of the images where they should show have a correlation of {agreement:.2} \
             (median of {count} views)"
        );
        if missed_px > MOST_MISSED_PX {
            reason += &format!("; {missed}");
        }
        if scene.views.iter().any(|v| !v.observed.is_empty()) {
            return Err(elsewhere(reason));
        }
        progress.event(Event::Warning(format!("{reason}: are the images those of the cameras?")));
    }
    if missed_px > MOST_MISSED_PX {
        if agreement.is_none_or(|a| a < OF_OWN) {
            return Err(elsewhere(missed));
        }
        progress.event(Event::Warning(format!(
            "{missed}; their colours agree: were the images resized after the model was made?"
        )));
    }
    Ok(())
}

fn elsewhere(reason: String) -> PipelineError {
    PipelineError::Elsewhere {
        what: "the points and the images".into(),
        reason,
        cause: "are the images those of the model, and were points and cameras moved and scaled together? `satgs info SCENE` \
                shows the reprojection error",
    }
}

/// Correlation of the grey values of points with those of a view where it shows them; none if too few tell something.
fn color_agreement(
    scene: &PerspectiveScene,
    points: &[Point<Site>],
    view: &PerspectiveView,
    picture: &PinholeView,
) -> Option<f64> {
    let gray = |rgb: [u8; 3]| rgb.map(f64::from).iter().sum::<f64>() / 3.0;
    let seen = seen_points(points, view);
    let pairs: Vec<(f64, f64)> = seen
        .iter()
        .filter_map(|p| {
            let there = picture.rgb(p.col.round().max(0.0) as usize, p.row.round().max(0.0) as usize)?;
            Some((gray(scene.points.get(p.index)?.rgb), gray(there)))
        })
        .collect();
    if pairs.len() < FEWEST {
        // Points that should show and lie outside of the image agree with nothing.
        return (view.observed.len() >= FEWEST && seen.len() < view.observed.len() / 2).then_some(0.0);
    }
    let n = pairs.len() as f64;
    let (a, b) = pairs.iter().fold((0.0, 0.0), |(a, b), p| (a + p.0 / n, b + p.1 / n));
    let moment = |of: fn((f64, f64)) -> f64| pairs.iter().map(|p| of((p.0 - a, p.1 - b))).sum::<f64>() / n;
    let (aa, bb, ab) = (moment(|p| p.0 * p.0), moment(|p| p.1 * p.1), moment(|p| p.0 * p.1));
    (aa.min(bb).sqrt() >= LEAST_CONTRAST).then(|| ab / (aa * bb).sqrt())
}
