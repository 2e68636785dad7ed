//! Features of a network that a user brings as an ONNX file, evaluated with rten.

use super::FeatureError;
use super::map::{DenseFeatures, FeatureMap, picture_size};
use super::tiles::{tile_starts, tile_values};
use crate::io::Grid2;
use crate::nn::onnx::{Normalization, OnnxModel, OnnxOutput, OnnxTensor};
use std::path::Path;

/// Side of the pictures of DINOv2 (Oquab et al. 2023), pixels, if a graph takes any.
const DEFAULT_SIDE_PX: usize = 518;
/// Largest number of tokens before those of the patches: a class token and four registers (Darcet et al. 2023).
const MOST_LEADING: usize = 5;
/// Patches that neighbouring tiles share at least: a stride of 476 px with tiles of 518 px and patches of 14 px.
const OVERLAP_PATCHES: usize = 3;

/// Dense features of an ONNX model, such as DINOv2.
///
/// The model takes one picture, f32 `[1, 3, side, side]`, normalised as ImageNet's are. Its first output holds a vector for
/// each patch, f32 `[1, n + patches, channels]` after n class and register tokens, or `[1, channels, rows, columns]`.
///
/// Larger pictures are evaluated in tiles that overlap by three patches, where vectors are averaged. A picture that ends within a
/// tile is mirrored at its right and lower border.
pub struct OnnxFeatures {
    model: OnnxModel,
    /// Side of a tile, pixels and patches.
    side_px: usize,
    side: usize,
    layout: Layout,
    channels: usize,
}

/// Where the first output has the vector of a patch.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Layout {
    /// One vector after the other, the first ones not of patches.
    Tokens { leading: usize },
    /// One channel after the other.
    Planes,
}

impl OnnxFeatures {
    /// Reads a model; tiles are as large as its input, 518 pixels if that is open. Evaluates it once, to see its output.
    ///
    /// # Errors
    /// [`FeatureError`] if the file cannot be read or is cut short, if its graph takes or gives something else than described at
    /// [`OnnxFeatures`], or if it has operators that rten does not compute or computes as others (cubic `Resize`).
    pub fn load(path: &Path) -> Result<Self, FeatureError> {
        Self::load_with_side(path, DEFAULT_SIDE_PX)
    }

    /// [`OnnxFeatures::load`] with tiles of another side, pixels, if the size of the graph's input is open.
    ///
    /// # Errors
    /// As [`OnnxFeatures::load`].
    pub fn load_with_side(path: &Path, side_px: usize) -> Result<Self, FeatureError> {
        let model = OnnxModel::load(path)?;
        let side_px = match model.input_size() {
            [Some(rows), Some(columns)] if rows != columns => {
                return Err(model.wrong_input("[1, 3, side, side]").into());
            }
            [rows, columns] => rows.or(columns).unwrap_or(side_px),
        };
        let mut features = Self { model, side_px, side: 0, layout: Layout::Planes, channels: 0 };
        let gray = features.evaluate(vec![0.0; 3 * side_px * side_px])?;
        (features.layout, features.side, features.channels) =
            layout(&gray.shape, side_px).ok_or_else(|| features.wrong_output(gray.description()))?;
        Ok(features)
    }

    /// The first output for the values of a tile.
    fn evaluate(&self, values: Vec<f32>) -> Result<OnnxTensor, FeatureError> {
        let tensor = match self.model.evaluate([self.side_px; 2], values)? {
            OnnxOutput::Tensor(tensor) => tensor,
            OnnxOutput::Other(found) => return Err(self.wrong_output(found)),
        };
        if tensor.values.iter().all(|v| v.is_finite()) {
            Ok(tensor)
        } else {
            Err(FeatureError::NotFinite { path: self.model.path().into() })
        }
    }

    fn wrong_output(&self, found: String) -> FeatureError {
        let (path, side_px) = (self.model.path().into(), self.side_px);
        FeatureError::Output { path, found, side_px, most_leading: MOST_LEADING }
    }

    /// Adds the vectors of a tile to those of its patches that the map has, and counts them.
    fn add(&self, tile: &[f32], first: (usize, usize), map: &mut FeatureMap, counts: &mut [f32]) {
        for row in 0..self.side.min(map.height - first.1) {
            for col in 0..self.side.min(map.width - first.0) {
                let at = (first.1 + row) * map.width + first.0 + col;
                let patch = row * self.side + col;
                counts[at] += 1.0;
                for (c, sum) in map.data[at * self.channels..][..self.channels].iter_mut().enumerate() {
                    *sum += tile[match self.layout {
                        Layout::Tokens { leading } => (leading + patch) * self.channels + c,
                        Layout::Planes => c * self.side * self.side + patch,
                    }];
                }
            }
        }
    }
}

impl DenseFeatures for OnnxFeatures {
    fn patch_px(&self) -> usize {
        self.side_px / self.side
    }

    fn channels(&self) -> usize {
        self.channels
    }

    fn extract(&mut self, rgb: &[Grid2; 3]) -> Result<FeatureMap, FeatureError> {
        let (columns, rows) = picture_size(rgb)?;
        let patch_px = self.patch_px();
        let (width, height) = (columns.div_ceil(patch_px), rows.div_ceil(patch_px));
        let data = vec![0.0; width * height * self.channels];
        let mut map = FeatureMap { width, height, channels: self.channels, data };
        let mut counts = vec![0.0; width * height];
        for row in tile_starts(height, self.side, OVERLAP_PATCHES) {
            for col in tile_starts(width, self.side, OVERLAP_PATCHES) {
                let values =
                    tile_values(rgb, col * patch_px, row * patch_px, self.side_px, Normalization::IMAGENET);
                let tile = self.evaluate(values)?;
                if layout(&tile.shape, self.side_px) != Some((self.layout, self.side, self.channels)) {
                    return Err(self.wrong_output(tile.description()));
                }
                self.add(&tile.values, (col, row), &mut map, &mut counts);
            }
        }
        for (vector, count) in map.data.chunks_exact_mut(self.channels).zip(counts) {
            vector.iter_mut().for_each(|value| *value /= count);
        }
        Ok(map)
    }
}

/// How an output of a shape holds the patches of a picture, how many there are along a side, and how many channels.
fn layout(shape: &[usize], side_px: usize) -> Option<(Layout, usize, usize)> {
    let (layout, side, channels) = match *shape {
        [1, tokens, channels] => {
            let side = tokens.isqrt();
            let leading = tokens - side * side;
            (leading <= MOST_LEADING).then_some((Layout::Tokens { leading }, side, channels))
        }
        [1, channels, rows, columns] => (rows == columns).then_some((Layout::Planes, rows, channels)),
        _ => None,
    }?;
    (side > 0 && channels > 0 && side_px.is_multiple_of(side)).then_some((layout, side, channels))
}
