//! The tree of tiles: nodes are divided where the splats are, and an inner node shows the merged splats of its children.

use super::super::packing::bounds;
use super::merge::merge;
use crate::splat::splats::Splats;

/// Most splats of a leaf: a megabyte as SPZ.
const LEAF: usize = 50_000;
/// Cells of an inner node along its longest side.
const CELLS: f32 = 128.0;
/// Deepest level: 2^24 m are beyond the Earth.
const DEEPEST: usize = 24;
/// Nodes that one parent joins.
const JOINED: usize = 8;
/// Standard deviations at which a splat ends (the cut of `KHR_gaussian_splatting`).
const EXTENT: f32 = 3.0;
/// The longest way in a cube of side one: the farthest that a splat moves when it is merged.
const DIAGONAL: f64 = 1.732_050_807_568_877_2;

/// A tile and those below it.
#[derive(Clone, Debug, PartialEq)]
pub struct TileNode {
    /// Name of its content.
    pub id: String,
    /// Corners of the box around its splats and those below, metres.
    pub bounds: [[f32; 3]; 2],
    /// Farthest that a splat was moved by merging, metres; 0 of a leaf.
    pub error_m: f64,
    /// Number of its own splats.
    pub splats: usize,
    /// The tiles that replace it.
    pub children: Vec<TileNode>,
}

impl TileNode {
    /// This node and all below it.
    pub fn all(&self) -> impl Iterator<Item = &Self> {
        let mut waiting = vec![self];
        std::iter::from_fn(move || {
            let node = waiting.pop()?;
            waiting.extend(node.children.iter().rev());
            Some(node)
        })
    }

    /// Number of levels.
    #[must_use]
    pub fn levels(&self) -> usize {
        1 + self.children.iter().map(Self::levels).max().unwrap_or(0)
    }
}

/// Divides splats into tiles, which `write` gets by their names, children before parents. Returns the topmost one and its
/// splats. Sides at least half as long as the longest are halved: a flat scene becomes a quadtree, others an octree.
///
/// # Errors
/// Those of `write`.
pub fn subtree<E>(
    splats: Splats,
    id: &str,
    write: &mut dyn FnMut(&str, &Splats) -> Result<(), E>,
) -> Result<(TileNode, Splats), E> {
    divide(splats, id, 0, write)
}

fn divide<E>(
    splats: Splats,
    id: &str,
    level: usize,
    write: &mut dyn FnMut(&str, &Splats) -> Result<(), E>,
) -> Result<(TileNode, Splats), E> {
    let (low, high) = bounds(&splats.position);
    let side = |k: usize| high[k] - low[k];
    let longest = (0..3).map(side).fold(0.0, f32::max);
    if splats.len() <= LEAF || level == DEEPEST || longest <= 0.0 {
        write(id, &splats)?;
        let node = TileNode {
            id: id.into(),
            bounds: extent(&splats),
            error_m: 0.0,
            splats: splats.len(),
            children: Vec::new(),
        };
        return Ok((node, splats));
    }
    let part_of = |p: &[f32; 3]| {
        (0..3).fold(0, |part, k| {
            let is_upper = side(k) >= 0.5 * longest && p[k] > 0.5 * (low[k] + high[k]);
            part | usize::from(is_upper) << k
        })
    };
    let mut parts: [Vec<u32>; 8] = Default::default();
    for (p, i) in splats.position.iter().zip(0..) {
        parts[part_of(p)].push(i);
    }
    let own = |indices: &Vec<u32>| {
        let mut own = Splats::default();
        own.take_from(&splats, indices);
        own
    };
    let parts: Vec<(usize, Splats)> =
        parts.iter().enumerate().filter(|(_, p)| !p.is_empty()).map(|(k, p)| (k, own(p))).collect();
    drop(splats);
    let mut below = Vec::new();
    for (k, part) in parts {
        below.push(divide(part, &format!("{id}{k}"), level + 1, write)?);
    }
    parent(id, below, write)
}

/// Joins tiles under one, by parents in between if they are many. None without tiles.
///
/// # Errors
/// Those of `write`.
pub fn join<E>(
    id: &str,
    mut tiles: Vec<(TileNode, Splats)>,
    write: &mut dyn FnMut(&str, &Splats) -> Result<(), E>,
) -> Result<Option<TileNode>, E> {
    if tiles.len() <= JOINED {
        return Ok(match tiles.len() {
            0 => None,
            1 => tiles.pop().map(|(node, _)| node),
            _ => Some(parent(id, tiles, write)?.0),
        });
    }
    let joined = join_many(id, tiles, write)?;
    Ok(Some(joined.0))
}

fn join_many<E>(
    id: &str,
    mut tiles: Vec<(TileNode, Splats)>,
    write: &mut dyn FnMut(&str, &Splats) -> Result<(), E>,
) -> Result<(TileNode, Splats), E> {
    if tiles.len() > JOINED {
        // Halves along the longer side of the centres, until few are left.
        let center = |node: &TileNode, k: usize| node.bounds[0][k] + node.bounds[1][k];
        let centers: Vec<[f32; 3]> =
            tiles.iter().map(|(node, _)| [0, 1, 2].map(|k| center(node, k))).collect();
        let (low, high) = bounds(&centers);
        let axis = usize::from(high[1] - low[1] > high[0] - low[0]);
        tiles.sort_by(|(a, _), (b, _)| center(a, axis).total_cmp(&center(b, axis)));
        let upper = tiles.split_off(tiles.len() / 2);
        let halves = [(0, tiles), (1, upper)];
        let mut below = Vec::new();
        for (k, half) in halves {
            below.push(join_many(&format!("{id}{k}"), half, write)?);
        }
        return parent(id, below, write);
    }
    parent(id, tiles, write)
}

