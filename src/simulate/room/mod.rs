//! A room of 4 x 5 x 2.5 m as a test set: two of its walls have no texture.
//!
//! The room is made of planes, boxes and a sphere, so that depths, normals and the mesh are exact. Light is diffuse and does
//! not depend on the direction of view. The origin is the middle of the floor; x points to the east wall, y to the north
//! wall, z upwards.

mod cameras;
mod mesh;
mod options;
mod shape;
mod shading;
mod texture;

pub use options::RoomOptions;

use super::error::SimulateError;
use super::folder;
use super::keyed_rng::KeyedRng;
use super::perspective::{Hit, PinholeCamera, PointRules, Scenery, TestSet, TestSetSummary, write_frames};
use crate::frame::Pixel;
use crate::progress::{Event, Progress};
use glam::DVec3;
use rayon::prelude::*;
use shading::Shading;
use std::path::Path;

/// Number of rays per pixel along each side.
const RAYS: usize = 2;
/// Number and errors of the points: structure from motion in a room finds a few thousand, to some millimetres.
const POINTS: PointRules = PointRules { count: 3000, error_m: 0.003, hidden_from_m: 0.002 };

/// Simulates a room and writes it to the folder `out` as a perspective scene with its truth: images in `images/`, a COLMAP
/// model in `sparse/0/`, exact depths, normals and mesh in `truth/`, depths and normals with smooth errors in `priors/`.
///
/// The same options give the same bytes for any number of threads.
///
/// # Errors
/// [`SimulateError`] if an option is outside of its range, the folder is not empty, a file cannot be written, or
/// `progress` asks to stop.
pub fn simulate_room(
    out: &Path,
    options: &RoomOptions,
    progress: &dyn Progress,
) -> Result<TestSetSummary, SimulateError> {
    options.check()?;
    folder::prepare(out, options.overwrite)?;
    let rng = KeyedRng::new(options.seed).key(3000);
    progress.event(Event::Started { stage: "building the room", total: 0 });
    let room = Room { shading: Shading::new(rng.key(1)) };
    let cameras = cameras::around(options.views, options.size_px, rng.key(2));
    let mesh = mesh::of_room(&room.shading);
    progress.event(Event::Finished);
    let set = TestSet {
        scenery: &room,
        cameras: &cameras,
        rules: POINTS,
        training: None,
        mesh: &mesh,
        rng: rng.key(3),
    };
    if let Some(stated) = options.frames {
        let cameras = cameras::walk(options.views, options.size_px);
        write_frames(out, &room, &cameras, stated, progress)?;
    }
    set.write(out, progress)
}

/// The room with its colours.
struct Room {
    shading: Shading,
}

impl Scenery for Room {
    fn first_hit(&self, from: DVec3, along: DVec3) -> Option<Hit> {
        let contact = shape::first_contact(from, along);
        let shape::Contact { distance, normal, part } = contact;
        Some(Hit { distance, normal, is_textured: part.is_textured() })
    }

    fn picture(&self, camera: &PinholeCamera) -> Vec<u8> {
        let size = camera.size_px;
        let inside = |i: usize| (i as f64 + 0.5) / RAYS as f64 - 0.5;
        let pixel = |k: usize| {
            let (col, row) = ((k % size) as f64, (k / size) as f64);
            let rays = (0..RAYS * RAYS).map(|s| {
                let along = camera.direction(Pixel::new(col + inside(s % RAYS), row + inside(s / RAYS)));
                let contact = shape::first_contact(camera.center, along);
                self.shading.radiance(contact.part, camera.center + along * contact.distance, contact.normal)
            });
            shading::displayed(rays.sum::<DVec3>() / (RAYS * RAYS) as f64)
        };
        let pixels: Vec<[u8; 3]> = (0..size * size).into_par_iter().map(pixel).collect();
        pixels.into_flattened()
    }
}

#[cfg(test)]
mod tests;
