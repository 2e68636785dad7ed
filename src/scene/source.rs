//! One image of a scene: the file, the cameras found in and beside it, its sun and date.

use super::sidecar::Sidecars;
use super::{Role, SceneError, Sun, View};
use crate::frame::{CornerPx, Pixel};
use crate::raster::ImageFile;
use crate::rpc::Rpc;
use crate::rpc::formats::{self, FormatError, RpcFile, SAME_PX, ViewTags};
use std::path::{Path, PathBuf};

/// Extensions of images, in lower case.
const IMAGES: [&str; 8] = ["tif", "tiff", "ntf", "nitf", "nsf", "jp2", "j2k", "vrt"];
/// The GSD told and the camera's at mid height agree better than this factor, whatever the relief.
const GSD_FACTOR: f64 = 1.35;
/// The off-nadir angle told and the camera's agree better, wherever in the image the telling is meant.
const OFF_NADIR_DEG: f64 = 5.0;
/// A map-projected image's RPC sees its own centre closer than this share of its size.
const OWN_GRID: f64 = 0.05;

/// Where a camera was found.
struct Camera {
    file: RpcFile,
    source: String,
}

/// Images of a folder, ordered by name; hidden files do not count.
pub(super) fn images_in(folder: &Path) -> Result<Vec<PathBuf>, SceneError> {
    let mut found: Vec<PathBuf> = files_in(folder)?
        .into_iter()
        .filter(|p| {
            let extension = p.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
            extension.is_some_and(|e| IMAGES.contains(&e.as_str())) && !p.is_dir()
        })
        .collect();
    found.sort();
    Ok(found)
}

/// Everything in a folder that is not hidden.
pub(super) fn files_in(folder: &Path) -> Result<Vec<PathBuf>, SceneError> {
    let failed = |e: std::io::Error| SceneError::Unreadable { path: folder.into(), reason: e.to_string() };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if !path.file_name().is_some_and(|n| n.to_string_lossy().starts_with('.')) {
            found.push(path);
        }
    }
    Ok(found)
}

/// The file name without its extension.
pub(super) fn stem(path: &Path) -> String {
    path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned())
}

/// Reads an image's view with the cameras beside and in it, the first of them; warnings are added to `warnings`.
///
/// None when there is no camera.
pub(super) fn view(
    image: &Path,
    sidecars: &Sidecars,
    warnings: &mut Vec<String>,
) -> Result<Option<View>, SceneError> {
    let file = ImageFile::open(image)?;
    file.check_complete()?;
    let size = file.size();
    let mut cameras = cameras(&file, sidecars)?;
    if cameras.is_empty() {
        return Ok(None);
    }
    let mut chosen = cameras.remove(0);
    for other in &cameras {
        let distance = distance_px(&chosen.file.rpc, &other.file.rpc, size);
        if distance > SAME_PX {
            warnings.push(format!(
                "`{}`: its {} and {from} differ by {distance:.1} px; {from} is used",
                image.display(),
                other.source,
                from = chosen.source,
            ));
        }
    }
    warnings.append(&mut chosen.file.warnings);
    let mut tags = chosen.file.tags;
    for metadata in &sidecars.metadata {
        match formats::read_tags(metadata) {
            Ok(more) => tags = tags.or(more),
            // The camera is whole without it.
            Err(e) => warnings.push(e.to_string()),
        }
    }
    let tags = tags.or(image_tags(&file));
    let rpc = match sidecars.tile {
        Some(tile) => tile.camera(image, chosen.file.rpc, &tags, warnings)?,
        None => chosen.file.rpc,
    };
    let is_part = sidecars.tile.is_some() && tags.tiles.is_none_or(|t| t.across.saturating_mul(t.down) > 1);
    if let Some(told) = tags.size.filter(|told| *told != size && !is_part) {
        return Err(SceneError::OtherSize {
            rpc: sidecars.cameras.first().map_or(image, PathBuf::as_path).into(),
            image: image.into(),
            told_width: told.0,
            told_height: told.1,
            width: size.0,
            height: size.1,
        });
    }
    refuse_ortho(&file, &rpc)?;
    let view = View {
        name: stem(image),
        image: image.into(),
        width: size.0,
        height: size.1,
        window: None,
        bands: file.default_bands(),
        stretch_percent: None,
        mask: None,
        nodata: tags.nodata,
        rpc,
        rpc_source: chosen.source,
        sun: tags.sun_deg.and_then(|(azimuth, elevation)| Sun::new(azimuth, elevation)),
        acquired: tags.acquired,
        role: Role::Train,
        height_range: tags.height_range,
    };
    warnings.extend(other_resolution(&view, tags.gsd_m));
    warnings.extend(other_direction(&view, tags.off_nadir_deg));
    Ok(Some(view))
}

