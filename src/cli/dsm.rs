//! `satgs dsm`: splats to a surface model and an orthophoto.

use super::products::Products;
use super::run_folder::{TrainedCameras, read_scene, require_image};
use super::stage::{Fingerprint, Stage, hash_file, or_none};
use super::{Failure, Ui, parse_metres, run_lock};
use crate::affine::SiteView;
use crate::dsm::{Heights, HeightsFrom, Seeing, Surface, hillshade, render};
use crate::io::{HeightSystem, ImageFile, MapGrid, Vertical, check_writable, write_png_gray};
use crate::mvs::{DSM_CELL_M, MatchedSurface};
use crate::run_files::{
    ADJUSTMENT, CAMERAS, CONFIDENCE, DSM, HILLSHADE, ORTHO, SPARSE_POINTS, SPLATS, SURFACE,
};
use crate::scene::{Role, View};
use crate::splat::raster::MAX_SIDE;
use crate::splat::train::recipe::RayHeight;
use std::path::{Path, PathBuf};

/// Render a trained run on the UTM grid: RUN/dsm.tif, RUN/ortho.tif, RUN/confidence.tif
///
/// dsm.tif holds heights in metres (float32, NaN nodata): the splats' surface, which recipe `best` has matched with the
/// images once more; `baeogs` and `eogs` take the mean of the splats' altitudes over nine cells. ortho.tif holds the
/// colours without shadows as the reference view would see them. confidence.tif holds for each cell the splats' opacity,
/// the spread of their altitudes (m) and the number of views that see it, 0 where its height was filled from around; cells
/// that valid pixels of fewer than two images cover are nodata. All are Cloud-Optimized GeoTIFFs that open in QGIS, with
/// dsm.qml to colour the heights there. hillshade.png is a picture of the surface.
#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    /// Folder that `satgs train RUN` filled
    run: PathBuf,
    #[command(flatten)]
    options: Options,
    /// Render anew though RUN holds a surface, of the same or of other input and options
    #[arg(long)]
    overwrite: bool,
}

/// What to render, on which grid.
#[derive(clap::Args, Clone, Debug)]
#[group(id = "surface")]
pub struct Options {
    /// Side of a cell in metres; the extent is the trained area
    #[arg(long, default_value_t = DSM_CELL_M, value_name = "M", value_parser = parse_metres, conflicts_with = "like")]
    resolution: f64,
    /// Take grid and extent from this raster
    #[arg(long, value_name = "RASTER")]
    like: Option<PathBuf>,
    /// What heights count from: `ellipsoid`, EGM84, EGM96, EGM2008 or a geoid grid (.gtx, .tif of PROJ)
    /// [default: as RUN/dsm.tif, if there is one, else the ellipsoid]
    #[arg(long, value_name = "REFERENCE")]
    vertical: Option<String>,
    /// Fill holes that reach no further than this between cells with heights, metres; confidence.tif says 0 views there
    #[arg(long, value_name = "M")]
    fill: Option<f64>,
    /// Write the relief as a raster as well: RUN/hillshade.tif
    #[arg(long)]
    hillshade: bool,
    /// Write the cells as a point cloud with colours as well (.laz or .las); a relative path counts from RUN
    #[arg(long, value_name = "FILE", value_parser = ending(&["laz", "las"]))]
    points: Option<PathBuf>,
    /// Write a mesh textured with the orthophoto as well (.glb); a relative path counts from RUN
    #[arg(long, value_name = "FILE", value_parser = ending(&["glb"]))]
    mesh: Option<PathBuf>,
}

/// Accepts paths with one of these endings.
fn ending(
    allowed: &'static [&'static str],
) -> impl Fn(&str) -> Result<PathBuf, String> + Clone + Send + Sync + 'static {
    move |text| {
        let path = PathBuf::from(text);
        let found = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        match found {
            Some(e) if allowed.contains(&e.as_str()) => Ok(path),
            _ => Err(format!("expected a file that ends in .{}", allowed.join(" or ."))),
        }
    }
}

impl Options {
    /// Opens what rendering will read and asks whether it can write, for what is wrong to be known before a long
    /// training.
    pub(super) fn check(&self, run: &Path) -> Result<(), Failure> {
        self.products()?.iter().try_for_each(|product| product.check(run))?;
        self.vertical.as_deref().map(Vertical::read).transpose()?;
        if let Some(path) = &self.like {
            check_size(&ImageFile::open(path)?.map_grid()?)?;
        }
        Ok(())
    }
}

