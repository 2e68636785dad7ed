//! Scores of a mesh against a reference, by distances between their surfaces, with the definitions of Manhattan-SDF's
//! evaluation (Guo et al. 2022), which later work on rooms follows, for places that are spread evenly over the surfaces
//! instead of vertices: the size of triangles does not matter, and vertices without triangles do not count.

use super::MetricsError;
use crate::mesh::{SurfaceTree, TriangleMesh};
use crate::random::CounterRng;
use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

/// Spacing of the places, as a share of the threshold: 2 cm at 5 cm, the cell in which Manhattan-SDF merges vertices.
const SPACING_SHARE: f64 = 0.4;
/// Most places on a mesh: those of larger surfaces are farther from each other. 100 MB of memory.
const MOST_PLACES: f64 = 4e6;
/// Seed of the places.
const SEED: u64 = 0;
/// Colours of no error, an error of the threshold, and one of twice the threshold or more (RdYlGn of ColorBrewer).
const ERROR_COLORS: [[f64; 3]; 3] = [[26.0, 152.0, 80.0], [255.0, 255.0, 191.0], [215.0, 48.0, 39.0]];

/// Scores of a mesh against a reference.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MeshScores {
    /// Distance up to which a point counts as correct, metres.
    pub threshold_m: f64,
    /// Mean distance from the mesh to the reference, metres.
    pub accuracy_m: f64,
    /// Mean distance from the reference to the mesh, metres.
    pub completeness_m: f64,
    /// Mean of accuracy and completeness, metres.
    pub chamfer_m: f64,
    /// Share of the mesh's places within the threshold.
    pub precision: f64,
    /// Share of the reference's places within the threshold.
    pub recall: f64,
    /// Harmonic mean of precision and recall.
    pub f1: f64,
    /// Spacing of the places on the mesh and on the reference: one for each square of this side, metres.
    pub spacing_m: [f64; 2],
    /// Number of places on the mesh.
    pub places: usize,
    /// Number of places on the reference.
    pub reference_places: usize,
}

/// Scores a mesh against a reference in the same frame, at places with a spacing of 0.4 times the threshold on both.
///
/// # Errors
/// [`MetricsError::EmptyMesh`] if one of them has no surface.
pub fn mesh_scores(
    mesh: &TriangleMesh,
    reference: &TriangleMesh,
    threshold_m: f64,
) -> Result<MeshScores, MetricsError> {
    let [ours, theirs] = [mesh, reference].map(|m| Places::new(m, SPACING_SHARE * threshold_m));
    if ours.places.is_empty() || theirs.places.is_empty() {
        return Err(empty(mesh, reference));
    }
    let (to_reference, to_mesh) = (distances(&ours.places, reference), distances(&theirs.places, mesh));
    let (Some(to_reference), Some(to_mesh)) = (to_reference, to_mesh) else {
        return Err(empty(mesh, reference));
    };
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
        spacing_m: [ours.spacing, theirs.spacing],
        places: ours.places.len(),
        reference_places: theirs.places.len(),
    })
}

/// The mesh coloured by the distance of its vertices to the reference: green for none, yellow at the threshold, red from
/// twice the threshold on.
///
/// # Errors
/// As [`mesh_scores`].
pub fn error_mesh(
    mesh: &TriangleMesh,
    reference: &TriangleMesh,
    threshold_m: f64,
) -> Result<TriangleMesh, MetricsError> {
    let vertices: Vec<DVec3> = mesh.vertices.iter().map(|p| DVec3::from_array(*p)).collect();
    let distances = distances(&vertices, reference).ok_or_else(|| empty(mesh, reference))?;
    let colors = distances.iter().map(|d| error_color(d / threshold_m)).collect();
    Ok(TriangleMesh { colors, ..mesh.clone() })
}

fn error_color(thresholds: f64) -> [u8; 3] {
    let place = thresholds.clamp(0.0, 2.0);
    let first = (place as usize).min(1);
    let (a, b, t) = (ERROR_COLORS[first], ERROR_COLORS[first + 1], place - first as f64);
    std::array::from_fn(|k| (a[k] + (b[k] - a[k]) * t).round() as u8)
}

/// Places on a surface.
struct Places {
    places: Vec<DVec3>,
    /// Side of the square that each stands for.
    spacing: f64,
}

