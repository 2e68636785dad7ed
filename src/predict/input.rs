//! What the network computes the splats of a tile from.
//!
//! Numbers are of the order of one: lengths are in units of the spacing of the key points, or logarithms of ratios; heights above
//! ground in tens of metres.
//!
//! | of | numbers |
//! |---|---|
//! | a point of a group | place relative to the key point (3), linear colour (3) |
//! | a key point | mean distance of its group, height above ground, normal (3); then mean and standard deviation of the image features, and the same of the vectors of a network if there is one |
//! | a query | normal (3), distance of the points from their plane, spacing of the cloud and of the points around, height above ground, linear colour (3), deviation of the images from it, share of images that show it, sunlight, whether it is on a wall, distance from the middle of the points of the voxel along the line of the sample, distance of the nearest point |

use super::head::Base;
use super::image_features::FEATURE_MAPS;
use super::image_network::NetworkMaps;
use super::key_points::{farthest_points, group};
use super::light::{Light, SeenColor, seen_color};
use super::network::{FeatureBlocks, KEY_INPUTS, MEMBER_INPUTS, NEIGHBOURS, NetworkInput, QUERY_INPUTS};
use super::queries::{Query, queries, queries_at};
use super::{Cloud, ImageObserver, SplatSampling, is_within};
use crate::frame::SiteBox;
use crate::stats::quantile;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use std::num::NonZero;

/// Key points lie this many of their spacings outside of a tile as well, so that all queries have some on all sides.
const MARGIN_SPACINGS: f64 = 3.0;
/// Largest number of key points of a tile.
const MOST_KEYS: usize = 8192;
/// Colours become square roots of their ratio to the brightness of the scene, less one, times this.
const COLOR_SCALE: f32 = 1.5;
/// Largest colour, deviation from it, and deviation of an image feature. They are those of nearly all points of simulated towns: beyond
/// what it was trained with, the network is not to be believed.
const MOST_COLOR: f32 = 1.2;
const MOST_DEVIATION: f32 = 1.2;
const MOST_FEATURE_DEVIATION: f32 = 0.35;
/// Heights above ground are divided by this, metres.
const HEIGHT_M: f64 = 10.0;

/// A cloud, with what the images show of it.
pub struct SeenCloud<'a> {
    /// The cloud.
    pub cloud: &'a Cloud,
    /// The images.
    pub images: &'a dyn ImageObserver,
    /// The light of each.
    pub lights: &'a [Light],
    /// What a network of image features gives for the images.
    maps: Option<&'a NetworkMaps>,
    colors: Vec<[f32; 3]>,
    /// Median linear brightness of the points.
    brightness: f32,
}

/// What is known of a tile.
pub struct TileInput {
    /// Numbers for the network.
    pub network: NetworkInput<f32>,
    /// What the splats are relative to.
    pub bases: Vec<Base>,
}

impl<'a> SeenCloud<'a> {
    /// Looks up the colours of all points.
    #[must_use]
    pub fn new(cloud: &'a Cloud, images: &'a dyn ImageObserver, lights: &'a [Light]) -> Self {
        let seen = |p: &[f64; 3]| seen_color(images, lights, *p);
        let seen: Vec<SeenColor> = cloud.positions().par_iter().map(seen).collect();
        let shown = seen.iter().filter(|seen| seen.views > 0.0);
        let gray = shown.map(|seen| f64::from(seen.color.iter().sum::<f32>()) / 3.0).collect();
        let brightness = quantile(gray, 0.5).map_or(0.5, |v| v.max(1e-3) as f32);
        let colors = seen.iter().map(|seen| seen.color_or(brightness)).collect();
        Self { cloud, images, lights, maps: None, colors, brightness }
    }

    /// With the vectors that a network of image features gives for the images.
    #[must_use]
    pub fn with_maps(self, maps: Option<&'a NetworkMaps>) -> Self {
        Self { maps, ..self }
    }

    /// Median linear brightness of the points.
    #[must_use]
    pub fn brightness(&self) -> f32 {
        self.brightness
    }

