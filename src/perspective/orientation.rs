//! How the pixels of a photograph are stored, by its EXIF.
//!
//! Cameras of some programs are of the photograph as stored, those of others of the photograph as it is displayed. They are
//! told apart by their sizes where rows and columns are exchanged; only such orientations are looked at.

use crate::io::{Grid2, ImageFile};

/// An orientation in which the displayed columns are stored as rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Orientation {
    /// Whether the displayed rows go from the last stored column to the first one.
    from_last_column: bool,
    /// Whether the displayed columns go from the last stored row to the first one.
    from_last_row: bool,
}

impl Orientation {
    /// The orientation that the EXIF of a photograph states, if it exchanges rows and columns (values 5 to 8 of EXIF 2.3, 4.6.4).
    pub(super) fn of(file: &ImageFile) -> Option<Self> {
        Self::from_exif(file.metadata("EXIF_Orientation", "")?.trim())
    }

    fn from_exif(value: &str) -> Option<Self> {
        let (from_last_column, from_last_row) = match value {
            "5" => (false, false),
            "6" => (false, true),
            "7" => (true, true),
            "8" => (true, false),
            _ => return None,
        };
        Some(Self { from_last_column, from_last_row })
    }

    /// The image as displayed.
    pub(super) fn displayed(self, stored: &Grid2) -> Grid2 {
        let flip = |is_flipped: bool, k: usize, n: usize| if is_flipped { n - 1 - k } else { k };
        Grid2::from_fn(stored.height, stored.width, |col, row| {
            stored.at(
                flip(self.from_last_column, row, stored.width),
                flip(self.from_last_row, col, stored.height),
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stored_pixels_are_displayed_as_exif_says() {
        let stored = Grid2 { width: 3, height: 2, data: vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0] };
        let shown = |value: &str| Orientation::from_exif(value).map(|o| o.displayed(&stored).data);
        assert_eq!(shown("5"), Some(vec![1.0, 4.0, 2.0, 5.0, 3.0, 6.0]));
        // Turned clockwise: the first stored row becomes the last column.
        assert_eq!(shown("6"), Some(vec![4.0, 1.0, 5.0, 2.0, 6.0, 3.0]));
        assert_eq!(shown("7"), Some(vec![6.0, 3.0, 5.0, 2.0, 4.0, 1.0]));
        assert_eq!(shown("8"), Some(vec![3.0, 6.0, 2.0, 5.0, 1.0, 4.0]));
        assert!(shown("1").is_none() && shown("3").is_none() && shown("").is_none());
    }
}
