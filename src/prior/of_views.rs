//! The priors of all training views, compared with the points of the scene.

use super::agreement::{FEWEST_POINTS, correlation};
use super::error::PriorError;
use super::folder::{PriorDescription, PriorFolder};
use super::make::{ExistingMaps, make_maps};
use super::map::{DepthKind, PriorContent, ViewPriors};
use super::normal_axes::{NormalAxes, compared_normals};
use super::seen::{SeenPoint, seen_points};
use super::source::{PriorMaker, PriorSource};
use crate::frame::{Point, Site};
use crate::perspective::{PerspectiveView, point_normals};
use crate::progress::{Event, Progress};
use rayon::prelude::*;
use std::num::NonZero;
use std::path::{Path, PathBuf};

/// Number of views whose depths are compared with the points of the scene.
const COMPARED_DEPTHS: usize = 8;
/// Number of views whose normals are compared with those of the points.
const COMPARED_NORMALS: usize = 5;
/// Smallest correlation, in absolute value, of depths that are of the scene.
const LEAST_CORRELATION: f64 = 0.2;
/// Neighbours that give a point its normal.
const NEIGHBOURS: NonZero<usize> = NonZero::new(16).unwrap();

/// Where priors come from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PriorSources {
    /// Of depths of the images.
    pub depths: Option<PriorSource>,
    /// What the values of the depths are; by default what `prior.json` says, else what the points of the scene say.
    pub kind: Option<DepthKind>,
    /// Of normals of the images.
    pub normals: Option<PriorSource>,
}

impl PriorSources {
    /// Whether priors are read from a folder.
    #[must_use]
    pub fn is_folder(&self, folder: &Path) -> bool {
        let is_it = |source: &PriorSource| match source {
            PriorSource::Folder(path) => match (path.canonicalize(), folder.canonicalize()) {
                (Ok(a), Ok(b)) => a == b,
                _ => false,
            },
            PriorSource::Maker(_) => false,
        };
        [&self.depths, &self.normals].into_iter().flatten().any(is_it)
    }
}

/// The files of a folder, by views: none where a view has none.
type Files<'a> = Vec<(&'a PerspectiveView, Option<PathBuf>)>;

/// Reads the priors of these views, in their order, compares them with `points`, those of the scene, and reports what is missing. What
/// a network or a command makes is kept in the folders `depths` and `normals` of `cache`, and not made again for the same images.
///
/// # Errors
/// [`PriorError`] if maps cannot be made, a folder has no file for any view, a file is damaged or has another shape than its image, or values contradict
/// the points of the scene.
pub fn read_priors(
    sources: &PriorSources,
    views: &[&PerspectiveView],
    points: &[Point<Site>],
    cache: &Path,
    progress: &dyn Progress,
) -> Result<Vec<ViewPriors>, PriorError> {
    let mut priors = vec![ViewPriors::default(); views.len()];
    if let Some(source) = &sources.depths {
        let description = PriorDescription { kind: sources.kind, scale: None };
        let folder = folder(source, PriorContent::Depths, &description, views, cache, progress)?;
        let files = files(&folder, views, progress)?;
        let kind = depth_kind(&folder, sources.kind, &files, points, progress)?;
        let read = |(view, file): &(&PerspectiveView, Option<PathBuf>)| {
            file.as_ref().map(|file| folder.depth(file, view, kind)).transpose()
        };
        let depths: Vec<_> = files.par_iter().map(read).collect();
        for (prior, depth) in priors.iter_mut().zip(depths) {
            prior.depth = depth?;
        }
    }
    if let Some(source) = &sources.normals {
        let description = PriorDescription::default();
        let folder = folder(source, PriorContent::Normals, &description, views, cache, progress)?;
        let files = files(&folder, views, progress)?;
        let axes = normal_axes(&folder, &files, points, progress)?;
        let read = |(view, file): &(&PerspectiveView, Option<PathBuf>)| {
            file.as_ref().map(|file| folder.normal(file, view, &axes)).transpose()
        };
        let normals: Vec<_> = files.par_iter().map(read).collect();
        for (prior, normal) in priors.iter_mut().zip(normals) {
            prior.normal = normal?;
        }
    }
    Ok(priors)
}

/// The folder of a source, with the maps that it has to make.
fn folder(
    source: &PriorSource,
    content: PriorContent,
    description: &PriorDescription,
    views: &[&PerspectiveView],
    cache: &Path,
    progress: &dyn Progress,
) -> Result<PriorFolder, PriorError> {
    match source {
        PriorSource::Folder(path) => PriorFolder::open(path),
        PriorSource::Maker(maker) => {
            // Training may match the photographs beside the maps that it is given.
            let folder = match maker {
                PriorMaker::Stereo => cache.join(maker.to_string()),
                _ => cache.join(content.to_string()),
            };
            make_maps(maker, content, views, &folder, description, ExistingMaps::Update, progress)?;
            PriorFolder::open(&folder)
        }
    }
}

