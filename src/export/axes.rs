//! The axes of splat files.

use crate::splat::splats::Splats;
use glam::{DMat3, DVec3};

/// Where x, y and z of a file point, for splats in a site frame. Splats without a place on Earth are turned in the same way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Axes {
    /// x east, y north, z up: the site frame.
    #[default]
    EastNorthUp,
    /// x east, y down, z north: the axes of scenes of COLMAP.
    EastDownNorth,
    /// x east, y up, z south: the axes of glTF, which SPZ calls RUB (right, up, back).
    EastUpSouth,
}

impl Axes {
    /// All of them.
    const ALL: [Self; 3] = [Self::EastNorthUp, Self::EastDownNorth, Self::EastUpSouth];

    /// The directions of x, y and z.
    #[must_use]
    pub fn names(self) -> [&'static str; 3] {
        match self {
            Self::EastNorthUp => ["east", "north", "up"],
            Self::EastDownNorth => ["east", "down", "north"],
            Self::EastUpSouth => ["east", "up", "south"],
        }
    }

    /// The axes with these directions.
    #[must_use]
    pub fn named(names: &[String]) -> Option<Self> {
        Self::ALL.into_iter().find(|axes| names == axes.names())
    }

    /// The rotation from the site frame.
    fn file_from_site(self) -> DMat3 {
        let rows = match self {
            Self::EastNorthUp => return DMat3::IDENTITY,
            Self::EastDownNorth => [DVec3::X, -DVec3::Z, DVec3::Y],
            Self::EastUpSouth => [DVec3::X, DVec3::Z, -DVec3::Y],
        };
        DMat3::from_cols(rows[0], rows[1], rows[2]).transpose()
    }

    /// A place of the site frame from one in these axes.
    pub(super) fn place_in_site(self, place: [f32; 3]) -> [f64; 3] {
        (self.file_from_site().transpose() * DVec3::from_array(place.map(f64::from))).to_array()
    }

    /// Splats in these axes.
    #[must_use]
    pub fn from_site(self, splats: Splats) -> Splats {
        turned(splats, self.file_from_site())
    }

    /// Splats of the site frame from those in these axes.
    #[must_use]
    pub fn to_site(self, splats: Splats) -> Splats {
        turned(splats, self.file_from_site().transpose())
    }
}

/// Splats turned about the origin, with the colours that depend on the direction.
fn turned(mut splats: Splats, rotation: DMat3) -> Splats {
    if rotation == DMat3::IDENTITY {
        return splats;
    }
    for position in &mut splats.position {
        *position = (rotation * DVec3::from_array(position.map(f64::from))).as_vec3().to_array();
    }
    splats.turn_shapes(rotation);
    splats
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splats_turned_to_other_axes_and_back_are_the_same() {
        let mut splats = Splats::default();
        splats.push([1.0, 2.0, 3.0], 0.4, 0.8, [0.2, 0.4, 0.6]);
        splats.rotation[0] = [0.9, 0.1, -0.3, 0.2];
        splats.f_rest = vec![std::array::from_fn(|k| k as f32 / 90.0)];
        assert_eq!(Axes::EastNorthUp.from_site(splats.clone()), splats);
        for (axes, position) in
            [(Axes::EastDownNorth, [1.0, -3.0, 2.0]), (Axes::EastUpSouth, [1.0, 3.0, -2.0])]
        {
            let turned = axes.from_site(splats.clone());
            assert_eq!(turned.position[0], position);
            let back = axes.to_site(turned);
            assert_eq!(back.position, splats.position);
            let rest = back.f_rest[0].iter().zip(splats.f_rest[0]);
            assert!(rest.clone().all(|(a, b)| (a - b).abs() < 1e-6));
            // A quaternion and its negative are the same rotation.
            let cos = |a: [f32; 4], b: [f32; 4]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
            let (own, found) = (splats.rotation[0], back.rotation[0]);
            assert!((cos(own, found).abs() - cos(own, own)).abs() < 1e-6);
            assert_eq!(Axes::named(&axes.names().map(String::from)), Some(axes));
        }
        assert_eq!(Axes::named(&["west", "north", "up"].map(String::from)), None);
    }
}
