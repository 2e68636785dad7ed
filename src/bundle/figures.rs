//! Plots of an adjustment: the residuals in the images, their histogram, the connections between views, the angles.

use super::error::BundleError;
use super::output::Adjustment;
use super::report::BIN_PX;
use crate::io::svg::{BLUE, GRAY};
use crate::io::{Chart, Drawing};
use crate::scene::{Scene, short_names};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::Path;

/// Names of the plots in the folder of an adjustment.
pub const ADJUSTMENT_FIGURES: [&str; 4] = ["residuals.svg", "histogram.svg", "graph.svg", "angles.svg"];
/// Longest side of a view's panel, and the distance between panels.
const PANEL: f64 = 320.0;
const GAP: f64 = 16.0;
/// Room below a panel for the name of its view.
const TEXT_GAP: f64 = 20.0;
/// Factor by which residuals are enlarged, for a panel as wide as the image.
const ENLARGEMENT: f64 = 40.0;
/// Largest number of residuals that are drawn of a view, evenly chosen.
const MAX_ARROWS: usize = 2000;
/// Side of the graph of connections.
const SIDE: f64 = 480.0;
/// Room around the graph for the names of the views.
const NAMES: f64 = 60.0;
/// Number of bins of the angles between rays, and their width, degrees.
const ANGLE_BINS: usize = 35;
const ANGLE_BIN_DEG: f64 = 2.0;

impl Adjustment {
    /// Writes the figures: `residuals.svg` (a panel for each view, row by row in the order of the report; residuals are
    /// enlarged 40 times), `histogram.svg` (reprojection errors before and after), `graph.svg` (the views on a circle,
    /// clockwise from the top; the darker a line, the more points two views share) and `angles.svg` (largest angle
    /// between the rays of each point).
    ///
    /// # Errors
    /// [`BundleError::Write`].
    pub fn write_figures(&self, folder: &Path, scene: &Scene) -> Result<(), BundleError> {
        let [residuals, histogram, graph, angles] = ADJUSTMENT_FIGURES.map(|name| folder.join(name));
        self.residuals(scene).write(&residuals, "residuals of the tie points in each view")?;
        self.histogram().write(&histogram)?;
        self.graph().write(&graph, "numbers of tie points that pairs of views share")?;
        Ok(self.angles().write(&angles)?)
    }

    fn residuals(&self, scene: &Scene) -> Drawing {
        let columns = (self.cameras.len() as f64).sqrt().ceil().max(1.0);
        let rows = (self.cameras.len() as f64 / columns).ceil();
        let (pitch, down) = (PANEL + GAP, PANEL + TEXT_GAP + GAP);
        let mut drawing = Drawing::new(columns * pitch + GAP, rows * down + 2.0 * GAP);
        let mut of_views = vec![Vec::new(); self.cameras.len()];
        for observation in &self.observations {
            of_views[observation.view].push(observation);
        }
        for (i, (name, _)) in self.cameras.iter().enumerate() {
            let Some(view) = scene.views.iter().find(|v| v.name == *name) else { continue };
            let size = [view.width as f64, view.height as f64];
            let corner = [(i as f64 % columns) * pitch + GAP, (i as f64 / columns).floor() * down + GAP];
            let scale = PANEL / size[0].max(size[1]);
            let first = view.window.map_or([0.0; 2], |w| [w.col as f64, w.row as f64]);
            let [w, h] = size.map(|s| s * scale);
            let ring = [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]];
            drawing.outline(&ring.map(|p| [corner[0] + p[0], corner[1] + p[1]]), GRAY);
            let stride = of_views[i].len().div_ceil(MAX_ARROWS).max(1);
            let arrows = of_views[i].iter().step_by(stride).map(|o| {
                let at =
                    [corner[0] + scale * (o.px.col - first[0]), corner[1] + scale * (o.px.row - first[1])];
                let [d_col, d_row] = o.residual_px;
                [at, [at[0] + ENLARGEMENT * d_col, at[1] + ENLARGEMENT * d_row]]
            });
            drawing.lines(arrows, BLUE, 1.0);
            drawing.text([corner[0], corner[1] + h + 0.5 * TEXT_GAP], "start", name);
        }
        let [x, y] = [GAP, rows * (PANEL + TEXT_GAP + GAP) + GAP];
        drawing.lines([[[x, y], [x + ENLARGEMENT, y]]].into_iter(), BLUE, 1.0);
        drawing.text([x + ENLARGEMENT + 6.0, y], "start", "a residual of 1 px");
        drawing
    }

    fn histogram(&self) -> Chart {
        let bars = |column: usize| {
            let counts: Vec<f64> = self.report.histogram.iter().map(|c| c[column] as f64).collect();
            Chart::bars(&counts, 0.0, BIN_PX)
        };
        Chart {
            title: "Reprojection errors".into(),
            x: "error, px".into(),
            y: "observations".into(),
            lines: vec![("after".into(), bars(1)), ("before".into(), bars(0))],
        }
    }

    fn angles(&self) -> Chart {
        let mut bins = vec![0.0; ANGLE_BINS];
        for q in &self.quality {
            bins[((q.angle_deg / ANGLE_BIN_DEG) as usize).min(ANGLE_BINS - 1)] += 1.0;
        }
        Chart {
            title: "Largest angle between the rays of a point".into(),
            x: "angle, degrees".into(),
            y: "points".into(),
            lines: vec![("points".into(), Chart::bars(&bins, 0.0, ANGLE_BIN_DEG))],
        }
    }

    fn graph(&self) -> Drawing {
        let mut drawing = Drawing::new(SIDE, SIDE);
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
            let radius = 0.5 * SIDE - NAMES;
            [0.5 * SIDE + radius * sin, 0.5 * SIDE - radius * cos]
        };
        let most = shared.values().copied().max().unwrap_or(1) as f64;
        for ((a, b), count) in shared {
            let opacity = 0.1 + 0.9 * (count as f64 / most).sqrt();
            drawing.lines([[place(a), place(b)]].into_iter(), GRAY, opacity);
        }
        for view in 0..self.cameras.len() {
            drawing.circle(place(view), 5.0, BLUE, true);
        }
        let names: Vec<&str> = self.cameras.iter().map(|(name, _)| name.as_str()).collect();
        let named: Vec<_> =
            short_names(&names).into_iter().enumerate().map(|(view, name)| (place(view), name)).collect();
        drawing.labels(&named);
        drawing
    }
}
