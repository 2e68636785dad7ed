//! Images of a trained perspective scene.

use super::super::PipelineError;
use super::super::render_options::{Colors, RenderOptions, RenderSummary, Viewpoint};
use super::super::run_folder::perspective_cameras::PerspectiveCameras;
use crate::io::{SensorImage, check_writable, write_png_rgb};
use crate::progress::{Event, Progress};
use std::path::Path;

/// Renders the image of a view: a `.png` of its colours, a `.tif` of colours and depth, or of the depth alone.
pub fn render(
    run: &Path,
    output: &Path,
    is_raster: bool,
    options: &RenderOptions,
    progress: &dyn Progress,
) -> Result<RenderSummary, PipelineError> {
    let Viewpoint::Like(name) = &options.viewpoint else {
        return Err(PipelineError::OnlyViews { option: "--view" });
    };
    if options.sun_deg.is_some() {
        return Err(PipelineError::OnlyViews { option: "--sun" });
    }
    match options.colors {
        Colors::OfViewpoint => {}
        Colors::OfView(_) => return Err(PipelineError::OnlyViews { option: "--appearance" }),
        Colors::At { .. } => return Err(PipelineError::OnlyViews { option: "--date" }),
    }
    if options.frames.is_some() {
        return Err(PipelineError::OnlyViews { option: "--frames" });
    }
    let cameras = PerspectiveCameras::read(run)?;
    check_writable(output)?;
    let view = cameras.find(name)?;
    progress.event(Event::Started { stage: "rendering", total: 1 });
    let picture = cameras.picture(&PerspectiveCameras::read_splats(run)?, &view.camera());
    let (width, height) = view.size;
    if is_raster {
        let [red, green, blue] = &picture.colors;
        let mut bands = vec![("red", "", red), ("green", "", green), ("blue", "", blue)];
        if options.depth || options.normals {
            bands.clear();
        }
        if options.normals {
            let discs = picture.discs.as_ref();
            let [x, y, z] = &discs.ok_or_else(|| PipelineError::NoNormals { run: run.into() })?.normals;
            bands.extend([("x", "", x), ("y", "", y), ("z", "", z)]);
        }
        if options.depth || !options.normals {
            bands.push(("depth", if cameras.site.is_some() { "m" } else { "" }, &picture.depth));
        }
        SensorImage { width, height, rpc: &[], metadata: &[] }.write_f32(output, &bands)?;
    } else {
        let byte = |v: f32| (v.clamp(0.0, 1.0) * 255.0).round() as u8;
        let rgb: Vec<u8> =
            (0..width * height).flat_map(|i| picture.colors.each_ref().map(|c| byte(c.data[i]))).collect();
        write_png_rgb(output, width, height, &rgb)?;
    }
    progress.event(Event::Finished);
    Ok(RenderSummary { output: output.into(), frames: 1 })
}
