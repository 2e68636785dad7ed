//! The layers of the page of `satgs view`, from the files of a run folder.

use super::PipelineError;
use super::page_splats::PageSplats;
use crate::affine::SiteScene;
use crate::bundle::Adjustment;
use crate::frame::{Geodetic, Point, Site, SiteGrid};
use crate::run_files::{ADJUSTMENT, CONFIDENCE, DSM, MESHES, ORTHO, SPARSE_POINTS};
use crate::viewer::{PageFile, PageLayer, ReliefLayer, ShownLayer, ViewerError, ViewerPage};
use std::path::Path;

/// Adds splats.
pub(super) fn add_splats(page: &mut ViewerPage, splats: PageSplats) {
    let PageSplats { files, count, .. } = splats;
    let layer = PageLayer::Splats { files: files.iter().map(|file| file.name.clone()).collect(), count };
    page.files.extend(files);
    page.layers.push(ShownLayer { layer, label: "Splats", note: grouped(count), is_shown: true });
}

/// Adds the mesh of the run, if there is one.
pub(super) fn add_mesh(
    page: &mut ViewerPage,
    run: &Path,
    site: Option<&SiteGrid>,
) -> Result<(), PipelineError> {
    let Some(file) = MESHES.into_iter().find(|name| run.join(name).exists()) else { return Ok(()) };
    let path = run.join(file);
    let damaged = |reason: String| ViewerError::Mesh { path: path.clone(), reason };
    let bytes = std::fs::read(&path).map_err(|e| damaged(e.to_string()))?;
    let offset = if file.ends_with(".glb") {
        glb_offset(&bytes, site).ok_or_else(|| damaged("it is not a GLB file".into()))?
    } else {
        [0.0; 3]
    };
    let note = format!("{} MB", bytes.len().div_ceil(1_000_000));
    page.files.push(PageFile::new(file, bytes));
    let layer = PageLayer::Mesh { file, offset };
    page.layers.push(ShownLayer { layer, label: "Mesh", note, is_shown: false });
    Ok(())
}

/// What is added to the coordinates of a GLB file to give site coordinates: its scene's `extras` name the place of its
/// origin on the map, at height 0; without them it is in the site frame. None for other files.
fn glb_offset(bytes: &[u8], site: Option<&SiteGrid>) -> Option<[f64; 3]> {
    let length = u32::from_le_bytes(bytes.get(12..16)?.try_into().ok()?) as usize;
    let text = bytes.get(20..20usize.checked_add(length)?)?;
    let document: serde_json::Value = serde_json::from_slice(text).ok()?;
    let extras = &document["scenes"][0]["extras"];
    Some(match (extras["east_m"].as_f64(), extras["north_m"].as_f64(), site.map(|site| site.origin.xyz())) {
        (Some(e), Some(n), Some([east, north, up])) => {
            [e - east, n - north, extras["height_m"].as_f64().unwrap_or(0.0) - up]
        }
        _ => [0.0; 3],
    })
}

/// Adds the surface model, if there is one, in the colours of the orthophoto.
pub(super) fn add_relief(page: &mut ViewerPage, run: &Path, site: &SiteGrid) -> Result<(), PipelineError> {
    let [dsm, ortho, confidence] = [DSM, ORTHO, CONFIDENCE].map(|name| run.join(name));
    if !dsm.exists() {
        return Ok(());
    }
    let if_there = |path: &'_ Path| path.exists().then(|| path.to_path_buf());
    let (ortho, confidence) = (if_there(&ortho), if_there(&confidence));
    let relief = ReliefLayer::read(&dsm, ortho.as_deref(), confidence.as_deref(), site)?;
    page.files.push(PageFile::new("relief.bin", relief.bytes()));
    let layer = PageLayer::Relief {
        file: "relief.bin",
        texture: relief.texture.is_some().then_some("ortho.png"),
        views: relief.views.is_some().then_some("views.bin"),
        columns: relief.altitudes.width,
        rows: relief.altitudes.height,
        west: relief.west,
        north: relief.north,
        cell: relief.cell,
    };
    if let Some(bytes) = relief.texture {
        page.files.push(PageFile::new("ortho.png", bytes));
    }
    if let Some(bytes) = relief.views {
        page.files.push(PageFile::new("views.bin", bytes));
    }
    page.layers.push(ShownLayer { layer, label: "DSM", note: format!("{} m", relief.cell), is_shown: false });
    Ok(())
}

/// Adds the sparse points of the adjustment, if there are some.
pub(super) fn add_tie_points(
    page: &mut ViewerPage,
    run: &Path,
    setup: &SiteScene,
) -> Result<(), PipelineError> {
    let folder = run.join(ADJUSTMENT);
    if !folder.join(SPARSE_POINTS).exists() {
        return Ok(());
    }
    let points = Adjustment::read(&folder)?.points;
    let place = |p: Point<Geodetic>| setup.site.site_from_geodetic(p);
    let points: Vec<_> = points.iter().map(|p| (place(p.position), [p.gray; 3])).collect();
    add_points(page, &points);
    Ok(())
}

/// Adds points with red, green and blue.
pub(super) fn add_points(page: &mut ViewerPage, points: &[(Point<Site>, [u8; 3])]) {
    let mut bytes: Vec<u8> =
        points.iter().flat_map(|(p, _)| p.xyz()).flat_map(|v| (v as f32).to_le_bytes()).collect();
    bytes.extend(points.iter().flat_map(|(_, rgb)| rgb));
    page.files.push(PageFile::new("points.bin", bytes));
    let (layer, note) =
        (PageLayer::Points { file: "points.bin", count: points.len() }, grouped(points.len()));
    page.layers.push(ShownLayer { layer, label: "Sparse points", note, is_shown: false });
}

/// A number with a space between groups of three digits.
pub(super) fn grouped(number: usize) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push('\u{202f}');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_grouped() {
        for (number, text) in
            [(7, "7"), (123, "123"), (1234, "1\u{202f}234"), (1234567, "1\u{202f}234\u{202f}567")]
        {
            assert_eq!(grouped(number), text);
        }
    }

    #[test]
    fn a_mesh_with_a_place_on_the_map_is_moved_into_the_site_frame() {
        let site = SiteGrid { epsg: 32617, origin: Point::new(100.0, 200.0, 30.0) };
        let glb = |text: &str| {
            let mut bytes = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
            bytes.extend((text.len() as u32).to_le_bytes());
            bytes.extend(b"JSON");
            bytes.extend(text.bytes());
            bytes
        };
        let placed = glb(r#"{"scenes":[{"extras":{"east_m":110.5,"north_m":190.0}}]}"#);
        assert_eq!(glb_offset(&placed, Some(&site)), Some([10.5, -10.0, -30.0]));
        assert_eq!(glb_offset(&glb(r#"{"scenes":[{}]}"#), Some(&site)), Some([0.0; 3]));
        for cut in 0..placed.len() {
            assert_eq!(glb_offset(&placed[..cut], Some(&site)), None);
        }
    }
}
