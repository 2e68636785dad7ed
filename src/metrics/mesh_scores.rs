//! Scores of a mesh against a reference, by distances between their vertices, with the definitions of Manhattan-SDF's
//! evaluation (Guo et al. 2022), which later work on rooms follows.

use super::MetricsError;
use crate::mesh::TriangleMesh;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use serde::Serialize;

/// Cell in which vertices are merged, as a share of the threshold (2 cm at 5 cm): meshes of small and of large triangles
/// then count alike.
const CELL_SHARE: f64 = 0.4;
/// Colours of no error, an error of the threshold, and one of twice the threshold or more (RdYlGn of ColorBrewer).
const ERROR_COLORS: [[f64; 3]; 3] = [[26.0, 152.0, 80.0], [255.0, 255.0, 191.0], [215.0, 48.0, 39.0]];

/// Scores of a mesh against a reference.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MeshScores {
    /// Distance up to which a vertex counts as right, metres.
    pub threshold_m: f64,
    /// Mean distance from a vertex of the mesh to the nearest of the reference, metres.
    pub accuracy_m: f64,
    /// Mean distance from a vertex of the reference to the nearest of the mesh, metres.
    pub completeness_m: f64,
    /// Mean of accuracy and completeness, metres.
    pub chamfer_m: f64,
    /// Share of the mesh's vertices within the threshold.
    pub precision: f64,
    /// Share of the reference's vertices within the threshold.
    pub recall: f64,
    /// Harmonic mean of precision and recall.
    pub f1: f64,
    /// Merged vertices of the mesh.
    pub vertices: usize,
    /// Merged vertices of the reference.
    pub reference_vertices: usize,
}

/// Scores a mesh against a reference in the same frame. Vertices are merged in cells of 0.4 times the threshold first.
///
/// # Errors
/// [`MetricsError::EmptyMesh`] if one of them has no vertices.
pub fn mesh_scores(
    mesh: &TriangleMesh,
    reference: &TriangleMesh,
    threshold_m: f64,
) -> Result<MeshScores, MetricsError> {
    let [ours, theirs] = [mesh, reference].map(|m| merged(&m.vertices, CELL_SHARE * threshold_m));
    let (to_reference, to_mesh) = (distances(&ours, &theirs)?, distances(&theirs, &ours)?);
    let mean = |d: &[f64]| d.iter().sum::<f64>() / d.len() as f64;
    let within = |d: &[f64]| d.iter().filter(|d| **d < threshold_m).count() as f64 / d.len() as f64;
    let (accuracy_m, completeness_m) = (mean(&to_reference), mean(&to_mesh));
    let (precision, recall) = (within(&to_reference), within(&to_mesh));
    let sum = precision + recall;
    Ok(MeshScores {
        threshold_m,
        accuracy_m,
        completeness_m,
        chamfer_m: 0.5 * (accuracy_m + completeness_m),
        precision,
        recall,
        f1: if sum > 0.0 { 2.0 * precision * recall / sum } else { 0.0 },
        vertices: ours.len(),
        reference_vertices: theirs.len(),
    })
}

/// The mesh in colours of the distance of its vertices to the reference: green for none, yellow at the threshold, red from
/// twice the threshold on.
///
/// # Errors
/// As [`mesh_scores`].
pub fn error_mesh(
    mesh: &TriangleMesh,
    reference: &TriangleMesh,
    threshold_m: f64,
) -> Result<TriangleMesh, MetricsError> {
    let distances = distances(&mesh.vertices, &reference.vertices)?;
    let colors = distances.iter().map(|d| error_color(d / threshold_m)).collect();
    Ok(TriangleMesh { colors, ..mesh.clone() })
}

fn error_color(thresholds: f64) -> [u8; 3] {
    let place = thresholds.clamp(0.0, 2.0);
    let first = (place as usize).min(1);
    let (a, b, t) = (ERROR_COLORS[first], ERROR_COLORS[first + 1], place - first as f64);
    std::array::from_fn(|k| (a[k] + (b[k] - a[k]) * t).round() as u8)
}

