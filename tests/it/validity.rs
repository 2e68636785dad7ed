//! Valid pixels from all sources, and ground that is visible in few valid pixels.

use crate::common::{camera, satgs, satgs_in, two_views};
use gdal::raster::{Buffer, ColorInterpretation, RasterCreationOptions};
use gdal::{Dataset, DriverManager, Metadata};
use satgs::affine::SiteScene;
use satgs::io::{ImageFile, SensorImage};
use satgs::rpc::formats::to_gdal;
use satgs::scene::{ReadOptions, Scene, read};
use std::path::Path;

/// Source of the information which pixels are valid.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Way {
    /// A declared nodata value.
    Nodata,
    /// An alpha band.
    Alpha,
    /// A mask file of GDAL beside the image.
    GdalMask,
    /// A mask in the list of views.
    UserMask,
}

/// Writes bands of an image with metadata of the default domain and the RPC domain.
fn write(
    path: &Path,
    size: (usize, usize),
    bands: &[Vec<u16>],
    domains: [&[(String, String)]; 2],
    nodata: Option<f64>,
    has_alpha: bool,
) -> Dataset {
    let memory = DriverManager::get_driver_by_name("MEM").unwrap();
    let mut image = memory.create_with_band_type::<u16, _>("", size.0, size.1, bands.len()).unwrap();
    for (i, band) in bands.iter().enumerate() {
        let mut out = image.rasterband(i + 1).unwrap();
        out.write((0, 0), size, &mut Buffer::new(size, band.clone())).unwrap();
        out.set_no_data_value(nodata).unwrap();
        if has_alpha && i + 1 == bands.len() {
            out.set_color_interpretation(ColorInterpretation::AlphaBand).unwrap();
        }
    }
    for (items, domain) in domains.into_iter().zip(["", "RPC"]) {
        items.iter().for_each(|(key, value)| image.set_metadata_item(key, value, domain).unwrap());
    }
    let tiff = DriverManager::get_driver_by_name("GTiff").unwrap();
    image.create_copy(&tiff, path, &RasterCreationOptions::default()).unwrap()
}

/// Writes a 16-bit copy of an image in which some pixels are not valid, and a mask file if `way` needs one.
fn twin(source: &Path, folder: &Path, way: Way, is_valid: impl Fn(usize, usize) -> bool) {
    let file = ImageFile::open(source).unwrap();
    let (width, height) = file.size();
    let known: Vec<bool> = (0..width * height).map(|i| is_valid(i % width, i / width)).collect();
    let missing = if way == Way::Nodata { 65535 } else { 3 };
    let band = |index: usize| {
        let stored = file.read(index).unwrap().data;
        stored.iter().zip(&known).map(|(v, known)| if *known { *v as u16 * 20 } else { missing }).collect()
    };
    let mut bands: Vec<Vec<u16>> = (1..=3).map(band).collect();
    if way == Way::Alpha {
        bands.push(known.iter().map(|k| u16::from(*k) * 65535).collect());
    }
    let name = source.file_name().unwrap();
    let (own, rpc) = (file.metadata_domain(""), file.metadata_domain("RPC"));
    let nodata = (way == Way::Nodata).then_some(65535.0);
    let image = write(&folder.join(name), (width, height), &bands, [&own, &rpc], nodata, way == Way::Alpha);
    let mask: Vec<u8> = known.iter().map(|k| u8::from(*k) * 255).collect();
    match way {
        Way::GdalMask => {
            let mut first = image.rasterband(1).unwrap();
            first.create_mask_band(true).unwrap();
            let mut band = first.open_mask_band().unwrap();
            band.write((0, 0), (width, height), &mut Buffer::new((width, height), mask)).unwrap();
        }
        Way::UserMask => {
            let tiff = DriverManager::get_driver_by_name("GTiff").unwrap();
            let path = folder.join("mask.tif");
            let out = tiff.create_with_band_type::<u8, _>(path, width, height, 1).unwrap();
            let mut band = out.rasterband(1).unwrap();
            band.write((0, 0), (width, height), &mut Buffer::new((width, height), mask)).unwrap();
        }
        Way::Nodata | Way::Alpha => {}
    }
}

