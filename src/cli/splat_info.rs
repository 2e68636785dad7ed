//! `satgs info` of splat files and of tilesets.

use super::{CliError, Ui};
use crate::export::tiles3d::TilesetInfo;
use crate::export::{SplatFile, SplatFileInfo};
use crate::pipeline::PipelineError;
use crate::splat::primitive::PrimitiveKind;
use std::fmt::Write;
use std::path::Path;

/// Name of the document of a tileset.
const TILESET: &str = "tileset.json";

/// Whether a path names a splat file or a tileset.
pub fn is_one(path: &Path) -> bool {
    path.is_file() && (SplatFile::is_named_like_one(path) || path.ends_with(TILESET))
}

/// Reads the file and shows what it holds.
pub fn run(path: &Path, ui: &Ui) -> Result<(), CliError> {
    if path.ends_with(TILESET) {
        let info = TilesetInfo::read(path).map_err(PipelineError::from)?;
        return ui.summary("info", Some(&tileset_text(path, &info)), &info);
    }
    let info = SplatFile::read(path).map_err(PipelineError::from)?.info();
    ui.summary("info", Some(&text(path, &info)), &info)
}

fn text(path: &Path, info: &SplatFileInfo) -> String {
    let kind = match info.primitive {
        PrimitiveKind::Ellipsoid => "ellipsoids",
        PrimitiveKind::Disc => "discs",
    };
    let mut text = format!(
        "{}: {} splats ({kind}), spherical harmonics of degree {}\n",
        path.display(),
        info.splats,
        info.degree
    );
    let [x, y, z] = info.axes;
    if let Some([low, high]) = info.bounds {
        let range = |k: usize| format!("{:.2} to {:.2}", low[k], high[k]);
        let _ = writeln!(text, "x ({x}) {}, y ({y}) {}, z ({z}) {}", range(0), range(1), range(2));
    }
    match (&info.site, info.map_bounds) {
        (Some(site), Some([low, high])) => {
            let _ = write!(
                text,
                "on EPSG:{}: east {:.2} to {:.2} m, north {:.2} to {:.2} m, ellipsoidal height {:.2} to {:.2} m",
                site.epsg, low[0], high[0], low[1], high[1], low[2], high[2]
            );
        }
        _ => text.push_str("no georeference"),
    }
    text
}

fn tileset_text(path: &Path, info: &TilesetInfo) -> String {
    let TilesetInfo { version, tiles, levels, error_m, .. } = info;
    let mut text = format!(
        "{}: 3D Tiles {version}, {tiles} tiles in {levels} levels of detail, error of the coarsest {error_m:.2} m",
        path.display()
    );
    if let Some([x, y, z]) = info.origin_ecef {
        let _ = write!(text, "\norigin at {x:.3} {y:.3} {z:.3} m, earth-centred (EPSG:4978)");
    }
    if let Some(copyright) = &info.copyright {
        let _ = write!(text, "\n{copyright}");
    }
    text
}
