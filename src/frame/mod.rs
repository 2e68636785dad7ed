//! Coordinate frames that cannot be mixed, and the transforms between them.
//!
//! A frame is a zero-sized marker ([`Geodetic`], [`Utm`], [`Site`], [`Ecef`], [`CenterPx`], [`CornerPx`]). A conversion
//! that needs a value (a zone, an origin) is a method of that value, named `target_from_source`.

mod crs;
mod geoid;
mod level;
mod point;
mod proj_log;
mod site;

pub use crs::{FrameError, Transform, map_step, metres_of_unit, utm_epsg, utm_of_map, wrap_longitude_deg};
pub use geoid::GeoidGrid;
pub use level::LevelFrame;
pub use point::{CenterPx, CornerPx, Ecef, Frame, Geodetic, Pixel, Point, Site, Utm, Vector};
pub use site::{SiteBox, SiteGrid};
