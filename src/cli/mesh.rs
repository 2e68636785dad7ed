//! `satgs mesh`: a mesh of a run or of a scene with depth maps.

use super::{CliError, Ui, ending, parse_metres};
use crate::pipeline::{MeshOptions, MeshSummary, mesh};
use std::path::PathBuf;

/// Make a mesh with walls and colours (.ply, .obj, .glb) of a run, or of a scene with depth maps
///
/// Depth maps are fused into a truncated signed distance function (TSDF) on voxels, whose zero surface
/// is the mesh; its 50 largest pieces of at least 50 triangles are kept. The depth maps of a run are
/// rendered in each training view, for satellite images also from straight above; a scene has its own.
/// Coordinates are those of the scene; for satellite images, metres from the site's origin, which
/// FILE.georef.json beside the mesh states.
///
///   defaults                      --voxel            --depth-max
///   satellite run                 0.5 m              no limit
///   RGB-D, ScanNet++, their runs  0.02 m             5 m
///   photographs from inside       95 % quantile of   99.9 % quantile of the depths (run: 95 %)
///                                 the depths / 250
///   other photographs             depth-max / 1024   twice the distance of the nearest camera from
///                                                    the point that all cameras look at
///
///   satgs mesh run -o town.glb
///   satgs mesh kitchen -o reference.ply --voxel 0.01
#[derive(clap::Args, Clone, Debug)]
#[command(verbatim_doc_comment)]
pub struct Args {
    /// Run folder of `satgs train`, or a scene with depth maps
    #[arg(value_name = "RUN_OR_SCENE")]
    input: PathBuf,
    /// The mesh
    #[arg(short, long, value_name = "FILE", value_parser = ending(&["ply", "obj", "glb"]))]
    output: PathBuf,
    /// Side of a voxel, metres (the scene's unit) [default: see above]
    #[arg(long, value_name = "METRES", value_parser = parse_metres)]
    voxel: Option<f64>,
    /// Truncation distance of the TSDF, metres [default: 4 voxels]
    #[arg(long, value_name = "METRES", value_parser = parse_metres)]
    truncation: Option<f64>,
    /// Leave out greater depths, metres; not for satellite runs [default: see above]
    #[arg(long, value_name = "METRES", value_parser = parse_metres)]
    depth_max: Option<f64>,
    /// Replace the mesh if it exists
    #[arg(long)]
    overwrite: bool,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    let options = MeshOptions {
        voxel_m: args.voxel,
        truncation_m: args.truncation,
        depth_max_m: args.depth_max,
        overwrite: args.overwrite,
    };
    let summary = mesh(&args.input, &args.output, &options, ui)?;
    ui.summary("mesh", Some(&text(&summary)), &summary)
}

fn text(s: &MeshSummary) -> String {
    let limit = match (s.depth_max_m, s.depths_beyond) {
        (Some(most), Some(share)) => {
            let beyond = if share > 0.0 { format!("{:.1} %", 100.0 * share) } else { "none".into() };
            format!(", depths up to {most:.2} m ({beyond} of them are beyond)")
        }
        _ => String::new(),
    };
    format!(
        "{}: {} vertices, {} triangles in {} pieces ({} smaller ones left out)\n{} depth maps, voxels of {} m, \
         truncation {} m, {:.0} MB{limit}",
        s.output.display(),
        s.vertices,
        s.triangles,
        s.pieces,
        s.pieces_left_out,
        s.depth_maps,
        s.voxel_m,
        s.truncation_m,
        s.volume_mb
    )
}
