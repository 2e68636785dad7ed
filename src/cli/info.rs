//! `satgs info`.

use super::perspective_args::PerspectiveArgs;
use super::scene_args::SceneArgs;
use super::{CliError, Ui, device_info, perspective_info, splat_info};
use crate::estimate::{BEST_CONVERGENCE_DEG, Imaging, best_convergence_deg};
use crate::io::{ImageFile, Outline, check_writable, write_outlines};
use crate::mvs::DSM_CELL_M;
use crate::progress::{Event, Progress};
use crate::run::AnyScene;
use crate::scene::{Overlap, RPC_ORDER, Role, Scene, Sun, ValueRange, View, angle_between_deg};
use crate::splat::recipe::Recipe;
use crate::tiles::PlanOptions;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::PathBuf;

/// Pairs listed when there are too many views for a matrix.
const LISTED_PAIRS: usize = 5;
/// Views up to which a matrix fits a terminal.
const MATRIX_VIEWS: usize = 8;

/// Show what a scene contains: views, cameras, sun positions, dates, convergence angles, overlap on the ground
///
/// For photographs (a COLMAP project, a transforms.json of instant-ngp or nerfstudio, RGB-D frames in the layout of 7-Scenes, a
/// scene of LEVIR-NVS or ScanNet++): views, lenses, points, reprojection errors and extent.
///
/// For a splat file (.ply, .compressed.ply, .spz, .glb with KHR_gaussian_splatting): the number of splats, their extent, axes and
/// place on the map. For a tileset.json of 3D Tiles: tiles and levels of detail.
#[derive(clap::Args)]
#[command(mut_arg("scene", |scene| scene.required(false).required_unless_present("devices")))]
pub struct Args {
    #[command(flatten)]
    scene: Option<SceneArgs>,
    #[command(flatten)]
    perspective: PerspectiveArgs,
    /// List the GPUs of this machine, and what each lacks for training
    #[arg(long, conflicts_with = "scene")]
    devices: bool,
    /// Write the footprints of the images, at the middle of the height range, as GeoJSON, or as GeoPackage (.gpkg)
    #[arg(long, value_name = "FILE")]
    footprints: Option<PathBuf>,
    /// Write a plot of the footprints and a sky plot (satellites blue, suns orange, north up, zenith in the centre)
    #[arg(long, value_name = "FILE.svg", value_parser = super::ending(&["svg"]))]
    skyplot: Option<PathBuf>,
    /// Replace files that exist
    #[arg(long)]
    overwrite: bool,
}

impl Args {
    /// Reads the scene and shows its warnings.
    pub(super) fn read(&self, ui: &Ui) -> Result<AnyScene, CliError> {
        let scene = self.scene()?.read_any(&self.perspective, None, ui)?;
        if let AnyScene::Photographs(photographs) = &scene {
            for warning in photographs.scene.georeference.iter().flat_map(|g| g.warnings()) {
                ui.event(Event::Warning(warning.clone()));
            }
        }
        Ok(scene)
    }

    /// The scene, which only `--devices` does without.
    fn scene(&self) -> Result<&SceneArgs, CliError> {
        self.scene.as_ref().ok_or_else(|| CliError::input("no scene is named", "satgs info SCENE"))
    }
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    if args.devices {
        return device_info::run(ui);
    }
    let path = args.scene()?.path();
    if splat_info::is_one(path) {
        return splat_info::run(path, ui);
    }
    for file in [&args.footprints, &args.skyplot].into_iter().flatten() {
        if file.exists() && !args.overwrite {
            return Err(CliError::input(format!("`{}` exists", file.display()), "--overwrite replaces it"));
        }
    }
    let scene = match args.read(ui)? {
        AnyScene::Satellites(scene) => scene,
        AnyScene::Photographs(found) => return perspective_info::run(&found.path, &found.scene, ui),
    };
    for file in [&args.footprints, &args.skyplot].into_iter().flatten() {
        check_writable(file)?;
    }
    let overlap = scene.overlap()?;
    let rows = scene.views.iter().map(|v| Row::new(v, overlap.height_m)).collect::<Result<Vec<_>, _>>()?;
    let pairs = Pairs::new(&rows);
    let order = format!("if an image has several RPCs, the first in this order is used: {RPC_ORDER}\n");
    let gamma = format!("display gamma: {} (--gamma)\n", scene.transfer_function.gamma());
    let heights = format!("heights searched: {} (--height-range or --dem gives others)\n", scene.heights());
    let valid = validity_notes(&rows);
    let expected = expectation(&scene, &rows, &pairs, &overlap);
    let text =
        [table(&rows) + &order + &gamma + &heights + &valid, pairs.text(&rows), ground(&scene, &overlap)]
            .join("\n")
            + &expected;
    if let Some(file) = &args.footprints {
        write_outlines(file, "footprints", &outlines(&rows, overlap.height_m))?;
    }
    if let Some(file) = &args.skyplot {
        scene.skyplot(&overlap)?.write(file, "footprints of the views, satellites and suns")?;
    }
    ui.summary("info", Some(&text), &summary(&scene, &rows, &pairs, &overlap))?;
    scene.require_shared_ground(scene.height_range())?;
    Ok(())
}

