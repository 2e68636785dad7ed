//! A recipe: a named, complete set of training options.
//!
//! The papers scale the scene to the cube [-1, 1]³. Lengths marked *cube* are in half sides of that cube: multiplied by
//! half the diagonal of the area in metres, they are metres. In perspective scenes they are multiplied by the extent of the
//! cameras instead (3DGS).

mod file;
mod parts;
mod presets;

pub use file::RecipeError;
pub use parts::{
    ActiveGrowth, Background, Densification, NetworkRates, OpacityReset, RayHeight, Start, StartPoints,
};

use crate::splat::appearance::AppearanceKind;
use crate::splat::loss::{LossWeights, SurfaceDepth};
use crate::splat::primitive::PrimitiveKind;
use crate::splat::splats::PerGroup;
use crate::splat::visibility::UncertaintyRecipe;
use serde::{Deserialize, Serialize};

/// Iterations for each of few training views, at most those of the recipe: fewer views converge in fewer iterations.
const ITERATIONS_PER_VIEW: u32 = 500;

/// What only recipes of perspective scenes have.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PerspectiveRecipe {
    /// Learning rate of positions at the last iteration, *cube* half sides; it decays exponentially from `rates.position`.
    pub last_position_rate: f64,
    /// Highest degree of the spherical harmonics, 0 to 3.
    pub sh_degree: u32,
    /// Number of iterations after which the degree that is used rises by one, from 0.
    pub sh_degree_every: u32,
    /// Splats with a larger scale are removed while there is densification after the first opacity reset, *cube* half sides.
    pub prune_above: f64,
    /// The colour behind the splats.
    #[serde(default)]
    pub background: Background,
    /// Which depth of discs is the surface's, for the consistency with normals.
    #[serde(default)]
    pub surface: SurfaceDepth,
    /// First iteration with the loss term `normal_consistency` of discs.
    #[serde(default)]
    pub normals_from: u32,
    /// First iteration with the loss term `depth_distortion` of discs.
    #[serde(default)]
    pub distortion_from: u32,
    /// First iteration with the loss terms that compare with priors: `depth_prior`, `depth_smoothness` and, of discs,
    /// `normal_prior`.
    #[serde(default)]
    pub priors_from: u32,
    /// The points to start from.
    #[serde(default)]
    pub start_points: StartPoints,
    /// Weight of the loss term `opacity_sum` at the last iteration, to which it goes linearly; that of the first if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last_opacity_sum: Option<f64>,
}

impl PerspectiveRecipe {
    /// Names of weights, and the first iteration with each.
    #[must_use]
    pub fn weights_from(&self) -> [(&'static str, u32); 5] {
        [
            ("normal_consistency", self.normals_from),
            ("depth_distortion", self.distortion_from),
            ("depth_prior", self.priors_from),
            ("depth_smoothness", self.priors_from),
            ("normal_prior", self.priors_from),
        ]
    }
}

/// What only recipes of satellite scenes have.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SatelliteRecipe {
    /// How the splats are initialised.
    pub start: Start,
    /// Number of iterations at half the images' resolution, before those at full resolution.
    pub half_resolution_until: u32,
    /// Largest pixel size at half resolution, metres. Where it would be exceeded, all iterations are at full resolution:
    /// narrow trees and roof edges that half resolution loses do not come back.
    #[serde(default = "widest_half_resolution_px_m")]
    pub half_resolution_px_m: f64,
    /// Linear value of white in images that are not stored linearly. A smaller value makes the photometric loss smaller,
    /// so that the opacity loss weighs more.
    #[serde(default = "white")]
    pub white: f32,
    /// The colour model.
    #[serde(default)]
    pub appearance: AppearanceKind,
    /// Learning rate of Adam for the parameters of the colour model.
    pub appearance_rate: f64,
    /// Learning rates of Adam for the networks of the colour model; none for models without networks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub network_rates: Option<NetworkRates>,
    /// Whether the opacity loss divides the sum of opacities by the initial number of splats (EOGS) instead of the current
    /// number (BAEOGS).
    pub opacity_by_start: bool,
    /// Number of iterations before shadows and the consistency loss are used (EOGS: 1000).
    pub shadows_from: u32,
    /// Largest shear of the virtual view, half image sides per metre of altitude (EOGS: 0.01). A virtual view is the
    /// training view's camera with a random shear, for the consistency loss; none is rendered if that has no weight.
    pub virtual_shear: f64,
    /// A virtual view is rendered once in this number of iterations, and the consistency loss is multiplied by the number.
    #[serde(default = "always")]
    pub virtual_every: u32,
    /// Which altitude becomes the DSM's height, where the DSM comes from the splats alone.
    #[serde(default)]
    pub heights: RayHeight,
    /// How pixels that other images do not confirm are left out; all count alike if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uncertainty: Option<UncertaintyRecipe>,
    /// A second training, of the colours for novel views, from the splats of this one; none if absent. Height products come
    /// from this training in any case.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub then: Option<Box<Recipe<SatelliteRecipe>>>,
}

