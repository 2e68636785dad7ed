//! Depths by matching the photographs of a scene with each other.

use super::error::PriorError;
use super::map::DepthPrior;
use crate::checkpoint::PartStore;
use crate::io::Grid2;
use crate::mvs::{MatchError, MatchedPoint, Photograph, match_photographs, matched_points};
use crate::perspective::{PerspectiveError, PerspectiveView, PinholeCamera, ScenePoint, ViewImage};
use crate::progress::{Event, Progress};
use glam::DVec2;
use rayon::prelude::*;

/// The mean colour of a window is that of so many pixels on each side of its centre, and of the centre.
const AVERAGED: i64 = 3;

/// For each view its depths in the unit of the scene, NaN where they are not known, in a map of the image file: with the distortion
/// of its lens, at the size at which views are matched. What is found goes to `parts`, and is taken from there.
///
/// # Errors
/// [`PriorError::Image`] if an image cannot be read, [`PriorError::Write`] if a part cannot be stored, [`PriorError::Interrupted`] if
/// `progress` asks to stop.
pub(super) fn stereo_maps(
    views: &[&PerspectiveView],
    parts: &PartStore,
    progress: &dyn Progress,
) -> Result<Vec<Grid2>, PriorError> {
    let interrupted = || PriorError::Interrupted { made: 0, total: views.len() };
    progress.event(Event::Started { stage: "reading images", total: views.len() as u64 });
    let mut photographs = Vec::with_capacity(views.len());
    // As many at a time as there are threads: an undistorted image is several times as large as what is kept of it.
    for some in views.chunks(rayon::current_num_threads().max(1)) {
        if progress.is_cancelled() {
            return Err(interrupted());
        }
        let read = |view: &&PerspectiveView| -> Result<Photograph, PriorError> {
            Ok(Photograph::new(view.camera, gray(&view.read_image()?)))
        };
        let read: Vec<Result<Photograph, PriorError>> = some.par_iter().map(read).collect();
        for photograph in read {
            photographs.push(photograph?);
        }
        progress.event(Event::Advanced { done: photographs.len() as u64, status: String::new() });
    }
    progress.event(Event::Finished);
    let cameras: Vec<PinholeCamera> = photographs.iter().map(|p| *p.camera()).collect();
    let found = match_photographs(photographs, Some(parts), progress).map_err(|e| match e {
        MatchError::Write(e) => e.into(),
        _ => interrupted(),
    })?;
    let all = views.par_iter().zip(&cameras).zip(&found);
    Ok(all.map(|((view, camera), depth)| of_file(view, camera, depth)).collect())
}

/// About `most` points of the surface that views with depths in the unit of the scene show, with their colours.
///
/// # Errors
/// [`PerspectiveError`] if an image cannot be read.
pub fn stereo_points(
    views: &[(&PerspectiveView, &DepthPrior)],
    most: usize,
) -> Result<Vec<ScenePoint>, PerspectiveError> {
    let factor = |view: &PerspectiveView| Photograph::reduction(view.camera.size);
    let cameras: Vec<PinholeCamera> =
        views.iter().map(|(view, _)| view.camera.reduced(factor(view))).collect();
    let depths: Vec<Grid2> = views.iter().map(|(view, depth)| every(&depth.values, factor(view))).collect();
    let points = matched_points(&cameras, &depths.iter().collect::<Vec<_>>(), most);
    let of_view = |own: &[MatchedPoint]| -> Result<Vec<ScenePoint>, PerspectiveError> {
        let Some((view, _)) = own.first().and_then(|p| views.get(p.view)) else { return Ok(Vec::new()) };
        let (image, factor) = (view.read_image()?, factor(view) as i64);
        let point = |p: &MatchedPoint| {
            let pixel = p.pixel.map(|at| at * factor + factor / 2);
            Some(ScenePoint { position: p.position, rgb: color(&image, pixel)? })
        };
        Ok(own.iter().filter_map(point).collect())
    };
    let by_view: Vec<&[MatchedPoint]> = points.chunk_by(|a, b| a.view == b.view).collect();
    let colored: Vec<Result<Vec<ScenePoint>, PerspectiveError>> =
        by_view.into_par_iter().map(of_view).collect();
    Ok(colored.into_iter().collect::<Result<Vec<_>, _>>()?.concat())
}

