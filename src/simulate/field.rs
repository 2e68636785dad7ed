//! The scene as a height field: heights are interpolated bilinearly between the nodes of a fine grid.
//!
//! Positions are metres east and north of the centre of the scene along the map grid; heights are ellipsoidal. Rays are
//! cast onto this field, so that images and exact DSM come from the same surface.

/// Surface material at a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Material {
    Grass,
    Paving,
    Asphalt,
    Roof,
    Tree,
    Water,
    Rock,
    Scree,
    Snow,
    /// Ground of unknown height: an image shows nothing there.
    Void,
}

/// One node of the field.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    /// Ellipsoidal height, metres.
    pub(super) height_m: f64,
    pub(super) material: Material,
    /// Number of the building that it belongs to; 0 if none.
    pub(super) owner: u16,
    /// Reflectance in red, green, blue.
    pub(super) albedo: [f32; 3],
}

/// A square height field centred on the scene.
pub(super) struct Field {
    half_m: f64,
    step_m: f64,
    side: usize,
    nodes: Vec<Node>,
    ceiling: Vec<f32>,
    ceiling_side: usize,
    lowest_m: f64,
    highest_m: f64,
}

/// A position in metres: east, north, ellipsoidal height.
pub(super) type Place = [f64; 3];

/// Side of the coarse cells of the maximum heights that rays skip, metres.
const LEAP_M: f64 = 2.0;
/// Number of steps of a ray per distance between nodes.
const STEPS_PER_NODE: f64 = 2.0;
/// Fewest bisections that locate the intersection within a step: 0.1 m / 2¹⁴ is 6 µm.
const HALVINGS: usize = 14;
/// Height within which an intersection is located, metres: more bisections follow where a step of a steep ray descends far.
const EXACT_M: f64 = 1e-3;

impl Field {
    /// A field over ±`half_m` with a node every `step_m`; nodes are ordered row by row from the south.
    pub(super) fn new(half_m: f64, step_m: f64, nodes: Vec<Node>) -> Self {
        let side = Self::nodes_per_side(half_m, step_m);
        assert_eq!(nodes.len(), side * side, "one node for every position");
        let ceiling_side = (2.0 * half_m / LEAP_M).ceil() as usize + 1;
        let mut highest = vec![f32::NEG_INFINITY; ceiling_side * ceiling_side];
        let (mut lowest_m, mut highest_m) = (f64::INFINITY, f64::NEG_INFINITY);
        // A node belongs to every cell that reaches between its neighbours, because heights are interpolated there.
        let cell = |i: usize| (i as f64 * step_m / LEAP_M) as usize;
        let cells = |i: usize| cell(i.saturating_sub(1))..=cell((i + 1).min(side - 1));
        for (k, node) in nodes.iter().enumerate() {
            for (r, c) in cells(k / side).flat_map(|r| cells(k % side).map(move |c| (r, c))) {
                let slot = &mut highest[r * ceiling_side + c];
                *slot = slot.max(node.height_m as f32 + 0.01);
            }
            lowest_m = lowest_m.min(node.height_m);
            highest_m = highest_m.max(node.height_m);
        }
        // A ceiling covers the neighbouring cells too, because a step may leave the cell in any direction.
        let around = |i: usize| i.saturating_sub(1)..(i + 2).min(ceiling_side);
        let ceiling = (0..ceiling_side * ceiling_side)
            .map(|k| {
                around(k / ceiling_side)
                    .flat_map(|r| around(k % ceiling_side).map(move |c| (r, c)))
                    .map(|(r, c)| highest[r * ceiling_side + c])
                    .fold(f32::NEG_INFINITY, f32::max)
            })
            .collect();
        Self { half_m, step_m, side, nodes, ceiling, ceiling_side, lowest_m, highest_m }
    }

    /// Number of nodes along each side.
    pub(super) fn nodes_per_side(half_m: f64, step_m: f64) -> usize {
        (2.0 * half_m / step_m).round() as usize + 1
    }

    /// Lowest and highest height, metres.
    pub(super) fn height_range(&self) -> (f64, f64) {
        (self.lowest_m, self.highest_m)
    }