/// The camera of an RPC file, or of an image with what lies beside it.
///
/// # Errors
/// [`SceneError`], naming the file.
pub fn read_camera(path: &Path) -> Result<RpcFile, SceneError> {
    if !is_image(path) {
        return Ok(formats::read(path)?);
    }
    let folder = path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut warnings = Vec::new();
    let sidecars = Sidecars::of(path, &files_in(folder)?);
    let view = view(path, &sidecars, &mut warnings)?.ok_or_else(|| no_rpc(path))?;
    Ok(RpcFile { tags: view.tags(), rpc: view.rpc, format: "image", warnings })
}

/// Whether a file is no text: RPC files are, images are not, but for the head of a NITF.
pub(super) fn is_image(path: &Path) -> bool {
    use std::io::Read;
    let mut head = Vec::new();
    let read = std::fs::File::open(path).and_then(|f| f.take(512).read_to_end(&mut head));
    read.is_ok() && (head.contains(&0) || head.starts_with(b"NITF") || head.starts_with(b"NSIF"))
}

/// The error for an image without a camera.
pub(super) fn no_rpc(image: &Path) -> SceneError {
    let is_map = ImageFile::open(image).is_ok_and(|f| f.is_map());
    let what = if is_map { "; it has a map projection, as an ortho product" } else { "" };
    SceneError::NoRpc { path: image.into(), what }
}

/// The cameras of an image, the most preferred first: sidecars in their order, then what the file itself holds.
///
/// The first must be whole; a broken one below a good one is nobody's problem.
fn cameras(file: &ImageFile, sidecars: &Sidecars) -> Result<Vec<Camera>, FormatError> {
    let mut found = Vec::new();
    for path in &sidecars.cameras {
        let source = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        match formats::read(path) {
            Ok(file) => found.push(Camera { file, source }),
            Err(e) if found.is_empty() => return Err(e),
            Err(_) => {}
        }
    }
    if sidecars.is_chosen {
        return Ok(found);
    }
    match own_camera(file) {
        Ok(own) => found.extend(own),
        Err(e) if found.is_empty() => return Err(e),
        Err(_) => {}
    }
    Ok(found)
}

/// The camera in the file: a TIFF's tag to the last bit, else what GDAL shows.
fn own_camera(file: &ImageFile) -> Result<Option<Camera>, FormatError> {
    let path = file.path();
    let camera = |rpc, source: &str| Camera { file: RpcFile::new(rpc, "GDAL"), source: source.into() };
    if let Some(rpc) = formats::from_tiff(path)? {
        return Ok(Some(camera(rpc, "RPC tag")));
    }
    // GDAL reads an RPC00A too; which order its own readers make of it nobody can check here.
    if file.metadata("RPC00A", "TRE").is_some() {
        return Err(FormatError::Rpc00a { file: path.into() });
    }
    let source = if file.metadata("RPC00B", "TRE").is_some() { "RPC00B segment" } else { "RPC read by GDAL" };
    Ok(formats::from_gdal(path, &file.metadata_domain("RPC"))?.map(|rpc| camera(rpc, source)))
}

/// How far apart two cameras see the ground under an image's corners and centre, at most.
pub(super) fn distance_px(a: &Rpc, b: &Rpc, (width, height): (usize, usize)) -> f64 {
    let (w, h) = (width as f64, height as f64);
    let places = [(0.0, 0.0), (w, 0.0), (0.0, h), (w, h), (0.5 * w, 0.5 * h)];
    let apart = places.map(|(col, row)| {
        let px = Pixel::<CornerPx>::new(col, row).into();
        a.localize(px, a.center().height_m()).map_or(f64::INFINITY, |p| b.project(p).distance(px))
    });
    // `f64::max` passes NaN over.
    apart.into_iter().map(|d| if d.is_nan() { f64::INFINITY } else { d }).fold(0.0, f64::max)
}

