//! `satgs align`: one shift that brings everything a run holds to a reference.

use super::{CliError, Ui};
use crate::coregister::Shift;
use crate::pipeline::{AlignOptions, align};
use std::path::PathBuf;

/// Align a run to a reference: one shift east, north and up of its cameras, points, splats and rasters
///
/// The shift and its standard deviations are estimated from RUN/dsm.tif, or from the sparse points if there is no dsm.tif.
/// The run is not moved in directions that the reference does not determine, such as along smooth ground. The shift is applied
/// to RUN/ba (corrected RPCs, points, tie points), cameras.json, the splats, the surfaces in RUN/train, dsm.tif, ortho.tif,
/// confidence.tif and hillshade.tif: to all of them or, if the command fails, to none. RUN/align.json records it.
/// Point clouds, meshes and scores in RUN have the old position and are removed, with a message; rendered images and files
/// outside RUN do not change. `satgs dsm RUN` renders the surface again on a grid aligned to multiples of the cell size.
#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    /// Run folder of `satgs ba`, or of later stages
    run: PathBuf,
    /// Reference: a surface model (any raster in a projected CRS in metres, DFC2019's .tif with its .txt), lidar points (.las,
    /// .laz), or ground control points (.csv, in the format of `satgs ba --gcps`)
    #[arg(long, value_name = "REFERENCE")]
    to: PathBuf,
    /// Vertical reference of the heights of --to: `ellipsoid`, EGM84, EGM96, EGM2008 or a geoid grid (.gtx, .tif of PROJ)
    /// [default: as its CRS or VERTICAL_REFERENCE says, else the ellipsoid]
    #[arg(long, value_name = "REFERENCE")]
    vertical: Option<String>,
    /// EPSG code of a point cloud that does not state its own
    #[arg(long, value_name = "EPSG")]
    crs: Option<u32>,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    let options =
        AlignOptions { reference: args.to.clone(), vertical: args.vertical.clone(), epsg: args.crs };
    let aligned = align(&args.run, &options, ui)?;
    let found = &aligned.alignment;
    let Shift { east_m, north_m, up_m } = found.shift;
    let text = format!(
        "{east_m:+.3} m east, {north_m:+.3} m north, {up_m:+.3} m up, from {} points; median distance afterwards {:.2} m; {}{}",
        found.points,
        found.left_m,
        found.sigma_text(),
        found.fit.as_ref().map_or_else(String::new, |fit| format!("; {fit}"))
    );
    let text = if aligned.was_moved {
        format!("moved {text}")
    } else {
        format!("`{}` is aligned already: {text}", args.run.display())
    };
    ui.summary_of("align", Some(&text), &aligned, !aligned.was_moved)
}
