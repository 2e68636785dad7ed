//! The files of a mosaic.

use super::TilesError;
use super::blend::{Blended, SHARES, WHOLE_SHARE, core_file};
use super::cells::Cells;
use super::colour::{ColorCorrection, TileColors};
use super::done::tile_folder;
use super::mosaicked::FailedTile;
use super::plan::Plan;
use super::seams::Seam;
use crate::dsm::height_style;
use crate::io::{
    Grid2, ImageFile, MapFeature, MapShape, MosaicPart, Template, WriteError, write_file, write_map_features,
};
use crate::progress::{Event, Progress};
use crate::report::map_of_page;
use crate::run_files::{CONFIDENCE, DSM, FAILED, MOSAIC, ORTHO, SEAMS};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Metadata item that lists the views of a raster.
const INPUTS: &str = "INPUTS";
/// Folder of the orthophotos with corrected colours, while the mosaic is written.
const CORRECTED: &str = "corrected";
/// The style of the surface model.
const STYLE: &str = "dsm.qml";

/// What the files of a mosaic are made from.
pub(super) struct MosaicFiles<'a> {
    pub(super) run: &'a Path,
    pub(super) plan: &'a Plan,
    /// The blended cores; at least one.
    pub(super) cores: &'a [Blended],
    pub(super) colors: &'a TileColors,
}

