//! The frame of a training scene that is part of a larger one, such as a tile.

use crate::frame::{SiteBox, SiteGrid};
use serde::{Deserialize, Serialize};

/// Half the diagonal of the area of JAX_068, metres, for which the recipes were made. Learning rates of positions and limits
/// of the splats' sizes refer to it in every [`SiteFrame`], so that they do not depend on the size of the frame.
pub(super) const REFERENCE_HALF_DIAGONAL_M: f64 = 226.0;

/// What a training scene takes over from a larger scene of which it is a part, instead of deriving it from its own views
/// and points; see [`SiteScene::in_frame`](super::SiteScene::in_frame).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SiteFrame {
    /// The site. Its origin must lie in or near the area, because splats have single precision.
    pub site: SiteGrid,
    /// The area in which splats may lie, site metres: west, south, east, north.
    pub area: SiteBox,
    /// Lowest and highest altitude that the rays of trained pixels pass within the area, and that splats have as long as no
    /// surface is known; metres above the site's origin.
    pub altitudes: (f64, f64),
    /// Lowest and highest altitude between which the surface is searched, metres above the site's origin.
    pub searched: (f64, f64),
    /// Name of the training view whose colours the orthophoto takes; by default, the view with the smallest sum of the
    /// angle off nadir and the angle of the sun from the zenith.
    pub reference: Option<String>,
}
