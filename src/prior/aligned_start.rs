//! Points for training to start from, by priors of depths that are aligned with the points of the scene (GeoProp-GS §3.1, §3.2).

use super::error::PriorError;
use super::hdd::cloud::{AlignedView, SurfacePoint, cloud};
use super::hdd::{AlignedDepth, Unaligned, align_depth};
use super::inpaint::InpaintCommand;
use super::map::{DepthPrior, PixelColor};
use super::pseudo_views::{PseudoView, holes_of, proposals, pseudo_views};
use super::seen::seen_points;
use crate::frame::{Point, Site};
use crate::perspective::{PerspectiveView, PinholeCamera, ScenePoint};
use crate::progress::{Event, Progress};
use rayon::prelude::*;
use std::path::Path;

/// A view with a prior of its depths.
pub struct StartView<'a> {
    /// The view.
    pub view: &'a PerspectiveView,
    /// The prior.
    pub depth: &'a DepthPrior,
    /// Its colours.
    pub color: PixelColor<'a>,
}

/// Whether and how points are added where no view sees anything.
#[derive(Clone, Copy, Debug)]
pub enum Completion<'a> {
    /// They are not.
    None,
    /// At the filled holes of pseudo-views.
    PseudoViews,
    /// As `PseudoViews`, in the colours that a command gives the holes. The folder keeps its pictures.
    Inpainted(&'a InpaintCommand, &'a Path),
}

/// What training starts from.
#[derive(Clone, Debug)]
pub struct AlignedStart {
    /// Points behind the pixels of the views.
    pub points: Vec<ScenePoint>,
    /// Points where no view sees anything, black unless their colours were painted.
    pub proposals: Vec<ScenePoint>,
    /// Names and depths of the views whose depths were aligned.
    pub views: Vec<(String, AlignedDepth)>,
    /// The pseudo-views that proposals come from.
    pub pseudo_views: Vec<PseudoView>,
    /// For each of the other views, whether a pixel shows what no view sees.
    pub unseen: Vec<UnseenPixels>,
}

/// The pixels of a view that show what no view with a prior sees.
#[derive(Clone, Debug)]
pub struct UnseenPixels {
    /// Name of the view.
    pub name: String,
    /// Columns and rows.
    pub size: (usize, usize),
    /// Whether each pixel does, row by row.
    pub pixels: Vec<bool>,
}

/// Aligns the depths of all views with the points of the scene that they see, and puts a point behind each pixel, but not more than
/// about `most` in all; with a `completion` also where pseudo-views have holes. `others` are views that are not trained on. Views that
/// cannot be aligned are reported and left out.
///
/// # Errors
/// [`PriorError::Unaligned`] if the depths of no view can be aligned, others if a command fails.
pub fn aligned_start(
    points: &[Point<Site>],
    views: &[StartView],
    others: &[&PerspectiveView],
    most: usize,
    completion: Completion,
    progress: &dyn Progress,
) -> Result<AlignedStart, PriorError> {
    progress.event(Event::Started { stage: "aligning depths", total: 0 });
    let aligned: Vec<_> =
        views.par_iter().map(|v| align_depth(v.depth, &seen_points(points, v.view))).collect();
    let (mut found, mut of_cloud) = (Vec::new(), Vec::<(&PinholeCamera, &PixelColor)>::new());
    let mut first = None;
    for (view, aligned) in views.iter().zip(aligned) {
        let name = &view.view.name;
        match aligned {
            Ok(aligned) => {
                of_cloud.push((&view.view.camera, &view.color));
                found.push((name.clone(), aligned));
            }
            Err(why) => {
                let text = reason(why);
                progress.event(Event::Warning(format!("the depths of `{name}` are not used: {text}")));
                first.get_or_insert((name.clone(), text));
            }
        }
    }
    if let (true, Some((view, reason))) = (found.is_empty(), first) {
        return Err(PriorError::Unaligned { view, reason });
    }
    let of_cloud = of_cloud.into_iter().zip(&found);
    let of_cloud: Vec<AlignedView> = of_cloud
        .map(|((camera, color), (_, aligned))| AlignedView { camera, depth: &aligned.depth, color })
        .collect();
    let surface = cloud(&of_cloud, most);
    let mut pseudo = match completion {
        Completion::None => Vec::new(),
        Completion::PseudoViews | Completion::Inpainted(..) => pseudo_views(&of_cloud, &surface),
    };
    progress.event(Event::Finished);
    if let Completion::Inpainted(command, folder) = completion {
        command.fill(&mut pseudo, folder, progress)?;
    }
    let proposals = proposals(&of_cloud, &surface, &pseudo);
    let unseen = others.par_iter().map(|view| UnseenPixels {
        name: view.name.clone(),
        size: view.camera.size,
        pixels: holes_of(&surface, &view.camera),
    });
    let unseen = unseen.collect();
    let points = |surface: Vec<SurfacePoint>| {
        surface.iter().map(|p| ScenePoint { position: p.point(), rgb: p.rgb }).collect()
    };
    Ok(AlignedStart {
        points: points(surface),
        proposals: points(proposals),
        views: found,
        pseudo_views: pseudo,
        unseen,
    })
}

fn reason(why: Unaligned) -> String {
    match why {
        Unaligned::FewPoints(points) => format!(
            "the view sees {points} points of the scene with a value of the prior, and {} are needed",
            super::hdd::FEWEST_POINTS
        ),
        Unaligned::NoFit => "no scale and shift bring half of its values to the points of the scene".into(),
    }
}
