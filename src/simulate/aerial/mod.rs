//! The simulated town as photographs from the air: a test set of perspective views with few to train on.
//!
//! Rays of pinhole cameras are cast onto the height field of the satellite images, with its colours, sun and shadows. The
//! world is a map in metres whose origin is the centre of the town; z is the ellipsoidal height minus [`DATUM_M`].

mod cameras;
mod mesh;
mod options;

pub use options::AerialOptions;

use super::calendar::Calendar;
use super::error::SimulateError;
use super::field::{Field, Material, Place};
use super::folder;
use super::geodesy::{PLACE, sun_on_map};
use super::keyed_rng::KeyedRng;
use super::options::BitDepth;
use super::perspective::{Hit, PinholeCamera, PointRules, Scenery, TestSet, TestSetSummary};
use super::radiometry::Radiometry;
use super::rays::Sight;
use super::render::Shot;
use super::season::Palette;
use super::surface::Surface;
use super::town::Town;
use crate::frame::{CenterPx, Pixel, SiteGrid};
use crate::progress::{Event, Progress};
use glam::DVec3;
use std::path::Path;

/// Ellipsoidal height of the world's z = 0, metres.
const DATUM_M: f64 = PLACE.height_m();
/// Number and errors of the points: so few that structure from motion nearly failed.
const POINTS: PointRules = PointRules { count: 300, error_m: 0.3, hidden_from_m: 0.05 };
/// Half the side of the town, metres: oblique images and shadows that fall into them end within it.
const HALF_TOWN_M: f64 = 340.0;
/// Pond and tower lie within this distance of the centre along both axes, metres.
const HALF_CORE_M: f64 = 100.0;
/// Finest and coarsest distance between nodes of the height field, metres.
const STEPS_M: (f64, f64) = (0.25, 1.0);
/// The day on which all images are taken: in spring, with the sun about 50 degrees high.
const DAY_OF_YEAR: u32 = 110;

/// Simulates photographs of the town from 600 m above ground, and writes them to the folder `out` as a perspective scene
/// with its truth: as [`simulate_room`](super::simulate_room), and `train.txt` and `test.txt`, lists of three images to train
/// on and of all others.
///
/// The same options give the same bytes for any number of threads.
///
/// # Errors
/// [`SimulateError`] if an option is outside of its range, the folder is not empty, a file cannot be written, or
/// `progress` asks to stop.
pub fn simulate_aerial(
    out: &Path,
    options: &AerialOptions,
    progress: &dyn Progress,
) -> Result<TestSetSummary, SimulateError> {
    options.check()?;
    folder::prepare(out, options.overwrite)?;
    let rng = KeyedRng::new(options.seed);
    progress.event(Event::Started { stage: "building the town", total: 0 });
    let scene = TownFromAbove::new(options)?;
    let ground = DVec3::new(0.0, 0.0, scene.town.plan.ground_m(0.0, 0.0) - DATUM_M);
    let cameras = cameras::above(ground, options.views, options.size_px, rng.key(4000));
    let mesh = mesh::of_field(&scene.town.field, |place| scene.color(place));
    progress.event(Event::Finished);
    let set = TestSet {
        scenery: &scene,
        cameras: &cameras,
        rules: POINTS,
        training: Some(cameras::spread(&cameras)),
        mesh: &mesh,
        rng: rng.key(4001),
    };
    set.write(out, progress)
}

/// The town on the day of the images.
struct TownFromAbove {
    town: Town,
    palette: Palette,
    radiometry: Radiometry,
    colors: KeyedRng,
    /// Address of the waves on the water, which are the same in all images.
    waves: KeyedRng,
}

impl TownFromAbove {
    fn new(options: &AerialOptions) -> Result<Self, SimulateError> {
        let rng = KeyedRng::new(options.seed);
        let wanted_m = 0.5 * cameras::FOOTPRINT_M / options.size_px as f64;
        // The sides of the town are a whole number of steps.
        let step_m = 1.0 / (1.0 / wanted_m.clamp(STEPS_M.0, STEPS_M.1)).round();
        let town = Town::new(options.seed, HALF_TOWN_M, step_m, HALF_CORE_M, options.relief);
        let colors = rng.key(7);
        let moment = Calendar::Mild.moment(0, DAY_OF_YEAR, rng.key(4002), PLACE);
        let sun = sun_on_map(&SiteGrid::at(PLACE)?, PLACE, moment.sun);
        Ok(Self {
            town,
            palette: Palette::mild(moment.day_of_year, colors),
            radiometry: Radiometry::new(rng.key(4003), sun, BitDepth::Eight).without_noise(),
            colors,
            waves: rng.key(4004),
        })
    }

