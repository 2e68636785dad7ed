//! Makes the plan of an adjusted scene's tiles.

use super::cells::MapBox;
use super::error::TilesError;
use super::margins::{Margins, exceeds_cap};
use super::plan::{
    Plan, SCHEMA, Tile, TileCost, TileSurface, TileTraining, TileView, adjustment_hash, to_json,
};
use super::plan_options::{CORE_PER_OVERLAP, PlanOptions, RECIPE, fingerprint};
use crate::affine::{MIN_POINTS, SiteScene, sun_direction, with_margins};
use crate::bundle::Adjustment;
use crate::estimate::RunSize;
use crate::frame::{Point, SiteGrid, Utm, wrap_longitude_deg};
use crate::io::{ImageFile, MapGrid, Window, write_file, write_json};
use crate::pipeline::{Outcome, PipelineError, RunLock, Stage, hash, read_scene};
use crate::progress::{Event, Progress};
use crate::run_files::{ADJUSTMENT, DSM, PLAN, STAGE, TILES, TRAIN_STAGE};
use crate::scene::{Aoi, ReadCost, Role, Scene, View, angle_between_deg, require_tiled_images};
use crate::splat::recipe::Recipe;
use crate::stats::bounds;
use std::path::Path;

/// Smallest side of a core that planning chooses to stay within a given memory, metres.
const SMALLEST_CORE_M: f64 = 64.0;
/// An area whose sides are at most so many cores long is not cut, if memory allows: two small tiles take longer than one.
const UNCUT_CORES: f64 = 1.5;
/// A view belongs to a tile if it shows this share of the places of the overlap box that two training views see.
const LEAST_COVERED: f64 = 0.3;
/// Number of training views that a place needs to get a height.
const LEAST_VIEWS: usize = 2;
/// Number of places along each side of the overlap box at which the views' coverage is examined.
const PLACES: usize = 16;
/// Largest number of training views of a tile.
const MAX_VIEWS: usize = 30;
/// Largest distance of an area from the central meridian of its UTM zone, degrees of longitude: half as far again as the
/// zone reaches. Lengths on the map are at most 0.3 % too large there, at the equator.
const FARTHEST_DEG: f64 = 4.5;

/// Whether an adjusted run is larger than one tile, in metres or in memory.
///
/// # Errors
/// [`TilesError`] if the run is not adjusted.
pub fn needs_tiles(run: &Path, options: &PlanOptions) -> Result<bool, TilesError> {
    let from = adjusted(run)?;
    let (west, south, east, north) = from.setup.area;
    let side = (east - west).max(north - south);
    if side > UNCUT_CORES * options.core_m + options.resolution_m {
        return Ok(true);
    }
    let Some(limit) = options.max_memory_mb else { return Ok(false) };
    let planner = Planner::new(run, options, from)?;
    let whole = CoreSize::uncut(side + options.resolution_m);
    let (plan, _) = planner.plan(whole, &planner.candidates()?)?;
    Ok(plan.total.memory_mb > limit)
}

impl PlanOptions {
    /// Number and length in metres of the cores along each side of an area, where memory does not ask for smaller ones.
    #[must_use]
    pub fn cores(&self, sides_m: [f64; 2]) -> [(usize, f64); 2] {
        let size = CoreSize::of(self);
        sides_m.map(|side| cut(side, size, CORE_PER_OVERLAP * self.overlap_m, self.resolution_m))
    }
}

/// Plans the tiles of an adjusted run, unless that was done with the same input and options. Writes `RUN/tiles.json`.
///
/// # Errors
/// [`TilesError`]: the run is not adjusted or holds another plan, an option is wrong, the area reaches too far out
/// of its UTM zone, no views cover a part of it, the memory of the smallest tile is above the limit.
pub fn plan(run: &Path, options: &PlanOptions, progress: &dyn Progress) -> Result<Outcome<Plan>, TilesError> {
    let _lock = RunLock::existing(run)?;
    plan_locked(run, options, progress)
}

