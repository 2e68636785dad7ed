//! `satgs simulate`: a scene with a known answer.

use super::{CliError, Ui};
use crate::simulate::{Relief, SimulateOptions, Summary, simulate};
use std::fmt::Write;
use std::path::PathBuf;

/// Simulate a test scene: images of a small town with RPC cameras, and the exact surface model
///
/// OUT gets 8-bit RGB GeoTIFFs; their RPC tags have pointing errors of several pixels, their metadata give the sun's
/// position. OUT/truth gets the exact DSM, its classes (DFC2019's codes), the true RPCs and the pointing errors. The same
/// options give the same bytes.
#[derive(clap::Args)]
#[command(
    after_help = "Example: satgs simulate town && satgs run town -o run --truth town/truth/TOWN_DSM.tif"
)]
pub struct Args {
    /// Folder for the scene
    out: PathBuf,
    /// Seed of the random town
    #[arg(long, default_value_t = 0, value_name = "N")]
    seed: u64,
    /// Number of images; 8 or more are recommended
    #[arg(long, default_value_t = 10, value_name = "N")]
    views: usize,
    /// Columns and rows of every image, pixels
    #[arg(long, default_value_t = 400, value_name = "PX")]
    size: usize,
    /// Ground sampling distance at nadir, metres
    #[arg(long, default_value_t = 0.5, value_name = "M")]
    gsd: f64,
    /// Put the town on hills: 60 m of relief instead of about 15 m
    #[arg(long)]
    hilly: bool,
    /// Replace the files of an earlier simulation in OUT
    #[arg(long)]
    overwrite: bool,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    let options = SimulateOptions {
        seed: args.seed,
        views: args.views,
        size_px: args.size,
        gsd_m: args.gsd,
        relief: if args.hilly { Relief::Hilly } else { Relief::Rolling },
        overwrite: args.overwrite,
    };
    let summary = simulate(&args.out, &options, ui)?;
    let json = serde_json::json!({ "out": args.out, "options": options, "summary": summary });
    ui.summary("simulate", Some(&text(args, &summary)), &json)
}

fn text(args: &Args, summary: &Summary) -> String {
    let s = &summary.scene;
    let mut t = format!(
        "{} views of {} x {} px in {}\n",
        summary.views.len(),
        args.size,
        args.size,
        args.out.display()
    );
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let rows = [
        ("mean absolute deviation", format!("{:.2} m", s.mean_absolute_deviation_m)),
        ("roofs", percent(s.roofs_share)),
        ("trees", percent(s.trees_share)),
        ("water", percent(s.water_share)),
        ("tallest building", format!("{:.1} m", s.tallest_building_m)),
        ("relief", format!("{:.1} m", s.relief_m)),
    ];
    for (name, value) in rows {
        // Writing to a string cannot fail.
        let _ = writeln!(t, "  {name:<24}{value:>9}");
    }
    let _ = writeln!(t, "\nview      off-nadir  azimuth  sun azimuth  elevation  pointing error (col, row)");
    for v in &summary.views {
        let _ = writeln!(
            t,
            "{:<9} {:>8.1}° {:>7.1}° {:>11.1}° {:>9.1}°  {:>+8.2} {:>+8.2} px",
            v.name, v.off_nadir_deg, v.azimuth_deg, v.sun_azimuth_deg, v.sun_elevation_deg, v.d_col, v.d_row
        );
    }
    let _ = write!(t, "\nexact DSM: {}", summary.truth.display());
    t
}
