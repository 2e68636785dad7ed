//! The surface by matching: a plane sweep through the training views, on a map grid.
//!
//! Every cell tries the altitudes of a stack of surfaces parallel to the ground. At each, the views are sampled
//! where they would see the cell and compared pair by pair (`correlation`); semi-global matching picks altitudes
//! that agree with their neighbours' (`semiglobal`). A second pass knows from the first what hides a cell from a view,
//! which brings streets between high walls to light, and what the cells visibility like (`visibility`). It starts training near the
//! surface, and sharpens what training found (`settle` has the last word). Two to five views are matched in another way,
//! image by image (`stereo`).

mod correlation;
mod error;
mod file;
mod ground;
mod occlusion;
mod visibility;
mod semiglobal;
mod postfilter;
mod stereo;

pub use error::MatchError;
pub use ground::{Ground, ground_plane};
pub use occlusion::{OCCLUSION_TOLERANCE_M, occlusion_height};
pub use stereo::FEW_VIEWS;

use crate::affine::{SiteScene, TrainingView, median_pixel_m};
use crate::frame::{Point, Site, SiteGrid};
use crate::io::{Grid2, MapGrid};
use crate::progress::{Event, Interrupted, Progress};
use crate::scene::views_needed;
use correlation::{CostVolume, MatchImage};
use rayon::prelude::*;
use semiglobal::{Jump, Steps};
use visibility::Visibility;

/// Passes; from the second on, what is hidden counts no more.
const PASSES: u64 = 2;
/// Side of a DSM's cells, metres, unless asked otherwise; no finer ones are matched.
pub const DSM_CELL_M: f64 = 0.5;
/// Cells times altitudes that are held in memory, three bytes each; beyond, cells are coarser.
const MAX_VOLUME: f64 = 600e6;
/// Ground displacement per metre of height between the views of a pair: less is blind, more sees other walls.
pub const PARALLAX: std::ops::Range<f64> = 0.08..0.9;
/// The parallax that is preferred, and what a deviation weighs against suns that differ.
const BEST_PARALLAX: f64 = 0.35;
const PARALLAX_WEIGHT: f64 = 0.1;
/// Views from which on training betters the surface that they were matched to: two or three agree on false splats as well.
const REFINED_FROM_VIEWS: usize = 4;
/// Pairs a view, on average.
const PAIRS_A_VIEW: usize = 4;
/// Of the views that see a cell at some altitude, the share that must see its ground; and altitudes that are tried.
const GROUNDED_SHARE: f64 = 0.55;
const COVER_PLANES: usize = 8;
/// How far from a cell, and how far above or below the first surface there, a prior may lie, metres; and of the views
/// that see the first surface of a cell the share that must see the prior.
const NEARBY_M: f64 = 5.0;
const IN_SIGHT: f64 = 0.8;
/// Score from which a cell is confident to hide what lies behind it.
const CONFIDENT: f32 = 0.4;
/// A plain cell bridges what views agree on if of the cells within this distance, metres, this share is confident and no
/// further up or down, metres.
const SUPPORT_REACH_M: f64 = 10.0;
const SUPPORT: f32 = 0.01;
const SAME_ROOF_M: f32 = 1.0;
/// Cost of a step of one plane between neighbours, of the 255 for no correlation.
const STEP: u16 = 30;
/// Cost of a jump between neighbours, of the 255 for no correlation: high, so that plain roofs and streets hold
/// together; lower near a prior, which does that, so that trees stand out.
const JUMP: u16 = 200;
const JUMP_NEAR: u16 = 60;
/// Cost, of the 255 for no correlation, that a prior adds far from it.
const PRIOR_COST: f32 = 90.0;
/// Distance from the prior at which half of that is added, metres.
const PRIOR_REACH_M: f32 = 3.0;
/// Share of that cost at the first surface, where it differs from the prior.
const RETURN_COST: f32 = 0.5;
/// Share of it at the prior where training had nothing to hold on to.
const DRIFT_COST: f32 = 0.25;

/// What is swept.
pub struct PlaneSweep {
    site: SiteGrid,
    grid: MapGrid,
    images: Vec<MatchImage>,
    pairs: Vec<(usize, usize)>,
    stack: PlaneStack,
    /// Of every cell, row by row.
    covers: Vec<Cover>,
}

