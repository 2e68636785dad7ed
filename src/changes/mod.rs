//! What changed between two surface models of one place: regions that rose or fell, with their volumes and how sure these are.
//!
//! [`Changes::between`] moves the later surface onto the earlier one by the shift with the smallest mean absolute difference, which
//! what changed hardly pulls, takes the differences of heights, and compares each with what both surfaces are expected to err by.
//! Differences that are too large for that, and wide enough to be no edge of a roof that moved by a pixel, are joined to regions.

mod error;
mod outline;
mod regions;

pub use error::ChangesError;
pub use regions::{Region, RegionRule};

use crate::frame::metres_of_unit;
use crate::io::{Grid2, MapGrid};
use crate::metrics::{
    HeightRaster, Method, MetricsError, Registration, onto_grid, registered, registrations, to_one_reference,
};
use crate::stats::quantile;
use serde::Serialize;

/// Number of registrations: all but the first leave out what changed.
const ROUNDS: usize = 2;
/// Smallest number of cells that both surfaces have.
const LEAST_COMMON_CELLS: usize = 100;
/// Share of normally distributed errors that are smaller than their standard deviation.
const WITHIN_SIGMA: f64 = 0.6827;
/// Standard deviation of errors whose mean absolute value is 1, if they are normally distributed.
const SIGMA_OF_MEAN: f32 = 1.2533;

/// A surface at one time.
pub struct Epoch {
    /// Its heights.
    pub surface: HeightRaster,
    /// Expected absolute error of every height, metres, on the same cells; none if that is not known.
    pub expected_error: Option<Grid2>,
}

/// Differences between two surfaces.
#[derive(Clone, Debug, Serialize)]
pub struct Changes {
    /// The grid of the earlier surface, on which the differences lie.
    pub grid: MapGrid,
    /// Metres that the later surface was moved east, north and up.
    pub moved_m: [f64; 3],
    /// Whether the heights determine the horizontal shift; where they leave a direction open it is not moved.
    pub is_determined: bool,
    /// Number of cells of the earlier surface.
    pub cells: usize,
    /// Number of cells that both surfaces have.
    pub common_cells: usize,
    /// Median of the standard deviations of the differences, metres.
    pub sigma_m: f64,
    /// What was done to the heights, and what is not known of them.
    pub notes: Vec<String>,
    /// The regions that changed, the largest volume first.
    pub regions: Vec<Region>,
    /// Later minus earlier height, metres; NaN where one of them is not known.
    #[serde(skip)]
    pub difference: Grid2,
    /// Standard deviation of the difference, metres.
    #[serde(skip)]
    pub sigma: Grid2,
}

impl Changes {
    /// The changes from an earlier to a later surface.
    ///
    /// # Errors
    /// [`ChangesError`]: fewer than 100 common cells, or maps or vertical references that cannot be brought together.
    pub fn between(mut earlier: Epoch, mut later: Epoch, rule: &RegionRule) -> Result<Self, ChangesError> {
        let notes = notes(&mut earlier.surface, &mut later.surface)?;
        let (earlier, later) = (&earlier, &later);
        let grid = earlier.surface.grid;
        let middle = grid.middle();
        let cell_m = grid.cell * metres_of_unit(grid.epsg, [middle.x(), middle.y()])?;
        let mut unchanged = earlier.surface.height.clone();
        let mut found = Self::registered(earlier, later, &unchanged, (rule, cell_m))?;
        for _ in 1..ROUNDS {
            for region in &found.regions {
                region.cells.iter().for_each(|cell| unchanged.data[*cell] = f32::NAN);
            }
            found = Self::registered(earlier, later, &unchanged, (rule, cell_m))?;
        }
        Ok(Self { notes, ..found })
    }

    /// The changes after the later surface is moved onto what is left of the earlier one as `unchanged`.
    fn registered(
        earlier: &Epoch,
        later: &Epoch,
        unchanged: &Grid2,
        (rule, cell_m): (&RegionRule, f64),
    ) -> Result<Self, ChangesError> {
        let (before, after) = (&earlier.surface, &later.surface);
        let grid = before.grid;
        let (as_it_is, _) = onto_grid(&after.height, &after.grid, &grid)?;
        let common = as_it_is.data.iter().zip(&unchanged.data).filter(|(a, b)| !(**a - **b).is_nan()).count();
        if common < LEAST_COMMON_CELLS {
            return Err(no_overlap(before, after, common));
        }
        let [.., shift] = registrations(&as_it_is, unchanged, (f32::MIN, f32::MAX));
        debug_assert_eq!(shift.method, Method::Xyz);
        let heights = registered(&after.height, &after.grid, &grid, &shift)?;
        let difference = subtracted(&heights, &before.height);
        let of_later = later.expected_error.as_ref();
        let level = Registration { dz_m: 0.0, ..shift };
        let of_later = of_later.map(|error| registered(error, &after.grid, &grid, &level)).transpose()?;
        let sigma = sigma(&difference, earlier.expected_error.as_ref(), of_later.as_ref());
        let [east, north] = shift.moved_cells().map(|cells| cells * cell_m);
        Ok(Self {
            grid,
            moved_m: [east, north, shift.dz_m],
            is_determined: shift.is_determined,
            cells: before.height.valid().count(),
            common_cells: difference.valid().count(),
            notes: Vec::new(),
            sigma_m: quantile(sigma.valid().map(f64::from).collect(), 0.5).unwrap_or(f64::NAN),
            regions: regions::regions(&difference, &sigma, (&grid, cell_m), rule),
            difference,
            sigma,
        })
    }

