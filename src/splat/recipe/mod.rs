//! A recipe: a named, complete set of training options.
//!
//! The papers scale the scene to the cube [-1, 1]³. Lengths marked *cube* are in half sides of that cube: multiplied by
//! half the diagonal of the area in metres, they are metres. In perspective scenes they are multiplied by the extent of the
//! cameras instead (3DGS).

mod file;
mod presets;

pub use file::RecipeError;

use crate::splat::appearance::AppearanceKind;
use crate::splat::loss::{LossWeights, SurfaceDepth};
use crate::splat::primitive::PrimitiveKind;
use crate::splat::splats::PerGroup;
use crate::splat::visibility::UncertaintyRecipe;
use serde::{Deserialize, Serialize};

/// Iterations for each of few training views, at most those of the recipe: fewer views converge in fewer iterations.
const ITERATIONS_PER_VIEW: u32 = 500;

/// How the splats are initialised.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Start {
    /// On the surface that dense stereo matching gives. That surface also refines the DSM after training; with the other
    /// initialisations the DSM comes from the splats alone.
    Surface,
    /// At the sparse points of the bundle adjustment, with a level ground plane of splats (BAEOGS §3.1).
    Points,
    /// Evenly in the volume over the area between the lowest and the highest altitude (EOGS).
    #[serde(rename = "box")]
    Volume,
}

/// Which altitude along a vertical ray through the splats becomes the height of the DSM.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RayHeight {
    /// The altitude at which the transmittance from above falls below one half.
    #[default]
    Median,
    /// The alpha-composited mean altitude, averaged over the cell and its eight neighbours; the remaining transmittance
    /// counts as the lowest altitude of the scene (EOGS).
    Mean,
}

/// Active growth: splats that have grown are replaced by four parts at once as long as the images ask for more (IndoorSplat
/// §4.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActiveGrowth {
    /// Number of checks without growth after which a splat is active no longer.
    pub idle_rounds: u8,
}

/// Densification: when and which splats are duplicated or split (BAEOGS §3.3, on gsplat's default strategy).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Densification {
    /// First iteration of densification.
    pub from: u32,
    /// Last iteration of densification.
    pub until: u32,
    /// Splats with a larger scale (the largest of the three) are densified, *cube* half sides.
    pub max_scale: Option<f64>,
    /// Splats with a larger projected radius are densified, as a fraction of the longer image side.
    pub max_radius: Option<f64>,
    /// Splats with a larger mean norm of the gradient by the 2-D mean are densified; per half image side.
    pub gradient: f64,
    /// Splats with a smaller scale are duplicated, larger ones are split in two, *cube* half sides.
    pub copy_below: f64,
    /// Largest number of splats.
    pub max_splats: u32,
    /// Active growth; splats grow equally if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub active: Option<ActiveGrowth>,
}

/// Opacity resets (BAEOGS §3.3).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OpacityReset {
    /// Iterations between resets.
    pub every: u32,
    /// Opacities above this are lowered to it.
    pub opacity: f64,
    /// Number of iterations after a reset without the opacity loss.
    pub opacity_loss_pause: u32,
    /// Number of iterations after a reset without densification and pruning.
    pub densification_pause: u32,
    /// Iteration from which on there are no more resets; by default the last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until: Option<u32>,
}

/// The colour behind the splats while a perspective scene is trained.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Background {
    /// Black in every iteration.
    #[default]
    Black,
    /// A random colour in every iteration, so that splats cover whatever the images cover.
    Random,
}

/// The points that training of a perspective scene starts from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum StartPoints {
    /// Those of the scene, else those of its depth maps, else random ones.
    #[default]
    Scene,
    /// Those of the scene, and more in patches of views that have few, by priors of depths (IndoorSplat §4.1).
    Patches,
    /// One for each pixel, by priors of depths that are aligned with the points of the scene (GeoProp-GS §3.1, HDD).
    Hdd,
    /// As `hdd`, and anchored ones where no view sees anything (GeoProp-GS §3.2, GVA).
    Gva,
}

impl StartPoints {
    /// Whether priors of depths are used.
    #[must_use]
    pub fn needs_depths(self) -> bool {
        self != Self::Scene
    }

    /// Whether the start itself aligns priors of depths with the scene, each view on its own (HDD).
    #[must_use]
    pub fn aligns_depths(self) -> bool {
        matches!(self, Self::Hdd | Self::Gva)
    }
}

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

