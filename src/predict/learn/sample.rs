//! What the network learns from: a tile of a town, and the parts of images that show its surface in sunlight.

use super::points;
use super::town::{TargetView, Town};
use crate::camera::QuadraticKernel;
use crate::frame::SiteBox;
use crate::predict::head::Head;
use crate::predict::input::{SeenCloud, TileInput};
use crate::predict::light::calibrate;
use crate::predict::network::NetworkEvaluation;
use crate::predict::observer::SatelliteImages;
use crate::predict::{Cloud, Model, PredictError, SplatSampling, is_within, reference, tiles};
use crate::random::CounterRng;
use crate::splat::appearance::satgs::Cube;
use crate::splat::appearance::{AppearanceKind, ModelParameters};
use crate::splat::backend::stopwatch::Stopwatch;
use crate::splat::edit::Edit;
use crate::splat::loss::{LossTerm, TermInputs, terms};
use crate::splat::objective::{Objective, StepInput};
use crate::splat::primitive::PrimitiveKind;
use crate::splat::raster::{FrameCamera, Image};
use crate::splat::splats::Splats;
use std::sync::Arc;

/// Purpose of the random numbers.
const DRAW_TILE: u64 = 53;
/// Side of the tiles that are compared with images, and the margin beyond, in which splats are predicted as well, metres.
const TILE_M: f64 = 40.0;
const MARGIN_M: f64 = 2.0;
/// Pixels of at least so much sunlight are compared: shadows come from outside of the tile too.
const SUNLIT: f32 = 0.9;
/// Fewest pixels of a target.
const FEWEST_PIXELS: usize = 500;
/// Margin of the part of an image around its pixels that are compared, pixels.
const MARGIN_PX: usize = 4;

/// A tile of a town.
pub struct Sample {
    /// The town.
    pub town: Arc<Town>,
    /// What the network computes the splats from.
    pub input: TileInput,
    /// How its numbers become splats.
    pub head: Head,
    /// What their renders are compared with.
    pub targets: Vec<Target>,
    /// The splats of the same points without a network: [`reference::isotropic`] and [`reference::flattened`].
    pub references: [Splats; 2],
}

/// A part of an image.
pub struct Target {
    camera: FrameCamera<QuadraticKernel<f32>>,
    image: Image<f32>,
    valid: Vec<bool>,
    /// The colour model.
    pub appearance: Vec<f32>,
}

/// The samples of a town, from cloud number `cloud`, which has this share of the points.
pub fn samples(
    town: &Arc<Town>,
    sampling: &SplatSampling,
    seed: u64,
    cloud: u64,
    share: f64,
    tiles: usize,
) -> Result<Vec<Sample>, PredictError> {
    let given = points::draw(&town.surface, seed, cloud, share);
    let points = match Cloud::new(&given, sampling.spacing_m) {
        Ok((points, _)) => points,
        // A small town that was thinned too much teaches nothing.
        Err(PredictError::FewPoints { .. }) => return Ok(Vec::new()),
        Err(other) => return Err(other),
    };
    let surface = reference::surface(&points, sampling, town.area, true);
    let images = SatelliteImages::new(&town.context, &surface, town.altitudes);
    let lights = calibrate(&images, points.positions(), 0);
    let seen = SeenCloud::new(&points, &images, &lights);
    let references = [reference::isotropic(&seen), reference::flattened(&seen)];
    let mut draw = CounterRng::new(seed, DRAW_TILE, cloud, 0);
    let mut sample = |_| {
        let (west, south, east, north) = town.area;
        let mut between = |low: f64, high: f64| low + (high - TILE_M - low).max(0.0) * draw.uniform();
        let (w, s) = (between(west, east), between(south, north));
        let core = (w, s, w + TILE_M, s + TILE_M);
        let around = (w - MARGIN_M, s - MARGIN_M, w + TILE_M + MARGIN_M, s + TILE_M + MARGIN_M);
        let input = seen.tile(sampling, around, true)?;
        let targets: Vec<Target> = town.targets.iter().filter_map(|t| Target::of(t, core)).collect();
        let references = references.each_ref().map(|splats| inside(splats, around));
        let head = tiles::head(sampling, points.spacing_m(), seen.brightness());
        (!targets.is_empty()).then(|| Sample { town: town.clone(), input, head, targets, references })
    };
    Ok((0..tiles).filter_map(&mut sample).collect())
}

