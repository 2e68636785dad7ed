//! The recipes that come with the program: `best`, `baeogs` and `eogs` after the papers, and `satgs`, which trains colours after
//! `best`, for satellite scenes, in a quarter of the time as `satgs-fast`; `3dgs`, `2dgs`, `indoor` and `geoprop` for perspective scenes.

use super::{
    ActiveGrowth, Background, Densification, NetworkRates, OpacityReset, PerspectiveRecipe, RayHeight,
    Recipe, SatelliteRecipe, Start, StartPoints, always, white, widest_half_resolution_px_m,
};
use crate::splat::appearance::AppearanceKind;
use crate::splat::loss::{LossWeights, SurfaceDepth};
use crate::splat::primitive::PrimitiveKind;
use crate::splat::splats::PerGroup;
use crate::splat::visibility::{UncertaintyModel, UncertaintyRecipe};

/// Iterations of recipe `best`. The papers have 5000; an initialisation on the matched surface needs fewer.
const BEST_ITERATIONS: u32 = 4000;
/// Iterations of the colours of recipe `satgs-fast`.
const FAST_ITERATIONS: u32 = 1500;
/// The opacity whose logit is -6 (EOGS).
const EOGS_PRUNES_BELOW: f64 = 0.002_472_6;

/// Weights of the loss terms (EOGS).
const EOGS_WEIGHTS: [(&str, f64); 4] =
    [("opacity", 0.1), ("consistency_altitude", 0.01), ("consistency_color", 0.1), ("shadow_entropy", 0.01)];

/// `others` with the named weights replaced.
fn weights(others: LossWeights, named: &[(&str, f64)]) -> LossWeights {
    others.with(named).expect("the terms of the built-in recipes are registered")
}

/// A name, and a recipe that [`Recipe::named`] gives this name.
type BuiltIn = (&'static str, fn() -> Recipe);

/// The recipes that come with the program; the first is the default.
const BUILT_IN: [BuiltIn; 9] = [
    ("best", || best().of_any()),
    ("baeogs", || baeogs().of_any()),
    ("eogs", || eogs().of_any()),
    ("satgs", || satgs(satgs_colors()).of_any()),
    ("satgs-fast", || satgs(satgs_colors().with_iterations(FAST_ITERATIONS)).of_any()),
    ("3dgs", || three_d_gaussians().of_any()),
    ("2dgs", || two_d_gaussians().of_any()),
    ("indoor", || indoor().of_any()),
    ("geoprop", || geoprop().of_any()),
];

impl Recipe {
    /// Names of the recipes that come with the program; the first is the default.
    pub const NAMES: [&'static str; BUILT_IN.len()] = {
        let mut names = [""; BUILT_IN.len()];
        let mut k = 0;
        while k < names.len() {
            names[k] = BUILT_IN[k].0;
            k += 1;
        }
        names
    };
    /// The default recipe of perspective scenes.
    pub const OF_PERSPECTIVE_SCENES: &'static str = "3dgs";

    /// The recipe of this name; none if there is no such recipe.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        let (name, make) = BUILT_IN.iter().find(|built_in| built_in.0 == name)?;
        Some(Self { name: (*name).into(), ..make() })
    }
}

/// Zhang et al., BAEOGS.
#[allow(clippy::needless_update, reason = "a new parameter group has a rate of 0 until it is given one")]
fn baeogs() -> Recipe<SatelliteRecipe> {
    Recipe {
        name: String::new(),
        iterations: 5000,
        primitive: PrimitiveKind::Ellipsoid,
        rates: PerGroup {
            position: 0.000_16 * 2.22,
            log_scale: 0.005,
            rotation: 0.001,
            opacity_logit: 0.05,
            f_dc: 0.0025,
            ..PerGroup::default()
        },
        weights: weights(LossWeights::default(), &EOGS_WEIGHTS),
        check_every: 100,
        densification: Some(Densification {
            from: 500,
            until: 4000,
            max_scale: Some(0.03),
            max_radius: Some(0.15),
            gradient: 0.0006,
            copy_below: 0.01,
            max_splats: 2_000_000,
            active: None,
        }),
        prune_below: 0.0025,
        // The paper does not give these intervals. If the opacity loss returns before the rendered images have
        // recovered from the reset, it removes splats that they need.
        reset: Some(OpacityReset {
            every: 3000,
            opacity: 0.005,
            opacity_loss_pause: 1000,
            densification_pause: 500,
            until: None,
        }),
        kind: SatelliteRecipe {
            start: Start::Points,
            // Half resolution and a virtual view in every second iteration only save time: the paper trains at full
            // resolution with a virtual view in every iteration.
            half_resolution_until: 3500,
            half_resolution_px_m: widest_half_resolution_px_m(),
            white: white(),
            appearance: AppearanceKind::Affine,
            appearance_rate: 0.01,
            network_rates: None,
            opacity_by_start: false,
            shadows_from: 1000,
            virtual_shear: 0.01,
            virtual_every: 2,
            heights: RayHeight::Mean,
            uncertainty: None,
            then: None,
        },
    }
}

