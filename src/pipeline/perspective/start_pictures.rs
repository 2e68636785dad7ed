//! Pictures of what priors of depths gave training to start from, and masks of what no view sees.

use crate::io::{Grid2, ImageFile, RgbImage, WriteError, write_png_gray};
use crate::prior::{AlignedDepth, AlignedStart, PseudoView};
use crate::run_files::START;
use crate::stats::quantile;
use std::path::{Path, PathBuf};

/// Largest number of views that are drawn.
const MOST_VIEWS: usize = 8;
/// Correction, as the logarithm of a factor, that is shown in full colour.
const LARGEST_CORRECTION: f32 = 0.1;
/// Colour of holes.
const HOLE: [u8; 3] = [200, 40, 120];

/// Writes for each of the first views its aligned depths (near is light) and their correction (red: moved away, blue: moved
/// nearer), as `NAME.png`, and for each pseudo-view that was used its points, holes (purple) and filled depths, as `pseudo-N.png`.
pub(super) fn write_pictures(folder: &Path, start: &AlignedStart) -> Result<(), WriteError> {
    for (name, view) in start.views.iter().take(MOST_VIEWS) {
        of_view(view).write(&folder.join(format!("{name}.png")))?;
    }
    for (i, view) in start.pseudo_views.iter().enumerate().filter(|(_, view)| view.is_used) {
        of_pseudo_view(view).write(&folder.join(format!("pseudo-{i}.png")))?;
    }
    for view in &start.unseen {
        let bytes: Vec<u8> = view.pixels.iter().map(|unseen| if *unseen { 255 } else { 0 }).collect();
        let (width, height) = view.size;
        write_png_gray(&unseen_path(folder, &view.name), width, height, &bytes)?;
    }
    Ok(())
}

/// The mask of a view that was held back: 255 at pixels that show what no training view sees.
fn unseen_path(start: &Path, name: &str) -> PathBuf {
    start.join("unseen").join(format!("{name}.png"))
}

/// Whether each pixel of a view that was held back shows what no training view sees; none if the run does not know.
pub(super) fn read_unseen(run: &Path, name: &str) -> Option<Grid2> {
    ImageFile::open(&unseen_path(&run.join(START), name)).ok()?.read(1).ok()
}

fn of_view(view: &AlignedDepth) -> RgbImage {
    let shades = Shades::of_depths(&view.depth);
    let correction = |v: f32| {
        let share = (v / LARGEST_CORRECTION).clamp(-1.0, 1.0);
        let fade = (255.0 * (1.0 - share.abs())).round() as u8;
        if share > 0.0 { [255, fade, fade] } else { [fade, fade, 255] }
    };
    RgbImage::panels((view.depth.width, view.depth.height), |col, row| {
        [shades.of_depth(view.depth.at(col, row)), correction(view.correction.at(col, row))]
    })
}

fn of_pseudo_view(view: &PseudoView) -> RgbImage {
    let shades = Shades::of_depths(&view.depth);
    let width = view.depth.width;
    RgbImage::panels((width, view.depth.height), |col, row| {
        let i = row * width + col;
        let color = if view.hole[i] { HOLE } else { view.colors[i] };
        [color, shades.of_depth(view.depth.data[i])]
    })
}

/// Shades of gray for values that are larger where a surface is nearer; the nearest is light.
pub(super) struct Shades {
    low: f64,
    high: f64,
}

impl Shades {
    /// Shades between the outermost values but one in a hundred at each end.
    pub(super) fn of(nearness: impl Iterator<Item = f32>) -> Self {
        let values: Vec<f64> = nearness.map(f64::from).collect();
        let at = |share| quantile(values.clone(), share).unwrap_or_default();
        Self { low: at(0.01), high: at(0.99) }
    }

    fn of_depths(depth: &Grid2) -> Self {
        Self::of(depth.valid().map(f32::recip))
    }

    fn of_depth(&self, depth: f32) -> [u8; 3] {
        self.shade(depth.recip())
    }

    /// The shade of a value.
    pub(super) fn shade(&self, nearness: f32) -> [u8; 3] {
        if nearness.is_nan() {
            return RgbImage::NO_DATA;
        }
        let share = (f64::from(nearness) - self.low) / (self.high - self.low).max(1e-12);
        [(20.0 + 225.0 * share.clamp(0.0, 1.0)).round() as u8; 3]
    }
}
