//! A scene and its views: names, files and geometry. Pixels are read when they are needed.

use super::files::file_name;
use super::{Aoi, HeightSource, SearchedHeights, TransferFunction};
use crate::frame::{CenterPx, Geodetic, Pixel, Point, wrap_longitude_deg};
use crate::io::Window;
use crate::rpc::Rpc;
use crate::rpc::formats::ViewTags;
use crate::stats::bounds;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Direction to the sun at the time of acquisition.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sun {
    /// Azimuth, clockwise from true north, degrees.
    pub azimuth_deg: f64,
    /// Elevation above the horizon, degrees.
    pub elevation_deg: f64,
}

impl Sun {
    /// The sun at an azimuth and an elevation in degrees; `None` if they are outside of their ranges.
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
    /// The view is adjusted and trained on.
    Train,
    /// The view is adjusted with the others, but not trained on.
    Test,
}

/// One image with its camera and metadata.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct View {
    /// File name of the image without its extension.
    pub name: String,
    /// The image file.
    pub image: PathBuf,
    /// Number of columns of the image, or of its used window.
    pub width: usize,
    /// Number of rows of the image, or of its used window.
    pub height: usize,
    /// The window of the image that is used, if not all of it is; the camera is that of the window.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub window: Option<Window>,
    /// Selected bands, counted from 1: three for red, green and blue, or one.
    pub bands: Vec<usize>,
    /// Percentage of pixels to clip at each end of the histogram. By default 8-bit values are not
    /// stretched, and half a percent of others is clipped.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stretch_percent: Option<f64>,
    /// The stored values that become 0 and 1, where all parts of an image must be stretched alike; by default they are
    /// determined from the pixels that are read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stretch: Option<[f32; 2]>,
    /// Raster of the size of the image, 0 at pixels that are not valid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask: Option<PathBuf>,
    /// Nodata value in the metadata of the product; one that the image file declares has precedence.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nodata: Option<f64>,
    /// The camera of the used window.
    pub rpc: Rpc,
    /// Where the RPC was found, for messages: a file name, `RPC tag`.
    pub rpc_source: String,
    /// Direction to the sun, if known.
    pub sun: Option<Sun>,
    /// Acquisition time in UTC, `YYYY-MM-DDThh:mm:ssZ` or `YYYY-MM-DD`, if known.
    pub acquired: Option<String>,
    /// Whether the view is trained on.
    pub role: Role,
    /// Lowest and highest ellipsoidal height on the ground in metres, if the metadata of the view state them.
    pub height_range: Option<(f64, f64)>,
}

/// Views of one place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scene {
    /// The views, ordered by name.
    pub views: Vec<View>,
    /// The area of interest to which images are cropped, if one was given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub aoi: Option<Aoi>,
    /// The heights to search, if an option or an elevation model gives them; [`Scene::heights`] returns those that are used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heights: Option<SearchedHeights>,
    /// Relation between the images' pixel values and linear radiance.
    #[serde(default, skip_serializing_if = "TransferFunction::is_linear")]
    pub transfer_function: TransferFunction,
    /// Warnings of the reader, one sentence each.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}

