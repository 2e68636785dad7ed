//! What the photographs say against stated cameras.

use serde::Serialize;
use std::fmt;

/// Something that the photographs contradict.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum PoseFinding {
    /// The poses of all views are to be read in another way.
    Convention {
        /// How, as a condition.
        reading: String,
        /// Median distance from epipolar lines as stated and in that way, pixels.
        px: [f64; 2],
        /// Share of the pairs of views that agree as stated and in that way.
        agree: [f64; 2],
    },
    /// All focal lengths are wrong by a factor.
    Focal {
        /// Focal length that fits over the stated one.
        factor: f64,
        /// Median distance from epipolar lines as stated and with that, pixels.
        px: [f64; 2],
    },
    /// The poses of most views do not fit, and no reading of them does.
    Inaccurate {
        /// Median distance from epipolar lines, pixels.
        px: f64,
        /// Share of the pairs of views that agree.
        agree: f64,
    },
    /// Two images fit the poses of each other.
    Exchanged {
        /// Names of their views.
        views: [String; 2],
    },
    /// A view does not fit its pose, while others fit theirs.
    Misplaced {
        /// Its name.
        view: String,
        /// Its median distance from epipolar lines, pixels; none if the lines of sight would meet behind the cameras.
        px: Option<f64>,
    },
    /// A view shows nothing that the views beside it show.
    Unmatched {
        /// Its name.
        view: String,
        /// Number of views that it was compared with.
        compared: usize,
    },
}

impl PoseFinding {
    /// What to do about it.
    #[must_use]
    pub fn next_step(&self) -> &'static str {
        match self {
            Self::Convention { .. } => {
                "write the poses of the scene in the form that its layout has: COLMAP from world to camera, transforms.json \
                 from camera to world with axes right, up, backward, RGB-D frames from camera to world with axes right, down, \
                 forward (docs/conventions.md)"
            }
            Self::Focal { .. } => {
                "give the focal length in pixels of these images: was it scaled when they were resampled?"
            }
            Self::Inaccurate { .. } => {
                "check the poses, or find them from the photographs: `satgs-poses IMAGES -o SCENE` of the Python package, or COLMAP"
            }
            Self::Exchanged { .. } => "exchange the names of their files, or their poses",
            Self::Misplaced { .. } => "correct its pose, or leave the image out of the scene",
            Self::Unmatched { .. } => {
                "look at it: is it of another place, or its pose wrong? if so, leave it out of the scene"
            }
        }
    }
}

impl fmt::Display for PoseFinding {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Convention { reading, px: [stated, fitted], agree } => {
                let [stated_agree, fitted_agree] = agree.map(|a| 100.0 * a);
                write!(
                    f,
                    "the poses contradict the photographs: matched features lie {stated:.1} px from their epipolar lines, \
                     {fitted:.1} px if {reading} ({stated_agree:.0} % and {fitted_agree:.0} % of the pairs of views agree)"
                )
            }
            Self::Focal { factor, px: [stated, fitted] } => write!(
                f,
                "the photographs have {factor:.3} times the stated focal length: matched features lie {stated:.1} px from their \
                 epipolar lines, {fitted:.1} px with that"
            ),
            Self::Inaccurate { px, agree } => write!(
                f,
                "the poses do not fit the photographs: matched features lie {px:.1} px from their epipolar lines, {:.0} % of the \
                 pairs of views agree",
                100.0 * agree
            ),
            Self::Exchanged { views: [a, b] } => {
                write!(f, "the images of `{a}` and `{b}` are swapped: each fits the pose of the other")
            }
            Self::Misplaced { view, px: Some(px) } => {
                write!(
                    f,
                    "`{view}` does not fit its pose: its features lie {px:.1} px from the epipolar lines of other views"
                )
            }
            Self::Misplaced { view, px: None } => {
                write!(
                    f,
                    "`{view}` does not fit its pose: what it shows with others would lie behind the cameras"
                )
            }
            Self::Unmatched { view, compared } => {
                write!(f, "`{view}` shows nothing that the {compared} views show which it was compared with")
            }
        }
    }
}
