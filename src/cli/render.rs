//! `satgs render`: pictures of a trained run from anywhere, under any sun.

use super::run_folder::{TrainedCameras, read_scene};
use super::{Failure, Ui};
use crate::affine::sun_direction;
use crate::affine::{SiteScene, SiteView};
use crate::bundle::Adjustment;
use crate::io::{Cog, MapGrid, SensorImage, Vertical, check_writable, write_png_rgb};
use crate::rpc::{Rpc, formats};
use crate::run_files::ADJUSTMENT;
use crate::scene::Sun;
use crate::splat::novel_view::{NovelView, Picture};
use std::path::{Path, PathBuf};

/// Views and suns lower than this are refused: their shears have no end.
const LOWEST_ELEVATION_DEG: f64 = 5.0;

/// Pictures of a trained run from anywhere, under any sun
///
/// A .png holds the colours. A .tif holds red, green, blue (0 to 1) and the height of what is seen (m) as float32; with
/// --view it lies on the map where ground is as high as the site's origin, with --like it has the view's corrected RPC.
/// Directions are degrees, azimuths clockwise from north.
/// With --frames the view goes to --view-to and the sun to --sun-to, a numbered file each:
///
///   satgs render RUN --view 0,30 --view-to 360,30 --frames 90 -o orbit.png
///   satgs render RUN --view 0,0 --sun 95,20 --sun-to 265,20 --frames 60 -o day.png
#[derive(clap::Args, Clone, Debug)]
#[command(verbatim_doc_comment)]
pub struct Args {
    /// Folder that `satgs train RUN` filled
    run: PathBuf,
    /// The picture (.png or .tif)
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Look through a view of the run, with its sun and colours
    #[arg(long, value_name = "VIEW", required_unless_present = "view")]
    like: Option<String>,
    /// Look from this azimuth, this far off nadir; colours are the reference view's
    #[arg(long, value_name = "AZIMUTH,OFF_NADIR", value_parser = direction, conflicts_with = "like")]
    view: Option<[f64; 2]>,
    /// Where the sun stands [default: the view's with --like, else no shadows]
    #[arg(long, value_name = "AZIMUTH,ELEVATION", value_parser = direction)]
    sun: Option<[f64; 2]>,
    /// Columns and rows [default: the area in the reference view's pixels]
    #[arg(long, value_name = "W,H", value_parser = size, conflicts_with = "like")]
    size: Option<(usize, usize)>,
    /// Where the view is in the last frame
    #[arg(long, value_name = "AZIMUTH,OFF_NADIR", value_parser = direction, requires_all = ["view", "frames"])]
    view_to: Option<[f64; 2]>,
    /// Where the sun is in the last frame
    #[arg(long, value_name = "AZIMUTH,ELEVATION", value_parser = direction, requires_all = ["sun", "frames"])]
    sun_to: Option<[f64; 2]>,
    /// Number of pictures, FILE_0001 and so on
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=9999))]
    frames: Option<u32>,
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
pub fn run(args: &Args, ui: &Ui) -> Result<(), Failure> {
    let is_raster = match args.output.extension().map(|e| e.to_string_lossy().to_lowercase()).as_deref() {
        Some("png") => false,
        Some("tif") => true,
        _ => {
            let message = format!("`{}` is no picture that can be written", args.output.display());
            return Err(Failure::input(message, "-o FILE.png or FILE.tif"));
        }
    };
    let cameras = TrainedCameras::read(&args.run)?;
    check_writable(&args.output)?;
    let setup = &cameras.setup;
    let splats = cameras.read_splats(&args.run)?;
    let like = args.like.as_ref().map(|name| find(setup, name)).transpose()?;
    let rpc = like.map(|view| corrected_camera(&args.run, &view.name)).transpose()?;
    let appearance = like
        .and_then(|v| cameras.appearances.iter().find(|a| a.0 == v.name))
        .map_or_else(|| cameras.reference_appearance(), |a| a.1);
    let frames = args.frames.unwrap_or(1);
    for frame in 0..frames {
        let part = f64::from(frame) / f64::from(frames.max(2) - 1);
        let between = |a: [f64; 2], b: Option<[f64; 2]>| {
            b.map_or(a, |b| std::array::from_fn(|k| a[k] + part * (b[k] - a[k])))
        };
        let mut view = match (like, args.view) {
            (Some(view), _) => NovelView { camera: view.camera, size: view.size, sun_shear: view.sun_shear },
            (None, from) => {
                let [azimuth, off_nadir] = between(from.unwrap_or_default(), args.view_to);
                high_enough("--view", 90.0 - off_nadir)?;
                let size = args.size.unwrap_or_else(|| setup.picture_size());
                NovelView { camera: setup.view_from(azimuth, off_nadir, size), size, sun_shear: None }
            }
        };
        if let Some(sun) = args.sun {
            let [azimuth_deg, elevation_deg] = between(sun, args.sun_to);
            high_enough("--sun", elevation_deg)?;
            let towards = sun_direction(Sun { azimuth_deg, elevation_deg }, &setup.site);
            view.sun_shear = Some(view.camera.shear_towards(towards));
        }
        let mut picture = view.picture(&splats, &appearance, setup.altitudes);
        setup.tone.show(&mut picture.colors);
        let path =
            if args.frames.is_some() { numbered(&args.output, frame + 1) } else { args.output.clone() };
        if is_raster {
            write_raster(&path, &picture, &view, rpc.as_ref(), setup)?;
        } else {
            let byte = |v: f32| (v.clamp(0.0, 1.0) * 255.0).round() as u8;
            let pixels = 0..view.size.0 * view.size.1;
            let rgb: Vec<u8> =
                pixels.flat_map(|i| picture.colors.each_ref().map(|c| byte(c.data[i]))).collect();
            write_png_rgb(&path, view.size.0, view.size.1, &rgb)?;
        }
    }
    let text = format!("{}, pictures: {frames}", args.output.display());
    ui.summary("render", &text, serde_json::json!({ "output": args.output, "frames": frames }));
    Ok(())
}

