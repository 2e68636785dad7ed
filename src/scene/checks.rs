//! Checks of a scene: errors for duplicate views and cameras that miss the ground, warnings for odd suns, dates and
//! view angles.

use super::sun::days_since_2000;
use super::{Scene, SceneError, Sun, View};
use crate::io::vsi;
use std::collections::BTreeMap;
use std::path::Path;

/// Lowest sun elevation with which shadows are modelled, and lowest elevation of the line of sight of a view, degrees.
/// Lower suns cast shadows longer than a scene. All modules use this limit.
pub const LOWEST_SUN_DEG: f64 = 15.0;
/// Largest off-nadir angle without a warning, degrees.
pub const FARTHEST_OFF_NADIR_DEG: f64 = 75.0;
/// Largest difference between the delivered sun direction and the one computed from date and place without a warning,
/// degrees.
const SUN_TOLERANCE_DEG: f64 = 5.0;
/// Smallest ratio of an RPC's denominator to its value in the middle of the image; below it the RPC is near a pole.
/// Whole images stay above 0.9.
const WEAK_DENOMINATOR: f64 = 0.1;
/// Largest difference of acquisition dates without a warning.
const LONG_TIME_YEARS: f64 = 3.0;

impl Scene {
    /// Checks that the scene has at least `needed` views.
    ///
    /// # Errors
    /// [`SceneError::TooFewViews`] if it has fewer.
    pub fn require_views(&self, needed: usize) -> Result<(), SceneError> {
        let found = self.views.len();
        if found < needed { Err(SceneError::TooFewViews { found, needed }) } else { Ok(()) }
    }

    /// Checks that the height ranges of all RPCs overlap, unless the metadata of the views state other heights.
    ///
    /// # Errors
    /// [`SceneError::NoSharedHeights`] names the view whose range differs most.
    pub fn require_shared_heights(&self) -> Result<(), SceneError> {
        let (low, high) = self.height_range();
        if low < high || self.views.iter().any(|v| v.height_range.is_some()) {
            return Ok(());
        }
        let middle = |v: &View| 0.5 * (v.rpc.height_range().0 + v.rpc.height_range().1);
        let mut middles: Vec<f64> = self.views.iter().map(middle).collect();
        middles.sort_by(f64::total_cmp);
        let usual = middles[middles.len() / 2];
        let off = |v: &&View| (middle(v) - usual).abs();
        let Some(odd) = self.views.iter().max_by(|a, b| off(a).total_cmp(&off(b))) else { return Ok(()) };
        let (low_m, high_m) = odd.rpc.height_range();
        Err(SceneError::NoSharedHeights { view: odd.name.clone(), low_m, high_m, usual_m: usual })
    }
}

/// Returns an error for two views with the same name, and for images with the same content.
pub(super) fn refuse_duplicates(scene: &Scene) -> Result<(), SceneError> {
    for pair in scene.views.windows(2) {
        if pair[0].name == pair[1].name {
            let (first, second) = (pair[0].image.clone(), pair[1].image.clone());
            return Err(SceneError::SameName { first, second });
        }
    }
    // Only files of the same size can be the same, so most are never read.
    let mut by_size: BTreeMap<u64, Vec<&View>> = BTreeMap::new();
    for view in &scene.views {
        let size = vsi::size(&view.image).unwrap_or_default();
        by_size.entry(size).or_default().push(view);
    }
    for group in by_size.values().filter(|g| g.len() > 1) {
        let mut seen: BTreeMap<[u8; 32], &Path> = BTreeMap::new();
        for view in group {
            let Ok(hash) = vsi::content_hash(&view.image) else { continue };
            if let Some(first) = seen.insert(*hash.as_bytes(), &view.image) {
                return Err(SceneError::SameImage { first: first.into(), second: view.image.clone() });
            }
        }
    }
    Ok(())
}

/// Returns an error for a camera that does not see the ground under its own image.
pub(super) fn refuse_blind(scene: &Scene) -> Result<(), SceneError> {
    for view in &scene.views {
        let height_m = view.rpc.center().height_m();
        if view.footprint(height_m).is_none() {
            let (view, source_file) = (view.name.clone(), view.rpc_source.clone());
            return Err(SceneError::SeesNoGround { view, source_file, height_m });
        }
    }
    Ok(())
}

