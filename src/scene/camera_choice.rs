//! Choice of the RPC of an image among those that were found for it. All scene layouts use this module.
//!
//! An RPC of a larger image, of which the image is a crop, a tile or a NITF chip, is shifted if the offset is known. The
//! first RPC that fits the image is taken. If none fits, the error is the reason against the first one. `--trust-rpc`
//! takes the first RPC without these checks.

use super::map_fit::{MapFit, five_places, map_fit};
use super::sidecar::{Sidecars, Tile};
use super::{SceneError, chip};

use crate::io::ImageFile;
use crate::rpc::formats::{RpcFile, SAME_PX, ViewTags};
use crate::rpc::{Axis, Rpc};
use std::path::PathBuf;

/// Largest relative difference between scale and offset of an RPC that begins at the first pixel of its image.
const WHOLE: f64 = 0.25;
/// Largest relative difference of two scale factors that count as equal, and of a factor from a whole number.
const ONE_FACTOR: f64 = 0.02;
/// Factor by which an image must be larger than the validity volume of an RPC to be refused.
const LARGER: f64 = 1.5;
/// Largest whole factor of resampling that is recognised; for larger ones, every size is near to a multiple of another.
const MOST_TIMES: f64 = 8.5;
/// Tolerances for offsets at the centre of an image and for scales of half its size, as fractions of its size.
const CENTERED: f64 = 0.1;
const SPAN: f64 = 0.005;

/// Source of an RPC that GDAL found, in the image or in a sidecar.
pub(super) const READ_BY_GDAL: &str = "RPC read by GDAL";

/// An RPC that may belong to the image.
pub(super) struct Candidate {
    pub file: RpcFile,
    /// Where it was found, for messages: a file name, `RPC tag`.
    pub source: String,
    /// The sidecar file; `None` for an RPC in the image file.
    pub path: Option<PathBuf>,
}

/// The chosen RPC.
pub(super) struct Choice {
    pub rpc: Rpc,
    pub source: String,
    /// Metadata of its file, completed from the metadata files of the image.
    pub tags: ViewTags,
}

/// Content of the metadata files of an image and of the product of which it may be a tile.
pub(super) struct SidecarTags {
    /// Files of the image, each with its content.
    pub image: Vec<(PathBuf, ViewTags)>,
    /// Files of the product.
    pub product: Vec<(PathBuf, ViewTags)>,
}

/// Chooses the first RPC that fits the image; the candidates are in order of preference. `None` if there are none.
///
/// # Errors
/// The reason against the first candidate if none fits.
pub(super) fn choose(
    image: &ImageFile,
    candidates: Vec<Candidate>,
    sidecars: &Sidecars,
    stated: &SidecarTags,
    trust_rpc: bool,
    warnings: &mut Vec<String>,
) -> Result<Option<Choice>, SceneError> {
    let candidates = without_repeats(candidates, image.size());
    let own = candidates.iter().find(|c| c.path.is_none()).map(|c| c.file.rpc.clone());
    let mut rejected: Option<(String, SceneError)> = None;
    let mut taken: Option<(Candidate, Rpc)> = None;
    for candidate in candidates {
        let of_product = candidate.path.as_ref().is_some_and(|p| sidecars.of_product.contains(p));
        let mut notes = Vec::new();
        let tile = sidecars.tile.filter(|_| of_product);
        let moved = moved(image, &candidate, own.as_ref(), tile, sidecars, stated, &mut notes);
        let fits = match moved {
            Ok(rpc) if trust_rpc => Ok(rpc),
            Ok(rpc) => {
                check(image, &candidate, &rpc, tile.is_some(), stated, sidecars, &mut notes).map(|()| rpc)
            }
            Err(_) if trust_rpc => Ok(candidate.file.rpc.clone()),
            Err(e) => Err(e),
        };
        match (fits, &taken) {
            (Ok(rpc), None) => {
                if let Some((source, error)) = rejected.take() {
                    warnings.push(format!(
                        "`{}`: {source} is not for this image ({error}); {} is used",
                        image.path().display(),
                        candidate.source
                    ));
                }
                warnings.append(&mut notes);
                taken = Some((candidate, rpc));
            }
            (Ok(rpc), Some((first, chosen))) => {
                let distance = distance_px(chosen, &rpc, image.size());
                if distance > SAME_PX {
                    warnings.push(format!(
                        "`{}`: its {} and {from} differ by {distance:.1} px; {from} is used",
                        image.path().display(),
                        candidate.source,
                        from = first.source,
                    ));
                }
            }
            (Err(e), None) if rejected.is_none() => rejected = Some((candidate.source, e)),
            // Further RPCs that do not fit, such as that of the whole image, are ignored.
            (Err(_), _) => {}
        }
    }
    let Some((mut chosen, rpc)) = taken else {
        return rejected.map_or(Ok(None), |(_, error)| Err(error));
    };
    warnings.append(&mut chosen.file.warnings);
    let tags =
        stated.image.iter().chain(&stated.product).fold(chosen.file.tags, |t, (_, more)| t.or(more.clone()));
    Ok(Some(Choice { rpc, source: chosen.source, tags }))
}

