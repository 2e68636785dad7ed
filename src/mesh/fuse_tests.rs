//! Depth maps of bodies whose surface is known.

use super::*;
use crate::affine::ViewCamera;
use crate::io::Grid2;
use crate::mesh::{DepthCamera, render_depth};
use crate::perspective::PinholeCamera;
use crate::progress::NoProgress;
use glam::{DMat3, DVec2, DVec3};

/// A camera at a place that looks at the origin.
fn looking_at_origin(center: DVec3) -> PinholeCamera {
    let forward = -center.normalize();
    let right = forward.cross(if forward.z.abs() > 0.9 { DVec3::X } else { DVec3::Z }).normalize();
    let cam_from_site = DMat3::from_cols(right, forward.cross(right), forward).transpose();
    let (focal, principal) = (DVec2::splat(300.0), DVec2::new(159.5, 119.5));
    PinholeCamera { cam_from_site, center, focal, principal, size: (320, 240) }
}

/// Directions spread evenly over the sphere (a Fibonacci lattice).
fn directions(n: usize) -> impl ExactSizeIterator<Item = DVec3> {
    (0..n).map(move |i| {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / n as f64;
        let (sin, cos) = (2.399_963_229_728_653 * i as f64).sin_cos();
        let level = (1.0 - z * z).sqrt();
        DVec3::new(level * cos, level * sin, z)
    })
}

/// The depth map of the unit sphere, from an exact intersection.
fn sphere(center: DVec3) -> DepthMap {
    let pinhole = looking_at_origin(center);
    let camera = DepthCamera::Pinhole(pinhole);
    let depth = Grid2::from_fn(320, 240, |col, row| {
        let ray = camera.point(col as f64, row as f64, 1.0) - center;
        let (a, b, c) = (ray.length_squared(), center.dot(ray), center.length_squared() - 1.0);
        ((-b - (b * b - a * c).sqrt()) / a) as f32
    });
    let color = Some([0.2, 0.4, 0.6].map(|v| Grid2::filled(320, 240, v)));
    DepthMap { color, ..DepthMap::new(camera, depth) }
}

fn options(voxel_m: f64) -> FuseOptions {
    FuseOptions {
        voxel_m,
        truncation_m: 4.0 * voxel_m,
        depth_max_m: None,
        bounds: None,
        kept: KeptPieces::LARGEST,
    }
}

fn fused(maps: impl Iterator<Item = DepthMap>, options: &FuseOptions) -> Result<FusedMesh, FuseFailure> {
    fuse(maps.map(Ok), options, &NoProgress)
}

/// What fusing may end with in these tests.
#[derive(Debug)]
enum FuseFailure {
    Mesh(MeshError),
    Interrupted,
}

impl From<MeshError> for FuseFailure {
    fn from(e: MeshError) -> Self {
        Self::Mesh(e)
    }
}

impl From<Interrupted> for FuseFailure {
    fn from(_: Interrupted) -> Self {
        Self::Interrupted
    }
}

fn corners(mesh: &TriangleMesh, triangle: [u32; 3]) -> [DVec3; 3] {
    triangle.map(|v| DVec3::from_array(mesh.vertices[v as usize]))
}

/// Spec: mean error below a quarter of a voxel from 24 maps.
#[test]
fn a_sphere_is_recovered_closed_with_outward_faces_normals_and_colours() {
    let voxel = 0.05;
    let result = fused(directions(24).map(|d| sphere(3.0 * d)), &options(voxel)).unwrap();
    let mesh = &result.mesh;
    let errors: Vec<f64> =
        mesh.vertices.iter().map(|p| (DVec3::from_array(*p).length() - 1.0).abs()).collect();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    let worst = errors.iter().copied().fold(0.0, f64::max);
    assert!(mean < 0.25 * voxel && worst < voxel, "{mean} {worst}");
    assert_eq!((result.maps, result.pieces.0), (24, 1));
    // Euler's formula of a closed surface without holes: V - E + F = 2, with three half edges a face.
    let (v, f) = (mesh.vertices.len() as i64, mesh.triangles.len() as i64);
    assert_eq!(v - 3 * f / 2 + f, 2);
    for t in &mesh.triangles {
        let [a, b, c] = corners(mesh, *t);
        assert!((b - a).cross(c - a).dot(a) >= 0.0);
    }
    let cosine = |(p, n): (&[f64; 3], &[f32; 3])| {
        DVec3::from_array(*p).normalize().dot(DVec3::from_array(n.map(f64::from)))
    };
    let cosines: Vec<f64> = mesh.vertices.iter().zip(&mesh.normals).map(cosine).collect();
    let off = cosines.iter().filter(|c| **c < 0.98).count() as f64 / cosines.len() as f64;
    let least = cosines.iter().copied().fold(1.0, f64::min);
    assert!(off < 0.1 && least > 0.9, "{off} {least}");
    assert!(mesh.colors.iter().all(|c| *c == [51, 102, 153]));
}

