//! Pictures of what priors of depths gave training to start from.

use crate::io::{Grid2, RgbImage, WriteError};
use crate::prior::{AlignedDepth, AlignedStart, PseudoView};
use crate::stats::quantile;
use std::path::Path;

/// Gap between panels, pixels.
const GAP: usize = 8;
/// Largest number of views that are drawn.
const MOST_VIEWS: usize = 8;
/// Correction, as the logarithm of a factor, that is shown in full colour.
const LARGEST_CORRECTION: f32 = 0.1;
/// Colours of pixels without a depth, and of holes.
const NO_DATA: [u8; 3] = [160, 160, 160];
const HOLE: [u8; 3] = [200, 40, 120];

/// Writes for each of the first views its aligned depths (near is light) and their correction (red: moved away, blue: moved
/// nearer), as `NAME.png`, and for each pseudo-view that was used its points, holes (purple) and filled depths, as `pseudo-N.png`.
pub(super) fn write_pictures(folder: &Path, start: &AlignedStart) -> Result<(), WriteError> {
    for view in start.views.iter().take(MOST_VIEWS) {
        of_view(view).write(&folder.join(format!("{}.png", view.name)))?;
    }
    for (i, view) in start.pseudo_views.iter().enumerate().filter(|(_, view)| view.is_used) {
        of_pseudo_view(view).write(&folder.join(format!("pseudo-{i}.png")))?;
    }
    Ok(())
}

fn of_view(view: &AlignedDepth) -> RgbImage {
    let shades = Shades::of(&view.depth);
    let correction = |v: f32| {
        let share = (v / LARGEST_CORRECTION).clamp(-1.0, 1.0);
        let fade = (255.0 * (1.0 - share.abs())).round() as u8;
        if share > 0.0 { [255, fade, fade] } else { [fade, fade, 255] }
    };
    panels(&view.depth, &[&|i| shades.of_depth(view.depth.data[i]), &|i| correction(view.correction.data[i])])
}

fn of_pseudo_view(view: &PseudoView) -> RgbImage {
    let shades = Shades::of(&view.depth);
    let color = |i: usize| if view.hole[i] { HOLE } else { view.colors[i] };
    panels(&view.depth, &[&color, &|i| shades.of_depth(view.depth.data[i])])
}

/// Panels of the size of a map side by side, each by the colour of a pixel.
fn panels(size: &Grid2, colors: &[&dyn Fn(usize) -> [u8; 3]]) -> RgbImage {
    let (width, height) = (size.width, size.height);
    let mut out = RgbImage::white(colors.len() * (width + GAP) - GAP, height);
    for (panel, color) in colors.iter().enumerate() {
        for i in 0..width * height {
            out.set(panel * (width + GAP) + i % width, i / width, color(i));
        }
    }
    out
}

/// Shades of gray for inverse depths.
struct Shades {
    low: f64,
    high: f64,
}

impl Shades {
    fn of(depth: &Grid2) -> Self {
        let values = || depth.valid().map(|d| f64::from(d).recip()).collect::<Vec<_>>();
        let at = |share| quantile(values(), share).unwrap_or_default();
        Self { low: at(0.01), high: at(0.99) }
    }

    fn of_depth(&self, depth: f32) -> [u8; 3] {
        if depth.is_nan() {
            return NO_DATA;
        }
        let share = (f64::from(depth).recip() - self.low) / (self.high - self.low).max(1e-12);
        [(20.0 + 225.0 * share.clamp(0.0, 1.0)).round() as u8; 3]
    }
}