/// Compares the heights to search with those for which the RPCs are made: a warning if none of them is searched.
///
/// # Errors
/// [`SceneError::HeightsElsewhere`] if they are farther apart than the heights of the RPCs from each other, where RPCs mean
/// nothing.
pub(super) fn require_heights_of_rpcs(scene: &mut Scene, (low, high): (f64, f64)) -> Result<(), SceneError> {
    let (rpc_low_m, rpc_high_m) = scene.height_range();
    let apart = (low - rpc_high_m).max(rpc_low_m - high);
    if low < high && rpc_low_m < rpc_high_m && apart > rpc_high_m - rpc_low_m {
        return Err(SceneError::HeightsElsewhere { low_m: low, high_m: high, rpc_low_m, rpc_high_m });
    }
    if apart > 0.0 {
        scene.warnings.push(format!(
            "--height-range {low},{high} lies outside of the heights of the RPCs, {rpc_low_m:.0} to {rpc_high_m:.0} m above the \
             ellipsoid"
        ));
    }
    Ok(())
}

/// Adds the warnings of a scene, one per cause. A sun that is too low is removed: such a view is trained without
/// shadows.
pub(super) fn warn(scene: &mut Scene) {
    let mut warnings = Vec::new();
    let names = |picked: &dyn Fn(&View) -> bool| {
        scene.views.iter().filter(|v| picked(v)).map(|v| v.name.as_str()).collect::<Vec<_>>().join(", ")
    };
    let without = names(&|v| v.sun.is_none());
    if !without.is_empty() {
        warnings.push(format!(
            "the sun direction is unknown, so that no shadows are modelled (--sun NAME=AZ,EL sets it): {without}"
        ));
    }
    for view in &scene.views {
        let Some(sun) = view.sun else { continue };
        let (name, at) = (&view.name, sun.elevation_deg);
        if at <= 0.0 {
            warnings
                .push(format!("{name}: its sun is below the horizon ({at:.1}°), no shadows are modelled"));
        } else if at < LOWEST_SUN_DEG {
            warnings
                .push(format!("{name}: its sun is too low for shadows ({at:.1}°, under {LOWEST_SUN_DEG}°)"));
        }
        if let Some((computed, apart)) = contradiction(view, sun) {
            warnings.push(format!(
                "{name}: its sun (azimuth {:.1}°, elevation {at:.1}°) is {apart:.0}° off where date and place put it \
                 ({:.1}°, {:.1}°)",
                sun.azimuth_deg, computed.azimuth_deg, computed.elevation_deg
            ));
        }
    }
    for view in &scene.views {
        let least = view.rpc.smallest_denominator();
        if least < WEAK_DENOMINATOR {
            warnings.push(format!(
                "{}: its RPC has a pole near its volume (a denominator falls to {least:.2}): heights far from its own \
                 are not to be trusted",
                view.name
            ));
        }
        let direction = view.direction_deg(view.rpc.center().height_m());
        if let Some((_, off)) = direction.filter(|d| d.1 > FARTHEST_OFF_NADIR_DEG) {
            warnings.push(format!("{}: its off-nadir angle is {off:.0}°, almost horizontal", view.name));
        }
    }
    let days: Vec<f64> = scene.views.iter().filter_map(|v| days_since_2000(v.acquired.as_deref()?)).collect();
    let span = |f: fn(f64, f64) -> f64| days.iter().copied().reduce(f).unwrap_or_default();
    let years = (span(f64::max) - span(f64::min)) / 365.25;
    if years > LONG_TIME_YEARS {
        warnings
            .push(format!("the views are {years:.1} years apart: what changed in between becomes blurred"));
    }
    scene.warnings.extend(warnings);
    for view in &mut scene.views {
        view.sun = view.sun.filter(|s| s.elevation_deg >= LOWEST_SUN_DEG);
    }
}

/// The sun direction computed from date and place, with its difference from the delivered one, if that is too large.
fn contradiction(view: &View, sun: Sun) -> Option<(Sun, f64)> {
    let place = view.ground_center(view.rpc.center().height_m())?;
    let computed = Sun::at(view.acquired.as_deref()?, place)?;
    let apart = computed.angle_to_deg(sun);
    (apart > SUN_TOLERANCE_DEG).then_some((computed, apart))
}
