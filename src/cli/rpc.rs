//! `satgs rpc`: points through a camera, cameras between formats, two cameras against each other.

use super::{CliError, Ui};
use crate::affine::{GroundBox, Order, residual};
use crate::frame::{Pixel, Point};
use crate::io::{write_file, write_with_rpc};
use crate::progress::{Event, Progress};
use crate::rpc::formats::{RpcFile, to_gdal, to_json, to_rpb, to_text};
use crate::rpc::{Difference, GroundBatch, PixelBatch, Rpc};
use crate::scene::read_camera;
use serde_json::{Value, json};
use std::fmt::Write;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Work with RPC cameras: project and localise points, convert formats, compare two cameras, fit affine and quadratic cameras
///
/// FILE is an RPC file of any format that satgs reads (`_RPC.TXT`, Maxar .RPB and .XML, DIMAP, OSSIM .geom, rpcm JSON,
/// GDAL .aux.xml) or an image with its RPC inside or beside it. Pixel 0 0 is the centre of the first pixel, heights
/// are metres above the WGS 84 ellipsoid, longitudes and latitudes degrees.
#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    task: Task,
    /// Use the first RPC found for an image even if it seems to belong to another image
    #[arg(long, global = true)]
    trust_rpc: bool,
}

#[derive(clap::Subcommand)]
enum Task {
    /// Project ground points into the image: `lon lat h` to `col row`
    #[command(after_help = "\
Example, a point given and points from standard input:
  satgs rpc project img_RPC.TXT 5.4401,43.2603,120
  satgs rpc project img_RPC.TXT -- -81.6637,30.3487,-20
  echo '5.4401 43.2603 120' | satgs rpc project img_RPC.TXT")]
    Project(Points),
    /// Localise pixels on the ground at a height: `col row h` to `lon lat`
    #[command(after_help = "\
Example, the ground under an image's first pixel at 120 m:
  satgs rpc localize img.tif 0,0,120")]
    Localize(Points),
    /// Convert a camera to another format, with 17 significant digits
    #[command(after_help = "\
The ending of OUT sets the format: .txt (_RPC.TXT), .rpb, .json (rpcm), .tif (a copy of --image with
the RPC tag).
Example:
  satgs rpc convert RPC_PHR1A.XML img_RPC.TXT")]
    Convert(Convert),
    /// Compare two cameras over the volume of the first: RMS and maximum distance, pixels
    Compare(Compare),
    /// Fit affine and quadratic cameras to an RPC over a box, and show their distance to it, pixels
    Fit(Fit),
}

#[derive(clap::Args)]
struct Points {
    /// RPC file or image
    file: PathBuf,
    /// Points of three numbers each, separated by commas or blanks; after `--` if one begins with a minus [default: read
    /// from standard input]
    points: Vec<String>,
}

#[derive(clap::Args)]
struct Convert {
    /// RPC file or image
    file: PathBuf,
    /// The file to write
    out: PathBuf,
    /// Image to copy when OUT is a .tif
    #[arg(long)]
    image: Option<PathBuf>,
    /// Replace OUT if it exists
    #[arg(long)]
    overwrite: bool,
}

#[derive(clap::Args)]
struct Compare {
    /// RPC file or image, whose volume is used
    first: PathBuf,
    /// RPC file or image
    second: PathBuf,
}

#[derive(clap::Args)]
struct Fit {
    /// RPC file or image
    file: PathBuf,
    /// Side of the box on the ground, metres
    #[arg(long, default_value_t = 256.0, value_name = "METRES")]
    size: f64,
    /// The box reaches this far above and below its centre, metres
    #[arg(long, default_value_t = 20.0, value_name = "METRES")]
    heights: f64,
    /// Centre of the box [default: the centre of the RPC's volume]
    #[arg(long, value_name = "LON,LAT,H", allow_hyphen_values = true)]
    at: Option<String>,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    let load = |path: &Path| load(path, args.trust_rpc, ui);
    match &args.task {
        Task::Project(points) => project(points, &load(&points.file)?.rpc, ui),
        Task::Localize(points) => localize(points, &load(&points.file)?.rpc, ui),
        Task::Convert(convert) => write(convert, &load(&convert.file)?, ui),
        Task::Compare(two) => compare(two, &load(&two.first)?.rpc, &load(&two.second)?.rpc, ui),
        Task::Fit(fit) => approximate(fit, &load(&fit.file)?.rpc, ui),
    }
}

