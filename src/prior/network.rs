//! Depths and normals by a network that a user brings as an ONNX file, such as Depth Anything V2 (Yang et al. 2024).

use super::error::PriorError;
use super::map::PriorContent;
use super::resample::resampled;
use crate::io::{Grid2, NpyArray, NumberKind};
use crate::nn::onnx::{MOST_SIDE_PX, Normalization, OnnxModel, OnnxOutput, OnnxTensor};
use std::path::Path;

/// Length of the shorter side of the picture that a network of open size gets, pixels, and of which both sides are multiples
/// (Depth Anything V2).
const SHORTER_SIDE_PX: usize = 518;
const PATCH_PX: usize = 14;
/// Rows and columns of the pictures of Depth Pro (Bochkovskii et al. 2024), of which values are normalised otherwise.
const DEPTH_PRO: [usize; 2] = [1536, 1536];

/// A network that gives a map of a picture.
pub(super) struct PriorNetwork {
    model: OnnxModel,
    content: PriorContent,
}

impl PriorNetwork {
    /// Reads a network.
    ///
    /// # Errors
    /// [`PriorError::Network`].
    pub fn load(path: &Path, content: PriorContent) -> Result<Self, PriorError> {
        Ok(Self { model: OnnxModel::load(path)?, content })
    }

    /// The map of a picture, in its proportion of sides and not larger than it: rows x columns, for normals x 3.
    ///
    /// # Errors
    /// [`PriorError::Network`], [`PriorError::Output`].
    pub fn map(&self, rgb: [Grid2; 3]) -> Result<NpyArray, PriorError> {
        let (width, height) = (rgb[0].width, rgb[0].height);
        let size @ [rows, columns] = input_size(self.model.input_size(), width, height);
        let tensor = match self.model.evaluate(size, values(rgb, size))? {
            OnnxOutput::Tensor(tensor) => tensor,
            OnnxOutput::Other(found) => return Err(self.wrong_output(found, size)),
        };
        let found = tensor.description();
        let planes = planes(tensor, self.content, size).ok_or_else(|| self.wrong_output(found, size))?;
        // As fine as the network gives it in the direction that it has squeezed less.
        let finest = (planes[0].width as f64 / width as f64).max(planes[0].height as f64 / height as f64);
        let scale = finest.min(1.0);
        let [map_width, map_height] = [width, height].map(|n| ((n as f64 * scale).round() as usize).max(1));
        tracing::debug!("{columns} x {rows} pixels, map of {map_width} x {map_height}");
        let fitted: Vec<Grid2> = planes.into_iter().map(|p| resampled(p, map_width, map_height)).collect();
        let mut shape = vec![map_height, map_width];
        if fitted.len() > 1 {
            shape.push(fitted.len());
        }
        let values =
            (0..map_width * map_height).flat_map(|i| fitted.iter().map(move |p| p.data[i])).collect();
        Ok(NpyArray { shape, values, kind: NumberKind::Float })
    }

    fn wrong_output(&self, found: String, [rows, columns]: [usize; 2]) -> PriorError {
        let expected = match self.content {
            PriorContent::Depths => "[1, rows, columns] or [1, 1, rows, columns]",
            PriorContent::Normals => "[1, 3, rows, columns] or [1, rows, columns, 3]",
        };
        let (path, content) = (self.model.path().into(), self.content);
        PriorError::Output { path, found, content, expected, columns, rows }
    }
}

/// Rows and columns of the input for a picture: what the graph fixes; else 518 for the shorter side and the other one in
/// proportion, multiples of 14.
fn input_size([rows, columns]: [Option<usize>; 2], width: usize, height: usize) -> [usize; 2] {
    let (w, h) = (width as f64, height as f64);
    let multiple = |side: f64| {
        let patches = (side / PATCH_PX as f64).round() as usize;
        PATCH_PX * patches.clamp(1, MOST_SIDE_PX / PATCH_PX)
    };
    match (rows, columns) {
        (Some(rows), Some(columns)) => [rows, columns],
        (Some(rows), None) => [rows, multiple(rows as f64 * w / h)],
        (None, Some(columns)) => [multiple(columns as f64 * h / w), columns],
        (None, None) => [h, w].map(|side| multiple(SHORTER_SIDE_PX as f64 * side / w.min(h))),
    }
}

/// The values that a network sees of a whole picture at its input's size.
fn values(rgb: [Grid2; 3], size: [usize; 2]) -> Vec<f32> {
    let normalization = if size == DEPTH_PRO { Normalization::SYMMETRIC } else { Normalization::IMAGENET };
    let mut values = Vec::with_capacity(3 * size[0] * size[1]);
    for (color, mut plane) in rgb.into_iter().enumerate() {
        // Pixels without data must not spread to those around.
        plane.data.iter_mut().filter(|v| v.is_nan()).for_each(|v| *v = 0.0);
        let fitted = resampled(plane, size[1], size[0]);
        values.extend(fitted.data.iter().map(|value| normalization.of(color, *value)));
    }
    values
}

/// The planes of an output that shows the whole picture; none if it does not.
fn planes(tensor: OnnxTensor, content: PriorContent, [rows, columns]: [usize; 2]) -> Option<Vec<Grid2>> {
    let OnnxTensor { shape, values } = tensor;
    let (height, width, is_last) = match (content, shape.as_slice()) {
        (PriorContent::Depths, &[1, height, width] | &[1, 1, height, width]) => (height, width, false),
        (PriorContent::Normals, &[1, 3, height, width]) => (height, width, false),
        (PriorContent::Normals, &[1, height, width, 3]) => (height, width, true),
        _ => return None,
    };
    // Patch tokens, for example, have as many rows as there are patches.
    let is_whole = (height as f64 * columns as f64 / rows as f64 - width as f64).abs() <= 1.0;
    if height < 2 || width < 2 || !is_whole {
        return None;
    }
    let count = values.len() / (height * width);
    let plane = |k: usize| {
        let data = if is_last {
            values.iter().skip(k).step_by(count).copied().collect()
        } else {
            values[k * height * width..][..height * width].to_vec()
        };
        Grid2 { width, height, data }
    };
    Some((0..count).map(plane).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_open_input_gets_the_picture_in_its_proportion() {
        assert_eq!(input_size([None, None], 640, 480), [518, 686]);
        assert_eq!(input_size([None, None], 480, 640), [686, 518]);
        assert_eq!(input_size([Some(518), Some(518)], 640, 480), [518, 518]);
        assert_eq!(input_size([Some(518), None], 640, 480), [518, 686]);
        assert_eq!(input_size([None, None], 100_000, 10), [518, 4088]);
    }
}
