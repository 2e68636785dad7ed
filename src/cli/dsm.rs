//! `satgs dsm`: splats to a surface model and an orthophoto.

use super::stage::{Fingerprint, Stage, hash_file};
use super::train::{TrainedCameras, read_json};
use super::{Failure, Ui};
use crate::bundle::Adjustment;
use crate::dsm::{hillshade, render};
use crate::raster::{ImageFile, MapGrid, write_png_gray};
use crate::scene::Scene;
use crate::splat::ply;
use crate::splat::setup::Setup;
use crate::splat::sweep::Sweep;
use std::path::{Path, PathBuf};

/// Render a trained run on the UTM grid: RUN/dsm.tif, RUN/ortho.tif
///
/// dsm.tif holds ellipsoidal heights in metres (float32, NaN nodata): the splats' surface, which recipe `best` matches
/// with the images once more. ortho.tif holds the colours without shadows as the reference view would see them. Both
/// are Cloud-Optimized GeoTIFFs that open in QGIS. hillshade.png is a picture of the surface.
#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    /// Folder that `satgs train RUN` filled
    run: PathBuf,
    #[command(flatten)]
    options: Options,
    /// Render anew even if RUN holds a surface of other input or options
    #[arg(long)]
    overwrite: bool,
}

/// On which grid to render.
#[derive(clap::Args, Clone, Debug)]
#[group(id = "surface")]
pub struct Options {
    /// Side of a cell in metres; the extent is the trained area
    #[arg(long, default_value_t = 0.5, value_name = "M", conflicts_with = "like")]
    resolution: f64,
    /// Take grid and extent from this raster
    #[arg(long, value_name = "RASTER")]
    like: Option<PathBuf>,
}

/// No more cells than this: 40,000 squared.
const MAX_CELLS: f64 = 1.6e9;

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), Failure> {
    render_run(&args.run, &args.options, args.overwrite, ui)
}

/// Renders a run folder, unless that is done already.
pub fn render_run(run: &Path, options: &Options, overwrite: bool, ui: &Ui) -> Result<(), Failure> {
    let cameras = TrainedCameras::read(run)?;
    let setup = &cameras.setup;
    let grid = grid(options, &cameras)?;
    let stage = Stage::new(run, "dsm", &["dsm.tif", "ortho.tif"], fingerprint(run, &grid));
    if stage.is_done(overwrite)? {
        ui.note(&format!("`{}` has its surface already", run.display()));
        return Ok(());
    }
    let splats = ply::read(&run.join("splats.ply"))?;
    let reference =
        cameras.appearances.get(setup.reference_among_training()).map(|a| a.1).unwrap_or_default();
    let mut surface = render(&splats, &setup.site, grid, &reference);
    if cameras.recipe.sweep
        && let Some(sweep) = sweep(run, setup)?
    {
        surface.sharpen(&splats, &setup.site, &sweep, &|e| ui.show(e));
    }
    surface.write_dsm(&run.join("dsm.tif"))?;
    surface.write_ortho(&run.join("ortho.tif"))?;
    let shade = hillshade(&surface.height, grid.cell);
    write_png_gray(&run.join("hillshade.png"), grid.width, grid.height, &shade)?;
    stage.complete()?;

    let seen = surface.height.valid().count();
    let share = 100.0 * seen as f64 / surface.height.data.len() as f64;
    let text = format!(
        "{} x {} cells of {} m, EPSG:{}, {share:.1} % seen\n{}\n{}",
        grid.width,
        grid.height,
        grid.cell,
        grid.epsg,
        run.join("dsm.tif").display(),
        run.join("ortho.tif").display()
    );
    let json = serde_json::json!({ "grid": grid, "seen_percent": share });
    ui.summary("dsm", &text, json);
    Ok(())
}

/// The sweep by which a surface is sharpened; none if no two views can be matched.
fn sweep(run: &Path, setup: &Setup) -> Result<Option<Sweep>, Failure> {
    let scene: Scene = read_json(&run.join("scene.json"), "`satgs ba SCENE -o RUN` makes it")?;
    let points = Adjustment::read(&run.join("ba"))?.positions();
    Ok(Sweep::new(setup, &setup.training_views(&scene)?, &setup.sparse(&points)))
}

fn grid(options: &Options, cameras: &TrainedCameras) -> Result<MapGrid, Failure> {
    let site = &cameras.setup.site;
    let grid = match &options.like {
        Some(path) => ImageFile::open(path)?.map_grid()?,
        None => {
            if !(options.resolution.is_finite() && options.resolution > 0.0) {
                let message = format!("--resolution {} is no cell size", options.resolution);
                return Err(Failure::input(message, "metres, e.g. 0.5"));
            }
            let (w, s, e, n) = cameras.setup.area;
            let [x, y, _] = site.origin.xyz();
            MapGrid::covering(site.epsg, (x + w, y + s, x + e, y + n), options.resolution)
        }
    };
    if grid.epsg != site.epsg {
        let message = format!("the grid is in EPSG:{}, the run in EPSG:{}", grid.epsg, site.epsg);
        return Err(Failure::input(message, "gdalwarp -t_srs brings the reference raster over"));
    }
    if grid.width as f64 * grid.height as f64 > MAX_CELLS {
        let message = format!("{} x {} cells are too many", grid.width, grid.height);
        return Err(Failure::input(message, "a larger --resolution makes fewer"));
    }
    Ok(grid)
}

fn fingerprint(run: &Path, grid: &MapGrid) -> Fingerprint {
    Fingerprint::from([
        ("splats".into(), hash_file(&run.join("splats.ply"))),
        ("cameras".into(), hash_file(&run.join("cameras.json"))),
        ("grid".into(), serde_json::to_string(grid).unwrap_or_default()),
    ])
}