/// Learning rates of Adam for the networks of a colour model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetworkRates {
    /// Of the tables of the position encoding.
    pub tables: f64,
    /// Of the network that tones colours; 0 for colours that differ only by light.
    pub tone: f64,
    /// Of the networks of shadows and sky; 0 for colours without shadows.
    pub shadow: f64,
}

/// A named, complete set of training options.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Name of the recipe.
    pub name: String,
    /// Number of iterations. The recipe's other iteration numbers scale with it ([`Recipe::with_iterations`]).
    pub iterations: u32,
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
    /// The kind of splats: `3d` for ellipsoids, `2d` for flat discs.
    #[serde(default, skip_serializing_if = "PrimitiveKind::is_default")]
    pub primitive: PrimitiveKind,
    /// How the splats are initialised.
    pub start: Start,
    /// Learning rates of Adam for each parameter group of the splats. That of positions is in *cube* half sides (EOGS:
    /// 0.00016 times its radius of 2.2).
    pub rates: PerGroup<f64>,
    /// Learning rate of Adam for the parameters of the colour model.
    pub appearance_rate: f64,
    /// Learning rates of Adam for the networks of the colour model; none for models without networks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub network_rates: Option<NetworkRates>,
    /// Weights of the loss terms by name; absent ones are zero. EOGS's `L_opacity` is `opacity`, `L_new_altitude` and
    /// `L_new_rgb` are `consistency_altitude` (per metre) and `consistency_color`, and `L_translucentshadows` is
    /// `shadow_entropy`. `surface_prior` is not in the papers; it needs an initialisation on the matched surface.
    pub weights: LossWeights,
    /// The colour model.
    #[serde(default)]
    pub appearance: AppearanceKind,
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
    /// Number of iterations between checks, at which splats are pruned and densified.
    pub check_every: u32,
    /// Densification; none if absent.
    pub densification: Option<Densification>,
    /// Splats with a smaller opacity are removed at checks (BAEOGS: 0.0025), in perspective scenes at those with densification (3DGS).
    pub prune_below: f64,
    /// Which altitude becomes the DSM's height, where the DSM comes from the splats alone.
    #[serde(default)]
    pub heights: RayHeight,
    /// Opacity resets; none if absent.
    pub reset: Option<OpacityReset>,
    /// What only recipes of perspective scenes have; none in those of satellite scenes. Of the values above, those of half
    /// resolution, white, colour model, shadows and virtual views are not used in perspective scenes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub perspective: Option<PerspectiveRecipe>,
    /// How pixels that other images do not confirm are left out; all count alike if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uncertainty: Option<UncertaintyRecipe>,
    /// A second training, of the colours for novel views, from the splats of this one; none if absent. Height products come
    /// from this training in any case.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub then: Option<Box<Recipe>>,
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

impl Recipe {
    /// The recipe for this number of training views: at most 500 iterations for each view, if it initialises the splats on the
    /// matched surface and the views are few, and, of photographs, if it adds no splats: it learns few views by heart.
    #[must_use]
    pub fn for_views(self, views: usize) -> Self {
        let is_few = match self.perspective {
            None => self.start == Start::Surface && views <= crate::mvs::FEW_VIEWS,
            Some(_) => self.densification.is_none(),
        };
        let enough = ITERATIONS_PER_VIEW * views.max(1) as u32;
        if is_few && enough < self.iterations { self.with_iterations(enough) } else { self }
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
        let at_least_one = |t: u32| scale(t).max(1);
        let densification =
            self.densification.map(|g| Densification { from: scale(g.from), until: scale(g.until), ..g });
        let reset = self.reset.map(|r| OpacityReset {
            every: if self.perspective.is_some() { r.every } else { at_least_one(r.every) },
            opacity_loss_pause: scale(r.opacity_loss_pause),
            densification_pause: scale(r.densification_pause),
            until: r.until.map(scale),
            ..r
        });
        let uncertainty = self.uncertainty.map(|u| UncertaintyRecipe {
            from: scale(u.from),
            full_from: scale(u.full_from),
            ..u
        });
        let perspective = self.perspective.map(|p| PerspectiveRecipe {
            sh_degree_every: at_least_one(p.sh_degree_every),
            normals_from: scale(p.normals_from),
            distortion_from: scale(p.distortion_from),
            priors_from: scale(p.priors_from),
            ..p
        });
        Self {
            iterations,
            half_resolution_until: scale(self.half_resolution_until),
            shadows_from: scale(self.shadows_from),
            densification,
            reset,
            perspective,
            uncertainty,
            then: self.then.as_ref().map(|then| Box::new(then.with_iterations(scale(then.iterations)))),
            ..self.clone()
        }
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