/// What the table says about a view.
struct Row<'a> {
    view: &'a View,
    bands: usize,
    bits: u32,
    values: Option<ValueRange>,
    /// Of the pixels used those that are image, percent.
    valid_percent: f64,
    /// Of these the black ones along the border, if they are many.
    margin_percent: Option<f64>,
    gsd_m: Option<(f64, f64)>,
    /// Azimuth and off-nadir of the direction to the satellite.
    direction_deg: Option<(f64, f64)>,
}

impl<'a> Row<'a> {
    fn new(view: &'a View, height_m: f64) -> Result<Self, CliError> {
        let file = ImageFile::open(&view.image)?;
        Ok(Self {
            view,
            bands: file.bands(),
            bits: file.bit_depth(),
            values: view.value_range()?,
            valid_percent: view
                .valid_pixels()?
                .map_or(100.0, |v| 100.0 * v.count() as f64 / (view.width * view.height) as f64),
            margin_percent: view.undeclared_margin_percent()?,
            gsd_m: view.gsd_m(height_m),
            direction_deg: view.direction_deg(height_m),
        })
    }

    fn cells(&self) -> [String; 10] {
        let v = self.view;
        let or_dash = |cell: Option<String>| cell.unwrap_or_else(|| "-".into());
        let (low, high) = v.rpc.height_range();
        [
            format!("{}{}", v.name, if v.role == Role::Test { " (test)" } else { "" }),
            format!("{}x{}", v.width, v.height),
            format!("{}x{}", self.bands, self.bits),
            or_dash(self.values.map(|v| format!("{} to {}, {}", v.low, v.high, v.median))),
            or_dash(self.gsd_m.map(|(c, r)| format!("{c:.2}x{r:.2}"))),
            or_dash(self.direction_deg.map(|d| format!("{:.1}", d.1))),
            or_dash(self.direction_deg.map(|d| format!("{:.0}", d.0))),
            or_dash(v.sun.map(|s| format!("{:.1}, {:.1}", s.azimuth_deg, s.elevation_deg))),
            or_dash(v.acquired.as_deref().map(|d| d.replace('T', " ").trim_end_matches('Z').into())),
            format!("{} ({low:.0} to {high:.0} m)", v.rpc_source),
        ]
    }
}

/// Footprints with what the table says in numbers.
fn outlines(rows: &[Row], height_m: f64) -> Vec<Outline> {
    let outline = |r: &Row| {
        let sun = |angle: fn(Sun) -> f64| r.view.sun.map_or(f64::NAN, angle);
        let direction = |k: fn((f64, f64)) -> f64| r.direction_deg.map_or(f64::NAN, k);
        Some(Outline {
            name: r.view.name.clone(),
            ring: r.view.footprint(height_m)?.map(|p| (p.lon_deg(), p.lat_deg())).to_vec(),
            numbers: vec![
                ("height_m", height_m),
                ("off_nadir_deg", direction(|d| d.1)),
                ("azimuth_deg", direction(|d| d.0)),
                ("sun_azimuth_deg", sun(|s| s.azimuth_deg)),
                ("sun_elevation_deg", sun(|s| s.elevation_deg)),
                ("gsd_m", r.gsd_m.map_or(f64::NAN, |(c, r)| (c * r).sqrt())),
            ],
        })
    };
    rows.iter().filter_map(outline).collect()
}

fn table(rows: &[Row]) -> String {
    let head = [
        "view",
        "pixels",
        "bands",
        "values, median",
        "GSD m",
        "off-nadir",
        "azimuth",
        "sun az, el",
        "UTC",
        "RPC (heights)",
    ];
    let mut lines = vec![head.map(String::from)];
    lines.extend(rows.iter().map(Row::cells));
    let width: [usize; 10] =
        std::array::from_fn(|k| lines.iter().map(|l| l[k].chars().count()).max().unwrap_or(0));
    let mut out = String::new();
    for line in &lines {
        let mut text = String::new();
        for (cell, width) in line.iter().zip(width) {
            let _ = write!(text, "{cell:width$}  ");
        }
        let _ = writeln!(out, "{}", text.trim_end());
    }
    out
}

