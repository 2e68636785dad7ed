//! `satgs simulate`: a scene with a known answer.

mod photographs;

use super::{CliError, Ui};
use crate::scene::Role;
use crate::simulate::{
    BitDepth, PlannedView, Relief, SimulateOptions, StatedCamera, Summary, SurfaceFiles, Terrain,
    covering_px, simulate,
};
use std::fmt::Write;
use std::path::PathBuf;

/// Simulate a test scene with a known answer: satellite images of a town or a mountain, photographs of a room or from the air
///
/// Without --room or --aerial: satellite images with RPC cameras of a small town (with --mountains: of a mountain), and its
/// exact surface model. OUT gets RGB GeoTIFFs; their RPC tags have pointing errors of several pixels, their metadata give the sun's
/// position. OUT/truth gets the exact DSM, bare ground and classes (DFC2019's codes) of a town, the true RPCs and the
/// pointing errors. The same options give the same bytes.
///
/// --seasons, --cars and --held-out are for methods that model how images of one place differ. With any of them,
/// OUT/truth/appearance gets three pictures for every image, pixel by pixel: NAME_sunlit.png (share of sunlight at the
/// surface: 255 in full sun, 0 in shadow), NAME_cars.png (255 on moving cars and their shadows) and NAME_clean.png (the image
/// without cars and noise), and views.json with the gains, haze and colours of every date.
///
/// --room and --aerial make photographs of pinhole cameras instead: OUT/images, a COLMAP model in OUT/sparse/0, the exact
/// depths, normals and mesh in OUT/truth, and in OUT/priors depths and normals with smooth errors, as networks give them.
#[derive(clap::Args)]
#[command(group = clap::ArgGroup::new("photographs"))]
#[command(after_help = "Examples:
  satgs simulate town && satgs run town -o run --truth town/truth/TOWN_DSM.tif
  satgs simulate year --views 12 --seasons --cars 2 --held-out 4 && satgs run year -o run && \\
    satgs nvs-eval run
  satgs simulate mountain --mountains --view 11,11,2024-08-20T10:30 --view 11,191,2024-08-20T10:31
  satgs simulate plan --surface city_dsm.tif --texture city_ortho.tif --views 8 && \\
    satgs run plan -o plan-run --truth plan/truth/SURFACE_DSM.tif
  satgs simulate room --room && satgs run room -o run --recipe indoor \\
    --depth-prior room/priors/depths --normal-prior room/priors/normals && \\
    satgs mesh run -o mesh.ply && satgs mesh-eval mesh.ply room/truth/mesh.ply --views room
  satgs simulate air --aerial && satgs run air -o run --recipe 3dgs --test-views air/test.txt && \\
    satgs nvs-eval run")]
