//! The truth of shadows, cars and colours, in `truth/appearance/`: pictures of every image, and `views.json`.

use super::radiometry::Radiometry;
use super::render::Picture;
use super::season::Palette;
use super::summary::{AppearanceFigures, ViewFigures};
use crate::io::{WriteError, write_json, write_png_gray, write_png_rgb};
use std::collections::BTreeMap;
use std::path::Path;

/// Ends of the names of the pictures of a view.
pub(super) const PICTURES: [&str; 3] = ["_sunlit.png", "_cars.png", "_clean.png"];
/// Name of the file that describes all views.
pub(super) const LIST: &str = "views.json";

/// Writes the pictures of a view to `folder` and describes its appearance.
pub(super) fn write(
    folder: &Path,
    name: &str,
    size_px: usize,
    picture: &Picture,
    palette: &Palette,
    radiometry: &Radiometry,
) -> Result<AppearanceFigures, WriteError> {
    let [sunlit, cars, clean] = PICTURES.map(|end| folder.join(format!("{name}{end}")));
    write_png_gray(&sunlit, size_px, size_px, &picture.sunlit)?;
    write_png_gray(&cars, size_px, size_px, &picture.cars)?;
    write_png_rgb(&clean, size_px, size_px, &picture.clean)?;
    let [grass, trees] = palette.means();
    Ok(AppearanceFigures {
        gain: radiometry.gain,
        offset: radiometry.offset,
        noise: radiometry.noise,
        grass,
        trees,
        snow: palette.snow,
        cars_percent: picture.cars_percent(),
        sunlit,
        cars,
        clean,
    })
}

/// Writes `views.json`: for each view its role, date and sun, and how it looks. Paths are relative to the file.
pub(super) fn write_list(folder: &Path, views: &[ViewFigures]) -> Result<(), WriteError> {
    let relative = |view: &ViewFigures| {
        let mut view = view.clone();
        for path in view.appearance.iter_mut().flat_map(AppearanceFigures::paths_mut) {
            *path = path.file_name().map_or_else(|| path.clone(), Into::into);
        }
        (view.name.clone(), view)
    };
    write_json(&folder.join(LIST), &views.iter().map(relative).collect::<BTreeMap<_, _>>())
}