/// The tile above others.
fn parent<E>(
    id: &str,
    below: Vec<(TileNode, Splats)>,
    write: &mut dyn FnMut(&str, &Splats) -> Result<(), E>,
) -> Result<(TileNode, Splats), E> {
    let (mut children, mut all) = (Vec::new(), Splats::default());
    for (node, splats) in below {
        children.push(node);
        append(&mut all, splats);
    }
    let (low, high) = bounds(&all.position);
    let cell = (0..3).map(|k| high[k] - low[k]).fold(f32::MIN_POSITIVE, f32::max) / CELLS;
    let merged = merge(&all, low, cell);
    write(id, &merged)?;
    let mut around = extent(&merged);
    for child in &children {
        around = union(around, child.bounds);
    }
    let below_m = children.iter().map(|c| c.error_m).fold(0.0, f64::max);
    let error_m = below_m.max(DIAGONAL * f64::from(cell));
    let node = TileNode { id: id.into(), bounds: around, error_m, splats: merged.len(), children };
    Ok((node, merged))
}

/// Appends splats; those without spherical harmonics get some of zero if the others have some.
fn append(all: &mut Splats, mut more: Splats) {
    if all.is_empty() {
        *all = more;
        return;
    }
    if all.f_rest.is_empty() != more.f_rest.is_empty() {
        all.f_rest.resize(all.len(), [0.0; 45]);
        more.f_rest.resize(more.len(), [0.0; 45]);
    }
    all.append(more);
}

/// Corners of the box around splats with their extent.
fn extent(splats: &Splats) -> [[f32; 3]; 2] {
    let corner = |sign: f32| -> Vec<[f32; 3]> {
        let radius = |s: &[f32; 3]| EXTENT * s.iter().fold(f32::MIN, |m, v| m.max(*v)).exp();
        let pairs = splats.position.iter().zip(&splats.log_scale);
        pairs.map(|(p, s)| p.map(|v| v + sign * radius(s))).collect()
    };
    [bounds(&corner(-1.0)).0, bounds(&corner(1.0)).1]
}

fn union(a: [[f32; 3]; 2], b: [[f32; 3]; 2]) -> [[f32; 3]; 2] {
    [std::array::from_fn(|k| a[0][k].min(b[0][k])), std::array::from_fn(|k| a[1][k].max(b[1][k]))]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    /// Splats on a sloping square of ground.
    fn ground(side: usize, at: f32) -> Splats {
        let mut splats = Splats::default();
        for i in 0..side * side {
            let (x, y) = ((i % side) as f32, (i / side) as f32);
            splats.push([at + x, y, 0.05 * x], 0.5, 0.9, [0.2, 0.5, x / side as f32]);
        }
        splats
    }

    #[test]
    fn leaves_hold_all_splats_once_and_parents_fewer() {
        let splats = ground(400, 0.0);
        let mut files = BTreeMap::new();
        let mut write = |id: &str, splats: &Splats| -> Result<(), ()> {
            assert!(files.insert(id.to_owned(), splats.clone()).is_none());
            Ok(())
        };
        let (root, top) = subtree(splats.clone(), "r", &mut write).unwrap();
        // A quadtree: the ground is flat.
        assert_eq!((root.children.len(), root.levels(), files.len()), (4, 2, 5));
        let leaves: Vec<&TileNode> = root.all().filter(|n| n.children.is_empty()).collect();
        let mut found: Vec<[f32; 3]> = leaves.iter().flat_map(|n| files[&n.id].position.clone()).collect();
        let mut expected = splats.position.clone();
        let by_place = |a: &[f32; 3], b: &[f32; 3]| a[1].total_cmp(&b[1]).then(a[0].total_cmp(&b[0]));
        found.sort_by(by_place);
        expected.sort_by(by_place);
        assert_eq!(found, expected);
        assert!(top.len() < splats.len() / 4 && top.len() == root.splats);
        let cell = 399.0 / 128.0;
        assert!((root.error_m - DIAGONAL * cell).abs() < 1e-3 && leaves.iter().all(|n| n.error_m == 0.0));
        for child in &root.children {
            for k in 0..3 {
                assert!(root.bounds[0][k] <= child.bounds[0][k] && root.bounds[1][k] >= child.bounds[1][k]);
            }
        }
    }

    #[test]
    fn many_tiles_are_joined_under_one_root() {
        let mut written = 0;
        let mut write = |_: &str, _: &Splats| -> Result<(), ()> {
            written += 1;
            Ok(())
        };
        let tiles: Vec<_> = (0..20)
            .map(|i| subtree(ground(10, 10.0 * i as f32), &format!("t{i}-"), &mut write).unwrap())
            .collect();
        let root = join("r", tiles, &mut write).unwrap().unwrap();
        let leaves: Vec<&TileNode> = root.all().filter(|n| n.children.is_empty()).collect();
        assert_eq!((leaves.len(), root.levels()), (20, 4));
        assert_eq!(written, root.all().count());
        assert!(root.all().all(|n| n.children.iter().all(|c| c.error_m <= n.error_m)));
        assert_eq!(join::<()>("r", Vec::new(), &mut |_, _| Ok(())), Ok(None));
    }
}