/// The kind of scene that a recipe trains, with the options that only recipes of this kind have.
#[derive(Clone, Debug, PartialEq)]
pub enum RecipeKind {
    /// Satellite images.
    Satellite(SatelliteRecipe),
    /// Photographs.
    Perspective(PerspectiveRecipe),
}

/// A named, complete set of training options: of any scene, or of the one kind `K`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RecipeFile", into = "RecipeFile")]
#[serde(bound = "K: OfScene")]
pub struct Recipe<K: OfScene = RecipeKind> {
    /// Name of the recipe.
    pub name: String,
    /// Number of iterations. The recipe's other iteration numbers scale with it ([`Recipe::with_iterations`]).
    pub iterations: u32,
    /// The kind of splats: `3d` for ellipsoids, `2d` for flat discs.
    pub primitive: PrimitiveKind,
    /// Learning rates of Adam for each parameter group of the splats. That of positions is in *cube* half sides (EOGS:
    /// 0.00016 times its radius of 2.2).
    pub rates: PerGroup<f64>,
    /// Weights of the loss terms by name; absent ones are zero. EOGS's `L_opacity` is `opacity`, `L_new_altitude` and
    /// `L_new_rgb` are `consistency_altitude` (per metre) and `consistency_color`, and `L_translucentshadows` is
    /// `shadow_entropy`. `surface_prior` is not in the papers; it needs an initialisation on the matched surface.
    pub weights: LossWeights,
    /// Number of iterations between checks, at which splats are pruned and densified.
    pub check_every: u32,
    /// Densification; none if absent.
    pub densification: Option<Densification>,
    /// Splats with a smaller opacity are removed at checks (BAEOGS: 0.0025), in perspective scenes at those with densification (3DGS).
    pub prune_below: f64,
    /// Opacity resets; none if absent.
    pub reset: Option<OpacityReset>,
    /// What depends on the kind of scene.
    pub kind: K,
}

/// The options that depend on the kind of scene: [`SatelliteRecipe`], [`PerspectiveRecipe`], or [`RecipeKind`], one of the two.
pub trait OfScene: Clone {
    /// Those of a kind; none if they are of another.
    fn of(kind: RecipeKind) -> Option<Self>;

    /// The options with the kind that they are of.
    fn kind(self) -> RecipeKind;

    /// Those of satellite scenes; none of other scenes.
    fn satellite(&self) -> Option<&SatelliteRecipe> {
        None
    }

    /// Those of perspective scenes; none of other scenes.
    fn perspective(&self) -> Option<&PerspectiveRecipe> {
        None
    }

    /// Whether so few training views need fewer iterations, of a recipe that adds splats or does not.
    fn are_few(&self, views: usize, adds_splats: bool) -> bool;

    /// The same options with all iteration numbers scaled.
    #[must_use]
    fn scaled(&self, scale: &dyn Fn(u32) -> u32) -> Self;
}

impl OfScene for SatelliteRecipe {
    fn of(kind: RecipeKind) -> Option<Self> {
        if let RecipeKind::Satellite(satellite) = kind { Some(satellite) } else { None }
    }

    fn kind(self) -> RecipeKind {
        RecipeKind::Satellite(self)
    }

    fn satellite(&self) -> Option<&SatelliteRecipe> {
        Some(self)
    }

    fn are_few(&self, views: usize, _: bool) -> bool {
        self.start == Start::Surface && views <= crate::mvs::FEW_VIEWS
    }

