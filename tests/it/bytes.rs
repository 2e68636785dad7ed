//! The bytes of a small scene, so that work on the house is told from work on the numbers.
//!
//! The same instructions give the same bytes, whatever the number of threads; other instruction sets and other makes of
//! processor round differently in their last bit, so the hashes are kept by processor. On a processor without hashes the figures
//! of the scene must be nearly the same. A deliberate change of the results changes both here, and says so in the change log.

use satgs::io::ImageFile;
use satgs::pipeline::TrainOptions;
use satgs::progress::NoProgress;
use satgs::run::{RunOptions, run};
use satgs::run_files::{ADJUSTMENT, DSM, SPLATS};
use satgs::scene::{self, ReadOptions};
use satgs::simulate::{SimulateOptions, simulate};
use satgs::splat::ply;
use satgs::splat::recipe::{Densification, Recipe};
use std::path::Path;

/// What a recipe gives.
struct Known {
    recipe: &'static str,
    /// The number of observations in tie_points.csv, the number of splats and the mean height of dsm.tif in metres.
    figures: [f64; 3],
    /// For each known processor, the hashes of tie_points.csv, splats.ply and the heights of dsm.tif.
    hashes: &'static [(&'static str, [&'static str; 3])],
}

const KNOWN: [Known; 4] = [
    Known {
        recipe: "best",
        figures: [433.0, 13870.0, 156.755],
        hashes: &[("GenuineIntel avx512", ["e5474f145c43badf", "69422e7d70b3900f", "181b9e69965d9383"])],
    },
    Known {
        recipe: "growing",
        figures: [433.0, 152205.0, 157.263],
        hashes: &[("GenuineIntel avx512", ["e5474f145c43badf", "078e0e02204db17f", "24ceade651848004"])],
    },
    Known {
        recipe: "baeogs",
        figures: [433.0, 7672.0, 143.620],
        hashes: &[("GenuineIntel avx512", ["e5474f145c43badf", "0f642d96d1437fa6", "04bc5cc72a4de876"])],
    },
    Known {
        recipe: "eogs",
        figures: [433.0, 52102.0, 149.556],
        hashes: &[("GenuineIntel avx512", ["e5474f145c43badf", "29b7989c025ecda4", "aea995786e55a260"])],
    },
];
/// Largest relative difference of the counts and difference of the height, metres, on other processors.
const COUNTS_TOLERANCE: f64 = 0.02;
const HEIGHT_TOLERANCE_M: f64 = 0.1;

/// Make and instruction set of the processor at hand, as far as results depend on them.
fn processor() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let field = |name: &str| {
        let line = info.lines().find(|line| line.starts_with(name)).unwrap_or_default();
        line.split_once(": ").map_or("", |(_, value)| value).to_owned()
    };
    let flags = field("flags");
    let has = |flag: &str| flags.split_whitespace().any(|f| f == flag);
    let instructions = match (has("avx512vl"), has("avx2")) {
        (true, _) => "avx512",
        (_, true) => "avx2",
        _ => "other",
    };
    format!("{} {instructions}", field("vendor_id"))
}

fn hash(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex()[..16].to_string()
}

/// Hashes and figures of a run.
fn hashes_and_figures(folder: &Path) -> ([String; 3], [f64; 3]) {
    let read = |name: &Path| std::fs::read(folder.join(name)).unwrap();
    let heights = ImageFile::open(&folder.join(DSM)).unwrap().read(1).unwrap();
    let bytes: Vec<u8> = heights.data.iter().flat_map(|z| z.to_bits().to_le_bytes()).collect();
    let (sum, cells) = heights.valid().fold((0.0, 0.0), |(sum, n), z| (sum + f64::from(z), n + 1.0));
    let tie_points = read(&Path::new(ADJUSTMENT).join("tie_points.csv"));
    let observations = tie_points.iter().filter(|byte| **byte == b'\n').count() - 1;
    let splats = ply::read(&folder.join(SPLATS)).unwrap().len();
    let hashes = [hash(&tie_points), hash(&read(Path::new(SPLATS))), hash(&bytes)];
    (hashes, [observations as f64, splats as f64, sum / cells])
}

/// Recipe `best` with so many checks that splats are cloned, split and removed within the few iterations of the test.
fn growing() -> Recipe {
    let best = Recipe::named("best").unwrap();
    let densification =
        best.densification.map(|d| Densification { gradient: 0.0003, copy_below: 0.004, ..d });
    Recipe { check_every: 10, densification, ..best }
}

#[test]
fn a_small_scene_gives_the_bytes_that_it_gave_before() {
    let folder = tempfile::tempdir().unwrap();
    let images = folder.path().join("scene");
    let options = SimulateOptions { views: 6, size_px: 160, ..SimulateOptions::default() };
    simulate(&images, &options, &NoProgress).unwrap();
    let scene = scene::read(&images, &ReadOptions::default()).unwrap();
    let growing_file = folder.path().join("growing.toml");
    std::fs::write(&growing_file, growing().to_toml()).unwrap();
    let of_recipe = |recipe: &str| {
        let out = folder.path().join(recipe);
        let name = if recipe == "growing" { growing_file.to_str().unwrap() } else { recipe };
        let train = TrainOptions { recipe: name.into(), iterations: Some(120), ..TrainOptions::default() };
        let options = RunOptions { train, ..RunOptions::default() };
        run(scene.clone().into(), &options, &out, &NoProgress, &mut |_| {}).unwrap();
        hashes_and_figures(&out)
    };
    let found = KNOWN.map(|known| (of_recipe(known.recipe), known));
    for ((_, figures), Known { recipe, figures: expected, .. }) in &found {
        let is_near = |k: usize| (figures[k] / expected[k] - 1.0).abs() < COUNTS_TOLERANCE;
        let off_m = (figures[2] - expected[2]).abs();
        assert!(is_near(0) && is_near(1) && off_m < HEIGHT_TOLERANCE_M, "{recipe}: {figures:?}");
    }
    let processor = processor();
    let summary: Vec<_> = found.iter().map(|(made, known)| (known.recipe, made)).collect();
    for ((hashes, _), known) in &found {
        match known.hashes.iter().find(|(of, _)| *of == processor) {
            Some((_, expected)) => {
                assert_eq!(hashes, expected, "{}: tie points, splats, heights; {summary:?}", known.recipe)
            }
            None => println!("the bytes of the processor `{processor}` are not known: {summary:?}"),
        }
    }
}
