//! The splats of runs as 3D Tiles: `satgs export --3dtiles`.

use super::PipelineError;
use super::export_folder::{ExportFolder, SUMMARY};
use super::export_splats::read_shown;
use super::exported::ExportedTileset;
use crate::export::ExportError;
use crate::export::tiles3d;
use crate::frame::{LevelFrame, SiteGrid};
use crate::io::{write_file, write_json};
use crate::progress::{Event, Progress};
use crate::splat::splats::Splats;
use std::path::{Path, PathBuf};

/// The document of a tileset, and the folder with the contents of its tiles.
const TILESET: &str = "tileset.json";
const CONTENTS: &str = "tiles";
/// Name of the topmost tile.
const ROOT: &str = "root";

/// A run whose splats are part of a tileset.
#[derive(Clone, Debug, PartialEq)]
pub struct TilesetPart {
    /// The run folder.
    pub run: PathBuf,
    /// Name of its topmost tile.
    pub name: String,
    /// The box on the map that it fills: west, south, east, north, metres. Without one all of its splats count.
    pub core: Option<[f64; 4]>,
}

impl TilesetPart {
    /// All splats of a run.
    #[must_use]
    pub fn whole(run: &Path) -> Self {
        Self { run: run.into(), name: ROOT.into(), core: None }
    }
}

/// Exports the splats of runs as 3D Tiles into a folder, which appears when it is complete; `overwrite` replaces what an earlier
/// export wrote there. One run is in memory at a time.
///
/// # Errors
/// [`PipelineError`]: a run is not trained or has no georeference, the folder is not empty or cannot be written, the caller
/// asked to stop.
pub fn export_tileset(
    parts: &[TilesetPart],
    folder: &Path,
    copyright: Option<&str>,
    overwrite: bool,
    progress: &dyn Progress,
) -> Result<ExportedTileset, PipelineError> {
    let target = ExportFolder::new(folder, TILESET, overwrite)?;
    let mut place: Option<(LevelFrame, SiteGrid)> = None;
    let (mut tops, mut bytes, mut total) = (Vec::new(), 0, 0);
    let uri = |id: &str| format!("{CONTENTS}/{id}.glb");
    let mut write = |id: &str, splats: &Splats| -> Result<(), PipelineError> {
        progress.check()?;
        let content = tiles3d::content(splats, copyright)?;
        bytes += content.len() as u64;
        Ok(write_file(&target.path(&uri(id)), content)?)
    };
    progress.event(Event::Started { stage: "writing tiles", total: parts.len() as u64 });
    for (i, part) in parts.iter().enumerate() {
        progress.check()?;
        let run = &part.run;
        let (mut splats, site) = read_shown(run)?;
        let site = site.ok_or_else(|| ExportError::NoPlace { run: run.clone() })?;
        let (level, _) =
            place.get_or_insert_with(|| (LevelFrame::at(site.geodetic_from_utm(site.origin)), site));
        if let Some(core) = part.core {
            splats = inside(&splats, &site, core);
        }
        total += splats.len();
        let off_the_map = || ExportError::OffTheMap { run: run.clone(), epsg: site.epsg };
        let placed = tiles3d::place(splats, &site, level).ok_or_else(off_the_map)?;
        if !placed.is_empty() {
            tops.push(tiles3d::subtree(placed, &part.name, &mut write)?);
        }
        progress.event(Event::Advanced { done: i as u64 + 1, status: part.name.clone() });
    }
    let root = tiles3d::join(ROOT, tops, &mut write)?;
    progress.event(Event::Finished);
    let no_splats =
        || ExportError::NoSplats { run: parts.first().map_or_else(PathBuf::new, |p| p.run.clone()) };
    let (root, (level, site)) = root.zip(place).ok_or_else(no_splats)?;
    write_json(&target.path(TILESET), &tiles3d::document(&root, &level, &site, copyright, &uri))?;
    let exported = ExportedTileset {
        tileset: folder.join(TILESET),
        tiles: root.all().count(),
        levels: root.levels(),
        splats: total,
        bytes,
    };
    write_json(&target.path(SUMMARY), &exported)?;
    target.finish(&[SUMMARY, TILESET, CONTENTS])?;
    Ok(exported)
}

/// The splats in a box on the map, to which its west and south edges belong.
fn inside(splats: &Splats, site: &SiteGrid, [west, south, east, north]: [f64; 4]) -> Splats {
    let [x0, y0, _] = site.origin.xyz();
    let is_inside = |p: &[f32; 3]| {
        let (x, y) = (x0 + f64::from(p[0]), y0 + f64::from(p[1]));
        (west..east).contains(&x) && (south..north).contains(&y)
    };
    let kept: Vec<u32> =
        splats.position.iter().zip(0..).filter(|(p, _)| is_inside(p)).map(|(_, i)| i).collect();
    let mut inside = Splats::default();
    inside.take_from(splats, &kept);
    inside
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Point;

    #[test]
    fn neighbouring_boxes_hold_each_splat_once() {
        let site = SiteGrid { epsg: 32617, origin: Point::new(1000.0, 2000.0, 0.0) };
        let mut splats = Splats::default();
        for x in 0..5 {
            splats.push([x as f32, 0.0, 0.0], 0.1, 0.5, [0.5; 3]);
        }
        let of = |west: f64, east: f64| inside(&splats, &site, [west, 1990.0, east, 2010.0]).len();
        assert_eq!((of(999.0, 1002.0), of(1002.0, 1004.0)), (2, 2));
    }
}
