//! A scene and its views: names, files and geometry; pixels are read when a stage needs them.

use super::{Aoi, TransferFunction};
use crate::frame::{CenterPx, Geodetic, Pixel, Point, half_turn};
use crate::io::Window;
use crate::rpc::Rpc;
use crate::rpc::formats::ViewTags;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Where the sun stood.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sun {
    /// Clockwise from true north, degrees.
    pub azimuth_deg: f64,
    /// Above the horizon, degrees.
    pub elevation_deg: f64,
}

impl Sun {
    /// A sun at these angles in degrees; none if they are no direction.
    #[must_use]
    pub fn new(azimuth_deg: f64, elevation_deg: f64) -> Option<Self> {
        let sound = (-360.0..=360.0).contains(&azimuth_deg) && (-90.0..=90.0).contains(&elevation_deg);
        sound.then_some(Self { azimuth_deg, elevation_deg })
    }
}

/// What a view is used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Adjusted and trained on.
    Train,
    /// Adjusted with the others, never trained on.
    Test,
}

/// One acquisition.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct View {
    /// The image's file name without its extension.
    pub name: String,
    /// The image file.
    pub image: PathBuf,
    /// Columns of the image, or of the window of it that is used.
    pub width: usize,
    /// Rows of the image, or of the window.
    pub height: usize,
    /// The part of the image that is used, if not all of it is; the camera is that part's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub window: Option<Window>,
    /// Bands used, from 1: three for red, green and blue, or one.
    pub bands: Vec<usize>,
    /// Percent of pixels cut off at each end when values are stretched; without it 8 bits are taken as they are and
    /// others lose half a percent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stretch_percent: Option<f64>,
    /// A raster of the image's size: where it is 0 there is no image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask: Option<PathBuf>,
    /// The value of pixels that are no image, when the product's metadata tell one; what the image file itself declares
    /// comes first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nodata: Option<f64>,
    /// The camera.
    pub rpc: Rpc,
    /// Where the RPC was read from, as a user would name it: `RPC tag`, or a file.
    pub rpc_source: String,
    /// The sun, when known.
    pub sun: Option<Sun>,
    /// Acquisition time as ISO 8601 `YYYY-MM-DDThh:mm:ssZ`, when known.
    pub acquired: Option<String>,
    /// Training or test.
    pub role: Role,
    /// Lowest and highest ellipsoidal height to search, when the view's metadata tells.
    pub height_range: Option<(f64, f64)>,
}

/// All views of one place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scene {
    /// The views, ordered by name.
    pub views: Vec<View>,
    /// The area of interest, when one was given; images are cropped to it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub aoi: Option<Aoi>,
    /// Relation between the images' pixel values and linear radiance.
    #[serde(default, skip_serializing_if = "TransferFunction::is_linear")]
    pub transfer_function: TransferFunction,
    /// What was odd when the scene was read, one sentence a cause.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}

/// Angle in degrees between two directions given as (azimuth, angle from the zenith), degrees.
#[must_use]
pub fn angle_between_deg(a: (f64, f64), b: (f64, f64)) -> f64 {
    let unit = |(azimuth, zenith): (f64, f64)| {
        let (azimuth, zenith) = (azimuth.to_radians(), zenith.to_radians());
        [zenith.sin() * azimuth.sin(), zenith.sin() * azimuth.cos(), zenith.cos()]
    };
    let (a, b) = (unit(a), unit(b));
    let dot: f64 = a.iter().zip(b).map(|(x, y)| x * y).sum();
    let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    cross.iter().map(|c| c * c).sum::<f64>().sqrt().atan2(dot).to_degrees()
}

impl Scene {
    /// Views that may be trained on.
    pub fn training(&self) -> impl Iterator<Item = &View> {
        self.views.iter().filter(|v| v.role == Role::Train)
    }

    /// Heights between which matching searches: the widest of what the views' metadata tell, else what the
    /// views' RPCs have in common.
    #[must_use]
    pub fn height_range(&self) -> (f64, f64) {
        let told = self.views.iter().filter_map(|v| v.height_range);
        let wide = told.fold(None, |acc: Option<(f64, f64)>, (lo, hi)| {
            Some(acc.map_or((lo, hi), |(a, b)| (a.min(lo), b.max(hi))))
        });
        wide.unwrap_or_else(|| {
            let ranges = self.views.iter().map(|v| v.rpc.height_range());
            ranges.fold((f64::NEG_INFINITY, f64::INFINITY), |a, b| (a.0.max(b.0), a.1.min(b.1)))
        })
    }

