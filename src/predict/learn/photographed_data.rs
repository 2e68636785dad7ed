//! Samples of photographed scenes with depth maps: the second phase of Point2GS (§4.1).
//!
//! A round draws some views of a scene, lifts points from their depth maps, thins them, and takes other views as targets. Only pixels
//! are compared whose depth lies on a surface that the points show.

use super::config::LearnConfig;
use super::data::{Crop, Sample, Target, TrainingData, VALIDATION_CLOUD, VALIDATION_TILES, tiles_of};
use super::error::LearnError;
use super::points::draw_share;
use crate::frame::{Pixel, SiteBox};
use crate::io::Grid2;
use crate::perspective::{PerspectiveOptions, PerspectiveScene, PerspectiveView, PinholeCamera};
use crate::predict::cloud::voxel_means;
use crate::predict::image_network::{ImageNetworkId, NetworkMaps};
use crate::predict::photographs::EnlargedCloud;
use crate::predict::{Cloud, ImageNetwork, PredictError, is_within};
use crate::prior::{DepthKind, DepthPrior, ViewPriors};
use crate::progress::{Event, Progress};
use crate::random::CounterRng;
use crate::scene::Role;
use crate::splat::loss::{LossWeights, PriorTargets, SurfaceDepth, TermInputs, WeightError, terms};
use crate::splat::pinhole::{EllipsoidObjective, NEAREST, PinholeStep, PinholeView};
use crate::splat::seen_gradient::SeenGradient;
use crate::splat::splats::Splats;
use crate::splat::stopwatch::Stopwatch;
use crate::stats::quantile;
use rayon::prelude::*;
use std::num::NonZero;
use std::path::{Path, PathBuf};

/// Purposes of the random numbers.
const DRAW_VIEWS: u64 = 55;
const DRAW_POINT: u64 = 56;
/// Weight of the agreement of depths.
const DEPTH_WEIGHT: f64 = 0.2;
/// Largest number of pixels of the training views of all scenes that are kept in memory, and of the views that are held back: 8 bytes
/// each.
const MOST_PIXELS: usize = 250_000_000;
/// Views are drawn until this many show a tile, of at most so many.
const TARGETS: usize = 4;
const TRIED_TARGETS: usize = 16;
/// Range of the sides of the voxels that points are thinned to, as parts of the median depth.
const THINNING: (f64, f64) = (1.0 / 120.0, 1.0 / 30.0);
/// A pixel is compared if its place is at most so many spacings of the points away from one.
const NEAR: f64 = 1.5;
/// Number of clouds of a scene for validation.
const VALIDATION_CLOUDS: u64 = 4;

/// Scenes with depth maps, in memory.
pub struct PhotographedScenes {
    scenes: Vec<MeasuredScene>,
    image_network: Option<ImageNetworkId>,
}

/// A scene.
struct MeasuredScene {
    path: PathBuf,
    training: Vec<MeasuredView>,
    held_back: Vec<MeasuredView>,
    /// What a network of image features gives for the training views, if there is one.
    maps: Option<NetworkMaps>,
    median_depth: f64,
}

/// A photograph with the depths of its pixels.
struct MeasuredView {
    view: PinholeView,
    depth: Grid2,
}

impl PhotographedScenes {
    /// Reads scenes, with the image features of a network if there is one. Of large ones some views are kept, evenly chosen, such
    /// that they take 4 GB at most.
    ///
    /// # Errors
    /// [`LearnError::Photographs`] if a scene cannot be read, [`LearnError::FewDepths`] if fewer than two training views of one have
    /// depth maps, [`LearnError::Interrupted`].
    pub fn read(
        paths: &[PathBuf],
        options: &PerspectiveOptions,
        image_network: Option<&ImageNetwork>,
        progress: &dyn Progress,
    ) -> Result<Self, LearnError> {
        let most_pixels = MOST_PIXELS / paths.len().max(1);
        let scene = |path: &PathBuf| MeasuredScene::read(path, options, most_pixels, image_network, progress);
        let scenes = paths.iter().map(scene).collect::<Result<Vec<_>, LearnError>>()?;
        if scenes.iter().all(|s| s.held_back.is_empty()) {
            let text = "no views with depth maps are held back: the training is not scored";
            progress.event(Event::Warning(text.into()));
        }
        Ok(Self { scenes, image_network: image_network.map(|n| n.id().clone()) })
    }

    /// The network whose image features they have.
    pub(super) fn image_network(&self) -> Option<&ImageNetworkId> {
        self.image_network.as_ref()
    }

