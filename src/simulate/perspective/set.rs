//! Taking the photographs of a test set, and writing all that is known about them.

use super::camera::PinholeCamera;
use super::points::{FoundPoint, PointFinder, PointRules};
use super::priors;
use super::summary::{TestSetSummary, TestSetView};
use super::surface_mesh::SurfaceMesh;
use super::{Scenery, colmap};
use crate::frame::Pixel;
use crate::io::{NpyArray, NumberKind, WriteError, write_file, write_json, write_png_rgb};
use crate::progress::{Event, Progress};
use crate::scene::Role;
use crate::simulate::error::SimulateError;
use crate::simulate::export::{TEST_LIST, TRAIN_LIST};
use crate::simulate::keyed_rng::KeyedRng;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;

/// Folder of the images.
pub(in crate::simulate) const IMAGES: &str = "images";
/// Folder of the COLMAP model.
pub(in crate::simulate) const MODEL: &str = "sparse/0";
/// The exact mesh.
pub(in crate::simulate) const MESH: &str = "truth/mesh.ply";
/// The affine maps of the depths of the priors.
pub(in crate::simulate) const DISPARITIES: &str = "truth/disparities.json";
/// Folders of exact depths, exact normals, depths and normals of the priors.
pub(in crate::simulate) const MAPS: [&str; 4] =
    ["truth/depths", "truth/normals", "priors/depths", "priors/normals"];
/// File that says what the values of a folder of priors are.
pub(in crate::simulate) const DESCRIPTION: &str = "prior.json";

/// A test set to be written.
pub(in crate::simulate) struct TestSet<'a> {
    pub(in crate::simulate) scenery: &'a dyn Scenery,
    pub(in crate::simulate) cameras: &'a [PinholeCamera],
    pub(in crate::simulate) rules: PointRules,
    /// Numbers of the cameras to train on, if the others are to be held back.
    pub(in crate::simulate) training: Option<Vec<usize>>,
    /// The exact mesh.
    pub(in crate::simulate) mesh: &'a SurfaceMesh,
    /// Random numbers of points and priors.
    pub(in crate::simulate) rng: KeyedRng,
}

/// Exact maps of a view, row by row.
struct ExactMaps {
    /// Depth along the optical axis, metres; NaN where nothing is seen.
    depths: Vec<f32>,
    /// Unit normals in camera axes, towards the camera.
    normals: Vec<f32>,
}

