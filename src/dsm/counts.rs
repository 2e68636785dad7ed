//! Numbers of cells of a surface model whose heights are confirmed, and filled in.

use super::Dsm;
use crate::io::{ImageFile, RasterError, Window};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Number of views that confirm a height: a height comes from the parallax between two views.
pub(super) const CONFIRMING_VIEWS: f32 = 2.0;
/// Band of the number of views in the file of the confidence, counted from 1.
pub const VIEWS_BAND: usize = 3;
/// Band of the expected error there, counted from 1.
pub const EXPECTED_ERROR_BAND: usize = 4;
/// Rows of a file that are read at a time.
const ROWS_AT_ONCE: usize = 256;

/// Whether a number of views of [`Confidence::views`](super::Confidence::views) confirms a height; NaN does not.
#[must_use]
pub fn is_confirmed(views: f32) -> bool {
    views >= CONFIRMING_VIEWS
}

/// Numbers of cells of a surface model with confirmed and with filled heights: `with_height` is the sum of `confirmed` and `filled`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct CellCounts {
    /// All cells of the grid.
    pub all: u64,
    /// Cells with a height.
    pub with_height: u64,
    /// Of these, cells that at least two views confirm; none where views are not counted.
    pub confirmed: Option<u64>,
    /// Of these, cells that fewer views confirm: their heights are filled in from the cells around them.
    pub filled: Option<u64>,
}

impl CellCounts {
    /// Counts the cells of two rasters of one size: heights, and numbers of views, which are NaN where they are not
    /// known.
    fn add(&mut self, heights: &[f32], views: &[f32]) {
        self.all += heights.len() as u64;
        for (_, views) in heights.iter().zip(views).filter(|(z, _)| !z.is_nan()) {
            self.with_height += 1;
            if !views.is_nan() {
                let counted = if is_confirmed(*views) { &mut self.confirmed } else { &mut self.filled };
                *counted.get_or_insert(0) += 1;
            }
        }
    }

    /// Both classes are known once one of them is.
    fn complete(mut self) -> Self {
        if self.confirmed.is_some() || self.filled.is_some() {
            self.confirmed.get_or_insert(0);
            self.filled.get_or_insert(0);
        }
        self
    }

    /// The counts of a surface model and its confidence as files; without a file of the same size, confirmed and filled
    /// cells are not known.
    ///
    /// # Errors
    /// [`RasterError`] if a file cannot be read.
    pub fn of_files(dsm: &Path, confidence: &Path) -> Result<Self, RasterError> {
        let dsm = ImageFile::open(dsm)?;
        let (width, height) = dsm.size();
        let confidence = confidence.exists().then(|| ImageFile::open(confidence)).transpose()?;
        let confidence = confidence.filter(|c| c.size() == dsm.size() && c.bands() >= VIEWS_BAND);
        let mut counts = Self::default();
        for row in (0..height).step_by(ROWS_AT_ONCE) {
            let window = Window { col: 0, row, width, height: ROWS_AT_ONCE.min(height - row) };
            let heights = dsm.read_window(1, window)?;
            let views = confidence.as_ref().map(|c| c.read_window(VIEWS_BAND, window)).transpose()?;
            let unknown = vec![f32::NAN; heights.data.len()];
            counts.add(&heights.data, views.as_ref().map_or(&unknown, |v| &v.data));
        }
        Ok(counts.complete())
    }

    /// Share of all cells, percent.
    fn percent(&self, cells: u64) -> f64 {
        100.0 * cells as f64 / self.all.max(1) as f64
    }

    /// The shares of the cells as a phrase, such as "78.8 % of the cells have a height: 46.1 % confirmed by two views or
    /// more, 32.7 % filled in".
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = format!("{:.1} % of the cells have a height", self.percent(self.with_height));
        if let (Some(confirmed), Some(filled)) = (self.confirmed, self.filled) {
            text += &format!(
                ": {:.1} % confirmed by two views or more, {:.1} % filled in",
                self.percent(confirmed),
                self.percent(filled)
            );
        }
        text
    }
}

impl Dsm {
    /// Numbers of cells with confirmed and with filled heights.
    #[must_use]
    pub fn counts(&self) -> CellCounts {
        let mut counts = CellCounts::default();
        counts.add(&self.height.data, &self.confidence.views.data);
        counts.complete()
    }

    /// Makes the cells nodata whose heights are not confirmed by two views.
    pub fn keep_confirmed(&mut self) {
        let Self { height, colors, confidence, .. } = self;
        for (i, _) in confidence.views.data.iter().enumerate().filter(|(_, views)| !is_confirmed(**views)) {
            height.data[i] = f32::NAN;
            colors.iter_mut().for_each(|c| c.data[i] = f32::NAN);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsm::render::tests::flat_surface;
    use crate::io::{Grid2, VerticalReference};

    #[test]
    fn cells_with_a_height_are_confirmed_or_filled_in_the_model_and_in_its_files() {
        let (mut surface, _) = flat_surface(10, 4);
        assert_eq!(surface.counts(), CellCounts { all: 40, with_height: 40, ..CellCounts::default() });
        surface.height.data[0] = f32::NAN;
        surface.confidence.views = Grid2::from_fn(10, 4, |col, _| [0.0, 1.0, 2.0, 1.5, 3.0][col / 2]);
        let counts = CellCounts { all: 40, with_height: 39, confirmed: Some(16), filled: Some(23) };
        assert_eq!(surface.counts(), counts);
        let dir = tempfile::tempdir().unwrap();
        let [dsm, confidence] = ["dsm.tif", "confidence.tif"].map(|name| dir.path().join(name));
        surface.write_dsm(&dsm, &surface.heights_above(&VerticalReference::Ellipsoid)).unwrap();
        assert_eq!(CellCounts::of_files(&dsm, &confidence).unwrap().confirmed, None);
        surface.write_confidence(&confidence).unwrap();
        assert_eq!(CellCounts::of_files(&dsm, &confidence).unwrap(), counts);
        let expected =
            "97.5 % of the cells have a height: 40.0 % confirmed by two views or more, 57.5 % filled in";
        assert_eq!(counts.text(), expected);

        surface.keep_confirmed();
        let kept = CellCounts { with_height: 16, filled: Some(0), ..counts };
        assert_eq!(surface.counts(), kept);
        assert!(surface.colors[1].at(0, 1).is_nan() && !surface.colors[1].at(9, 1).is_nan());
    }
}
