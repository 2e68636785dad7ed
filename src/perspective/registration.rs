//! Finds the cameras of RGB-D frames whose colours and depths were taken by two of them.
//!
//! A sensor has a camera for colours and one for depths, side by side. Many folders of frames state one set of intrinsic
//! parameters: in 7-Scenes it is that of the depth maps, elsewhere that of the colours, and often the depth maps are registered to
//! the colours already. With the wrong one, what is trained on the frames is blurred and misplaced.
//!
//! Edges of the images at jumps of the depths say how both cameras lie to each other ([`EdgeFit`]), but not which of them is the
//! stated one, and they err. Features that match between frames decide ([`FrameMatches`]): the colour camera is that whose
//! epipolar lines they lie on, and the depth camera is believed only if its depths carry the features to where they are found in
//! the other frame.

use super::depth_edges::EdgeFit;
use super::frame_matches::{FrameMatches, SensorCameras};
use super::view::{PerspectiveView, SensorCamera};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Number of frames that are looked at.
const FRAMES: usize = 16;
/// Largest distance from epipolar lines over the least of all cameras that are tried.
const AS_GOOD: f64 = 1.1;
/// Differences of distances from epipolar lines that say nothing, pixels.
const SLACK_PX: f64 = 0.1;
/// Largest distance of features carried by depths over that with the stated camera.
const BETTER: f64 = 0.9;

/// The cameras of colours and depths of RGB-D frames, which differ.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ColorRegistration {
    /// Focal length of the colours over the stated one.
    pub focal_ratio: f64,
    /// Focal length of the depth maps over the stated one: 1 if the stated camera is theirs.
    #[serde(default = "one")]
    pub depth_focal_ratio: f64,
    /// Place of the depth camera in the axes (right, down) of the colour camera, metres.
    pub offset_m: [f64; 2],
    /// Whether the stated poses are those of the depth camera.
    #[serde(default = "yes")]
    pub poses_of_depths: bool,
    /// What speaks for them.
    #[serde(flatten)]
    pub evidence: RegistrationEvidence,
}

/// Cameras that edges suggest and matched features contradict.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RejectedRegistration {
    /// Focal length of the colours over that of the depth maps.
    pub focal_ratio: f64,
    /// What speaks for and against them: of the cameras that features contradict least.
    #[serde(flatten)]
    pub evidence: RegistrationEvidence,
}

/// Figures of cameras of RGB-D frames, with the stated camera for colours and depths, and with two cameras.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RegistrationEvidence {
    /// Mean strength of the image's edges at jumps of the depth, over their standard deviation.
    pub edges: [f64; 2],
    /// Median distance of matched features from their epipolar lines, pixels; none without matches.
    #[serde(default)]
    pub epipolar_px: Option<[f64; 2]>,
    /// Median distance of matched features from where the depths of the other frame carry them, pixels, of those features that both
    /// place differently; none without matches.
    #[serde(default)]
    pub carried_px: Option<[f64; 2]>,
}

fn one() -> f64 {
    1.0
}

fn yes() -> bool {
    true
}

impl fmt::Display for RegistrationEvidence {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let [stated, fitted] = self.edges;
        write!(
            f,
            "at jumps of the depths, edges of the images are {fitted:.1} instead of {stated:.1} standard deviations strong"
        )?;
        if let Some([stated, fitted]) = self.epipolar_px {
            write!(
                f,
                "; matched features lie {fitted:.1} px from their epipolar lines instead of {stated:.1} px"
            )?;
        }
        if let Some([stated, fitted]) = self.carried_px {
            write!(f, " and {fitted:.1} px from where the depths carry them instead of {stated:.1} px")?;
        }
        Ok(())
    }
}

impl fmt::Display for ColorRegistration {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let [x, y] = self.offset_m.map(|v| 1000.0 * v);
        let side = if x < 0.0 { "left" } else { "right" };
        let level = if y < 0.0 { "above" } else { "below" };
        let (whose, ratio) = match self.focal_ratio == 1.0 {
            true => ("depth maps", self.depth_focal_ratio),
            false => ("colours", self.focal_ratio),
        };
        write!(
            f,
            "colours and depths are of two cameras: the {whose} have {ratio:.3} times the stated focal length, and the depth camera is \
             {:.0} mm {side} of the colour camera and {:.0} mm {level} it ({}); depth maps are brought to the colour camera",
            x.abs(),
            y.abs(),
            self.evidence
        )
    }
}

impl fmt::Display for RejectedRegistration {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let why = match self.evidence.epipolar_px {
            Some(_) => "matched features contradict it",
            None => "too few features match between the frames to confirm it",
        };
        write!(
            f,
            "colours and depths are taken as of the one stated camera: edges suggest that the colours have {:.3} times the focal length \
             of the depths, and {why} ({})",
            self.focal_ratio, self.evidence
        )
    }
}

/// Two cameras that edges suggest, and what features say of them.
struct Tried {
    cameras: SensorCameras,
    evidence: RegistrationEvidence,
    /// Of the stated camera and of these.
    epipolar_px: [f64; 2],
    /// Distance of features carried by depths over that with the stated camera.
    carried: f64,
}