    fn scaled(&self, scale: &dyn Fn(u32) -> u32) -> Self {
        Self {
            half_resolution_until: scale(self.half_resolution_until),
            shadows_from: scale(self.shadows_from),
            uncertainty: self.uncertainty.map(|u| UncertaintyRecipe {
                from: scale(u.from),
                full_from: scale(u.full_from),
                ..u
            }),
            then: self.then.as_ref().map(|then| Box::new(then.with_iterations(scale(then.iterations)))),
            ..self.clone()
        }
    }
}

impl OfScene for PerspectiveRecipe {
    fn of(kind: RecipeKind) -> Option<Self> {
        if let RecipeKind::Perspective(perspective) = kind { Some(perspective) } else { None }
    }

    fn kind(self) -> RecipeKind {
        RecipeKind::Perspective(self)
    }

    fn perspective(&self) -> Option<&PerspectiveRecipe> {
        Some(self)
    }

    fn are_few(&self, _: usize, adds_splats: bool) -> bool {
        !adds_splats
    }

    fn scaled(&self, scale: &dyn Fn(u32) -> u32) -> Self {
        Self {
            sh_degree_every: scale(self.sh_degree_every).max(1),
            normals_from: scale(self.normals_from),
            distortion_from: scale(self.distortion_from),
            priors_from: scale(self.priors_from),
            ..*self
        }
    }
}

impl OfScene for RecipeKind {
    fn of(kind: RecipeKind) -> Option<Self> {
        Some(kind)
    }

    fn kind(self) -> RecipeKind {
        self
    }

    fn satellite(&self) -> Option<&SatelliteRecipe> {
        if let Self::Satellite(satellite) = self { Some(satellite) } else { None }
    }

    fn perspective(&self) -> Option<&PerspectiveRecipe> {
        if let Self::Perspective(perspective) = self { Some(perspective) } else { None }
    }

    fn are_few(&self, views: usize, adds_splats: bool) -> bool {
        match self {
            Self::Satellite(satellite) => satellite.are_few(views, adds_splats),
            Self::Perspective(perspective) => perspective.are_few(views, adds_splats),
        }
    }

    fn scaled(&self, scale: &dyn Fn(u32) -> u32) -> Self {
        match self {
            Self::Satellite(satellite) => Self::Satellite(satellite.scaled(scale)),
            Self::Perspective(perspective) => Self::Perspective(perspective.scaled(scale)),
        }
    }
}

/// A recipe as a file has it: the kind of scene is told by which of the tables `[satellite]` and `[perspective]` is there.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RecipeFile {
    name: String,
    iterations: u32,
    #[serde(default, skip_serializing_if = "PrimitiveKind::is_default")]
    primitive: PrimitiveKind,
    check_every: u32,
    prune_below: f64,
    rates: PerGroup<f64>,
    weights: LossWeights,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    satellite: Option<SatelliteRecipe>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    perspective: Option<PerspectiveRecipe>,
    densification: Option<Densification>,
    reset: Option<OpacityReset>,
}

impl<K: OfScene> TryFrom<RecipeFile> for Recipe<K> {
    type Error = &'static str;

    fn try_from(file: RecipeFile) -> Result<Self, Self::Error> {
        let RecipeFile { name, iterations, primitive, check_every, prune_below, rates, weights, .. } = file;
        let RecipeFile { densification, reset, satellite, perspective, .. } = file;
        let kind = match (satellite, perspective) {
            (Some(satellite), None) => RecipeKind::Satellite(satellite),
            (None, Some(perspective)) => RecipeKind::Perspective(perspective),
            _ => return Err("expected either the table [satellite] or the table [perspective]"),
        };
        let kind = K::of(kind).ok_or("the recipe is of the other kind of scene")?;
        Ok(Self {
            name,
            iterations,
            primitive,
            rates,
            weights,
            check_every,
            densification,
            prune_below,
            reset,
            kind,
        })
    }
}

