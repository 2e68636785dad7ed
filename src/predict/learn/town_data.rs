//! Samples of simulated towns: tiles, and the parts of images that show their surface in sunlight.

use super::config::LearnConfig;
use super::data::{Crop, Sample, Target, TrainingData, VALIDATION_CLOUD, VALIDATION_TILES, tiles_of};
use super::error::LearnError;
use super::points::{draw, draw_share};
use super::town::{TargetView, Town};
use crate::camera::QuadraticKernel;
use crate::frame::SiteBox;
use crate::predict::image_network::NetworkMaps;
use crate::predict::input::SeenCloud;
use crate::predict::light::calibrate;
use crate::predict::observer::SatelliteImages;
use crate::predict::{Cloud, ImageNetwork, PredictError, is_within, reference};
use crate::progress::{Event, NoProgress, Progress};
use crate::simulate::{Relief, SimulateOptions, Terrain};
use crate::splat::appearance::satgs::Cube;
use crate::splat::appearance::{AppearanceKind, ModelParameters};
use crate::splat::loss::{LossWeights, TermInputs, WeightError, terms};
use crate::splat::primitive::PrimitiveKind;
use crate::splat::raster::FrameCamera;
use crate::splat::satellite::{Gradient, SatelliteObjective, SatelliteStep};
use crate::splat::splats::Splats;
use crate::splat::stopwatch::Stopwatch;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Weight of the pull to the exact surface.
const SURFACE_WEIGHT: f64 = 0.2;
/// Pixels of at least so much sunlight are compared: shadows come from outside of the tile too.
const SUNLIT: f32 = 0.9;
/// Seeds of towns for validation begin here: none of them is learned from.
const VALIDATION_SEED: u64 = 1 << 60;

/// Towns that are simulated in a folder one after the other.
pub struct Towns<'a> {
    config: &'a LearnConfig,
    folder: &'a Path,
    image_network: Option<&'a ImageNetwork>,
    /// What the network of image features gave for the images of towns, by their seeds: towns come again.
    maps: RefCell<BTreeMap<u64, Arc<NetworkMaps>>>,
}

impl TrainingData for Towns<'_> {
    fn identity(&self) -> String {
        // The configuration tells all.
        String::new()
    }

    fn held_back(&self) -> &'static str {
        "unseen towns"
    }

    fn samples(&self, round: usize) -> Result<Vec<Sample>, LearnError> {
        let seed = self.config.seed.wrapping_mul(1 << 16) + (round % self.config.towns) as u64;
        let share = draw_share(self.config.seed, round as u64);
        Ok(self.tiles(&self.load(seed)?, round as u64, share, self.config.tiles)?)
    }

    fn validation(&self, shares: &[f64], progress: &dyn Progress) -> Result<Vec<Vec<Sample>>, LearnError> {
        let mut out: Vec<Vec<Sample>> = shares.iter().map(|_| Vec::new()).collect();
        let total = self.config.validation_towns as u64;
        progress.event(Event::Started { stage: "preparing towns for validation", total });
        for k in 0..total {
            progress.check()?;
            let town = self.load(VALIDATION_SEED + k)?;
            for (own, share) in out.iter_mut().zip(shares) {
                own.extend(self.tiles(&town, VALIDATION_CLOUD + k, *share, VALIDATION_TILES)?);
            }
            progress.event(Event::Advanced { done: k + 1, status: String::new() });
        }
        progress.event(Event::Finished);
        Ok(out)
    }
}

impl<'a> Towns<'a> {
    /// The towns of a configuration in a folder, with the image features of a network if there is one.
    pub fn new(config: &'a LearnConfig, folder: &'a Path, image_network: Option<&'a ImageNetwork>) -> Self {
        Self { config, folder, image_network, maps: RefCell::default() }
    }

    /// What the network of image features gives for the images of a town.
    fn maps(&self, seed: u64, town: &Town) -> Result<Option<Arc<NetworkMaps>>, PredictError> {
        let Some(network) = self.image_network else { return Ok(None) };
        if let Some(maps) = self.maps.borrow().get(&seed) {
            return Ok(Some(maps.clone()));
        }
        let maps = Arc::new(network.maps_of(&town.context, &NoProgress)?);
        self.maps.borrow_mut().insert(seed, maps.clone());
        Ok(Some(maps))
    }