    /// Mean of the cameras' views of their image centres at the middle of the height range.
    #[must_use]
    pub fn center(&self) -> Option<Point<Geodetic>> {
        let (lo, hi) = self.height_range();
        let h = 0.5 * (lo + hi);
        let seen: Vec<[f64; 3]> =
            self.views.iter().filter_map(|v| v.ground_center(h)).map(Point::xyz).collect();
        let [first_lon, ..] = *seen.first()?;
        let n = seen.len() as f64;
        // Longitudes count from the first one: on either side of the antimeridian they are nearly a turn apart.
        let east = seen.iter().map(|p| half_turn(p[0] - first_lon)).sum::<f64>() / n;
        Some(Point::new(first_lon + east, seen.iter().map(|p| p[1]).sum::<f64>() / n, h))
    }
}

impl View {
    /// The camera of the whole image, from one of the window that is used.
    #[must_use]
    pub fn camera_of_whole(&self, of_window: &Rpc) -> Rpc {
        self.window.map_or_else(|| of_window.clone(), |w| of_window.shifted(w.col as f64, w.row as f64))
    }

    /// The camera of the window that is used, from one of the whole image.
    #[must_use]
    pub fn camera_of_window(&self, of_whole: &Rpc) -> Rpc {
        self.window.map_or_else(|| of_whole.clone(), |w| of_whole.cropped(w.col, w.row))
    }

    /// Where the whole image has a pixel of the window that is used.
    #[must_use]
    pub fn px_of_whole(&self, px: Pixel<CenterPx>) -> Pixel<CenterPx> {
        self.window.map_or(px, |w| Pixel::new(px.col + w.col as f64, px.row + w.row as f64))
    }

    /// Where the window that is used has a pixel of the whole image.
    #[must_use]
    pub fn px_of_window(&self, px: Pixel<CenterPx>) -> Pixel<CenterPx> {
        self.window.map_or(px, |w| Pixel::new(px.col - w.col as f64, px.row - w.row as f64))
    }

    /// What a file with the whole image's camera says beside it.
    #[must_use]
    pub fn tags(&self) -> ViewTags {
        ViewTags {
            image: self.image.file_name().map(|n| n.to_string_lossy().into_owned()),
            size: self.window.is_none().then_some((self.width, self.height)),
            sun_deg: self.sun.map(|s| (s.azimuth_deg, s.elevation_deg)),
            acquired: self.acquired.clone(),
            height_range: self.height_range,
            ..ViewTags::default()
        }
    }

    /// The ground point seen at the image's centre at a height, if the camera has one.
    #[must_use]
    pub fn ground_center(&self, height_m: f64) -> Option<Point<Geodetic>> {
        let center = Pixel::new(0.5 * (self.width as f64 - 1.0), 0.5 * (self.height as f64 - 1.0));
        self.rpc.localize(center, height_m).ok()
    }

    /// The image's four outer corners on the ground at a height, in order around it.
    #[must_use]
    pub fn footprint(&self, height_m: f64) -> Option<[Point<Geodetic>; 4]> {
        use crate::frame::CornerPx;
        let (w, h) = (self.width as f64, self.height as f64);
        let mut corners = [self.rpc.center(); 4];
        for (corner, (col, row)) in corners.iter_mut().zip([(0.0, 0.0), (w, 0.0), (w, h), (0.0, h)]) {
            *corner = self.rpc.localize(Pixel::<CornerPx>::new(col, row).into(), height_m).ok()?;
        }
        Some(corners)
    }

    /// Direction from the ground to the satellite: (azimuth clockwise from north, off-nadir), degrees.
    #[must_use]
    pub fn direction_deg(&self, height_m: f64) -> Option<(f64, f64)> {
        const RISE_M: f64 = 100.0;
        let low = self.ground_center(height_m)?;
        let px = self.rpc.project(low);
        let high = self.rpc.localize_from(px, low.at_height(height_m + RISE_M)).ok()?;
        let grid = crate::frame::SiteGrid::at(low).ok()?;
        let d = grid.site_from_geodetic(high).xyz();
        let azimuth = d[0].atan2(d[1]).to_degrees() + grid.convergence_deg();
        Some((azimuth.rem_euclid(360.0), d[0].hypot(d[1]).atan2(d[2]).to_degrees()))
    }

    /// Size of a pixel on the ground at the image's centre, along a row and along a column, metres.
    #[must_use]
    pub fn gsd_m(&self, height_m: f64) -> Option<(f64, f64)> {
        let center = self.ground_center(height_m)?;
        let grid = crate::frame::SiteGrid::at(center).ok()?;
        let px = self.rpc.project(center);
        let length = |d_col: f64, d_row: f64| {
            let next = self.rpc.localize_from(Pixel::new(px.col + d_col, px.row + d_row), center).ok()?;
            let d = grid.site_from_geodetic(next).xyz();
            Some(d[0].hypot(d[1]))
        };
        Some((length(1.0, 0.0)?, length(0.0, 1.0)?))
    }
}