fn succeed(folder: &Path, args: &[&str]) {
    let output = satgs_in(folder, args);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
}

/// The result files of a run, whose bytes are compared.
fn results(run: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files = vec![run.join("splats.ply"), run.join("confidence.tif"), run.join("dsm.tif")];
    for entry in walk(&run.join("ba")) {
        let extension = entry.extension().map(|e| e.to_string_lossy().into_owned());
        if extension.is_some_and(|e| ["TXT", "csv", "ply", "laz"].contains(&e.as_str())) {
            files.push(entry);
        }
    }
    files.sort();
    let read = |f: &std::path::PathBuf| {
        (f.strip_prefix(run).unwrap().display().to_string(), std::fs::read(f).unwrap())
    };
    files.iter().map(read).collect()
}

fn walk(folder: &Path) -> Vec<std::path::PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    entries.flat_map(|p| if p.is_dir() { walk(&p) } else { vec![p] }).collect()
}

#[test]
fn invalid_pixels_give_the_same_result_as_nodata_alpha_mask_and_list() {
    let folder = tempfile::tempdir().unwrap();
    succeed(folder.path(), &["simulate", "town", "--size", "180", "--views", "5", "-q"]);
    let is_valid = |col: usize, row: usize| col.abs_diff(80) + row.abs_diff(100) > 40;
    let mut found = Vec::new();
    for way in [Way::Nodata, Way::Alpha, Way::GdalMask, Way::UserMask] {
        let own = folder.path().join(format!("{way:?}"));
        std::fs::create_dir(&own).unwrap();
        twin(&folder.path().join("town/VIEW_02.tif"), &own, way, is_valid);
        let mut list = String::new();
        for view in ["VIEW_01", "VIEW_02", "VIEW_03", "VIEW_04", "VIEW_05"] {
            let beside = if view == "VIEW_02" { "" } else { "../town/" };
            list += &format!("[[view]]\nimage = \"{beside}{view}.tif\"\n");
            if view == "VIEW_02" && way == Way::UserMask {
                list += "mask = \"mask.tif\"\n";
            }
        }
        std::fs::write(own.join("scene.toml"), list).unwrap();
        succeed(&own, &["ba", "scene.toml", "-o", "run", "-q"]);
        succeed(&own, &["train", "run", "--iterations", "5", "-q"]);
        succeed(&own, &["dsm", "run", "-q"]);
        found.push((way, results(&own.join("run"))));
    }
    let (_, first) = &found[0];
    assert!(first.len() > 8, "{}", first.len());
    for (way, other) in &found[1..] {
        for ((name, a), (other_name, b)) in first.iter().zip(other) {
            assert!(name == other_name && a == b, "{name} of {way:?} is another");
        }
        assert_eq!(first.len(), other.len());
    }
}

