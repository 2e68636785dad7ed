//! Depth maps of meshes, by a z-buffer.
//!
//! The inverse depth of a pinhole camera and the altitude under parallel rays are linear in the image, and greater ones are
//! nearer: the buffer keeps the greatest.

use super::{DepthCamera, TriangleMesh};
use crate::frame::Point;
use crate::io::Grid2;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Triangles that reach behind a pinhole camera are cut at this share of their greatest depth.
const NEAREST: f64 = 1e-4;
/// Triangles that one thread projects at a time.
const TRIANGLES_AT_ONCE: usize = 4096;
/// Rows of pixels that one thread draws at a time.
const BAND_ROWS: usize = 64;
/// How far outside of a triangle a pixel may lie, as a share of it, so that no gap opens between neighbours.
const SLACK: f64 = 1e-9;

/// A corner of a triangle in the image: column, row, and what is greater where it is nearer.
type ImageCorner = DVec3;

/// The depth map of a mesh, in the depths of the camera; NaN where there is no triangle.
#[must_use]
pub fn render_depth(mesh: &TriangleMesh, camera: &DepthCamera) -> Grid2 {
    let (width, height) = camera.size();
    let triangles = image_triangles(mesh, camera);
    let mut out = Grid2::filled(width, height, f32::NAN);
    out.data.par_chunks_mut((BAND_ROWS * width).max(1)).enumerate().for_each(|(band, depths)| {
        let first = band * BAND_ROWS;
        let rows = depths.len() / width.max(1);
        let mut nearest = vec![f64::NEG_INFINITY; depths.len()];
        triangles.iter().for_each(|t| draw(*t, &mut nearest, first, rows, width));
        for (depth, near) in depths.iter_mut().zip(nearest).filter(|(_, near)| near.is_finite()) {
            *depth = match camera {
                DepthCamera::Pinhole(_) => near.recip(),
                DepthCamera::Parallel { .. } => near,
            } as f32;
        }
    });
    out
}

/// The triangles that may be in the image, those that reach behind a pinhole camera cut; in the order of the mesh.
fn image_triangles(mesh: &TriangleMesh, camera: &DepthCamera) -> Vec<[ImageCorner; 3]> {
    let (width, height) = camera.size();
    let last = DVec2::new(width as f64 - 1.0, height as f64 - 1.0);
    let positions = mesh.vertices.par_iter().map(|p| DVec3::from_array(*p));
    // Corners in the image; of a pinhole camera, in its axes.
    let corners: Vec<DVec3> = match camera {
        DepthCamera::Parallel { camera, .. } => positions
            .map(|p| {
                let px = camera.project(Point::new(p.x, p.y, p.z));
                DVec3::new(px.col, px.row, p.z)
            })
            .collect(),
        DepthCamera::Pinhole(camera) => {
            positions.map(|p| camera.cam_from_site * (p - camera.center)).collect()
        }
    };
    let may_show = |[a, b, c]: &[ImageCorner; 3]| {
        let (low, high) = (a.min(*b).min(*c), a.max(*b).max(*c));
        // Comparisons with NaN are false, so that corners that are not finite are not drawn.
        high.x >= 0.0 && high.y >= 0.0 && low.x <= last.x && low.y <= last.y
    };
    let add = |out: &mut Vec<[ImageCorner; 3]>, triangle: &[u32; 3]| {
        let triangle = triangle.map(|v| corners[v as usize]);
        let DepthCamera::Pinhole(camera) = camera else {
            return out.extend(Some(triangle).filter(may_show));
        };
        let image = |p: DVec3| (camera.focal * p.truncate() / p.z + camera.principal).extend(p.z.recip());
        let nearest = NEAREST * triangle.iter().map(|p| p.z).fold(0.0, f64::max);
        if nearest == 0.0 {
            return;
        }
        if triangle.iter().all(|p| p.z >= nearest) {
            out.extend(Some(triangle.map(image)).filter(may_show));
        } else {
            let polygon = in_front(triangle, nearest);
            let fan = (2..polygon.len()).map(|k| [polygon[0], polygon[k - 1], polygon[k]].map(image));
            out.extend(fan.filter(may_show));
        }
    };
    let of_chunk = |triangles: &[[u32; 3]]| {
        let mut out = Vec::new();
        triangles.iter().for_each(|t| add(&mut out, t));
        out
    };
    mesh.triangles.par_chunks(TRIANGLES_AT_ONCE).map(of_chunk).collect::<Vec<_>>().concat()
}

/// The part of a triangle in camera axes beyond a depth: up to four corners.
fn in_front(triangle: [DVec3; 3], nearest: f64) -> Vec<DVec3> {
    let mut out = Vec::with_capacity(4);
    for k in 0..3 {
        let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
        if a.z >= nearest {
            out.push(a);
        }
        if (a.z >= nearest) != (b.z >= nearest) {
            out.push(a.lerp(b, (nearest - a.z) / (b.z - a.z)));
        }
    }
    out
}

