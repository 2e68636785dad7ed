//! One image of a scene: the file, the cameras found in and beside it, its sun and date.

use super::{Role, SceneError, Sun, View};
use crate::frame::{CornerPx, Pixel};
use crate::raster::ImageFile;
use crate::rpc::Rpc;
use crate::rpc::formats::{self, RpcFile, ViewTags};
use std::path::{Path, PathBuf};

/// Extensions of images, in lower case.
const IMAGES: [&str; 6] = ["tif", "tiff", "ntf", "nitf", "jp2", "j2k"];
/// Endings of RPC files beside NAME, in the order in which they are preferred.
const SIDECARS: [&str; 6] = ["_rpc.txt", ".rpc.txt", ".rpc", "_rpc.json", ".json", ".txt"];
/// Two RPCs of one image that differ by less are the same, rounded differently.
const SAME_PX: f64 = 0.1;

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

/// The RPC file of `name` in a listing, the most preferred first.
pub(super) fn sidecar_of(name: &str, listing: &[PathBuf]) -> Option<PathBuf> {
    let wanted = name.to_lowercase();
    let ending = |p: &Path| {
        let file = p.file_name()?.to_string_lossy().to_lowercase();
        let ending = file.strip_prefix(&wanted)?.to_owned();
        SIDECARS.iter().position(|s| *s == ending)
    };
    listing.iter().filter_map(|p| Some((ending(p)?, p))).min().map(|(_, p)| p.clone())
}

/// Reads an image's view with the cameras in and beside it; the RPC file, if one is given, wins.
///
/// None when there is no camera; warnings are added to `warnings`.
pub(super) fn view(
    image: &Path,
    sidecar: Option<&Path>,
    warnings: &mut Vec<String>,
) -> Result<Option<View>, SceneError> {
    let file = ImageFile::open(image)?;
    file.check_complete()?;
    let size = file.size();
    let Some(camera) = camera(&file, sidecar, warnings)? else { return Ok(None) };
    if let Some(told) = camera.file.tags.size.filter(|told| *told != size) {
        return Err(SceneError::OtherSize {
            rpc: sidecar.unwrap_or(image).into(),
            image: image.into(),
            told_width: told.0,
            told_height: told.1,
            width: size.0,
            height: size.1,
        });
    }
    let tags = camera.file.tags;
    let own = image_tags(&file);
    let sun = tags.sun_deg.or(own.sun_deg);
    Ok(Some(View {
        name: stem(image),
        image: image.into(),
        width: size.0,
        height: size.1,
        rpc: camera.file.rpc,
        rpc_source: camera.source,
        sun: sun.map(|(azimuth_deg, elevation_deg)| Sun { azimuth_deg, elevation_deg }),
        acquired: tags.acquired.or(own.acquired),
        role: Role::Train,
        height_range: tags.height_range,
    }))
}

/// The error for an image without a camera.
pub(super) fn no_rpc(image: &Path) -> SceneError {
    let is_map = ImageFile::open(image).is_ok_and(|f| f.has_geotransform());
    let what = if is_map { "; it has a map projection, as an ortho product" } else { "" };
    SceneError::NoRpc { path: image.into(), what }
}

fn camera(
    file: &ImageFile,
    sidecar: Option<&Path>,
    warnings: &mut Vec<String>,
) -> Result<Option<Camera>, SceneError> {
    let image = file.path();
    let untagged = |rpc| RpcFile { rpc, tags: ViewTags::default() };
    let chosen = match sidecar {
        Some(path) => {
            let name = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
            Some(Camera { file: formats::read(path)?, source: name })
        }
        None => {
            let domain = file.metadata_domain("RPC");
            let source =
                if domain == file.own_metadata_domain("RPC") { "RPC tag" } else { "sidecar read by GDAL" };
            formats::from_gdal(image, &domain)?
                .map(|rpc| Camera { file: untagged(rpc), source: source.into() })
        }
    };
    let Some(chosen) = chosen else { return Ok(None) };
    // A broken tag under a good sidecar is nobody's problem.
    if chosen.source != "RPC tag"
        && let Ok(Some(own)) = formats::from_gdal(image, &file.own_metadata_domain("RPC"))
    {
        let distance = distance_px(&chosen.file.rpc, &own, file.size());
        if distance > SAME_PX {
            warnings.push(format!(
                "`{}`: its RPC tag and {from} differ by {distance:.1} px; {from} is used",
                image.display(),
                from = chosen.source,
            ));
        }
    }
    Ok(Some(chosen))
}

/// How far apart two cameras see the ground under an image's corners and centre, at most.
pub(super) fn distance_px(a: &Rpc, b: &Rpc, (width, height): (usize, usize)) -> f64 {
    let (w, h) = (width as f64, height as f64);
    let places = [(0.0, 0.0), (w, 0.0), (0.0, h), (w, h), (0.5 * w, 0.5 * h)];
    let apart = places.map(|(col, row)| {
        let px = Pixel::<CornerPx>::new(col, row).into();
        a.localize(px, a.center().height_m()).map_or(f64::INFINITY, |p| b.project(p).distance(px))
    });
    apart.into_iter().fold(0.0, f64::max)
}

/// Sun and date that the image file itself tells.
fn image_tags(file: &ImageFile) -> ViewTags {
    let number = |keys: &[&str]| {
        let text = keys.iter().find_map(|k| file.metadata(k, ""))?;
        text.trim().parse::<f64>().ok().filter(|v| v.is_finite())
    };
    let azimuth = number(&["SUN_AZIMUTH", "SATGS_SUN_AZIMUTH_DEG", "NITF_USE00A_SUN_AZ"]);
    let elevation = number(&["SUN_ELEVATION", "SATGS_SUN_ELEVATION_DEG", "NITF_USE00A_SUN_EL"]);
    let dates = [("ACQUISITION_TIME", ""), ("ACQUISITIONDATETIME", "IMAGERY"), ("NITF_IDATIM", "")];
    ViewTags {
        sun_deg: azimuth.zip(elevation),
        acquired: dates
            .iter()
            .find_map(|(key, domain)| file.metadata(key, domain).and_then(|d| formats::iso_date(&d))),
        ..ViewTags::default()
    }
}
