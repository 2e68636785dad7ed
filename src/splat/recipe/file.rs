//! Reading and writing a recipe as TOML, with the checks of its values.

use super::{Densification, PerspectiveRecipe, Recipe, SatelliteRecipe};
use crate::io::read_text;
use crate::splat::loss::{TERMS, TermScope};
use crate::splat::primitive::PrimitiveKind;
use std::path::{Path, PathBuf};

/// Why a recipe could not be read.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum RecipeError {
    /// The file cannot be read.
    #[error("recipe `{path}` cannot be read: {reason}")]
    #[diagnostic(help("--recipe takes the name of a recipe or a TOML file"))]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's message.
        reason: String,
    },
    /// There is neither a recipe nor a file of this name.
    #[error("recipe `{name}` is neither one of satgs' recipes nor a file")]
    #[diagnostic(help(
        "recipes are {}; `satgs train --print-recipe best > my.toml` writes one as a TOML file to change", Recipe::NAMES.join(", ")
    ))]
    Unknown {
        /// The given name.
        name: String,
    },
    /// The file is not a valid recipe.
    #[error("recipe `{path}`: {reason}")]
    #[diagnostic(help("`satgs train --print-recipe best` prints one to start from"))]
    Format {
        /// The file.
        path: PathBuf,
        /// The error, with the line or the name of the value.
        reason: String,
    },
}

impl Recipe {
    /// Reads a recipe from a TOML file, such as [`Recipe::to_toml`] writes, and checks its values.
    ///
    /// # Errors
    /// [`RecipeError`] names the file, and the line or the value.
    pub fn read(path: &Path) -> Result<Self, RecipeError> {
        let refused = |reason: String| RecipeError::Format { path: path.into(), reason };
        if !path.exists() {
            return Err(RecipeError::Unknown { name: path.display().to_string() });
        }
        let text = read_text(path)
            .map_err(|e| RecipeError::Io { path: path.into(), reason: e.cause.to_string() })?;
        let recipe: Self = toml::from_str(&text).map_err(|e| refused(e.to_string().trim_end().into()))?;
        recipe.check().map_err(refused)?;
        Ok(recipe)
    }

    /// The recipe as TOML.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }

    /// A weight of a term that has no value in the scenes or for the splats of the recipe, and what the term is of.
    pub fn idle_weight(&self) -> Option<(&'static str, &'static str)> {
        let is_photographed = self.perspective().is_some();
        let has_discs = is_photographed && self.primitive == PrimitiveKind::Disc;
        TERMS.iter().find_map(|term| {
            let of = match term.scope {
                TermScope::Photographs if !is_photographed => "perspective scenes",
                TermScope::PhotographedDiscs if !has_discs => "discs in perspective scenes",
                _ => return None,
            };
            term.weights.iter().find(|name| self.weights.get(name) > 0.0).map(|name| (*name, of))
        })
    }

