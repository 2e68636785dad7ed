//! `satgs simulate`: a scene with a known answer.

use super::{CliError, Ui};
use crate::scene::Role;
use crate::simulate::{Relief, SimulateOptions, Summary, simulate};
use std::fmt::Write;
use std::path::PathBuf;

/// Simulate a test scene: images of a small town with RPC cameras, and the exact surface model
///
/// OUT gets 8-bit RGB GeoTIFFs; their RPC tags have pointing errors of several pixels, their metadata give the sun's
/// position. OUT/truth gets the exact DSM, its classes (DFC2019's codes), the true RPCs and the pointing errors. The same
/// options give the same bytes.
///
/// --seasons, --cars and --held-out make scenes for methods that explain how images of one place differ. With any of them,
/// OUT/truth/appearance gets three pictures of every image, pixel by pixel: NAME_sunlit.png (share of sunlight at the
/// surface: 255 in full sun, 0 in shadow), NAME_cars.png (255 on moving cars and their shadows) and NAME_clean.png (the image
/// without cars and noise), and views.json with the gains, haze and colours of every date.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  satgs simulate town && satgs run town -o run --truth town/truth/TOWN_DSM.tif
  satgs simulate year --views 12 --seasons --cars 2 --held-out 4 && satgs run year -o run && satgs nvs-eval run")]
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
    /// Take images in all four seasons, from 2021 to 2023, instead of March to October
    ///
    /// Grass and trees turn smoothly from the green of spring to the dark green of summer, to yellow-brown and to grey-brown;
    /// in late winter thin snow lies on a part of roofs and open ground. The sun follows from date and time and is at least
    /// 33 degrees high, so that dates go from mid-February to the end of October.
    #[arg(long)]
    seasons: bool,
    /// Percent of the pixels of every image that show a moving car or its shadow, 0 to 8 [default: light traffic, 1 to 2]
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true)]
    cars: Option<f64>,
    /// Make N more images, TEST_01.tif and so on, that OUT/test.txt holds back from training
    ///
    /// They have no cars and no noise, and dates, suns and directions between those of the other images. `satgs nvs-eval`
    /// compares a trained run with them.
    #[arg(long, default_value_t = 0, value_name = "N", allow_negative_numbers = true)]
    held_out: usize,
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
        seasons: args.seasons,
        cars_percent: args.cars,
        held_out: args.held_out,
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
    t += &appearance_text(summary);
    let _ = write!(t, "\nexact DSM: {}", summary.truth.display());
    t
}

/// What was written about shadows, cars and colours; empty if nothing was.
fn appearance_text(summary: &Summary) -> String {
    let known: Vec<_> = summary.views.iter().filter_map(|v| Some((v, v.appearance.as_ref()?))).collect();
    let Some(folder) = known.first().and_then(|(_, a)| a.sunlit.parent()) else { return String::new() };
    let mut t = "\nview      date        use       snow   cars  mean grass (red, green, blue)\n".to_owned();
    for (view, a) in &known {
        let date = view.acquired.split('T').next().unwrap_or_default();
        let used_for = if view.role == Role::Test { "held out" } else { "training" };
        let [r, g, b] = a.grass;
        let _ = writeln!(
            t,
            "{:<9} {date}  {used_for} {:>4.0} % {:>4.1} %  {r:.2} {g:.2} {b:.2}",
            view.name,
            100.0 * a.snow,
            a.cars_percent
        );
    }
    let held_out = known.iter().filter(|(v, _)| v.role == Role::Test).count();
    if held_out > 0 {
        let _ = writeln!(t, "\nheld out by test.txt: {held_out} images without cars and noise, TEST_*.tif");
    }
    let folder = folder.display();
    let _ = writeln!(
        t,
        "\nappearance: {folder}/NAME_sunlit.png, NAME_cars.png, NAME_clean.png of every image, views.json"
    );
    t
}
