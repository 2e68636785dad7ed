//! Images of a trained satellite scene from any direction, under any sun.

use super::super::render_options::{Colors, RenderOptions, RenderSummary, Viewpoint};
use super::super::run_folder::colors::SceneColors;
use super::super::{PipelineError, TrainedCameras, read_scene, relocation};
use super::appearance::embedding_at;
use crate::affine::{SiteScene, sun_direction};
use crate::bundle::Adjustment;
use crate::frame::Point;
use crate::io::{Cog, Grid2, MapGrid, SensorImage, VerticalReference, check_writable, write_png_rgb};
use crate::progress::{Event, Progress};
use crate::rpc::{Rpc, formats};
use crate::run_files::ADJUSTMENT;
use crate::scene::Sun;
use crate::splat::primitive::PrimitiveKind;
use crate::splat::satellite::{NovelView, Picture};
use std::path::{Path, PathBuf};

/// Noon, hours.
const NOON_H: f64 = 12.0;
/// Views and suns lower than this are refused: their displacement by height is too large.
const LOWEST_ELEVATION_DEG: f64 = 5.0;

/// Renders the images that the options ask for, as [`render`](super::super::render).
pub fn render(
    run: &Path,
    output: &Path,
    is_raster: bool,
    options: &RenderOptions,
    progress: &dyn Progress,
) -> Result<RenderSummary, PipelineError> {
    relocation::finish(run)?;
    let cameras = TrainedCameras::read(run)?;
    check_writable(output)?;
    let setup = &cameras.setup;
    let trained = SceneColors::read(run)?;
    if trained.is_none() && options.colors != Colors::OfViewpoint {
        return Err(PipelineError::NoTrainedColors { run: run.into(), what: "another view or date" });
    }
    let splats = cameras.read_splats(run)?;
    if options.normals && splats.primitive() != PrimitiveKind::Disc {
        return Err(PipelineError::NoNormals { run: run.into() });
    }
    let like = match &options.viewpoint {
        Viewpoint::Like(name) | Viewpoint::Visibility(name) => Some(cameras.find(name)?),
        Viewpoint::Direction { .. } => None,
    };
    let rpc = like.map(|view| corrected_camera(run, &view.name)).transpose()?;
    if let (Viewpoint::Visibility(_), Some(view), Some(rpc)) = (&options.viewpoint, like, &rpc) {
        let visibility = trained.as_ref().and_then(|colors| colors.visibility(&view.name, view.size));
        let no_visibility = || PipelineError::NoVisibility { run: run.into(), name: view.name.clone() };
        write_visibility(output, is_raster, &visibility.ok_or_else(no_visibility)?, rpc)?;
        return Ok(RenderSummary { output: output.into(), frames: 1 });
    }
    let appearance = like
        .and_then(|v| cameras.appearances.iter().find(|a| a.0 == v.name))
        .map_or_else(|| cameras.reference_appearance(), |a| a.1.clone());
    let frames = options.frames.unwrap_or(1);
    let mut strip = Strip::default();
    progress.event(Event::Started { stage: "rendering", total: frames.into() });
    for frame in 0..frames {
        progress.check()?;
        let part = f64::from(frame) / f64::from(frames.max(2) - 1);
        let mut view = frame_view(&cameras, options, part)?;
        let picture = match &trained {
            Some(colors) => {
                let (embedding, sun) = frame_colors(run, colors, setup, options, part)?;
                let sun_shear = sun.map(|sun| view.camera.shear_towards(sun_direction(sun, &setup.site)));
                view.sun_shear =
                    if options.sun_deg.is_some() { view.sun_shear } else { sun_shear.or(view.sun_shear) };
                colors.picture(&view, &embedding, setup)
            }
            None => {
                let mut picture = view.picture(&splats, &appearance, setup.altitudes);
                setup.transfer_function.encode(&mut picture.colors);
                picture
            }
        };
        let path = if options.frames.is_some() && !options.strip {
            numbered(output, frame + 1)
        } else {
            output.into()
        };
        if options.strip {
            strip.push(&picture);
        } else if is_raster {
            let normals = options.normals.then(|| view.normals(&splats));
            let mut bands = bands_of(&picture, normals.as_ref(), options, setup);
            if let Some(colors) = trained.as_ref().filter(|_| !options.normals && !options.depth) {
                bands.push(("sunlight", "", colors.sunlit(&view, setup)));
            }
            write_raster(&path, &bands, &view, rpc.as_ref(), setup)?;
        } else {
            write_png_rgb(&path, view.size.0, view.size.1, &bytes_of(&picture))?;
        }
        progress.event(Event::Advanced { done: u64::from(frame) + 1, status: String::new() });
    }
    if options.strip {
        strip.write(output)?;
    }
    progress.event(Event::Finished);
    Ok(RenderSummary { output: output.into(), frames })
}