impl MosaicFiles<'_> {
    /// Writes surface model, orthophoto and confidence, and the style of the first; returns the names of the files.
    pub(super) fn write_rasters(&self, progress: &dyn Progress) -> Result<Vec<String>, TilesError> {
        progress.event(Event::Started { stage: "writing the mosaic", total: 3 });
        let folder = self.run.join(MOSAIC);
        // Of a fixed name, so that what a killed call left is replaced.
        let corrected = folder.join(CORRECTED);
        let failed = |e: std::io::Error| WriteError::new(&corrected, e);
        if corrected.exists() {
            std::fs::remove_dir_all(&corrected).map_err(failed)?;
        }
        std::fs::create_dir_all(&corrected).map_err(failed)?;
        self.cores.par_iter().try_for_each(|core| self.correct(core, &corrected))?;
        for (i, name) in [DSM, ORTHO, CONFIDENCE].into_iter().enumerate() {
            let path_of = |id: &str| match name {
                ORTHO => corrected.join(format!("{id}.tif")),
                _ => core_file(self.run, id, name),
            };
            self.write_raster(name, path_of)?;
            progress.event(Event::Advanced { done: i as u64 + 1, status: String::new() });
        }
        progress.event(Event::Finished);
        std::fs::remove_dir_all(&corrected).map_err(failed)?;
        let (bands, _) = map_of_page(&self.run.join(DSM))?;
        write_file(&self.run.join(STYLE), height_style(&bands[0]))?;
        Ok([DSM, ORTHO, CONFIDENCE, STYLE].map(str::to_owned).to_vec())
    }

    fn write_raster(&self, name: &str, path_of: impl Fn(&str) -> PathBuf) -> Result<(), TilesError> {
        let grid = self.plan.mosaic_grid();
        let all = Cells::of_box(grid.bounds().into(), grid.cell);
        let mut views = BTreeSet::new();
        let mut parts = Vec::new();
        for core in self.cores {
            let tile = self.plan.tile(&core.id).ok_or_else(|| TilesError::NoTile { id: core.id.clone() })?;
            let window = Cells::of_box(tile.core, self.plan.resolution_m).window_in(all);
            parts.push(MosaicPart { path: path_of(&core.id), window });
            let file = ImageFile::open(&tile_folder(self.run, &core.id).join(name))?;
            views.extend(
                file.metadata(INPUTS, "").iter().flat_map(|names| names.split(", ")).map(str::to_owned),
            );
        }
        let first = tile_folder(self.run, &self.cores[0].id).join(name);
        let mut template = Template::of(&ImageFile::open(&first)?)?;
        template.set_metadata(INPUTS, views.into_iter().collect::<Vec<_>>().join(", "));
        Ok(template.write_mosaic(&self.run.join(name), &grid, &parts)?)
    }

    /// Writes the orthophoto of a core with the colours corrected.
    fn correct(&self, core: &Blended, folder: &Path) -> Result<(), TilesError> {
        let ortho = ImageFile::open(&core_file(self.run, &core.id, ORTHO))?;
        let shares = ImageFile::open(&core_file(self.run, &core.id, SHARES))?;
        let (width, height) = ortho.size();
        let read = |file: &ImageFile| -> Result<[Grid2; 3], TilesError> {
            Ok([file.read(1)?, file.read(2)?, file.read(3)?])
        };
        let mut bands: [Grid2; 3] = read(&ortho)?;
        let shares: [Grid2; 3] = read(&shares)?;
        let own = self.colors.of(&core.id);
        let correction = |id: Option<&str>| id.map_or(own, |id| self.colors.of(id));
        let around =
            [false, true].map(|south| [false, true].map(|east| core.sharing(east, south).map(correction)));
        for row in 0..height {
            for col in 0..width {
                let others = &around[usize::from(2 * row >= height)][usize::from(2 * col >= width)];
                let at = row * width + col;
                let of_others = [0, 1, 2].map(|i| f64::from(shares[i].data[at]) / WHOLE_SHARE);
                let rest = 1.0 - of_others.iter().sum::<f64>();
                let tiles: [(f64, ColorCorrection); 4] = [
                    (rest, own),
                    (of_others[0], others[0]),
                    (of_others[1], others[1]),
                    (of_others[2], others[2]),
                ];
                for (band, values) in bands.iter_mut().enumerate() {
                    let v = &mut values.data[at];
                    *v = ColorCorrection::corrected_mixture(f64::from(*v), band, &tiles) as f32;
                }
            }
        }
        let path = folder.join(format!("{}.tif", core.id));
        Ok(Template::of(&ortho)?.write(&path, &ortho.map_grid()?, &bands.each_ref())?)
    }

    /// Writes the seams as lines.
    pub(super) fn write_seams(&self, seams: &[Seam]) -> Result<Vec<String>, TilesError> {
        let number = |v: Option<f64>| v.unwrap_or(f64::NAN);
        let features = seams.iter().map(|s| {
            let color = self.colors.step(s);
            MapFeature {
                corners: s.line.iter().map(|p| (p[0], p[1])).collect(),
                texts: vec![("first", s.tiles[0].clone()), ("second", s.tiles[1].clone())],
                numbers: vec![
                    ("step_m", number(s.median_m)),
                    ("nmad_m", number(s.nmad_m)),
                    ("over_1m", number(s.over_1m)),
                    ("cells", s.cells as f64),
                    ("ortho_before", number(color.map(|c| c.before))),
                    ("ortho_after", number(color.map(|c| c.after))),
                    ("ortho_spread", number(color.map(|c| c.spread))),
                ],
            }
        });
        let (path, features) = (self.run.join(SEAMS), features.collect::<Vec<_>>());
        write_map_features(&path, "seams", self.plan.epsg, MapShape::Line, &features)?;
        Ok(vec![SEAMS.into()])
    }

    /// Writes the cores of the tiles that are not done as polygons.
    pub(super) fn write_failed(&self, failed: &[FailedTile]) -> Result<Vec<String>, TilesError> {
        let features = failed.iter().filter_map(|f| {
            let [w, s, e, n] = self.plan.tile(&f.id)?.core;
            Some(MapFeature {
                corners: vec![(w, s), (e, s), (e, n), (w, n)],
                texts: vec![("tile", f.id.clone()), ("reason", f.reason.clone())],
                numbers: Vec::new(),
            })
        });
        let (path, features) = (self.run.join(FAILED), features.collect::<Vec<_>>());
        write_map_features(&path, "failed", self.plan.epsg, MapShape::Polygon, &features)?;
        Ok(vec![FAILED.into()])
    }
}
