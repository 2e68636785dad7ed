//! What changed between two runs, or two surface models: `satgs changes`.

use super::PipelineError;
use super::evaluate::evidence;
use crate::changes::{Changes, Epoch, Region, RegionRule};
use crate::io::{Cog, MapFeature, MapShape, check_writable, write_file, write_json, write_map_features};
use crate::metrics::{HeightRaster, ScaleWords, error_figure, error_style};
use crate::progress::{Event, Progress};
use crate::run_files::DSM;
use std::path::{Path, PathBuf};

/// Files that are written.
const DIFFERENCE: &str = "difference.tif";
const STYLE: &str = "difference.qml";
const PICTURE: &str = "difference.png";
const REGIONS: &str = "changes.gpkg";
const SUMMARY: &str = "changes.json";
const FILES: [&str; 5] = [DIFFERENCE, STYLE, PICTURE, REGIONS, SUMMARY];
/// The words of the picture's scale.
const WORDS: ScaleWords = ScaleWords { below: "lower", above: "higher", missing: "not known" };

/// Options of a comparison.
#[derive(Clone, Copy, Debug, Default)]
pub struct ChangesOptions {
    /// What counts as a change.
    pub rule: RegionRule,
    /// Replace files of an earlier comparison.
    pub overwrite: bool,
}

/// Compares two surfaces, each a run folder or the raster of a surface model, and writes the map of the differences, the regions that
/// changed and a summary into the folder `output`.
///
/// # Errors
/// [`PipelineError`]: a file cannot be read, the two have too little ground in common, an output exists or cannot be written.
pub fn changes(
    earlier: &Path,
    later: &Path,
    options: &ChangesOptions,
    output: &Path,
    progress: &dyn Progress,
) -> Result<Changes, PipelineError> {
    for path in FILES.map(|name| output.join(name)) {
        if path.exists() && !options.overwrite {
            return Err(PipelineError::Exists { path });
        }
    }
    let [from, to] = [epoch(earlier)?, epoch(later)?];
    let inputs = format!("{}, {}", from.surface.path.display(), to.surface.path.display());
    check_writable(&output.join(DIFFERENCE))?;
    progress.check()?;
    progress.event(Event::Started { stage: "comparing surfaces", total: 0 });
    let found = Changes::between(from, to, &options.rule)?;
    progress.event(Event::Finished);
    found.notes.iter().for_each(|note| progress.event(Event::Note(note.clone())));
    if !found.is_determined {
        progress.event(Event::Warning(
            "the heights do not determine the horizontal shift between the two; in the directions that they leave open the later one \
             is not moved"
                .into(),
        ));
    }
    write(&found, &inputs, output)?;
    Ok(found)
}

/// The surface of a run folder, or of a raster, with what is expected of its errors.
fn epoch(path: &Path) -> Result<Epoch, PipelineError> {
    let file: PathBuf = if path.is_dir() { path.join(DSM) } else { path.into() };
    let surface = HeightRaster::read(&file)?;
    let expected_error = evidence(&surface, None)?.and_then(|evidence| evidence.expected_error);
    Ok(Epoch { surface, expected_error })
}

fn write(found: &Changes, inputs: &str, output: &Path) -> Result<(), PipelineError> {
    let [east, north, up] = found.moved_m;
    let metadata = [
        ("INPUTS", inputs.to_owned()),
        ("TIFFTAG_IMAGEDESCRIPTION", "later minus earlier height".to_owned()),
        ("LATER_MOVED", format!("{east:.3} m east, {north:.3} m north, {up:.3} m up")),
    ];
    let cog = Cog { grid: found.grid, metadata: &metadata, heights_from: None };
    let bands = [("difference", "m", &found.difference), ("standard deviation", "m", &found.sigma)];
    cog.write_f32(&output.join(DIFFERENCE), &bands)?;
    write_file(&output.join(STYLE), error_style())?;
    error_figure(&found.difference, found.grid.cell, &WORDS).write(&output.join(PICTURE))?;
    let features: Vec<MapFeature> = found.regions.iter().enumerate().map(feature).collect();
    write_map_features(&output.join(REGIONS), "changes", found.grid.epsg, MapShape::Polygon, &features)?;
    Ok(write_json(&output.join(SUMMARY), found)?)
}

fn feature((index, region): (usize, &Region)) -> MapFeature {
    MapFeature {
        corners: region.outline.clone(),
        texts: vec![("change", if region.mean_m > 0.0 { "rose" } else { "fell" }.into())],
        numbers: vec![
            ("number", index as f64 + 1.0),
            ("area_m2", region.area_m2),
            ("mean_m", region.mean_m),
            ("largest_m", region.largest_m),
            ("volume_m3", region.volume_m3),
            ("volume_sigma_m3", region.volume_sigma_m3),
        ],
    }
}
