//! Reading of one view: the image file, the RPCs in and beside it, its sun and date.

use super::camera_choice::{Candidate, READ_BY_GDAL, SidecarTags, choose};
use super::files::{file_name, has_extension, read_text, stem};
use super::sidecar::{Sidecars, likely_names};
use super::{Role, SceneError, Sun, View};
use crate::io::{ImageFile, vsi};
use crate::rpc::formats::{self, FormatError, RpcFile, ViewTags};
use std::path::{Path, PathBuf};

/// File name extensions of images, in lower case.
const IMAGES: [&str; 8] = ["tif", "tiff", "ntf", "nitf", "nsf", "jp2", "j2k", "vrt"];
/// File name extensions of rasters that are views only if they hold an RPC: ENVI, PCIDSK, PNG, Erdas Imagine, raw.
const OTHER_RASTERS: [&str; 8] = ["dat", "pix", "png", "img", "bil", "bip", "bsq", "jpg"];
/// Largest factor between the stated GSD and that of the camera at the middle height without a warning.
const GSD_FACTOR: f64 = 1.35;
/// Largest difference between the stated off-nadir angle and that of the camera without a warning, degrees; it allows for
/// the variation within an image.
const OFF_NADIR_DEG: f64 = 5.0;

/// Images of a folder, ordered by name; hidden files do not count.
pub(super) fn images_in(folder: &Path) -> Result<Vec<PathBuf>, SceneError> {
    let mut found: Vec<PathBuf> = files_in(folder)?
        .into_iter()
        .filter(|p| has_extension(p, &IMAGES) && !is_folder(p) && !is_companion(p))
        .collect();
    found.sort();
    Ok(found)
}

/// Files and folders in a folder; hidden ones are left out.
pub(super) fn files_in(folder: &Path) -> Result<Vec<PathBuf>, SceneError> {
    vsi::list(folder).map_err(|cause| SceneError::Unreadable { path: folder.into(), cause })
}

/// Files in the folder of an image; those with its sidecars' names if a virtual folder cannot be listed.
pub(super) fn files_beside(image: &Path) -> Result<Vec<PathBuf>, SceneError> {
    let folder = image.parent().unwrap_or(Path::new(".")).to_path_buf();
    vsi::files_beside(image, &likely_names(image))
        .map_err(|cause| SceneError::Unreadable { path: folder, cause })
}

/// Whether a path with the extension of an image is a local folder. Virtual ones are not asked, each would be a request.
fn is_folder(path: &Path) -> bool {
    !vsi::is_virtual(path) && path.is_dir()
}

/// Paths of the source images of a virtual raster (VRT), as it states them; empty for any other file.
#[must_use]
pub fn sources_of(image: &Path) -> Vec<PathBuf> {
    if !has_extension(image, &["vrt"]) {
        return Vec::new();
    }
    let Ok(text) = read_text(image) else { return Vec::new() };
    let Ok(document) = roxmltree::Document::parse(&text) else { return Vec::new() };
    let folder = image.parent().unwrap_or(Path::new("."));
    let named =
        document.descendants().filter(|n| ["SourceFilename", "SourceDataset"].contains(&n.tag_name().name()));
    let mut found: Vec<PathBuf> =
        named.filter_map(|n| Some(vsi::join(folder, n.text()?.trim().as_ref()))).collect();
    found.sort();
    found.dedup();
    found
}

/// Whether a raster describes another one, as Planet's `udm` and `udm2` masks do, and is not an image itself.
pub(super) fn is_companion(path: &Path) -> bool {
    let name = stem(path).to_lowercase();
    name.ends_with("_udm") || name.ends_with("_udm2") || name.contains("_udm2_") || name.contains("_udm_")
}

/// Rasters of a listing in formats that are not searched for views.
pub(super) fn other_rasters(listing: &[PathBuf]) -> impl Iterator<Item = &PathBuf> {
    listing.iter().filter(|p| has_extension(p, &OTHER_RASTERS) && !is_folder(p))
}