/// Angle in degrees between two directions, each given as (azimuth, angle from the zenith) in degrees.
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
    /// The heights to search: those of an option or an elevation model; else the union of the ranges in the metadata of the
    /// views; else the intersection of the ranges of their RPCs.
    #[must_use]
    pub fn heights(&self) -> SearchedHeights {
        if let Some(stated) = self.heights {
            return stated;
        }
        let of_metadata = self.views.iter().filter_map(|v| v.height_range);
        if let Some((low_m, high_m)) = of_metadata.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))) {
            return SearchedHeights { low_m, high_m, source: HeightSource::Metadata };
        }
        let of_rpcs = self.views.iter().map(|v| v.rpc.height_range());
        let everything = (f64::NEG_INFINITY, f64::INFINITY);
        let (low_m, high_m) = of_rpcs.fold(everything, |a, b| (a.0.max(b.0), a.1.min(b.1)));
        SearchedHeights { low_m, high_m, source: HeightSource::Rpcs }
    }

    /// [`SearchedHeights::with_tie_points`] of [`Scene::heights`], with the heights of the tie points.
    #[must_use]
    pub fn heights_with(&self, tie_points: impl Iterator<Item = f64>) -> SearchedHeights {
        let heights = self.heights();
        bounds(tie_points).map_or(heights, |found| heights.with_tie_points(found))
    }

    /// Lowest and highest of [`Scene::heights`], metres.
    #[must_use]
    pub fn height_range(&self) -> (f64, f64) {
        self.heights().range()
    }

    /// Views that may be trained on.
    pub fn training(&self) -> impl Iterator<Item = &View> {
        self.views.iter().filter(|v| v.role == Role::Train)
    }

    /// Mean of the ground points at the image centres, at the middle of the height range; `None` if there are none.
    #[must_use]
    pub fn center(&self) -> Option<Point<Geodetic>> {
        let (lo, hi) = self.height_range();
        let h = 0.5 * (lo + hi);
        let seen: Vec<[f64; 3]> =
            self.views.iter().filter_map(|v| v.ground_center(h)).map(Point::xyz).collect();
        let [first_lon, ..] = *seen.first()?;
        let n = seen.len() as f64;
        // Longitudes are averaged as differences from the first one, because the scene may cross the antimeridian.
        let east = seen.iter().map(|p| wrap_longitude_deg(p[0] - first_lon)).sum::<f64>() / n;
        Some(Point::new(first_lon + east, seen.iter().map(|p| p[1]).sum::<f64>() / n, h))
    }
}

impl View {
    /// The camera of the whole image, given that of the used window.
    #[must_use]
    pub fn camera_of_whole(&self, of_window: &Rpc) -> Rpc {
        self.window.map_or_else(|| of_window.clone(), |w| of_window.shifted(w.col as f64, w.row as f64))
    }

    /// The camera of the used window, given that of the whole image.
    #[must_use]
    pub fn camera_of_window(&self, of_whole: &Rpc) -> Rpc {
        self.window.map_or_else(|| of_whole.clone(), |w| of_whole.cropped(w.col, w.row))
    }

    /// Position in the whole image of a position in the used window.
    #[must_use]
    pub fn px_of_whole(&self, px: Pixel<CenterPx>) -> Pixel<CenterPx> {
        self.window.map_or(px, |w| Pixel::new(px.col + w.col as f64, px.row + w.row as f64))
    }

    /// Position in the used window of a position in the whole image.
    #[must_use]
    pub fn px_of_window(&self, px: Pixel<CenterPx>) -> Pixel<CenterPx> {
        self.window.map_or(px, |w| Pixel::new(px.col - w.col as f64, px.row - w.row as f64))
    }

    /// Metadata of the whole image, to be written beside its camera.
    #[must_use]
    pub fn tags(&self) -> ViewTags {
        ViewTags {
            image: Some(file_name(&self.image)).filter(|name| !name.is_empty()),
            size: self.window.is_none().then_some((self.width, self.height)),
            sun_deg: self.sun.map(|s| (s.azimuth_deg, s.elevation_deg)),
            acquired: self.acquired.clone(),
            height_range: self.height_range,
            ..ViewTags::default()
        }
    }

    /// The ground point at the centre of the image at an ellipsoidal height in metres; `None` if it cannot be localised.
    #[must_use]
    pub fn ground_center(&self, height_m: f64) -> Option<Point<Geodetic>> {
        let center = Pixel::new(0.5 * (self.width as f64 - 1.0), 0.5 * (self.height as f64 - 1.0));
        self.rpc.localize(center, height_m).ok()
    }

    /// The ground points of the four outer corners of the image at an ellipsoidal height in metres, in order around the
    /// image; `None` if one cannot be localised.
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

    /// Direction from the ground to the satellite at the image centre and an ellipsoidal height in metres: azimuth clockwise
    /// from true north and off-nadir angle (incidence at the ground), degrees.
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

    /// Ground sampling distance at the image centre and an ellipsoidal height in metres: along a row and along a column,
    /// metres per pixel.
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