/// As [`plan`]; the caller holds the lock.
pub(crate) fn plan_locked(
    run: &Path,
    options: &PlanOptions,
    progress: &dyn Progress,
) -> Result<Outcome<Plan>, TilesError> {
    options.check()?;
    if options.train.resume {
        let instead = "a tile continues from its checkpoint anyway";
        return Err(TilesError::OneTileOnly { option: "--resume", instead });
    }
    let stage = Stage::new(run, TILES, vec![run.join(PLAN)], fingerprint(run, options)?);
    if stage.is_done(options.overwrite)? {
        progress.event(Event::Note(format!("`{}` has its plan already", run.display())));
        return Ok(Outcome::Kept(Some(Plan::read(run)?)));
    }
    if !run.join(PLAN).exists() && run.join(TRAIN_STAGE).join(STAGE).exists() {
        return Err(TilesError::WholeRun { run: run.into() });
    }
    stage.require_writable()?;
    let planner = Planner::new(run, options, adjusted(run)?)?;
    let (plan, notes) = planner.within_memory()?;
    notes.into_iter().for_each(|note| progress.event(Event::Warning(note)));
    if plan.train.recipe == RECIPE {
        write_file(&run.join(RECIPE), options.train.recipe()?.to_toml())?;
    }
    write_json(&run.join(PLAN), &plan)?;
    if run.join(DSM).exists() {
        progress.event(Event::Warning(format!(
            "`{}` is the mosaic of an earlier plan; `satgs mosaic RUN` makes that of this one once its tiles are done",
            run.join(DSM).display()
        )));
    }
    stage.complete(&plan.total)?;
    Ok(Outcome::Made(plan))
}

/// An adjusted scene.
struct Adjusted {
    scene: Scene,
    setup: SiteScene,
    /// The sparse points on the map.
    points: Vec<Point<Utm>>,
}

fn adjusted(run: &Path) -> Result<Adjusted, TilesError> {
    let mut scene = read_scene(run)?;
    let adjustment = Adjustment::read(&run.join(ADJUSTMENT)).map_err(PipelineError::from)?;
    let rpcs = adjustment.cameras_of(&scene).map_err(PipelineError::from)?;
    let positions = adjustment.positions();
    let setup = SiteScene::new(&scene, &rpcs, &positions).map_err(PipelineError::from)?;
    let points = positions.iter().map(|p| setup.site.utm_from_geodetic(*p)).collect();
    scene.views.iter_mut().zip(rpcs).for_each(|(view, rpc)| view.rpc = rpc);
    Ok(Adjusted { scene, setup, points })
}

/// What of a view decides its tiles.
struct Candidate<'a> {
    view: &'a View,
    /// Opened once, because the files of many tiles may lie in an object store.
    file: ImageFile,
    /// Ground displacement (east, north) of the rays towards the sun, metres per metre of height; none if there is no usable
    /// sun.
    sun: Option<[f64; 2]>,
    stretch: Option<[f32; 2]>,
    gsd_m: f64,
}

/// Which places of the overlap box of a tile a view shows, by rows.
type Shown = [bool; PLACES * PLACES];

/// The largest side of a core, metres.
#[derive(Clone, Copy)]
struct CoreSize {
    /// Where an area is cut.
    cut_m: f64,
    /// Of an area that is not cut in this direction.
    uncut_m: f64,
}

impl CoreSize {
    /// The largest of these options.
    fn of(options: &PlanOptions) -> Self {
        Self { cut_m: options.core_m, uncut_m: UNCUT_CORES * options.core_m }
    }

    /// Of an area that is not cut.
    fn uncut(side_m: f64) -> Self {
        Self { cut_m: side_m, uncut_m: side_m }
    }

    /// The next smaller one.
    fn smaller(self) -> Self {
        let cut_m = if self.uncut_m > self.cut_m { self.cut_m } else { 0.5 * self.cut_m };
        Self { cut_m, uncut_m: cut_m }
    }
}

