//! Planes across the optical axis of a photograph, evenly spaced in the inverse of the depth.

use crate::mvs::ray_costs::Rays;
use crate::perspective::PinholeCamera;
use glam::{DMat3, DVec2, DVec3};
use multiversion::multiversion;
use std::ops::Range;

/// Where a source view sees a pixel of the reference view, by inverse depth: in homogeneous coordinates `pixel + inverse_depth *
/// baseline`, with `pixel` the columns times (column, row, 1).
#[derive(Clone, Copy, Debug)]
pub(super) struct Transfer {
    columns: DMat3,
    baseline: DVec3,
}

impl Transfer {
    /// From a reference view to a source view.
    pub fn new(reference: &PinholeCamera, source: &PinholeCamera) -> Self {
        let matrix = |c: &PinholeCamera| {
            DMat3::from_cols(
                DVec3::new(c.focal.x, 0.0, 0.0),
                DVec3::new(0.0, c.focal.y, 0.0),
                c.principal.extend(1.0),
            )
        };
        let source_matrix = matrix(source);
        let rotation = source.cam_from_site * reference.cam_from_site.transpose();
        Self {
            columns: source_matrix * rotation * matrix(reference).inverse(),
            baseline: source_matrix * (source.cam_from_site * (reference.center - source.center)),
        }
    }

    /// The place of a pixel at an inverse depth; none behind the source view.
    pub fn place(&self, px: DVec2, inverse_depth: f64) -> Option<DVec2> {
        let p = self.columns * px.extend(1.0) + inverse_depth * self.baseline;
        (p.z > 0.0).then(|| p.truncate() / p.z)
    }
}

/// Planes across the optical axis of a reference view: plane `k` lies at the inverse depth `k * step`.
pub(super) struct DepthPlanes {
    /// For each source view.
    pub transfers: Vec<Transfer>,
    /// Difference of inverse depth between planes.
    pub step: f64,
}

impl Rays for DepthPlanes {
    fn places(&self, source: usize, plane: usize, row: usize, columns: Range<usize>, out: [&mut [f32]; 2]) {
        let Transfer { columns: by_pixel, baseline } = self.transfers[source];
        let first = by_pixel * DVec3::new(columns.start as f64, row as f64, 1.0);
        let first = first + plane as f64 * self.step * baseline;
        project_line(first.as_vec3().to_array(), by_pixel.x_axis.as_vec3().to_array(), out);
    }

    fn value(&self, _: usize, plane: f32) -> f32 {
        self.step as f32 * plane
    }
}

/// The images of points at even distances, in homogeneous coordinates, on a line; NaN behind the camera.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx2+fma", "x86_64+avx2+fma"))]
fn project_line(first: [f32; 3], step: [f32; 3], [cols, rows]: [&mut [f32]; 2]) {
    for (i, (col, row)) in cols.iter_mut().zip(rows).enumerate() {
        let k = i as f32;
        let depth = first[2] + k * step[2];
        let inverse = if depth > 0.0 { 1.0 / depth } else { f32::NAN };
        *col = (first[0] + k * step[0]) * inverse;
        *row = (first[1] + k * step[1]) * inverse;
    }
}
