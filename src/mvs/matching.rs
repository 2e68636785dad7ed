//! The plane sweep's passes: matching, and refinement with the trained splats as a prior.

use super::correlation::CostVolume;
use super::pairs::MatchError;
use super::plane_sweep::PlaneSweep;
use super::semiglobal::{self, P2, Penalties};
use super::stereo::{self, FEW_VIEWS};
use super::surface::MatchedSurface;
use super::visibility::Visibility;
use crate::checkpoint::PartStore;
use crate::io::Grid2;
use crate::progress::{Event, Progress};
use rayon::prelude::*;

/// Number of passes; all but the first leave out views from which a cell is occluded.
const PASSES: u64 = 2;
/// Smallest number of views with which refinement after training improves the surface. Two or three views can
/// agree on splats at false altitudes.
const MIN_REFINED_VIEWS: usize = 4;
/// A prior is used only if it lies within this distance, metres, of the altitudes of the first surface that
/// far around the cell.
const PRIOR_NEIGHBOURHOOD_M: f64 = 5.0;
/// A prior is used only if at least this share of the views that see the first surface of the cell also see
/// the prior.
const PRIOR_COVERAGE: f64 = 0.8;
/// A textureless cell is interpolated from confident cells if at least the share `SUPPORT_SHARE` of the cells within
/// `SUPPORT_RADIUS_M` (metres) are confident and differ from it by less than `SUPPORT_STEP_M` in altitude.
const SUPPORT_RADIUS_M: f64 = 10.0;
const SUPPORT_SHARE: f32 = 0.01;
const SUPPORT_STEP_M: f32 = 1.0;
/// Penalty of semi-global matching for a difference of one plane between neighbouring cells, in the unit of
/// [`CostVolume`], where 255 stands for a correlation of 0.
const P1: u16 = 30;
/// Penalty for a larger difference. It is high, so that textureless roofs and streets stay connected.
const P2_MATCHING: u16 = 200;
/// The same with a prior. The prior keeps surfaces connected, and a lower penalty preserves trees.
const P2_REFINEMENT: u16 = 60;
/// Cost of altitudes that the coarse search did not find near a cell, in the same unit.
const FAR_COST: u8 = 40;

impl PlaneSweep {
    /// Matches the views. Passes and maps that are found go to `parts`, and are taken from there.
    ///
    /// # Errors
    /// [`MatchError::Interrupted`] when `progress` cancels, [`MatchError::Write`] when a part cannot be stored.
    pub fn run(
        &self,
        parts: Option<&PartStore>,
        progress: &dyn Progress,
    ) -> Result<MatchedSurface, MatchError> {
        if self.images.len() <= FEW_VIEWS {
            return stereo::match_views(self, parts, progress);
        }
        progress.event(Event::Started { stage: "matching the surface", total: PASSES });
        let matched = |pass: u64, before: Option<&MatchedSurface>| {
            let rasters = PartStore::part(parts, &format!("pass_{pass}"), "", || {
                let visibility = before.map(|s| Visibility::new(self, &s.altitude, &s.confident()));
                let found = self.optimized(&self.near_candidates(visibility.as_ref()), P2_MATCHING);
                Ok::<_, MatchError>((found.altitude, found.score))
            });
            rasters.map(|rasters| self.unweighted(rasters))
        };
        let mut surface = matched(0, None)?;
        for pass in 1..PASSES {
            progress.event(Event::Advanced { done: pass, status: String::new() });
            progress.check()?;
            surface = matched(pass, Some(&surface))?;
        }
        if let Some(parts) = parts {
            parts.tell(progress);
        }
        surface.prior_weight = self.prior_weight(&surface);
        progress.event(Event::Finished);
        Ok(surface)
    }