/// How many views have a cell within the valid pixels of their images.
#[derive(Clone, Copy)]
struct Cover {
    /// At altitudes from the stack's lowest to its highest.
    planes: [f32; COVER_PLANES],
    /// At the best of them and of the ground, at least one.
    most: f32,
    /// Whether the ground is seen by most of the views that would see something high above it.
    ///
    /// Around the area views visibility in under things that are not there: only those would be matched.
    is_grounded: bool,
}

impl Cover {
    /// From the numbers of views; `needed` is how many must see the ground.
    fn new(ground: usize, planes: [usize; COVER_PLANES], needed: usize) -> Self {
        let most = planes.into_iter().fold(ground, usize::max);
        let is_grounded = ground >= needed && ground as f64 >= GROUNDED_SHARE * most as f64;
        Self { planes: planes.map(|n| n as f32), most: most.max(1) as f32, is_grounded }
    }

    /// Share of the views at the best altitude that have the cell `part` of the way up the stack.
    fn share(&self, part: f32) -> f32 {
        let at = part * (COVER_PLANES - 1) as f32;
        let below = (at as usize).min(COVER_PLANES - 2);
        let [low, high] = [self.planes[below], self.planes[below + 1]];
        (low + (high - low) * (at - below as f32)) / self.most
    }
}

/// Surfaces parallel to the ground: plane `k` lies `low + k * step` metres above it.
struct PlaneStack {
    /// Altitude of the ground in every cell, site metres.
    ground: Grid2,
    low: f32,
    step: f32,
    planes: usize,
}

impl PlaneStack {
    /// From the lowest plane to the highest, metres.
    fn height_m(&self) -> f64 {
        f64::from(self.step) * (self.planes - 1) as f64
    }

    fn altitude(&self, cell: usize, plane: f32) -> f32 {
        self.ground.data[cell] + self.low + self.step * plane
    }
}

/// Altitudes on a map grid.
#[derive(Clone, Debug)]
pub struct MatchedSurface {
    /// The site its altitudes are of.
    pub site: SiteGrid,
    /// The grid.
    pub grid: MapGrid,
    /// Altitudes in metres above the site's origin; NaN where no pair of views sees the cell.
    pub altitude: Grid2,
    /// How well the views agree there, 0 to 1: the mean cube of the pairs' correlations, less where few images reach. 0 where
    /// an altitude was not matched but filled from around.
    pub score: Grid2,
    /// How far training is to be held to it: 1 where it bridges something plain from what views agree on, else down to 0.
    pub prior_weight: Grid2,
}

impl MatchedSurface {
    /// Centre of a cell on the surface; its altitude is NaN where there is none.
    #[must_use]
    pub fn point(&self, col: usize, row: usize) -> Point<Site> {
        let p = self.site.site_from_utm(self.grid.cell_center(col, row));
        Point::new(p.x(), p.y(), f64::from(self.altitude.at(col, row)))
    }
}

impl PlaneSweep {
    /// A sweep of a set-up's area at the heights of its sparse points; none without these or if no two views make a
    /// pair.
    #[must_use]
    pub fn new(setup: &SiteScene, views: &[TrainingView], sparse: &[Point<Site>]) -> Option<Self> {
        let pairs = pairs(views);
        if pairs.is_empty() {
            return None;
        }
        let images: Vec<MatchImage> = views.iter().map(MatchImage::new).collect();
        let ground = Ground::new(sparse, setup.area);
        let (low, high) = ground.heights_above(sparse)?;
        let (west, south, east, north) = setup.area;
        let [x, y, _] = setup.site.origin.xyz();
        let cell = cell_m(median_pixel_m(views));
        let volume = (east - west) * (north - south) * (high - low) / cell.powi(3);
        let cell = cell * (volume / MAX_VOLUME).cbrt().max(1.0);
        let grid = MapGrid::covering(setup.site.epsg, (x + west, y + south, x + east, y + north), cell);
        let ground = Grid2::from_fn(grid.width, grid.height, |col, row| {
            let p = setup.site.site_from_utm(grid.cell_center(col, row));
            ground.altitude(p.x(), p.y()) as f32
        });
        let planes = ((high - low) / cell).ceil() as usize + 2;
        let stack = PlaneStack { ground, low: low as f32, step: cell as f32, planes };
        let mut sweep = Self { site: setup.site, grid, images, pairs, stack, covers: Vec::new() };
        sweep.covers = (0..grid.width * grid.height).into_par_iter().map(|i| sweep.cover(i)).collect();
        Some(sweep)
    }

