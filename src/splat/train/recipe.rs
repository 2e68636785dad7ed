//! A recipe: the complete set of training choices, by name.
//!
//! Numbers marked *cube* are lengths in the papers' [-1, 1] cube: times half its side, they are metres.

use crate::splat::appearance::AppearanceKind;
use crate::splat::loss::LossWeights;
use crate::splat::splats::PerGroup;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Iterations of the default recipe, instead of the papers' 5000: it starts near the surface.
const BEST_ITERATIONS: u32 = 4000;
/// Iterations for each of few training views, up to the recipe's: what they show is learnt sooner.
const ITERATIONS_A_VIEW: u32 = 500;
/// Opacity whose logit is -6.
const EOGS_PRUNES_BELOW: f64 = 0.002_472_6;

/// Weights of the loss's terms (EOGS).
const EOGS_WEIGHTS: [(&str, f64); 4] =
    [("opacity", 0.1), ("consistency_altitude", 0.01), ("consistency_color", 0.1), ("shadow_entropy", 0.01)];

/// Why a recipe could not be read.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum RecipeError {
    /// The system does not give it.
    #[error("recipe `{path}` cannot be read: {reason}")]
    #[diagnostic(help("--recipe takes the name of a recipe or a TOML file"))]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's words.
        reason: String,
    },
    /// It is no recipe.
    #[error("recipe `{path}`: {reason}")]
    #[diagnostic(help("`satgs train --print-recipe best` prints one to start from"))]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
}

/// What splats start on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Start {
    /// The surface that matching finds; it also sharpens the DSM afterwards. Otherwise the DSM is the splats' alone.
    Surface,
    /// The sparse points, with a level carpet (BAEOGS §3.1).
    Points,
    /// Everywhere in the area's box of air (EOGS).
    Box,
}

/// What the DSM's height is of the splats that lie above each other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RayHeight {
    /// The altitude at which half of the light from above is gone.
    #[default]
    Median,
    /// The mean altitude at which light is lost, in the cell and the eight around it; what comes through counts as the
    /// lowest altitude (EOGS).
    Mean,
}

/// When and which splats are doubled (BAEOGS §3.3, on gsplat's default strategy).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Densification {
    /// First iteration.
    pub from: u32,
    /// Last iteration.
    pub until: u32,
    /// Largest scale that is left alone, *cube* half sides.
    pub max_scale: f64,
    /// Largest projected radius that is left alone, of the longer image side.
    pub max_radius: f64,
    /// Mean gradient by the image position, in half image sides, from which a splat is doubled.
    pub gradient: f64,
    /// Splats smaller than this are copied, larger ones split in two, *cube* half sides.
    pub copy_below: f64,
    /// No more splats than this.
    pub max_splats: u32,
}

/// Opacity resets (BAEOGS §3.3).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reset {
    /// Iterations between resets.
    pub every: u32,
    /// Opacities are lowered to this.
    pub opacity: f64,
    /// Iterations for which the opacity loss rests.
    pub opacity_loss_rests: u32,
    /// Iterations for which growth and pruning rest.
    pub growth_rests: u32,
}