/// Cells that fewer than two valid views see become nodata, as for cropped images; the other cells are not affected.
#[test]
fn ground_on_valid_pixels_of_fewer_than_two_views_is_nodata() {
    let folder = tempfile::tempdir().unwrap();
    succeed(folder.path(), &["simulate", "town", "--size", "180", "--views", "6", "-q"]);
    let own = folder.path().join("own");
    std::fs::create_dir(&own).unwrap();
    const FIRST: f64 = 60.0;
    for k in 1..=6 {
        let source = folder.path().join(format!("town/VIEW_0{k}.tif"));
        twin(&source, &own, Way::Nodata, |col, _| col as f64 >= FIRST);
    }
    for recipe in ["best", "eogs"] {
        let run = own.join(recipe);
        let name = run.to_str().unwrap();
        succeed(&own, &["ba", ".", "-o", name, "-q"]);
        succeed(&own, &["train", name, "--iterations", "20", "--recipe", recipe, "-q"]);
        // The grid covers the whole town, not the area alone.
        succeed(&own, &["dsm", name, "--like", "../town/truth/TOWN_DSM.tif", "-q"]);
        let setup: SiteScene =
            serde_json::from_str(&std::fs::read_to_string(run.join("cameras.json")).unwrap()).unwrap();
        let (dsm, confidence) = (
            ImageFile::open(&run.join("dsm.tif")).unwrap(),
            ImageFile::open(&run.join("confidence.tif")).unwrap(),
        );
        let (height, views) = (dsm.read(1).unwrap(), confidence.read(3).unwrap());
        let grid = dsm.map_grid().unwrap();
        let mut cells = 0;
        for row in 0..height.height {
            for col in 0..height.width {
                let z = f64::from(height.at(col, row)) - setup.site.origin.z();
                let p = setup.site.site_from_utm(grid.cell_center(col, row)).at_height(z);
                let shown = setup.views.iter().filter(|v| {
                    let px = v.camera.project(p);
                    let within = |v: f64, first: f64| v >= first && v <= 179.0;
                    within(px.col, FIRST) && within(px.row, 0.0)
                });
                let shown = shown.count();
                assert!(z.is_nan() || shown >= 2, "{recipe}: {col} {row} is shown by {shown}");
                assert!(z.is_nan() || views.at(col, row) <= shown as f32, "{recipe}: {col} {row}");
                cells += usize::from(!z.is_nan());
            }
        }
        assert!(cells > 5000, "{recipe}: {cells} cells");
        // The area is derived from the valid pixels.
        let (west, _, east, _) = setup.area;
        assert!(east - west < 100.0, "{:?}", setup.area);
    }
}

/// A scene of one image of 64 x 64 pixels.
fn small(bands: &[Vec<u16>], nodata: Option<f64>, has_alpha: bool) -> (tempfile::TempDir, Scene) {
    let folder = tempfile::tempdir().unwrap();
    let rpc = to_gdal(&camera(5.44, 0.2));
    drop(write(&folder.path().join("a.tif"), (64, 64), bands, [&[], &rpc], nodata, has_alpha));
    let scene = read(folder.path(), &ReadOptions::default()).unwrap();
    (folder, scene)
}

fn missing(scene: &Scene) -> usize {
    scene.views[0].valid_pixels().unwrap().map_or(0, |v| 64 * 64 - v.count())
}

/// Values from 100 on, `value` in a square in the middle and in the first two columns.
fn holed(value: u16, low: u16) -> Vec<u16> {
    let at = |col: usize, row: usize| {
        let is_hole = col < 2 || (20..30).contains(&col) && (20..30).contains(&row);
        if is_hole { value } else { low + ((col * 7 + row * 13) % 50) as u16 }
    };
    (0..64 * 64).map(|i| at(i % 64, i / 64)).collect()
}

#[test]
fn a_nodata_value_within_the_image_is_a_colour_only_in_the_range_of_other_values() {
    let (margin, hole) = (2 * 64, 100);
    for (value, low, expected) in
        [(65535, 100, margin + hole), (0, 100, margin + hole), (0, 1, margin), (120, 100, 0)]
    {
        let (_folder, scene) = small(&[holed(value, low)], Some(f64::from(value)), false);
        let found = missing(&scene);
        if value == 120 {
            // Some pixels with this value are connected with the margin.
            assert!((margin..margin + hole).contains(&found), "{found}");
            continue;
        }
        assert_eq!(found, expected, "{value} {low}");
        let range = scene.views[0].value_range().unwrap().unwrap();
        let lowest = if expected == margin { 0 } else { low };
        assert_eq!((range.low, range.high), (f32::from(lowest), f32::from(low + 49)), "{value} {low}");
        let colors = &scene.views[0].read_colors().unwrap()[0];
        assert_eq!(colors.data.iter().filter(|v| v.is_nan()).count(), expected);
        // Invalid pixels do not influence the stretch of the other values.
        let mean = colors.valid().sum::<f32>() / colors.valid().count() as f32;
        assert!((0.3..0.7).contains(&mean), "{mean}");
    }
}