/// Removes the RPC that GDAL found if it is that of one of the sidecars, which is a candidate already.
fn without_repeats(mut candidates: Vec<Candidate>, size: (usize, usize)) -> Vec<Candidate> {
    let beside: Vec<Rpc> =
        candidates.iter().filter(|c| c.path.is_some()).map(|c| c.file.rpc.clone()).collect();
    let repeats = |rpc: &Rpc| beside.iter().any(|b| distance_px(b, rpc, size) <= SAME_PX);
    candidates.retain(|c| c.source != READ_BY_GDAL || !repeats(&c.file.rpc));
    candidates
}

/// The camera of the image, from a candidate that may be that of a larger image.
fn moved(
    image: &ImageFile,
    candidate: &Candidate,
    own: Option<&Rpc>,
    tile: Option<Tile>,
    sidecars: &Sidecars,
    stated: &SidecarTags,
    notes: &mut Vec<String>,
) -> Result<Rpc, SceneError> {
    let rpc = &candidate.file.rpc;
    if let Some(tile) = tile {
        let product =
            stated.product.iter().fold(candidate.file.tags.clone(), |t, (_, more)| t.or(more.clone()));
        return tile.camera(image.path(), rpc, &product, sidecars.til.as_deref(), notes);
    }
    // A sidecar with the same RPC as the segment belongs to the full image too.
    let repeats = |own: &Rpc| distance_px(own, rpc, image.size()) <= SAME_PX;
    let is_full = candidate.path.is_none() || own.is_some_and(repeats);
    let chip = if is_full { chip::ichipb(image)? } else { None };
    if let Some((col, row)) = chip {
        notes.push(format!(
            "`{}` is a chip that begins at column {col}, row {row} of the full image (ICHIPB): {} is shifted by this offset",
            image.path().display(),
            candidate.source
        ));
        return Ok(rpc.shifted(-col, -row));
    }
    if let Some((col, row)) = chip::counted_from_whole(image, &candidate.file) {
        notes.push(format!(
            "`{}` begins at column {col}, row {row} of the whole image, according to its geotransform: {} is shifted by this offset",
            image.path().display(),
            candidate.source
        ));
        return Ok(rpc.shifted(-col, -row));
    }
    Ok(rpc.clone())
}

/// Returns an error if a camera does not belong to the image; adds warnings to `notes`.
fn check(
    image: &ImageFile,
    candidate: &Candidate,
    rpc: &Rpc,
    is_tile: bool,
    stated: &SidecarTags,
    sidecars: &Sidecars,
    notes: &mut Vec<String>,
) -> Result<(), SceneError> {
    let size = image.size();
    let stated_size = stated_size(candidate, stated, sidecars);
    // The offset of tiles and crops in the whole image is applied already.
    let tiles = stated.product.iter().find_map(|(_, tags)| tags.tiles).or(candidate.file.tags.tiles);
    let is_part = is_tile && tiles.is_none_or(|t| t.across.saturating_mul(t.down) > 1);
    let is_moved = is_part || *rpc != candidate.file.rpc;
    let is_stated = stated_size.as_ref().is_some_and(|(stated, _)| *stated == size);
    match map_fit(image, rpc) {
        MapFit::NoMap | MapFit::OwnGrid => {}
        MapFit::Other { distance_px, is_near } => {
            if !(is_near && (is_stated || spans(rpc, size))) {
                return Err(SceneError::Ortho { path: image.path().into(), distance_px });
            }
            notes.push(format!(
                "`{}`: its map position and its {} differ by {distance_px:.0} px; the RPC is used, because it has the \
                 size of the image",
                image.path().display(),
                candidate.source
            ));
        }
    }
    if let Some(((width, height), by)) = stated_size.filter(|(stated, _)| *stated != size && !is_moved) {
        let is_whole = spans_about(rpc, (width, height));
        // The RPC in a crop may have been shifted with it, while the metadata are still those of the whole image.
        if candidate.path.is_some() || is_whole {
            return Err(SceneError::OtherSize {
                rpc: by,
                image: image.path().into(),
                expected_width: width,
                expected_height: height,
                width: size.0,
                height: size.1,
            });
        }
        notes.push(format!(
            "`{}` is for an image of {width} x {height} pixels, `{}` has {} x {} and is taken for a part of it; its {} is used",
            by.display(),
            image.path().display(),
            size.0,
            size.1,
            candidate.source
        ));
    }
    if !is_stated && !is_moved {
        refuse_other_scale(image, candidate, rpc)?;
    }
    Ok(())
}