/// A named, complete set of training choices.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Its name.
    pub name: String,
    /// Iterations; the other times are for this many and scale with it.
    pub iterations: u32,
    /// Iterations at half the images' resolution before the full one.
    pub half_resolution_until: u32,
    /// Widest pixels that half the resolution may have, metres; else there is only the full one, for narrow trees and
    /// roofs' rims, once lost, do not come back.
    #[serde(default = "widest_half_resolution_px_m")]
    pub half_resolution_px_m: f64,
    /// Light of what images that are not light themselves show as white; the less it is, the more opacities weigh.
    #[serde(default = "white")]
    pub white: f32,
    /// What splats start on.
    pub start: Start,
    /// Step lengths of Adam for each parameter group of the splats. That of positions is in *cube* half sides (EOGS: 0.00016
    /// times its radius of 2.2).
    pub rates: PerGroup<f64>,
    /// Step length of Adam for the parameters of the colour model.
    pub appearance_rate: f64,
    /// Weights of the loss's terms by name: EOGS's `L_opacity` is `opacity`, `L_new_altitude` and `L_new_rgb` are
    /// `consistency_altitude` (per metre) and `consistency_color`, `L_translucentshadows` is `shadow_entropy`; ours is
    /// `surface_prior`, for recipes that start on the matched surface. Those that are absent are zero.
    pub weights: LossWeights,
    /// The colour model.
    #[serde(default)]
    pub appearance: AppearanceKind,
    /// Whether the sum of opacities is divided by the number of splats at the start (EOGS) instead of the present one
    /// (BAEOGS).
    pub opacity_by_start: bool,
    /// Iteration from which shadows and the virtual camera count (EOGS: 1000).
    pub shadows_from: u32,
    /// Largest shear of the virtual camera, half image sides per metre of altitude (EOGS: 0.01); there is none unless
    /// consistency weighs something.
    pub virtual_shear: f64,
    /// Every so many iterations there is a virtual view, and consistency weighs that much more.
    #[serde(default = "always")]
    pub virtual_every: u32,
    /// Iterations between checks, at which faint splats are removed and others doubled.
    pub check_every: u32,
    /// Doubling; none if absent.
    pub growth: Option<Densification>,
    /// Splats fainter than this are removed (BAEOGS: 0.0025).
    pub prune_below: f64,
    /// The DSM's heights, where it is the splats' alone.
    #[serde(default)]
    pub heights: RayHeight,
    /// Resets; none if absent.
    pub reset: Option<Reset>,
}

/// Between the 0.7 m of images of 0.35 m, which half the resolution serves, and the 1 m of those of 0.5 m.
fn widest_half_resolution_px_m() -> f64 {
    0.9
}

/// As bright as an image can be.
fn white() -> f32 {
    1.0
}

/// In every iteration.
fn always() -> u32 {
    1
}

/// Weights, some of them of these values.
fn weights(others: LossWeights, named: &[(&str, f64)]) -> LossWeights {
    others.with(named).expect("the terms of the built-in recipes are registered")
}

impl Recipe {
    /// The recipe for so many training views: where it starts on the surface that few of them are matched to, it has no more
    /// than 500 iterations for each.
    #[must_use]
    pub fn for_views(self, views: usize) -> Self {
        let is_few = self.start == Start::Surface && views <= crate::mvs::FEW_VIEWS;
        let enough = ITERATIONS_A_VIEW * views.max(1) as u32;
        if is_few && enough < self.iterations { self.with_iterations(enough) } else { self }
    }

