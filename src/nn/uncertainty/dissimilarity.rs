//! How much the features of two pictures differ, patch by patch.

use super::UncertaintyError;
use crate::io::Grid2;
use crate::nn::features::FeatureMap;

/// The factor λ_p of the dissimilarity (SatGS, equation 17): it is 1 from a cosine of 1/2 down.
pub const SCALE: f64 = 2.0;

/// The dissimilarity `min(1, scale - scale cos(F, F'))` of the vectors of each patch (SatGS, equation 17): 0 where they are
/// parallel, 1 where they differ.
///
/// A vector of zeros is parallel to a vector of zeros and orthogonal to all others.
///
/// # Errors
/// [`UncertaintyError::Shapes`] if the maps differ in shape.
pub fn dissimilarity(first: &FeatureMap, second: &FeatureMap, scale: f64) -> Result<Grid2, UncertaintyError> {
    let shapes = [first, second].map(|map| [map.width, map.height, map.channels]);
    if shapes[0] != shapes[1] {
        return Err(UncertaintyError::Shapes { first: shapes[0], second: shapes[1] });
    }
    Ok(Grid2::from_rows(first.width, first.height, |row, line| {
        for (col, value) in line.iter_mut().enumerate() {
            let difference = scale * (1.0 - cosine(first.at(col, row), second.at(col, row)));
            *value = difference.clamp(0.0, 1.0) as f32;
        }
    }))
}

/// Cosine of the angle between two vectors, in double precision: near 0 the dissimilarity is the rest of a subtraction.
fn cosine(a: &[f32], b: &[f32]) -> f64 {
    let dot =
        |a: &[f32], b: &[f32]| -> f64 { a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum() };
    let squares = dot(a, a) * dot(b, b);
    if squares > 0.0 { dot(a, b) / squares.sqrt() } else { f64::from(dot(a, a) == dot(b, b)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parallel_vectors_do_not_differ_and_orthogonal_ones_do() {
        let map =
            |vectors: [[f32; 2]; 4]| FeatureMap { width: 2, height: 2, channels: 2, data: vectors.concat() };
        let a = map([[1.0, 2.0], [1.0, 0.0], [1.0, 0.0], [0.0, 0.0]]);
        let b = map([[2.0, 4.0], [0.0, 3.0], [0.8, 0.6], [1.0, 0.0]]);
        let found = dissimilarity(&a, &b, SCALE).unwrap();
        for (found, expected) in found.data.iter().zip([0.0, 1.0, 0.4, 1.0]) {
            assert!((found - expected).abs() < 1e-6, "{found} {expected}");
        }
        assert_eq!(dissimilarity(&b, &b, SCALE).unwrap().data, [0.0; 4]);
        let narrow = FeatureMap { width: 4, height: 1, ..a.clone() };
        assert!(matches!(dissimilarity(&a, &narrow, SCALE), Err(UncertaintyError::Shapes { .. })));
    }
}