    /// A town of the folder, which is simulated if it is not there. The name has the options, so that towns of others are not
    /// taken.
    pub fn load(&self, seed: u64) -> Result<Arc<Town>, LearnError> {
        let options = self.config.town(seed);
        let SimulateOptions { views, size_px, gsd_m, ref terrain, .. } = options;
        let relief = if *terrain == Terrain::Town(Relief::Hilly) { "hilly" } else { "rolling" };
        let folder = self.folder.join(format!("towns/{seed}-{views}x{size_px}px-{gsd_m}m-{relief}"));
        let mut town = Town::load(&folder, &options, self.config.transfer_function(seed)?, &NoProgress)?;
        town.maps = self.maps(seed, &town)?;
        Ok(Arc::new(town))
    }

    /// The samples of a town, from cloud number `cloud`, which has this share of the points.
    pub fn tiles(
        &self,
        town: &Arc<Town>,
        cloud: u64,
        share: f64,
        tiles: usize,
    ) -> Result<Vec<Sample>, PredictError> {
        let LearnConfig { sampling, seed, .. } = self.config;
        let points = match Cloud::new(&draw(&town.surface, *seed, cloud, share), sampling.spacing_m) {
            Ok((points, _)) => points,
            // A small town that was thinned too much teaches nothing.
            Err(PredictError::FewPoints { .. }) => return Ok(Vec::new()),
            Err(other) => return Err(other),
        };
        let surface = reference::surface(&points, sampling, town.area, true);
        let images = SatelliteImages::new(&town.context, &surface, town.altitudes);
        let lights = calibrate(&images, points.positions(), 0);
        let seen = SeenCloud::new(&points, &images, &lights).with_maps(town.maps.as_deref());
        let targets_of = |area: SiteBox| {
            let targets = town.targets.iter().filter_map(|view| TownTarget::of(town, view, area));
            targets.map(|target| Box::new(target) as Box<dyn Target>).collect()
        };
        Ok(tiles_of(&seen, sampling, town.area, true, (*seed, cloud, tiles), targets_of))
    }
}

/// The part of an image of a town that shows a tile in sunlight.
struct TownTarget {
    town: Arc<Town>,
    camera: FrameCamera<QuadraticKernel<f32>>,
    crop: Crop,
    /// The colour model.
    appearance: Vec<f32>,
}

impl TownTarget {
    /// The part of an image that shows a level area in sunlight; none if that is too little.
    fn of(town: &Arc<Town>, target: &TargetView, area: SiteBox) -> Option<Self> {
        let TargetView { view, light, shown } = target;
        let is_shown = |shown: &Option<([f64; 3], f32)>| {
            shown.is_some_and(|(p, sunlight)| sunlight > SUNLIT && is_within(area, 0.0, p))
        };
        let crop = Crop::of((view.width, view.height), |col, row| {
            is_shown(&shown[row * view.width + col]).then(|| view.block_mean(col, row, 1))?
        })?;
        let (left, top) = crop.corner;
        let camera = view.camera.cropped(left as f64, top as f64);
        let camera = FrameCamera::new(&camera, crop.image.width, crop.image.height);
        Some(Self { town: town.clone(), camera, crop, appearance: light.appearance().values })
    }

    fn objective(&self) -> SatelliteObjective<f32> {
        let terms = terms(TermInputs { prior: Some(self.town.prior.clone()), lpips: None });
        let cube = Cube { corner: [0.0; 3], side_m: 1.0 };
        SatelliteObjective::new(PrimitiveKind::Ellipsoid, AppearanceKind::Affine.model(cube), terms)
    }

    /// What is rendered and compared.
    fn step_input(&self, background: [f32; 3]) -> SatelliteStep<'_, f32> {
        SatelliteStep {
            camera: self.camera,
            target: &self.crop.image,
            valid: &self.crop.valid,
            visibility: None,
            crop: None,
            sun: None,
            virtual_view: None,
            background,
            floor: self.town.altitudes.0 as f32,
            anchored: &[],
        }
    }

    fn parameters(&self) -> ModelParameters<'_, f32> {
        ModelParameters { shared: &[], view: &self.appearance }
    }
}

impl Target for TownTarget {
    fn evaluate(&self, splats: &Splats, background: [f32; 3]) -> Result<(f64, Splats), WeightError> {
        let weights = LossWeights::of(&[("surface_prior", SURFACE_WEIGHT)])?;
        let mut gradient = Gradient::default();
        let input = self.step_input(background);
        let mut watch = Stopwatch::default();
        let mut objective = self.objective();
        let loss = objective.evaluate(splats, self.parameters(), &input, &weights, &mut gradient, &mut watch);
        Ok((loss.total, gradient.splats))
    }

    fn squared_error(&self, splats: &Splats) -> (f64, usize) {
        let mut objective = self.objective();
        let input = self.step_input([0.0; 3]);
        objective.forward(splats, self.parameters(), &input, &mut Stopwatch::default());
        self.crop.squared_error(objective.picture())
    }
}