    /// Distance between nodes, metres.
    pub(super) fn step_m(&self) -> f64 {
        self.step_m
    }

    /// Half the field's side, metres.
    pub(super) fn half_m(&self) -> f64 {
        self.half_m
    }

    /// The node nearest to a position.
    pub(super) fn nearest(&self, x: f64, y: f64) -> &Node {
        &self.nodes[self.nearest_index(x, y)]
    }

    /// Index of the node nearest to a position.
    pub(super) fn nearest_index(&self, x: f64, y: f64) -> usize {
        let index = |v: f64| (((v + self.half_m) / self.step_m).round().max(0.0) as usize).min(self.side - 1);
        index(y) * self.side + index(x)
    }

    /// The four nodes around a position (south-west, south-east, north-west, north-east), and the position between them as
    /// fractions of a cell.
    pub(super) fn around(&self, x: f64, y: f64) -> ([&Node; 4], f64, f64) {
        let last = (self.side - 2) as f64;
        let (u, v) = ((x + self.half_m) / self.step_m, (y + self.half_m) / self.step_m);
        let (i, j) = (u.floor().clamp(0.0, last), v.floor().clamp(0.0, last));
        let k = j as usize * self.side + i as usize;
        let n = &self.nodes;
        (
            [&n[k], &n[k + 1], &n[k + self.side], &n[k + self.side + 1]],
            (u - i).clamp(0.0, 1.0),
            (v - j).clamp(0.0, 1.0),
        )
    }

    /// Height at a position; outside of the field, that of its border.
    pub(super) fn height_m(&self, x: f64, y: f64) -> f64 {
        let ([a, b, c, d], u, v) = self.around(x, y);
        let south = a.height_m + (b.height_m - a.height_m) * u;
        let north = c.height_m + (d.height_m - c.height_m) * u;
        south + (north - south) * v
    }

    /// Slope to the east and to the north at a position, metres per metre.
    pub(super) fn slope(&self, x: f64, y: f64) -> [f64; 2] {
        let ([a, b, c, d], u, v) = self.around(x, y);
        let [a, b, c, d] = [a, b, c, d].map(|n| n.height_m);
        [((b - a) * (1.0 - v) + (d - c) * v) / self.step_m, ((c - a) * (1.0 - u) + (d - b) * u) / self.step_m]
    }

    /// First intersection of a descending ray with the field; `path(t)` is the ray for t from 0, above all heights, to 1,
    /// below all heights.
    pub(super) fn first_hit(&self, path: impl Fn(f64) -> Place) -> Option<Place> {
        let (from, to) = (path(0.0), path(1.0));
        let run_m = (to[0] - from[0]).hypot(to[1] - from[1]).max(1e-6);
        let (leap, fine) = (LEAP_M / run_m, (self.step_m / STEPS_PER_NODE / run_m).min(1.0));
        let halvings = HALVINGS.max(((from[2] - to[2]) * fine / EXACT_M).log2().ceil() as usize);
        let above = |p: Place| p[2] > self.height_m(p[0], p[1]);
        let mut t = 0.0;
        let mut here = from;
        while t < 1.0 {
            let after = (t + leap).min(1.0);
            let far = path(after);
            if far[2] > self.ceiling_m(here) {
                (t, here) = (after, far);
                continue;
            }
            let after = (t + fine).min(1.0);
            let far = path(after);
            if !above(far) {
                let (mut high, mut low) = (t, after);
                for _ in 0..halvings {
                    let middle = 0.5 * (high + low);
                    if above(path(middle)) { high = middle } else { low = middle }
                }
                return Some(path(low));
            }
            (t, here) = (after, far);
        }
        None
    }

    /// Whether a position is in sunlight; `sun` is the unit vector to the sun.
    pub(super) fn is_lit(&self, place: Place, sun: [f64; 3]) -> bool {
        let run = sun[0].hypot(sun[1]).max(1e-6);
        let along = |m: f64| -> Place { std::array::from_fn(|k| place[k] + sun[k] / run * m) };
        let fine_m = self.step_m / STEPS_PER_NODE;
        let mut m = fine_m;
        loop {
            let p = along(m);
            if p[2] > self.highest_m {
                return true;
            }
            if p[2] > self.ceiling_m(p) {
                m += LEAP_M;
            } else if p[2] < self.height_m(p[0], p[1]) {
                return false;
            } else {
                m += fine_m;
            }
        }
    }

