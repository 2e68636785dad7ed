//! The views that take part in an adjustment.

use super::features::Keypoint;
use crate::scene::View;

/// A view that takes part in an adjustment.
pub(super) struct UsedView<'a> {
    pub(super) view: &'a View,
    pub(super) keypoints: &'a [Keypoint],
}

impl UsedView<'_> {
    /// Columns and rows.
    pub(super) fn size(&self) -> (usize, usize) {
        (self.view.width, self.view.height)
    }
}