fn load(path: &Path, trust_rpc: bool, ui: &Ui) -> Result<RpcFile, CliError> {
    let file = read_camera(path, trust_rpc)?;
    for warning in &file.warnings {
        ui.event(Event::Warning(warning.clone()));
    }
    Ok(file)
}

fn project(args: &Points, rpc: &Rpc, ui: &Ui) -> Result<(), CliError> {
    let [lon_deg, lat_deg, height_m] = args.read()?;
    let ground = GroundBatch { lon_deg, lat_deg, height_m };
    let mut seen = PixelBatch::default();
    rpc.project_batch(&ground, &mut seen);
    let beyond = outside_volume(rpc, &ground, ui);
    let mut text = String::new();
    for (col, row) in seen.col.iter().zip(&seen.row) {
        let _ = writeln!(text, "{col:.9} {row:.9}");
    }
    ui.summary(
        "rpc project",
        Some(&text),
        &json!({ "col": seen.col, "row": seen.row, "outside_volume": beyond }),
    )
}

/// Number of points outside the volume for which the RPC was made, and a warning if there are any.
fn outside_volume(rpc: &Rpc, ground: &GroundBatch, ui: &Ui) -> usize {
    let all = ground.lon_deg.len();
    let is_outside = |i: &usize| {
        let place = Point::new(ground.lon_deg[*i], ground.lat_deg[*i], ground.height_m[*i]);
        place.is_finite() && !rpc.is_valid_at(place)
    };
    let beyond = (0..all).filter(is_outside).count();
    if beyond > 0 {
        let text = format!("{beyond} of {all} points are outside the volume for which the RPC was made");
        ui.event(Event::Warning(text));
    }
    beyond
}

fn localize(args: &Points, rpc: &Rpc, ui: &Ui) -> Result<(), CliError> {
    let [col, row, height] = args.read()?;
    let pixels = PixelBatch { col, row };
    let mut ground = GroundBatch::default();
    rpc.localize_batch(&pixels, &height, &mut ground);
    ground.height_m.clone_from(&height);
    let beyond = outside_volume(rpc, &ground, ui);
    let mut text = String::new();
    for (lon, lat) in ground.lon_deg.iter().zip(&ground.lat_deg) {
        let _ = writeln!(text, "{lon:.13} {lat:.13}");
    }
    let lost: Vec<usize> = (0..height.len()).filter(|i| ground.lon_deg[*i].is_nan()).collect();
    let (lon, lat) = (&ground.lon_deg, &ground.lat_deg);
    let summary = json!({ "lon": lon, "lat": lat, "outside_volume": beyond, "not_seen": lost.len() });
    ui.summary("rpc localize", Some(&text), &summary)?;
    let Some(first) = lost.first() else { return Ok(()) };
    let why = rpc.localize(Pixel::new(pixels.col[*first], pixels.row[*first]), height[*first]);
    let why = why.err().map_or_else(String::new, |e| e.to_string());
    Err(CliError::partial(
        format!("{} of {} points cannot be localised; point {}: {why}", lost.len(), height.len(), first + 1),
        "their lines are NaN; pixels far outside the image and heights far outside the RPC's range cannot be localised",
    ))
}

impl Points {
    /// The three columns of the points.
    fn read(&self) -> Result<[Vec<f64>; 3], CliError> {
        let mut input = String::new();
        let lines: Vec<&str> = if self.points.is_empty() {
            std::io::stdin().read_to_string(&mut input).map_err(|e| {
                CliError::input(format!("standard input: {e}"), "points are read as UTF-8 text")
            })?;
            input.lines().collect()
        } else {
            self.points.iter().map(String::as_str).collect()
        };
        let mut columns: [Vec<f64>; 3] = Default::default();
        for line in lines {
            let line = line.split('#').next().unwrap_or_default();
            if line.trim().is_empty() {
                continue;
            }
            let what = format!("point {}", columns[0].len() + 1);
            for (column, value) in columns.iter_mut().zip(three(line, &what)?) {
                column.push(value);
            }
        }
        Ok(columns)
    }
}

