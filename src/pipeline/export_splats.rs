//! The splats of a run as one file: `satgs export --ply`, `--compressed-ply`, `--spz`, `--gltf`.

use super::exported::ExportedSplats;
use super::run_folder::perspective_manifest;
use super::{PerspectiveCameras, PipelineError, TrainedCameras, relocation};
use crate::export::{
    Axes, ExportError, GltfCompression, GltfScene, PlyVariant, compressed_ply, splat_gltf, spz,
};
use crate::frame::SiteGrid;
use crate::io::{check_writable, read_json, remove_if_there, write_file, write_json};
use crate::run_files::SPLATS;
use crate::splat::splats::Splats;
use serde_json::Value;
use std::path::Path;

/// Endings of files beside which a georeference may lie.
const ENDINGS: [&str; 4] = ["ply", "spz", "glb", "obj"];

/// A form in which splats are exported as one file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SplatExport {
    /// PLY of 3DGS.
    Ply(PlyVariant),
    /// Compressed PLY of PlayCanvas, in the axes of a variant.
    CompressedPly(PlyVariant),
    /// SPZ.
    Spz,
    /// Binary glTF.
    Gltf {
        /// How the splats are held.
        compression: GltfCompression,
        /// To whom they are credited.
        copyright: Option<String>,
    },
}

impl SplatExport {
    fn axes(&self) -> Axes {
        match self {
            Self::Ply(variant) | Self::CompressedPly(variant) => variant.axes(),
            Self::Spz | Self::Gltf { .. } => Axes::EastUpSouth,
        }
    }

    /// The content of the file, of splats in its axes.
    fn encode(&self, splats: &Splats, site: Option<&SiteGrid>) -> Result<Vec<u8>, ExportError> {
        Ok(match self {
            Self::Ply(variant) => variant.encode(splats, site),
            Self::CompressedPly(variant) => compressed_ply::encode(splats, &variant.comments(site)),
            Self::Spz => spz::encode(splats)?,
            Self::Gltf { compression, copyright } => {
                let scene =
                    GltfScene { site: site.copied(), copyright: copyright.clone(), ..GltfScene::default() };
                splat_gltf::encode(splats, *compression, &scene)?
            }
        })
    }

    /// Whether coordinates are whole numbers of steps.
    fn is_spz(&self) -> bool {
        matches!(self, Self::Spz | Self::Gltf { compression: GltfCompression::Spz, .. })
    }
}

/// Exports the splats of a run, those of a satellite run in the colours of the orthophoto, with `NAME.georef.json` beside
/// them if they have a place on Earth.
///
/// # Errors
/// [`PipelineError`]: the run is not trained, the file exists and `overwrite` is not set, it cannot be written, or the format
/// cannot hold the splats.
pub fn export_splats(
    run: &Path,
    file: &Path,
    form: &SplatExport,
    overwrite: bool,
) -> Result<ExportedSplats, PipelineError> {
    let is_own = match (file.canonicalize(), run.join(SPLATS).canonicalize()) {
        (Ok(file), Ok(own)) => file == own,
        _ => false,
    };
    if is_own {
        return Err(ExportError::OwnFile { path: file.into() }.into());
    }
    if file.exists() && !overwrite {
        return Err(PipelineError::Exists { path: file.into() });
    }
    check_writable(file)?;
    let (splats, site) = read_shown(run)?;
    if splats.is_empty() {
        return Err(ExportError::NoSplats { run: run.into() }.into());
    }
    let georeference = file.with_extension("georef.json");
    let place = site.as_ref().map(|site| {
        let mut place = crate::io::georeference(site);
        place["axes"] = serde_json::json!(form.axes().names());
        place
    });
    require_own(&georeference, place.as_ref(), file, overwrite)?;
    let splats = form.axes().from_site(splats);
    let bytes = form.encode(&splats, site.as_ref())?;
    write_file(file, &bytes)?;
    match &place {
        Some(place) => write_json(&georeference, place)?,
        // That of a file that was replaced.
        None => remove_if_there(&georeference)?,
    }
    let step = if form.is_spz() { Some(spz::step(&splats)?) } else { None };
    Ok(ExportedSplats { file: file.into(), splats: splats.len(), bytes: bytes.len() as u64, step })
}

/// An error if the georeference that is there differs from that of `file`, and belongs to another file of the same name or may
/// not be replaced.
fn require_own(
    georeference: &Path,
    place: Option<&Value>,
    file: &Path,
    overwrite: bool,
) -> Result<(), PipelineError> {
    let there = || read_json::<Value>(georeference).ok();
    if !georeference.exists() || place.is_some_and(|place| there().as_ref() == Some(place)) {
        return Ok(());
    }
    let others = ENDINGS.into_iter().map(|ending| file.with_extension(ending));
    if let Some(other) = others.filter(|other| other != file).find(|other| other.exists()) {
        return Err(ExportError::SharedGeoreference { georeference: georeference.into(), other }.into());
    }
    if overwrite { Ok(()) } else { Err(PipelineError::Exists { path: georeference.into() }) }
}

/// The splats of a run as they are shown, and their site frame if they have a place on Earth.
pub(super) fn read_shown(run: &Path) -> Result<(Splats, Option<SiteGrid>), PipelineError> {
    if perspective_manifest::is_run(run) {
        let cameras = PerspectiveCameras::read(run)?;
        return Ok((PerspectiveCameras::read_splats(run)?, cameras.site));
    }
    relocation::finish(run)?;
    let cameras = TrainedCameras::read(run)?;
    Ok((cameras.read_shown_splats(run)?, Some(cameras.setup.site)))
}
