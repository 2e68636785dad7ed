//! Where a point of one image may lie in another one whose pose is known.
//!
//! Image positions are directions (right, down) at depth one. A point `x` of camera a at depth `z` lies in the axes of camera b
//! at `R (z x) + t`; so `y . (t x R x) = 0` for its position `y` there (Hartley and Zisserman 2004, section 9.6).

use super::super::pose::Pose;
use glam::{DMat3, DVec2, DVec3};

/// Two directions to one point of the scene: from camera a, from camera b.
pub(in crate::perspective) type RayPair = [DVec2; 2];

/// The motion from the axes of camera a to those of camera b.
#[derive(Clone, Copy, Debug)]
pub(in crate::perspective) struct Motion {
    rotation: DMat3,
    translation: DVec3,
    essential: DMat3,
}

impl Motion {
    pub(in crate::perspective) fn between(a: &Pose, b: &Pose) -> Self {
        let rotation = b.cam_from_world * a.cam_from_world.transpose();
        let translation = b.cam_from_world * (a.center - b.center);
        let t = translation.normalize_or_zero();
        let across = DMat3::from_cols(
            DVec3::new(0.0, t.z, -t.y),
            DVec3::new(-t.z, 0.0, t.x),
            DVec3::new(t.y, -t.x, 0.0),
        );
        Self { rotation, translation, essential: across * rotation }
    }

    /// Distance of a pair from the epipolar lines, to first order; NaN without a distance between the cameras.
    pub(in crate::perspective) fn distance(&self, pair: &RayPair) -> f64 {
        sampson(&self.essential, pair)
    }

    /// Sine of the angle between both directions.
    pub(super) fn parallax(&self, [x, y]: &RayPair) -> f64 {
        let (x, y) = (self.rotation * x.extend(1.0), y.extend(1.0));
        (y.cross(x).length_squared() / (x.length_squared() * y.length_squared())).sqrt()
    }

    /// Whether the point at which both directions meet is in front of both cameras.
    pub(in crate::perspective) fn is_in_front(&self, [x, y]: &RayPair) -> bool {
        let (x, y) = (self.rotation * x.extend(1.0), y.extend(1.0));
        let across = y.cross(x);
        let depth = -y.cross(self.translation).dot(across);
        let there = depth * x + across.length_squared() * self.translation;
        depth > 0.0 && there.dot(y) > 0.0
    }
}

/// First-order distance of a pair from `y . (M x) = 0` (Sampson; Hartley and Zisserman 2004, equation 11.9).
pub(super) fn sampson(m: &DMat3, [x, y]: &RayPair) -> f64 {
    let (x, y) = (x.extend(1.0), y.extend(1.0));
    let (in_b, in_a) = (*m * x, m.transpose() * y);
    y.dot(in_b).abs() / (in_b.truncate().length_squared() + in_a.truncate().length_squared()).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_to_one_point_meet_in_front_of_both_cameras() {
        let a = Pose { cam_from_world: DMat3::IDENTITY, center: DVec3::ZERO };
        let b = Pose { cam_from_world: DMat3::from_rotation_y(0.3), center: DVec3::new(0.5, -0.1, 0.2) };
        let point = DVec3::new(0.4, 0.3, 3.0);
        let seen = |pose: &Pose| {
            let p = pose.cam_from_world * (point - pose.center);
            p.truncate() / p.z
        };
        let pair = [seen(&a), seen(&b)];
        let motion = Motion::between(&a, &b);
        assert!(motion.distance(&pair) < 1e-12 && motion.is_in_front(&pair));
        // A step across the epipolar line is its distance, shared by both images.
        let off = motion.distance(&[pair[0], pair[1] + DVec2::new(0.0, 0.01)]);
        assert!((0.005..0.0101).contains(&off), "{off}");
        // With the centres mirrored, the same lines meet behind the cameras.
        let mirrored = Motion::between(&a, &Pose { center: -b.center, ..b });
        assert!(mirrored.distance(&pair) < 1e-12 && !mirrored.is_in_front(&pair));
        assert!(Motion::between(&a, &a).distance(&pair).is_nan());
    }
}
