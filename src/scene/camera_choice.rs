//! Which of the RPCs found for an image is its own: the one place that decides it, whatever lists the image.
//!
//! An RPC that is for more than the image (a whole image beside its crop, tile or NITF chip) is moved to the image
//! where the offset is told. Of several the first that fits is taken; when none fits, what speaks against the first is
//! the error. `--trust-rpc` takes the first as it is.

use super::map_fit::{MapFit, five_places, map_fit};
use super::sidecar::{Sidecars, Tile};
use super::{SceneError, chip};

use crate::io::ImageFile;
use crate::rpc::formats::{RpcFile, SAME_PX, ViewTags};
use crate::rpc::{Axis, Rpc};
use std::path::PathBuf;

/// An RPC whose scales and offsets agree to this share is that of a whole image: it begins at the first pixel.
const WHOLE: f64 = 0.25;
/// Factors of the two axes that agree to this share are one factor, and a factor this near a whole number is one.
const ONE_FACTOR: f64 = 0.02;
/// No RPC's volume is smaller than its image by this factor: outside it cubic polynomials run away.
const LARGER: f64 = 1.5;
/// Images are scaled by whole numbers up to this; beyond, every size is near a whole part of another.
const MOST_TIMES: f64 = 8.5;
/// Offsets this near the centre of an image, as a share of its size, and scales this near half of it are its own.
const CENTERED: f64 = 0.1;
const SPAN: f64 = 0.005;

/// Source of an RPC that GDAL shows as the image's, wherever it found it.
pub(super) const READ_BY_GDAL: &str = "RPC read by GDAL";

/// An RPC that may be the image's.
pub(super) struct Candidate {
    pub file: RpcFile,
    /// Where it was found, as a user would name it.
    pub source: String,
    /// The sidecar; none for what the image itself holds.
    pub path: Option<PathBuf>,
}

/// The RPC that was taken.
pub(super) struct Choice {
    pub rpc: Rpc,
    pub source: String,
    /// What its file tells, and the image's metadata files.
    pub tags: ViewTags,
}

/// What metadata files tell about the image and about the product of which it may be a tile.
pub(super) struct Told {
    /// Of files named as the image, each with its tags.
    pub image: Vec<(PathBuf, ViewTags)>,
    /// Of files named as the product.
    pub product: Vec<(PathBuf, ViewTags)>,
}

/// Takes the RPC that fits the image, from those found in order of preference; none without any.
///
/// # Errors
/// What speaks against the first when none fits.
pub(super) fn choose(
    image: &ImageFile,
    candidates: Vec<Candidate>,
    sidecars: &Sidecars,
    told: &Told,
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
        let moved = moved(image, &candidate, own.as_ref(), tile, sidecars, told, &mut notes);
        let fits = match moved {
            Ok(rpc) if trust_rpc => Ok(rpc),
            Ok(rpc) => {
                check(image, &candidate, &rpc, tile.is_some(), told, sidecars, &mut notes).map(|()| rpc)
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
            // What does not fit beside one that does is the whole image's, a twin's: nobody's problem.
            (Err(_), _) => {}
        }
    }
    let Some((mut chosen, rpc)) = taken else {
        return rejected.map_or(Ok(None), |(_, error)| Err(error));
    };
    warnings.append(&mut chosen.file.warnings);
    let tags =
        told.image.iter().chain(&told.product).fold(chosen.file.tags, |t, (_, more)| t.or(more.clone()));
    Ok(Some(Choice { rpc, source: chosen.source, tags }))
}

/// Leaves out what GDAL reads in the image's name if it is one of the sidecars: refused as that, it is not right as this.
fn without_repeats(mut candidates: Vec<Candidate>, size: (usize, usize)) -> Vec<Candidate> {
    let beside: Vec<Rpc> =
        candidates.iter().filter(|c| c.path.is_some()).map(|c| c.file.rpc.clone()).collect();
    let repeats = |rpc: &Rpc| beside.iter().any(|b| distance_px(b, rpc, size) <= SAME_PX);
    candidates.retain(|c| c.source != READ_BY_GDAL || !repeats(&c.file.rpc));
    candidates
}

/// The camera of the image, from one that may be for the image of which it is a part.
fn moved(
    image: &ImageFile,
    candidate: &Candidate,
    own: Option<&Rpc>,
    tile: Option<Tile>,
    sidecars: &Sidecars,
    told: &Told,
    notes: &mut Vec<String>,
) -> Result<Rpc, SceneError> {
    let rpc = &candidate.file.rpc;
    if let Some(tile) = tile {
        let product =
            told.product.iter().fold(candidate.file.tags.clone(), |t, (_, more)| t.or(more.clone()));
        return tile.camera(image.path(), rpc, &product, sidecars.til.as_deref(), notes);
    }
    // A sidecar that repeats the segment is for the whole image as well.
    let repeats = |own: &Rpc| distance_px(own, rpc, image.size()) <= SAME_PX;
    let is_full = candidate.path.is_none() || own.is_some_and(repeats);
    let chip = if is_full { chip::ichipb(image)? } else { None };
    if let Some((col, row)) = chip {
        notes.push(format!(
            "`{}` is a chip that begins at column {col}, row {row} of the full image (ICHIPB): {} is moved there",
            image.path().display(),
            candidate.source
        ));
        return Ok(rpc.shifted(-col, -row));
    }
    if let Some((col, row)) = chip::counted_from_whole(image, &candidate.file) {
        notes.push(format!(
            "`{}` begins at column {col}, row {row} of the whole image by its geotransform: {} is moved there",
            image.path().display(),
            candidate.source
        ));
        return Ok(rpc.shifted(-col, -row));
    }
    Ok(rpc.clone())
}