/// Where a tile lies.
struct Place {
    id: String,
    core: MapBox,
    overlap: MapBox,
    heights_m: [f64; 2],
}

struct Planner<'a> {
    options: &'a PlanOptions,
    recipe: Recipe,
    surface: TileSurface,
    /// Width of the overlap, a multiple of the cell, metres.
    overlap_m: f64,
    site: SiteGrid,
    area: MapBox,
    /// Lowest and highest ellipsoidal height of the scene, and of those that are searched, metres.
    heights_m: [f64; 2],
    searched_m: [f64; 2],
    points: Vec<Point<Utm>>,
    adjustment_hash: String,
    scene: Scene,
    setup: SiteScene,
}

impl<'a> Planner<'a> {
    fn new(run: &Path, options: &'a PlanOptions, from: Adjusted) -> Result<Self, TilesError> {
        let Adjusted { scene, setup, points } = from;
        let (site, [x, y, z]) = (setup.site, setup.site.origin.xyz());
        let (w, s, e, n) = setup.area;
        let grid = MapGrid::covering(site.epsg, (x + w, y + s, x + e, y + n), options.resolution_m);
        let (w, s, e, n) = grid.bounds();
        require_near_zone(&site, [w, s, e, n])?;
        let [heights_m, searched_m] =
            [setup.altitudes, setup.searched].map(|(low, high)| [z + low, z + high]);
        let adjustment_hash = adjustment_hash(run)?;
        let (recipe, surface) = (options.train.recipe()?, options.surface.found()?);
        // Strips of a whole number of cells.
        let overlap_m = (options.overlap_m / options.resolution_m - 1e-6).ceil() * options.resolution_m;
        Ok(Self {
            options,
            recipe,
            surface,
            overlap_m,
            site,
            area: [w, s, e, n],
            heights_m,
            searched_m,
            points,
            adjustment_hash,
            scene,
            setup,
        })
    }

    /// The plan with the largest cores whose memory is below the limit, and notes about it.
    fn within_memory(&self) -> Result<(Plan, Vec<String>), TilesError> {
        let candidates = self.candidates()?;
        let mut size = CoreSize::of(self.options);
        loop {
            let (plan, notes) = self.plan(size, &candidates)?;
            let limit = self.options.max_memory_mb.unwrap_or(f64::INFINITY);
            if plan.total.memory_mb <= limit {
                return Ok((plan, notes));
            }
            size = size.smaller();
            if size.cut_m < SMALLEST_CORE_M.max(CORE_PER_OVERLAP * self.overlap_m) {
                return Err(TilesError::Memory { needed_mb: plan.total.memory_mb, limit_mb: limit });
            }
        }
    }