    /// Volumes that were added and removed in all regions, each with its standard deviation, cubic metres.
    #[must_use]
    pub fn volumes_m3(&self) -> [(f64, f64); 2] {
        [1.0, -1.0].map(|sign| {
            let of_sign = self.regions.iter().filter(|region| region.volume_m3 * sign > 0.0);
            // Regions err on their own.
            let (volume, variance) =
                of_sign.fold((0.0, 0.0), |(v, s), r| (v + r.volume_m3.abs(), s + r.volume_sigma_m3.powi(2)));
            (volume, variance.sqrt())
        })
    }
}

/// Brings heights above different vertical references together, and says what was done or is not known.
fn notes(earlier: &mut HeightRaster, later: &mut HeightRaster) -> Result<Vec<String>, MetricsError> {
    let mut notes = to_one_reference(earlier, later)?;
    if earlier.vertical != later.vertical || earlier.vertical.is_none() {
        let of = |s: &HeightRaster| s.vertical.clone().unwrap_or_else(|| "not stated".into());
        notes.push(format!(
            "vertical references: earlier {}, later {}; the median difference of what did not change is removed",
            of(earlier),
            of(later)
        ));
    }
    Ok(notes)
}

fn no_overlap(before: &HeightRaster, after: &HeightRaster, common: usize) -> ChangesError {
    ChangesError::NoOverlap {
        earlier: before.path.clone(),
        later: after.path.clone(),
        common,
        needed: LEAST_COMMON_CELLS,
        extents: format!("{} and {}", before.grid.extent(), after.grid.extent()),
    }
}

fn subtracted(from: &Grid2, what: &Grid2) -> Grid2 {
    Grid2 { data: from.data.iter().zip(&what.data).map(|(a, b)| a - b).collect(), ..*from }
}

