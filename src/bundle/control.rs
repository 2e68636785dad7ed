//! Ground control: surveyed points, their positions in the images, and the standard deviations of both.

use super::correction::{ImageFrame, MOST};
use super::error::BundleError;
use super::network::triangulate;
use super::output::Adjustment;
use super::problem::{Block, Observation, PositionPrior, SIGMA_PX, Track};
use crate::frame::{CenterPx, Geodetic, Pixel, Point};
use crate::io::{read_text, vsi};
use crate::rpc::Rpc;
use crate::scene::{Scene, View};
use crate::stats::median;
use serde::Deserialize;
use std::path::Path;

/// An observation of a surveyed point in an image.
#[derive(Clone, Debug, PartialEq)]
pub struct ControlPoint {
    /// Line of the file, from 1.
    pub line: usize,
    /// Surveyed position.
    pub place: Point<Geodetic>,
    /// The image: name of its file, with or without the extension.
    pub image: String,
    /// Position in the whole image.
    pub px: Pixel<CenterPx>,
    /// Standard deviations of the surveyed position: of east and of north, and of up, metres.
    pub sigma_m: [f64; 2],
    /// Standard deviation of the position in the image, pixels.
    pub sigma_px: f64,
}

impl ControlPoint {
    /// Whether the observation is one of this view's image.
    #[must_use]
    pub fn is_of(&self, view: &View) -> bool {
        let file = vsi::split_query(&view.image).0.file_name();
        view.name == self.image || file.is_some_and(|f| f == &*self.image)
    }
}

/// A line of the file.
#[derive(Deserialize)]
struct Line {
    lon: f64,
    lat: f64,
    h: f64,
    image: String,
    col: f64,
    row: f64,
    sigma_xy_m: f64,
    sigma_h_m: f64,
    sigma_px: f64,
}

/// Separators of columns that are recognised in order to refuse them by name.
const SEPARATORS: [(char, &str); 3] = [(';', "semicolons"), ('\t', "tabs"), (' ', "spaces")];

/// Reads a CSV file with the columns `lon, lat` (degrees, WGS 84), `h` (metres above the ellipsoid), `image`,
/// `col, row` ((0, 0) is the centre of the first pixel), `sigma_xy_m, sigma_h_m` and `sigma_px` (standard deviations).
///
/// A point that is visible in several images has one line for each image.
///
/// # Errors
/// [`BundleError::Control`] names the file, the line and what is wrong with it.
pub fn read_control(path: &Path) -> Result<Vec<ControlPoint>, BundleError> {
    let refused = |reason: String| BundleError::Control { path: path.into(), reason };
    let text = read_text(path).map_err(|e| refused(e.cause.to_string()))?;
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(std::io::Cursor::new(text));
    let head = reader.headers().map_err(|e| refused(e.to_string()))?.clone();
    if let Some((mark, name)) = SEPARATORS.iter().find(|s| head.len() == 1 && head[0].contains(s.0)) {
        return Err(refused(format!(
            "line 1: the columns are separated by {name} (`{mark}`), commas are expected"
        )));
    }
    let mut out = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|e| refused(e.to_string()))?;
        let number = record.position().map_or(0, |p| p.line() as usize);
        let l: Line = record.deserialize(Some(&head)).map_err(|e| refused(format!("line {number}: {e}")))?;
        let wrong = |field: &str, value: f64| refused(format!("line {number}: `{field}` is {value}"));
        for (field, value, limit) in [
            ("lon", l.lon, 360.0),
            ("lat", l.lat, 90.0),
            ("h", l.h, 10_000.0),
            ("col", l.col, 1e7),
            ("row", l.row, 1e7),
        ] {
            // A comparison that NaN fails too.
            let possible = value.abs() <= limit;
            if !possible {
                return Err(wrong(field, value));
            }
        }
        for (field, value) in
            [("sigma_xy_m", l.sigma_xy_m), ("sigma_h_m", l.sigma_h_m), ("sigma_px", l.sigma_px)]
        {
            if !(value.is_finite() && value > 0.0) {
                return Err(wrong(field, value));
            }
        }
        out.push(ControlPoint {
            line: number,
            place: Point::new(l.lon, l.lat, l.h),
            image: l.image,
            px: Pixel::new(l.col, l.row),
            sigma_m: [l.sigma_xy_m, l.sigma_h_m],
            sigma_px: l.sigma_px,
        });
    }
    if out.is_empty() {
        return Err(refused("it holds no point".into()));
    }
    Ok(out)
}