/// The plane z = 0.3 x - 0.2 y + 1 under parallel rays, one of them with normals.
#[test]
fn a_tilted_plane_under_parallel_rays_lies_where_it_is() {
    let normal = DVec3::new(-0.3, 0.2, 1.0).normalize();
    let plane = |slope: [f64; 2], with_normals: bool| {
        let linear = [[2.0, 0.0, -2.0 * slope[0]], [0.0, -2.0, 2.0 * slope[1]]];
        let camera =
            DepthCamera::Parallel { camera: ViewCamera::affine(linear, [60.0, 50.0]), size: (120, 100) };
        let along = camera.step(0.0, 0.0);
        let depth = Grid2::from_fn(120, 100, |col, row| {
            let p = camera.point(col as f64, row as f64, 0.0);
            ((1.0 - normal.dot(p) / normal.z) / (normal.dot(along) / normal.z) + 0.0) as f32
        });
        let normals = normal.to_array().map(|v| Grid2::filled(120, 100, v as f32));
        DepthMap { normal: with_normals.then_some(normals), ..DepthMap::new(camera, depth) }
    };
    for with_normals in [false, true] {
        let slopes = [[0.0, 0.0], [0.4, 0.1], [-0.3, 0.2], [0.0, -0.5]];
        let maps = slopes.into_iter().map(|s| plane(s, with_normals));
        let mesh = fused(maps, &options(0.5)).unwrap().mesh;
        assert!(mesh.triangles.len() > 5000);
        let worst = mesh.vertices.iter().map(|[x, y, z]| (z - (0.3 * x - 0.2 * y + 1.0)).abs());
        let worst = worst.fold(0.0, f64::max);
        // Without normals, distances are those along rays, which voxels that fewer views see mix differently.
        assert!(worst < if with_normals { 1e-3 } else { 0.01 }, "{worst}");
    }
}

/// Near depth edges the nearest pixel counts, and what is behind the nearer surface is not known.
#[test]
fn a_step_has_a_wall_where_cameras_see_it_and_none_where_they_do_not() {
    // A roof at 6 m over x < 0, ground at 0 m beside it, seen from straight above and from the east.
    let view = |slope: f64| {
        let camera = DepthCamera::Parallel {
            camera: ViewCamera::affine([[4.0, 0.0, -4.0 * slope], [0.0, -4.0, 0.0]], [59.5, 39.5]),
            size: (120, 80),
        };
        let depth = Grid2::from_fn(120, 80, |col, row| {
            let [roof, ground] = [6.0, 0.0].map(|z| camera.point(col as f64, row as f64, z).x);
            // Between the edge of the roof and the foot of the wall a ray meets the plane x = 0.
            if roof < 0.0 {
                6.0
            } else if ground < 0.0 {
                (-ground / slope) as f32
            } else {
                0.0
            }
        });
        DepthMap::new(camera, depth)
    };
    let with_normals = |slope: f64| {
        let mut map = view(slope);
        map.estimate_normals();
        map
    };
    let wall = |maps: Vec<DepthMap>| {
        let mesh = fused(maps.into_iter(), &options(0.5)).unwrap().mesh;
        let is_wall = |t: &&[u32; 3]| {
            let [a, b, c] = corners(&mesh, **t);
            let n = (b - a).cross(c - a).normalize();
            n.x > 0.9 && (1.5..4.5).contains(&a.z) && a.x.abs() < 0.5
        };
        mesh.triangles.iter().filter(is_wall).count()
    };
    assert!(wall(vec![view(0.0), view(0.5), view(0.6)]) > 200);
    assert_eq!(wall(vec![view(0.0)]), 0);
    assert!(wall([0.0, 0.5, 0.6].map(with_normals).to_vec()) > 200);
    assert_eq!(wall(vec![with_normals(0.0)]), 0);
}

#[test]
fn a_mesh_rendered_to_depth_and_fused_again_is_the_same_surface() {
    let first = fused(directions(24).map(|d| sphere(3.0 * d)), &options(0.05)).unwrap().mesh;
    let cameras = directions(24).map(|d| DepthCamera::Pinhole(looking_at_origin(3.0 * d)));
    let again = cameras.map(|c| DepthMap::new(c, render_depth(&first, &c)));
    let again = fused(again, &options(0.05)).unwrap().mesh;
    let mean = again.vertices.iter().map(|p| (DVec3::from_array(*p).length() - 1.0).abs()).sum::<f64>()
        / again.vertices.len() as f64;
    assert!(mean < 0.0125, "{mean}");
}

#[test]
fn any_number_of_threads_gives_the_same_mesh() {
    let mesh = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fused(directions(6).map(|d| sphere(3.0 * d)), &options(0.04)).unwrap().mesh)
    };
    assert_eq!(mesh(1), mesh(3));
}

#[test]
fn maps_without_use_are_errors_and_hostile_depths_are_left_out() {
    let map = || sphere(DVec3::new(3.0, 0.0, 0.0));
    let refused = |maps: Vec<DepthMap>, options: &FuseOptions| match fused(maps.into_iter(), options) {
        Err(FuseFailure::Mesh(e)) => e.to_string(),
        other => panic!("{other:?}"),
    };
    let mut small = map();
    small.depth = Grid2::filled(10, 10, 1.0);
    assert!(refused(vec![map(), small], &options(0.05)).contains("depth map 1 has 10 x 10 pixels"));
    let near = FuseOptions { depth_max_m: Some(1.0), ..options(0.05) };
    assert!(refused(vec![map()], &near).contains("show no surface"));
    let elsewhere = FuseOptions { bounds: Some([[5.0; 3], [6.0; 3]]), ..options(0.05) };
    assert!(refused(vec![map()], &elsewhere).contains("show no surface"));
    let mut volume = TsdfVolume::new(0.05, 0.2);
    volume.most_bytes = 1 << 18;
    let too_large = volume.integrate(&map()).unwrap_err().to_string();
    assert!(too_large.contains("voxels of 0.05 m need more than 0.000244140625 GiB"), "{too_large}");
    let mut hostile = map();
    for (i, v) in hostile.depth.data.iter_mut().enumerate() {
        *v = [f32::NAN, f32::INFINITY, -1.0, 0.0, 3e38, f32::MIN_POSITIVE][i % 6];
    }
    let far = FuseOptions { depth_max_m: Some(10.0), ..options(0.05) };
    assert!(refused(vec![hostile.clone()], &far).contains("no surface"));
    let _ = fused([hostile].into_iter(), &options(0.05));
}
