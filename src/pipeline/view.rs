//! The page that shows a run: `satgs view`.

use super::{PipelineError, TrainedCameras, relocation};
use crate::affine::SiteScene;
use crate::bundle::Adjustment;
use crate::frame::{Geodetic, Point, SiteGrid};
use crate::io::{check_writable, write_file};
use crate::progress::Progress;
use crate::run_files::{ADJUSTMENT, DSM, MESHES, ORTHO, PLAN, SPARSE_POINTS, SPLATS, TILES};
use crate::scene::Role;
use crate::splat::ply;
use crate::viewer::{CameraMark, PageFile, PageLayer, Relief, ShownLayer, ViewerError, ViewerPage, serve};
use serde::Serialize;
use std::net::{Ipv4Addr, TcpListener};
use std::path::{Path, PathBuf};

/// Distance at which satellites are drawn, in half diagonals of the area.
const SATELLITE_DISTANCE: f64 = 1.0;

/// A page that was written.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WrittenPage {
    /// The HTML file.
    pub page: PathBuf,
    /// Its size.
    pub bytes: u64,
    /// Names of its layers.
    pub layers: Vec<&'static str>,
}

/// Writes the page of a run as one HTML file, which opens without a network connection.
///
/// # Errors
/// [`PipelineError`] as [`view_page`]; the file exists and `overwrite` is not set, it cannot be written, or would be too
/// large for browsers.
pub fn write_page(run: &Path, file: &Path, overwrite: bool) -> Result<WrittenPage, PipelineError> {
    if file.exists() && !overwrite {
        return Err(PipelineError::Exists { path: file.into() });
    }
    check_writable(file)?;
    let page = view_page(run)?;
    let html = page.html()?;
    write_file(file, &html)?;
    let layers = page.layers.iter().map(|l| l.label).collect();
    Ok(WrittenPage { page: file.into(), bytes: html.len() as u64, layers })
}

/// Serves the page of a run to the browser of this machine, on a port or a free one, until `progress` asks to stop.
/// `started` gets the address of the page.
///
/// # Errors
/// [`PipelineError`] as [`view_page`]; the port is in use. [`PipelineError::Interrupted`] at the end.
pub fn serve_page(
    run: &Path,
    port: Option<u16>,
    started: impl FnOnce(&str) -> Result<(), PipelineError>,
    progress: &dyn Progress,
) -> Result<(), PipelineError> {
    let taken = |cause| ViewerError::Port { port: port.unwrap_or_default(), cause };
    // A port in use is said before the files are read.
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port.unwrap_or(0))).map_err(taken)?;
    let page = view_page(run)?;
    let address = listener.local_addr().map_err(taken)?;
    started(&format!("http://{address}/"))?;
    Ok(serve(&listener, &page, progress)?)
}

/// The page of a run, with a layer for each of its results that exists.
///
/// # Errors
/// [`PipelineError`]: the run has no splats or has several tiles, a file is damaged.
pub fn view_page(run: &Path) -> Result<ViewerPage, PipelineError> {
    if !run.join(SPLATS).exists() {
        return Err(no_splats(run).into());
    }
    relocation::finish(run)?;
    let cameras = TrainedCameras::read(run)?;
    let setup = &cameras.setup;
    let folder = run.canonicalize().unwrap_or_else(|_| run.into());
    let title = folder.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let mut page = ViewerPage::new(title, &setup.site, setup.area);

    let splats = cameras.read_shown_splats(run)?;
    let layer = PageLayer::Splats { file: "splats.ply" };
    page.files.push(PageFile { name: "splats.ply", bytes: ply::encode(&splats, &setup.site) });
    page.layers.push(ShownLayer { layer, label: "Splats", note: grouped(splats.len()), is_shown: true });
    add_mesh(&mut page, run, &setup.site)?;
    add_relief(&mut page, run, &setup.site)?;
    add_sparse_points(&mut page, run, setup)?;
    let views = satellites(setup);
    let (note, layer) = (grouped(views.len()), PageLayer::Cameras { views });
    page.layers.push(ShownLayer { layer, label: "Cameras", note, is_shown: true });
    Ok(page)
}

fn no_splats(run: &Path) -> ViewerError {
    if !run.join(PLAN).exists() {
        return ViewerError::NoSplats { run: run.into() };
    }
    let tiles = std::fs::read_dir(run.join(TILES)).into_iter().flatten().flatten();
    let mut trained: Vec<PathBuf> =
        tiles.map(|tile| tile.path()).filter(|t| t.join(SPLATS).exists()).collect();
    trained.sort();
    let example = trained.first().cloned().unwrap_or_else(|| run.join(TILES).join("ID"));
    ViewerError::OfTiles { run: run.into(), example: example.display().to_string() }
}

/// Adds the mesh of the run, if there is one.
fn add_mesh(page: &mut ViewerPage, run: &Path, site: &SiteGrid) -> Result<(), PipelineError> {
    let Some(file) = MESHES.into_iter().find(|name| run.join(name).exists()) else { return Ok(()) };
    let path = run.join(file);
    let damaged = |reason: String| ViewerError::Mesh { path: path.clone(), reason };
    let bytes = std::fs::read(&path).map_err(|e| damaged(e.to_string()))?;
    let offset = if file.ends_with(".glb") {
        glb_offset(&bytes, site).ok_or_else(|| damaged("it is not a GLB file".into()))?
    } else {
        [0.0; 3]
    };
    let note = format!("{} MB", bytes.len().div_ceil(1_000_000));
    page.files.push(PageFile { name: file, bytes });
    let layer = PageLayer::Mesh { file, offset };
    page.layers.push(ShownLayer { layer, label: "Mesh", note, is_shown: false });
    Ok(())
}