/// The splats whose centres are in a level area.
fn inside(splats: &Splats, area: SiteBox) -> Splats {
    let is_inside = |p: &[f32; 3]| is_within(area, 0.0, p.map(f64::from));
    let keep: Vec<bool> = splats.position.iter().map(is_inside).collect();
    let mut out = splats.clone();
    out.apply(&Edit::retain(&keep));
    out
}

impl Target {
    /// The part of an image that shows a level area in sunlight; none if that is too little.
    fn of(target: &TargetView, area: SiteBox) -> Option<Self> {
        let TargetView { view, light, shown } = target;
        let is_shown = |shown: &Option<([f64; 3], f32)>| {
            shown.is_some_and(|(p, sunlight)| sunlight > SUNLIT && is_within(area, 0.0, p))
        };
        let place = |i: usize| (i % view.width, i / view.width);
        let is_valid = |i: &usize| {
            is_shown(&shown[*i]) && {
                let (col, row) = place(*i);
                view.block_mean(col, row, 1).is_some()
            }
        };
        let pixels: Vec<(usize, usize)> = (0..shown.len()).filter(is_valid).map(place).collect();
        if pixels.len() < FEWEST_PIXELS {
            return None;
        }
        let bounds = |of: fn(&(usize, usize)) -> usize, most: usize| {
            let (low, high) = pixels.iter().map(of).fold((usize::MAX, 0), |(a, b), v| (a.min(v), b.max(v)));
            (low.saturating_sub(MARGIN_PX), (high + MARGIN_PX + 1).min(most))
        };
        let ((left, right), (top, bottom)) = (bounds(|p| p.0, view.width), bounds(|p| p.1, view.height));
        let (width, height) = (right - left, bottom - top);
        let mut image = Image::zeros(width, height, 3);
        let mut valid = vec![false; width * height];
        for (col, row) in pixels {
            let rgb = view.block_mean(col, row, 1)?;
            let (col, row) = (col - left, row - top);
            valid[row * width + col] = true;
            (0..3).for_each(|k| *image.at_mut(k, col, row) = rgb[k]);
        }
        let camera = FrameCamera::new(&view.camera.cropped(left as f64, top as f64), width, height);
        Some(Self { camera, image, valid, appearance: light.appearance().values })
    }

    /// What is rendered and compared.
    pub fn step_input(&self, background: [f32; 3], floor: f32) -> StepInput<'_, f32> {
        StepInput {
            camera: self.camera,
            target: &self.image,
            valid: &self.valid,
            visibility: None,
            crop: None,
            sun: None,
            virtual_view: None,
            background,
            floor,
        }
    }

    /// The colour model's parameters.
    pub fn parameters(&self) -> ModelParameters<'_, f32> {
        ModelParameters { shared: &[], view: &self.appearance }
    }
}

/// An objective for a sample's splats.
pub fn objective(town: &Town) -> Objective<f32> {
    let terms: Vec<Box<dyn LossTerm<f32>>> =
        terms(TermInputs { prior: Some(town.prior.clone()), lpips: None });
    let cube = Cube { corner: [0.0; 3], side_m: 1.0 };
    Objective::new(PrimitiveKind::Ellipsoid, AppearanceKind::Affine.model(cube), terms)
}

/// Mean squared error of the pictures of these splats over all targets of a sample.
pub fn squared_error(sample: &Sample, splats: &Splats) -> f64 {
    let mut objective = objective(&sample.town);
    let (mut sum, mut count) = (0.0, 0);
    for target in &sample.targets {
        let floor = sample.town.altitudes.0 as f32;
        let input = target.step_input([0.0; 3], floor);
        objective.forward(splats, target.parameters(), &input, &mut Stopwatch::default());
        let picture = objective.picture();
        for (i, _) in target.valid.iter().enumerate().filter(|(_, valid)| **valid) {
            let (col, row) = (i % picture.width, i / picture.width);
            for k in 0..3 {
                let shown = picture.at(k, col, row).clamp(0.0, 1.0);
                sum += f64::from(shown - target.image.at(k, col, row)).powi(2);
            }
            count += 3;
        }
    }
    sum / f64::from(count.max(1))
}

/// The splats that a model predicts of a sample.
pub fn predicted(model: &Model, sample: &Sample) -> Splats {
    let mut evaluation = NetworkEvaluation::new(&model.content.network);
    sample.head.splats(evaluation.forward(&model.parameters, &sample.input.network), &sample.input.bases)
}