impl TestSet<'_> {
    /// Takes the photographs and writes all files of the set to `out`.
    pub(in crate::simulate) fn write(
        &self,
        out: &Path,
        progress: &dyn Progress,
    ) -> Result<TestSetSummary, SimulateError> {
        let finder = PointFinder {
            scenery: self.scenery,
            cameras: self.cameras,
            rules: self.rules,
            rng: self.rng.key(1),
        };
        progress.event(Event::Started { stage: "taking photographs", total: self.cameras.len() as u64 });
        let (mut points, mut views) = (Vec::new(), Vec::new());
        for (i, camera) in self.cameras.iter().enumerate() {
            progress.check()?;
            let picture = self.scenery.picture(camera);
            let file = out.join(IMAGES).join(image_name(i));
            write_png_rgb(&file, camera.size_px, camera.size_px, &picture)?;
            points.extend(finder.of_image(i, &picture));
            views.push(self.write_maps(out, i)?);
            progress.event(Event::Advanced { done: i as u64 + 1, status: image_name(i) });
        }
        progress.event(Event::Finished);

        progress.event(Event::Started { stage: "writing points and mesh", total: 0 });
        self.write_model(out, &points, &mut views)?;
        let disparities: BTreeMap<_, _> = views.iter().map(|v| (v.name.as_str(), v.disparity)).collect();
        write_json(&out.join(DISPARITIES), &disparities)?;
        write_json(&out.join(MAPS[2]).join(DESCRIPTION), &BTreeMap::from([("kind", "disparity")]))?;
        self.write_lists(out)?;
        let mesh = out.join(MESH);
        self.mesh.write(&mesh)?;
        progress.event(Event::Finished);
        Ok(TestSetSummary {
            views,
            points: points.len(),
            mesh_vertices: self.mesh.vertices.len(),
            mesh_triangles: self.mesh.triangles.len(),
            mesh,
            test_list: self.training.as_ref().map(|_| out.join(TEST_LIST)),
        })
    }

    /// Writes the exact depths and normals of a view, and those of the priors.
    fn write_maps(&self, out: &Path, i: usize) -> Result<TestSetView, SimulateError> {
        let camera = &self.cameras[i];
        let size = camera.size_px;
        let maps = self.exact_maps(camera);
        let rng = self.rng.key(2).key(i as i64);
        let (values, disparity) = priors::disparities(&maps.depths, size, rng.key(1));
        let bent = priors::bent_normals(&maps.normals, size, rng.key(2));
        let known = || maps.depths.iter().copied().filter(|d| d.is_finite()).map(f64::from);
        let depths_m = [known().fold(f64::INFINITY, f64::min), known().fold(0.0, f64::max)];
        let of_depths = vec![size, size];
        let of_normals = vec![size, size, 3];
        let files = [
            (&of_depths, maps.depths),
            (&of_normals, maps.normals),
            (&of_depths, values),
            (&of_normals, bent),
        ];
        for (folder, (shape, values)) in MAPS.iter().zip(files) {
            let array = NpyArray { shape: shape.clone(), values, kind: NumberKind::Float };
            array.write(&out.join(folder).join(format!("{}.npy", view_name(i))))?;
        }
        let is_training = self.training.as_ref().is_none_or(|t| t.contains(&i));
        Ok(TestSetView {
            name: view_name(i),
            role: if is_training { Role::Train } else { Role::Test },
            center: camera.center.to_array(),
            depths_m,
            points: 0,
            disparity,
        })
    }

    /// Casts a ray through the centre of every pixel.
    fn exact_maps(&self, camera: &PinholeCamera) -> ExactMaps {
        let size = camera.size_px;
        let pixel = |k: usize| {
            let along = camera.direction(Pixel::new((k % size) as f64, (k / size) as f64));
            match self.scenery.first_hit(camera.center, along) {
                Some(hit) => (hit.distance as f32, camera.turned(hit.normal).as_vec3().to_array()),
                None => (f32::NAN, [f32::NAN; 3]),
            }
        };
        let pixels: Vec<_> = (0..size * size).into_par_iter().map(pixel).collect();
        ExactMaps {
            depths: pixels.iter().map(|p| p.0).collect(),
            normals: pixels.iter().flat_map(|p| p.1).collect(),
        }
    }

    fn write_model(
        &self,
        out: &Path,
        points: &[FoundPoint],
        views: &mut [TestSetView],
    ) -> Result<(), WriteError> {
        for (i, _) in points.iter().flat_map(|point| &point.seen) {
            views[*i].points += 1;
        }
        let names: Vec<_> = (0..self.cameras.len()).map(image_name).collect();
        colmap::write(&out.join(MODEL), self.cameras, &names, points)
    }

    /// Writes the lists of images to train on and of those that are held back.
    fn write_lists(&self, out: &Path) -> Result<(), WriteError> {
        let Some(training) = &self.training else { return Ok(()) };
        let list = |is_training: bool| -> String {
            let these = (0..self.cameras.len()).filter(|i| training.contains(i) == is_training);
            these.map(|i| image_name(i) + "\n").collect()
        };
        write_file(&out.join(TRAIN_LIST), list(true))?;
        write_file(&out.join(TEST_LIST), list(false))
    }
}

/// Name of the view of a camera.
fn view_name(i: usize) -> String {
    format!("{:04}", i + 1)
}

/// File name of the image of a camera.
fn image_name(i: usize) -> String {
    view_name(i) + ".png"
}