    fn cover(&self, cell: usize) -> Cover {
        let (col, row) = (cell % self.grid.width, cell / self.grid.width);
        let p = self.site.site_from_utm(self.grid.cell_center(col, row));
        let views = |z: f32| self.images.iter().filter(|i| i.has(p.at_height(f64::from(z)))).count();
        let step = (self.stack.planes - 1) as f32 / (COVER_PLANES - 1) as f32;
        let planes = std::array::from_fn(|k| views(self.stack.altitude(cell, k as f32 * step)));
        Cover::new(views(self.stack.ground.data[cell]), planes, views_needed(self.images.len()))
    }

    /// The grid that is swept.
    #[must_use]
    pub fn grid(&self) -> MapGrid {
        self.grid
    }

    /// Sweeps, the second time knowing what hides what.
    ///
    /// # Errors
    /// [`Interrupted`].
    pub fn run(&self, progress: &dyn Progress) -> Result<MatchedSurface, Interrupted> {
        if self.images.len() <= FEW_VIEWS {
            return self.match_images(progress);
        }
        progress.event(Event::Started { stage: "matching the surface", total: PASSES });
        let mut surface = self.pick(&CostVolume::correlate(self, None), JUMP);
        for pass in 1..PASSES {
            progress.event(Event::Advanced { done: pass, status: String::new() });
            progress.check()?;
            let visibility = Visibility::new(self, &surface.altitude, &surface.confident());
            surface = self.pick(&CostVolume::correlate(self, Some(&visibility)), JUMP);
        }
        surface.prior_weight = self.prior_weight(&surface);
        progress.event(Event::Finished);
        Ok(surface)
    }

    /// Whether the surface is to be matched once more after training ([`PlaneSweep::refine`]), or is the best there is.
    #[must_use]
    pub fn is_refined_by_training(&self) -> bool {
        self.images.len() >= REFINED_FROM_VIEWS
    }

    /// [`MatchedSurface::prior_weight`] of a surface.
    fn prior_weight(&self, surface: &MatchedSurface) -> Grid2 {
        let confident = surface.confident();
        let visibility = Visibility::new(self, &surface.altitude, &confident);
        let around = (SUPPORT_REACH_M / self.grid.cell) as i64;
        let of = |col: usize, row: usize| {
            let plain = 1.0 - visibility.texture(row * self.grid.width + col);
            if plain.is_nan() || plain == 0.0 {
                return 0.0;
            }
            let z = surface.altitude.at(col, row);
            let near = |center: usize| (center as i64 - around..=center as i64 + around).step_by(2);
            let cells = near(row).flat_map(|r| near(col).map(move |c| (c, r)));
            let like = cells.filter(|(c, r)| (confident.get(*c, *r) - z).abs() < SAME_ROOF_M).count();
            let share = like as f32 / near(0).count().pow(2) as f32;
            plain * (share / SUPPORT).min(1.0)
        };
        Grid2::from_rows(self.grid.width, self.grid.height, |row, line| {
            line.iter_mut().enumerate().for_each(|(col, weight)| *weight = of(col, row));
        })
    }

    /// Sweeps again, drawn to `prior`: altitudes on its grid, site metres, NaN where unknown.
    ///
    /// Where views agree better there it returns to the `first` surface: training closes narrow gaps that were
    /// open, and finds trees that were lost. What is found is postfiltered (`settle`), with the prior once more.
    #[must_use]
    pub fn refine(&self, prior: &Grid2, first: &MatchedSurface) -> MatchedSurface {
        let (hiding, prior) = (first.confident(), &self.plausible_prior(prior, &first.altitude));
        let refined_once = |surface: &Grid2| {
            let visibility = Visibility::new(self, surface, &hiding);
            let mut volume = CostVolume::correlate(self, Some(&visibility));
            volume.add_prior(prior, &first.altitude, &self.stack, &visibility);
            self.pick(&volume, JUMP_NEAR)
        };
        // The second time what the views show of the cells lies where it belongs.
        let mut refined = refined_once(&refined_once(prior).altitude).postfiltered(prior);
        // What no two of few views agreed on at first is no more than filled.
        for (score, first) in refined.score.data.iter_mut().zip(&first.score.data) {
            if *first == 0.0 {
                *score = 0.0;
            }
        }
        refined
    }