pub struct Args {
    /// Folder for the scene
    out: PathBuf,
    /// Seed of the random town
    #[arg(long, default_value_t = 0, value_name = "N")]
    seed: u64,
    /// Photograph a room of 4 x 5 x 2.5 m instead, with a table and a sphere; two walls have no texture
    ///
    /// The cameras stand around the table at two heights and look across the room in all directions. 3,000 points lie only on
    /// surfaces with texture, with errors of about 3 mm. Files take about 13 MB for each image of 640 x 640 pixels.
    #[arg(long, group = "photographs")]
    room: bool,
    /// With --room: also write RGB-D frames to OUT/frames, whose files state this camera
    ///
    /// A sensor is carried around the table; its frames have the form of 7-Scenes (camera-intrinsics.txt, and NAME.color.png,
    /// NAME.depth.png in millimetres, NAME.pose.txt). `registered`: one camera for colours and depths. `depth`, `color`: the
    /// depth camera stands 25 mm beside the colour camera and has 1.1 times its focal length; intrinsic parameters and poses
    /// are those of the one or the other.
    #[arg(long, requires = "room", value_name = "CAMERA")]
    frames: Option<Frames>,
    /// Photograph the town from 600 m above ground instead, with tilts up to 30 degrees, on one day
    ///
    /// Every image shows 260 to 300 m of ground. OUT/train.txt lists three images whose cameras are far from each other,
    /// OUT/test.txt all others, which --test-views of `satgs run` takes. There are 300 points with errors of about 0.3 m.
    #[arg(long, group = "photographs")]
    aerial: bool,
    /// Simulate a mountain without buildings instead: ridges, gullies, rock, scree and snow, slopes up to about 50 degrees
    ///
    /// Images have 16 bits, of which 12 are used, so that snow is neither saturated nor without texture.
    #[arg(long, conflicts_with_all = ["photographs", "hilly", "cars"])]
    mountains: bool,
    /// Simulate images of this surface instead, to plan an acquisition: a north-up raster of heights in a projected CRS in metres
    ///
    /// Images are centred on its middle, and show as much of it as --size allows. Images and the exact surface are nodata where it has
    /// no heights, and beyond its borders. Cars drive on grey level ground, and green ground changes with the season.
    #[arg(long, value_name = "DSM.tif", conflicts_with_all = ["photographs", "hilly", "mountains"])]
    surface: Option<PathBuf>,
    /// Picture of the ground of --surface, in its CRS: one band, or red, green and blue; its shadows remain
    /// [default: a plain texture, also where the picture is nodata]
    #[arg(long, value_name = "ORTHO.tif", requires = "surface")]
    texture: Option<PathBuf>,
    /// Vertical reference of --surface: `ellipsoid`, EGM84, EGM96, EGM2008 or a geoid grid (.gtx, .tif of PROJ)
    /// [default: as its CRS or VERTICAL_REFERENCE says, else the ellipsoid]
    #[arg(long, value_name = "REFERENCE", requires = "surface")]
    surface_vertical: Option<String>,
    /// Number of images; 8 or more are recommended [default: 10; --room: 60; --aerial: 21]
    #[arg(long, value_name = "N")]
    views: Option<usize>,
    /// Take an image from this direction, at this time; repeatable, instead of --views
    ///
    /// OFF_NADIR is the angle at the ground between the vertical and the satellite, AZIMUTH its direction clockwise from
    /// north, both in degrees. TIME (UTC, as 2024-08-20T10:30) gives the sun; without it, dates are spread over the year.
    /// Two images of one pass, taken forwards and backwards, are `--view 11,11,TIME --view 11,191,TIME`.
    #[arg(
        long,
        value_name = "OFF_NADIR,AZIMUTH[,TIME]",
        value_parser = parse_view,
        conflicts_with_all = ["photographs", "views"]
    )]
    view: Vec<PlannedView>,
    /// Bits of the grey levels, 8 or 16; of 16, 12 are used [default: 8; --mountains: 16]
    #[arg(long, value_name = "N", value_parser = parse_bits, conflicts_with = "photographs")]
    bits: Option<BitDepth>,
    /// Columns and rows of every image, pixels [default: 400; --room: 640; --aerial: 512; --surface: all of
    /// the surface, at most 2048]
    #[arg(long, value_name = "PX")]
    size: Option<usize>,
    /// Ground sampling distance at nadir, metres
    #[arg(long, default_value_t = 0.5, value_name = "M", conflicts_with = "photographs")]
    gsd: f64,
    /// Put the town on hills: 60 m of relief instead of about 15 m
    #[arg(long, conflicts_with = "room")]
    hilly: bool,
    /// Take images in all four seasons, from 2021 to 2023, instead of March to October
    ///
    /// Grass and trees turn smoothly from the green of spring to the dark green of summer, to yellow-brown and to grey-brown;
    /// in late winter thin snow lies on a part of roofs and open ground. The sun follows from date and time and is at least
    /// 33 degrees high, so that dates go from mid-February to the end of October.
    #[arg(long, conflicts_with = "photographs")]
    seasons: bool,
    /// Share of pixels that show a moving car or its shadow, percent of every image, 0 to 8 [default: light traffic, 1 to 2]
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true, conflicts_with = "photographs")]
    cars: Option<f64>,
    /// Make N more images, TEST_01.tif and so on, that OUT/test.txt holds back from training
    ///
    /// They have no cars and no noise, and dates, suns and directions between those of the other images. `satgs nvs-eval`
    /// compares a trained run with them.
    #[arg(
        long,
        default_value_t = 0,
        value_name = "N",
        allow_negative_numbers = true,
        conflicts_with = "photographs"
    )]
    held_out: usize,
    /// Replace the files of an earlier simulation in OUT
    #[arg(long)]
    overwrite: bool,
}