/// The values in the middle of squares of `factor` cells a side.
fn every(values: &Grid2, factor: usize) -> Grid2 {
    let middle = |at: usize| at * factor + factor / 2;
    Grid2::from_fn(values.width / factor, values.height / factor, |col, row| {
        values.at(middle(col), middle(row))
    })
}

/// The colour of a pixel; outside of the image the mean of what it shows nearest to there, of the more the farther away. None where
/// it shows nothing.
fn color(image: &ViewImage, pixel: [i64; 2]) -> Option<[u8; 3]> {
    let Grid2 { width, height, .. } = image.planes[0];
    let last = [width, height].map(|count| count as i64 - 1);
    let nearest = [0, 1].map(|k| pixel[k].clamp(0, last[k]));
    let outside = (0..2).map(|k| (pixel[k] - nearest[k]).abs()).max().unwrap_or(0);
    let is_shown = |[col, row]: [i64; 2]| image.shows_surface(row as usize * width + col as usize);
    if !is_shown(nearest) {
        return None;
    }
    let window = (-AVERAGED..=AVERAGED).flat_map(|down| {
        (-AVERAGED..=AVERAGED).map(move |right| {
            let at = [nearest[0] + right * outside / AVERAGED, nearest[1] + down * outside / AVERAGED];
            [0, 1].map(|k| at[k].clamp(0, last[k]))
        })
    });
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for at in window.filter(|at| is_shown(*at)) {
        for (sum, plane) in sum.iter_mut().zip(&image.planes) {
            *sum += plane.at(at[0] as usize, at[1] as usize);
        }
        count += 1.0;
    }
    Some(sum.map(|sum| (255.0 * sum / count).round().clamp(0.0, 255.0) as u8))
}

/// Gray values as displayed; NaN where there is no surface.
fn gray(image: &ViewImage) -> Grid2 {
    let [red, green, blue] = &image.planes;
    Grid2::from_rows(red.width, red.height, |row, line| {
        for (col, out) in line.iter_mut().enumerate() {
            let mean = (red.at(col, row) + green.at(col, row) + blue.at(col, row)) / 3.0;
            *out = if image.shows_surface(row * red.width + col) { mean } else { f32::NAN };
        }
    })
}

/// The depths of a camera without distortion in a map of the image file, of about the size of the depths. The borders of both are
/// those of the image.
fn of_file(view: &PerspectiveView, camera: &PinholeCamera, depth: &Grid2) -> Grid2 {
    let lens = &view.lens_camera;
    let size = DVec2::new(lens.size.0 as f64, lens.size.1 as f64);
    // A reduced image leaves out what fills no pixel; the map has the proportions of the file.
    let height = ((depth.width as f64 * size.y / size.x).round() as usize).max(1);
    let pixels = DVec2::new(depth.width as f64, height as f64);
    Grid2::from_rows(depth.width, height, |row, line| {
        for (col, out) in line.iter_mut().enumerate() {
            let at = (DVec2::new(col as f64, row as f64) + 0.5) * size / pixels - 0.5;
            let seen = (at - lens.principal) / lens.focal;
            let ideal = if lens.model.is_pinhole() { Some(seen) } else { lens.undistorted(seen) };
            *out = ideal.map_or(f32::NAN, |ideal| {
                let px = ideal * camera.focal + camera.principal;
                depth.get(px.x.round() as i64, px.y.round() as i64)
            });
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outside_of_an_image_colors_are_those_of_its_rim() {
        let plane = Grid2::from_fn(40, 30, |col, row| if col < 20 { 0.2 } else { 0.01 * row as f32 });
        let mut image = ViewImage { planes: [(); 3].map(|()| plane.clone()), opacity: None };
        assert_eq!(color(&image, [30, 20]), Some([51; 3]));
        assert_eq!(color(&image, [-9, 15]), Some([51; 3]));
        // The mean of the rows near the last one, which are few.
        let [below, ..] = color(&image, [39, 60]).unwrap_or_default();
        assert!((40..74).contains(&below), "{below}");
        image.planes[1].data[39] = f32::NAN;
        assert_eq!(color(&image, [60, -20]), None);
    }
}
