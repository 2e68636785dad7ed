//! `satgs dsm`: splats to a surface model and an orthophoto.

use super::{CliError, Ui, parse_metres};
use crate::mvs::DSM_CELL_M;
use crate::pipeline::{DsmOptions, DsmSummary, Outcome, dsm};
use crate::run_files::{DSM, ORTHO};
use std::path::{Path, PathBuf};

/// Render the surface model of a trained run: writes RUN/dsm.tif, RUN/ortho.tif and RUN/confidence.tif
///
/// All are Cloud-Optimized GeoTIFFs on the UTM grid. dsm.tif holds heights in metres (float32, nodata NaN): with recipe
/// `best` from matching the images once more near the surface of the splats, with `baeogs` and `eogs` the mean altitude of the
/// splats over 3 x 3 cells. ortho.tif is the orthophoto: the colours of the reference view (the training view nearest to nadir with
/// a high sun) without shadows. confidence.tif has four bands: opacity of the splats, standard deviation of their altitudes (m),
/// number of views that see the cell, expected error of the height (m). Heights that fewer than two views confirm are filled in from
/// the cells around them (--no-fill: nodata). Cells that fewer than two images cover are nodata.
///
/// Replacing a surface rewrites its points, mesh, hillshade and ground, and removes its scores in RUN/eval. dsm.qml is a QGIS
/// style for dsm.tif, hillshade.png a picture of the surface.
#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    /// Run folder of `satgs train`
    run: PathBuf,
    #[command(flatten)]
    options: Options,
    /// Render again. By default a surface of the same input and options is kept, and any other is an error
    #[arg(long)]
    overwrite: bool,
}

/// What to render, on which grid.
#[derive(clap::Args, Clone, Debug)]
#[group(id = "surface")]
pub struct Options {
    /// Side of a cell, metres
    ///
    /// The extent is the trained area.
    #[arg(long, default_value_t = DSM_CELL_M, value_name = "M", value_parser = parse_metres, conflicts_with = "like", help_heading = "Products")]
    resolution: f64,
    /// Use the grid and extent of this raster
    #[arg(long, value_name = "RASTER", hide_short_help = true, help_heading = "Products")]
    like: Option<PathBuf>,
    /// Vertical reference of dsm.tif, such as `ellipsoid` or EGM2008
    ///
    /// `ellipsoid`, EGM84, EGM96, EGM2008, or a geoid grid (.gtx, .tif of PROJ) [default: that of RUN/dsm.tif if it exists, else the
    /// ellipsoid].
    #[arg(long, value_name = "REFERENCE", help_heading = "Products")]
    vertical: Option<String>,
    /// Also interpolate across cells without any height, holes up to this width, metres [default: they stay nodata]
    ///
    /// confidence.tif has 0 views there.
    #[arg(long, value_name = "M", hide_short_help = true, help_heading = "Products")]
    fill: Option<f64>,
    /// Leave cells that fewer than two views confirm as nodata
    ///
    /// By default they are filled in from the cells around them, and confidence.tif has fewer than two views there.
    #[arg(long, conflicts_with = "fill", help_heading = "Products")]
    no_fill: bool,
    /// Also write the shaded relief as a raster: RUN/hillshade.tif
    #[arg(long, hide_short_help = true, help_heading = "Products")]
    hillshade: bool,
    /// Also write the bare ground (RUN/dtm.tif) and the heights above it (RUN/ndsm.tif)
    ///
    /// Morphological filters (SMRF, then PMF) remove trees and buildings up to 120 m wide; the ground under them is interpolated.
    #[arg(long, hide_short_help = true, help_heading = "Products")]
    dtm: bool,
    /// Also write the cells of dsm.tif as a coloured point cloud (.laz or .las)
    ///
    /// A relative path is resolved against RUN.
    #[arg(long, value_name = "FILE", value_parser = super::ending(&["laz", "las"]), hide_short_help = true, help_heading = "Products")]
    points: Option<PathBuf>,
    /// Also write dsm.tif as a mesh textured with the orthophoto (.glb); `satgs mesh` makes one with walls
    ///
    /// A relative path is resolved against RUN.
    #[arg(long, value_name = "FILE", value_parser = super::ending(&["glb"]), hide_short_help = true, help_heading = "Products")]
    mesh: Option<PathBuf>,
}

impl Options {
    /// The options as the library takes them.
    pub fn options(&self, overwrite: bool) -> DsmOptions {
        DsmOptions {
            resolution_m: self.resolution,
            area: None,
            like: self.like.clone(),
            vertical: self.vertical.clone(),
            fill_m: self.fill,
            no_fill: self.no_fill,
            hillshade: self.hillshade,
            dtm: self.dtm,
            points: self.points.clone(),
            mesh: self.mesh.clone(),
            overwrite,
        }
    }
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    show(&args.run, &dsm(&args.run, &args.options.options(args.overwrite), ui)?, ui)
}

/// Shows the summary of a surface model.
pub fn show(run: &Path, outcome: &Outcome<DsmSummary>, ui: &Ui) -> Result<(), CliError> {
    let text = |s: &DsmSummary| {
        format!(
            "{} x {} cells of {} m, EPSG:{}, heights above {}\n{}\n{}\n{}",
            s.grid.width,
            s.grid.height,
            s.grid.cell,
            s.grid.epsg,
            s.vertical,
            s.cells.text(),
            run.join(DSM).display(),
            run.join(ORTHO).display()
        )
    };
    ui.outcome("dsm", outcome, text)
}