/// What is added to the coordinates of a GLB file to give site coordinates: its scene's `extras` name the place of its
/// origin on the map, at height 0; without them it is in the site frame. None for other files.
fn glb_offset(bytes: &[u8], site: &SiteGrid) -> Option<[f64; 3]> {
    let length = u32::from_le_bytes(bytes.get(12..16)?.try_into().ok()?) as usize;
    let text = bytes.get(20..20usize.checked_add(length)?)?;
    let document: serde_json::Value = serde_json::from_slice(text).ok()?;
    let extras = &document["scenes"][0]["extras"];
    let [east, north, up] = site.origin.xyz();
    Some(match (extras["east_m"].as_f64(), extras["north_m"].as_f64()) {
        (Some(e), Some(n)) => [e - east, n - north, extras["height_m"].as_f64().unwrap_or(0.0) - up],
        _ => [0.0; 3],
    })
}

/// Adds the surface model, if there is one, in the colours of the orthophoto.
fn add_relief(page: &mut ViewerPage, run: &Path, site: &SiteGrid) -> Result<(), PipelineError> {
    let (dsm, ortho) = (run.join(DSM), run.join(ORTHO));
    if !dsm.exists() {
        return Ok(());
    }
    let relief = Relief::read(&dsm, ortho.exists().then_some(ortho.as_path()), site)?;
    page.files.push(PageFile { name: "relief.bin", bytes: relief.bytes() });
    let layer = PageLayer::Relief {
        file: "relief.bin",
        texture: relief.texture.is_some().then_some("ortho.png"),
        columns: relief.altitudes.width,
        rows: relief.altitudes.height,
        west: relief.west,
        north: relief.north,
        cell: relief.cell,
    };
    if let Some(bytes) = relief.texture {
        page.files.push(PageFile { name: "ortho.png", bytes });
    }
    page.layers.push(ShownLayer {
        layer,
        label: "DSM",
        note: format!("{} m", relief.cell),
        is_shown: false,
    });
    Ok(())
}

/// Adds the sparse points of the adjustment, if there are some.
fn add_sparse_points(page: &mut ViewerPage, run: &Path, setup: &SiteScene) -> Result<(), PipelineError> {
    let folder = run.join(ADJUSTMENT);
    if !folder.join(SPARSE_POINTS).exists() {
        return Ok(());
    }
    let points = Adjustment::read(&folder)?.points;
    let place = |p: Point<Geodetic>| setup.site.site_from_geodetic(p).xyz();
    let mut bytes: Vec<u8> =
        points.iter().flat_map(|p| place(p.position)).flat_map(|v| (v as f32).to_le_bytes()).collect();
    bytes.extend(points.iter().flat_map(|p| [p.gray; 3]));
    page.files.push(PageFile { name: "points.bin", bytes });
    let layer = PageLayer::Points { file: "points.bin", count: points.len() };
    page.layers.push(ShownLayer {
        layer,
        label: "Sparse points",
        note: grouped(points.len()),
        is_shown: false,
    });
    Ok(())
}

/// The views of a satellite run, whose lines of sight end in the middle of the area.
fn satellites(setup: &SiteScene) -> Vec<CameraMark> {
    let (west, south, east, north) = setup.area;
    let middle = [0.5 * (west + east), 0.5 * (south + north), 0.0];
    let distance = SATELLITE_DISTANCE * 0.5 * (east - west).hypot(north - south);
    let mark = |v: &crate::affine::SiteView| {
        CameraMark::of_satellite(&v.name, v.role == Role::Test, &v.camera, middle, distance)
    };
    setup.views.iter().map(mark).collect()
}

/// A number with a space between groups of three digits.
fn grouped(number: usize) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i) % 3 == 0 {
            text.push('\u{202f}');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_grouped() {
        for (number, text) in [(7, "7"), (123, "123"), (1234, "1\u{202f}234"), (1234567, "1\u{202f}234\u{202f}567")] {
            assert_eq!(grouped(number), text);
        }
    }

    #[test]
    fn a_mesh_with_a_place_on_the_map_is_moved_into_the_site_frame() {
        let site = SiteGrid { epsg: 32617, origin: Point::new(100.0, 200.0, 30.0) };
        let glb = |text: &str| {
            let mut bytes = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
            bytes.extend((text.len() as u32).to_le_bytes());
            bytes.extend(b"JSON");
            bytes.extend(text.bytes());
            bytes
        };
        let placed = glb(r#"{"scenes":[{"extras":{"east_m":110.5,"north_m":190.0}}]}"#);
        assert_eq!(glb_offset(&placed, &site), Some([10.5, -10.0, -30.0]));
        assert_eq!(glb_offset(&glb(r#"{"scenes":[{}]}"#), &site), Some([0.0; 3]));
        for cut in 0..placed.len() {
            assert_eq!(glb_offset(&placed[..cut], &site), None);
        }
    }
}