/// Which views have pixels that are no image, and which may have more that no file declares.
fn validity_notes(rows: &[Row]) -> String {
    let listed = |percent: &dyn Fn(&Row) -> Option<f64>| {
        let named = rows.iter().filter_map(|r| Some(format!("{} {:.1} %", r.view.name, percent(r)?)));
        named.collect::<Vec<_>>().join(", ")
    };
    let mut out = String::new();
    let part = listed(&|r| Some(r.valid_percent).filter(|p| *p < 100.0));
    if !part.is_empty() {
        let _ = writeln!(out, "valid pixels (all others are nodata, transparent or masked): {part}");
    }
    let margins = listed(&|r| r.margin_percent);
    if !margins.is_empty() {
        let _ = writeln!(
            out,
            "black pixels along the border, used as image unless declared as nodata (`gdal_edit.py -a_nodata 0 FILE`, or \
             `mask` in a list of views): {margins}"
        );
    }
    out
}

/// Convergence angles of all pairs, smallest first.
struct Pairs(Vec<(usize, usize, f64)>);

impl Pairs {
    fn new(rows: &[Row]) -> Self {
        let mut pairs = Vec::new();
        for i in 0..rows.len() {
            for j in i + 1..rows.len() {
                if let (Some(a), Some(b)) = (rows[i].direction_deg, rows[j].direction_deg) {
                    pairs.push((i, j, angle_between_deg(a, b)));
                }
            }
        }
        pairs.sort_by(|a, b| a.2.total_cmp(&b.2));
        Self(pairs)
    }

    fn min_median_max(&self) -> Option<[f64; 3]> {
        let p = &self.0;
        Some([p.first()?.2, p[p.len() / 2].2, p.last()?.2])
    }

    /// Those nearest to the angle at which heights are best.
    fn best(&self) -> Vec<(usize, usize, f64)> {
        let mut best = self.0.clone();
        best.sort_by(|a, b| {
            (a.2 - BEST_CONVERGENCE_DEG).abs().total_cmp(&(b.2 - BEST_CONVERGENCE_DEG).abs())
        });
        best.truncate(LISTED_PAIRS);
        best
    }

    fn text(&self, rows: &[Row]) -> String {
        let Some([min, median, max]) = self.min_median_max() else {
            return "convergence: needs two views\n".into();
        };
        let mut out = format!(
            "convergence of {} pairs: min {min:.1}°, median {median:.1}°, max {max:.1}°\n",
            self.0.len()
        );
        if (3..=MATRIX_VIEWS).contains(&rows.len()) {
            let angle = |i: usize, j: usize| {
                self.0.iter().find(|p| (p.0, p.1) == (i.min(j), i.max(j))).map_or(f64::NAN, |p| p.2)
            };
            let width = rows.iter().map(|r| r.view.name.chars().count()).max().unwrap_or(0);
            for (i, row) in rows.iter().enumerate() {
                let _ = write!(out, "  {:width$}", row.view.name);
                for j in 0..i {
                    let _ = write!(out, " {:6.1}", angle(i, j));
                }
                out.push('\n');
            }
        } else if rows.len() > MATRIX_VIEWS {
            let _ = writeln!(out, "nearest to {BEST_CONVERGENCE_DEG:.0}°:");
            for (i, j, angle) in self.best() {
                let _ = writeln!(out, "  {angle:5.1}°  {}  {}", rows[i].view.name, rows[j].view.name);
            }
        }
        out
    }
}

fn ground(scene: &Scene, o: &Overlap) -> String {
    let smallest = o.footprint_m2.iter().copied().fold(f64::INFINITY, f64::min);
    let largest = o.footprint_m2.iter().copied().fold(0.0, f64::max);
    let percent = |area: f64| 100.0 * area / smallest;
    let mut out = format!(
        "footprints at {:.0} m: {smallest:.0} to {largest:.0} m² (EPSG:{})\n\
         seen by at least {} of {} views: {:.0} m², {:.0} % of the smallest footprint\n\
         seen by all: {:.0} m², {:.0} %\n",
        o.height_m,
        o.epsg,
        o.min_views,
        scene.views.len(),
        o.common_m2,
        percent(o.common_m2),
        o.all_m2,
        percent(o.all_m2)
    );
    if let Some((w, s, e, n)) = o.common_box {
        let _ = writeln!(
            out,
            "box of the common ground: {w:.1} {s:.1} to {e:.1} {n:.1} ({:.0} x {:.0} m)",
            e - w,
            n - s
        );
    }
    let strays: Vec<&View> = scene
        .views
        .iter()
        .zip(&o.nearest)
        .filter_map(|(v, n)| n.is_some_and(|n| n.1 < 50.0).then_some(v))
        .collect();
    for view in strays {
        let _ = writeln!(out, "  {} shows other ground: {}", view.name, view.place(o.height_m));
    }
    out
}