    fn ceiling_m(&self, p: Place) -> f64 {
        let last = self.ceiling_side - 1;
        let cell = |v: f64| (((v + self.half_m) / LEAP_M).max(0.0) as usize).min(last);
        f64::from(self.ceiling[cell(p[1]) * self.ceiling_side + cell(p[0])])
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Dark flat ground at 150 m with one bright box: half sides (5, 3) m, 12 m high, centred at (8, -6).
    pub(in super::super) fn one_box() -> Field {
        a_box([8.0, -6.0])
    }

    fn a_box(center: [f64; 2]) -> Field {
        let (half, step) = (70.0, 0.25);
        let side = Field::nodes_per_side(half, step);
        let node = |k: usize| {
            let (x, y) = ((k % side) as f64 * step - half, (k / side) as f64 * step - half);
            let on_box = (x - center[0]).abs() <= 5.0 && (y - center[1]).abs() <= 3.0;
            let (height_m, material, albedo) =
                if on_box { (162.0, Material::Roof, [0.8; 3]) } else { (150.0, Material::Grass, [0.1; 3]) };
            Node { height_m, material, owner: u16::from(on_box), albedo }
        };
        Field::new(half, step, (0..side * side).map(node).collect())
    }

    #[test]
    fn the_length_of_a_shadow_follows_from_height_and_sun_elevation() {
        let field = one_box();
        let (elevation, azimuth) = (40.0f64.to_radians(), 135.0f64.to_radians());
        let sun = [azimuth.sin() * elevation.cos(), azimuth.cos() * elevation.cos(), elevation.sin()];
        // The shadow of the box's corner ends h / tan(elevation) away from the corner.
        let corner = [8.0 - 5.0, -6.0 + 3.0];
        let on_ground = |m: f64| {
            let place = [corner[0] - azimuth.sin() * m, corner[1] - azimuth.cos() * m, 150.0];
            field.is_lit(place, sun)
        };
        let length = (0..400).map(|i| f64::from(i) * 0.1).filter(|m| !on_ground(*m)).fold(0.0, f64::max);
        assert!((length - 12.0 / elevation.tan()).abs() < 0.5, "{length}");
        assert!(on_ground(length + 1.0) && !on_ground(2.0));
    }

    #[test]
    fn a_ray_ends_on_a_wall_and_not_in_it() {
        // The walls stand on the first and on the last nodes of the cells that rays leap over.
        for shift in [-0.75, -0.25, 0.0, 0.25, 0.75] {
            let field = a_box([9.0 + shift, -6.0]);
            for k in 0..200 {
                // Nearly level rays from both sides, so that some leap ends right beside the wall.
                let from = -40.0 - 0.01 * f64::from(k);
                for side in [1.0, -1.0] {
                    let path = |t: f64| [9.0 + side * (from + 60.0 * t), -6.0, 155.0 - 6.0 * t];
                    let [x, y, z] = field.first_hit(path).unwrap();
                    assert!((z - field.height_m(x, y)).abs() < 0.01, "{x} {z} {}", field.height_m(x, y));
                }
            }
        }
    }

    #[test]
    fn a_ray_stops_at_the_first_surface() {
        let field = one_box();
        let path = |t: f64| [8.0 - 20.0 + 40.0 * t, -6.0, 182.0 - 40.0 * t];
        // Descends at 45° through (8, -6, 162): the middle of the roof.
        let hit = field.first_hit(path).unwrap();
        assert!((hit[0] - 8.0).abs() < 1e-3 && (hit[2] - 162.0).abs() < 1e-3, "{hit:?}");
        let ground = field.first_hit(|t| [40.0 + 5.0 * t, 20.0, 180.0 - 60.0 * t]).unwrap();
        assert!((ground[2] - 150.0).abs() < 1e-3 && (ground[0] - 42.5).abs() < 1e-3, "{ground:?}");
    }
}
