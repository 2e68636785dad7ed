//! `satgs render`: images of a trained run from any direction, under any sun.

use super::{CliError, Ui};
use crate::pipeline::{Colors, Moment, RenderOptions, Viewpoint, render};
use crate::rpc::formats::iso_date;
use crate::scene::days_of;
use std::path::PathBuf;

/// Render images of a trained run from any direction, under any sun
///
/// A .png holds colours. A .tif holds red, green, blue (0 to 1) and the height of the surface in the
/// pixel (m) as float32, with recipe satgs also the share of sunlight (0 to 1); it has the corrected
/// RPC of the view (--like), or a map grid for ground at the height of the site's origin (--view).
/// Angles are degrees, azimuths clockwise from north. With --frames the direction changes evenly to
/// --view-to and the sun to --sun-to, one numbered file per frame:
///
///   satgs render RUN --view 0,30 --view-to 360,30 --frames 90 -o orbit.png
///   satgs render RUN --view 0,0 --sun 95,20 --sun-to 265,20 --frames 60 -o day.png
///
/// A run of recipe satgs has colours for every season, interpolated between those of its views before
/// and after that day of the year, and shadows for every sun:
///
///   satgs render RUN --view 0,0 --date 2015-03-10 -o march.png
///   satgs render RUN --view 0,0 --date 2015-01-01 --date-to 2015-12-31 --frames 6 --strip -o year.png
#[derive(clap::Args, Clone, Debug)]
#[command(verbatim_doc_comment)]
pub struct Args {
    /// Run folder of `satgs train`
    run: PathBuf,
    /// The image (.png or .tif)
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Use the camera, sun and colours of this view of the run
    #[arg(long, value_name = "VIEW", required_unless_present_any = ["view", "visibility"])]
    like: Option<String>,
    /// Write how far other images confirm each pixel of this training view (recipe satgs): 1 where they show the same, lower for
    /// cars and clouds
    #[arg(long, value_name = "VIEW", conflicts_with_all = ["like", "view", "appearance", "date", "sun", "frames", "depth", "normals"])]
    visibility: Option<String>,
    /// Direction from the scene to the camera: azimuth and angle off nadir; colours are those of the reference view (the training
    /// view nearest to nadir with a high sun)
    #[arg(long, value_name = "AZIMUTH,OFF_NADIR", value_parser = direction, conflicts_with = "like")]
    view: Option<[f64; 2]>,
    /// Use the colours of this training view (recipe satgs)
    #[arg(long, value_name = "VIEW", conflicts_with = "date")]
    appearance: Option<String>,
    /// Use the colours of this date, and the sun at its --time (recipe satgs)
    #[arg(long, value_name = "YYYY-MM-DD", value_parser = date)]
    date: Option<f64>,
    /// Date of the last frame
    #[arg(long, value_name = "YYYY-MM-DD", value_parser = date, requires_all = ["date", "frames"])]
    date_to: Option<f64>,
    /// Time of day of --date, UTC [default: the median of the training views]
    #[arg(long, value_name = "HH:MM", value_parser = time, requires = "date")]
    time: Option<f64>,
    /// Time of day of the last frame, UTC
    #[arg(long, value_name = "HH:MM", value_parser = time, requires_all = ["date", "frames"])]
    time_to: Option<f64>,
    /// Position of the sun [default: that of --date, else that of the view with --like, else no shadows]
    #[arg(long, value_name = "AZIMUTH,ELEVATION", value_parser = direction)]
    sun: Option<[f64; 2]>,
    /// Columns and rows [default: the trained area in pixels of the reference view]
    #[arg(long, value_name = "W,H", value_parser = size, conflicts_with = "like")]
    size: Option<(usize, usize)>,
    /// Direction of the camera in the last frame
    #[arg(long, value_name = "AZIMUTH,OFF_NADIR", value_parser = direction, requires_all = ["view", "frames"])]
    view_to: Option<[f64; 2]>,
    /// Position of the sun in the last frame
    #[arg(long, value_name = "AZIMUTH,ELEVATION", value_parser = direction, requires_all = ["sun", "frames"])]
    sun_to: Option<[f64; 2]>,
    /// Write only the depth (.tif, float32, NaN where there is none): the height of the surface, for perspective scenes the
    /// distance along the optical axis
    #[arg(long)]
    depth: bool,
    /// Write the unit normals of flat splats (.tif, float32): bands east, north, up, for perspective scenes x, y, z of the
    /// scene's axes. With --depth the depth follows as a fourth band
    #[arg(long)]
    normals: bool,
    /// Number of frames of an animation: OUT.png becomes OUT_0001.png and so on
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=9999))]
    frames: Option<u32>,
    /// Write the frames side by side into one image (.png)
    #[arg(long, requires = "frames", conflicts_with_all = ["depth", "normals"])]
    strip: bool,
}

fn date(text: &str) -> Result<f64, String> {
    let is_date = text.len() == 10 && iso_date(text).is_some();
    let noon = is_date.then(|| days_of(text)).flatten();
    noon.ok_or_else(|| "expected a date such as 2015-03-10".into())
}

fn time(text: &str) -> Result<f64, String> {
    let parts = text.split_once(':').and_then(|(h, m)| Some((h.parse::<u8>().ok()?, m.parse::<u8>().ok()?)));
    match parts {
        Some((h, m)) if h < 24 && m < 60 => Ok(f64::from(h) + f64::from(m) / 60.0),
        _ => Err("expected hours and minutes, UTC, e.g. 16:05".into()),
    }
}

fn direction(text: &str) -> Result<[f64; 2], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|v| v.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[a, b]) if a.is_finite() && b.is_finite() => Ok([a, b]),
        _ => Err("expected two numbers, degrees, e.g. 150,40".into()),
    }
}

fn size(text: &str) -> Result<(usize, usize), String> {
    let numbers: Option<Vec<usize>> = text.split(',').map(|v| v.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[w, h]) if (16..=20_000).contains(&w) && (16..=20_000).contains(&h) => Ok((w, h)),
        _ => Err("expected columns and rows from 16 to 20000, e.g. 1024,768".into()),
    }
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    let viewpoint = match (&args.like, &args.visibility) {
        (_, Some(view)) => Viewpoint::Visibility(view.clone()),
        (Some(view), None) => Viewpoint::Like(view.clone()),
        (None, None) => Viewpoint::Direction {
            from_deg: args.view.unwrap_or_default(),
            to_deg: args.view_to,
            size: args.size,
        },
    };
    let moment = |noon| Moment { noon, hour: args.time };
    let colors = match (&args.appearance, args.date) {
        (Some(view), _) => Colors::OfView(view.clone()),
        (None, Some(noon)) => {
            let last = Moment { noon: args.date_to.unwrap_or(noon), hour: args.time_to.or(args.time) };
            Colors::At { from: moment(noon), to: Some(last) }
        }
        (None, None) => Colors::OfViewpoint,
    };
    let options = RenderOptions {
        viewpoint,
        colors,
        strip: args.strip,
        sun_deg: args.sun,
        sun_to_deg: args.sun_to,
        frames: args.frames,
        depth: args.depth,
        normals: args.normals,
    };
    let rendered = render(&args.run, &args.output, &options, ui)?;
    let text = format!("{}, images: {}", rendered.output.display(), rendered.frames);
    ui.summary("render", Some(&text), &rendered)
}