    /// Checks the ranges of all values; an error names the first that is out of range.
    fn check(&self) -> Result<(), String> {
        let r = &self.rates;
        let of_densification =
            |value: fn(&Densification) -> f64| self.densification.as_ref().map_or(0.0, value);
        let of_satellite = |value: fn(&SatelliteRecipe) -> f64| self.satellite().map_or(0.0, value);
        let of_perspective = |value: fn(&PerspectiveRecipe) -> f64| self.perspective().map_or(0.0, value);
        let numbers = [
            ("rates.position", r.position),
            ("rates.log_scale", r.log_scale),
            ("rates.rotation", r.rotation),
            ("rates.opacity_logit", r.opacity_logit),
            ("rates.f_dc", r.f_dc),
            ("rates.f_rest", r.f_rest),
            ("perspective.prune_above", of_perspective(|p| p.prune_above)),
            ("perspective.last_opacity_sum", of_perspective(|p| p.last_opacity_sum.unwrap_or_default())),
            ("satellite.appearance_rate", of_satellite(|s| s.appearance_rate)),
            ("satellite.half_resolution_px_m", of_satellite(|s| s.half_resolution_px_m)),
            ("satellite.white", of_satellite(|s| s.white.into())),
            ("satellite.virtual_shear", of_satellite(|s| s.virtual_shear)),
            ("densification.max_scale", of_densification(|g| g.max_scale.unwrap_or_default())),
            ("densification.max_radius", of_densification(|g| g.max_radius.unwrap_or_default())),
            ("densification.gradient", of_densification(|g| g.gradient)),
            ("densification.copy_below", of_densification(|g| g.copy_below)),
        ];
        let weights = self.weights.iter().map(|(name, value)| (format!("weights.{name}"), value));
        let numbers = numbers.into_iter().map(|(name, value)| (name.to_owned(), value));
        if let Some((name, value)) = numbers.chain(weights).find(|(_, v)| !(v.is_finite() && *v >= 0.0)) {
            return Err(format!("{name} = {value}, but must be a finite number of at least 0"));
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
        if self.satellite().is_some_and(|s| s.white == 0.0) {
            return Err("satellite.white = 0, but must be above 0".into());
        }
        if let Some(p) = self.perspective() {
            let (first, last) = (r.position, p.last_position_rate);
            if !(first > 0.0 && last > 0.0 && last.is_finite()) {
                return Err(format!(
                    "rates.position = {first} and perspective.last_position_rate = {last}, but both must be above 0"
                ));
            }
            if p.prune_above == 0.0 {
                return Err("perspective.prune_above = 0, but must be above 0".into());
            }
            if p.sh_degree > 3 {
                return Err(format!("perspective.sh_degree = {}, but must be from 0 to 3", p.sh_degree));
            }
        }
        if let Some((name, of)) = self.idle_weight() {
            return Err(format!("weights.{name} is above 0, but is of {of}"));
        }
        let unequal = self.densification.filter(|g| g.active.is_some());
        if unequal.is_some_and(|g| g.max_scale.is_some() || g.max_radius.is_some()) {
            return Err("densification.active is by gradients, without max_scale and max_radius".into());
        }
        let idle_rounds = unequal.and_then(|g| g.active).map_or(1, |growth| growth.idle_rounds);
        let counts = [
            ("densification.active.idle_rounds", idle_rounds.into()),
            ("perspective.sh_degree_every", self.perspective().map_or(1, |p| p.sh_degree_every)),
            ("iterations", self.iterations),
            ("satellite.virtual_every", self.satellite().map_or(1, |s| s.virtual_every)),
            ("check_every", self.check_every),
            ("reset.every", self.reset.map_or(1, |r| r.every)),
        ];
        if let Some((name, _)) = counts.into_iter().find(|(_, v)| *v == 0) {
            return Err(format!("{name} = 0, but must be at least 1"));
        }
        let Some(reset) = self.reset else { return Ok(()) };
        let pauses = [
            ("reset.opacity_loss_pause", reset.opacity_loss_pause),
            ("reset.densification_pause", reset.densification_pause),
        ];
        match pauses.into_iter().find(|(_, span)| *span >= reset.every) {
            Some((name, span)) => Err(format!("{name} = {span}, but must be less than reset.every")),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recipe_that_is_written_as_toml_is_read_back_equal() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mine.toml");
        for name in Recipe::NAMES {
            let recipe = Recipe::named(name).unwrap();
            std::fs::write(&path, recipe.to_toml()).unwrap();
            assert_eq!(Recipe::read(&path).unwrap(), recipe);
        }
    }

    #[test]
    fn an_invalid_recipe_is_refused_with_the_name_of_the_value_and_of_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bad.toml");
        let text = Recipe::named("baeogs").unwrap().to_toml();
        for (from, to, says) in [
            ("opacity_logit = 0.05", "opacity_logit = nan", "rates.opacity_logit = NaN"),
            ("gradient = 0.0006", "gradient = -1.0", "densification.gradient = -1"),
            ("prune_below = 0.0025", "prune_below = 0.0", "prune_below = 0,"),
            ("copy_below = 0.01", "copy_below = 0.01\nactive = { idle_rounds = 5 }", "densification.active"),
            ("virtual_every = 2", "virtual_every = 0", "satellite.virtual_every = 0"),
            ("check_every = 100", "check_every = 0", "check_every = 0"),
            ("densification_pause = 500", "densification_pause = 3000", "reset.densification_pause = 3000"),
            ("iterations = 5000", "iterations = 0", "iterations = 0"),
            ("white = 1.0", "white = 0.0", "satellite.white = 0"),
            ("shadow_entropy = 0.01", "shadow_entropy = -1.0", "weights.shadow_entropy = -1"),
            ("shadow_entropy = 0.01", "entropy = 0.01", "no loss term has the weight `entropy`"),
            ("start = \"points\"", "begin = \"points\"", "unknown field `begin`"),
            ("start = \"points\"", "start = \"sky\"", "line"),
            ("[satellite]", "[perspective]", "unknown field `appearance`"),
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
