//! Scores of novel views with trained colours, by three protocols.

use crate::affine::{SiteScene, SiteView, TrainingView};
use crate::io::{Grid2, RgbImage, write_json};
use crate::nn::lpips::Lpips;
use crate::pipeline::nvs_scores::{NvsScores, Protocol, ViewScore};
use crate::pipeline::run_folder::colors::SceneColors;
use crate::pipeline::{PipelineError, TrainedCameras, report};
use crate::progress::{Event, Progress};
use crate::run_files::{NVS_PICTURES, NVS_SCORES};
use crate::scene::{Scene, days_of};
use crate::splat::image_score::{ScoredPair, ScoredPart};
use crate::splat::loss::target::TargetImage;
use crate::splat::raster::FrameCamera;
use crate::splat::satellite::{NovelView, Picture, SatelliteStep, fit_view};
use std::path::Path;

/// Mean difference of colours that is shown in full red.
const LARGEST_ERROR: f32 = 0.25;

/// Renders views with trained colours and compares them with their images.
///
/// # Errors
/// [`PipelineError`]: a view has no sun or no date where it needs one, or no valid pixel, an image cannot be read, the caller
/// asked to stop.
pub fn nvs_eval(
    run: &Path,
    colors: &SceneColors,
    scene: &Scene,
    views: &[&SiteView],
    (protocol, lpips): (Protocol, Option<&Lpips<f32>>),
    progress: &dyn Progress,
) -> Result<NvsScores, PipelineError> {
    let setup = TrainedCameras::read(run)?.setup;
    let mut scores = Vec::new();
    progress.event(Event::Started { stage: "scoring views", total: views.len() as u64 });
    for view in views {
        progress.check()?;
        let name = || view.name.clone();
        let source = scene.views.iter().find(|v| v.name == view.name);
        let source = source.ok_or_else(|| PipelineError::ViewNotInScene { run: run.into(), name: name() })?;
        let novel = NovelView::from(*view);
        if novel.sun_shear.is_none() {
            return Err(PipelineError::NoSun { name: name() });
        }
        let mut target = TargetImage::default();
        let (area, altitudes) = (setup.area, setup.ray_altitudes());
        let planes = source.read_colors()?;
        target.load(&TrainingView::new(name(), view.camera, None, &planes, area, altitudes), 0);
        let nearest = nearest(colors, source.acquired.as_deref());
        let embedding = match protocol {
            Protocol::Nearest => nearest.ok_or_else(|| PipelineError::NoDate { name: name() })?.to_vec(),
            _ => fit(
                colors,
                &novel,
                &target,
                protocol,
                nearest.unwrap_or(colors.reference()),
                &setup,
                progress,
            )?,
        };
        let part = if protocol == Protocol::Half { ScoredPart::RightHalf } else { ScoredPart::Whole };
        let picture = colors.picture(&novel, &embedding, &setup);
        let pair = ScoredPair::of_view(&picture.colors, &target, part);
        let panels = panels(&target, &picture, &colors.sunlit(&novel, &setup));
        panels.write(&run.join(format!("{NVS_PICTURES}/{:04}.png", scores.len())))?;
        let score = pair.score_with(lpips)?.ok_or_else(|| PipelineError::NothingToScore { name: name() })?;
        scores.push(ViewScore { view: name(), score, parts: None });
        progress.event(Event::Advanced { done: scores.len() as u64, status: String::new() });
    }
    progress.event(Event::Finished);
    let scores = NvsScores { protocol: Some(protocol), ..NvsScores::with_mean(scores) };
    write_json(&run.join(NVS_SCORES), &scores)?;
    report(run)?;
    Ok(scores)
}

/// Four panels: image, picture, their difference (white is none, red is large), and the share of sunlight.
fn panels(target: &TargetImage, picture: &Picture, sunlit: &Grid2) -> RgbImage {
    let width = sunlit.width;
    let byte = |v: f32| (255.0 * v.clamp(0.0, 1.0)).round() as u8;
    RgbImage::panels((width, sunlit.height), |col, row| {
        let image: [f32; 3] = std::array::from_fn(|c| target.colors.at(c, col, row));
        let found = picture.colors.each_ref().map(|c| c.at(col, row).clamp(0.0, 1.0));
        let error = image.iter().zip(found).map(|(a, b)| (a - b).abs()).sum::<f32>() / 3.0;
        let white = byte(1.0 - error / LARGEST_ERROR);
        let is_valid = target.valid[row * width + col];
        let difference = if is_valid { [255, white, white] } else { RgbImage::NO_DATA };
        [image.map(byte), found.map(byte), difference, [byte(sunlit.at(col, row)); 3]]
    })
}

/// The embedding of the training view taken at the nearest time; none if the times are not known.
fn nearest<'a>(colors: &'a SceneColors, acquired: Option<&str>) -> Option<&'a [f32]> {
    let time = days_of(acquired?)?;
    let views = colors.appearance.content.views.iter().zip(&colors.appearance.embeddings);
    let distances = views.filter_map(|(view, embedding)| {
        let other = days_of(view.acquired.as_deref()?)?;
        Some(((other - time).abs(), &embedding[..]))
    });
    distances.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, embedding)| embedding)
}

/// The embedding that is fitted on the image of a view, or on its left half.
fn fit(
    colors: &SceneColors,
    view: &NovelView,
    target: &TargetImage,
    protocol: Protocol,
    start: &[f32],
    setup: &SiteScene,
    progress: &dyn Progress,
) -> Result<Vec<f32>, PipelineError> {
    let mut target = target.clone();
    let width = view.size.0;
    if protocol == Protocol::Half {
        for (i, valid) in target.valid.iter_mut().enumerate().filter(|(i, _)| i % width >= width / 2) {
            *valid = false;
            (0..3).for_each(|c| *target.colors.at_mut(c, i % width, i / width) = 0.0);
        }
    }
    let input = SatelliteStep {
        camera: FrameCamera::new(&view.camera, view.size.0, view.size.1),
        target: &target.colors,
        valid: &target.valid,
        sun: view.sun(setup.altitudes),
        visibility: None,
        crop: None,
        virtual_view: None,
        background: [0.0; 3],
        floor: setup.altitudes.0 as f32,
        anchored: &[],
    };
    Ok(fit_view(&colors.splats, colors.model(), colors.parameters(start), &input, progress)?)
}
