//! Surface model, orthophoto and confidence of a trained run: `satgs dsm`.

use super::outdated;
use super::product_lists::list_products;
use super::products::Products;
use super::report::renew_report;
use super::run_folder::stage::{Fingerprint, Outcome, Stage, hash_file, or_none};
use super::run_folder::tiled::{require_one_area, require_own_tile};
use super::surface_source::{KnownSurface, SurfaceSource, satellite_surface};
use super::{PipelineError, RunLock};
use crate::dsm::{CellCounts, Dsm, Heights, hillshade};
use crate::frame::{SiteBox, SiteGrid};
use crate::io::{HeightSystem, ImageFile, MapGrid, VerticalReference, check_writable, write_png_gray};
use crate::mvs::DSM_CELL_M;
use crate::progress::{Event, Progress};
use crate::run_files::{
    ABOVE_GROUND, ADJUSTMENT, CAMERAS, CONFIDENCE, DSM, GROUND, HILLSHADE, ORTHO, SPARSE_POINTS, SPLATS,
    SURFACE,
};
use crate::splat::raster::MAX_SIDE;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// No grid has more cells than this: 40,000 squared.
const MAX_CELLS: f64 = 1.6e9;

/// Which products to write, on which grid.
#[derive(Clone, Debug)]
pub struct DsmOptions {
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// Extent in the run's map projection: west, south, east and north, metres; by default the trained area. It is snapped
    /// outwards to whole cells.
    pub area: Option<(f64, f64, f64, f64)>,
    /// Use the grid and extent of this raster instead.
    pub like: Option<PathBuf>,
    /// Vertical reference of the heights: `ellipsoid`, a geoid model or a geoid's grid; by default that of an existing
    /// `RUN/dsm.tif`, else the ellipsoid.
    pub vertical: Option<String>,
    /// Also interpolate across cells without any height, holes up to this width, metres.
    pub fill_m: Option<f64>,
    /// Leave cells that fewer than two views confirm as nodata, instead of filling them in from the cells around them.
    pub no_fill: bool,
    /// Also write the shaded relief as a raster, `RUN/hillshade.tif`.
    pub hillshade: bool,
    /// Also write the bare ground and the heights above it: `RUN/dtm.tif`, `RUN/ndsm.tif`.
    pub dtm: bool,
    /// Also write the cells as a coloured point cloud (.laz, .las). A relative path counts from the run folder.
    pub points: Option<PathBuf>,
    /// Also write a textured mesh (.glb). A relative path counts from the run folder.
    pub mesh: Option<PathBuf>,
    /// Render again, and replace a surface in the run folder.
    pub overwrite: bool,
}

impl Default for DsmOptions {
    fn default() -> Self {
        Self {
            resolution_m: DSM_CELL_M,
            area: None,
            like: None,
            vertical: None,
            fill_m: None,
            no_fill: false,
            hillshade: false,
            dtm: false,
            points: None,
            mesh: None,
            overwrite: false,
        }
    }
}

impl DsmOptions {
    /// An error if an option is given, for scenes of which no surface model can be made.
    pub(crate) fn require_none(&self) -> Result<(), PipelineError> {
        // All fields are named, so that none is forgotten.
        let Self {
            resolution_m,
            area,
            like,
            vertical,
            fill_m,
            no_fill,
            hillshade,
            dtm,
            points,
            mesh,
            overwrite: _,
        } = self;
        let given = [
            ("--resolution", (resolution_m - DSM_CELL_M).abs() > 0.0),
            ("--like", area.is_some() || like.is_some()),
            ("--vertical", vertical.is_some()),
            ("--fill", fill_m.is_some()),
            ("--no-fill", *no_fill),
            ("--hillshade", *hillshade),
            ("--dtm", *dtm),
            ("--points", points.is_some()),
            ("--mesh", mesh.is_some()),
        ];
        match given.into_iter().find(|(_, is_given)| *is_given) {
            Some((option, _)) => Err(PipelineError::Option {
                option,
                found: "given for a scene of which no surface model is made".into(),
                expected: "a scene with a place on Earth, by --georef for example",
            }),
            None => Ok(()),
        }
    }

