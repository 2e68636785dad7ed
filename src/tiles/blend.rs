//! The core of a tile, blended with its neighbours.
//!
//! Tiles of a row are joined first, then rows of tiles. In the strip that two of them have in common, twice the overlap wide,
//! both are averaged where they show the same surface; elsewhere a cut of least cost decides which of them a cell is taken
//! from. A cell depends only on the tiles around it and not on whose core it lies in, so that jobs need no order:
//!
//! - The cut between two tiles of a row is computed over the whole strip, from these two tiles.
//! - The cut between two rows is computed core by core. Where it passes from one core to the next is computed from the
//!   square around the corner, which both jobs see.

use super::TilesError;
use super::cells::Cells;
use super::cut::{Cut, least_cost_cut, linear_share, mixed, owned_share};
use super::done::{Seals, are_sound, seal};
use super::plan::{Plan, Tile};
use super::seams::Seam;
use super::tile_rasters::{Patch, TileRasters};
use crate::io::{Grid2, Template, read_json, write_json};
use crate::pipeline::Outcome;
use crate::progress::{Event, Progress};
use crate::run_files::{CONFIDENCE, DSM, MOSAIC, ORTHO};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Another version blends cores again.
pub(super) const VERSION: &str = env!("CARGO_PKG_VERSION");
/// The largest value of a weight in the file of shares.
pub(super) const WHOLE_SHARE: f64 = 255.0;
/// Name of the file of shares, which only the mosaic needs.
pub(super) const SHARES: &str = "shares.tif";

/// A blended core: `mosaic/ID.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Blended {
    /// ID of the tile.
    pub id: String,
    /// Hash of the files of the tile and of its neighbours.
    pub input_hash: String,
    /// IDs of the tiles around, with the tile itself in the middle: rows from the north, columns from the west; none if a tile is
    /// absent.
    pub neighbours: [[Option<String>; 3]; 3],
    /// The seams to the eastern and to the southern neighbour.
    pub seams: Vec<Seam>,
    /// The files of the core, by name in `mosaic`.
    pub files: Seals,
}

/// The nine tiles around a core, and what blending needs of the plan.
struct Surroundings<'a> {
    run: &'a Path,
    plan: &'a Plan,
    /// Rows from the north, columns from the west; none if the plan has no such tile, or it is left out.
    tiles: [[Option<TileRasters>; 3]; 3],
    core: Cells,
    /// The rows of cores of each row of tiles; none if it has no tile.
    rows: [Option<(i64, i64)>; 3],
    overlap: i64,
}

/// Path of a file of a blended core.
pub(super) fn core_file(run: &Path, id: &str, name: &str) -> PathBuf {
    run.join(MOSAIC).join(format!("{id}_{name}"))
}

/// Blends the core of a tile with its neighbours: writes `mosaic/ID_{dsm,ortho,confidence,shares}.tif`, and last
/// `mosaic/ID.json`. `without` lists tiles that are taken as absent because they failed; all other neighbours must be done.
///
/// The core is kept if it was made from the same files.
///
/// # Errors
/// [`TilesError`] if the tile or a neighbour is not done, a file is damaged, or a core cannot be written.
pub fn blend(
    run: &Path,
    id: &str,
    without: &[String],
    progress: &dyn Progress,
) -> Result<Outcome<Blended>, TilesError> {
    let plan = Plan::read(run)?;
    let tile = plan.tile(id).ok_or_else(|| TilesError::NoTile { id: id.into() })?;
    let (blended, is_kept) = blend_tile(run, &plan, tile, without)?;
    if is_kept {
        progress.event(Event::Note(format!("the core of tile `{id}` is blended already")));
        return Ok(Outcome::Kept(Some(blended)));
    }
    Ok(Outcome::Made(blended))
}

/// As [`blend`], with the plan at hand; also returns whether the core was kept.
pub(super) fn blend_tile(
    run: &Path,
    plan: &Plan,
    tile: &Tile,
    without: &[String],
) -> Result<(Blended, bool), TilesError> {
    let around = Surroundings::open(run, plan, tile, without)?;
    let input_hash = around.input_hash();
    let record = run.join(MOSAIC).join(format!("{}.json", tile.id));
    let kept = read_json::<Blended>(&record).ok();
    if let Some(kept) = kept.filter(|b| b.input_hash == input_hash && are_sound(&b.files, &run.join(MOSAIC)))
    {
        return Ok((kept, true));
    }
    let blended = around.blend(&tile.id, input_hash)?;
    write_json(&record, &blended)?;
    Ok((blended, false))
}