    fn shot<'a>(&'a self, sight: &'a dyn Sight, size_px: usize) -> Shot<'a> {
        Shot {
            field: &self.town.field,
            rays: sight,
            cars: None,
            palette: &self.palette,
            radiometry: &self.radiometry,
            colors: self.colors,
            grain: self.waves,
            size_px,
        }
    }

    /// The colour in the images of a place of the height field.
    fn color(&self, place: Place) -> [u8; 3] {
        self.shot(&Blind, 0).color(&Surface::at(&self.town.field, place, self.colors))
    }
}

/// The sight of an image without pixels.
struct Blind;

impl Sight for Blind {
    fn first_hit(&self, _: &Field, _: Pixel<CenterPx>) -> Option<Place> {
        None
    }
}

impl Sight for PinholeCamera {
    fn first_hit(&self, field: &Field, px: Pixel<CenterPx>) -> Option<Place> {
        first_place(field, self.center, self.direction(px))
    }
}

/// Where a descending ray of the world meets the height field: a place of the field, with its ellipsoidal height.
fn first_place(field: &Field, from: DVec3, along: DVec3) -> Option<Place> {
    /// Halvings of the interval in which the ray meets the surface.
    const HALVINGS: usize = 26;
    /// Largest interval that [`Field::first_hit`] leaves, as a share of the ray.
    const INTERVAL: f64 = 1.0 / 16_384.0;
    let from = from.with_z(from.z + DATUM_M);
    let (low, high) = field.height_range();
    let at_height = |height: f64| (height - from.z) / along.z;
    let (start, end) = (at_height(high + 1.0), at_height(low - 1.0));
    if along.z >= 0.0 || start < 0.0 {
        return None;
    }
    let path = |t: f64| (from + along * (start + t * (end - start))).to_array();
    let found = field.first_hit(path)?;
    let is_above = |t: f64| {
        let [x, y, z] = path(t);
        z > field.height_m(x, y)
    };
    let mut below = (at_height(found[2]) - start) / (end - start);
    let mut above = below - INTERVAL;
    // Where a wall begins behind a cell that the ray leapt over, the place may be inside of it: the ray is followed back.
    let run_m = (end - start) * along.x.hypot(along.y);
    let back = (0.25 * field.step_m() / run_m.max(1e-6)).clamp(INTERVAL, 1.0);
    while !is_above(above) && above > 0.0 {
        below = above;
        above -= back;
    }
    for _ in 0..HALVINGS {
        let middle = 0.5 * (above + below);
        if is_above(middle) { above = middle } else { below = middle }
    }
    Some(path(below))
}

impl Scenery for TownFromAbove {
    fn first_hit(&self, from: DVec3, along: DVec3) -> Option<Hit> {
        /// Steps back along the ray to the cell in which it meets the surface: the place may lie on the border of the next one.
        const BACK_M: [f64; 3] = [0.0, 1e-4, 1e-2];
        let field = &self.town.field;
        let place = first_place(field, from, along)?;
        let at = DVec3::from_array(place).with_z(place[2] - DATUM_M);
        let surface = |back_m: f64| {
            let [x, y, _] = (at - along * back_m).to_array();
            Surface::at(field, [x, y, place[2]], self.colors)
        };
        let normal = |surface: &Surface| DVec3::from_array(surface.normal);
        let surfaces = BACK_M.map(surface);
        let facing = surfaces.iter().find(|s| normal(s).dot(along) < 0.0);
        let surface = facing.unwrap_or(&surfaces[0]);
        let distance = (at.z - from.z) / along.z;
        let is_textured = surface.material != Material::Water;
        Some(Hit { distance, normal: normal(surface), is_textured })
    }

    fn picture(&self, camera: &PinholeCamera) -> Vec<u8> {
        self.shot(camera, camera.size_px).picture().clean
    }
}

#[cfg(test)]
mod tests;