    /// Opens what rendering will read and checks that it can write, so that errors are found before a long training.
    ///
    /// # Errors
    /// [`PipelineError`] of the option that is wrong.
    pub fn check(&self, run: &Path) -> Result<(), PipelineError> {
        if !(self.resolution_m.is_finite() && self.resolution_m > 0.0) {
            let found = self.resolution_m.to_string();
            return Err(PipelineError::Option { option: "--resolution", found, expected: "metres above 0" });
        }
        if self.no_fill && self.fill_m.is_some() {
            let found = "given with --fill".into();
            return Err(PipelineError::Option { option: "--no-fill", found, expected: "one of the two" });
        }
        self.products()?.iter().try_for_each(|product| product.check(run))?;
        self.vertical.as_deref().map(VerticalReference::read).transpose()?;
        if let Some(path) = &self.like {
            check_size(&ImageFile::open(path)?.map_grid()?)?;
        }
        Ok(())
    }
}

/// Result of rendering a surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DsmSummary {
    /// Grid of the rasters.
    pub grid: MapGrid,
    /// Vertical reference of the heights.
    pub vertical: String,
    /// Numbers of cells with confirmed and with filled heights.
    pub cells: CellCounts,
}

/// Renders a trained run on a map grid, unless that was done with the same input and options. Products that are missing
/// are added to a surface that is complete; points, mesh and hillshade of a surface that is replaced are written again, and its
/// scores are removed.
///
/// Writes `RUN/dsm.tif`, `RUN/ortho.tif`, `RUN/confidence.tif` and the products that are asked for.
///
/// # Errors
/// [`PipelineError`]: the run is not trained, is in use or holds another surface, an option is wrong, a file cannot be
/// written.
pub fn dsm(
    run: &Path,
    options: &DsmOptions,
    progress: &dyn Progress,
) -> Result<Outcome<DsmSummary>, PipelineError> {
    let _lock = RunLock::existing(run)?;
    require_one_area(run)?;
    require_own_tile(run, options.overwrite)?;
    let outcome = dsm_locked(run, options, progress)?;
    match outcome {
        Outcome::Made(_) => renew_report(run)?,
        // Products may have been added.
        Outcome::Kept(_) => list_products(run)?,
    }
    Ok(outcome)
}

/// As [`dsm`]; the caller holds the lock.
pub(crate) fn dsm_locked(
    run: &Path,
    options: &DsmOptions,
    progress: &dyn Progress,
) -> Result<Outcome<DsmSummary>, PipelineError> {
    let source = SurfaceSource::read(run)?;
    if options.no_fill && !source.counts_views() {
        let found = "given for photographs".into();
        let expected = "a satellite scene: views of photographs are not counted in each cell";
        return Err(PipelineError::Option { option: "--no-fill", found, expected });
    }
    let grid = grid(options, source.site(), source.area())?;
    let above = vertical_name(run, options)?;
    let vertical = VerticalReference::read(&above)?;
    let outputs = [DSM, "dsm.qml", ORTHO, CONFIDENCE].map(|name| run.join(name)).to_vec();
    let stage = Stage::new(run, "dsm", outputs, fingerprint(run, &grid, &above, options));
    let is_done = stage.is_done(options.overwrite)?;
    let mut made = Products::read(run, stage.fingerprint())?;
    let mut products = options.products()?;
    products.retain(|product| !is_done || !product.files().all(|file| made.has(file)));
    if is_done {
        progress.event(Event::Note(format!("`{}` has its surface already", run.display())));
        if products.is_empty() {
            return Ok(Outcome::Kept(stage.summary()?));
        }
    } else {
        stage.require_writable()?;
    }
    products.iter().try_for_each(|product| product.check(run))?;
    let (surface, heights) = completed(source.surface(run, grid)?, options, &vertical)?;
    if !is_done {
        write_rasters(run, &surface, &heights)?;
        outdated::after_surface(run, progress)?;
        Product::add_those_of(made.outdated(), &mut products);
    }
    for product in &products {
        product.write(run, &surface, &heights)?;
        for file in product.files() {
            made.add(file.into())?;
            progress.event(Event::Note(format!("`{}` is written", run.join(file).display())));
        }
    }
    if is_done {
        return Ok(Outcome::Kept(stage.summary()?));
    }
    let summary = DsmSummary { grid, vertical: vertical.name().into(), cells: surface.counts() };
    stage.complete(&summary)?;
    Ok(Outcome::Made(summary))
}