    /// The folders and numbers of views, for the description of a model.
    pub(super) fn describe(&self) -> String {
        let name =
            |path: &Path| path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        let of = |s: &MeasuredScene| format!("{} ({} views)", name(&s.path), s.training.len());
        self.scenes.iter().map(of).collect::<Vec<_>>().join(", ")
    }
}

impl MeasuredScene {
    fn read(
        path: &Path,
        options: &PerspectiveOptions,
        most_pixels: usize,
        image_network: Option<&ImageNetwork>,
        progress: &dyn Progress,
    ) -> Result<Self, LearnError> {
        let scene = PerspectiveScene::read(path, options)?;
        for (name, reason) in &scene.skipped {
            progress.event(Event::Warning(format!("`{name}` is left out: {reason}")));
        }
        let [training, held_back] = [true, false].map(|is_training| {
            let has_role = |v: &&PerspectiveView| (v.role == Role::Train) == is_training;
            let views = scene.views.iter().filter(|v| v.depth.is_some()).filter(has_role);
            evenly_chosen(views.collect(), most_pixels)
        });
        let training = MeasuredView::read_all(&training, progress)?;
        let held_back = MeasuredView::read_all(&held_back, progress)?;
        let depths = training.iter().flat_map(|v| v.depth.data.iter().step_by(101)).filter(|z| z.is_finite());
        let median_depth = quantile(depths.map(|z| f64::from(*z)).collect(), 0.5);
        let has_depths = |v: &&MeasuredView| v.depth.data.iter().any(|z| z.is_finite());
        let few =
            || LearnError::FewDepths { path: path.into(), found: training.iter().filter(has_depths).count() };
        let median_depth = median_depth.filter(|_| training.len() > 1).ok_or_else(few)?;
        let views: Vec<&PinholeView> = training.iter().map(|v| &v.view).collect();
        let maps = image_network.map(|n| n.maps_of_photographs(&views, progress)).transpose()?;
        Ok(Self { path: path.into(), training, held_back, maps, median_depth })
    }

    /// The samples of cloud number `cloud`, of whose points this share is kept: lifted from views for training, and compared with
    /// other views for training or with views that are held back.
    fn samples(
        &self,
        config: &LearnConfig,
        cloud: u64,
        (share, tiles): (f64, usize),
        is_validation: bool,
    ) -> Result<Vec<Sample>, PredictError> {
        let mut draw = CounterRng::new(config.seed, DRAW_VIEWS, cloud, 0);
        let mut order: Vec<usize> = (0..self.training.len()).collect();
        shuffle(&mut order, &mut draw);
        // One view at least is left to compare with.
        let (used, others) = order.split_at(config.views.min(order.len() - 1).max(1));
        let [context, others] = [used, others].map(|views| views.iter().map(|i| &self.training[*i]));
        let context: Vec<&MeasuredView> = context.collect();
        let mut candidates: Vec<&MeasuredView> =
            if is_validation { self.held_back.iter().collect() } else { others.collect() };
        shuffle(&mut candidates, &mut draw);
        candidates.truncate(TRIED_TARGETS);
        let (finest, coarsest) = THINNING;
        let edge = self.median_depth * finest * (coarsest / finest).powf(draw.uniform());
        let is_kept = |i: u64| CounterRng::new(config.seed, DRAW_POINT, cloud, i).uniform() < share;
        let points = (0..).zip(lifted(&context, edge)).filter(|(i, _)| is_kept(*i));
        let points: Vec<[f64; 3]> = points.map(|(_, p)| p).collect();
        let enlarged = match EnlargedCloud::new(&points, &config.sampling) {
            Ok(enlarged) => enlarged,
            // Views that show little are not thinned.
            Err(PredictError::FewPoints { .. }) if share < 1.0 && !is_validation => {
                return self.samples(config, cloud, (1.0, tiles), is_validation);
            }
            Err(PredictError::FewPoints { .. }) => return Ok(Vec::new()),
            Err(other) => return Err(other),
        };
        let views: Vec<&PinholeView> = context.iter().map(|v| &v.view).collect();
        let maps = self.maps.as_ref().map(|maps| maps.of(used));
        let EnlargedCloud { cloud: points, scale, area, .. } = &enlarged;
        let targets_of = |area: SiteBox| {
            let found = candidates.iter().filter_map(|v| PhotographTarget::of(v, *scale, area, points));
            found.take(TARGETS).map(|target| Box::new(target) as Box<dyn Target>).collect()
        };
        let tiles = (config.seed, cloud, tiles);
        Ok(enlarged.with_views(&views, &config.sampling, maps.as_ref(), |seen| {
            tiles_of(seen, &config.sampling, *area, false, tiles, targets_of)
        }))
    }
}

