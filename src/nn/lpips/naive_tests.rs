//! The distance by plain loops, as the definition has it: what the fast one is compared with.

use super::architecture::{Architecture, ConvolutionLayer, LayerKind};
use super::image::PlanarRgb;
use std::collections::BTreeMap;

/// Channels of planes, row by row.
#[derive(Clone)]
struct Planes {
    width: usize,
    height: usize,
    data: Vec<Vec<f64>>,
}

impl Planes {
    fn at(&self, channel: usize, col: i64, row: i64) -> f64 {
        let inside = (0..self.width as i64).contains(&col) && (0..self.height as i64).contains(&row);
        if inside { self.data[channel][row as usize * self.width + col as usize] } else { 0.0 }
    }

    /// Channels computed one by one from (channel, column, row).
    fn from_fn(width: usize, height: usize, channels: usize, f: impl Fn(usize, i64, i64) -> f64) -> Self {
        let plane = |c| {
            (0..width * height).map(|i| f(c, (i % width) as i64, (i / width) as i64)).collect::<Vec<f64>>()
        };
        Self { width, height, data: (0..channels).map(plane).collect() }
    }
}

fn convolution(
    input: &Planes,
    layer: &ConvolutionLayer,
    stride: usize,
    tensors: &BTreeMap<String, Vec<f64>>,
) -> Planes {
    let ConvolutionLayer { index, channels, side, padding, .. } = *layer;
    let weights = &tensors[&format!("features.{index}.weight")];
    let bias = &tensors[&format!("features.{index}.bias")];
    let outputs = |n: usize| (n + 2 * padding - side) / stride + 1;
    Planes::from_fn(outputs(input.width), outputs(input.height), channels, |o, col, row| {
        let mut sum = bias[o];
        for i in 0..input.data.len() {
            for (t, u) in (0..side).flat_map(|t| (0..side).map(move |u| (t, u))) {
                let at = |n: i64, k: usize| n * stride as i64 + k as i64 - padding as i64;
                let weight = weights[((o * input.data.len() + i) * side + t) * side + u];
                sum += weight * input.at(i, at(col, u), at(row, t));
            }
        }
        sum.max(0.0)
    })
}

fn pool(input: &Planes, side: usize) -> Planes {
    let outputs = |n: usize| (n - side) / 2 + 1;
    Planes::from_fn(outputs(input.width), outputs(input.height), input.data.len(), |c, col, row| {
        let places = (0..side as i64).flat_map(|t| (0..side as i64).map(move |u| (2 * col + u, 2 * row + t)));
        places.map(|(col, row)| input.at(c, col, row)).fold(f64::NEG_INFINITY, f64::max)
    })
}

fn layer_distance(a: &Planes, b: &Planes, weights: &[f64]) -> f64 {
    let pixels = a.width * a.height;
    let normalised = |planes: &Planes, i: usize| {
        let features: Vec<f64> = planes.data.iter().map(|plane| plane[i]).collect();
        let norm = features.iter().map(|f| f * f).sum::<f64>().sqrt();
        features.into_iter().map(|f| f / (norm + 1e-10)).collect::<Vec<f64>>()
    };
    let of_pixel = |i: usize| -> f64 {
        let pairs = normalised(a, i).into_iter().zip(normalised(b, i));
        pairs.zip(weights).map(|((u, v), w)| w * (u - v).powi(2)).sum()
    };
    (0..pixels).map(of_pixel).sum::<f64>() / pixels as f64
}

/// The distance of two images by a network with the given tensors.
pub(super) fn distance(
    architecture: &Architecture,
    tensors: &BTreeMap<String, Vec<f64>>,
    images: [PlanarRgb<'_, f64>; 2],
) -> f64 {
    let mut maps = images.map(|image| {
        Planes::from_fn(image.width(), image.height(), 3, |c, col, row| {
            let (shift, scale) = ([-0.030, -0.088, -0.188][c], [0.458, 0.448, 0.450][c]);
            (2.0 * image.planes()[c][row as usize * image.width() + col as usize] - 1.0 - shift) / scale
        })
    });
    let (mut distance, mut compared) = (0.0, 0);
    let first = (LayerKind::Convolution(architecture.first), architecture.stride);
    let others = architecture.others.iter().map(|kind| (*kind, 1));
    for (kind, stride) in std::iter::once(first).chain(others) {
        match kind {
            LayerKind::Pool(p) => maps = maps.map(|map| pool(&map, p.side)),
            LayerKind::Convolution(layer) => {
                maps = maps.map(|map| convolution(&map, &layer, stride, tensors));
                if layer.compared {
                    let weights = &tensors[&format!("lin{compared}.model.1.weight")];
                    distance += layer_distance(&maps[0], &maps[1], weights);
                    compared += 1;
                }
            }
        }
    }
    distance
}