    /// A linear colour as a number of the order of one, whatever the exposure is.
    fn of_order_one(&self, color: f32) -> f32 {
        (COLOR_SCALE * ((color / self.brightness).max(0.0).sqrt() - 1.0)).min(MOST_COLOR)
    }

    /// The linear colour of each point.
    #[must_use]
    pub fn colors(&self) -> &[[f32; 3]] {
        &self.colors
    }

    /// Spacing of the key points, metres: as asked, or that of the cloud if it is wider.
    #[must_use]
    pub fn key_spacing_m(&self, sampling: &SplatSampling) -> f64 {
        sampling.key_spacing_m.max(self.cloud.spacing_m())
    }

    /// What the network takes of a level box (west, south, east, north), metres; none where there are no points. `has_walls`
    /// adds walls without points.
    #[must_use]
    pub fn tile(&self, sampling: &SplatSampling, area: SiteBox, has_walls: bool) -> Option<TileInput> {
        let unit = self.key_spacing_m(sampling);
        let keys = self.keys(area, unit);
        let positions: Vec<[f64; 3]> = keys.iter().map(|k| self.cloud.positions()[*k]).collect();
        let queries = if sampling.densify {
            queries(self.cloud, sampling, area, has_walls)
        } else {
            let is_inside = |p: &&[f64; 3]| is_within(area, 0.0, **p);
            queries_at(self.cloud, &positions.iter().filter(is_inside).copied().collect::<Vec<_>>())
        };
        if queries.is_empty() {
            return None;
        }
        let tree = ImmutableKdTree::<f64, 3>::new_from_slice(&positions).ok()?;
        let attended = |query: &Query| {
            const COUNT: NonZero<usize> = NonZero::new(NEIGHBOURS).unwrap();
            let near = tree.query(&query.position).nearest_n::<SquaredEuclidean<f64>>(COUNT).execute();
            // The nearest is repeated where there are fewer.
            let near: [u32; NEIGHBOURS] = std::array::from_fn(|n| near.get(n).unwrap_or(&near[0]).item);
            let relative = |key: u32| {
                let from = positions[key as usize];
                std::array::from_fn(|k| ((query.position[k] - from[k]) / unit) as f32)
            };
            (near, near.map(relative))
        };
        let (neighbours, relative) = queries.par_iter().map(attended).unzip();
        let (of_queries, bases): (Vec<_>, Vec<_>) =
            queries.par_iter().map(|q| self.of_query(q, sampling)).unzip();
        let (members, of_keys): (Vec<_>, Vec<_>) = keys.par_iter().map(|k| self.of_key(*k, unit)).unzip();
        let network = NetworkInput {
            members: FeatureBlocks::of_rows(&members.concat()),
            keys: FeatureBlocks::of_rows(&of_keys),
            neighbours,
            relative,
            queries: FeatureBlocks::of_rows(&of_queries),
        };
        Some(TileInput { network, bases })
    }

    /// Indices of the key points of a box.
    fn keys(&self, area: SiteBox, unit: f64) -> Vec<usize> {
        let (west, south, east, north) = area;
        let near = self.cloud.positions().iter().enumerate();
        let near = near.filter(|(_, p)| is_within(area, MARGIN_SPACINGS * unit, **p));
        let origin = [0.5 * (west + east), 0.5 * (south + north), 0.0];
        let local = |p: &[f64; 3]| std::array::from_fn(|k| (p[k] - origin[k]) as f32);
        let (indices, points): (Vec<usize>, Vec<[f32; 3]>) = near.map(|(i, p)| (i, local(p))).unzip();
        farthest_points(&points, unit as f32, MOST_KEYS).into_iter().map(|k| indices[k]).collect()
    }