/// Which camera RGB-D frames state.
#[derive(Clone, Copy, clap::ValueEnum)]
enum Frames {
    Registered,
    Depth,
    Color,
}

impl From<Frames> for StatedCamera {
    fn from(frames: Frames) -> Self {
        match frames {
            Frames::Registered => Self::Registered,
            Frames::Depth => Self::Depth,
            Frames::Color => Self::Color,
        }
    }
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    if args.room || args.aerial {
        return photographs::run(args, ui);
    }
    let defaults = SimulateOptions::default();
    let size_px = match (args.size, &args.surface) {
        (Some(size_px), _) => size_px,
        (None, Some(surface)) => covering_px(surface, args.gsd)?,
        (None, None) => defaults.size_px,
    };
    let options = SimulateOptions {
        seed: args.seed,
        views: args.views.unwrap_or(defaults.views),
        size_px,
        gsd_m: args.gsd,
        terrain: args.terrain(),
        planned: args.view.clone(),
        depth: args.bits.unwrap_or(if args.mountains { BitDepth::Sixteen } else { defaults.depth }),
        seasons: args.seasons,
        cars_percent: args.cars,
        held_out: args.held_out,
        overwrite: args.overwrite,
    };
    let summary = simulate(&args.out, &options, ui)?;
    let json = serde_json::json!({ "out": args.out, "options": options, "summary": summary });
    ui.summary("simulate", Some(&text(args, &options, &summary)), &json)
}

impl Args {
    fn terrain(&self) -> Terrain {
        match &self.surface {
            Some(surface) => Terrain::Surface(SurfaceFiles {
                surface: surface.clone(),
                texture: self.texture.clone(),
                vertical: self.surface_vertical.clone(),
            }),
            None if self.mountains => Terrain::Mountains,
            None => Terrain::Town(self.relief()),
        }
    }

    /// Height differences of the town.
    fn relief(&self) -> Relief {
        if self.hilly { Relief::Hilly } else { Relief::Rolling }
    }
}

/// Reads an angle from the vertical, an azimuth and a time.
fn parse_view(text: &str) -> Result<PlannedView, String> {
    let mut parts = text.splitn(3, ',').map(str::trim);
    let mut angle = || parts.next().and_then(|part| part.parse::<f64>().ok());
    let (Some(off_nadir_deg), Some(azimuth_deg)) = (angle(), angle()) else {
        return Err(
            "expected two angles in degrees, and perhaps a time, as 11,191,2024-08-20T10:30".to_owned()
        );
    };
    Ok(PlannedView { off_nadir_deg, azimuth_deg, acquired: parts.next().map(str::to_owned) })
}

fn parse_bits(text: &str) -> Result<BitDepth, String> {
    let bits = text.parse::<u32>().ok().and_then(|bits| BitDepth::try_from(bits).ok());
    bits.ok_or_else(|| "expected 8 or 16".to_owned())
}

fn text(args: &Args, options: &SimulateOptions, summary: &Summary) -> String {
    let s = &summary.scene;
    let mut t = format!(
        "{} views of {} x {} px in {}\n",
        summary.views.len(),
        options.size_px,
        options.size_px,
        args.out.display()
    );
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let mut rows = vec![
        ("mean absolute deviation", format!("{:.2} m", s.mean_absolute_deviation_m)),
        ("relief", format!("{:.1} m", s.relief_m)),
    ];
    if matches!(options.terrain, Terrain::Town(_)) {
        rows.extend([
            ("roofs", percent(s.roofs_share)),
            ("trees", percent(s.trees_share)),
            ("water", percent(s.water_share)),
            ("tallest building", format!("{:.1} m", s.tallest_building_m)),
        ]);
    }
    if let Some(surface) = &summary.surface {
        let assumed = if surface.vertical_is_assumed { " (assumed; --surface-vertical)" } else { "" };
        rows.push(("heights are above", format!("{}{assumed}", surface.vertical)));
        rows.push(("without heights", percent(surface.holes_share)));
        if args.texture.is_some() {
            rows.push(("without texture", percent(surface.untextured_share)));
        }
    }
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
