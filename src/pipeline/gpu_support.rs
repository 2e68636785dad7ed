//! What GPUs can train.

use crate::splat::appearance::AppearanceKind;
use crate::splat::primitive::PrimitiveKind;
use crate::splat::recipe::{OfScene, Recipe, SatelliteRecipe};

/// Weights of the loss terms that a GPU computes.
const TERMS_ON_GPU: [&str; 6] = [
    "opacity",
    "opacity_sum",
    "consistency_altitude",
    "consistency_color",
    "shadow_entropy",
    "surface_prior",
];

/// What a recipe of satellite scenes has that GPUs cannot do.
pub fn unsupported_heights(recipe: &Recipe<SatelliteRecipe>) -> Option<String> {
    if recipe.kind.appearance != AppearanceKind::Affine {
        return Some("GPUs do not train the networks of SatGS's colours".into());
    }
    if recipe.kind.uncertainty.is_some() {
        return Some("GPUs do not compare images to find pixels that others do not confirm".into());
    }
    unsupported_recipe(recipe, &TERMS_ON_GPU)
}

/// What a recipe has that GPUs cannot do, if they compute the loss terms with these weights.
pub fn unsupported_recipe<K: OfScene>(recipe: &Recipe<K>, terms: &[&str]) -> Option<String> {
    if recipe.primitive != PrimitiveKind::Ellipsoid {
        return Some("GPUs train ellipsoids only, not flat discs".into());
    }
    let mut others = recipe.weights.iter().filter(|(name, _)| !terms.contains(name));
    let (name, _) = others.find(|(_, weight)| *weight != 0.0)?;
    Some(format!("GPUs do not compute the loss term `{name}`"))
}