/// What speaks against a camera, as an error; what is only odd is added to `notes`.
fn check(
    image: &ImageFile,
    candidate: &Candidate,
    rpc: &Rpc,
    is_tile: bool,
    told: &Told,
    sidecars: &Sidecars,
    notes: &mut Vec<String>,
) -> Result<(), SceneError> {
    let size = image.size();
    let told_size = told_size(candidate, told, sidecars);
    // Tiles and crops that were moved know their place in the whole already.
    let tiles = told.product.iter().find_map(|(_, tags)| tags.tiles).or(candidate.file.tags.tiles);
    let is_part = is_tile && tiles.is_none_or(|t| t.across.saturating_mul(t.down) > 1);
    let is_moved = is_part || *rpc != candidate.file.rpc;
    let is_told = told_size.as_ref().is_some_and(|(told, _)| *told == size);
    match map_fit(image, rpc) {
        MapFit::NoMap | MapFit::OwnGrid => {}
        MapFit::Other { distance_px, is_near } => {
            if !(is_near && (is_told || spans(rpc, size))) {
                return Err(SceneError::Ortho { path: image.path().into(), distance_px });
            }
            notes.push(format!(
                "`{}`: its place on the map is {distance_px:.0} px off where its {} sees it, which has the image's size: \
                 the RPC counts",
                image.path().display(),
                candidate.source
            ));
        }
    }
    if let Some(((width, height), by)) = told_size.filter(|(told, _)| *told != size && !is_moved) {
        let is_whole = spans_about(rpc, (width, height));
        // An image's own RPC that was moved with the crop is right beside the whole image's metadata.
        if candidate.path.is_some() || is_whole {
            return Err(SceneError::OtherSize {
                rpc: by,
                image: image.path().into(),
                told_width: width,
                told_height: height,
                width: size.0,
                height: size.1,
            });
        }
        notes.push(format!(
            "`{}` is for an image of {width} x {height} pixels, `{}` has {} x {}: taken for a part of it, its {} counts",
            by.display(),
            image.path().display(),
            size.0,
            size.1,
            candidate.source
        ));
    }
    if !is_told && !is_moved {
        refuse_other_scale(image, candidate, rpc)?;
    }
    Ok(())
}

/// The size that the files of a candidate tell, and the file.
fn told_size(candidate: &Candidate, told: &Told, sidecars: &Sidecars) -> Option<((usize, usize), PathBuf)> {
    if let (Some(path), Some(size)) = (&candidate.path, candidate.file.tags.size) {
        return Some((size, path.clone()));
    }
    // The product's size says nothing of a tile whose camera is its own.
    let of_product = candidate.path.as_ref().is_some_and(|p| sidecars.of_product.contains(p));
    let product: &[_] = if sidecars.is_tile_by_name && !of_product { &[] } else { &told.product };
    told.image.iter().chain(product).find_map(|(path, tags)| Some((tags.size?, path.clone())))
}

/// Refuses an image that is larger than all of its RPC's volume, or as many times smaller in both axes as the one of
/// another resolution is.
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
        told_width: 2.0 * c.col.scale,
        told_height: 2.0 * c.row.scale,
        width,
        height,
    })
}

/// Whether an RPC's volume is that of an image of this size, to a few thousandths.
fn spans(rpc: &Rpc, (width, height): (usize, usize)) -> bool {
    let c = rpc.coefficients();
    let own = |axis: Axis, size: usize| {
        let size = size as f64;
        (2.0 * axis.scale.abs() - size).abs() <= 1.0 + SPAN * size
            && (axis.offset - 0.5 * size).abs() <= CENTERED * size
    };
    own(c.col, width) && own(c.row, height)
}

/// As [`spans`], of scales that may have a margin.
fn spans_about(rpc: &Rpc, (width, height): (usize, usize)) -> bool {
    let c = rpc.coefficients();
    let own = |axis: Axis, size: usize| (axis.offset - 0.5 * size as f64).abs() <= CENTERED * size as f64;
    own(c.col, width) && own(c.row, height)
}

/// How far apart two cameras see the ground under an image's corners and centre, at most.
pub(super) fn distance_px(a: &Rpc, b: &Rpc, size: (usize, usize)) -> f64 {
    let apart = five_places(size).map(|corner| {
        let px = corner.into();
        a.localize(px, a.center().height_m()).map_or(f64::INFINITY, |p| b.project(p).distance(px))
    });
    // `f64::max` passes NaN over.
    apart.into_iter().map(|d| if d.is_nan() { f64::INFINITY } else { d }).fold(0.0, f64::max)
}

impl Told {
    /// Reads the metadata files; one that is broken costs only what it tells.
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