/// Reads the view of an image, with the RPC in or beside it that fits it; `None` if there is no RPC.
///
/// Warnings are added to `warnings`.
pub(super) fn view(
    image: &Path,
    sidecars: &Sidecars,
    trust_rpc: bool,
    warnings: &mut Vec<String>,
) -> Result<Option<View>, SceneError> {
    let file = ImageFile::open(image)?;
    file.check_complete()?;
    if file.is_palette(1) {
        return Err(SceneError::Palette { image: image.into() });
    }
    let size = file.size();
    let candidates = cameras(&file, sidecars)?;
    if candidates.is_empty() {
        return Ok(None);
    }
    let stated = SidecarTags::read(sidecars, warnings);
    let Some(chosen) = choose(&file, candidates, sidecars, &stated, trust_rpc, warnings)? else {
        return Ok(None);
    };
    let tags = chosen.tags.or(image_tags(&file));
    let view = View {
        name: stem(image),
        image: image.into(),
        width: size.0,
        height: size.1,
        window: None,
        bands: file.default_bands(),
        stretch_percent: None,
        stretch: None,
        mask: None,
        nodata: tags.nodata,
        rpc: chosen.rpc,
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

/// Reads the camera of an RPC file, or of an image with its sidecars. `trust_rpc` takes the first RPC found without
/// checking that it belongs to the image.
///
/// # Errors
/// [`SceneError`], naming the file, if it cannot be read, or no RPC belongs to the image.
pub fn read_camera(path: &Path, trust_rpc: bool) -> Result<RpcFile, SceneError> {
    if !is_image(path) {
        return Ok(formats::read(path)?);
    }
    let mut warnings = Vec::new();
    let sidecars = Sidecars::of(path, &files_beside(path)?);
    let view = view(path, &sidecars, trust_rpc, &mut warnings)?.ok_or_else(|| no_rpc(path))?;
    Ok(RpcFile { tags: view.tags(), rpc: view.rpc, format: "image", warnings })
}

/// Whether a file is an image: a binary file or a NITF, whose header is text. RPC files are text.
pub(super) fn is_image(path: &Path) -> bool {
    use std::io::Read;
    let mut head = Vec::new();
    let read = vsi::open(path).and_then(|f| f.take(512).read_to_end(&mut head));
    let is_utf16 = head.starts_with(&[0xff, 0xfe]) || head.starts_with(&[0xfe, 0xff]);
    read.is_ok() && (head.contains(&0) && !is_utf16 || head.starts_with(b"NITF") || head.starts_with(b"NSIF"))
}

/// The error for an image without an RPC.
pub(super) fn no_rpc(image: &Path) -> SceneError {
    let is_map = ImageFile::open(image).is_ok_and(|f| f.is_map());
    let what = if is_map { "; it has a map projection, as an orthorectified product has" } else { "" };
    SceneError::NoRpc { path: image.into(), what }
}

/// RPCs of an image in order of preference: sidecars in their order, then the RPC in the file. The RPC in a virtual
/// raster comes before its sidecars, which are those of its source.
///
/// An error in the most preferred file is returned; damaged files after a valid one are ignored.
fn cameras(file: &ImageFile, sidecars: &Sidecars) -> Result<Vec<Candidate>, FormatError> {
    let mut found = Vec::new();
    let is_virtual = has_extension(file.path(), &["vrt"]);
    if is_virtual && !sidecars.is_chosen {
        found.extend(own_camera(file)?);
    }
    for path in &sidecars.cameras {
        match formats::read(path) {
            Ok(read) => {
                found.push(Candidate { file: read, source: file_name(path), path: Some(path.clone()) })
            }
            Err(e) if found.is_empty() => return Err(e),
            Err(_) => {}
        }
    }
    if sidecars.is_chosen || is_virtual {
        return Ok(found);
    }
    match own_camera(file) {
        Ok(own) => found.extend(own),
        Err(e) if found.is_empty() => return Err(e),
        Err(_) => {}
    }
    Ok(found)
}

/// The RPC in an image file: from the TIFF tag with all bits, otherwise as GDAL reads it.
fn own_camera(file: &ImageFile) -> Result<Option<Candidate>, FormatError> {
    let path = file.path();
    let camera =
        |rpc, source: &str| Candidate { file: RpcFile::new(rpc, "GDAL"), source: source.into(), path: None };
    if let Some(rpc) = formats::from_tiff(path)? {
        return Ok(Some(camera(rpc, "RPC tag")));
    }
    // GDAL reads RPC00A too, but whether it reorders the terms is not known.
    if file.metadata("RPC00A", "TRE").is_some() {
        return Err(FormatError::Rpc00a { file: path.into() });
    }
    let source = if file.metadata("RPC00B", "TRE").is_some() { "RPC00B segment" } else { READ_BY_GDAL };
    Ok(formats::from_gdal(path, &file.metadata_domain("RPC"))?.map(|rpc| camera(rpc, source)))
}

/// A warning if the GSD of the camera is not the stated one, or the camera is that of a much larger image.
fn other_resolution(view: &View, stated_gsd_m: Option<f64>) -> Option<String> {
    let c = view.rpc.coefficients();
    let (col, row) = view.gsd_m(c.height.offset)?;
    let gsd = (col * row).sqrt();
    if let Some(stated) = stated_gsd_m.filter(|t| gsd / t > GSD_FACTOR || t / gsd > GSD_FACTOR) {
        return Some(format!(
            "{}: its metadata state a GSD of {stated:.2} m, that of its camera is {gsd:.2} m; was the image \
             resampled without its RPC?",
            view.name
        ));
    }
    // The offsets of an RPC of a whole image are near to its centre, the scales near to half its sides.
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

/// A warning if the off-nadir angle of the camera is not the stated one.
fn other_direction(view: &View, stated_deg: Option<f64>) -> Option<String> {
    let (_, off_nadir) = view.direction_deg(view.rpc.center().height_m())?;
    let stated = stated_deg.filter(|stated| (stated - off_nadir).abs() > OFF_NADIR_DEG)?;
    Some(format!(
        "{}: its metadata state an off-nadir angle of {stated:.1}°, that of its camera is {off_nadir:.1}°; do both belong \
         to this image?",
        view.name
    ))
}

/// Sun and date in the metadata of the image file.
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