/// Tracks of ground control, for the views with the given names; observations in other views of the scene are left out.
///
/// # Errors
/// [`BundleError::ControlImage`] for an image that is not in the scene.
pub fn tracks_of(
    control: &[ControlPoint],
    scene: &Scene,
    names: &[&str],
    block: &Block,
) -> Result<Vec<Track>, BundleError> {
    let mut tracks: Vec<Track> = Vec::new();
    for c in control {
        let view = scene.views.iter().find(|v| c.is_of(v));
        let view = view.ok_or_else(|| BundleError::ControlImage { image: c.image.clone() })?;
        let Some(index) = names.iter().position(|n| *n == view.name) else { continue };
        let known = PositionPrior {
            place: block.local(c.place),
            sigma_m: [c.sigma_m[0], c.sigma_m[0], c.sigma_m[1]],
        };
        let px = view.px_of_window(c.px);
        let seen = Observation { view: index, px, weight: (SIGMA_PX / c.sigma_px).powi(2) };
        match tracks.iter_mut().find(|t| t.prior == Some(known)) {
            Some(track) => track.observations.push(seen),
            None => tracks.push(Track { observations: vec![seen], prior: Some(known), ..Track::default() }),
        }
    }
    Ok(tracks)
}

/// Pairs of positions of each surveyed point, with the line of the file that names it: as triangulated by the adjusted cameras, and
/// as surveyed. Points with fewer than two observations are left out.
///
/// # Errors
/// [`BundleError::ControlImage`], [`BundleError::NoCamera`].
pub fn control_pairs(
    control: &[ControlPoint],
    scene: &Scene,
    adjustment: &Adjustment,
) -> Result<Vec<ControlPair>, BundleError> {
    let rpcs = adjustment.cameras_of(scene)?;
    pairs_of(control, scene, rpcs.iter().collect())
}

/// As [`control_pairs`], as triangulated by the delivered cameras.
///
/// # Errors
/// [`BundleError::ControlImage`].
pub fn delivered_control_pairs(
    control: &[ControlPoint],
    scene: &Scene,
) -> Result<Vec<ControlPair>, BundleError> {
    pairs_of(control, scene, scene.views.iter().map(|v| &v.rpc).collect())
}

/// The name of a surveyed point in messages, and its positions.
pub type ControlPair = (String, [Point<Geodetic>; 2]);

fn pairs_of(
    control: &[ControlPoint],
    scene: &Scene,
    rpcs: Vec<&Rpc>,
) -> Result<Vec<ControlPair>, BundleError> {
    let Some(first) = control.first() else { return Ok(Vec::new()) };
    let as_they_are = vec![[0.0; MOST]; rpcs.len()];
    let frames = scene.views.iter().map(|v| ImageFrame::new((v.width, v.height))).collect();
    let block = Block::new(rpcs, frames, first.place);
    let names: Vec<&str> = scene.views.iter().map(|v| v.name.as_str()).collect();
    let tracks = tracks_of(control, scene, &names, &block)?;
    let pair = |t: &Track| {
        let place = (t.observations.len() >= 2).then(|| triangulate(&block, t, &as_they_are))??;
        let known = t.prior?;
        let line = control.iter().find(|c| block.local(c.place) == known.place).map_or(0, |c| c.line);
        Some((format!("line {line}"), [block.geodetic(place), block.geodetic(known.place)]))
    };
    Ok(tracks.iter().filter_map(pair).collect())
}

/// Median of the standard deviations that a survey states for its points, metres in space.
#[must_use]
pub fn stated_accuracy_m(control: &[ControlPoint]) -> f64 {
    let in_space = |c: &ControlPoint| (2.0 * c.sigma_m[0].powi(2) + c.sigma_m[1].powi(2)).sqrt();
    median(control.iter().map(in_space).collect()).unwrap_or(0.0)
}