/// What is made beside the rasters when asked for; it can be added to a surface that is there. Paths count from RUN.
enum Product {
    Hillshade,
    Points(PathBuf),
    Mesh(PathBuf),
}

impl Product {
    fn path(&self) -> &Path {
        match self {
            Self::Hillshade => Path::new(HILLSHADE),
            Self::Points(path) | Self::Mesh(path) => path,
        }
    }

    fn check(&self, run: &Path) -> Result<(), Failure> {
        Ok(check_writable(&run.join(self.path()))?)
    }

    fn write(&self, run: &Path, surface: &Surface, heights: &Heights) -> Result<(), Failure> {
        let path = run.join(self.path());
        let written = match self {
            Self::Hillshade => surface.write_hillshade(&path),
            Self::Points(_) => surface.write_points(&path, heights),
            Self::Mesh(_) => surface.write_mesh(&path, heights),
        };
        Ok(written?)
    }
}

impl Options {
    /// The products that are asked for.
    fn products(&self) -> Result<Vec<Product>, Failure> {
        let sparse = Path::new(ADJUSTMENT).join(SPARSE_POINTS);
        if self.points.as_ref().is_some_and(|path| *path == sparse) {
            let message = format!("--points: `{}` holds the run's tie points", sparse.display());
            return Err(Failure::input(message, "another name keeps them"));
        }
        let hillshade = self.hillshade.then_some(Product::Hillshade);
        let points = self.points.clone().map(Product::Points);
        Ok(hillshade.into_iter().chain(points).chain(self.mesh.clone().map(Product::Mesh)).collect())
    }
}

/// What heights are to count from: as asked, else as those that the run holds do, which an alignment does not change.
fn vertical_name(run: &Path, options: &Options) -> Result<String, Failure> {
    if let Some(asked) = &options.vertical {
        return Ok(asked.clone());
    }
    let dsm = run.join(DSM);
    let from = match dsm.exists() {
        // One that cannot be read says nothing.
        true => {
            ImageFile::open(&dsm).and_then(|file| HeightSystem::of_raster(&file)).map_or(None, |h| h.from)
        }
        false => None,
    };
    Ok(from.unwrap_or_else(|| Vertical::ELLIPSOID.into()))
}

/// No more cells than this: 40,000 squared.
const MAX_CELLS: f64 = 1.6e9;

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), Failure> {
    render_run(&args.run, &args.options, args.overwrite, ui)
}

