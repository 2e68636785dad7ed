//! The surface where a ray ends: its material, its colour before season and light, its normal.

use super::field::{Field, Material, Place};
use super::keyed_rng::KeyedRng;
use super::texture::{self, Albedo};

/// Slope from which on a surface counts as a wall, metres per metre.
const WALL_SLOPE: f64 = 1.7;

/// A point of the surface.
pub(super) struct Surface {
    pub(super) place: Place,
    pub(super) material: Material,
    pub(super) albedo: Albedo,
    /// Unit normal.
    pub(super) normal: [f64; 3],
    pub(super) is_wall: bool,
}

impl Surface {
    /// The surface at a position of the field; `colors` is the address of the town's colours.
    pub(super) fn at(field: &Field, place: Place, colors: KeyedRng) -> Self {
        let [x, y, z] = place;
        let (nodes, u, v) = field.around(x, y);
        let [gx, gy] = field.slope(x, y);
        let steep = gx.hypot(gy);
        let length = (1.0 + steep * steep).sqrt();
        let normal = [-gx / length, -gy / length, 1.0 / length];
        let is_wall = steep > WALL_SLOPE;
        if is_wall {
            // Nodes of a wall have the material of the roof above them.
            let top = nodes.iter().fold(nodes[0], |a, b| if b.height_m > a.height_m { b } else { a });
            let albedo = if top.material == Material::Roof {
                texture::wall(colors, top.owner, (x * gy - y * gx) / steep, z)
            } else {
                top.albedo
            };
            return Self { place, material: top.material, albedo, normal, is_wall };
        }
        let mut albedo = [0.0f32; 3];
        let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
        for (node, w) in nodes.iter().zip(weights) {
            (0..3).for_each(|b| albedo[b] += w as f32 * node.albedo[b]);
        }
        Self { place, material: field.nearest(x, y).material, albedo, normal, is_wall }
    }

    /// Direct irradiance relative to that of a surface perpendicular to the sun; 0 in shadow, and where the surface is turned
    /// away from the sun. `sun` is the unit vector to the sun.
    pub(super) fn direct_light(&self, field: &Field, sun: [f64; 3]) -> f64 {
        let facing = (0..3).map(|k| self.normal[k] * sun[k]).sum::<f64>();
        let [x, y, z] = self.place;
        if facing > 0.0 && field.is_lit([x, y, z + 0.03], sun) { facing } else { 0.0 }
    }
}