/// Some of these views, evenly chosen, such that they have at most about so many pixels.
fn evenly_chosen(views: Vec<&PerspectiveView>, most_pixels: usize) -> Vec<&PerspectiveView> {
    let pixels: usize = views.iter().map(|v| v.camera.size.0 * v.camera.size.1).sum();
    let every = pixels.div_ceil(most_pixels.max(1)).max(1);
    views.into_iter().step_by(every).collect()
}

impl MeasuredView {
    fn read_all(views: &[&PerspectiveView], progress: &dyn Progress) -> Result<Vec<Self>, LearnError> {
        progress.event(Event::Started { stage: "reading images and depth maps", total: views.len() as u64 });
        let mut out = Vec::with_capacity(views.len());
        for some in views.chunks(rayon::current_num_threads().max(1)) {
            progress.check()?;
            let read: Vec<Result<Self, LearnError>> = some.par_iter().map(|view| Self::read(view)).collect();
            for view in read {
                out.push(view?);
            }
            progress.event(Event::Advanced { done: out.len() as u64, status: String::new() });
        }
        progress.event(Event::Finished);
        Ok(out)
    }

    fn read(view: &PerspectiveView) -> Result<Self, LearnError> {
        let photograph = PinholeView::of_image(view.name.clone(), view.camera, &view.read_image()?);
        Ok(Self { view: photograph, depth: view.read_depth()? })
    }

    /// The position that a pixel shows; none without depth.
    fn position(&self, col: usize, row: usize) -> Option<[f64; 3]> {
        let z = f64::from(self.depth.at(col, row));
        z.is_finite().then(|| self.view.camera.at_depth(Pixel::new(col as f64, row as f64), z))
    }
}

/// Brings the elements into a random order (Fisher and Yates).
fn shuffle<T>(items: &mut [T], draw: &mut CounterRng) {
    for i in (1..items.len()).rev() {
        items.swap(i, draw.below(i + 1));
    }
}

/// The points that views show, the mean of those of each voxel.
fn lifted(views: &[&MeasuredView], edge: f64) -> Vec<[f64; 3]> {
    let of_view = |view: &&MeasuredView| {
        let (width, height) = view.view.camera.size;
        let pixels = (0..height).flat_map(|row| (0..width).map(move |col| (col, row)));
        pixels.filter_map(|(col, row)| view.position(col, row)).collect::<Vec<_>>()
    };
    voxel_means(&views.iter().flat_map(of_view).collect::<Vec<_>>(), edge)
}

/// Scenes of a training: the configuration tells what is drawn of them.
pub struct PhotographedData<'a> {
    /// What is drawn.
    pub config: &'a LearnConfig,
    /// The scenes.
    pub scenes: &'a PhotographedScenes,
}

impl TrainingData for PhotographedData<'_> {
    fn identity(&self) -> String {
        let of_view = |v: &MeasuredView| format!("{} {:?}", v.view.name, v.view.camera);
        let of_scene = |s: &MeasuredScene| {
            let views: Vec<String> = s.training.iter().map(of_view).collect();
            format!("{} {}", s.path.display(), views.join(" "))
        };
        self.scenes.scenes.iter().map(of_scene).collect::<Vec<_>>().join("\n")
    }

    fn held_back(&self) -> &'static str {
        "views held back"
    }

    fn samples(&self, round: usize) -> Result<Vec<Sample>, LearnError> {
        let scenes = &self.scenes.scenes;
        let Some(scene) = scenes.get(round % scenes.len().max(1)) else { return Ok(Vec::new()) };
        let share = draw_share(self.config.seed, round as u64);
        Ok(scene.samples(self.config, round as u64, (share, self.config.tiles), false)?)
    }

    fn validation(&self, shares: &[f64], progress: &dyn Progress) -> Result<Vec<Vec<Sample>>, LearnError> {
        let scored = self.scenes.scenes.iter().filter(|scene| !scene.held_back.is_empty());
        let clouds: Vec<_> =
            scored.flat_map(|scene| (0..VALIDATION_CLOUDS).map(move |k| (scene, k))).collect();
        let mut out: Vec<Vec<Sample>> = shares.iter().map(|_| Vec::new()).collect();
        progress
            .event(Event::Started { stage: "preparing views for validation", total: clouds.len() as u64 });
        for (done, (scene, cloud)) in clouds.into_iter().enumerate() {
            progress.check()?;
            for (own, share) in out.iter_mut().zip(shares) {
                let what = (*share, VALIDATION_TILES);
                own.extend(scene.samples(self.config, VALIDATION_CLOUD + cloud, what, true)?);
            }
            progress.event(Event::Advanced { done: done as u64 + 1, status: String::new() });
        }
        progress.event(Event::Finished);
        Ok(out)
    }
}