impl<'a> Surroundings<'a> {
    fn open(run: &'a Path, plan: &'a Plan, tile: &Tile, without: &[String]) -> Result<Self, TilesError> {
        let core = Cells::of_box(tile.core, plan.resolution_m);
        let overlap = plan.overlap_cells();
        let mut tiles: [[Option<TileRasters>; 3]; 3] = Default::default();
        let mut rows = [None; 3];
        for other in std::iter::once(tile).chain(tile.neighbours.iter().filter_map(|id| plan.tile(id))) {
            let its = Cells::of_box(other.core, plan.resolution_m);
            let wrong = |reason| TilesError::Cores { a: tile.id.clone(), b: other.id.clone(), reason };
            let at = |low: i64, high: i64, of_low: i64, of_high: i64| match () {
                () if (of_low, of_high) == (low, high) => Some(1),
                () if of_high == low => Some(0),
                () if of_low == high => Some(2),
                () => None,
            };
            let column = at(core.west, core.east, its.west, its.east);
            let row = at(core.north, core.south, its.north, its.south);
            let (Some(row), Some(column)) = (row, column) else {
                return Err(wrong("their cores are not in rows and columns"));
            };
            let is_narrow = |side: usize, place: usize| place != 1 && (side as i64) < 2 * overlap;
            if is_narrow(core.width().min(its.width()), column)
                || is_narrow(core.height().min(its.height()), row)
            {
                return Err(wrong("a core is narrower than twice the overlap"));
            }
            let its_rows = (its.north, its.south);
            if rows[row].is_some_and(|rows| rows != its_rows) {
                return Err(wrong("their cores are not in rows and columns"));
            }
            rows[row] = Some(its_rows);
            if !without.contains(&other.id) || other.id == tile.id {
                tiles[row][column] = Some(TileRasters::open(run, plan, other)?);
            }
        }
        Ok(Self { run, plan, tiles, core, rows, overlap })
    }

    /// Hash of all that the core depends on.
    fn input_hash(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        let text = format!("{VERSION} {:?} {} {}", self.core, self.overlap, self.plan.resolution_m);
        hasher.update(text.as_bytes());
        for tile in self.tiles.iter().flatten() {
            let text = tile.as_ref().map(|t| format!("{} {} {:?}", t.id, t.done.input_hash, t.done.files));
            hasher.update(text.unwrap_or_else(|| "absent".into()).as_bytes()).update(b"\n");
        }
        hasher.finalize().to_hex()[..32].to_owned()
    }

    fn blend(&self, id: &str, input_hash: String) -> Result<Blended, TilesError> {
        let cells = self.core;
        let mut out = Patch::empty(cells);
        // Weights of the tile in the next column, in the next row, and in both.
        let mut shares: [Grid2; 3] = std::array::from_fn(|_| out.share.clone());
        let own = self.row_mosaic(1, cells.grown(self.overlap))?;
        for row in 0..cells.height() {
            for col in 0..cells.width() {
                let (to, from) = (row * cells.width() + col, place(&own, cells, col, row));
                (0..out.bands.len()).for_each(|i| out.bands[i].data[to] = own.bands[i].data[from]);
                shares[0].data[to] = own.share.data[from];
            }
        }
        for (next, border) in [(0, cells.north), (2, cells.south)] {
            if self.rows[next].is_none() {
                continue;
            }
            self.join_rows(&own, next, border, &mut out, &mut shares)?;
        }
        let files = self.write(id, &out, &shares)?;
        Ok(Blended { id: id.into(), input_hash, neighbours: self.ids(), seams: self.seams()?, files })
    }

    fn ids(&self) -> [[Option<String>; 3]; 3] {
        [0, 1, 2].map(|row| [0, 1, 2].map(|col: usize| self.tiles[row][col].as_ref().map(|t| t.id.clone())))
    }

    /// The box of the strip between two tiles of a row, over which their cut is computed.
    fn strip_of_row(&self, rows: (i64, i64), border: i64) -> Cells {
        let o = self.overlap;
        Cells { west: border - o, east: border + o, north: rows.0 - o, south: rows.1 + o }
    }

