//! Images of the training's progress: a view as it is rendered so far, and curves of loss and number of splats.

use crate::affine::TrainingView;
use crate::io::{Chart, RgbImage};
use crate::splat::loss::target::{COARSEST_LEVEL, TargetImage};
use crate::splat::satellite::{NovelView, Picture};
use crate::splat::train::LogLine;

/// Longest side of a panel, for views of up to 16 times that, pixels.
const PANEL: usize = 400;
/// Mean difference of encoded colours that is shown in full red.
const LARGEST_ERROR: f32 = 0.25;
/// Largest number of points of a curve; each is the mean over successive iterations.
const CURVE_POINTS: usize = 400;

/// Whether iteration `done`, from 1, is the last of one of `snapshots` equal parts of `all` iterations.
#[must_use]
pub fn is_snapshot_due(snapshots: u32, done: u32, all: u32) -> bool {
    let part = |done: u32| u64::from(done) * u64::from(snapshots) / u64::from(all);
    part(done) > part(done - 1)
}

/// Five panels of a training view: its image, the rendered picture, the share of sunlight, the altitudes (black is the
/// lowest, white the highest), and the difference of picture and image (white is none, red is large).
pub struct Panels<'a> {
    view: &'a TrainingView,
    target: TargetImage,
    /// The camera at the panels' resolution, with which the picture must be rendered.
    pub from: NovelView,
}

impl<'a> Panels<'a> {
    /// The panels of a view; `shadows` tells whether the picture has shadows.
    #[must_use]
    pub fn new(view: &'a TrainingView, shadows: bool) -> Self {
        let factor = view.width.max(view.height).div_ceil(PANEL);
        let max_level = view.width.min(view.height).ilog2() as usize;
        let level = (factor.next_power_of_two().ilog2() as usize).min(COARSEST_LEVEL).min(max_level);
        let mut target = TargetImage::default();
        let camera = target.load(view, level);
        let size = (target.colors.width, target.colors.height);
        let scale = 0.5f64.powi(level as i32);
        let sun_shear = view.sun_shear.filter(|_| shadows).map(|s| s.map(|s| s * scale));
        Self { view, target, from: NovelView { camera, size, sun_shear } }
    }

    /// Draws the panels with the picture rendered from [`Panels::from`]; `altitudes` are the lowest and highest, metres.
    #[must_use]
    pub fn draw(&self, picture: Picture, altitudes: (f64, f64)) -> RgbImage {
        draw_panels(self.view, &self.target, picture, altitudes)
    }
}

fn draw_panels(
    view: &TrainingView,
    target: &TargetImage,
    mut picture: Picture,
    altitudes: (f64, f64),
) -> RgbImage {
    let (width, height) = (target.colors.width, target.colors.height);
    view.transfer_function.encode(&mut picture.colors);
    let byte = |v: f32| (255.0 * v.clamp(0.0, 1.0)).round() as u8;
    let (low, high) = (altitudes.0 as f32, altitudes.1 as f32);
    RgbImage::panels((width, height), |col, row| {
        let is_valid = target.valid[row * width + col];
        let image = is_valid
            .then(|| std::array::from_fn(|c| view.transfer_function.encoded(target.colors.at(c, col, row))));
        let rendered = picture.colors.each_ref().map(|c| c.at(col, row));
        let altitude = picture.altitude.at(col, row);
        let error = image
            .map(|image: [f32; 3]| image.iter().zip(rendered).map(|(a, b)| (a - b).abs()).sum::<f32>() / 3.0);
        let white = error.map(|e| byte(1.0 - e / LARGEST_ERROR));
        [
            image.map_or(RgbImage::NO_DATA, |c| c.map(byte)),
            rendered.map(byte),
            [byte(picture.sunlight.at(col, row)); 3],
            if altitude.is_nan() { RgbImage::NO_DATA } else { [byte((altitude - low) / (high - low)); 3] },
            white.map_or(RgbImage::NO_DATA, |w| [255, w, w]),
        ]
    })
}