    fn candidates(&self) -> Result<Vec<Candidate<'_>>, TilesError> {
        let views = self.scene.views.iter().zip(&self.setup.views);
        views
            .map(|(view, on_site)| {
                let sun = view.sun.filter(|_| on_site.sun_shear.is_some());
                let sun = sun.map(|sun| {
                    let [e, n, up] = sun_direction(sun, &self.site).xyz();
                    [e / up, n / up]
                });
                Ok(Candidate {
                    view,
                    file: ImageFile::open(&view.image)?,
                    sun,
                    stretch: match view.stretch {
                        Some(stretch) => Some(stretch),
                        None => view.sampled_stretch()?,
                    },
                    gsd_m: on_site.camera.gsd_m(),
                })
            })
            .collect()
    }

    fn plan(&self, size: CoreSize, candidates: &[Candidate]) -> Result<(Plan, Vec<String>), TilesError> {
        let cell = self.options.resolution_m;
        let places = self.places(size);
        let coverage = candidates.iter().map(|c| self.coverage(c, &places)).collect::<Result<Vec<_>, _>>()?;
        let (mut tiles, mut empty, mut capped) = (Vec::new(), Vec::new(), 0);
        for (i, place) in places.into_iter().enumerate() {
            let shown: Vec<&Shown> = coverage.iter().map(|of_view| &of_view[i]).collect();
            let chosen = self.views_of(candidates, &shown, &place);
            let id = place.id.clone();
            match self.tile(place, chosen)? {
                Some((tile, is_capped)) => {
                    capped += usize::from(is_capped);
                    tiles.push(tile);
                }
                None => empty.push(id),
            }
        }
        if tiles.is_empty() {
            return Err(TilesError::NoViews { least: LEAST_VIEWS });
        }
        self.require_tiled_images(&tiles)?;
        let ids: Vec<String> = tiles.iter().map(|t: &Tile| t.id.clone()).collect();
        for tile in &mut tiles {
            tile.neighbours = neighbours(&tile.id).filter(|n| ids.contains(n)).collect();
        }
        let mut notes = Vec::new();
        if !empty.is_empty() {
            notes.push(format!(
                "no two training views see ground of {}: the mosaic has no data there",
                empty.join(", ")
            ));
        }
        if capped > 0 {
            notes.push(format!(
                "{capped} tiles have shadows longer than {} m; those of casters farther away are not modelled",
                super::margins::SHADOW_CAP_M
            ));
        }
        let total = tiles.iter().fold(TileCost::default(), |sum, tile| TileCost {
            seconds_2core: sum.seconds_2core + tile.cost.seconds_2core,
            memory_mb: sum.memory_mb.max(tile.cost.memory_mb),
            read_mb: sum.read_mb + tile.cost.read_mb,
        });
        let mut plan = Plan {
            schema: SCHEMA,
            satgs: env!("CARGO_PKG_VERSION").into(),
            plan_hash: String::new(),
            epsg: self.site.epsg,
            origin_height_m: self.site.origin.z(),
            resolution_m: cell,
            train: TileTraining::of(&self.options.train, &self.recipe),
            surface: self.surface.clone(),
            adjustment_hash: self.adjustment_hash.clone(),
            core_m: size.cut_m,
            overlap_m: self.overlap_m,
            tiles,
            total,
        };
        plan.set_input_hashes()?;
        plan.plan_hash = hash(to_json(&plan)?.as_bytes());
        Ok((plan, notes))
    }

    /// The cores of all tiles, with the ranges of heights around them.
    fn places(&self, size: CoreSize) -> Vec<Place> {
        let cell = self.options.resolution_m;
        let o = self.overlap_m;
        let least = CORE_PER_OVERLAP * o;
        let (columns, width) = cut(self.area[2] - self.area[0], size, least, cell);
        let (rows, height) = cut(self.area[3] - self.area[1], size, least, cell);
        let place = |(row, column): (usize, usize)| {
            let west = self.area[0] + column as f64 * width;
            let south = self.area[1] + row as f64 * height;
            let core = [west, south, (west + width).min(self.area[2]), (south + height).min(self.area[3])];
            let overlap = [core[0] - o, core[1] - o, core[2] + o, core[3] + o];
            Place { id: id(column, row), core, overlap, heights_m: self.heights_of(overlap) }
        };
        (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))).map(place).collect()
    }

    /// A tile, and whether its margin for shadows is limited; none if fewer than two training views cover it.
    fn tile(&self, place: Place, chosen: Vec<&Candidate>) -> Result<Option<(Tile, bool)>, TilesError> {
        let Place { id, core, overlap, heights_m } = place;
        let is_training = |c: &&&Candidate| c.view.role == Role::Train;
        if chosen.iter().filter(is_training).count() < LEAST_VIEWS {
            return Ok(None);
        }
        let sight = self.lines_of_sight(&chosen, overlap, heights_m);
        let sun: Vec<_> = chosen.iter().filter_map(|c| c.sun).collect();
        let around = |[low, high]: [f64; 2]| {
            Margins::new(high - low, &sight, &sun).around(overlap, self.options.resolution_m)
        };
        // What stands around the overlap may be higher than what stands in it, and occlude or shade it.
        let heights_m = self.heights_of(around(heights_m));
        let (height, splat_box) = (heights_m[1] - heights_m[0], around(heights_m));
        let [w, s, e, n] = splat_box;
        let aoi = Aoi::from_utm_box((w, s, e, n), &self.site).map_err(PipelineError::from)?;
        let (mut views, mut pixels, mut read_bytes) = (Vec::new(), 0, 0);
        for c in &chosen {
            let Some(window) = c.view.window_showing(&aoi, (heights_m[0], heights_m[1])) else { continue };
            let whole = c.view.cropped(window).window.unwrap_or(window);
            pixels += whole.width * whole.height;
            read_bytes += ReadCost::of(&c.file, &c.view.bands, whole)?.stored_bytes;
            views.push(TileView {
                name: c.view.name.clone(),
                window: [whole.col, whole.row, whole.width, whole.height],
                stretch: c.stretch,
            });
        }
        let reference = self.setup_reference();
        let reference = chosen.iter().find(|c| c.view.name == reference).or(chosen.iter().find(is_training));
        let training: Vec<_> = chosen.iter().filter(is_training).collect();
        let cells = |from: f64, to: f64| ((to - from) / self.options.resolution_m).round();
        let size = RunSize {
            area_m2: (e - w) * (n - s),
            surface_cells: cells(overlap[0], overlap[2]) * cells(overlap[1], overlap[3]),
            height_m: height,
            gsd_m: training.iter().map(|c| c.gsd_m).sum::<f64>() / training.len() as f64,
            views: training.len(),
            pixels,
            iterations: self.options.train.recipe_for(training.len())?.iterations,
        };
        let tile = Tile {
            id,
            core,
            splat_box,
            heights_m,
            searched_m: self.searched_m,
            views,
            reference: reference.map(|c| c.view.name.clone()).unwrap_or_default(),
            neighbours: Vec::new(),
            cost: TileCost::new(size.cost(), read_bytes),
            input_hash: String::new(),
        };
        Ok(Some((tile, exceeds_cap(height, &sun))))
    }

    /// Ground displacements (east, north) of lines of sight through the corners of a box, metres per metre of height.
    fn lines_of_sight(
        &self,
        views: &[&Candidate],
        [w, s, e, n]: MapBox,
        [low, high]: [f64; 2],
    ) -> Vec<[f64; 2]> {
        let corners = [(w, s), (e, s), (e, n), (w, n)];
        let of_view = |c: &&Candidate| {
            corners.map(|(x, y)| {
                let ground = self.site.geodetic_from_utm(Point::new(x, y, low));
                let above =
                    c.view.rpc.localize_from(c.view.rpc.project(ground), ground.at_height(high)).ok()?;
                let p = self.site.utm_from_geodetic(above);
                let slope = [(p.x() - x) / (high - low), (p.y() - y) / (high - low)];
                slope.iter().all(|v| v.is_finite()).then_some(slope)
            })
        };
        views.iter().flat_map(of_view).flatten().collect()
    }

    /// Name of the scene's reference view.
    fn setup_reference(&self) -> &str {
        self.setup.views.get(self.setup.reference).map_or("", |v| &v.name)
    }

    /// Range of heights of a box: that of the sparse points in it, or of the scene if there are few.
    fn heights_of(&self, [w, s, e, n]: MapBox) -> [f64; 2] {
        let inside = self.points.iter().filter(|p| (w..=e).contains(&p.x()) && (s..=n).contains(&p.y()));
        let [low, high] = self.heights_m;
        let heights: Vec<f64> = inside.map(|p| p.z()).filter(|z| (low..=high).contains(z)).collect();
        if heights.len() < MIN_POINTS {
            return self.heights_m;
        }
        let around = |found| with_margins(found, (low, high)).into();
        bounds(heights.into_iter()).map_or(self.heights_m, around)
    }

    /// The views of a tile, by the places of its overlap box that each view of the scene shows: those that show much of what
    /// two training views see, and as many more as are needed for all of that ground to be seen by two of them. In the order
    /// of the scene.
    fn views_of<'b, 'c>(
        &self,
        candidates: &'b [Candidate<'c>],
        shown: &[&Shown],
        place: &Place,
    ) -> Vec<&'b Candidate<'c>> {
        let is_training = |c: usize| candidates[c].view.role == Role::Train;
        let mut seeing = [0; PLACES * PLACES];
        for of_view in shown.iter().enumerate().filter(|(c, _)| is_training(*c)).map(|(_, of_view)| of_view) {
            (0..seeing.len()).for_each(|i| seeing[i] += usize::from(of_view[i]));
        }
        let usable = seeing.map(|views| views >= LEAST_VIEWS);
        let count =
            |of_view: &Shown, wanted: &Shown| (0..usable.len()).filter(|i| of_view[*i] && wanted[*i]).count();
        let least = LEAST_COVERED * usable.iter().filter(|is_usable| **is_usable).count() as f64;
        let is_covering = |c: &usize| {
            let cells = count(shown[*c], &usable);
            cells > 0 && cells as f64 >= least
        };
        let covering: Vec<&Candidate> =
            (0..candidates.len()).filter(is_covering).map(|c| &candidates[c]).collect();
        let middle = 0.5 * (place.heights_m[0] + place.heights_m[1]);
        let chosen = spread(&covering, self.setup_reference(), middle);
        let mut is_chosen: Vec<bool> =
            candidates.iter().map(|c| chosen.iter().any(|other| std::ptr::eq(*other, c))).collect();
        loop {
            let of_chosen = |i: usize| {
                (0..candidates.len()).filter(|c| is_chosen[*c] && is_training(*c) && shown[*c][i]).count()
            };
            let missing: Shown = std::array::from_fn(|i| usable[i] && of_chosen(i) < LEAST_VIEWS);
            let others = (0..candidates.len()).filter(|c| !is_chosen[*c] && is_training(*c));
            let best = others
                .map(|c| (count(shown[c], &missing), c))
                .max_by_key(|(n, c)| (*n, std::cmp::Reverse(*c)));
            match best {
                Some((n, c)) if n > 0 => is_chosen[c] = true,
                _ => break,
            }
        }
        candidates.iter().zip(is_chosen).filter_map(|(c, is_chosen)| is_chosen.then_some(c)).collect()
    }

    /// The places of the overlap boxes of tiles that a view shows, each at the middle height of its tile.
    fn coverage(&self, candidate: &Candidate, places: &[Place]) -> Result<Vec<Shown>, TilesError> {
        let view = candidate.view;
        // As large as the whole image, so that only one is in memory at a time.
        let valid = view.valid_pixels()?;
        let shown = |place: &Place| -> Shown {
            let ([w, s, e, n], a) = (place.overlap, self.area);
            // Images may be cropped to the area, so that nothing is known of the overlap beyond it.
            let [w, s, e, n] = [w.max(a[0]), s.max(a[1]), e.min(a[2]), n.min(a[3])];
            let height_m = 0.5 * (place.heights_m[0] + place.heights_m[1]);
            let at = |k: usize, low: f64, high: f64| low + (high - low) * (k as f64 + 0.5) / PLACES as f64;
            let is_seen = |i: usize| {
                let ground = Point::new(at(i % PLACES, w, e), at(i / PLACES, s, n), height_m);
                let px = view.rpc.project(self.site.geodetic_from_utm(ground));
                let (col, row) = (px.col.round(), px.row.round());
                let inside = col >= 0.0 && row >= 0.0 && col < view.width as f64 && row < view.height as f64;
                inside && valid.as_ref().is_none_or(|v| v.at(col as usize, row as usize))
            };
            std::array::from_fn(is_seen)
        };
        Ok(places.iter().map(shown).collect())
    }

    /// An error if an image is stored so that reading the windows of all tiles would read it many times.
    fn require_tiled_images(&self, tiles: &[Tile]) -> Result<(), TilesError> {
        let reads = tiles.iter().flat_map(|tile| &tile.views).filter_map(|planned| {
            let view = self.scene.views.iter().find(|view| view.name == planned.name)?;
            Some((view, Window::from(planned)))
        });
        Ok(require_tiled_images(reads).map_err(PipelineError::from)?)
    }
}