    /// The cut between two tiles of a row; none if one is absent.
    fn cut_of_row(&self, row: usize, west: usize, strip: Cells) -> Result<Option<Cut>, TilesError> {
        let (Some(a), Some(b)) = (&self.tiles[row][west], &self.tiles[row][west + 1]) else {
            return Ok(None);
        };
        let (a, b) = (a.read(0, strip)?, b.read(0, strip)?);
        Ok(Some(least_cost_cut(&difference(&a, &b), None, None)))
    }

    /// The tiles of a row joined over a box, which lies within the core's columns and the overlap.
    fn row_mosaic(&self, row: usize, cells: Cells) -> Result<Patch, TilesError> {
        let mut out = Patch::empty(cells);
        let Some(rows) = self.rows[row] else { return Ok(out) };
        if let Some(tile) = &self.tiles[row][1] {
            out.bands = tile.read_all(cells)?;
        }
        // The tile of the neighbouring column is the first of the western strip, and the second of the eastern strip.
        for (west, border) in [(0, self.core.west), (1, self.core.east)] {
            let neighbour = 2 * west;
            let Some(other) = &self.tiles[row][neighbour] else { continue };
            let strip = self.strip_of_row(rows, border);
            let Some(common) = strip.common(cells) else { continue };
            let cut = self.cut_of_row(row, west, strip)?;
            let theirs = Patch { bands: other.read_all(common)?, ..Patch::empty(common) };
            for r in 0..common.height() {
                let line = (common.north - strip.north) as usize + r;
                for c in 0..common.width() {
                    let across = (common.west - strip.west) as usize + c;
                    let linear = linear_share(across, strip.width());
                    let owned = cut.as_ref().map_or(0.5, |cut| owned_share(across, cut[line]));
                    let at = place(&out, common, c, r);
                    let (ours, theirs) = (out.at(at), theirs.at(r * common.width() + c));
                    let (values, share) = if west == 0 {
                        let (values, share) = mixed(&theirs, &ours, linear, owned);
                        (values, 1.0 - share)
                    } else {
                        mixed(&ours, &theirs, linear, owned)
                    };
                    (0..values.len()).for_each(|i| out.bands[i].data[at] = values[i]);
                    out.share.data[at] = share;
                }
            }
        }
        Ok(out)
    }

    /// Joins the row of tiles in the north (0) or south (2) at a border to the core.
    fn join_rows(
        &self,
        own: &Patch,
        next: usize,
        border: i64,
        out: &mut Patch,
        shares: &mut [Grid2; 3],
    ) -> Result<(), TilesError> {
        let o = self.overlap;
        let strip = Cells { north: border - o, south: border + o, ..self.core.grown(o) };
        let theirs = self.row_mosaic(next, strip)?;
        let height =
            |patch: &Patch, col: usize, row: usize| patch.bands[0].data[place(patch, strip, col, row)];
        let difference = Grid2::from_fn(strip.height(), strip.width(), |across, along| {
            height(own, along, across) - height(&theirs, along, across)
        });
        let cut = self.cut_of_rows(next, &difference);
        let Some(common) = strip.common(self.core) else { return Ok(()) };
        for r in 0..common.height() {
            let across = (common.north - strip.north) as usize + r;
            let linear = linear_share(across, strip.height());
            for c in 0..common.width() {
                let at = place(own, common, c, r);
                let at_theirs = place(&theirs, common, c, r);
                let (ours, other) = (own.at(at), theirs.at(at_theirs));
                let owned = owned_share(across, cut[c]);
                let (values, share) = if next == 0 {
                    let (values, share) = mixed(&other, &ours, linear, owned);
                    (values, 1.0 - share)
                } else {
                    mixed(&ours, &other, linear, owned)
                };
                let to = place(out, common, c, r);
                (0..values.len()).for_each(|i| out.bands[i].data[to] = values[i]);
                let column = [own.share.data[at], theirs.share.data[at_theirs]];
                shares[0].data[to] = (1.0 - share) * column[0];
                shares[1].data[to] = share * (1.0 - column[1]);
                shares[2].data[to] = share * column[1];
            }
        }
        Ok(())
    }