/// The mean of the points in each cell of a grid, ordered by cells.
fn merged(points: &[[f64; 3]], cell: f64) -> Vec<[f64; 3]> {
    let key = |p: &[f64; 3]| p.map(|v| (v / cell).floor() as i64);
    let mut order: Vec<([i64; 3], usize)> = points.par_iter().enumerate().map(|(i, p)| (key(p), i)).collect();
    order.par_sort_unstable();
    let mean = |cell: &[([i64; 3], usize)]| {
        let sum = cell.iter().fold([0.0; 3], |sum, (_, i)| std::array::from_fn(|k| sum[k] + points[*i][k]));
        sum.map(|v: f64| v / cell.len() as f64)
    };
    order.chunk_by(|a, b| a.0 == b.0).map(mean).collect()
}

/// Distance of each point to the nearest of others, metres.
fn distances(points: &[[f64; 3]], others: &[[f64; 3]]) -> Result<Vec<f64>, MetricsError> {
    let empty = || MetricsError::EmptyMesh { vertices: points.len(), reference_vertices: others.len() };
    if points.is_empty() || others.is_empty() {
        return Err(empty());
    }
    let tree = ImmutableKdTree::<f64, 3>::new_from_slice(others).map_err(|_| empty())?;
    let nearest =
        |p: &[f64; 3]| tree.query(p).nearest_one::<SquaredEuclidean<f64>>().execute().distance.sqrt();
    Ok(points.par_iter().map(nearest).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A level square of one metre at an altitude, with vertices each centimetre.
    fn plane(z: f64) -> TriangleMesh {
        let vertices = (0..101 * 101).map(|i| [f64::from(i % 101) * 0.01, f64::from(i / 101) * 0.01, z]);
        TriangleMesh { vertices: vertices.collect(), ..TriangleMesh::default() }
    }

    /// Closed form: two planes at a distance of 3 cm, and of 6 cm.
    #[test]
    fn scores_of_shifted_planes_are_their_distance() {
        let scores = |shift: f64| mesh_scores(&plane(shift), &plane(0.0), 0.05).unwrap();
        let near = scores(0.03);
        for distance in [near.accuracy_m, near.completeness_m, near.chamfer_m] {
            assert!((distance - 0.03).abs() < 1e-9, "{distance}");
        }
        assert_eq!((near.precision, near.recall, near.f1), (1.0, 1.0, 1.0));
        let far = scores(0.06);
        assert!((far.accuracy_m - 0.06).abs() < 1e-9);
        assert_eq!((far.precision, far.recall, far.f1), (0.0, 0.0, 0.0));
    }

    /// Half of the reference is missing: all that is there is right.
    #[test]
    fn what_is_missing_lowers_recall_and_not_precision() {
        let mut half = plane(0.0);
        half.vertices.retain(|p| p[0] < 0.5);
        let scores = mesh_scores(&half, &plane(0.0), 0.05).unwrap();
        assert_eq!(scores.precision, 1.0);
        assert!((0.5..0.6).contains(&scores.recall), "{}", scores.recall);
        assert!((0.1..0.15).contains(&scores.completeness_m), "{}", scores.completeness_m);
        assert!(mesh_scores(&TriangleMesh::default(), &half, 0.05).is_err());
    }

    #[test]
    fn dense_parts_do_not_count_more() {
        let mut dense = plane(0.0);
        dense.vertices.extend((0..100_000).map(|i| [0.5 + f64::from(i) * 1e-8, 0.5, 1.0]));
        let scores = mesh_scores(&dense, &plane(0.0), 0.05).unwrap();
        assert!(scores.precision > 0.999, "{}", scores.precision);
    }

    #[test]
    fn errors_are_green_yellow_and_red() {
        let color = |z| error_mesh(&plane(z), &plane(0.0), 0.05).unwrap().colors[0];
        assert_eq!([color(0.0), color(0.05), color(0.2)], [[26, 152, 80], [255, 255, 191], [215, 48, 39]]);
    }
}
