//! What a surface model is made of: a trained satellite scene, or a perspective scene with a place on Earth.

use super::run_folder::colors::SceneColors;
use super::run_folder::perspective_manifest;
use super::run_folder::satellite_cameras::require_image;
use super::{PerspectiveCameras, PipelineError, TrainedCameras, read_scene, relocation};
use crate::affine::SiteView;
use crate::dsm::{Dsm, HeightsFrom, Seeing, render};
use crate::frame::{SiteBox, SiteGrid};
use crate::io::MapGrid;
use crate::mvs::MatchedSurface;
use crate::run_files::{HEIGHT_SPLATS, SURFACE};
use crate::scene::{Role, View};
use crate::splat::appearance::Appearance;
use crate::splat::harmonics::seen_along;
use crate::splat::ply;
use crate::splat::recipe::RayHeight;
use crate::splat::splats::Splats;
use std::path::Path;

/// Down: the direction in which a map looks.
const DOWN: [f64; 3] = [0.0, 0.0, -1.0];

/// A trained run of which a surface model can be made.
pub(super) enum SurfaceSource {
    /// Of a satellite scene.
    Satellite(Box<TrainedCameras>),
    /// Of a perspective scene, with its site.
    Perspective(Box<PerspectiveCameras>, SiteGrid),
}

impl SurfaceSource {
    /// Reads the cameras of a run; the caller holds the lock.
    pub fn read(run: &Path) -> Result<Self, PipelineError> {
        if perspective_manifest::is_run(run) {
            let cameras = PerspectiveCameras::read(run)?;
            let site = cameras.site.ok_or_else(|| PipelineError::NoGeoreference { run: run.into() })?;
            return Ok(Self::Perspective(Box::new(cameras), site));
        }
        relocation::finish_locked(run)?;
        Ok(Self::Satellite(Box::new(TrainedCameras::read(run)?)))
    }

    /// The site frame.
    pub fn site(&self) -> &SiteGrid {
        match self {
            Self::Satellite(cameras) => &cameras.setup.site,
            Self::Perspective(_, site) => site,
        }
    }

    /// The trained area.
    pub fn area(&self) -> SiteBox {
        match self {
            Self::Satellite(cameras) => cameras.setup.area,
            Self::Perspective(cameras, _) => cameras.area,
        }
    }

    /// Whether the views that see a cell are counted.
    pub fn counts_views(&self) -> bool {
        matches!(self, Self::Satellite(_))
    }

    /// Renders the surface on a map grid.
    pub fn surface(&self, run: &Path, grid: MapGrid) -> Result<Dsm, PipelineError> {
        match self {
            Self::Satellite(cameras) => {
                let splats = surface_splats(cameras, run)?;
                let read = || MatchedSurface::read(&run.join(SURFACE), &cameras.setup.site);
                let matched = cameras.is_matched.then(read).transpose()?;
                satellite_surface(cameras, &splats, matched.as_ref(), run, grid)
            }
            Self::Perspective(cameras, site) => {
                let splats = seen_along(PerspectiveCameras::read_splats(run)?, DOWN);
                let mut surface = render(&splats, site, grid, &Appearance::default(), HeightsFrom::Median);
                let names = cameras.views.iter().filter(|v| v.role == Role::Train).map(|v| v.name.as_str());
                surface.metadata = vec![("INPUTS", names.collect::<Vec<_>>().join(", "))];
                Ok(surface)
            }
        }
    }
}

/// Renders the surface of a satellite scene: the colours of splats in linear colours, and the heights of the matched surface
/// where there is one.
pub(super) fn satellite_surface(
    cameras: &TrainedCameras,
    splats: &Splats,
    matched: Option<&MatchedSurface>,
    run: &Path,
    grid: MapGrid,
) -> Result<Dsm, PipelineError> {
    let setup = &cameras.setup;
    let reference = cameras.reference_appearance();
    let source = match (matched, cameras.recipe.kind.heights) {
        (Some(surface), _) => HeightsFrom::Matched(surface),
        (None, RayHeight::Median) => HeightsFrom::Median,
        (None, RayHeight::Mean) => HeightsFrom::Mean { floor: setup.altitudes.0 as f32 },
    };
    let mut surface = render(splats, &setup.site, grid, &reference, source);
    setup.transfer_function.encode(&mut surface.colors);
    let views: Vec<_> = setup.views.iter().filter(|v| v.role == Role::Train).collect();
    let names: Vec<&str> = views.iter().map(|v| v.name.as_str()).collect();
    surface.metadata = vec![("INPUTS", names.join(", "))];
    surface.count_views(&setup.site, &seeing(run, &views)?);
    if let Some(matched) = matched {
        surface.mark_filled(matched);
    }
    Ok(surface)
}

/// The splats of heights and orthophoto, in linear colours. Where colours for novel views were trained, those of the reference
/// view in full sunlight, without shadows and what moves; but the splats of the training for heights if these are not
/// matched.
fn surface_splats(cameras: &TrainedCameras, run: &Path) -> Result<Splats, PipelineError> {
    let linear = |mut splats: Splats| {
        splats.recolor(|v| cameras.setup.transfer_function.linear(v));
        splats
    };
    match SceneColors::read(run)? {
        None => cameras.read_splats(run),
        Some(_) if !cameras.is_matched => Ok(linear(ply::read(&run.join(HEIGHT_SPLATS))?)),
        Some(colors) => Ok(linear(colors.baked_in_sunlight(colors.reference()))),
    }
}

/// The views with their valid pixels, which are read from their images again where some are not.
fn seeing(run: &Path, views: &[&SiteView]) -> Result<Vec<Seeing>, PipelineError> {
    let is_masked = views.iter().any(|v| v.is_masked);
    let scene = is_masked.then(|| read_scene(run)).transpose()?;
    let of_view = |v: &&SiteView| {
        let mut views = scene.iter().flat_map(|s| &s.views);
        let view = views.find(|s| v.is_masked && s.name == v.name);
        view.map(require_image).transpose()?;
        let valid = view.map(View::valid_pixels).transpose()?.flatten();
        Ok(Seeing { camera: v.camera, size: v.size, valid })
    };
    views.iter().map(of_view).collect()
}

/// A surface whose heights training will not change, with the cameras and splats that training starts from.
pub(crate) struct KnownSurface<'a> {
    pub cameras: TrainedCameras,
    pub splats: &'a Splats,
    pub heights: &'a MatchedSurface,
}

/// What is done with a known surface before splats are trained.
pub(crate) type SurfaceIsKnown<'a> = &'a mut dyn FnMut(KnownSurface) -> Result<(), PipelineError>;