/// Red, green and blue of each pixel, row by row.
fn bytes_of(picture: &Picture) -> Vec<u8> {
    let byte = |v: f32| (v.clamp(0.0, 1.0) * 255.0).round() as u8;
    let pixels = 0..picture.colors[0].data.len();
    pixels.flat_map(|i| picture.colors.each_ref().map(|c| byte(c.data[i]))).collect()
}

/// Pictures of the same size side by side.
#[derive(Default)]
struct Strip {
    size: (usize, usize),
    pictures: Vec<Vec<u8>>,
}

impl Strip {
    fn push(&mut self, picture: &Picture) {
        self.size = (picture.colors[0].width, picture.colors[0].height);
        self.pictures.push(bytes_of(picture));
    }

    fn write(&self, path: &Path) -> Result<(), PipelineError> {
        let ((width, height), count) = (self.size, self.pictures.len());
        let rows = (0..height).flat_map(|row| self.pictures.iter().map(move |p| (row, p)));
        let rgb: Vec<u8> =
            rows.flat_map(|(row, p)| p[3 * width * row..3 * width * (row + 1)].iter().copied()).collect();
        Ok(write_png_rgb(path, count * width, height, &rgb)?)
    }
}

/// Embedding and sun of a frame; `part` goes from 0 at the first frame to 1 at the last. Without a date there is no sun.
fn frame_colors(
    run: &Path,
    colors: &SceneColors,
    setup: &SiteScene,
    options: &RenderOptions,
    part: f64,
) -> Result<(Vec<f32>, Option<Sun>), PipelineError> {
    let of_view = |name: &str| {
        let views = || colors.appearance.content.views.iter().map(|v| v.name.as_str()).collect::<Vec<_>>();
        let no_view = || PipelineError::NoView { name: name.into(), views: views().join(", ") };
        let index = colors.appearance.view(name).ok_or_else(no_view)?;
        Ok::<_, PipelineError>(colors.appearance.embeddings[index].clone())
    };
    match (&options.colors, &options.viewpoint) {
        (Colors::At { from, to }, _) => {
            let to = to.unwrap_or(*from);
            let between = |a: f64, b: f64| a + part * (b - a);
            let usual = || colors.usual_hour().unwrap_or(NOON_H);
            let hour = between(from.hour.unwrap_or_else(usual), to.hour.unwrap_or_else(usual));
            let day = between(from.noon, to.noon).round() + (hour - NOON_H) / 24.0;
            let embedding =
                embedding_at(colors, day).ok_or_else(|| PipelineError::NoSeason { run: run.into() })?;
            let sun = Sun::at_day(day, setup.site.geodetic_from_site(Point::new(0.0, 0.0, 0.0)));
            if options.sun_deg.is_none() {
                high_enough("--time", sun.elevation_deg)?;
            }
            Ok((embedding, Some(sun)))
        }
        (Colors::OfView(name), _) => Ok((of_view(name)?, None)),
        (Colors::OfViewpoint, Viewpoint::Like(name)) if colors.appearance.view(name).is_some() => {
            Ok((of_view(name)?, None))
        }
        (Colors::OfViewpoint, _) => Ok((colors.reference().to_vec(), None)),
    }
}

/// Camera and sun of a frame; `part` goes from 0 at the first frame to 1 at the last.
fn frame_view(
    cameras: &TrainedCameras,
    options: &RenderOptions,
    part: f64,
) -> Result<NovelView, PipelineError> {
    let setup = &cameras.setup;
    let between = |a: [f64; 2], b: Option<[f64; 2]>| {
        b.map_or(a, |b| std::array::from_fn(|k| a[k] + part * (b[k] - a[k])))
    };
    let mut view = match &options.viewpoint {
        Viewpoint::Like(name) | Viewpoint::Visibility(name) => cameras.find(name)?.into(),
        Viewpoint::Direction { from_deg, to_deg, size } => {
            let [azimuth, off_nadir] = between(*from_deg, *to_deg);
            high_enough("--view", 90.0 - off_nadir)?;
            let size = size.unwrap_or_else(|| setup.picture_size());
            NovelView { camera: setup.view_from(azimuth, off_nadir, size), size, sun_shear: None }
        }
    };
    if let Some(sun) = options.sun_deg {
        let [azimuth_deg, elevation_deg] = between(sun, options.sun_to_deg);
        high_enough("--sun", elevation_deg)?;
        let towards = sun_direction(Sun { azimuth_deg, elevation_deg }, &setup.site);
        view.sun_shear = Some(view.camera.shear_towards(towards));
    }
    Ok(view)
}

