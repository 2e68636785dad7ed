//! The surface from two to five views, by stereo matching in the images.
//!
//! The plane sweep on the map grid compares the views where they would see a cell at an altitude. With few views that
//! lets one pixel explain several cells, and false heights hide the ground from the only pair that sees it. Here every
//! pixel of a view has one altitude: a cost volume along its rays (`volume`), semi-global matching and the check that
//! another view's map has the same point (`maps`; Hirschmüller 2008, §2.3 and §2.6). The maps become one surface by
//! drawing them as meshes and taking the median of the views in every cell (`fuse`). What no two maps agree on is filled
//! from around and marked: its score is 0.

mod fuse;
mod maps;
mod rays;
mod volume;

use super::correlation::MatchImage;
use super::{MAX_VOLUME, MatchedSurface, PlaneSweep};
use crate::io::{Grid2, Window};
use crate::progress::{Event, Interrupted, Progress};
use maps::AltitudeMap;
use rays::Rays;
use volume::CostVolume;

/// Views up to which the images are matched instead of the map grid's cells.
pub const FEW_VIEWS: usize = 5;
/// Distance of the planes that are tried, pixels of the view that sees it largest.
const STEP_PX: f64 = 0.5;
/// A step between surfaces: so many cells, which a slope of 70° climbs from one to the next, or so many pixels' worth of
/// altitude, which is more than noise.
const STEP_CELLS: f64 = 3.0;
const STEP_OF_PX: f64 = 0.7;
/// Rows beyond those that are kept of a strip, from which the costs along its paths come.
const STRIP_MARGIN: usize = 64;

/// A view and those that it is matched with.
struct Partners {
    view: usize,
    others: Vec<usize>,
    /// Altitude that moves a point by a pixel of the view where it moves it farthest, metres.
    px_m: f64,
    /// Difference of altitude between neighbouring pixels from which on they are of two surfaces, metres.
    step_m: f32,
}

impl PlaneSweep {
    /// Matches the few views' images.
    pub(super) fn match_images(&self, progress: &dyn Progress) -> Result<MatchedSurface, Interrupted> {
        progress.event(Event::Started { stage: "matching the surface", total: self.images.len() as u64 });
        let partners = self.partners();
        let mut maps = Vec::with_capacity(partners.len());
        for (done, partners) in (1..).zip(&partners) {
            progress.check()?;
            maps.push(self.altitude_map(partners, self.strip_rows(partners)));
            progress.event(Event::Advanced { done, status: String::new() });
        }
        let confirmed = maps::confirmed(&self.images, &maps, &partners);
        let surface = fuse::surface(self, &partners, &confirmed);
        progress.event(Event::Finished);
        Ok(surface)
    }

    /// The views that have a partner.
    fn partners(&self) -> Vec<Partners> {
        let is_pair = |i: usize, j: usize| self.pairs.contains(&(i.min(j), i.max(j)));
        let of = |view: usize| {
            let others: Vec<usize> =
                (0..self.images.len()).filter(|j| *j != view && is_pair(view, *j)).collect();
            let camera = &self.images[view].camera;
            let all = others.iter().map(|j| rays::metres_per_pixel(camera, &self.images[*j].camera));
            let px_m = all.reduce(f64::min)?;
            let step_m = (STEP_CELLS * self.grid.cell).max(STEP_OF_PX * px_m) as f32;
            Some(Partners { view, others, px_m, step_m })
        };
        (0..self.images.len()).filter_map(of).collect()
    }

    /// Rows of a view that are matched at a time: as many as the memory for a volume holds.
    fn strip_rows(&self, partners: &Partners) -> usize {
        let planes = (self.stack.height_m() / (STEP_PX * partners.px_m)).ceil() + 1.0;
        let rows = MAX_VOLUME / (self.images[partners.view].gray.width as f64 * planes);
        (rows as usize).saturating_sub(2 * STRIP_MARGIN).max(STRIP_MARGIN)
    }

    /// The map of one view, matched strip by strip of so many rows.
    fn altitude_map(&self, partners: &Partners, rows: usize) -> AltitudeMap {
        let reference = &self.images[partners.view];
        let others: Vec<&MatchImage> = partners.others.iter().map(|j| &self.images[*j]).collect();
        let step_m = STEP_PX * partners.px_m;
        let Grid2 { width, height, .. } = reference.gray;
        let mut map = AltitudeMap::unknown(width, height);
        for first in (0..height).step_by(rows) {
            let last = (first + rows).min(height);
            let (from, to) = (first.saturating_sub(STRIP_MARGIN), (last + STRIP_MARGIN).min(height));
            let strip = reference.cropped(Window { col: 0, row: from, width, height: to - from });
            let rays = Rays::new(self, &strip, &others, step_m);
            let volume = CostVolume::new(&strip, &others, &rays);
            map.take_rows(first..last, &AltitudeMap::pick(&strip, &rays, &volume), from);
        }
        map
    }

    /// Altitude of the ground at a place of the site, as the stack of planes has it.
    fn ground_at(&self, x: f64, y: f64) -> f64 {
        let [east, north, _] = self.site.origin.xyz();
        let ground: &Grid2 = &self.stack.ground;
        let col = (x + east - self.grid.west) / self.grid.cell - 0.5;
        let row = (self.grid.north - y - north) / self.grid.cell - 0.5;
        let within = |v: f64, n: usize| v.clamp(0.0, n as f64 - 1.0);
        f64::from(ground.bilinear(within(col, ground.width), within(row, ground.height)))
    }
}

#[cfg(test)]
mod tests;