/// Standard deviations of differences: of the expected errors of both surfaces, raised by one factor if the differences are larger
/// than these say, of which most are no changes. Without expected errors it is the same everywhere.
fn sigma(difference: &Grid2, earlier: Option<&Grid2>, later: Option<&Grid2>) -> Grid2 {
    let zero = Grid2::filled(difference.width, difference.height, 0.0);
    let [a, b] = [earlier, later].map(|error| error.unwrap_or(&zero));
    let is_known = earlier.is_some() || later.is_some();
    let of_cell = |((d, a), b): ((&f32, &f32), &f32)| {
        let expected = if is_known { SIGMA_OF_MEAN * a.hypot(*b) } else { 1.0 };
        if d.is_nan() { f32::NAN } else { expected }
    };
    let cells = difference.data.iter().zip(&a.data).zip(&b.data);
    let mut sigma = Grid2 { data: cells.map(of_cell).collect(), ..*difference };
    let ratios = difference.data.iter().zip(&sigma.data).map(|(d, s)| f64::from((d / s).abs()));
    let scatter = quantile(ratios.filter(|r| r.is_finite()).collect(), WITHIN_SIGMA).unwrap_or(1.0);
    let factor = if is_known { scatter.max(1.0) } else { scatter } as f32;
    sigma.data.iter_mut().for_each(|s| *s *= factor);
    sigma
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::CounterRng;

    const GRID: MapGrid =
        MapGrid { epsg: 32631, west: 500_000.0, north: 4_800_000.0, cell: 0.5, width: 200, height: 160 };

    /// A town on a slope, with noise of 0.1 m, seen from a place that lies `shift` cells east and south and 2 m higher.
    fn town(seed: u64, shift: (i64, i64), extra: impl Fn(i64, i64) -> f32) -> Epoch {
        let height = |col: usize, row: usize| {
            let (x, y) = (col as i64 + shift.0, row as i64 + shift.1);
            let (i, j) = (x.div_euclid(23), y.div_euclid(19));
            let house = (x.rem_euclid(23) > 7 && y.rem_euclid(19) > 6) as u8 as f32;
            let noise = CounterRng::new(seed, 1, 0, (row * GRID.width + col) as u64).normal() as f32;
            0.02 * x as f32
                + house * ((i * 7 + j * 5 + i * j).rem_euclid(9) as f32 + 3.0)
                + 0.1 * noise
                + extra(x, y)
        };
        let (width, rows) = (GRID.width, GRID.height);
        let surface = HeightRaster {
            path: "dsm.tif".into(),
            grid: GRID,
            height: Grid2::from_fn(width, rows, |col, row| {
                height(col, row) + 2.0 * (shift != (0, 0)) as u8 as f32
            }),
            vertical: None,
            undeclared_nodata: 0,
            converted_from: None,
        };
        Epoch { surface, expected_error: Some(Grid2::filled(width, rows, 0.1)) }
    }

    fn within(x: i64, y: i64, (west, north, east, south): (i64, i64, i64, i64)) -> bool {
        (west..east).contains(&x) && (north..south).contains(&y)
    }

    #[test]
    fn what_rose_and_fell_is_found_with_its_volume_although_the_surfaces_are_shifted() {
        let before = town(1, (0, 0), |x, y| if within(x, y, (120, 90, 150, 110)) { 5.0 } else { 0.0 });
        let after = town(2, (2, -1), |x, y| if within(x, y, (40, 60, 60, 100)) { 6.0 } else { 0.0 });
        let changes = Changes::between(before, after, &RegionRule::default()).unwrap();
        assert!(changes.is_determined, "{changes:?}");
        let [east, north, up] = changes.moved_m;
        assert!(
            (east - 1.0).abs() < 0.05 && (north - 0.5).abs() < 0.05 && (up + 2.0).abs() < 0.05,
            "{changes:?}"
        );
        let [rose, fell] = changes.regions.as_slice() else { panic!("{:?}", changes.regions) };
        // 20 x 40 and 30 x 20 cells of 0.25 m².
        assert!(
            (rose.volume_m3 - 6.0 * 200.0).abs() < 40.0 && (rose.area_m2 - 200.0).abs() < 10.0,
            "{rose:?}"
        );
        assert!((fell.volume_m3 + 5.0 * 150.0).abs() < 40.0 && (fell.mean_m + 5.0).abs() < 0.2, "{fell:?}");
        assert!(rose.volume_sigma_m3 > 0.0 && rose.volume_sigma_m3 < 0.08 * rose.volume_m3, "{rose:?}");
        let [(added, _), (removed, _)] = changes.volumes_m3();
        assert!((added - rose.volume_m3).abs() < 1e-9 && (removed + fell.volume_m3).abs() < 1e-9);
        let east_of_all = rose.outline.iter().map(|p| p.0).fold(f64::MIN, f64::max);
        assert!((east_of_all - (GRID.west + 30.0)).abs() < 1.1, "{:?}", rose.outline);
    }

    #[test]
    fn the_same_town_twice_has_not_changed_and_uncertain_heights_change_nothing() {
        let changes = Changes::between(
            town(1, (0, 0), |_, _| 0.0),
            town(2, (3, 2), |_, _| 0.0),
            &RegionRule::default(),
        );
        assert!(changes.unwrap().regions.is_empty());
        let mut after = town(2, (0, 0), |x, y| if within(x, y, (40, 60, 60, 100)) { 6.0 } else { 0.0 });
        after.expected_error = Some(Grid2::from_fn(GRID.width, GRID.height, |x, y| {
            if within(x as i64, y as i64, (30, 50, 70, 110)) { 4.0 } else { 0.1 }
        }));
        let changes = Changes::between(town(1, (0, 0), |_, _| 0.0), after, &RegionRule::default()).unwrap();
        assert!(changes.regions.is_empty(), "{:?}", changes.regions);
    }

    #[test]
    fn without_expected_errors_the_scatter_of_the_differences_tells_them() {
        let without = |epoch: Epoch| Epoch { expected_error: None, ..epoch };
        let before = without(town(1, (0, 0), |_, _| 0.0));
        let after = without(town(2, (0, 0), |x, y| if within(x, y, (40, 60, 60, 100)) { 6.0 } else { 0.0 }));
        let changes = Changes::between(before, after, &RegionRule::default()).unwrap();
        assert_eq!(changes.regions.len(), 1);
        assert!((changes.sigma_m - 0.14).abs() < 0.03, "{}", changes.sigma_m);
    }

    #[test]
    fn surfaces_of_different_places_are_refused() {
        let mut after = town(2, (0, 0), |_, _| 0.0);
        after.surface.grid.west += 10_000.0;
        let refused = Changes::between(town(1, (0, 0), |_, _| 0.0), after, &RegionRule::default());
        assert!(matches!(refused, Err(ChangesError::NoOverlap { .. })));
    }
}