/// Number of parts and length of each, a multiple of `cell`, of a length cut into parts of at most the given size, all of at least
/// `least`: for that, parts may be a little longer, and a short length is one part.
fn cut(length: f64, size: CoreSize, least: f64, cell: f64) -> (usize, f64) {
    let cells = (length / cell).round().max(1.0);
    let longest = if length <= size.uncut_m { size.uncut_m } else { size.cut_m };
    let most = (longest / cell + 1e-6).floor().max(1.0);
    let mut parts = (cells / most).ceil();
    let each = |parts: f64| (cells / parts).ceil();
    let last = |parts: f64| cells - (parts - 1.0) * each(parts);
    while parts > 1.0 && last(parts) * cell < least - 1e-6 {
        parts -= 1.0;
    }
    (parts as usize, each(parts) * cell)
}

fn id(column: usize, row: usize) -> String {
    format!("x{column:03}_y{row:03}")
}

/// IDs of the eight places around a tile.
fn neighbours(id: &str) -> impl Iterator<Item = String> {
    let number = |part: Option<&str>| part.and_then(|p| p.get(1..)?.parse::<i64>().ok()).unwrap_or(0);
    let mut parts = id.split('_');
    let (x, y) = (number(parts.next()), number(parts.next()));
    let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))).filter(|d| *d != (0, 0));
    let places = around.map(move |(dx, dy)| (x + dx, y + dy)).filter(|(x, y)| *x >= 0 && *y >= 0);
    places.map(|(x, y)| self::id(x as usize, y as usize))
}

