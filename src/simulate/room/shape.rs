//! The surfaces of the room, and where rays meet them.

use glam::DVec3;

/// A box with sides along the axes: its lowest and highest corner, metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Block {
    pub(super) low: DVec3,
    pub(super) high: DVec3,
}

/// The inside of the room.
pub(super) const ROOM: Block = Block { low: DVec3::new(-2.0, -2.5, 0.0), high: DVec3::new(2.0, 2.5, 2.5) };
/// The top of the table.
pub(super) const TABLE_TOP: Block =
    Block { low: DVec3::new(-0.6, -0.2, 0.7), high: DVec3::new(0.8, 0.6, 0.74) };
/// The legs of the table, from the floor to its top.
pub(super) const LEGS: [Block; 4] = [leg(-0.56, -0.16), leg(0.7, -0.16), leg(-0.56, 0.5), leg(0.7, 0.5)];
/// Side of a leg, metres.
const LEG_M: f64 = 0.06;
/// Centre of the sphere, which lies on the table.
pub(super) const SPHERE_CENTER: DVec3 = DVec3::new(0.3, 0.22, TABLE_TOP.high.z + SPHERE_RADIUS_M);
/// Radius of the sphere, metres.
pub(super) const SPHERE_RADIUS_M: f64 = 0.22;
/// Rays leave surfaces from this distance on.
const NEAREST: f64 = 1e-9;

const fn leg(x: f64, y: f64) -> Block {
    Block { low: DVec3::new(x, y, 0.0), high: DVec3::new(x + LEG_M, y + LEG_M, TABLE_TOP.low.z) }
}

/// A part of the room.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Floor,
    Ceiling,
    /// The wall at the lowest x, with wallpaper and pictures.
    WestWall,
    /// The wall at the lowest y, of bricks.
    SouthWall,
    /// The wall at the highest x, without texture.
    EastWall,
    /// The wall at the highest y, without texture.
    NorthWall,
    TableTop,
    /// Edges and lower side of the top, and legs.
    TableFrame,
    Sphere,
}

impl Part {
    /// Whether the colour varies over the part.
    pub(super) const fn is_textured(self) -> bool {
        !matches!(self, Self::EastWall | Self::NorthWall)
    }
}

/// Where a ray first meets a surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Contact {
    /// Distance in lengths of the ray's direction.
    pub(super) distance: f64,
    /// Unit normal into the room.
    pub(super) normal: DVec3,
    pub(super) part: Part,
}

/// The part of the room's box that has a normal into the room along an axis.
pub(super) fn part_of_room(normal: DVec3) -> Part {
    match normal.to_array() {
        [x, ..] if x > 0.5 => Part::WestWall,
        [x, ..] if x < -0.5 => Part::EastWall,
        [_, y, _] if y > 0.5 => Part::SouthWall,
        [_, y, _] if y < -0.5 => Part::NorthWall,
        [.., z] if z > 0.0 => Part::Floor,
        _ => Part::Ceiling,
    }
}

/// Where a ray from inside of the room first meets a surface.
pub(super) fn first_contact(from: DVec3, along: DVec3) -> Contact {
    let (distance, normal) = exit(&ROOM, from, along);
    let mut first = Contact { distance, normal, part: part_of_room(normal) };
    let mut meet = |found: Option<(f64, DVec3)>, part: fn(DVec3) -> Part| {
        if let Some((distance, normal)) = found.filter(|f| f.0 < first.distance) {
            first = Contact { distance, normal, part: part(normal) };
        }
    };
    let top = |normal: DVec3| if normal.z > 0.5 { Part::TableTop } else { Part::TableFrame };
    meet(entry(&TABLE_TOP, from, along), top);
    for leg in &LEGS {
        meet(entry(leg, from, along), |_| Part::TableFrame);
    }
    meet(sphere_entry(from, along), |_| Part::Sphere);
    first
}

/// Where a ray from inside of a block leaves it: distance and normal to the inside.
fn exit(block: &Block, from: DVec3, along: DVec3) -> (f64, DVec3) {
    let mut first = (f64::INFINITY, DVec3::ZERO);
    for k in 0..3 {
        let wall = if along[k] > 0.0 { block.high[k] } else { block.low[k] };
        let distance = (wall - from[k]) / along[k];
        if along[k] != 0.0 && distance < first.0 {
            let mut normal = DVec3::ZERO;
            normal[k] = -along[k].signum();
            first = (distance, normal);
        }
    }
    first
}

/// Where a ray from outside of a block enters it: distance and normal to the outside.
fn entry(block: &Block, from: DVec3, along: DVec3) -> Option<(f64, DVec3)> {
    let (mut enters, mut leaves, mut axis) = (f64::NEG_INFINITY, f64::INFINITY, 0);
    for k in 0..3 {
        let [low, high] = [block.low[k], block.high[k]].map(|wall| (wall - from[k]) / along[k]);
        if along[k] == 0.0 {
            if from[k] < block.low[k] || from[k] > block.high[k] {
                return None;
            }
            continue;
        }
        if low.min(high) > enters {
            (enters, axis) = (low.min(high), k);
        }
        leaves = leaves.min(low.max(high));
    }
    let mut normal = DVec3::ZERO;
    normal[axis] = -along[axis].signum();
    (enters > NEAREST && enters < leaves).then_some((enters, normal))
}

fn sphere_entry(from: DVec3, along: DVec3) -> Option<(f64, DVec3)> {
    let to_center = SPHERE_CENTER - from;
    let (a, b) = (along.length_squared(), along.dot(to_center));
    let c = to_center.length_squared() - SPHERE_RADIUS_M * SPHERE_RADIUS_M;
    let root = (b * b - a * c).sqrt();
    // The root of a ray that misses the sphere is NaN, which fails the comparison.
    let distance = (b - root) / a;
    (distance > NEAREST).then(|| (distance, (along * distance - to_center) / SPHERE_RADIUS_M))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_stop_at_the_first_surface() {
        let eye = DVec3::new(0.3, -2.0, 0.9);
        let contact = |from, along| {
            let c = first_contact(from, along);
            (c.part, c.distance, c.normal)
        };
        let (part, distance, normal) = contact(eye, DVec3::new(0.0, 0.5, 0.0));
        assert!(part == Part::Sphere && normal.y < -0.9, "{normal}");
        assert!(((eye + DVec3::Y * 0.5 * distance) - SPHERE_CENTER).length() - SPHERE_RADIUS_M < 1e-12);
        for (from, along, part, distance) in [
            (eye, DVec3::NEG_Y, Part::SouthWall, 0.5),
            (eye, DVec3::X, Part::EastWall, 1.7),
            (eye, DVec3::NEG_Z * 3.0, Part::Floor, 0.3),
            (DVec3::new(-0.4, 0.0, 2.0), DVec3::NEG_Z, Part::TableTop, 1.26),
            (DVec3::new(-0.4, 0.0, 0.2), DVec3::Z, Part::TableFrame, 0.5),
            (DVec3::new(-1.56, -0.14, 0.3), DVec3::X, Part::TableFrame, 1.0),
        ] {
            let found = contact(from, along);
            assert!(found.0 == part && (found.1 - distance).abs() < 1e-12, "{found:?}");
            assert_eq!(found.2, -along.normalize());
        }
    }
}
