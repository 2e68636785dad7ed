//! What GPUs can train.

use crate::splat::appearance::AppearanceKind;
use crate::splat::primitive::PrimitiveKind;
use crate::splat::recipe::{OfScene, Recipe, SatelliteRecipe};

/// Weights of the loss terms that a GPU computes of satellite scenes.
const TERMS_OF_SATELLITES: [&str; 6] = [
    "opacity",
    "opacity_sum",
    "consistency_altitude",
    "consistency_color",
    "shadow_entropy",
    "surface_prior",
];
/// The same of photographs.
const TERMS_OF_PHOTOGRAPHS: [&str; 3] = ["opacity", "opacity_sum", "normal_consistency"];

/// What a recipe of satellite scenes has that GPUs cannot do.
pub fn unsupported_heights(recipe: &Recipe<SatelliteRecipe>) -> Option<String> {
    if recipe.kind.appearance != AppearanceKind::Affine {
        return Some("GPUs do not train the networks of SatGS's colours".into());
    }
    if recipe.kind.uncertainty.is_some() {
        return Some("GPUs do not compare images to find pixels that others do not confirm".into());
    }
    if recipe.primitive != PrimitiveKind::Ellipsoid {
        return Some("GPUs train ellipsoids only from satellite images, not flat discs".into());
    }
    unsupported_terms(recipe, &TERMS_OF_SATELLITES)
}

/// What a recipe of photographs has that GPUs cannot do.
pub fn unsupported_photographs(recipe: &Recipe) -> Option<String> {
    unsupported_terms(recipe, &TERMS_OF_PHOTOGRAPHS)
}

/// A loss term of a recipe that GPUs do not compute, if they compute those with these weights.
fn unsupported_terms<K: OfScene>(recipe: &Recipe<K>, terms: &[&str]) -> Option<String> {
    let mut others = recipe.weights.iter().filter(|(name, _)| !terms.contains(name));
    let (name, _) = others.find(|(_, weight)| *weight != 0.0)?;
    Some(format!("GPUs do not compute the loss term `{name}`"))
}
