//! Choices and schedules that recipes are composed of.

use serde::{Deserialize, Serialize};

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