/// Writes the rasters of a surface whose heights are known although its splats are still to be trained. The stage is complete
/// only when it is rendered from the trained ones.
pub(crate) fn before_training(
    run: &Path,
    options: &DsmOptions,
    known: &KnownSurface,
    progress: &dyn Progress,
) -> Result<(), PipelineError> {
    let KnownSurface { cameras, splats, heights } = known;
    let grid = grid(options, &cameras.setup.site, cameras.setup.area)?;
    let vertical = VerticalReference::read(&vertical_name(run, options)?)?;
    let surface = satellite_surface(cameras, splats, Some(heights), run, grid)?;
    let (surface, heights) = completed(surface, options, &vertical)?;
    write_rasters(run, &surface, &heights)?;
    let made = Products::all(run).into_iter().filter(|file| file.is_relative() && run.join(file).exists());
    let mut products = Vec::new();
    Product::add_those_of(made, &mut products);
    products.iter().try_for_each(|product| product.write(run, &surface, &heights))?;
    list_products(run)?;
    let [dsm, confidence, ortho] = [DSM, CONFIDENCE, ORTHO].map(|name| run.join(name));
    progress.event(Event::Note(format!(
        "`{}`, `{}` and `{}` are written; training will change only the colours of the orthophoto",
        dsm.display(),
        confidence.display(),
        ortho.display()
    )));
    Ok(())
}

/// A rendered surface, filled or without its fills as asked for, and its heights above a vertical reference.
fn completed<'a>(
    mut surface: Dsm,
    options: &DsmOptions,
    vertical: &'a VerticalReference,
) -> Result<(Dsm, Heights<'a>), PipelineError> {
    if let Some(reach_m) = options.fill_m {
        surface.fill(reach_m);
    }
    if options.no_fill {
        surface.keep_confirmed();
    }
    let heights = surface.heights_above(vertical);
    if heights.raster.valid().next().is_none() && surface.height.valid().next().is_some() {
        return Err(PipelineError::NoUndulation { name: vertical.name().into() });
    }
    Ok((surface, heights))
}

fn write_rasters(run: &Path, surface: &Dsm, heights: &Heights) -> Result<(), PipelineError> {
    let grid = surface.grid;
    surface.write_dsm(&run.join(DSM), heights)?;
    surface.write_ortho(&run.join(ORTHO))?;
    surface.write_confidence(&run.join(CONFIDENCE))?;
    let shade = hillshade(&surface.height, grid.cell);
    Ok(write_png_gray(&run.join("hillshade.png"), grid.width, grid.height, &shade)?)
}

/// An optional product, which can be added to a complete surface. Paths count from the run folder.
#[derive(PartialEq)]
enum Product {
    Hillshade,
    /// The bare ground, and the heights above it.
    Ground,
    Points(PathBuf),
    Mesh(PathBuf),
}

impl Product {
    fn files(&self) -> impl Iterator<Item = &Path> {
        let (first, second) = match self {
            Self::Hillshade => (Path::new(HILLSHADE), None),
            Self::Ground => (Path::new(GROUND), Some(Path::new(ABOVE_GROUND))),
            Self::Points(path) | Self::Mesh(path) => (path.as_path(), None),
        };
        std::iter::once(first).chain(second)
    }

    /// Adds the products of files to a list, each once.
    fn add_those_of(files: impl IntoIterator<Item = PathBuf>, list: &mut Vec<Self>) {
        for product in files.into_iter().filter_map(Self::of_file) {
            if !list.contains(&product) {
                list.push(product);
            }
        }
    }

    /// The product that a file is, by its name.
    fn of_file(path: PathBuf) -> Option<Self> {
        let ending = path.extension()?.to_string_lossy().to_lowercase();
        match ending.as_str() {
            _ if path == Path::new(HILLSHADE) => Some(Self::Hillshade),
            _ if [GROUND, ABOVE_GROUND].map(Path::new).contains(&path.as_path()) => Some(Self::Ground),
            "laz" | "las" => Some(Self::Points(path)),
            "glb" => Some(Self::Mesh(path)),
            _ => None,
        }
    }