/// Refuses a map whose RPC is that of the image it was made from.
///
/// An ortho-ready product (Maxar's OR2A) is a map at one height whose RPC is its own: at some height the camera sees
/// the place of a pixel at that pixel.
fn refuse_ortho(file: &ImageFile, rpc: &Rpc) -> Result<(), SceneError> {
    let (width, height) = file.size();
    let center = Pixel::<CornerPx>::new(0.5 * width as f64, 0.5 * height as f64);
    let Some((lon, lat)) = file.lon_lat(center) else { return Ok(()) };
    let (low, high) = rpc.height_range();
    let nearest = (0..=20)
        .map(|i| low + (high - low) * f64::from(i) / 20.0)
        .map(|h| rpc.project(crate::frame::Point::new(lon, lat, h)).distance(center.into()))
        .fold(f64::INFINITY, f64::min);
    if nearest <= OWN_GRID * width.max(height) as f64 {
        return Ok(());
    }
    Err(SceneError::Ortho { path: file.path().into(), distance_px: nearest })
}

/// A warning for a camera of another resolution than the metadata tell, or for a much larger image.
fn other_resolution(view: &View, told_gsd_m: Option<f64>) -> Option<String> {
    let c = view.rpc.coefficients();
    let (col, row) = view.gsd_m(c.height.offset)?;
    let gsd = (col * row).sqrt();
    if let Some(told) = told_gsd_m.filter(|t| gsd / t > GSD_FACTOR || t / gsd > GSD_FACTOR) {
        return Some(format!(
            "{}: its metadata tell of pixels of {told:.2} m, its camera makes them {gsd:.2} m; was the image \
             resampled without its RPC?",
            view.name
        ));
    }
    // The offsets of a whole image's model are its middle, its scales half its sides.
    let is_whole = |axis: crate::rpc::Axis| (axis.offset / axis.scale - 1.0).abs() < 0.25;
    let larger = |axis: crate::rpc::Axis, size: usize| 2.0 * axis.scale > 1.5 * size as f64;
    let is_other =
        is_whole(c.col) && is_whole(c.row) && larger(c.col, view.width) && larger(c.row, view.height);
    is_other.then(|| {
        format!(
            "{}: its RPC is for an image of about {:.0} x {:.0} pixels, this one has {} x {}; was it cropped or \
             resampled without its RPC?",
            view.name,
            2.0 * c.col.scale,
            2.0 * c.row.scale,
            view.width,
            view.height
        )
    })
}

/// A warning for a camera that looks from elsewhere than the metadata tell.
fn other_direction(view: &View, told_deg: Option<f64>) -> Option<String> {
    let (_, off_nadir) = view.direction_deg(view.rpc.center().height_m())?;
    let told = told_deg.filter(|told| (told - off_nadir).abs() > OFF_NADIR_DEG)?;
    Some(format!(
        "{}: its metadata tell of a view {told:.1}° off nadir, its camera looks {off_nadir:.1}° off; are they the same \
         image's?",
        view.name
    ))
}

/// Sun and date that the image file itself tells.
fn image_tags(file: &ImageFile) -> ViewTags {
    let number = |keys: &[&str]| {
        let text = keys.iter().find_map(|k| file.metadata(k, ""))?;
        text.trim().parse::<f64>().ok().filter(|v| v.is_finite())
    };
    let azimuth =
        number(&["SUN_AZIMUTH", "SATGS_SUN_AZIMUTH_DEG", "NITF_USE00A_SUN_AZ", "NITF_CSEXRA_SUN_AZIMUTH"]);
    let elevation = number(&[
        "SUN_ELEVATION",
        "SATGS_SUN_ELEVATION_DEG",
        "NITF_USE00A_SUN_EL",
        "NITF_CSEXRA_SUN_ELEVATION",
    ]);
    let dates = [("ACQUISITION_TIME", ""), ("ACQUISITIONDATETIME", "IMAGERY"), ("NITF_IDATIM", "")];
    ViewTags {
        sun_deg: azimuth.zip(elevation),
        acquired: dates
            .iter()
            .find_map(|(key, domain)| file.metadata(key, domain).and_then(|d| formats::iso_date(&d))),
        ..ViewTags::default()
    }
}