/// A view of a run by its name.
pub(super) fn find<'a>(setup: &'a SiteScene, name: &str) -> Result<&'a SiteView, Failure> {
    setup.views.iter().find(|v| v.name == name).ok_or_else(|| {
        let names: Vec<&str> = setup.views.iter().map(|v| v.name.as_str()).collect();
        Failure::input(format!("the run has no view `{name}`"), format!("it has {}", names.join(", ")))
    })
}

fn high_enough(option: &str, elevation_deg: f64) -> Result<(), Failure> {
    if (LOWEST_ELEVATION_DEG..=90.0).contains(&elevation_deg) {
        return Ok(());
    }
    let message = format!(
        "{option}: {elevation_deg}° above the horizon is not between {LOWEST_ELEVATION_DEG}° and 90°"
    );
    Err(Failure::input(message, "--view AZIMUTH,OFF_NADIR, --sun AZIMUTH,ELEVATION"))
}

fn numbered(path: &Path, number: u32) -> PathBuf {
    let part = |p: Option<&std::ffi::OsStr>| p.map_or_else(String::new, |p| p.to_string_lossy().into_owned());
    path.with_file_name(format!("{}_{number:04}.{}", part(path.file_stem()), part(path.extension())))
}

/// A view's camera as adjusted.
fn corrected_camera(run: &Path, name: &str) -> Result<Rpc, Failure> {
    let scene = read_scene(run)?;
    let cameras = Adjustment::read(&run.join(ADJUSTMENT))?.cameras_of(&scene)?;
    let camera = scene.views.iter().zip(cameras).find(|(view, _)| view.name == name);
    camera.map(|(_, rpc)| rpc).ok_or_else(|| {
        Failure::input(format!("scene.json has no view `{name}`"), "`satgs ba SCENE -o RUN` makes it")
    })
}

/// Writes colours and heights with the view's RPC, if it has one, else on the map.
fn write_raster(
    path: &Path,
    picture: &Picture,
    view: &NovelView,
    rpc: Option<&Rpc>,
    setup: &SiteScene,
) -> Result<(), Failure> {
    let ([east, north, up], (width, height)) = (setup.site.origin.xyz(), view.size);
    let mut altitude = picture.altitude.clone();
    altitude.data.iter_mut().for_each(|z| *z += up as f32);
    let [red, green, blue] = &picture.colors;
    let bands = [("red", "", red), ("green", "", green), ("blue", "", blue), ("height", "m", &altitude)];
    if let Some(rpc) = rpc {
        let image = SensorImage { width, height, rpc: &formats::to_gdal(rpc), metadata: &[] };
        return Ok(image.write_f32(path, &bands)?);
    }
    let cell = view.camera.gsd_m();
    let [col, row] = view.camera.offset;
    let (west, north) = (east - (col + 0.5) * cell, north + (row + 0.5) * cell);
    let grid = MapGrid { epsg: setup.site.epsg, west, north, cell, width, height };
    let cog = Cog { grid, metadata: &[], heights_from: Some(&Vertical::Ellipsoid) };
    Ok(cog.write_f32(path, &bands)?)
}