/// Draws a triangle into rows of the image.
fn draw([a, b, c]: [ImageCorner; 3], nearest: &mut [f64], first: usize, rows: usize, width: usize) {
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let last = [width as f64 - 1.0, (first + rows) as f64 - 1.0];
    if high.y < first as f64 || low.y > last[1] {
        return;
    }
    let area = (b - a).truncate().perp_dot((c - a).truncate());
    if area == 0.0 || !area.is_finite() {
        return;
    }
    let (from_col, to_col) = (low.x.max(0.0).ceil() as usize, high.x.min(last[0]).floor() as usize);
    let (from_row, to_row) = (low.y.max(first as f64).ceil() as usize, high.y.min(last[1]).floor() as usize);
    let share =
        |p: DVec2, q: DVec3, r: DVec3| (r.truncate() - q.truncate()).perp_dot(p - q.truncate()) / area;
    for row in from_row..=to_row {
        for col in from_col..=to_col {
            let p = DVec2::new(col as f64, row as f64);
            let (u, v) = (share(p, b, c), share(p, c, a));
            let w = 1.0 - u - v;
            if u >= -SLACK && v >= -SLACK && w >= -SLACK {
                let near = &mut nearest[(row - first) * width + col];
                *near = near.max(u * a.z + v * b.z + w * c.z);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::affine::ViewCamera;
    use crate::perspective::PinholeCamera;
    use glam::DMat3;

    /// A square of the plane z = 2 + x / 2 behind which lies a larger level one.
    fn squares() -> TriangleMesh {
        let square = |half: f64, z: f64, slope: f64| {
            [[-half, -half], [half, -half], [half, half], [-half, half]].map(|[x, y]| [x, y, z + slope * x])
        };
        TriangleMesh {
            vertices: [square(1.0, 2.0, 0.5), square(9.0, 6.0, 0.0)].concat(),
            triangles: vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]],
            ..TriangleMesh::default()
        }
    }

    fn pinhole() -> PinholeCamera {
        PinholeCamera {
            cam_from_site: DMat3::IDENTITY,
            center: DVec3::ZERO,
            focal: DVec2::splat(100.0),
            principal: DVec2::new(99.5, 79.5),
            size: (200, 160),
        }
    }

    #[test]
    fn a_pinhole_camera_sees_the_nearest_plane_at_its_exact_depth() {
        let camera = DepthCamera::Pinhole(pinhole());
        let depth = render_depth(&squares(), &camera);
        for (col, row) in [(99, 79), (120, 60), (70, 100)] {
            let x = (col as f64 - 99.5) / 100.0;
            let expected = 2.0 / (1.0 - 0.5 * x);
            assert!((f64::from(depth.at(col, row)) - expected).abs() < 1e-5, "{}", depth.at(col, row));
        }
        assert!((depth.at(2, 2) - 6.0).abs() < 1e-5);
    }

    #[test]
    fn a_parallel_camera_sees_the_highest_plane_at_its_altitude() {
        let camera = ViewCamera::affine([[10.0, 0.0, 2.0], [0.0, -10.0, 0.0]], [60.0, 50.0]);
        let depth = render_depth(&squares(), &DepthCamera::Parallel { camera, size: (120, 100) });
        // The level plane at 6 m hides what is below it.
        assert!((depth.at(60, 50) - 6.0).abs() < 1e-6);
        let mut low = squares();
        low.triangles.truncate(2);
        let depth = render_depth(&low, &DepthCamera::Parallel { camera, size: (120, 100) });
        let z = f64::from(depth.at(66, 50));
        let [x, _] = camera.localize(crate::frame::Pixel::new(66.0, 50.0), z);
        assert!((z - (2.0 + 0.5 * x)).abs() < 1e-5);
        assert!(depth.at(2, 2).is_nan());
    }

    #[test]
    fn the_part_of_a_triangle_behind_the_camera_is_cut() {
        let mesh = TriangleMesh {
            vertices: vec![[-1.0, 1.0, -5.0], [1.0, 1.0, -5.0], [0.0, 1.0, 50.0]],
            triangles: vec![[0, 1, 2]],
            ..TriangleMesh::default()
        };
        let depth = render_depth(&mesh, &DepthCamera::Pinhole(pinhole()));
        // The floor one metre below the camera is seen below the horizon alone.
        assert!((0..80).all(|row| depth.at(99, row).is_nan()));
        assert!((depth.at(99, 129) - 100.0 / 49.5).abs() < 1e-4, "{}", depth.at(99, 129));
        let behind = TriangleMesh { triangles: vec![[0, 1, 1]], ..mesh };
        assert!(render_depth(&behind, &DepthCamera::Pinhole(pinhole())).valid().next().is_none());
    }
}
