//! Features of a network that a user brings as an ONNX file, evaluated with rten.

use super::FeatureError;
use super::map::{DenseFeatures, FeatureMap, picture_size};
use super::onnx_graph::{Fault, check};
use super::tiles::{tile_starts, tile_values};
use crate::io::{Cause, Grid2};
use rten::{DataType, Dimension, Model, NodeId, RunOptions, ThreadPool, TryFromValueError, Value, ValueType};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Side of the pictures of DINOv2 (Oquab et al. 2023), pixels, if a graph takes any.
const DEFAULT_SIDE_PX: usize = 518;
/// Largest side, pixels: beyond it a file is damaged rather than made for such pictures.
const MOST_SIDE_PX: usize = 4096;
/// Means and standard deviations of red, green and blue over ImageNet, by which networks expect their input normalised.
const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
const DEVIATION: [f32; 3] = [0.229, 0.224, 0.225];
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
    path: PathBuf,
    model: Model,
    input: NodeId,
    output: NodeId,
    threads: Arc<ThreadPool>,
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
        check_file(path)?;
        let model = caused(|| Model::load_file(path))
            .map_err(|cause| FeatureError::Load { path: path.into(), cause })?;
        let (input, side_px) = picture_input(&model, path, side_px)?;
        let Some(&output) = model.output_ids().first() else {
            let found = "no output".to_owned();
            return Err(FeatureError::Output {
                path: path.into(),
                found,
                side_px,
                most_leading: MOST_LEADING,
            });
        };
        let threads = Arc::new(ThreadPool::with_num_threads(rayon::current_num_threads()));
        let mut features = Self {
            path: path.into(),
            model,
            input,
            output,
            threads,
            side_px,
            side: 0,
            layout: Layout::Planes,
            channels: 0,
        };
        let gray = features.evaluate(vec![0.0; 3 * side_px * side_px])?;
        (features.layout, features.side, features.channels) =
            layout(&gray.shape, side_px).ok_or_else(|| features.wrong_output(gray.description()))?;
        Ok(features)
    }

    /// The first output for the values of a tile.
    fn evaluate(&self, values: Vec<f32>) -> Result<Evaluated, FeatureError> {
        let failed = |cause: Cause| FeatureError::Run { path: self.path.clone(), cause };
        let picture =
            Value::from_shape([1, 3, self.side_px, self.side_px], values).map_err(|e| failed(e.into()))?;
        let options = RunOptions::default().with_thread_pool(Some(self.threads.clone()));
        let [output] =
            caused(|| self.model.run_n(vec![(self.input, picture.into())], [self.output], Some(options)))
                .map_err(failed)?;
        let evaluated = Evaluated::of(output).map_err(|found| self.wrong_output(found))?;
        if evaluated.values.iter().all(|v| v.is_finite()) {
            Ok(evaluated)
        } else {
            Err(FeatureError::NotFinite { path: self.path.clone() })
        }
    }

    fn wrong_output(&self, found: String) -> FeatureError {
        let (path, side_px) = (self.path.clone(), self.side_px);
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
                let values = tile_values(rgb, col * patch_px, row * patch_px, self.side_px, MEAN, DEVIATION);
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

/// An output of the graph.
struct Evaluated {
    shape: Vec<usize>,
    values: Vec<f32>,
}

impl Evaluated {
    /// A tensor of f32 of rank 3 or 4; else a description of the output.
    fn of(output: Value) -> Result<Self, String> {
        if let Ok((shape, values)) = output.clone().into_shape_vec::<f32, 3>() {
            return Ok(Self { shape: shape.into(), values });
        }
        let found = output.dtype().to_string();
        match output.into_shape_vec::<f32, 4>() {
            Ok((shape, values)) => Ok(Self { shape: shape.into(), values }),
            Err(TryFromValueError::WrongRank { actual, .. }) => Err(format!("{found} of rank {actual}")),
            Err(_) => Err(found),
        }
    }

    fn description(&self) -> String {
        format!("tensor(f32) {:?}", self.shape)
    }
}

/// Checks that a file is a whole ONNX model which rten computes as written.
fn check_file(path: &Path) -> Result<(), FeatureError> {
    let bytes = std::fs::read(path).map_err(|cause| FeatureError::Read { path: path.into(), cause })?;
    check(&bytes).map_err(|fault| match fault {
        Fault::Damaged { at, reason } => FeatureError::Damaged { path: path.into(), at, reason },
        Fault::CubicResize { node } => FeatureError::CubicResize { path: path.into(), node },
    })
}

/// The graph's only input, and its side in pixels; `open_px` if that is open.
fn picture_input(model: &Model, path: &Path, open_px: usize) -> Result<(NodeId, usize), FeatureError> {
    let inputs: Vec<_> =
        model.input_ids().iter().filter_map(|&id| Some((id, model.node_info(id)?))).collect();
    if let [(id, info)] = &inputs[..] {
        let is_float = info.dtype().is_none_or(|dtype| dtype == ValueType::Tensor(DataType::Float));
        let side = info.shape().map_or(Some(open_px), |shape| picture_side(&shape, open_px));
        if let (true, Some(side)) = (is_float, side) {
            return Ok((*id, side));
        }
    }
    let found: Vec<String> = inputs.iter().map(|(_, info)| format!("{info:?}")).collect();
    let found = if found.is_empty() { "nothing".to_owned() } else { found.join(", ") };
    Err(FeatureError::Input { path: path.into(), found })
}

/// The side of pictures of a shape, if that is `[1, 3, side, side]` where it is fixed.
fn picture_side(shape: &[Dimension], open_px: usize) -> Option<usize> {
    let [batch, colors, rows, columns] = shape else { return None };
    let fixed = |dimension: &Dimension| match dimension {
        Dimension::Fixed(size) => Some(*size),
        Dimension::Symbolic(_) => None,
    };
    let side = fixed(rows).or(fixed(columns)).unwrap_or(open_px);
    let is_or_open = |dimension, size| fixed(dimension).is_none_or(|s| s == size);
    let fits =
        is_or_open(batch, 1) && is_or_open(colors, 3) && is_or_open(rows, side) && is_or_open(columns, side);
    (fits && (1..=MOST_SIDE_PX).contains(&side)).then_some(side)
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

/// What the runtime returns, with its error as a cause.
fn caused<T, E: Into<Cause>>(run: impl FnOnce() -> Result<T, E>) -> Result<T, Cause> {
    run().map_err(Into::into)
}