/// Three finite numbers with commas or blanks between.
fn three(text: &str, what: &str) -> Result<[f64; 3], CliError> {
    let words = text.split([',', ' ', '\t', ';', '\r']).filter(|w| !w.is_empty());
    let numbers: Option<Vec<f64>> = words.map(|w| w.parse().ok().filter(|v: &f64| v.is_finite())).collect();
    numbers.and_then(|n| n.try_into().ok()).ok_or_else(|| {
        let shown: String = text.trim().chars().take(60).collect();
        CliError::input(
            format!("{what} is `{shown}`, expected three numbers"),
            "longitude, latitude and height, or column, row and height, as in `5.44 43.26 120`",
        )
    })
}

fn write(args: &Convert, file: &RpcFile, ui: &Ui) -> Result<(), CliError> {
    let out = &args.out;
    if out.exists() && !args.overwrite {
        return Err(CliError::input(format!("`{}` exists", out.display()), "--overwrite replaces it"));
    }
    let ending = out.extension().map_or_else(String::new, |e| e.to_string_lossy().to_lowercase());
    let text = match (ending.as_str(), &args.image) {
        ("txt", None) => to_text(&file.rpc),
        ("rpb", None) => to_rpb(&file.rpc),
        ("json", None) => to_json(&file.rpc, &file.tags),
        ("tif" | "tiff", Some(image)) => {
            write_with_rpc(image, out, &to_gdal(&file.rpc))?;
            String::new()
        }
        ("tif" | "tiff", None) => {
            return Err(CliError::input(
                format!("`{}` needs an image to copy", out.display()),
                "--image IN.tif names it",
            ));
        }
        _ => {
            return Err(CliError::input(
                format!("`{}` does not end in a known format", out.display()),
                "OUT ends in .txt, .rpb or .json, or in .tif with --image",
            ));
        }
    };
    if !text.is_empty() {
        write_file(out, text)?;
    }
    let line = format!("{}: {} as {}", out.display(), file.format, ending);
    ui.summary("rpc convert", Some(&line), &json!({ "out": out, "from": file.format, "to": ending }))
}

fn compare(args: &Compare, a: &Rpc, b: &Rpc, ui: &Ui) -> Result<(), CliError> {
    let difference = a.difference(b).ok_or_else(|| {
        let (first, second) = (args.first.display(), args.second.display());
        CliError::input(format!("`{first}` and `{second}` see no common ground"), "is one of them damaged?")
    })?;
    let Difference { rms_px: rms, max_px: max, mean_px: [d_col, d_row], places } = difference;
    let text = format!(
        "over the volume of {}: RMS {rms:.6} px, maximum {max:.6} px\nmean of second minus first: col {d_col:+.6}, \
         row {d_row:+.6} px\n",
        args.first.display()
    );
    let summary =
        json!({ "rms_px": rms, "max_px": max, "mean_col_px": d_col, "mean_row_px": d_row, "points": places });
    ui.summary("rpc compare", Some(&text), &summary)
}

fn approximate(args: &Fit, rpc: &Rpc, ui: &Ui) -> Result<(), CliError> {
    let center = match &args.at {
        Some(text) => {
            let [lon, lat, h] = three(text, "--at")?;
            Point::new(lon, lat, h)
        }
        None => rpc.center(),
    };
    let ground = GroundBox { center, side_m: args.size, half_height_m: args.heights };
    let affine = residual(rpc, &ground, Order::Affine)?;
    let quadratic = residual(rpc, &ground, Order::Quadratic)?;
    let text = format!(
        "{:.0} m square, ±{:.0} m, around lon {:.6}, lat {:.6}, {:.1} m\n\
         affine:    RMS {:.2e} px, maximum {:.2e} px\n\
         quadratic: RMS {:.2e} px, maximum {:.2e} px\n",
        args.size,
        args.heights,
        center.lon_deg(),
        center.lat_deg(),
        center.height_m(),
        affine.rms_px,
        affine.max_px,
        quadratic.rms_px,
        quadratic.max_px
    );
    let both = |r: crate::affine::Residual| -> Value { json!({ "rms_px": r.rms_px, "max_px": r.max_px }) };
    let summary = json!({
        "center": [center.lon_deg(), center.lat_deg(), center.height_m()], "size_m": args.size,
        "heights_m": args.heights, "affine": both(affine), "quadratic": both(quadratic),
    });
    ui.summary("rpc fit", Some(&text), &summary)
}