/// Curves of loss and number of splats over the iterations, each as a fraction of its largest value.
#[must_use]
pub fn curves(log: &[LogLine]) -> Chart {
    let block = log.len().div_ceil(CURVE_POINTS).max(1);
    let mean = |lines: &[LogLine], of: fn(&LogLine) -> f64| {
        lines.iter().map(of).sum::<f64>() / lines.len().max(1) as f64
    };
    let curve = |of: fn(&LogLine) -> f64| -> Vec<(f64, f64)> {
        let points =
            log.chunks(block).map(|lines| (mean(lines, |l| f64::from(l.iteration)), mean(lines, of)));
        let points: Vec<(f64, f64)> = points.collect();
        let largest = points.iter().map(|p| p.1).fold(f64::MIN_POSITIVE, f64::max);
        points.into_iter().map(|(iteration, value)| (iteration, value / largest)).collect()
    };
    Chart {
        title: "Training".into(),
        x: "iteration".into(),
        y: "fraction of the largest value".into(),
        lines: vec![("loss".into(), curve(|l| l.loss)), ("splats".into(), curve(|l| l.splats as f64))],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::affine::ViewCamera;
    use crate::io::Grid2;
    use crate::splat::appearance::Appearance;
    use crate::splat::splats::Splats;

    #[test]
    fn panels_show_image_picture_shadow_altitude_and_error() {
        let camera = ViewCamera::affine([[1.0, 0.0, 0.2], [0.0, -1.0, 0.1]], [19.5, 19.5]);
        let white = Grid2::filled(40, 40, 1.0);
        let view = TrainingView::new(
            "v".into(),
            camera,
            Some([1.0, 0.0]),
            &[white],
            (-30.0, -30.0, 10.0, 30.0),
            (0.0, 0.0),
        );
        let mut splats = Splats::default();
        // Black ground, a part of which lies in the shadow of a roof.
        for i in -12..=12 {
            for j in -12..=12 {
                splats.push([2.0 * i as f32, 2.0 * j as f32, 0.0], 2.0, 0.99, [0.0; 3]);
            }
        }
        for i in -2..=2 {
            for j in -2..=2 {
                splats.push([i as f32, j as f32, 10.0], 1.0, 0.99, [0.0; 3]);
            }
        }
        let panels = Panels::new(&view, true);
        let picture = panels.from.picture(&splats, &Appearance::default(), (-10.0, 10.0));
        let image = panels.draw(picture, (-10.0, 10.0));
        assert_eq!((image.width, image.height), (5 * 48 - 8, 40));
        let at = |panel: usize, col: usize, row: usize| image.at(panel * 48 + col, row);
        assert_eq!((at(0, 5, 30), at(0, 38, 30)), ([255; 3], RgbImage::NO_DATA));
        assert!(at(1, 5, 30)[0] < 10 && at(3, 5, 30)[0].abs_diff(127) < 3, "ground");
        assert!(at(3, 21, 20)[0] > 240, "roof");
        let light: Vec<u8> = (0..40).map(|col| at(2, col, 20)[0]).collect();
        assert!(light.iter().any(|l| *l < 100) && light[2] > 240, "{light:?}");
        assert_eq!((at(4, 5, 30), at(4, 38, 30)), ([255, 0, 0], RgbImage::NO_DATA));
    }

    #[test]
    fn snapshots_are_due_at_the_end_of_equal_parts_of_the_training() {
        let due = |snapshots: u32| -> Vec<u32> {
            (1..=100).filter(|done| is_snapshot_due(snapshots, *done, 100)).collect()
        };
        assert_eq!(due(4), [25, 50, 75, 100]);
        assert_eq!((due(0).len(), due(3).len(), due(1000).len()), (0, 3, 100));
    }

    #[test]
    fn curves_have_a_limited_number_of_points_of_at_most_one() {
        for iterations in [0, 1, 2, 799, 4000] {
            let line =
                |i: u32| LogLine { iteration: i, loss: 1.0 / f64::from(i), splats: 9, ..LogLine::default() };
            let log: Vec<LogLine> = (1..=iterations).map(line).collect();
            for (_, points) in curves(&log).lines {
                assert!(points.iter().all(|p| p.1 <= 1.0) && points.len() <= CURVE_POINTS);
            }
        }
    }
}
