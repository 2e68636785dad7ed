//! The bytes of a small scene, so that work on the house is told from work on the numbers.
//!
//! The same instructions give the same bytes, whatever the number of threads; other instruction sets and other makes of
//! processor round differently in their last bit, so the hashes are kept by processor. A deliberate change of the results
//! changes them here, and says so in the change log.

use satgs::io::ImageFile;
use satgs::pipeline::{RunOptions, TrainOptions, run};
use satgs::progress::NoProgress;
use satgs::run_files::{ADJUSTMENT, DSM, SPLATS};
use satgs::scene::{self, ReadOptions};
use satgs::simulate::{SimulateOptions, simulate};
use satgs::splat::train::recipe::{Densification, Recipe};
use std::path::Path;

/// Processor, recipe, and the hashes of tie_points.csv, splats.ply and the heights of dsm.tif.
const KNOWN: [(&str, &str, [&str; 3]); 4] = [
    ("GenuineIntel avx512", "best", ["e7a686dd4b3929ac", "8954d420a281c61c", "8c5c86a2be007a6a"]),
    ("GenuineIntel avx512", "growing", ["e7a686dd4b3929ac", "a33cdb3585eaec53", "05373d601e78d4b7"]),
    ("GenuineIntel avx512", "baeogs", ["e7a686dd4b3929ac", "086848e0151c0fa1", "df3cd26fca91802b"]),
    ("GenuineIntel avx512", "eogs", ["e7a686dd4b3929ac", "d2bc565ce5b98238", "c3a5c6f91e5acab5"]),
];

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

fn hashes(folder: &Path) -> [String; 3] {
    let read = |name: &Path| std::fs::read(folder.join(name)).unwrap();
    let heights = ImageFile::open(&folder.join(DSM)).unwrap().read(1).unwrap();
    let heights: Vec<u8> = heights.data.iter().flat_map(|z| z.to_bits().to_le_bytes()).collect();
    let tie_points = read(&Path::new(ADJUSTMENT).join("tie_points.csv"));
    [hash(&tie_points), hash(&read(Path::new(SPLATS))), hash(&heights)]
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
    let processor = processor();
    let known: Vec<_> = KNOWN.iter().filter(|(known, ..)| *known == processor).collect();
    if known.is_empty() {
        println!("skipped: no bytes are known for the processor `{processor}`");
        return;
    }
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
        run(&scene, &RunOptions { train, ..RunOptions::default() }, &out, &NoProgress, &mut |_| {}).unwrap();
        hashes(&out)
    };
    let found: Vec<(&str, [String; 3])> = known.iter().map(|k| (k.1, of_recipe(k.1))).collect();
    let expected: Vec<(&str, [String; 3])> = known.iter().map(|k| (k.1, k.2.map(str::to_owned))).collect();
    assert_eq!(found, expected, "recipe: tie points, splats, heights");
}