    /// The cut between the core's row of tiles and the next one, for the columns of the core. `difference` covers the
    /// overlap too; its rows are columns of the map.
    fn cut_of_rows(&self, next: usize, difference: &Grid2) -> Cut {
        let (o, width) = (self.overlap as usize, self.core.width());
        let part = |from: usize, lines: usize| Grid2 {
            width: difference.width,
            height: lines,
            data: difference.data[from * difference.width..(from + lines) * difference.width].to_vec(),
        };
        // Where the cut goes on in the next column of tiles, it passes the border of the cores at the same cell.
        let passes = |column: usize, from: usize| {
            let goes_on = self.tiles[1][column].is_some() || self.tiles[next][column].is_some();
            goes_on.then(|| least_cost_cut(&part(from, 2 * o), None, None)[o])
        };
        least_cost_cut(&part(o, width), passes(0, 0), passes(2, width))
    }

    /// The seams to the eastern and to the southern neighbour.
    fn seams(&self) -> Result<Vec<Seam>, TilesError> {
        let (o, core) = (self.overlap, self.core);
        let cell = self.plan.resolution_m;
        let corner = |col: i64, row: i64| [col as f64 * cell, -row as f64 * cell];
        let east = Cells { west: core.east - o, east: core.east + o, ..core };
        let south = Cells { north: core.south - o, south: core.south + o, ..core };
        let mut seams = Vec::new();
        for (other, strip, ends) in [
            (&self.tiles[1][2], east, [corner(core.east, core.north), corner(core.east, core.south)]),
            (&self.tiles[2][1], south, [corner(core.west, core.south), corner(core.east, core.south)]),
        ] {
            let (Some(own), Some(other)) = (&self.tiles[1][1], other) else { continue };
            let read = |tile: &TileRasters| -> Result<[Grid2; 4], TilesError> {
                Ok([tile.read(0, strip)?, tile.read(1, strip)?, tile.read(2, strip)?, tile.read(3, strip)?])
            };
            let (a, b) = (read(own)?, read(other)?);
            seams.push(Seam::new([own.id.clone(), other.id.clone()], ends, a.each_ref(), b.each_ref()));
        }
        Ok(seams)
    }

    fn write(&self, id: &str, out: &Patch, shares: &[Grid2; 3]) -> Result<Seals, TilesError> {
        let grid = self.core.grid(self.plan.epsg, self.plan.resolution_m);
        let Some(own) = &self.tiles[1][1] else { return Ok(Seals::new()) };
        let bands: Vec<&Grid2> = out.bands.iter().collect();
        let parts = [(DSM, &bands[..1]), (ORTHO, &bands[1..4]), (CONFIDENCE, &bands[4..])];
        let mut names = Vec::new();
        for ((name, bands), file) in parts.into_iter().zip(&own.files) {
            Template::of(file)?.write(&core_file(self.run, id, name), &grid, bands)?;
            names.push(format!("{id}_{name}"));
        }
        let bytes = |g: &Grid2| g.data.iter().map(|v| (WHOLE_SHARE * f64::from(*v)).round() as u8).collect();
        let cog = crate::io::Cog { grid, metadata: &[], heights_from: None };
        cog.write_u8(&core_file(self.run, id, SHARES), shares.iter().map(bytes).collect(), None)?;
        names.push(format!("{id}_{SHARES}"));
        seal(&self.run.join(MOSAIC), &names)
            .map_err(|source| TilesError::RunFile { source, made_by: "`satgs tile blend RUN ID` makes it" })
    }
}

/// The index in a patch of a cell of a smaller box.
fn place(patch: &Patch, cells: Cells, col: usize, row: usize) -> usize {
    let at = cells.window_in(patch.cells);
    (at.row + row) * patch.cells.width() + at.col + col
}

fn difference(a: &Grid2, b: &Grid2) -> Grid2 {
    Grid2 { width: a.width, height: a.height, data: a.data.iter().zip(&b.data).map(|(a, b)| a - b).collect() }
}

impl Blended {
    /// IDs of the tiles whose weights the three bands of the file of shares hold at a cell: the tile of the next column, the
    /// one of the next row, and the one of both. `east` and `south` tell in which half of the core the cell lies.
    #[must_use]
    pub fn sharing(&self, east: bool, south: bool) -> [Option<&str>; 3] {
        let (col, row) = (if east { 2 } else { 0 }, if south { 2 } else { 0 });
        [(1, col), (row, 1), (row, col)]
            .map(|(row, col): (usize, usize)| self.neighbours[row][col].as_deref())
    }
}