    fn check(&self, run: &Path) -> Result<(), PipelineError> {
        self.files().try_for_each(|file| check_writable(&run.join(file)))?;
        Ok(())
    }

    fn write(&self, run: &Path, surface: &Dsm, heights: &Heights) -> Result<(), PipelineError> {
        let written = match self {
            Self::Hillshade => surface.write_hillshade(&run.join(HILLSHADE)),
            Self::Ground => surface.write_ground(&run.join(GROUND), &run.join(ABOVE_GROUND), heights),
            Self::Points(path) => surface.write_points(&run.join(path), heights),
            Self::Mesh(path) => surface.write_mesh(&run.join(path), heights),
        };
        Ok(written?)
    }
}

impl DsmOptions {
    /// The products that are asked for.
    fn products(&self) -> Result<Vec<Product>, PipelineError> {
        let sparse = Path::new(ADJUSTMENT).join(SPARSE_POINTS);
        if self.points.as_ref().is_some_and(|path| *path == sparse) {
            return Err(PipelineError::PointsTaken { path: sparse });
        }
        let hillshade = self.hillshade.then_some(Product::Hillshade);
        let ground = self.dtm.then_some(Product::Ground);
        let points = self.points.clone().map(Product::Points);
        Ok(hillshade
            .into_iter()
            .chain(ground)
            .chain(points)
            .chain(self.mesh.clone().map(Product::Mesh))
            .collect())
    }
}

/// Name of the vertical reference: the one asked for, else that of the heights in the run, which an alignment keeps.
fn vertical_name(run: &Path, options: &DsmOptions) -> Result<String, PipelineError> {
    if let Some(asked) = &options.vertical {
        return Ok(asked.clone());
    }
    let dsm = run.join(DSM);
    let from = match dsm.exists() {
        // A raster that cannot be read says nothing.
        true => {
            ImageFile::open(&dsm).and_then(|file| HeightSystem::of_raster(&file)).map_or(None, |h| h.from)
        }
        false => None,
    };
    Ok(from.unwrap_or_else(|| VerticalReference::ELLIPSOID.into()))
}

fn grid(options: &DsmOptions, site: &SiteGrid, trained: SiteBox) -> Result<MapGrid, PipelineError> {
    let grid = match &options.like {
        Some(path) => ImageFile::open(path)?.map_grid()?,
        None => {
            let (w, s, e, n) = trained;
            let [x, y, _] = site.origin.xyz();
            let area = options.area.unwrap_or((x + w, y + s, x + e, y + n));
            MapGrid::covering(site.epsg, area, options.resolution_m)
        }
    };
    if grid.epsg != site.epsg {
        return Err(PipelineError::GridCrs { grid: grid.epsg, run: site.epsg });
    }
    check_size(&grid)?;
    Ok(grid)
}

fn check_size(grid: &MapGrid) -> Result<(), PipelineError> {
    if grid.width.max(grid.height) > MAX_SIDE || grid.width as f64 * grid.height as f64 > MAX_CELLS {
        return Err(PipelineError::GridSize { width: grid.width, height: grid.height });
    }
    Ok(())
}

fn fingerprint(run: &Path, grid: &MapGrid, above: &str, options: &DsmOptions) -> Fingerprint {
    let mut fingerprint = Fingerprint::from([
        ("--vertical".into(), VerticalReference::known_name(above)),
        ("--fill".into(), or_none(options.fill_m)),
        ("surface".into(), hash_file(&run.join(SURFACE))),
        ("splats".into(), hash_file(&run.join(SPLATS))),
        ("cameras".into(), hash_file(&run.join(CAMERAS))),
        (
            "grid (--resolution, --like)".into(),
            format!(
                "{} x {} cells of {} m from {} east, {} north, EPSG:{}",
                grid.width, grid.height, grid.cell, grid.west, grid.north, grid.epsg
            ),
        ),
    ]);
    if options.no_fill {
        fingerprint.insert("--no-fill".into(), "given".into());
    }
    fingerprint
}