/// Renders a run folder, unless that is done already.
pub fn render_run(run: &Path, options: &Options, overwrite: bool, ui: &Ui) -> Result<(), Failure> {
    run_lock::lock(run)?;
    let cameras = TrainedCameras::read(run)?;
    let setup = &cameras.setup;
    let grid = grid(options, &cameras)?;
    let above = vertical_name(run, options)?;
    let vertical = Vertical::read(&above)?;
    let outputs = [DSM, "dsm.qml", ORTHO, CONFIDENCE].map(|name| run.join(name)).to_vec();
    let stage = Stage::new(run, "dsm", outputs, fingerprint(run, &grid, &above, options));
    let is_done = stage.is_done(overwrite)?;
    let mut made = Products::read(run, stage.fingerprint());
    let mut products = options.products()?;
    products.retain(|product| !is_done || !made.has(product.path()));
    if is_done {
        ui.note(&format!("`{}` has its surface already", run.display()));
        ui.repeat_summary("dsm", stage.summary());
        if products.is_empty() {
            return Ok(());
        }
    } else {
        stage.require_writable()?;
    }
    products.iter().try_for_each(|product| product.check(run))?;
    let splats = cameras.read_splats(run)?;
    let reference = cameras.reference_appearance();
    let read = || MatchedSurface::read(&run.join(SURFACE), &setup.site);
    let matched = cameras.is_matched.then(read).transpose()?;
    let source = match (&matched, cameras.recipe.heights) {
        (Some(surface), _) => HeightsFrom::Matched(surface),
        (None, RayHeight::Median) => HeightsFrom::Median,
        (None, RayHeight::Mean) => HeightsFrom::Mean { floor: setup.altitudes.0 as f32 },
    };
    let mut surface = render(&splats, &setup.site, grid, &reference, source);
    setup.tone.show(&mut surface.colors);
    let views: Vec<_> = setup.views.iter().filter(|v| v.role == Role::Train).collect();
    let names: Vec<&str> = views.iter().map(|v| v.name.as_str()).collect();
    surface.metadata = vec![("INPUTS", names.join(", "))];
    surface.count_views(&setup.site, &seeing(run, &views)?);
    if let Some(matched) = &matched {
        surface.mark_filled(matched);
    }
    if let Some(reach_m) = options.fill {
        surface.fill(reach_m);
    }
    let heights = surface.heights_above(&vertical);
    if heights.plane.valid().next().is_none() && surface.height.valid().next().is_some() {
        let message = format!("the grid of `{}` has no undulation here", vertical.name());
        return Err(Failure::input(
            message,
            "EGM96 and EGM2008 grids of the whole Earth come with PROJ's data",
        ));
    }
    if !is_done {
        surface.write_dsm(&run.join(DSM), &heights)?;
        surface.write_ortho(&run.join(ORTHO))?;
        surface.write_confidence(&run.join(CONFIDENCE))?;
        let shade = hillshade(&surface.height, grid.cell);
        write_png_gray(&run.join("hillshade.png"), grid.width, grid.height, &shade)?;
    }
    for product in &products {
        product.write(run, &surface, &heights)?;
        made.add(product.path().into())?;
        ui.note(&format!("`{}` is written", run.join(product.path()).display()));
    }
    if is_done {
        return Ok(());
    }

    let seen = surface.height.valid().count();
    let share = 100.0 * seen as f64 / surface.height.data.len() as f64;
    let text = format!(
        "{} x {} cells of {} m, EPSG:{}, heights above {}, {share:.1} % seen\n{}\n{}",
        grid.width,
        grid.height,
        grid.cell,
        grid.epsg,
        vertical.name(),
        run.join(DSM).display(),
        run.join(ORTHO).display()
    );
    let json = serde_json::json!({ "grid": grid, "vertical": vertical.name(), "seen_percent": share });
    stage.complete(&json)?;
    ui.summary("dsm", &text, json);
    Ok(())
}

/// The views with their valid pixels, which are read from their images again where some are not.
fn seeing(run: &Path, views: &[&SiteView]) -> Result<Vec<Seeing>, Failure> {
    let is_masked = views.iter().any(|v| v.is_masked);
    let scene = is_masked.then(|| read_scene(run)).transpose()?;
    let of_view = |v: &&SiteView| {
        let mut views = scene.iter().flat_map(|s| &s.views);
        let view = views.find(|s| v.is_masked && s.name == v.name);
        view.map(require_image).transpose()?;
        let valid = view.map(View::valid_pixels).transpose()?.flatten();
        Ok(Seeing { camera: v.camera, size: v.size, valid })
    };
    views.iter().map(of_view).collect()
}

fn grid(options: &Options, cameras: &TrainedCameras) -> Result<MapGrid, Failure> {
    let site = &cameras.setup.site;
    let grid = match &options.like {
        Some(path) => ImageFile::open(path)?.map_grid()?,
        None => {
            let (w, s, e, n) = cameras.setup.area;
            let [x, y, _] = site.origin.xyz();
            MapGrid::covering(site.epsg, (x + w, y + s, x + e, y + n), options.resolution)
        }
    };
    if grid.epsg != site.epsg {
        let message = format!("the grid is in EPSG:{}, the run in EPSG:{}", grid.epsg, site.epsg);
        return Err(Failure::input(message, "gdalwarp -t_srs brings the reference raster over"));
    }
    check_size(&grid)?;
    Ok(grid)
}

fn check_size(grid: &MapGrid) -> Result<(), Failure> {
    if grid.width.max(grid.height) > MAX_SIDE || grid.width as f64 * grid.height as f64 > MAX_CELLS {
        let message = format!("{} x {} cells are too many", grid.width, grid.height);
        return Err(Failure::input(message, "a larger --resolution makes fewer"));
    }
    Ok(())
}

fn fingerprint(run: &Path, grid: &MapGrid, above: &str, options: &Options) -> Fingerprint {
    Fingerprint::from([
        ("--vertical".into(), Vertical::known_name(above)),
        ("--fill".into(), or_none(options.fill)),
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
    ])
}