/// At most [`MAX_VIEWS`] training views, spread over directions and suns, and all test views; in the order of the scene.
///
/// The reference view comes first; each next one is that with the largest angle to the chosen ones.
fn spread<'a, 'b>(covering: &[&'a Candidate<'b>], reference: &str, height_m: f64) -> Vec<&'a Candidate<'b>> {
    let training: Vec<&Candidate> = covering.iter().copied().filter(|c| c.view.role == Role::Train).collect();
    if training.len() <= MAX_VIEWS {
        return covering.to_vec();
    }
    let directions: Vec<_> = training.iter().map(|c| directions_of(c.view, height_m)).collect();
    let first = training.iter().position(|c| c.view.name == reference).unwrap_or(0);
    let (mut chosen, mut nearest) = (vec![first], vec![f64::INFINITY; training.len()]);
    while chosen.len() < MAX_VIEWS {
        let last = directions[chosen[chosen.len() - 1]];
        for (near, d) in nearest.iter_mut().zip(&directions) {
            let (sight, sun) = (angle_between_deg(last.0, d.0), angle_between_deg(last.1, d.1));
            *near = near.min(sight.hypot(sun));
        }
        let free = (0..training.len()).filter(|i| !chosen.contains(i));
        let Some(next) = free.max_by(|a, b| nearest[*a].total_cmp(&nearest[*b]).then(b.cmp(a))) else {
            break;
        };
        chosen.push(next);
    }
    let is_chosen = |c: &&Candidate| {
        c.view.role == Role::Test || chosen.iter().any(|i| training[*i].view.name == c.view.name)
    };
    covering.iter().copied().filter(is_chosen).collect()
}

