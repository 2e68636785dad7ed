//! Heights above a vertical reference.

use super::Dsm;
use crate::frame::{Point, SiteGrid};
use crate::io::{Grid2, VerticalReference, color_style};

/// Distance in cells between the nodes at which undulations are computed; they are smooth and are interpolated between
/// the nodes.
const GEOID_STEP: usize = 64;
/// Colour map viridis of Matplotlib, from low to high.
const HEIGHT_COLORS: [[u8; 3]; 5] =
    [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
/// Fraction of the cells that lie below the lowest and above the highest colour.
const STYLE_TAIL: f64 = 0.02;

/// Heights of the cells of a DSM in metres above a vertical reference; NaN where they are not known.
pub struct Heights<'a> {
    /// Heights in metres.
    pub raster: Grid2,
    /// The vertical reference.
    pub above: &'a VerticalReference,
}

impl Dsm {
    /// Converts the ellipsoidal heights of the DSM to heights above a vertical reference; NaN also outside of the geoid grid.
    #[must_use]
    pub fn heights_above<'a>(&self, above: &'a VerticalReference) -> Heights<'a> {
        let VerticalReference::Geoid { .. } = above else {
            return Heights { raster: self.height.clone(), above };
        };
        let place = SiteGrid { epsg: self.grid.epsg, origin: Point::new(0.0, 0.0, 0.0) };
        let nodes = [self.grid.width, self.grid.height].map(|n| n.div_ceil(GEOID_STEP) + 1);
        let undulation = Grid2::from_fn(nodes[0], nodes[1], |col, row| {
            let p = place.geodetic_from_utm(self.grid.cell_center(col * GEOID_STEP, row * GEOID_STEP));
            above.undulation_m(p.lon_deg(), p.lat_deg()) as f32
        });
        let step = GEOID_STEP as f64;
        let raster = Grid2::from_fn(self.grid.width, self.grid.height, |col, row| {
            self.height.at(col, row) - undulation.bilinear(col as f64 / step, row as f64 / step)
        });
        Heights { raster, above }
    }
}

/// The colours of heights: from the height below which 2 % of the cells lie to that above which 2 % do, over viridis.
#[derive(Clone, Copy, Debug)]
pub struct HeightScale {
    /// Height of the first colour, metres.
    pub low: f32,
    /// Height of the last colour, metres.
    pub high: f32,
}

impl HeightScale {
    /// The colours at equal steps of height.
    pub const COLORS: [[u8; 3]; 5] = HEIGHT_COLORS;

    /// The scale of heights in metres.
    #[must_use]
    pub fn of(heights: &Grid2) -> Self {
        let mut sorted: Vec<f32> = heights.valid().collect();
        sorted.sort_unstable_by(f32::total_cmp);
        let at = |share: f64| sorted.get((share * sorted.len() as f64) as usize).copied().unwrap_or(0.0);
        Self { low: at(STYLE_TAIL), high: at(1.0 - STYLE_TAIL) }
    }

    /// The colour of a height in metres.
    #[must_use]
    pub fn color(&self, height_m: f32) -> [u8; 3] {
        let last = HEIGHT_COLORS.len() - 1;
        let share = (height_m - self.low) / (self.high - self.low).max(f32::MIN_POSITIVE);
        let place = share.clamp(0.0, 1.0) * last as f32;
        let index = (place as usize).min(last - 1);
        let t = place - index as f32;
        let between = |a: u8, b: u8| (f32::from(a) + (f32::from(b) - f32::from(a)) * t).round() as u8;
        std::array::from_fn(|k| between(HEIGHT_COLORS[index][k], HEIGHT_COLORS[index + 1][k]))
    }
}

/// A QGIS style that colours heights in metres from low to high.
#[must_use]
pub fn height_style(heights: &Grid2) -> String {
    let HeightScale { low, high } = HeightScale::of(heights);
    let step = (high - low) / (HEIGHT_COLORS.len() - 1) as f32;
    let value = |i: usize| (10.0 * (low + step * i as f32)).round() / 10.0;
    let stops = HEIGHT_COLORS.iter().enumerate().map(|(i, color)| (value(i), *color));
    color_style(&stops.collect::<Vec<_>>())
}