/// The image size that the files of a candidate state, and the file that states it.
fn stated_size(
    candidate: &Candidate,
    stated: &SidecarTags,
    sidecars: &Sidecars,
) -> Option<((usize, usize), PathBuf)> {
    if let (Some(path), Some(size)) = (&candidate.path, candidate.file.tags.size) {
        return Some((size, path.clone()));
    }
    // The size of the product is not that of a tile with a camera of its own.
    let of_product = candidate.path.as_ref().is_some_and(|p| sidecars.of_product.contains(p));
    let product: &[_] = if sidecars.is_tile_by_name && !of_product { &[] } else { &stated.product };
    stated.image.iter().chain(product).find_map(|(path, tags)| Some((tags.size?, path.clone())))
}

/// Returns an error for an image that is larger than the validity volume of its RPC, or smaller by the same whole factor
/// along both axes, as an image of another resolution is.
fn refuse_other_scale(image: &ImageFile, candidate: &Candidate, rpc: &Rpc) -> Result<(), SceneError> {
    let (width, height) = image.size();
    let c = rpc.coefficients();
    let is_whole = |axis: Axis| (axis.offset / axis.scale - 1.0).abs() < WHOLE;
    if !is_whole(c.col) || !is_whole(c.row) {
        return Ok(());
    }
    let (across, down) = (width as f64 / (2.0 * c.col.scale), height as f64 / (2.0 * c.row.scale));
    let is_one = (across / down - 1.0).abs() < ONE_FACTOR;
    let times = (across * down).sqrt().recip();
    let is_times = (LARGER..MOST_TIMES).contains(&times) && (times / times.round() - 1.0).abs() < ONE_FACTOR;
    if !is_one || !(across.min(down) > LARGER || is_times) {
        return Ok(());
    }
    Err(SceneError::OtherScale {
        image: image.path().into(),
        source_file: candidate.source.clone(),
        expected_width: 2.0 * c.col.scale,
        expected_height: 2.0 * c.row.scale,
        width,
        height,
    })
}

/// Whether offsets and scales of an RPC are those of an image of this size.
fn spans(rpc: &Rpc, (width, height): (usize, usize)) -> bool {
    let c = rpc.coefficients();
    let own = |axis: Axis, size: usize| {
        let size = size as f64;
        (2.0 * axis.scale.abs() - size).abs() <= 1.0 + SPAN * size
            && (axis.offset - 0.5 * size).abs() <= CENTERED * size
    };
    own(c.col, width) && own(c.row, height)
}

/// Whether the offsets of an RPC are those of an image of this size; its scales may include a margin.
fn spans_about(rpc: &Rpc, (width, height): (usize, usize)) -> bool {
    let c = rpc.coefficients();
    let own = |axis: Axis, size: usize| (axis.offset - 0.5 * size as f64).abs() <= CENTERED * size as f64;
    own(c.col, width) && own(c.row, height)
}

/// Largest distance between the projections of the ground under the corners and the centre of an image by two cameras,
/// pixels.
pub(super) fn distance_px(a: &Rpc, b: &Rpc, size: (usize, usize)) -> f64 {
    let apart = five_places(size).map(|corner| {
        let px = corner.into();
        a.localize(px, a.center().height_m()).map_or(f64::INFINITY, |p| b.project(p).distance(px))
    });
    // `f64::max` ignores NaN.
    apart.into_iter().map(|d| if d.is_nan() { f64::INFINITY } else { d }).fold(0.0, f64::max)
}

impl SidecarTags {
    /// Reads the metadata files; a damaged one gives a warning.
    pub(super) fn read(sidecars: &Sidecars, warnings: &mut Vec<String>) -> Self {
        let mut read = |files: &[PathBuf]| {
            let tags = |path: &PathBuf| match crate::rpc::formats::read_tags(path) {
                Ok(tags) => Some((path.clone(), tags)),
                Err(e) => {
                    warnings.push(e.to_string());
                    None
                }
            };
            files.iter().filter_map(tags).collect()
        };
        Self { image: read(&sidecars.metadata), product: read(&sidecars.product_metadata) }
    }
}