fn high_enough(option: &'static str, elevation_deg: f64) -> Result<(), PipelineError> {
    let lowest_deg = LOWEST_ELEVATION_DEG;
    if (lowest_deg..=90.0).contains(&elevation_deg) {
        return Ok(());
    }
    Err(PipelineError::Direction { option, elevation_deg, lowest_deg })
}

fn numbered(path: &Path, number: u32) -> PathBuf {
    let part = |p: Option<&std::ffi::OsStr>| p.map_or_else(String::new, |p| p.to_string_lossy().into_owned());
    path.with_file_name(format!("{}_{number:04}.{}", part(path.file_stem()), part(path.extension())))
}

/// The corrected camera of a view.
fn corrected_camera(run: &Path, name: &str) -> Result<Rpc, PipelineError> {
    let scene = read_scene(run)?;
    let cameras = Adjustment::read(&run.join(ADJUSTMENT))?.cameras_of(&scene)?;
    let camera = scene.views.iter().zip(cameras).find(|(view, _)| view.name == name);
    camera
        .map(|(_, rpc)| rpc)
        .ok_or_else(|| PipelineError::ViewNotInScene { run: run.into(), name: name.into() })
}

/// A band: its name, unit and values.
type Band = (&'static str, &'static str, Grid2);

/// The bands to write: colours and heights, or what the options ask for.
fn bands_of(
    picture: &Picture,
    normals: Option<&[Grid2; 3]>,
    options: &RenderOptions,
    setup: &SiteScene,
) -> Vec<Band> {
    let mut height = picture.altitude.clone();
    height.data.iter_mut().for_each(|z| *z += setup.site.origin.z() as f32);
    let named = |names: [&'static str; 3], grids: &[Grid2; 3]| {
        names.into_iter().zip(grids).map(|(name, grid)| (name, "", grid.clone())).collect::<Vec<Band>>()
    };
    let mut bands = match normals {
        Some(normals) => named(["east", "north", "up"], normals),
        None if options.depth => Vec::new(),
        None => named(["red", "green", "blue"], &picture.colors),
    };
    if normals.is_none() || options.depth {
        bands.push(("height", "m", height));
    }
    bands
}

/// Writes the visibility of a view's pixels: gray, or a band with the view's RPC.
fn write_visibility(
    path: &Path,
    is_raster: bool,
    visibility: &Grid2,
    rpc: &Rpc,
) -> Result<(), PipelineError> {
    let Grid2 { width, height, .. } = *visibility;
    if is_raster {
        let image = SensorImage { width, height, rpc: &formats::to_gdal(rpc), metadata: &[] };
        return Ok(image.write_f32(path, &[("visibility", "", visibility)])?);
    }
    let rgb: Vec<u8> = visibility.data.iter().flat_map(|v| [(v * 255.0).round() as u8; 3]).collect();
    Ok(write_png_rgb(path, width, height, &rgb)?)
}

/// Writes bands with the view's RPC, if it has one, else on the map.
fn write_raster(
    path: &Path,
    bands: &[Band],
    view: &NovelView,
    rpc: Option<&Rpc>,
    setup: &SiteScene,
) -> Result<(), PipelineError> {
    let ([east, north, _], (width, height)) = (setup.site.origin.xyz(), view.size);
    let bands: Vec<_> = bands.iter().map(|(name, unit, grid)| (*name, *unit, grid)).collect();
    if let Some(rpc) = rpc {
        let image = SensorImage { width, height, rpc: &formats::to_gdal(rpc), metadata: &[] };
        return Ok(image.write_f32(path, &bands)?);
    }
    let cell = view.camera.gsd_m();
    let [col, row] = view.camera.offset;
    let (west, north) = (east - (col + 0.5) * cell, north + (row + 0.5) * cell);
    let grid = MapGrid { epsg: setup.site.epsg, west, north, cell, width, height };
    let cog = Cog { grid, metadata: &[], heights_from: Some(&VerticalReference::Ellipsoid) };
    Ok(cog.write_f32(path, &bands)?)
}
