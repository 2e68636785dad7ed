//! Views cropped to an area of interest.

use super::aoi::extent;
use super::{Aoi, Scene, SceneError, View, require_tiled_images};
use crate::frame::Pixel;
use crate::io::Window;

/// Pixels added on each side of the part of an image that shows the area, because keypoints and matching windows at its
/// border extend beyond it.
const MARGIN_PX: f64 = 48.0;

impl Scene {
    /// Crops every view to the part of its image that may show an area between two heights. Views that do not see the area
    /// are left out with a warning.
    ///
    /// # Errors
    /// [`SceneError::AreaNotSeen`] if no view sees it, [`SceneError::Striped`] as [`require_tiled_images`] says.
    pub(crate) fn crop(&mut self, aoi: Aoi, heights: (f64, f64)) -> Result<(), SceneError> {
        let (mut kept, mut without) = (Vec::new(), Vec::new());
        for view in &self.views {
            match view.window_showing(&aoi, heights) {
                Some(window) => kept.push((view, window)),
                None => without.push(view.name.clone()),
            }
        }
        if kept.is_empty() {
            let height = 0.5 * (heights.0 + heights.1);
            let footprint = self.views.first().map_or_else(String::new, |v| v.place(height));
            let sees = |aoi: &Aoi| self.views.iter().any(|view| view.window_showing(aoi, heights).is_some());
            let is_swapped = aoi.swapped().is_some_and(|swapped| sees(&swapped));
            return Err(SceneError::AreaNotSeen { area: aoi.place(), footprint, is_swapped });
        }
        if !without.is_empty() {
            self.warnings.push(format!("left out, because they do not see the area: {}", without.join(", ")));
        }
        require_tiled_images(kept.iter().copied())?;
        self.views = kept.into_iter().map(|(view, window)| view.cropped(window)).collect();
        self.aoi = Some(aoi);
        Ok(())
    }
}

impl View {
    /// The view restricted to a window of its used part.
    #[must_use]
    pub fn cropped(&self, window: Window) -> Self {
        let mut view = self.clone();
        view.rpc = self.rpc.cropped(window.col, window.row);
        (view.width, view.height) = (window.width, window.height);
        let used = self.used_window();
        view.window = Some(Window { col: used.col + window.col, row: used.row + window.row, ..window });
        view
    }

    /// The part of the used part of the image that may show an area between two ellipsoidal heights in metres, with a
    /// margin; `None` if no part does.
    #[must_use]
    pub fn window_showing(&self, aoi: &Aoi, (low, high): (f64, f64)) -> Option<Window> {
        let seen = aoi.outline().flat_map(|p| [low, high].map(|h| self.rpc.project(p.at_height(h))));
        let seen: Vec<Pixel<_>> = seen.filter(|px| px.col.is_finite() && px.row.is_finite()).collect();
        let (a, b) = extent(&seen.iter().map(|px| [px.col, px.row]).collect::<Vec<_>>());
        let span = |k: usize, size: usize| {
            // An image that overlaps with the margin alone does not show the area.
            if !(a[k] <= size as f64 && b[k] >= 0.0) {
                return None;
            }
            let from = (a[k] - MARGIN_PX).floor().max(0.0) as usize;
            let to = ((b[k] + MARGIN_PX).ceil() as usize).min(size);
            (to > from + 1).then_some((from, to - from))
        };
        let ((col, width), (row, height)) = (span(0, self.width)?, span(1, self.height)?);
        Some(Window { col, row, width, height })
    }
}