    /// Names of the recipes that come with the program, the default first.
    pub const NAMES: [&'static str; 3] = ["best", "baeogs", "eogs"];

    /// A recipe by name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        let growth = Densification {
            from: 500,
            until: 4000,
            max_scale: 0.03,
            max_radius: 0.15,
            gradient: 0.0006,
            copy_below: 0.01,
            max_splats: 2_000_000,
        };
        let baeogs = Self {
            name: "baeogs".into(),
            iterations: 5000,
            // Ours, for time: the paper trains at full resolution throughout, with a virtual view in every iteration.
            half_resolution_until: 3500,
            half_resolution_px_m: widest_half_resolution_px_m(),
            white: white(),
            start: Start::Points,
            rates: PerGroup {
                position: 0.000_16 * 2.22,
                log_scale: 0.005,
                rotation: 0.001,
                opacity_logit: 0.05,
                f_dc: 0.0025,
            },
            appearance_rate: 0.01,
            weights: weights(LossWeights::default(), &EOGS_WEIGHTS),
            appearance: AppearanceKind::Affine,
            opacity_by_start: false,
            shadows_from: 1000,
            virtual_shear: 0.01,
            virtual_every: 2,
            check_every: 100,
            growth: Some(growth),
            prune_below: 0.0025,
            heights: RayHeight::Mean,
            // How long things rest is ours: a loss on opacities that comes back before the pictures are restored
            // removes what they need.
            reset: Some(Reset { every: 3000, opacity: 0.005, opacity_loss_rests: 1000, growth_rests: 500 }),
        };
        match name {
            "baeogs" => Some(baeogs),
            // EOGS looks for faint splats in every iteration. Between 1/255 and this opacity no pixel sees them, so that
            // to wait a little changes nothing.
            "eogs" => Some(Self {
                name: "eogs".into(),
                half_resolution_until: 0,
                // The mean of DFC2019's colours becomes 0.15: the published images have 0.13 to 0.2, as far as the first
                // losses of an independent reproduction tell.
                white: 0.4,
                virtual_every: always(),
                start: Start::Box,
                opacity_by_start: true,
                growth: None,
                prune_below: EOGS_PRUNES_BELOW,
                reset: None,
                ..baeogs
            }),
            "best" => {
                let best = Self {
                    name: "best".into(),
                    start: Start::Surface,
                    // Roofs without texture would drift.
                    weights: weights(baeogs.weights, &[("surface_prior", 0.1)]),
                    heights: RayHeight::Median,
                    reset: None,
                    ..baeogs
                };
                Some(best.with_iterations(BEST_ITERATIONS))
            }
            _ => None,
        }
    }

    /// Reads a recipe that [`Recipe::to_toml`] wrote, or a user after it.
    ///
    /// # Errors
    /// [`RecipeError`] names the file and the line or the value.
    pub fn read(path: &Path) -> Result<Self, RecipeError> {
        let refused = |reason: String| RecipeError::Format { path: path.into(), reason };
        let text = std::fs::read_to_string(path)
            .map_err(|e| RecipeError::Io { path: path.into(), reason: e.to_string() })?;
        let recipe: Self = toml::from_str(&text).map_err(|e| refused(e.to_string().trim_end().into()))?;
        recipe.check().map_err(refused)?;
        Ok(recipe)
    }

    /// The recipe as TOML.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }

    /// What is wrong with it, if anything.
    fn check(&self) -> Result<(), String> {
        let r = &self.rates;
        let of_growth = |value: fn(&Densification) -> f64| self.growth.as_ref().map_or(0.0, value);
        let numbers = [
            ("rates.position", r.position),
            ("rates.log_scale", r.log_scale),
            ("rates.rotation", r.rotation),
            ("rates.opacity_logit", r.opacity_logit),
            ("rates.f_dc", r.f_dc),
            ("appearance_rate", self.appearance_rate),
            ("half_resolution_px_m", self.half_resolution_px_m),
            ("white", self.white.into()),
            ("virtual_shear", self.virtual_shear),
            ("growth.max_scale", of_growth(|g| g.max_scale)),
            ("growth.max_radius", of_growth(|g| g.max_radius)),
            ("growth.gradient", of_growth(|g| g.gradient)),
            ("growth.copy_below", of_growth(|g| g.copy_below)),
        ];
        let weights = self.weights.iter().map(|(name, value)| (format!("weights.{name}"), value));
        let numbers = numbers.into_iter().map(|(name, value)| (name.to_owned(), value));
        if let Some((name, value)) = numbers.chain(weights).find(|(_, v)| !(v.is_finite() && *v >= 0.0)) {
            return Err(format!("{name} = {value}, but must be a number of at least 0"));
        }
        let opacities =
            [("prune_below", Some(self.prune_below)), ("reset.opacity", self.reset.map(|r| r.opacity))];
        for (name, value) in opacities {
            if value.is_some_and(|v| !(v > 0.0 && v < 1.0)) {
                return Err(format!(
                    "{name} = {}, but must be an opacity between 0 and 1",
                    value.unwrap_or_default()
                ));
            }
        }
        if self.white == 0.0 {
            return Err("white = 0, but must be above 0".into());
        }
        let counts = [
            ("iterations", self.iterations),
            ("virtual_every", self.virtual_every),
            ("check_every", self.check_every),
            ("reset.every", self.reset.map_or(1, |r| r.every)),
        ];
        if let Some((name, _)) = counts.into_iter().find(|(_, v)| *v == 0) {
            return Err(format!("{name} = 0, but must be at least 1"));
        }
        let Some(reset) = self.reset else { return Ok(()) };
        let rests = [
            ("reset.opacity_loss_rests", reset.opacity_loss_rests),
            ("reset.growth_rests", reset.growth_rests),
        ];
        match rests.into_iter().find(|(_, span)| *span >= reset.every) {
            Some((name, span)) => Err(format!("{name} = {span}, but must be less than reset.every")),
            None => Ok(()),
        }
    }

    /// The same recipe with every time scaled to another number of iterations.
    ///
    /// The interval between checks stays: gradients need that many views to be averaged, and what has not
    /// settled yet would double with every check.
    #[must_use]
    pub fn with_iterations(&self, iterations: u32) -> Self {
        let scale =
            |t: u32| (u64::from(t) * u64::from(iterations) / u64::from(self.iterations.max(1))) as u32;
        let at_least_one = |t: u32| scale(t).max(1);
        let growth = self.growth.map(|g| Densification { from: scale(g.from), until: scale(g.until), ..g });
        let reset = self.reset.map(|r| Reset {
            every: at_least_one(r.every),
            opacity_loss_rests: scale(r.opacity_loss_rests),
            growth_rests: scale(r.growth_rests),
            ..r
        });
        Self {
            iterations,
            half_resolution_until: scale(self.half_resolution_until),
            shadows_from: scale(self.shadows_from),
            growth,
            reset,
            ..self.clone()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_printed_is_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mine.toml");
        for name in Recipe::NAMES {
            let recipe = Recipe::named(name).unwrap();
            std::fs::write(&path, recipe.to_toml()).unwrap();
            assert_eq!(Recipe::read(&path).unwrap(), recipe);
        }
    }

    #[test]
    fn recipes_that_cannot_be_cooked_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bad.toml");
        let text = Recipe::named("baeogs").unwrap().to_toml();
        for (from, to, says) in [
            ("opacity_logit = 0.05", "opacity_logit = nan", "rates.opacity_logit = NaN"),
            ("gradient = 0.0006", "gradient = -1.0", "growth.gradient = -1"),
            ("prune_below = 0.0025", "prune_below = 0.0", "prune_below = 0,"),
            ("virtual_every = 2", "virtual_every = 0", "virtual_every = 0"),
            ("check_every = 100", "check_every = 0", "check_every = 0"),
            ("growth_rests = 500", "growth_rests = 3000", "reset.growth_rests = 3000"),
            ("iterations = 5000", "iterations = 0", "iterations = 0"),
            ("white = 1.0", "white = 0.0", "white = 0"),
            ("shadow_entropy = 0.01", "shadow_entropy = -1.0", "weights.shadow_entropy = -1"),
            ("shadow_entropy = 0.01", "entropy = 0.01", "no loss term has the weight `entropy`"),
            ("start = \"points\"", "begin = \"points\"", "unknown field `begin`"),
            ("start = \"points\"", "start = \"sky\"", "line"),
        ] {
            let changed = text.replacen(from, to, 1);
            assert_ne!(changed, text, "{from}");
            std::fs::write(&path, changed).unwrap();
            let error = Recipe::read(&path).unwrap_err().to_string();
            assert!(error.contains(says) && error.contains("bad.toml"), "{error}");
        }
        assert!(
            Recipe::read(&folder.path().join("none.toml")).unwrap_err().to_string().contains("none.toml")
        );
    }
}