/// The files of the views; says how many are missing.
fn files<'a>(
    folder: &PriorFolder,
    views: &[&'a PerspectiveView],
    progress: &dyn Progress,
) -> Result<Files<'a>, PriorError> {
    let files: Files = views.iter().map(|view| (*view, folder.file(view))).collect();
    let missing: Vec<&str> =
        files.iter().filter(|(_, file)| file.is_none()).map(|(view, _)| &*view.name).collect();
    let folder = folder.path();
    if missing.len() == views.len() {
        let example = missing.first().map(ToString::to_string).unwrap_or_default();
        return Err(PriorError::NoFiles { folder: folder.into(), views: views.len(), example });
    }
    if let Some(first) = missing.first() {
        let (n, of) = (missing.len(), views.len());
        let text = format!(
            "`{}` has no file for {n} of {of} training views, the first is {first}",
            folder.display()
        );
        progress.event(Event::Warning(text));
    }
    Ok(files)
}

/// The first views with a file, and the points that they see; only views that see enough points.
fn compared<'a>(
    files: &'a Files,
    points: &[Point<Site>],
    most: usize,
) -> Vec<(&'a PerspectiveView, &'a PathBuf, Vec<SeenPoint>)> {
    let with_file = files.iter().filter_map(|(view, file)| Some((*view, file.as_ref()?)));
    let seen = with_file.map(|(view, file)| (view, file, seen_points(points, view)));
    seen.filter(|(_, _, seen)| seen.len() >= FEWEST_POINTS).take(most).collect()
}

/// What the values of depths are: what `given` or `prior.json` says, unless the points of the scene contradict it, else what
/// they say.
fn depth_kind(
    folder: &PriorFolder,
    given: Option<DepthKind>,
    files: &Files,
    points: &[Point<Site>],
    progress: &dyn Progress,
) -> Result<DepthKind, PriorError> {
    let path = || folder.path().to_path_buf();
    let stated = given.or(folder.description().kind);
    let compared = compared(files, points, COMPARED_DEPTHS);
    let median = |kind| -> Result<Option<(f64, usize)>, PriorError> {
        let mut found = Vec::new();
        for (view, file, seen) in &compared {
            found.extend(correlation(&folder.depth(file, view, kind)?, seen));
        }
        found.sort_by(f64::total_cmp);
        Ok(found.get(found.len() / 2).map(|median| (*median, found.len())))
    };
    let Some((correlation, views)) = median(stated.unwrap_or(DepthKind::Relative))? else {
        return stated.ok_or_else(|| PriorError::NoKind { folder: path() });
    };
    match stated {
        _ if correlation.abs() < LEAST_CORRELATION => {
            Err(PriorError::OtherScene { folder: path(), correlation, views })
        }
        Some(kind) if correlation < 0.0 => Err(PriorError::Opposite { folder: path(), kind, correlation }),
        Some(kind) => Ok(kind),
        None => {
            let kind = if correlation > 0.0 { DepthKind::Relative } else { DepthKind::Disparity };
            let text =
                format!("the values of `{}` are {kind}, as the points of the scene show", path().display());
            progress.event(Event::Note(text));
            Ok(kind)
        }
    }
}

/// The axes in which normals agree best with those of the scene's points; the usual ones, with a warning, if there are too few
/// points.
fn normal_axes(
    folder: &PriorFolder,
    files: &Files,
    points: &[Point<Site>],
    progress: &dyn Progress,
) -> Result<NormalAxes, PriorError> {
    let compared = compared(files, points, COMPARED_NORMALS);
    let positions: Vec<[f64; 3]> = points.iter().map(|p| p.xyz()).collect();
    let normals = if compared.is_empty() { Vec::new() } else { point_normals(&positions, NEIGHBOURS) };
    let mut all = Vec::new();
    for (view, file, seen) in &compared {
        let prior = folder.normal(file, view, &NormalAxes::USUAL)?;
        all.extend(compared_normals(&prior, seen, points, &normals, &view.camera));
    }
    let path = folder.path();
    let found = NormalAxes::found(&all)
        .map_err(|angle_deg| PriorError::Normals { folder: path.into(), angle_deg })?;
    let Some(axes) = found else {
        let text = format!(
            "the scene has too few points to compare the normals of `{}` with: they are taken to be in camera axes, right, down \
             and forward",
            path.display()
        );
        progress.event(Event::Warning(text));
        return Ok(NormalAxes::USUAL);
    };
    if axes != NormalAxes::USUAL {
        let text = format!("the normals of `{}` are in other axes: {axes}", path.display());
        progress.event(Event::Note(text));
    }
    Ok(axes)
}