/// Expected accuracy and time of `satgs run`; nothing without two views of common ground.
fn expectation(scene: &Scene, of_views: &[Row], pairs: &Pairs, o: &Overlap) -> String {
    let (Some((west, south, east, north)), Some(recipe)) = (o.common_box, Recipe::named(Recipe::NAMES[0]))
    else {
        return String::new();
    };
    let is_trained = |i: usize| of_views[i].view.role == Role::Train;
    let views = (0..of_views.len()).filter(|i| is_trained(*i)).count();
    if views < 2 {
        return String::new();
    }
    let angles = pairs.0.iter().filter(|p| is_trained(p.0) && is_trained(p.1)).map(|p| p.2);
    let trained = of_views.iter().filter(|row| row.view.role == Role::Train);
    let mut gsd: Vec<f64> = trained.filter_map(|r| r.gsd_m.map(|(c, r)| (c * r).sqrt())).collect();
    gsd.sort_by(f64::total_cmp);
    let Some(gsd_m) = gsd.get(gsd.len() / 2).copied() else { return String::new() };
    let imaging = Imaging { views, convergence_deg: best_convergence_deg(angles), gsd_m };
    let (low_m, high_m) = scene.heights().range();
    let [(columns, width), (rows, height)] = PlanOptions::default().cores([east - west, north - south]);
    let tiles = columns * rows;
    let cost = imaging.cost(&recipe, (tiles, [width, height]), high_m - low_m, DSM_CELL_M);
    let tiles = if tiles > 1 { "; the area is cut into tiles, of which `satgs plan` tells more" } else { "" };
    format!("{}{tiles}\n", imaging.text(cost))
}

fn summary(scene: &Scene, rows: &[Row], pairs: &Pairs, o: &Overlap) -> Value {
    let views: Vec<Value> = rows
        .iter()
        .zip(&o.footprint_m2)
        .zip(&o.nearest)
        .map(|((r, area), nearest)| {
            let v = r.view;
            let (low, high) = v.rpc.height_range();
            json!({
                "name": v.name, "image": v.image, "width": v.width, "height": v.height,
                "bands": r.bands, "bits": r.bits, "role": v.role,
                "values": r.values.map(|v| [v.low, v.high]), "median_value": r.values.map(|v| v.median),
                "valid_percent": r.valid_percent, "black_margin_percent": r.margin_percent,
                "gsd_col_m": r.gsd_m.map(|g| g.0), "gsd_row_m": r.gsd_m.map(|g| g.1),
                "off_nadir_deg": r.direction_deg.map(|d| d.1), "azimuth_deg": r.direction_deg.map(|d| d.0),
                "sun": v.sun, "acquired": v.acquired, "rpc_source": v.rpc_source,
                "rpc_heights_m": [low, high], "height_range_m": v.height_range,
                "footprint": v.footprint(o.height_m).map(|c| c.map(|p| [p.lon_deg(), p.lat_deg()])),
                "footprint_m2": area, "most_shared_percent": nearest.map(|n| n.1),
            })
        })
        .collect();
    let named =
        |p: &(usize, usize, f64)| json!({ "a": rows[p.0].view.name, "b": rows[p.1].view.name, "deg": p.2 });
    let spread = pairs.min_median_max();
    json!({
        "views": views,
        "gamma": scene.transfer_function.gamma(),
        "heights_searched": scene.heights(),
        "convergence": {
            "min_deg": spread.map(|s| s[0]), "median_deg": spread.map(|s| s[1]), "max_deg": spread.map(|s| s[2]),
            "pairs": pairs.0.iter().map(named).collect::<Vec<_>>(),
        },
        "ground": {
            "epsg": o.epsg, "height_m": o.height_m, "min_views": o.min_views, "common_m2": o.common_m2,
            "all_views_m2": o.all_m2, "common_box": o.common_box,
        },
        "warnings": scene.warnings,
    })
}