/// Directions to the satellite and to the sun: azimuth and angle from the zenith, degrees.
fn directions_of(view: &View, height_m: f64) -> ((f64, f64), (f64, f64)) {
    let sun = view.sun.map_or((0.0, 45.0), |s| (s.azimuth_deg, 90.0 - s.elevation_deg));
    (view.direction_deg(height_m).unwrap_or((0.0, 0.0)), sun)
}

/// An error if a box reaches too far out of the UTM zone of the site. All tiles have this zone, as an area of one tile has: a
/// transverse Mercator projection does not end at the border of its zone.
fn require_near_zone(site: &SiteGrid, [w, s, e, n]: MapBox) -> Result<(), TilesError> {
    // The last two digits of the code are the number of the zone.
    let middle_deg = 6.0 * f64::from(site.epsg % 100) - 183.0;
    let off_deg = [(w, s), (e, s), (e, n), (w, n)].map(|(x, y)| {
        let lon_deg = site.geodetic_from_utm(Point::new(x, y, 0.0)).lon_deg();
        wrap_longitude_deg(lon_deg - middle_deg).abs()
    });
    let off_deg = off_deg.into_iter().fold(0.0, f64::max);
    if off_deg <= FARTHEST_DEG {
        return Ok(());
    }
    Err(TilesError::OutOfZone { epsg: site.epsg, off_deg, farthest_deg: FARTHEST_DEG })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn parts_cover_a_length_exactly(cells in 1usize..5000, longest in 20.0..600.0f64, cell in 0.2..2.0f64) {
            let length = cells as f64 * cell;
            let least = 0.25 * longest;
            let (parts, each) = cut(length, CoreSize::uncut(longest.max(cell)), least, cell);
            prop_assert!(each <= 2.0 * longest.max(cell) + 1e-6);
            prop_assert!(parts == 1 || length - each * (parts - 1) as f64 >= least - 1e-6);
            prop_assert!((each / cell - (each / cell).round()).abs() < 1e-6);
            prop_assert!(each * parts as f64 >= length - 1e-6);
            prop_assert!(each * (parts - 1) as f64 + 1e-6 < length);
        }
    }

    #[test]
    fn parts_are_of_nearly_the_same_length() {
        let size = CoreSize { cut_m: 512.0, uncut_m: 768.0 };
        assert_eq!(cut(1000.0, size, 64.0, 0.5), (2, 500.0));
        assert_eq!(cut(512.0, size, 64.0, 0.5), (1, 512.0));
        assert_eq!(cut(1030.0, size, 64.0, 0.5), (3, 343.5));
        assert_eq!(cut(100.0, CoreSize::uncut(64.0), 64.0, 0.5), (1, 100.0));
    }

    #[test]
    fn an_area_a_little_longer_than_a_core_is_not_cut_unless_memory_is_short() {
        let size = CoreSize { cut_m: 512.0, uncut_m: 768.0 };
        assert_eq!(cut(522.0, size, 64.0, 0.5), (1, 522.0));
        assert_eq!(cut(769.0, size, 64.0, 0.5), (2, 384.5));
        let smaller = size.smaller();
        assert_eq!((smaller.cut_m, smaller.uncut_m), (512.0, 512.0));
        assert_eq!(cut(522.0, smaller, 64.0, 0.5), (2, 261.0));
        assert_eq!(smaller.smaller().cut_m, 256.0);
    }

    #[test]
    fn the_cores_of_an_area_are_those_of_its_plan() {
        let cores = |sides_m: [f64; 2]| PlanOptions::default().cores(sides_m);
        assert_eq!(cores([600.0, 600.0]), [(1, 600.0), (1, 600.0)]);
        assert_eq!(cores([1000.0, 1000.0]), [(2, 500.0), (2, 500.0)]);
        assert_eq!(cores([3000.0, 100.0]), [(6, 500.0), (1, 100.0)]);
    }

    #[test]
    fn neighbours_are_the_eight_places_around() {
        assert_eq!(neighbours("x001_y001").count(), 8);
        let corner: Vec<String> = neighbours("x000_y000").collect();
        assert_eq!(corner, ["x001_y000", "x000_y001", "x001_y001"]);
    }
}