/// The part of a photograph that shows a tile.
struct PhotographTarget {
    camera: PinholeCamera,
    crop: Crop,
    depths: PriorTargets,
}

impl PhotographTarget {
    /// The part of a view, in the scene enlarged by `scale`, that shows points of a cloud in a level area; none if that is too little.
    fn of(measured: &MeasuredView, scale: f64, area: SiteBox, points: &Cloud) -> Option<Self> {
        const ONE: NonZero<usize> = NonZero::new(1).unwrap();
        let MeasuredView { view, depth } = measured;
        let most = (NEAR * points.spacing_m()).powi(2);
        let is_shown = |p: [f64; 3]| {
            is_within(area, 0.0, p) && points.nearest(p, ONE).next().is_some_and(|(_, square)| square < most)
        };
        let crop = Crop::of(view.camera.size, |col, row| {
            let place = measured.position(col, row)?.map(|v| scale * v);
            is_shown(place).then(|| view.color(col, row))?
        })?;
        let (left, top) = crop.corner;
        let size = (crop.image.width, crop.image.height);
        let camera = view.camera.cropped(crop.corner, size);
        let camera = PinholeCamera { center: scale * camera.center, ..camera };
        let values = Grid2::from_fn(size.0, size.1, |col, row| {
            if crop.valid[row * size.0 + col] {
                scale as f32 * depth.at(left + col, top + row)
            } else {
                f32::NAN
            }
        });
        let prior = DepthPrior { values, kind: DepthKind::Measured };
        let depths = PriorTargets::new(ViewPriors { depth: Some(prior), normal: None }, &camera);
        Some(Self { camera, crop, depths })
    }

    fn step_input(&self, background: [f32; 3]) -> PinholeStep<'_, f32> {
        PinholeStep {
            camera: &self.camera,
            nearest: NEAREST,
            target: &self.crop.image,
            valid: &self.crop.valid,
            priors: Some(&self.depths),
            anchored: &[],
            background,
            sh_degree: 0,
            surface: SurfaceDepth::default(),
        }
    }
}

impl Target for PhotographTarget {
    fn evaluate(&self, splats: &Splats, background: [f32; 3]) -> Result<(f64, Splats), WeightError> {
        let weights = LossWeights::of(&[("depth_prior", DEPTH_WEIGHT)])?;
        let mut objective = EllipsoidObjective::new(terms(TermInputs { prior: None, lpips: None }));
        let mut gradient = SeenGradient::default();
        let input = self.step_input(background);
        let loss = objective.evaluate(splats, &input, &weights, &mut gradient, &mut Stopwatch::default());
        Ok((loss.total, gradient.of_all(splats)))
    }

    fn squared_error(&self, splats: &Splats) -> (f64, usize) {
        let mut objective = EllipsoidObjective::new(terms(TermInputs { prior: None, lpips: None }));
        objective.forward(splats, &self.step_input([0.0; 3]), &mut Stopwatch::default());
        self.crop.squared_error(objective.view())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec2, DVec3};

    /// A gray wall of splats across the optical axis at a depth.
    fn wall(depth: f32) -> Splats {
        let mut out = Splats::default();
        for i in 0..400 {
            let [x, y] = [i % 20, i / 20].map(|k| 0.2 * (k as f32 - 9.5) * depth / 4.0);
            out.push([x, y, depth], 0.15 * depth / 4.0, 0.9, [0.5; 3]);
        }
        out
    }

    #[test]
    fn a_wall_of_the_right_colour_at_a_wrong_depth_is_moved_to_the_depth_that_was_measured() {
        let camera = PinholeCamera {
            cam_from_site: DMat3::IDENTITY,
            center: DVec3::ZERO,
            focal: DVec2::splat(40.0),
            principal: DVec2::splat(15.5),
            size: (32, 32),
        };
        let crop = Crop::of(camera.size, |_, _| Some([0.5; 3])).unwrap();
        let values = Grid2::filled(32, 32, 4.0);
        let depth = DepthPrior { values, kind: DepthKind::Measured };
        let depths = PriorTargets::new(ViewPriors { depth: Some(depth), normal: None }, &camera);
        let target = PhotographTarget { camera, crop, depths };
        let evaluate = |depth| {
            let (loss, gradient) = target.evaluate(&wall(depth), [0.0; 3]).unwrap();
            (loss, gradient.position.iter().map(|by| f64::from(by[2])).sum::<f64>())
        };
        let [near, right, far] = [3.6, 4.0, 4.4].map(evaluate);
        assert!(right.0 + 0.015 < near.0.min(far.0), "{near:?} {right:?} {far:?}");
        assert!(near.1 < -0.01 && far.1 > 0.01, "{near:?} {far:?}");
    }
}
