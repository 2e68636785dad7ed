//! Predicted time and memory of a run of one area. The constants are fitted to measured runs; docs/performance.md has the
//! figures.

use crate::mvs::{FEW_VIEWS, MAX_VOLUME, cell_m};
use crate::splat::init::SPACING_M;

/// Number of splats at the start for each square of [`SPACING_M`], or of a cell if cells are larger: the most that was seen of large
/// tiles, whose memory must not exceed its prediction. Pixels of half a metre give smooth surfaces, of which four squares often
/// share a splat; larger pixels do not.
const SPLATS: f64 = 1.1;
const SPLATS_OF_COARSE_CELLS: f64 = 1.75;
/// Of few views, whose walls have more splats: three towns of five views with pixels of 0.5 m had 1.45 to 1.76.
const SPLATS_OF_FEW_VIEWS: f64 = 1.8;
/// Number of splats by which a training of [`GROWN_AFTER`] iterations grows, whatever its area: the gradient that asks for growth is
/// one in half image sides, so small images grow more densely. Three scenes of 18,000 to 23,000 m² grew by 44,000 to 74,000, JAX_068 by
/// 13,000 more than were pruned. Growth is fast at first: 20,000 to 34,000 after 800 iterations in six scenes.
const GROWN: f64 = 45_000.0;
const GROWN_AFTER: f64 = 4000.0;
/// Seconds of one core (Intel Xeon, AVX-512) for an iteration: of each splat, and of each pixel of one view. JAX_068 takes 168 ms with
/// 118,000 splats and 650,000 pixels, a tile of a million splats and 500,000 pixels 600 to 800 ms.
const SPLAT_S: f64 = 0.45e-6;
const PIXEL_S: f64 = 0.17e-6;
/// Seconds of one core for the matching of each pixel of every view.
const MATCHING_S: f64 = 8e-6;
/// Bytes of memory: of each splat in training, of each pixel of every view, and of each entry of the matching's cost
/// volume: three, and what is worked with beside them.
const SPLAT_BYTES: f64 = 2000.0;
const PIXEL_BYTES: f64 = 42.0;
const ENTRY_BYTES: f64 = 3.3;
/// Bytes of a splat while the surface is rendered: itself, its projection, and what sorts it.
const SPLAT_BYTES_OF_SURFACE: f64 = 400.0;
/// Of each cell of the surface model: bytes of memory while it is rendered, and seconds of one core. A tile of 7,775 x 7,601
/// cells took 57 bytes and 10 µs for each.
const CELL_BYTES: f64 = 60.0;
const CELL_S: f64 = 10e-6;
/// Memory without images and splats, megabytes.
const BASE_MB: f64 = 250.0;
/// Bytes in a megabyte.
const MEGABYTE: f64 = 1e6;

/// The size of a run of one area: a whole scene or a tile.
#[derive(Clone, Copy, Debug)]
pub struct RunSize {
    /// Area in which splats may live, square metres.
    pub area_m2: f64,
    /// Number of cells of the surface model.
    pub surface_cells: f64,
    /// Range of heights, metres.
    pub height_m: f64,
    /// Ground sampling distance, metres.
    pub gsd_m: f64,
    /// Number of training views.
    pub views: usize,
    /// Pixels of the windows of all views.
    pub pixels: usize,
    /// Iterations of training.
    pub iterations: u32,
}

/// The predicted cost of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cost {
    /// Seconds of one core.
    pub core_seconds: f64,
    /// Peak memory, megabytes.
    pub memory_mb: f64,
}

impl RunSize {
    /// The predicted cost.
    #[must_use]
    pub fn cost(&self) -> Cost {
        let cell = cell_m(self.gsd_m);
        let cells = self.area_m2 / cell.powi(2);
        let spacing = (SPACING_M / cell).round().max(1.0) * cell;
        let density = if self.views <= FEW_VIEWS {
            SPLATS_OF_FEW_VIEWS
        } else if spacing > cell {
            SPLATS
        } else {
            SPLATS_OF_COARSE_CELLS
        };
        let grown = GROWN * (f64::from(self.iterations) / GROWN_AFTER).sqrt();
        let splats = density * self.area_m2 / spacing.powi(2) + grown;
        let (all, views) = (self.pixels as f64, self.views.max(1) as f64);
        // A volume is over the cells of the map, or, of few views, over the pixels of one.
        let entries = cells.max(all / views) * (self.height_m / cell).max(1.0);
        let matching = ENTRY_BYTES * entries.min(MAX_VOLUME);
        // The surface is rendered after training.
        let training = matching.max(SPLAT_BYTES * splats) + PIXEL_BYTES * all;
        let surface = SPLAT_BYTES_OF_SURFACE * splats + CELL_BYTES * self.surface_cells;
        let iteration = SPLAT_S * splats + PIXEL_S * all / views;
        Cost {
            core_seconds: f64::from(self.iterations) * iteration
                + MATCHING_S * all
                + CELL_S * self.surface_cells,
            memory_mb: (BASE_MB + training.max(surface) / MEGABYTE).ceil(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_larger_tile_costs_more_and_a_volume_is_limited() {
        let tile = |side: f64, height_m: f64| {
            let pixels = (10.0 * (side / 0.5).powi(2)) as usize;
            let size = RunSize {
                area_m2: side * side,
                surface_cells: (side / 0.5).powi(2),
                height_m,
                gsd_m: 0.5,
                views: 10,
                pixels,
                iterations: 4000,
            };
            size.cost()
        };
        let (small, large) = (tile(300.0, 60.0), tile(600.0, 60.0));
        assert!(large.memory_mb > small.memory_mb && large.core_seconds > 3.5 * small.core_seconds);
        // 600 million entries at three bytes are the limit of a cost volume.
        let (high, higher) = (tile(700.0, 2000.0), tile(700.0, 4000.0));
        assert_eq!(high.memory_mb, higher.memory_mb);
        assert!(high.memory_mb > 2000.0);
    }

    #[test]
    fn memory_and_time_grow_with_the_cells_of_the_surface() {
        // data/town with cells of 2 cm: 3,466 MB were measured, and five minutes.
        let size = |cell: f64| RunSize {
            area_m2: 155.0 * 152.0,
            surface_cells: (155.5 / cell).round() * (152.0 / cell).round(),
            height_m: 40.0,
            gsd_m: 0.5,
            views: 3,
            pixels: 3 * 160 * 160,
            iterations: 30,
        };
        let (usual, fine) = (size(0.5).cost(), size(0.02).cost());
        assert!(usual.memory_mb < 450.0 && usual.core_seconds < 20.0, "{usual:?}");
        assert!((3466.0..4500.0).contains(&fine.memory_mb), "{fine:?}");
        assert!((400.0..800.0).contains(&fine.core_seconds), "{fine:?}");
    }
}