/// EOGS, which prunes in every iteration. Splats are invisible below the alpha cut-off of 1/255, before their opacity falls to
/// the value of this recipe, so that pruning every 100 iterations changes nothing.
fn eogs() -> Recipe<SatelliteRecipe> {
    let baeogs = baeogs();
    Recipe {
        densification: None,
        prune_below: EOGS_PRUNES_BELOW,
        reset: None,
        kind: SatelliteRecipe {
            start: Start::Volume,
            half_resolution_until: 0,
            // With this value the mean colour of the DFC2019 images is 0.15. That of the images which EOGS published
            // is 0.13 to 0.2, judged by the first losses of an independent reproduction.
            white: 0.4,
            opacity_by_start: true,
            virtual_every: always(),
            ..baeogs.kind
        },
        ..baeogs
    }
}

/// Our own: BAEOGS on the matched surface.
fn best() -> Recipe<SatelliteRecipe> {
    let baeogs = baeogs();
    let best = Recipe {
        // Without the prior, splats on roofs without texture drift in altitude.
        weights: weights(baeogs.weights, &[("surface_prior", 0.1)]),
        reset: None,
        kind: SatelliteRecipe { start: Start::Surface, heights: RayHeight::Median, ..baeogs.kind },
        ..baeogs
    };
    best.with_iterations(BEST_ITERATIONS)
}

/// Bai et al., SatGS, 2025: heights by `best`, then colours.
fn satgs(colors: Recipe<SatelliteRecipe>) -> Recipe<SatelliteRecipe> {
    let best = best();
    let kind = SatelliteRecipe { then: Some(Box::new(colors)), ..best.kind };
    Recipe { kind, ..best }
}

/// The training of colours of recipe `satgs`, from the splats of a training for heights.
#[allow(clippy::needless_update, reason = "a new parameter group has a rate of 0 until it is given one")]
fn satgs_colors() -> Recipe<SatelliteRecipe> {
    let (iterations, heights) = (6000, best());
    let named =
        [("sun_visibility", 1.0), ("dark_tones", 1.0), ("bright_shadows", 1.0), ("perceptual", 0.005)];
    Recipe {
        name: "satgs-colors".into(),
        iterations,
        rates: PerGroup { position: 3e-5, opacity_logit: 0.02, ..heights.rates },
        weights: weights(LossWeights::default(), &named),
        densification: Some(Densification {
            from: 300,
            until: 4000,
            max_scale: None,
            max_radius: None,
            gradient: 0.0002,
            copy_below: 0.002,
            max_splats: 500_000,
            active: None,
        }),
        prune_below: 0.005,
        kind: SatelliteRecipe {
            half_resolution_until: 0,
            appearance: AppearanceKind::SatGs,
            appearance_rate: 1e-3,
            network_rates: Some(NetworkRates { tables: 1e-2, tone: 5e-4, shadow: 5e-4 }),
            shadows_from: 0,
            virtual_every: always(),
            uncertainty: Some(UncertaintyRecipe {
                model: UncertaintyModel::Closed,
                // The paper begins at 35,000 of about 70,000 iterations, and has all of it after 40,000.
                from: 7 * iterations / 20,
                full_from: 2 * iterations / 5,
                prior: 0.5,
                visible: 0.15,
            }),
            ..heights.kind
        },
        ..heights
    }
}

