//! Reference views: those whose pixels get values.

/// A view whose pixels get values, altitudes or inverse depths, and the source views that it is matched with.
#[derive(Clone, Debug)]
pub(super) struct ReferenceView {
    /// Index of the view.
    pub view: usize,
    /// Indices of the views that it is matched with.
    pub sources: Vec<usize>,
    /// Difference of the value that moves a point by one pixel, in the source view where it moves farthest.
    pub value_per_px: f64,
    /// Difference of the value between neighbouring pixels above which they lie on two surfaces.
    pub discontinuity: f32,
}
