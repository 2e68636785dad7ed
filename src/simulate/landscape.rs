//! The ground under the satellites, as a height field at a place on Earth.

use super::error::SimulateError;
use super::field::Field;
use super::geodesy::PLACE;
use super::keyed_rng::KeyedRng;
use super::mountains::Mountain;
use super::options::SimulateOptions;
use super::plan::Plan;
use super::summary::SurfaceFigures;
use super::survey::{self, Survey};
use super::terrain::Terrain;
use super::town::Town;
use crate::frame::{Geodetic, Point, SiteGrid};

/// Half the side of a field, as a share of the side of the images: it covers the corners of oblique ones.
const HALF_SIDE: f64 = 0.82;
/// What is added for the parallax of the highest roofs, and for shadows from outside, metres.
const MARGIN_M: f64 = 50.0;

/// The ground of a simulation.
pub(super) struct Landscape {
    pub(super) field: Field,
    /// The plan of the town, if it is one.
    pub(super) plan: Option<Plan>,
    /// Its map; the origin is the centre, at height 0.
    pub(super) grid: SiteGrid,
    /// Longitude, latitude and a typical ellipsoidal height of the centre.
    pub(super) center: Point<Geodetic>,
}

impl Landscape {
    /// The ground that options ask for, and what is known of a user's surface.
    pub(super) fn new(options: &SimulateOptions) -> Result<(Self, Option<SurfaceFigures>), SimulateError> {
        let extent_m = options.size_px as f64 * options.gsd_m;
        let step_m = 0.5 * options.gsd_m;
        let half_m = |margin_m: f64| ((HALF_SIDE * extent_m + margin_m) / step_m).ceil() * step_m;
        let parallax = options.largest_off_nadir_deg().to_radians().tan();
        let made = match &options.terrain {
            Terrain::Town(relief) => {
                let town = Town::new(options.seed, half_m(MARGIN_M), step_m, 0.5 * extent_m, *relief);
                Self::at(PLACE, town.field, Some(town.plan))?
            }
            Terrain::Mountains => {
                let half_m = half_m(MARGIN_M + 0.5 * Mountain::SPAN_M * parallax);
                let field = Mountain::new(options.seed, colors(options.seed)).field(half_m, step_m);
                let (low, high) = field.height_range();
                Self::at(PLACE.at_height(0.5 * (low + high)), field, None)?
            }
            Terrain::Surface(files) => {
                let half_m = |span_m: f64| half_m(MARGIN_M + 0.5 * span_m * parallax);
                let made = survey::read(files, step_m, extent_m, half_m, colors(options.seed))?;
                let Survey { field, grid, center, figures } = made;
                return Ok((Self { field, plan: None, grid, center }, Some(figures)));
            }
        };
        Ok((made, None))
    }

    /// A landscape with the given centre, on the UTM grid.
    pub(super) fn at(
        center: Point<Geodetic>,
        field: Field,
        plan: Option<Plan>,
    ) -> Result<Self, SimulateError> {
        let map = SiteGrid::at(center)?;
        let [e, n, _] = map.origin.xyz();
        let grid = SiteGrid { epsg: map.epsg, origin: Point::new(e.round(), n.round(), 0.0) };
        let center = grid.geodetic_from_utm(grid.origin).at_height(center.height_m());
        Ok(Self { field, plan, grid, center })
    }

    /// Ellipsoidal height of the ground at a place, metres, under buildings and trees if these are known.
    pub(super) fn ground_m(&self, x: f64, y: f64) -> f64 {
        match &self.plan {
            Some(plan) => plan.ground_m(x, y),
            None => self.field.height_m(x, y),
        }
    }
}

/// Address of the colours of a seed.
pub(super) fn colors(seed: u64) -> KeyedRng {
    KeyedRng::new(seed).key(7)
}