    /// The numbers of the points of a group, and of its key point.
    fn of_key(&self, key: usize, unit: f64) -> (Vec<[f32; MEMBER_INPUTS]>, Vec<f32>) {
        let positions = self.cloud.positions();
        let center = positions[key];
        let mut distances = 0.0;
        let members = group(self.cloud, center).map(|i| {
            let offset: [f64; 3] = std::array::from_fn(|k| (positions[i][k] - center[k]) / unit);
            distances += offset.iter().map(|v| v * v).sum::<f64>().sqrt();
            let [x, y, z] = offset.map(|v| v as f32);
            let [r, g, b] = self.colors[i].map(|v| self.of_order_one(v));
            [x, y, z, r, g, b]
        });
        let [x, y, z] = self.cloud.planes()[key].normal.to_array();
        let distance = distances / members.len() as f64;
        let known: [f64; KEY_INPUTS] = [distance, self.cloud.above_ground_m(center) / HEIGHT_M, x, y, z];
        let mut out = known.map(|v| v as f32).to_vec();
        self.push_image_features(center, &mut out);
        (members.to_vec(), out)
    }

    /// Appends mean and standard deviation of the image features over the images, weighted by visibility.
    fn push_image_features(&self, p: [f64; 3], out: &mut Vec<f32>) {
        let mut own = WeightedMoments::zeros(FEATURE_MAPS);
        let mut of_network = WeightedMoments::zeros(self.maps.map_or(0, NetworkMaps::channels));
        for view in 0..self.images.views() {
            let Some(seen) = self.images.observe(view, p).filter(|seen| seen.visibility > 0.0) else {
                continue;
            };
            if let Some(features) = self.images.features(view, p) {
                own.add(seen.visibility, &features);
            }
            let vector = self.maps.and_then(|maps| maps.at(view, self.images.project(view, p)?));
            if let Some(vector) = vector {
                of_network.add(seen.visibility, vector);
            }
        }
        own.push(MOST_FEATURE_DEVIATION, out);
        of_network.push(f32::INFINITY, out);
    }

    /// The numbers of a query, and what its splat is relative to.
    fn of_query(&self, query: &Query, sampling: &SplatSampling) -> ([f32; QUERY_INPUTS], Base) {
        let seen: SeenColor = seen_color(self.images, self.lights, query.position);
        let spacing = sampling.spacing_m;
        let ratio = |length_m: f64| (1.0 + length_m / spacing).ln() as f32;
        let [x, y, z] = query.normal.map(|v| v as f32);
        let color = seen.color_or(self.brightness);
        let [r, g, b] = color.map(|v| self.of_order_one(v));
        let (nearest, distance_m) = query.nearest;
        let numbers = [
            x,
            y,
            z,
            ratio(query.rms_m),
            ratio(self.cloud.spacing_m()),
            ratio(self.cloud.spacings()[nearest]),
            (self.cloud.above_ground_m(query.position) / HEIGHT_M) as f32,
            r,
            g,
            b,
            (COLOR_SCALE * seen.deviation / self.brightness).min(MOST_DEVIATION),
            seen.views / self.images.views().max(1) as f32,
            seen.sunlight,
            f32::from(u8::from(query.is_wall)),
            ratio(query.moved_m),
            ratio(distance_m),
        ];
        (numbers, Base::new(query, color))
    }
}

/// Sums of vectors and of their squares, with weights.
struct WeightedMoments {
    sum: Vec<f32>,
    squares: Vec<f32>,
    weights: f32,
}

impl WeightedMoments {
    fn zeros(length: usize) -> Self {
        Self { sum: vec![0.0; length], squares: vec![0.0; length], weights: 0.0 }
    }

    fn add(&mut self, weight: f32, vector: &[f32]) {
        self.weights += weight;
        for ((sum, squares), value) in self.sum.iter_mut().zip(&mut self.squares).zip(vector) {
            *sum += weight * value;
            *squares += weight * value * value;
        }
    }

    /// Appends the means, and the standard deviations up to a largest one; zeros where nothing has weight.
    fn push(&self, most_deviation: f32, out: &mut Vec<f32>) {
        let scale = if self.weights > 1e-3 { self.weights.recip() } else { 0.0 };
        out.extend(self.sum.iter().map(|sum| scale * sum));
        let deviation = |(sum, squares): (&f32, &f32)| {
            let mean = scale * sum;
            (scale * squares - mean * mean).max(0.0).sqrt().min(most_deviation)
        };
        out.extend(self.sum.iter().zip(&self.squares).map(deviation));
    }
}