    /// `prior` where it lies among the altitudes of the `first` surface nearby and is as much in sight: over margins and
    /// what is plain, splats may float where no view objects.
    fn plausible_prior(&self, prior: &Grid2, first: &Grid2) -> Grid2 {
        let around = (NEARBY_M / self.grid.cell).ceil() as i64;
        let of = |col: usize, row: usize| {
            let (z, below) = (prior.at(col, row), first.at(col, row));
            let p = self.site.site_from_utm(self.grid.cell_center(col, row));
            let views =
                |z: f32| self.images.iter().filter(|i| i.has(p.at_height(f64::from(z)))).count() as f64;
            let near = |center: usize| center as i64 - around..=center as i64 + around;
            let cells = near(row).flat_map(|r| near(col).map(move |c| first.get(c, r)));
            let (low, high) =
                cells.fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), z| (l.min(z), h.max(z)));
            let is_among = (low - NEARBY_M as f32..=high + NEARBY_M as f32).contains(&z);
            if below.is_nan() || is_among && views(z) >= IN_SIGHT * views(below) { z } else { f32::NAN }
        };
        Grid2::from_rows(prior.width, prior.height, |row, line| {
            line.iter_mut().enumerate().for_each(|(col, z)| *z = of(col, row));
        })
    }

    /// The cheapest altitude of every cell, between planes by a parabola.
    fn pick(&self, volume: &CostVolume, jump: u16) -> MatchedSurface {
        let planes = self.stack.planes;
        let steps = Steps { step: STEP, jump: Jump::Constant(jump) };
        let sums = semiglobal::aggregate(volume.costs(), self.grid.width, planes, steps);
        let best = |cell: usize| {
            let costs = volume.cell(cell);
            let sums = &sums[cell * planes..(cell + 1) * planes];
            let k = (0..planes).min_by_key(|k| sums[*k]).unwrap_or(0);
            if costs[k] == CostVolume::UNSEEN || !self.covers[cell].is_grounded {
                return (f32::NAN, 0.0);
            }
            let mut between = 0.0;
            if k > 0 && k + 1 < planes {
                let [a, b, c] = [sums[k - 1], sums[k], sums[k + 1]].map(f32::from);
                between = 0.5 * (a - c) / (a - 2.0 * b + c).max(1.0);
            }
            (self.stack.altitude(cell, k as f32 + between), 1.0 - f32::from(costs[k]) / 255.0)
        };
        let (width, height) = (self.grid.width, self.grid.height);
        let picked: Vec<(f32, f32)> = (0..width * height).into_par_iter().map(best).collect();
        let (altitude, score) = picked.into_iter().unzip();
        let plane = |data: Vec<f32>| Grid2 { width, height, data };
        let prior_weight = Grid2::filled(width, height, 0.0);
        MatchedSurface {
            site: self.site,
            grid: self.grid,
            altitude: plane(altitude),
            score: plane(score),
            prior_weight,
        }
    }
}

impl MatchedSurface {
    /// The altitudes, NaN where they are not confident.
    fn confident(&self) -> Grid2 {
        let mut out = self.altitude.clone();
        for (z, score) in out.data.iter_mut().zip(&self.score.data) {
            if *score < CONFIDENT {
                *z = f32::NAN;
            }
        }
        out
    }
}

/// Side of the cells for pixels so wide: the same, to a tenth of a metre, so that pixels of about half a metre make the
/// DSM's own cells and none of them is taken twice.
fn cell_m(pixel_m: f64) -> f64 {
    ((10.0 * pixel_m).round() / 10.0).max(DSM_CELL_M)
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// The parallax of two views: ground displacement per metre of height between them.
#[must_use]
pub fn parallax(a: &TrainingView, b: &TrainingView) -> f64 {
    distance(a.camera.line_of_sight_slope(), b.camera.line_of_sight_slope())
}

/// Pairs of views with enough parallax, those under the most similar suns first: shadows lie alike.
fn pairs(views: &[TrainingView]) -> Vec<(usize, usize)> {
    let shadow = |i: usize| views[i].sun_shear.map(|s| views[i].camera.sheared(s).line_of_sight_slope());
    let mut rated = Vec::new();
    for i in 0..views.len() {
        for j in i + 1..views.len() {
            let parallax = parallax(&views[i], &views[j]);
            if PARALLAX.contains(&parallax) {
                let suns = shadow(i).zip(shadow(j)).map_or(0.0, |(a, b)| distance(a, b));
                rated.push((suns + PARALLAX_WEIGHT * (parallax - BEST_PARALLAX).abs(), i, j));
            }
        }
    }
    rated.sort_by(|a, b| a.0.total_cmp(&b.0));
    rated.truncate(PAIRS_A_VIEW * views.len());
    rated.into_iter().map(|(_, i, j)| (i, j)).collect()
}

#[cfg(test)]
mod tests;
