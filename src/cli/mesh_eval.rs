//! `satgs mesh-eval`: a mesh against a reference.

use super::{CliError, Ui, ending, parse_metres};
use crate::pipeline::{MeshEvalOptions, MeshEvaluation, mesh_eval};
use std::fmt::Write;
use std::path::PathBuf;

/// Score a mesh against a reference: accuracy, completeness, precision, recall, F1, chamfer distance
///
/// Both surfaces are sampled by area, at points 0.4 times the threshold apart, so that the size of
/// triangles does not matter. Accuracy is the mean distance from the mesh to the reference,
/// completeness the mean distance from the reference to the mesh, chamfer the mean of both. Precision
/// and recall are the shares of these distances below the threshold, F1 their harmonic mean.
/// --views first cuts both meshes to what the views see: they are rendered to depth maps and fused
/// again (voxels of 4 cm, truncation 12 cm, depths up to 5 m; satellite views: 1 m, 3 m, any depth).
///
///   satgs mesh-eval mesh.ply reference.ply --views kitchen
///   satgs mesh-eval town.ply lidar.ply --threshold 1 --error-mesh errors.ply
#[derive(clap::Args, Clone, Debug)]
#[command(verbatim_doc_comment)]
pub struct Args {
    /// The mesh (.ply, .obj)
    mesh: PathBuf,
    /// The reference (.ply, .obj)
    reference: PathBuf,
    /// Distance up to which a point counts as correct, metres
    #[arg(long, value_name = "METRES", default_value = "0.05", value_parser = parse_metres)]
    threshold: f64,
    /// Cut both meshes to what the views of this run or scene see; it must be in the frame of the reference
    #[arg(long, value_name = "RUN_OR_SCENE")]
    views: Option<PathBuf>,
    /// Move the mesh by the similarity that fits the camera centres of this run or scene to those of --views
    ///
    /// For a mesh in another frame, such as COLMAP's. Cameras of images with the same name correspond.
    #[arg(long, value_name = "RUN_OR_SCENE", requires = "views")]
    align: Option<PathBuf>,
    /// Write the mesh coloured by its errors (.ply, .obj, .glb): green 0, yellow the threshold, red twice the threshold or more
    #[arg(long, value_name = "FILE", value_parser = ending(&["ply", "obj", "glb"]))]
    error_mesh: Option<PathBuf>,
    /// Replace the error mesh if it exists
    #[arg(long)]
    overwrite: bool,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    let options = MeshEvalOptions {
        threshold_m: args.threshold,
        views: args.views.clone(),
        align: args.align.clone(),
        error_mesh: args.error_mesh.clone(),
        overwrite: args.overwrite,
    };
    let evaluation = mesh_eval(&args.mesh, &args.reference, &options, ui)?;
    ui.summary("mesh-eval", Some(&text(&evaluation)), &evaluation)
}

fn text(e: &MeshEvaluation) -> String {
    let s = &e.scores;
    let mut out = String::new();
    if let Some(a) = &e.alignment {
        let by = if a.by_attitudes { " and their attitudes, because they lie near a line" } else { "" };
        let _ =
            writeln!(out, "aligned by {} camera centres{by}: scale {:.5}, {}", a.images, a.scale, a.quality);
        if let Some(names) = a.quality.left_out_text() {
            let _ = writeln!(out, "left out, because they disagree with the others: {names}");
        }
    }
    if let Some(views) = e.views {
        let _ = writeln!(out, "cut to what {views} views see");
    }
    let _ = writeln!(
        out,
        "accuracy {:.4} m  completeness {:.4} m  chamfer {:.4} m\n\
         precision {:.4}  recall {:.4}  F1 {:.4} at {} m\n\
         {} places {:.3} m apart, {} places {:.3} m apart on the reference",
        s.accuracy_m,
        s.completeness_m,
        s.chamfer_m,
        s.precision,
        s.recall,
        s.f1,
        s.threshold_m,
        s.places,
        s.spacing_m[0],
        s.reference_places,
        s.spacing_m[1]
    );
    out
}