#[test]
fn an_alpha_band_is_not_used_as_a_colour() {
    let (gray, alpha) = (holed(3, 100), holed(0, 100));
    let (folder, scene) = small(&[gray.clone(), alpha.clone()], None, true);
    assert_eq!((scene.views[0].bands.clone(), missing(&scene)), (vec![1], 2 * 64 + 100));
    assert!(!scene.warnings.iter().any(|w| w.contains("--bands")), "{:?}", scene.warnings);
    drop(folder);

    let (folder, scene) = small(&[gray.clone(), gray.clone(), gray, alpha], None, true);
    assert_eq!((scene.views[0].bands.clone(), missing(&scene)), (vec![1, 2, 3], 2 * 64 + 100));
    assert!(!scene.warnings.iter().any(|w| w.contains("--bands")), "{:?}", scene.warnings);
    let options = ReadOptions { bands: vec![4], ..ReadOptions::default() };
    let error = read(folder.path(), &options).unwrap_err().to_string();
    assert!(error.contains("band 4 is an alpha band"), "{error}");
}

#[test]
fn an_undeclared_alpha_band_is_recognised_by_its_values() {
    let folder = tempfile::tempdir().unwrap();
    let rpc = to_gdal(&camera(5.44, 0.2));
    let image = SensorImage { width: 64, height: 64, rpc: &rpc, metadata: &[] };
    let byte = |v: Vec<u16>| v.into_iter().map(|v| v as u8).collect::<Vec<u8>>();
    let alpha = byte(holed(0, 100)).into_iter().map(|v| if v == 0 { 0 } else { 255 }).collect();
    let path = folder.path().join("a.tif");
    image.write_u8(&path, vec![byte(holed(3, 100)), alpha]).unwrap();
    let scene = read(folder.path(), &ReadOptions::default()).unwrap();
    assert_eq!((scene.views[0].bands.clone(), missing(&scene)), (vec![1], 2 * 64 + 100));
    // A band with other values is a colour.
    image.write_u8(&path, vec![byte(holed(3, 100)), byte(holed(0, 100))]).unwrap();
    assert_eq!(missing(&read(folder.path(), &ReadOptions::default()).unwrap()), 0);
}

#[test]
fn the_usable_data_mask_of_planet_is_used_as_a_mask() {
    let folder = two_views();
    let mask = SensorImage { width: 64, height: 64, rpc: &[], metadata: &[] };
    let clear = holed(0, 1).into_iter().map(|v| u8::from(v > 0)).collect();
    mask.write_u8(&folder.path().join("a_udm2.tif"), vec![clear]).unwrap();
    let scene = read(folder.path(), &ReadOptions::default()).unwrap();
    assert_eq!((scene.views.len(), missing(&scene)), (2, 2 * 64 + 100));
    assert!(scene.views[1].valid_pixels().unwrap().is_none());
    assert!(
        scene.warnings.iter().any(|w| w.contains("a_udm2.tif` is used as the mask of a")),
        "{:?}",
        scene.warnings
    );
}

#[test]
fn info_warns_of_undeclared_black_margins() {
    let (folder, _) = small(&[holed(0, 100)], None, false);
    let output = satgs(&["info", folder.path().to_str().unwrap()]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(text.contains("black pixels along the border") && text.contains("a 3.1 %"), "{text}");

    let (folder, _) = small(&[holed(0, 100)], Some(0.0), false);
    let output = satgs(&["info", folder.path().to_str().unwrap()]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        text.contains("valid pixels") && text.contains("a 94.4 %") && !text.contains("black pixels along"),
        "{text}"
    );
}
