//! What the network learns from: the numbers of a tile, and the images that renders of its splats are compared with.

use super::error::LearnError;
use crate::frame::SiteBox;
use crate::predict::head::Head;
use crate::predict::input::{SeenCloud, TileInput};
use crate::predict::network::NetworkEvaluation;
use crate::predict::{Model, SplatSampling, is_within, reference, tiles};
use crate::progress::Progress;
use crate::random::CounterRng;
use crate::splat::edit::Edit;
use crate::splat::loss::WeightError;
use crate::splat::raster::Image;
use crate::splat::splats::Splats;

/// Number of tiles of a cloud for validation, and the number of the first such cloud.
pub const VALIDATION_TILES: usize = 3;
pub const VALIDATION_CLOUD: u64 = 1 << 40;
/// Purpose of the random numbers.
const DRAW_TILE: u64 = 53;
/// Side of the tiles that are compared with images, and the margin beyond, in which splats are predicted as well, metres.
const TILE_M: f64 = 40.0;
const MARGIN_M: f64 = 2.0;
/// Fewest pixels of a target.
const FEWEST_PIXELS: usize = 500;
/// Margin of the part of an image around its pixels that are compared, pixels.
const MARGIN_PX: usize = 4;

/// Where the samples come from.
pub trait TrainingData {
    /// What tells these data from others.
    fn identity(&self) -> String;

    /// What the scores of samples that are not learned from are of.
    fn held_back(&self) -> &'static str;

    /// The samples of a round.
    fn samples(&self, round: usize) -> Result<Vec<Sample>, LearnError>;

    /// Samples that are not learned from, for each part of the points.
    fn validation(&self, shares: &[f64], progress: &dyn Progress) -> Result<Vec<Vec<Sample>>, LearnError>;
}

/// A tile of a scene.
pub struct Sample {
    /// What the network computes the splats from.
    pub input: TileInput,
    /// How its numbers become splats.
    pub head: Head,
    /// What their renders are compared with.
    pub targets: Vec<Box<dyn Target>>,
    /// The splats of the same points without a network: [`reference::isotropic`] and [`reference::flattened`].
    pub references: [Splats; 2],
}

/// A part of an image.
pub trait Target: Send + Sync {
    /// The loss of splats in front of a background, and its derivatives by them.
    fn evaluate(&self, splats: &Splats, background: [f32; 3]) -> Result<(f64, Splats), WeightError>;

    /// Sum of the squared differences of their render from the image, and the number of values.
    fn squared_error(&self, splats: &Splats) -> (f64, usize);
}

impl Sample {
    /// The splats that a model predicts.
    pub fn predicted(&self, model: &Model) -> Splats {
        let mut evaluation = NetworkEvaluation::new(&model.content.network);
        self.head.splats(evaluation.forward(&model.parameters, &self.input.network), &self.input.bases)
    }

    /// Mean squared error of the pictures of these splats over all targets.
    pub fn squared_error(&self, splats: &Splats) -> f64 {
        let errors = self.targets.iter().map(|target| target.squared_error(splats));
        let (sum, count) = errors.fold((0.0, 0), |(a, n), (b, m)| (a + b, n + m));
        sum / count.max(1) as f64
    }
}

/// Samples of a cloud: at most so many tiles at random places in a level area, and for each the targets that `targets_of` finds of its
/// level box. `cloud` is the number of the cloud for random numbers.
pub fn tiles_of(
    seen: &SeenCloud,
    sampling: &SplatSampling,
    (west, south, east, north): SiteBox,
    has_walls: bool,
    (seed, cloud, tiles): (u64, u64, usize),
    targets_of: impl Fn(SiteBox) -> Vec<Box<dyn Target>>,
) -> Vec<Sample> {
    let references = [reference::isotropic(seen), reference::flattened(seen)];
    let mut draw = CounterRng::new(seed, DRAW_TILE, cloud, 0);
    let mut sample = |_| {
        let mut between = |low: f64, high: f64| low + (high - TILE_M - low).max(0.0) * draw.uniform();
        let (w, s) = (between(west, east), between(south, north));
        let core = (w, s, w + TILE_M, s + TILE_M);
        let around = (w - MARGIN_M, s - MARGIN_M, w + TILE_M + MARGIN_M, s + TILE_M + MARGIN_M);
        let input = seen.tile(sampling, around, has_walls)?;
        let targets = targets_of(core);
        let references = references.each_ref().map(|splats| inside(splats, around));
        let head = tiles::head(sampling, seen.cloud.spacing_m(), seen.brightness());
        (!targets.is_empty()).then(|| Sample { input, head, targets, references })
    };
    (0..tiles).filter_map(&mut sample).collect()
}

/// The splats whose centres are in a level area.
fn inside(splats: &Splats, area: SiteBox) -> Splats {
    let is_inside = |p: &[f32; 3]| is_within(area, 0.0, p.map(f64::from));
    let keep: Vec<bool> = splats.position.iter().map(is_inside).collect();
    let mut out = splats.clone();
    out.apply(&Edit::retain(&keep));
    out
}

/// The part of an image around the pixels that are compared.
pub struct Crop {
    /// Its first column and row.
    pub corner: (usize, usize),
    /// The colours of the pixels that are compared; zero elsewhere.
    pub image: Image<f32>,
    /// Which pixels are compared.
    pub valid: Vec<bool>,
}

impl Crop {
    /// The part around the pixels of an image of this size for which `color` has a colour; none if they are too few.
    pub fn of(
        (width, height): (usize, usize),
        color: impl Fn(usize, usize) -> Option<[f32; 3]>,
    ) -> Option<Self> {
        let place = |i: usize| (i % width, i / width);
        let colored = |i: usize| {
            let (col, row) = place(i);
            Some((col, row, color(col, row)?))
        };
        let pixels: Vec<(usize, usize, [f32; 3])> = (0..width * height).filter_map(colored).collect();
        if pixels.len() < FEWEST_PIXELS {
            return None;
        }
        let bounds = |of: fn(&(usize, usize, [f32; 3])) -> usize, most: usize| {
            let (low, high) = pixels.iter().map(of).fold((usize::MAX, 0), |(a, b), v| (a.min(v), b.max(v)));
            (low.saturating_sub(MARGIN_PX), (high + MARGIN_PX + 1).min(most))
        };
        let ((left, right), (top, bottom)) = (bounds(|p| p.0, width), bounds(|p| p.1, height));
        let mut image = Image::zeros(right - left, bottom - top, 3);
        let mut valid = vec![false; image.width * image.height];
        for (col, row, rgb) in pixels {
            let (col, row) = (col - left, row - top);
            valid[row * image.width + col] = true;
            (0..3).for_each(|k| *image.at_mut(k, col, row) = rgb[k]);
        }
        Some(Self { corner: (left, top), image, valid })
    }

    /// Sum of the squared differences of a picture, clipped to what an image can show, from the pixels that are compared, and the
    /// number of values.
    pub fn squared_error(&self, picture: &Image<f32>) -> (f64, usize) {
        let (mut sum, mut count) = (0.0, 0);
        for (i, _) in self.valid.iter().enumerate().filter(|(_, valid)| **valid) {
            let (col, row) = (i % self.image.width, i / self.image.width);
            for k in 0..3 {
                let shown = picture.at(k, col, row).clamp(0.0, 1.0);
                sum += f64::from(shown - self.image.at(k, col, row)).powi(2);
            }
            count += 3;
        }
        (sum, count)
    }
}