    /// The cost volume of the first surface. The planes of a block are those near the candidates of all its cells; in cells
    /// that are far from these, views may agree on them by chance.
    fn near_candidates(&self, visibility: Option<&Visibility>) -> CostVolume<'_> {
        let mut volume = CostVolume::correlate(self, visibility);
        if let Some(candidates) = &self.candidates {
            volume.raise(FAR_COST, |cell| {
                let (col, row) = (cell % self.grid.width, cell / self.grid.width);
                let near = candidates.at(self.site.site_from_utm(self.grid.cell_center(col, row)));
                move |plane| !near.contains(f64::from(self.stack.altitude(cell, plane as f32)))
            });
        }
        volume
    }

    /// Whether so many views are enough for [`PlaneSweep::refine`] to improve the surface after training.
    #[must_use]
    pub fn can_refine(views: usize) -> bool {
        views >= MIN_REFINED_VIEWS
    }

    /// [`MatchedSurface::prior_weight`] of a surface.
    fn prior_weight(&self, surface: &MatchedSurface) -> Grid2 {
        let confident = surface.confident();
        let visibility = Visibility::new(self, &surface.altitude, &confident);
        let radius = (SUPPORT_RADIUS_M / self.grid.cell) as i64;
        let weight = |col: usize, row: usize| {
            let textureless = 1.0 - visibility.texture(row * self.grid.width + col);
            if textureless.is_nan() || textureless == 0.0 {
                return 0.0;
            }
            let z = surface.altitude.at(col, row);
            let near = |center: usize| (center as i64 - radius..=center as i64 + radius).step_by(2);
            let cells = near(row).flat_map(|r| near(col).map(move |c| (c, r)));
            let supporting =
                cells.filter(|(c, r)| (confident.get(*c, *r) - z).abs() < SUPPORT_STEP_M).count();
            let share = supporting as f32 / near(0).count().pow(2) as f32;
            textureless * (share / SUPPORT_SHARE).min(1.0)
        };
        Grid2::from_rows(self.grid.width, self.grid.height, |row, line| {
            line.iter_mut().enumerate().for_each(|(col, out)| *out = weight(col, row));
        })
    }

    /// Matches again after training, with the altitudes of the trained splats as `prior`: site metres on this
    /// sweep's grid, NaN where unknown. `first` is the surface from which training started.
    ///
    /// Training finds trees that the first matching lost, but closes narrow gaps that it had open. Each cell
    /// may therefore also return to the first surface where the views agree better there. Textureless segments
    /// are then moved onto planes (`planes`), noise at the margin is removed (`margin`), and the result is
    /// postfiltered (`postfilter`).
    #[must_use]
    pub fn refine(&mut self, prior: &Grid2, first: &MatchedSurface) -> MatchedSurface {
        let (occluders, prior) = (first.confident(), &self.plausible_prior(prior, &first.altitude));
        self.include(&[prior, &first.altitude]);
        let of_prior = Visibility::new(self, prior, &occluders);
        let refined_once = |visibility: &Visibility| {
            let mut volume = CostVolume::correlate(self, Some(visibility));
            volume.add_prior(prior, &first.altitude, &self.stack, visibility);
            self.optimized(&volume, P2_REFINEMENT)
        };
        // The gray values of the cells depend on the surface: the second pass takes them from the result of
        // the first.
        let once = refined_once(&of_prior);
        let mut refined = refined_once(&of_prior.of(self, &once.altitude));
        refined.flatten(&of_prior.of(self, &refined.altitude));
        self.remove_noisy_margin(&mut refined);
        let mut refined = refined.postfiltered(prior);
        // Cells that few-view stereo could not match stay marked as filled.
        for (score, first) in refined.score.data.iter_mut().zip(&first.score.data) {
            if *first == 0.0 {
                *score = 0.0;
            }
        }
        refined
    }

    /// `prior` where it is plausible, else NaN: within the range of altitudes of the `first` surface nearby,
    /// and seen by most of the views that see the first surface. At the margins and over textureless
    /// surfaces, splats may float where no view contradicts them.
    pub(super) fn plausible_prior(&self, prior: &Grid2, first: &Grid2) -> Grid2 {
        let radius = (PRIOR_NEIGHBOURHOOD_M / self.grid.cell).ceil() as i64;
        let plausible = |col: usize, row: usize| {
            let (z, first_z) = (prior.at(col, row), first.at(col, row));
            let views = |z: f32| self.covering_views(col, row, z) as f64;
            let near = |center: usize| center as i64 - radius..=center as i64 + radius;
            let cells = near(row).flat_map(|r| near(col).map(move |c| first.get(c, r)));
            let (low, high) =
                cells.fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), z| (l.min(z), h.max(z)));
            let margin = PRIOR_NEIGHBOURHOOD_M as f32;
            let is_in_range = (low - margin..=high + margin).contains(&z);
            let is_plausible = first_z.is_nan() || is_in_range && views(z) >= PRIOR_COVERAGE * views(first_z);
            if is_plausible { z } else { f32::NAN }
        };
        Grid2::from_rows(prior.width, prior.height, |row, line| {
            line.iter_mut().enumerate().for_each(|(col, z)| *z = plausible(col, row));
        })
    }

    /// The altitudes of least cost after semi-global aggregation, interpolated between planes by a parabola. Cells whose best
    /// plane is the first or the last have a score of 0, because the true altitude may lie beyond.
    fn optimized(&self, volume: &CostVolume, p2: u16) -> MatchedSurface {
        let penalties = Penalties { p1: P1, p2: P2::Constant(p2) };
        let sums = semiglobal::aggregate(&volume.costs, volume.ranges, penalties);
        let best = |cell: usize| {
            let (costs, planes) = (volume.cell(cell), volume.ranges.planes(cell));
            let sums = &sums[volume.ranges.entries(cell..cell + 1)];
            let k = (0..planes.len()).min_by_key(|k| sums[*k]).unwrap_or(0);
            let cost = costs.get(k).copied().unwrap_or(CostVolume::UNSEEN);
            if cost == CostVolume::UNSEEN || !self.coverage[cell].covers_ground {
                return (f32::NAN, 0.0);
            }
            let plane = (planes.start + k) as f32;
            if k == 0 || k + 1 == planes.len() {
                return (self.stack.altitude(cell, plane), 0.0);
            }
            let [a, b, c] = [sums[k - 1], sums[k], sums[k + 1]].map(f32::from);
            let fraction = 0.5 * (a - c) / (a - 2.0 * b + c).max(1.0);
            (self.stack.altitude(cell, plane + fraction), 1.0 - f32::from(cost) / 255.0)
        };
        let (width, height) = (self.grid.width, self.grid.height);
        let found: Vec<(f32, f32)> = (0..width * height).into_par_iter().map(best).collect();
        let (altitude, score) = found.into_iter().unzip();
        let raster = |data: Vec<f32>| Grid2 { width, height, data };
        self.unweighted((raster(altitude), raster(score)))
    }

    /// The surface of altitudes and scores, with prior weights of 0.
    fn unweighted(&self, (altitude, score): (Grid2, Grid2)) -> MatchedSurface {
        let prior_weight = Grid2::filled(self.grid.width, self.grid.height, 0.0);
        MatchedSurface { site: self.site, grid: self.grid, altitude, score, prior_weight }
    }
}
