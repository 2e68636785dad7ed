//! `satgs changes`: what changed between two runs.

use super::{CliError, Ui, parse_metres};
use crate::changes::{Changes, Region, RegionRule};
use crate::pipeline::{ChangesOptions, changes};
use std::fmt::Write;
use std::path::PathBuf;

/// Number of regions that the table lists.
const LISTED: usize = 20;

/// Find what changed between two runs or surface models: regions that rose or fell, with their volumes
///
/// The later surface is moved onto the earlier one by the shift that fits what did not change. A difference of heights counts where
/// it is larger than twice its standard deviation, from the expected errors of both surfaces (confidence.tif; without it, from the
/// scatter of the differences), and wider than 2 m. DIR gets difference.tif (difference and its standard deviation, with a QGIS
/// style), difference.png, changes.gpkg (outlines with areas and volumes) and changes.json.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  satgs changes run_2019 run_2024 -o changes
  satgs changes lidar_2015.tif run/dsm.tif -o changes --least-height 3 --least-area 100

The standard deviation of a volume assumes that the cells of a region err together. Crops, trees and
parked vehicles change, too: compare images of the same season to find buildings.")]
pub struct Args {
    /// The earlier run folder, or the raster of a surface model
    earlier: PathBuf,
    /// The later run folder, or raster
    later: PathBuf,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Smallest difference of heights that counts, metres
    #[arg(long, value_name = "M", value_parser = parse_metres, default_value_t = RegionRule::default().least_height_m)]
    least_height: f64,
    /// Smallest area of a region, square metres
    #[arg(long, value_name = "M2", value_parser = parse_area, default_value_t = RegionRule::default().least_area_m2)]
    least_area: f64,
    /// Replace files that are in the output folder
    #[arg(long)]
    overwrite: bool,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    let rule = RegionRule { least_height_m: args.least_height, least_area_m2: args.least_area };
    let options = ChangesOptions { rule, overwrite: args.overwrite };
    let found = changes(&args.earlier, &args.later, &options, &args.output, ui)?;
    ui.summary("changes", Some(&text(&found)), &found)
}

fn text(found: &Changes) -> String {
    let [east, north, up] = found.moved_m;
    let share = 100.0 * found.common_cells as f64 / found.cells.max(1) as f64;
    let mut out = format!(
        "the later surface was moved {east:.2} m east, {north:.2} m north, {up:.2} m up; {share:.0} % of the cells are known in both, \
         and differences have a standard deviation of {:.2} m (median)\n",
        found.sigma_m
    );
    if found.regions.is_empty() {
        return out + "nothing changed";
    }
    let _ = writeln!(
        out,
        "{:>6} {:>9} {:>8} {:>11} {:>11} {:>11}",
        "region", "area m²", "mean m", "largest m", "volume m³", "σ m³"
    );
    for (i, r) in found.regions.iter().take(LISTED).enumerate() {
        let Region { area_m2, mean_m, largest_m, volume_m3, volume_sigma_m3, .. } = r;
        let number = i + 1;
        let _ = writeln!(
            out,
            "{number:>6} {area_m2:>9.0} {mean_m:>+8.2} {largest_m:>+11.2} {volume_m3:>+11.0} {volume_sigma_m3:>11.0}"
        );
    }
    if found.regions.len() > LISTED {
        let _ = writeln!(out, "and {} smaller ones", found.regions.len() - LISTED);
    }
    let [(added, added_sigma), (removed, removed_sigma)] = found.volumes_m3();
    let _ =
        write!(out, "added {added:.0} ± {added_sigma:.0} m³, removed {removed:.0} ± {removed_sigma:.0} m³");
    out
}

/// An area of at least 0.
fn parse_area(text: &str) -> Result<f64, String> {
    let area = text.parse().ok().filter(|m: &f64| m.is_finite() && *m >= 0.0);
    area.ok_or_else(|| "expected square metres, a number of at least 0".to_owned())
}
