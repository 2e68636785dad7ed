//! Figures of an adjustment: the residuals in the images, their histogram, the connections between views, the angles.

use super::error::BundleError;
use super::output::Adjustment;
use crate::io::Canvas;
use crate::scene::Scene;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::Path;

/// Side of a view's panel, and between panels, pixels.
const PANEL: f64 = 320.0;
const GAP: f64 = 16.0;
/// Factor by which residuals are enlarged, for a panel as wide as the image.
const ARROW: f64 = 40.0;
/// Size of the other pictures, pixels.
const SIDE: f64 = 640.0;
const BEFORE: [u8; 3] = Canvas::ORANGE;
const AFTER: [u8; 3] = Canvas::BLUE;

/// Number of bins of the angles between rays, and their width, degrees.
const ANGLE_BINS: usize = 35;
const ANGLE_BIN_DEG: f64 = 2.0;

impl Adjustment {
    /// Writes `residuals.png` (a panel a view, row by row in the report's order; arrows are 40 times the residuals),
    /// `histogram.png` (errors before in orange, after in blue, a line every half pixel) and `graph.png` (views on a
    /// circle, clockwise from the top; the darker a line, the more points two views share) and `angles.png` (points by
    /// the widest angle between their rays, in bins of 2°, a line every 10°).
    ///
    /// # Errors
    /// [`BundleError::Raster`].
    pub fn write_figures(&self, folder: &Path, scene: &Scene) -> Result<(), BundleError> {
        self.residuals(scene).write(&folder.join("residuals.png"))?;
        self.histogram().write(&folder.join("histogram.png"))?;
        self.graph().write(&folder.join("graph.png"))?;
        Ok(self.angles().write(&folder.join("angles.png"))?)
    }

    fn residuals(&self, scene: &Scene) -> Canvas {
        let columns = (self.cameras.len() as f64).sqrt().ceil().max(1.0);
        let rows = (self.cameras.len() as f64 / columns).ceil();
        let pitch = PANEL + GAP;
        let mut canvas = Canvas::new((columns * pitch + GAP) as usize, (rows * pitch + GAP) as usize);
        let observed = |view: usize| self.observations.iter().filter(move |t| t.view == view);
        for (i, (name, _)) in self.cameras.iter().enumerate() {
            let Some(view) = scene.views.iter().find(|v| v.name == *name) else { continue };
            let size = [view.width as f64, view.height as f64];
            let corner = [(i as f64 % columns) * pitch + GAP, (i as f64 / columns).floor() * pitch + GAP];
            let scale = PANEL / size[0].max(size[1]);
            let first = view.window.map_or([0.0; 2], |w| [w.col as f64, w.row as f64]);
            let [w, h] = size.map(|s| s * scale);
            let ring = [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]];
            canvas.outline(&ring.map(|p| [corner[0] + p[0], corner[1] + p[1]]), Canvas::GRID);
            for tie in observed(i) {
                let at = [
                    corner[0] + scale * (tie.px.col - first[0]),
                    corner[1] + scale * (tie.px.row - first[1]),
                ];
                let [d_col, d_row] = tie.residual_px;
                canvas.line(at, [at[0] + ARROW * d_col, at[1] + ARROW * d_row], AFTER);
                canvas.dot(at, [0; 3]);
            }
        }
        canvas
    }

    fn histogram(&self) -> Canvas {
        bars(&self.report.histogram, [BEFORE, AFTER], 10)
    }

    fn angles(&self) -> Canvas {
        let mut bins = vec![[0]; ANGLE_BINS];
        for q in &self.quality {
            bins[((q.angle_deg / ANGLE_BIN_DEG) as usize).min(ANGLE_BINS - 1)][0] += 1;
        }
        bars(&bins, [AFTER], 5)
    }

    fn graph(&self) -> Canvas {
        let mut canvas = Canvas::new(SIDE as usize, SIDE as usize);
        let mut shared: BTreeMap<(usize, usize), usize> = BTreeMap::new();
        for point in self.observations.chunk_by(|a, b| a.point == b.point) {
            for (k, a) in point.iter().enumerate() {
                for b in &point[k + 1..] {
                    *shared.entry((a.view, b.view)).or_default() += 1;
                }
            }
        }
        let place = |view: usize| {
            let (sin, cos) = (TAU * view as f64 / self.cameras.len() as f64).sin_cos();
            [0.5 * SIDE + (0.5 * SIDE - GAP) * sin, 0.5 * SIDE - (0.5 * SIDE - GAP) * cos]
        };
        let most = shared.values().copied().max().unwrap_or(1) as f64;
        // The strongest connections are drawn last.
        let mut edges: Vec<_> = shared.into_iter().collect();
        edges.sort_by_key(|e| e.1);
        for ((a, b), count) in edges {
            let light = (230.0 * (1.0 - (count as f64 / most).sqrt())) as u8;
            canvas.line(place(a), place(b), [light; 3]);
        }
        for view in 0..self.cameras.len() {
            canvas.disc(place(view), 5.0, AFTER);
        }
        canvas
    }
}

/// A histogram of `N` bars a bin, each of its own colour, with a line every `grid` bins.
fn bars<const N: usize>(bins: &[[usize; N]], colors: [[u8; 3]; N], grid: usize) -> Canvas {
    let mut canvas = Canvas::new(SIDE as usize, SIDE as usize / 2);
    let highest = bins.iter().flatten().copied().max().unwrap_or(1).max(1) as f64;
    let (floor, width) = (0.5 * SIDE - GAP, (SIDE - 2.0 * GAP) / bins.len() as f64);
    let left = |bin: f64| GAP + width * bin;
    for bin in (0..=bins.len()).step_by(grid) {
        let x = left(bin as f64);
        canvas.line([x, GAP], [x, floor], Canvas::GRID);
    }
    for (i, counts) in bins.iter().enumerate() {
        for (k, (count, color)) in counts.iter().zip(colors).enumerate() {
            let top = floor - (floor - GAP) * *count as f64 / highest;
            let side = |k: usize| left(i as f64 + k as f64 / N as f64);
            canvas.bar([side(k), top], [side(k + 1), floor], color);
        }
    }
    canvas
}