impl ColorRegistration {
    /// The cameras of RGB-D frames if colours and depths are of two; an error if edges say so and features do not.
    pub(super) fn find(views: &[PerspectiveView]) -> Result<Option<Self>, RejectedRegistration> {
        let with_depth: Vec<&PerspectiveView> = views.iter().filter(|v| v.depth.is_some()).collect();
        let step = with_depth.len().div_ceil(FRAMES).max(1);
        let frames: Vec<&PerspectiveView> = with_depth.iter().step_by(step).copied().collect();
        let Some(fit) = EdgeFit::find(&frames) else { return Ok(None) };
        let matches = FrameMatches::find(&with_depth, step);
        Self::decide(fit, matches.as_ref()).map(Some)
    }

    /// Which of the cameras that edges suggest the features confirm.
    fn decide(fit: EdgeFit, matches: Option<&FrameMatches>) -> Result<Self, RejectedRegistration> {
        let EdgeFit { focal_ratio, offset_m, edges } = fit;
        let of_depths =
            SensorCameras { color_focal: focal_ratio, depth_focal: 1.0, offset_m, poses_of_depths: true };
        let of_colors = SensorCameras {
            color_focal: 1.0,
            depth_focal: 1.0 / focal_ratio,
            offset_m: offset_m.map(|v| v * focal_ratio),
            poses_of_depths: false,
        };
        let stated = &SensorCameras::STATED;
        let tried = |cameras: SensorCameras| {
            let epipolar_px = [matches?.epipolar_px(stated)?, matches?.epipolar_px(&cameras)?];
            let carried_px = matches?.carried_px([stated, &cameras])?;
            let evidence =
                RegistrationEvidence { edges, epipolar_px: Some(epipolar_px), carried_px: Some(carried_px) };
            Some(Tried { cameras, evidence, epipolar_px, carried: carried_px[1] / carried_px[0] })
        };
        let tried: Vec<Tried> = [of_colors, of_depths].into_iter().filter_map(tried).collect();
        let least_px = tried.iter().flat_map(|t| t.epipolar_px).fold(f64::INFINITY, f64::min);
        let fits = |t: &&Tried| t.epipolar_px[1] <= AS_GOOD * least_px + SLACK_PX && t.carried <= BETTER;
        let nearer = |a: &&Tried, b: &&Tried| a.carried.total_cmp(&b.carried);
        match tried.iter().filter(fits).min_by(nearer) {
            Some(Tried { cameras, evidence, .. }) => Ok(Self {
                focal_ratio: cameras.color_focal,
                depth_focal_ratio: cameras.depth_focal,
                offset_m: cameras.offset_m,
                poses_of_depths: cameras.poses_of_depths,
                evidence: *evidence,
            }),
            None => {
                let evidence = tried.iter().min_by(nearer).map(|t| t.evidence);
                let without = RegistrationEvidence { edges, ..RegistrationEvidence::default() };
                Err(RejectedRegistration { focal_ratio, evidence: evidence.unwrap_or(without) })
            }
        }
    }

    /// Gives a view its two cameras. The pose is that of the stated one.
    pub(super) fn apply(&self, view: &mut PerspectiveView) {
        let [x, y] = self.offset_m;
        let center = DVec3::new(x, y, 0.0);
        let lens = &mut view.lens_camera;
        if let Some(depth) = &mut view.depth {
            let focal = lens.focal * self.depth_focal_ratio;
            depth.camera = Some(SensorCamera { focal, principal: lens.principal, center });
        }
        lens.focal *= self.focal_ratio;
        let camera = &view.camera;
        let place = match self.poses_of_depths {
            true => camera.center - camera.cam_from_site.transpose() * center,
            false => camera.center,
        };
        view.camera =
            PerspectiveView::undistorted_camera(lens, camera.cam_from_site, place, view.downsampling);
    }
}

#[cfg(test)]
mod tests {
    use super::super::frame_matches::test_frames::of_sensor;
    use super::*;

    /// What edges suggest: the colours have 0.9 times the focal length of the depths.
    const FIT: EdgeFit = EdgeFit { focal_ratio: 0.9, offset_m: [0.0; 2], edges: [0.2, 0.9] };

    #[test]
    fn features_decide_which_camera_is_stated() {
        let of_depths = ColorRegistration::decide(FIT, Some(&of_sensor(0.9, 1.0))).unwrap();
        assert_eq!((of_depths.focal_ratio, of_depths.depth_focal_ratio), (0.9, 1.0));
        let of_colors = ColorRegistration::decide(FIT, Some(&of_sensor(1.0, 1.0 / 0.9))).unwrap();
        assert_eq!((of_colors.focal_ratio, of_colors.depth_focal_ratio), (1.0, 1.0 / 0.9));
        for found in [of_depths, of_colors] {
            let carried = found.evidence.carried_px.unwrap();
            assert!(carried[1] < 0.3 && carried[1] < 0.5 * carried[0], "{found:?}");
        }
    }

    #[test]
    fn what_features_contradict_is_not_applied() {
        let rejected = ColorRegistration::decide(FIT, Some(&of_sensor(1.0, 1.0))).unwrap_err();
        let [stated, suggested] = rejected.evidence.carried_px.unwrap();
        assert!(stated < 0.3 && suggested > 2.0 * stated, "{rejected:?}");
        assert!(rejected.to_string().contains("matched features contradict it"), "{rejected}");
        let unknown = ColorRegistration::decide(FIT, None).unwrap_err();
        assert!(unknown.evidence.carried_px.is_none() && unknown.to_string().contains("too few features"));
    }
}