impl Places {
    /// Places spread over the triangles of a mesh by area: one at random in each of equal parts of the area, triangle after
    /// triangle.
    fn new(mesh: &TriangleMesh, spacing: f64) -> Self {
        let mut sum = 0.0;
        let up_to: Vec<f64> = (0..mesh.triangles.len())
            .map(|t| {
                let [a, b, c] = mesh.corners(t);
                sum += 0.5 * (b - a).cross(c - a).length();
                sum
            })
            .collect();
        if sum == 0.0 {
            return Self { places: Vec::new(), spacing };
        }
        let count = (sum / (spacing * spacing)).round().clamp(1.0, MOST_PLACES);
        let place = |k: usize| {
            let mut random = CounterRng::new(SEED, 0, 0, k as u64);
            let area = (k as f64 + random.uniform()) / count * sum;
            let t = up_to.partition_point(|end| *end <= area).min(up_to.len() - 1);
            let [a, b, c] = mesh.corners(t);
            // Osada et al., Shape distributions, 2002, equation 1.
            let (root, v) = (random.uniform().sqrt(), random.uniform());
            (1.0 - root) * a + root * (1.0 - v) * b + root * v * c
        };
        let places = (0..count as usize).into_par_iter().map(place).collect();
        Self { places, spacing: (sum / count).sqrt() }
    }
}

fn empty(mesh: &TriangleMesh, reference: &TriangleMesh) -> MetricsError {
    let (triangles, reference_triangles) = (mesh.triangles.len(), reference.triangles.len());
    MetricsError::EmptyMesh { triangles, reference_triangles }
}

/// Distance of each place to the surface of a mesh; none if that has no triangles.
fn distances(places: &[DVec3], mesh: &TriangleMesh) -> Option<Vec<f64>> {
    let tree = SurfaceTree::new(mesh)?;
    Some(places.par_iter().map(|p| tree.distance(*p)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A level square of one metre at an altitude, of 2 x n x n triangles.
    fn plane(z: f64, n: u32) -> TriangleMesh {
        let at = |i: u32| f64::from(i) / f64::from(n);
        let vertices = (0..=n).flat_map(|row| (0..=n).map(move |col| [at(col), at(row), z])).collect();
        let corner = |col: u32, row: u32| row * (n + 1) + col;
        let quad = |i: u32| {
            let (col, row) = (i % n, i / n);
            let [a, b, c, d] = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(x, y)| corner(col + x, row + y));
            [[a, b, c], [a, c, d]]
        };
        TriangleMesh { vertices, triangles: (0..n * n).flat_map(quad).collect(), ..TriangleMesh::default() }
    }

    /// Closed form: two planes at a distance of 3 cm, and of 6 cm; and the size of triangles does not matter.
    #[test]
    fn scores_of_shifted_planes_are_their_distance() {
        let scores = |shift: f64| mesh_scores(&plane(shift, 100), &plane(0.0, 1), 0.05).unwrap();
        let near = scores(0.03);
        for distance in [near.accuracy_m, near.completeness_m, near.chamfer_m] {
            assert!((distance - 0.03).abs() < 1e-9, "{distance}");
        }
        assert_eq!((near.precision, near.recall, near.f1), (1.0, 1.0, 1.0));
        assert!(near.places == 2500 && near.spacing_m.iter().all(|s| (s - 0.02).abs() < 1e-9));
        let far = scores(0.06);
        assert!((far.accuracy_m - 0.06).abs() < 1e-9);
        assert_eq!((far.precision, far.recall, far.f1), (0.0, 0.0, 0.0));
        let same = scores(0.0);
        assert!(same.chamfer_m < 1e-12 && same.f1 == 1.0);
    }

    /// Half of the reference is missing: all that is there is right.
    #[test]
    fn what_is_missing_lowers_recall_and_not_precision() {
        let mut half = plane(0.0, 100);
        half.triangles.retain(|t| half.vertices[t[0] as usize][0] < 0.5);
        let scores = mesh_scores(&half, &plane(0.0, 3), 0.05).unwrap();
        assert_eq!(scores.precision, 1.0);
        assert!((0.53..0.57).contains(&scores.recall), "{}", scores.recall);
        assert!((0.12..0.13).contains(&scores.completeness_m), "{}", scores.completeness_m);
        assert!(mesh_scores(&TriangleMesh::default(), &half, 0.05).is_err());
    }

    #[test]
    fn dense_parts_and_vertices_without_triangles_do_not_count_more() {
        let mut dense = plane(0.0, 2);
        let first = dense.vertices.len() as u32;
        // A square millimetre of a thousand triangles, a metre above, and vertices that no triangle uses.
        let corner = |i: u32| [0.5 + 1e-6 * f64::from(i), 0.5 + 1e-3 * f64::from(i % 2), 1.0];
        dense.vertices.extend((0..1000).map(corner));
        dense.triangles.extend((0..998).map(|i| [first + i, first + i + 1, first + i + 2]));
        dense.vertices.extend((0..1000).map(|i| [0.0, 0.0, f64::from(i)]));
        let scores = mesh_scores(&dense, &plane(0.0, 100), 0.05).unwrap();
        assert!(scores.precision > 0.999, "{}", scores.precision);
    }

    #[test]
    fn errors_are_green_yellow_and_red() {
        let color = |z| error_mesh(&plane(z, 4), &plane(0.0, 1), 0.05).unwrap().colors[0];
        assert_eq!([color(0.0), color(0.05), color(0.2)], [[26, 152, 80], [255, 255, 191], [215, 48, 39]]);
    }
}
