//! Pictures of any size in square tiles of whole patches.

use crate::io::Grid2;
use crate::nn::onnx::Normalization;

/// The first patch of each tile along an axis of `patches`: tiles of `tile` patches cover the axis, neighbours share at least
/// `overlap`, and the last one ends where the axis does. One tile, which reaches beyond the axis, if that is shorter.
pub(super) fn tile_starts(patches: usize, tile: usize, overlap: usize) -> Vec<usize> {
    let step = tile.saturating_sub(overlap).max(1);
    let last = patches.saturating_sub(tile);
    (0..last).step_by(step).chain([last]).collect()
}

/// The values that a network sees of a tile, colour by colour and row by row: normalised, with the picture mirrored
/// at its borders as often as needed.
pub(super) fn tile_values(
    rgb: &[Grid2; 3],
    first_col: usize,
    first_row: usize,
    side: usize,
    normalization: Normalization,
) -> Vec<f32> {
    let columns: Vec<usize> = (0..side).map(|k| mirrored(first_col + k, rgb[0].width)).collect();
    let mut values = Vec::with_capacity(3 * side * side);
    for (c, plane) in rgb.iter().enumerate() {
        for row in first_row..first_row + side {
            let line = plane.row(mirrored(row, plane.height));
            values.extend(columns.iter().map(|&col| normalization.of(c, line[col])));
        }
    }
    values
}

/// A pixel's place in an axis of `n` pixels that is mirrored at its ends; the pixels at the ends are repeated.
fn mirrored(pixel: usize, n: usize) -> usize {
    let place = pixel % (2 * n);
    if place < n { place } else { 2 * n - 1 - place }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_an_axis_and_overlap() {
        assert_eq!(tile_starts(54, 37, 3), [0, 17]);
        assert_eq!(tile_starts(71, 37, 3), [0, 34]);
        assert_eq!(tile_starts(72, 37, 3), [0, 34, 35]);
        assert_eq!(tile_starts(37, 37, 3), [0]);
        assert_eq!(tile_starts(5, 37, 3), [0]);
        assert_eq!(tile_starts(4, 2, 3), [0, 1, 2]);
    }

    #[test]
    fn a_small_picture_is_mirrored_as_often_as_needed() {
        let plane = Grid2::from_fn(3, 1, |col, _| [0.1, 0.2, f32::NAN][col]);
        let rgb = [plane.clone(), plane.clone(), plane];
        let values = tile_values(&rgb, 0, 0, 8, Normalization::NONE);
        assert_eq!(values[..8], [0.1, 0.2, 0.0, 0.0, 0.2, 0.1, 0.1, 0.2]);
        assert_eq!(values.len(), 3 * 64);
    }
}