/// Kerbl et al., 3D Gaussian Splatting for Real-Time Radiance Field Rendering, 2023, with the values of the authors' program.
/// It also removes splats that cover more than 20 px, but forgets what they cover before it looks; so this does not.
#[allow(clippy::needless_update, reason = "a new parameter group has a rate of 0 until it is given one")]
fn three_d_gaussians() -> Recipe<PerspectiveRecipe> {
    let densified_until = 15_000;
    Recipe {
        name: String::new(),
        iterations: 30_000,
        primitive: PrimitiveKind::Ellipsoid,
        rates: PerGroup {
            position: 1.6e-4,
            log_scale: 0.005,
            rotation: 0.001,
            opacity_logit: 0.05,
            f_dc: 0.0025,
            f_rest: 0.0025 / 20.0,
            ..PerGroup::default()
        },
        weights: LossWeights::default(),
        check_every: 100,
        densification: Some(Densification {
            from: 600,
            until: densified_until - 1,
            max_scale: None,
            max_radius: None,
            gradient: 0.0002,
            copy_below: 0.01,
            max_splats: 2_000_000,
            active: None,
        }),
        prune_below: 0.005,
        reset: Some(OpacityReset {
            every: 3000,
            opacity: 0.01,
            opacity_loss_pause: 0,
            densification_pause: 0,
            until: Some(densified_until),
        }),
        kind: PerspectiveRecipe {
            last_position_rate: 1.6e-6,
            sh_degree: 3,
            sh_degree_every: 1000,
            prune_above: 0.1,
            background: Background::Black,
            surface: SurfaceDepth::Mean,
            normals_from: 0,
            distortion_from: 0,
            priors_from: 0,
            start_points: StartPoints::Scene,
            last_opacity_sum: None,
        },
    }
}

/// Huang et al., 2D Gaussian Splatting for Geometrically Accurate Radiance Fields, 2024, with the values of the authors' program,
/// but also from points in parts of views that have few: in an office with plain walls they gain 2.8 dB in 1,000 iterations.
fn two_d_gaussians() -> Recipe<PerspectiveRecipe> {
    let volumes = three_d_gaussians();
    Recipe {
        primitive: PrimitiveKind::Disc,
        weights: weights(volumes.weights, &[("normal_consistency", 0.05)]),
        prune_below: 0.05,
        kind: PerspectiveRecipe {
            normals_from: 7000,
            distortion_from: 3000,
            start_points: StartPoints::Patches,
            ..volumes.kind
        },
        ..volumes
    }
}

/// IndoorSplat, with the values of the paper where it gives them: flat discs that follow priors of depths and normals, and grow
/// while active; the sum of opacities takes the place of resets.
fn indoor() -> Recipe<PerspectiveRecipe> {
    let discs = two_d_gaussians();
    let (depths, normals, evenness) = (0.2, 0.05, 1.0);
    let named = [
        ("depth_prior", depths),
        ("depth_smoothness", depths * evenness),
        ("normal_prior", normals),
        ("opacity_sum", 1e-10),
    ];
    Recipe {
        weights: weights(discs.weights, &named),
        // The paper says that a prolonged time without growth ends the activity of a splat, not how long it is.
        densification: discs
            .densification
            .map(|g| Densification { active: Some(ActiveGrowth { idle_rounds: 5 }), ..g }),
        reset: None,
        kind: PerspectiveRecipe { priors_from: 7000, last_opacity_sum: Some(1e-9), ..discs.kind },
        ..discs
    }
}

/// GeoProp-GS, which trains as FSGS does, without growth, pruning and resets, from aligned depths; what no view sees is anchored to
/// what lies nearby.
fn geoprop() -> Recipe<PerspectiveRecipe> {
    let volumes = three_d_gaussians();
    Recipe {
        iterations: 10_000,
        weights: weights(volumes.weights, &[("color_statistics", 0.01)]),
        densification: None,
        // The paper removes no splats. An image shows nothing of one with an opacity below 1/255.
        prune_below: 1e-6,
        reset: None,
        kind: PerspectiveRecipe { sh_degree_every: 500, start_points: StartPoints::Gva, ..volumes.kind },
        ..volumes
    }
}