impl<K: OfScene> From<Recipe<K>> for RecipeFile {
    fn from(recipe: Recipe<K>) -> Self {
        let Recipe { name, iterations, primitive, rates, weights, check_every, .. } = recipe;
        let Recipe { densification, prune_below, reset, kind, .. } = recipe;
        let (satellite, perspective) = match kind.kind() {
            RecipeKind::Satellite(satellite) => (Some(satellite), None),
            RecipeKind::Perspective(perspective) => (None, Some(perspective)),
        };
        Self {
            name,
            iterations,
            primitive,
            check_every,
            prune_below,
            rates,
            weights,
            densification,
            reset,
            satellite,
            perspective,
        }
    }
}

/// Images of 0.35 m (0.7 m at half resolution) gain from half resolution, and images of 0.5 m (1 m) do not; this value
/// lies between.
fn widest_half_resolution_px_m() -> f64 {
    0.9
}

/// The largest linear value of an image.
fn white() -> f32 {
    1.0
}

/// A virtual view in every iteration.
fn always() -> u32 {
    1
}

impl<K: OfScene> Recipe<K> {
    /// What only recipes of satellite scenes have; none of other recipes.
    #[must_use]
    pub fn satellite(&self) -> Option<&SatelliteRecipe> {
        self.kind.satellite()
    }

    /// What only recipes of perspective scenes have; none of other recipes.
    #[must_use]
    pub fn perspective(&self) -> Option<&PerspectiveRecipe> {
        self.kind.perspective()
    }

    /// The recipe for this number of training views: at most 500 iterations for each view, if it initialises the splats on the
    /// matched surface and the views are few, and, of photographs, if it adds no splats: it learns few views by heart.
    #[must_use]
    pub fn for_views(self, views: usize) -> Self {
        let enough = ITERATIONS_PER_VIEW * views.max(1) as u32;
        let is_few = self.kind.are_few(views, self.densification.is_some());
        if is_few && enough < self.iterations { self.with_iterations(enough) } else { self }
    }

    /// The recipe with these options of its kind of scene.
    #[must_use]
    pub fn with_kind<L: OfScene>(self, kind: L) -> Recipe<L> {
        let Self { name, iterations, primitive, rates, weights, check_every, .. } = self;
        let Self { densification, prune_below, reset, .. } = self;
        Recipe {
            name,
            iterations,
            primitive,
            rates,
            weights,
            check_every,
            densification,
            prune_below,
            reset,
            kind,
        }
    }

    /// The recipe as one of the kind `L` of scenes; none if it is of another.
    #[must_use]
    pub fn of_kind<L: OfScene>(self) -> Option<Recipe<L>> {
        let kind = L::of(self.kind.clone().kind())?;
        Some(self.with_kind(kind))
    }

    /// The recipe as one of any scene.
    #[must_use]
    pub fn of_any(self) -> Recipe {
        let kind = self.kind.clone().kind();
        self.with_kind(kind)
    }

    /// The same recipe with all iteration numbers scaled to another total.
    ///
    /// The interval between checks is not scaled: the gradient statistics need that number of views, and with a shorter
    /// interval splats that have not converged yet would be densified at every check. Nor is the interval between opacity
    /// resets of perspective scenes, whose splats need that many iterations to become opaque again.
    #[must_use]
    pub fn with_iterations(&self, iterations: u32) -> Self {
        let scale =
            |t: u32| (u64::from(t) * u64::from(iterations) / u64::from(self.iterations.max(1))) as u32;
        let densification =
            self.densification.map(|g| Densification { from: scale(g.from), until: scale(g.until), ..g });
        let is_photographed = self.perspective().is_some();
        let reset = self.reset.map(|r| OpacityReset {
            every: if is_photographed { r.every } else { scale(r.every).max(1) },
            opacity_loss_pause: scale(r.opacity_loss_pause),
            densification_pause: scale(r.densification_pause),
            until: r.until.map(scale),
            ..r
        });
        Self { iterations, densification, reset, kind: self.kind.scaled(&scale), ..self.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_views_take_fewer_iterations() {
        let iterations = |name: &str, views| Recipe::named(name).unwrap().for_views(views).iterations;
        assert_eq!([3, 6, 10, 40].map(|views| iterations("geoprop", views)), [1500, 3000, 5000, 10_000]);
        assert_eq!([2, 3, 12].map(|views| iterations("best", views)), [1000, 1500, 4000]);
        // What grows finds more to learn.
        assert_eq!(iterations("3dgs", 3), 30_000);
    }
}
