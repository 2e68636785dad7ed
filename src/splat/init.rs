//! Initialisation of the splats: on the surface of dense matching; at the sparse points of the bundle adjustment, with a level
//! ground plane that receives shadows (BAEOGS §3.1); or evenly in a volume (EOGS).

use crate::affine::{TrainingView, median_pixel_m};
use crate::frame::{Point, Site, SiteBox};
use crate::mvs::{FEW_VIEWS, MatchedSurface, ground_plane};
use crate::random::CounterRng;
use crate::splat::anchored::{Anchoring, StartSplats, nearest_anchors};
use crate::splat::primitive::PrimitiveKind;
use crate::splat::splats::{Splats, rotation_to};
use crate::stats::quantile;
use glam::DVec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use std::num::NonZero;

/// Number of additional splats around each sparse point, and their distance from it, metres (BAEOGS §3.1).
const COPIES: usize = 4;
const COPY_DISTANCE_M: f64 = 0.02;
/// Initial opacity; BAEOGS has 1.0, whose logit is infinite.
const OPACITY: f64 = 0.99;
/// Bounds of a splat's initial scale, metres.
const SCALE_M: (f64, f64) = (0.05, 2.0);
/// Spacing of the splats on a matched surface, metres, and their initial opacity.
pub const SPACING_M: f64 = 1.0;
const SURFACE_OPACITY: f32 = 0.9;
/// With few views the position of a wall is uncertain. Walls higher than this, metres, start as columns of splats of low opacity, of
/// which training makes those opaque that the images confirm (proposals of GeoProp-GS).
const HIGH_WALL_M: f64 = 3.0;
const WALL_OPACITY: f32 = 0.1;
/// Least spacing of the splats of such a column, metres; it is the size of a pixel if that is larger.
const LEAST_WALL_SPACING_M: f64 = 0.25;
/// Four neighbouring splats become one of twice the size if their altitudes differ from the mean by less, metres.
const FLAT_M: f64 = 0.25;
/// Splats in a volume: their number per cubic metre, initial opacity, and linear value of each colour channel (EOGS).
const VOLUME_DENSITY: f64 = 0.13;
const VOLUME_OPACITY: f32 = 0.01;
const VOLUME_COLOR: f32 = 1.1;
/// Purposes of the random numbers.
const DRAW_COPY: u64 = 1;
const DRAW_GROUND: u64 = 2;
const DRAW_VOLUME: u64 = 3;

/// Five splats at each sparse point (site frame, metres), and one for each square metre of `area` on the level plane below
/// which 2 % of the sparse points lie (BAEOGS §3.1).
#[must_use]
pub fn init_from_points(sparse: &[Point<Site>], area: SiteBox, seed: u64) -> Splats {
    let mut points = Vec::with_capacity(sparse.len() * (COPIES + 1));
    for (i, p) in sparse.iter().enumerate() {
        points.push(p.xyz());
        for k in 0..COPIES {
            let d = CounterRng::new(seed, DRAW_COPY, k as u64, i as u64).direction();
            let p = p.xyz();
            points.push(std::array::from_fn(|a| p[a] + COPY_DISTANCE_M * d[a]));
        }
    }
    let plane = ground_plane(sparse);
    let (west, south, east, north) = area;
    let count = ((east - west) * (north - south)).max(0.0) as usize;
    let ground: Vec<[f64; 3]> = (0..count)
        .map(|i| {
            let mut draw = CounterRng::new(seed, DRAW_GROUND, 0, i as u64);
            let x = west + (east - west) * draw.uniform();
            let y = south + (north - south) * draw.uniform();
            [x, y, plane]
        })
        .collect();
    let mut out = Splats::default();
    // The scales of sparse points and of ground plane splats are computed from neighbours of the same kind.
    for (points, gray) in [(points, 1.0), (ground, 0.0)] {
        for (p, scale) in points.iter().zip(clamped_scales(&points)) {
            out.push(p.map(|v| v as f32), scale as f32, OPACITY as f32, [gray; 3]);
        }
    }
    out
}

/// Splats of low opacity, evenly distributed over the area (west, south, east, north; site frame, metres) between two
/// altitudes, metres (EOGS).
#[must_use]
pub fn init_from_volume((west, south, east, north): SiteBox, (low, high): (f64, f64), seed: u64) -> Splats {
    let count = VOLUME_DENSITY * (east - west) * (north - south) * (high - low);
    let position = |i: u64| {
        let mut draw = CounterRng::new(seed, DRAW_VOLUME, 0, i);
        [(west, east), (south, north), (low, high)].map(|(from, to)| from + (to - from) * draw.uniform())
    };
    let positions: Vec<[f64; 3]> = (0..count.max(0.0) as u64).map(position).collect();
    let mut out = Splats::default();
    for (p, scale) in positions.iter().zip(clamped_scales(&positions)) {
        out.push(p.map(|v| v as f32), scale as f32, VOLUME_OPACITY, [VOLUME_COLOR; 3]);
    }
    out
}

/// Splats on a matched surface with the median colours of the views. Flat parts have larger splats; at steps of the surface,
/// columns of splats fill the wall from the upper to the lower altitude, those of high walls with low opacity if there are few
/// views. The third axis of each splat is the surface's normal if they are to be discs.
///
/// With few views, splats where the surface was not matched are anchored to the nearest where it was, and those of a wall to the one at
/// its upper edge (GeoProp-GS §3.3): what hardly an image shows moves with what images show well.
#[must_use]
pub fn init_from_surface(
    surface: &MatchedSurface,
    views: &[TrainingView],
    primitive: PrimitiveKind,
) -> StartSplats {
    let cells = ((SPACING_M / surface.grid.cell).round() as usize).max(1);
    let (columns, rows) = (surface.grid.width / cells, surface.grid.height / cells);
    let at = |col: usize, row: usize| {
        let (col, row) = (col.min(columns - 1), row.min(rows - 1));
        surface.point(col * cells + cells / 2, row * cells + cells / 2).xyz()
    };
    let spacing = cells as f64 * surface.grid.cell;
    let wall_spacing = median_pixel_m(views).max(LEAST_WALL_SPACING_M).min(spacing);
    let quads: Vec<(usize, usize)> =
        (0..rows / 2).flat_map(|r| (0..columns / 2).map(move |c| (2 * c, 2 * r))).collect();
    let support = |&(col, row): &(usize, usize)| {
        let score = surface.score.at(col * cells + cells / 2, row * cells + cells / 2);
        if score > 0.0 { Support::Matched } else { Support::Filled }
    };
    let splats_of_quad = |&(col, row): &(usize, usize)| {
        let places = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(c, r)| (col + c, row + r));
        let points = places.map(|(c, r)| at(c, r));
        let mean: [f64; 3] = std::array::from_fn(|k| points.iter().map(|p| p[k]).sum::<f64>() / 4.0);
        if points.iter().all(|p| (p[2] - mean[2]).abs() < FLAT_M) {
            let (size, opacity) = (2.0 * spacing, SURFACE_OPACITY);
            let is_filled = places.iter().all(|place| support(place) == Support::Filled);
            let support = if is_filled { Support::Filled } else { Support::Matched };
            return vec![SurfaceSplat { position: mean, size, normal: DVec3::Z, opacity, support }];
        }
        let mut splats = Vec::new();
        for ((c, r), p) in places.into_iter().zip(points).filter(|(_, p)| !p[2].is_nan()) {
            let around = [(c + 1, r), (c, r + 1), (c.saturating_sub(1), r), (c, r.saturating_sub(1))];
            let around = around.map(|(c, r)| at(c, r));
            let lowest = around.iter().fold(p[2], |m, q| m.min(q[2]));
            let rise = |ahead: [f64; 3], behind: [f64; 3]| (ahead[2] - behind[2]) / (2.0 * spacing);
            // Rows run southwards.
            let normal = DVec3::new(-rise(around[0], around[2]), rise(around[1], around[3]), 1.0);
            let normal = normal.try_normalize().unwrap_or(DVec3::Z);
            let (size, opacity, support) = (spacing, SURFACE_OPACITY, support(&(c, r)));
            splats.push(SurfaceSplat { position: p, size, normal, opacity, support });
            let drop = p[2] - lowest;
            let (size, normal, opacity) = if views.len() <= FEW_VIEWS && drop > HIGH_WALL_M {
                let level = DVec3::new(normal.x, normal.y, 0.0).try_normalize().unwrap_or(DVec3::X);
                (wall_spacing, level, WALL_OPACITY)
            } else {
                (spacing, normal, SURFACE_OPACITY)
            };
            let steps = (drop / size - 0.5).ceil().max(1.0) as usize;
            splats.extend((1..steps).map(|k| {
                let position = [p[0], p[1], p[2] - size * k as f64];
                SurfaceSplat { position, size, normal, opacity, support: Support::Wall { below: k } }
            }));
        }
        splats
    };
    let splats: Vec<SurfaceSplat> = quads.par_iter().flat_map_iter(splats_of_quad).collect();
    let colors: Vec<[f32; 3]> = splats.par_iter().map(|s| median_color(s.position, views)).collect();
    let anchorings = if views.len() <= FEW_VIEWS { anchorings_of(&splats) } else { Vec::new() };
    let mut out = Splats::default();
    for (splat, rgb) in splats.into_iter().zip(colors) {
        out.push(splat.position.map(|v| v as f32), 0.5 * splat.size as f32, splat.opacity, rgb);
        if primitive == PrimitiveKind::Disc {
            out.rotation[out.position.len() - 1] = rotation_to(splat.normal).map(|v| v as f32);
        }
    }
    StartSplats { splats: out, anchorings }
}

/// What tells where a splat of a matched surface is.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Support {
    /// The surface was matched there.
    Matched,
    /// The surface was filled in from around.
    Filled,
    /// Part of a wall, so many splats below its upper edge.
    Wall { below: usize },
}

/// Anchors splats of filled parts to the nearest of matched ones, and those of walls to what their upper edge goes with.
fn anchorings_of(splats: &[SurfaceSplat]) -> Vec<Anchoring> {
    let of = |support: Support| -> Vec<usize> {
        (0..splats.len()).filter(|i| splats[*i].support == support).collect()
    };
    let positions = |of: &[usize]| -> Vec<[f64; 3]> { of.iter().map(|i| splats[*i].position).collect() };
    let (matched, filled) = (of(Support::Matched), of(Support::Filled));
    let mut anchors: Vec<usize> = (0..splats.len()).collect();
    let Some(nearest) = nearest_anchors(&positions(&matched), &positions(&filled)) else { return Vec::new() };
    for (i, place) in filled.into_iter().zip(nearest) {
        anchors[i] = matched[place];
    }
    // The splats of a wall follow that of its upper edge.
    for (i, splat) in splats.iter().enumerate() {
        if let Support::Wall { below } = splat.support {
            anchors[i] = anchors[i - below];
        }
    }
    let anchored = anchors.into_iter().enumerate().filter(|(i, anchor)| i != anchor);
    anchored.map(|(i, anchor)| Anchoring { splat: i as u32, anchor: anchor as u32 }).collect()
}

/// A splat on a matched surface.
struct SurfaceSplat {
    position: [f64; 3],
    /// Its distance from the next ones, metres.
    size: f64,
    normal: DVec3,
    opacity: f32,
    support: Support,
}

/// The median of the views' linear colours at a position (site frame, metres); grey where no view shows it.
fn median_color([x, y, z]: [f64; 3], views: &[TrainingView]) -> [f32; 3] {
    let linear_color = |v: &TrainingView| {
        let color = v.color(v.camera.project(Point::new(x, y, z)))?;
        Some(color.map(|c| v.transfer_function.linear(c)))
    };
    let colors: Vec<[f32; 3]> = views.iter().filter_map(linear_color).collect();
    std::array::from_fn(|k| {
        let values = colors.iter().map(|c| f64::from(c[k])).collect();
        quantile(values, 0.5).map_or(0.5, |v| v as f32)
    })
}

/// [`neighbour_scales`] clamped to [`SCALE_M`], metres.
fn clamped_scales(points: &[[f64; 3]]) -> Vec<f64> {
    neighbour_scales(points).into_iter().map(|scale| scale.clamp(SCALE_M.0, SCALE_M.1)).collect()
}

/// Root mean square distance of each point to its three nearest neighbours, metres (3DGS); infinite where the points cannot be searched.
#[must_use]
pub fn neighbour_scales(points: &[[f64; 3]]) -> Vec<f64> {
    const NEIGHBOURS: NonZero<usize> = NonZero::new(4).unwrap();
    let tree = ImmutableKdTree::<f64, 3>::new_from_slice(points);
    let Ok(tree) = tree else { return vec![f64::INFINITY; points.len()] };
    points
        .par_iter()
        .map(|p| {
            // The nearest neighbour is the point itself.
            let near = tree.query(p).nearest_n::<SquaredEuclidean<f64>>(NEIGHBOURS).execute();
            let squares: Vec<f64> = near.iter().skip(1).map(|n| n.distance).collect();
            let mean = squares.iter().sum::<f64>() / squares.len().max(1) as f64;
            mean.sqrt()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::affine::ViewCamera;
    use crate::frame::SiteGrid;
    use crate::io::{Grid2, MapGrid};
    use glam::DQuat;

    /// A block of 16 m x 12 m and 12 m high on level ground, in cells of half a metre.
    fn block() -> MatchedSurface {
        let site = SiteGrid { epsg: 32617, origin: Point::new(436_200.0, 3_357_600.0, 10.0) };
        let (west, north) = (436_200.0 - 25.0, 3_357_600.0 + 20.0);
        let grid = MapGrid { epsg: 32617, west, north, cell: 0.5, width: 100, height: 80 };
        let altitude = Grid2::from_fn(100, 80, |col, row| {
            let (x, y) = (0.5 * col as f64 - 24.75, 19.75 - 0.5 * row as f64);
            if x.abs() < 8.0 && y.abs() < 6.0 { 12.0 } else { 0.0 }
        });
        let ones = Grid2::filled(100, 80, 1.0);
        MatchedSurface { site, grid, altitude, score: ones.clone(), prior_weight: ones }
    }

    #[test]
    fn splats_lie_on_the_surface_and_fill_its_walls() {
        let camera = ViewCamera::affine([[2.0, 0.0, 0.0], [0.0, -2.0, 0.0]], [79.5, 69.5]);
        let area = (-30.0, -25.0, 30.0, 25.0);
        let view =
            TrainingView::new("v".into(), camera, None, &[Grid2::filled(160, 140, 0.3)], area, (0.0, 0.0));
        let views = vec![view; FEW_VIEWS + 1];
        let StartSplats { splats, anchorings } = init_from_surface(&block(), &views, PrimitiveKind::Disc);
        assert!(anchorings.is_empty(), "with many views all splats are free");
        let near = |p: &&[f32; 3], z: f32| p[0].abs() < 5.0 && p[1].abs() < 3.0 && (p[2] - z).abs() < 0.5;
        assert!(splats.position.iter().filter(|p| near(p, 12.0)).count() >= 10);
        assert_eq!(
            splats.position.iter().filter(|p| near(p, 0.0)).count(),
            0,
            "no splat lies below the roof"
        );
        let on_walls = splats.position.iter().filter(|p| (2.0..10.0).contains(&p[2])).count();
        assert!(on_walls >= 150, "{on_walls}");
        let leans = |i: usize| {
            let [w, x, y, z] = splats.rotation[i].map(f64::from);
            (DQuat::from_xyzw(x, y, z, w) * DVec3::Z).z
        };
        let walls = (0..splats.len()).filter(|i| (2.0..10.0).contains(&splats.position[*i][2]));
        assert!(walls.map(leans).all(|z| z < 0.3), "the normals of walls are level");

        let of_few = init_from_surface(&block(), &views[1..], PrimitiveKind::Disc).splats;
        let walls: Vec<usize> =
            (0..of_few.len()).filter(|i| (2.0..10.0).contains(&of_few.position[*i][2])).collect();
        assert!(walls.len() > 3 * on_walls / 2, "{} instead of {on_walls}", walls.len());
        assert!(walls.iter().all(|i| of_few.opacity_logit[*i][0] < 0.0), "opacities of few views are low");
        let lowest = walls.iter().map(|i| of_few.position[*i][2]).fold(f32::MAX, f32::min);
        assert!(lowest < 2.6, "walls reach the ground: {lowest}");
    }

    #[test]
    fn what_was_not_matched_goes_with_what_was() {
        let mut surface = block();
        // The eastern margin was filled in, and the western half of the block, which has walls to the west and to the east.
        for row in 0..80 {
            for col in (80..100).chain(30..50) {
                surface.score.data[row * 100 + col] = 0.0;
            }
        }
        let StartSplats { splats, anchorings } = init_from_surface(&surface, &[], PrimitiveKind::Ellipsoid);
        let at = |i: u32| splats.position[i as usize];
        let x_and_z = |i: u32| (at(i)[0], at(i)[2]);
        let anchored: Vec<u32> = anchorings.iter().map(|a| a.splat).collect();
        let free: Vec<u32> = (0..splats.len() as u32).filter(|i| !anchored.contains(i)).collect();
        let distance = |i: u32, j: u32| at(i).iter().zip(at(j)).map(|(a, b)| (a - b).powi(2)).sum::<f32>();
        let is_filled = |x: f32| x > 15.4 || (-9.6..-0.4).contains(&x);
        assert!(anchorings.windows(2).all(|pair| pair[0].splat < pair[1].splat));
        let mut walls = 0;
        for Anchoring { splat, anchor } in &anchorings {
            let (x, z) = x_and_z(*splat);
            assert!(!is_filled(at(*anchor)[0]), "an anchor was matched");
            if (0.1..11.9).contains(&z) {
                walls += 1;
                // Upper edges that were filled in have anchors of their own.
                assert!(is_filled(x) || (at(*anchor)[2] > 11.5 && at(*anchor)[..2] == at(*splat)[..2]));
            } else {
                let nearest = free.iter().map(|i| distance(*splat, *i)).fold(f32::MAX, f32::min);
                assert!(is_filled(x) && distance(*splat, *anchor) <= nearest, "{x} {z}");
            }
        }
        assert!(walls > 100, "{walls}");
        let margin = (0..splats.len() as u32).filter(|i| x_and_z(*i).0 > 15.5);
        let free: Vec<_> = margin.clone().filter(|i| free.contains(i)).map(x_and_z).collect();
        assert!(margin.count() > 20 && free.is_empty(), "{free:?}");

        // Without a matched place everything is free.
        surface.score.data.fill(0.0);
        assert!(init_from_surface(&surface, &[], PrimitiveKind::Ellipsoid).anchorings.is_empty());
    }

    fn slope() -> Vec<Point<Site>> {
        (0..4000)
            .map(|i| {
                let mut d = CounterRng::new(5, 0, 0, i);
                let (x, y) = (200.0 * d.uniform() - 100.0, 160.0 * d.uniform() - 80.0);
                Point::new(x, y, 0.3 * x)
            })
            .collect()
    }

    #[test]
    fn the_ground_plane_has_one_splat_a_square_metre() {
        let sparse = slope();
        let splats = init_from_points(&sparse, (-100.0, -80.0, 100.0, 80.0), 0);
        assert_eq!(splats.len(), 5 * sparse.len() + 200 * 160);
    }

    #[test]
    fn a_volume_is_filled_evenly() {
        let splats = init_from_volume((-20.0, -10.0, 20.0, 10.0), (-5.0, 15.0), 0);
        assert_eq!(splats.len(), 2080, "0.13 splats per cubic metre");
        let lower = splats.position.iter().filter(|p| p[2] < 5.0).count();
        assert!((lower as i64 - 1040).abs() < 100, "{lower}");
        // Far from the volume's sides the expected root mean square distance of the nearest three is 1.49 m.
        let mean = splats.log_scale.iter().map(|s| s[0].exp()).sum::<f32>() / 2080.0;
        assert!((1.4..1.7).contains(&mean), "{mean}");
    }

    #[test]
    fn the_plane_lies_below_all_but_two_percent() {
        let sparse = slope();
        let splats = init_from_points(&sparse, (-10.0, -10.0, 10.0, 10.0), 0);
        let z = f64::from(splats.position[5 * sparse.len()][2]);
        let below = sparse.iter().filter(|p| p.z() < z - 1e-3).count();
        assert!((60..=90).contains(&below), "{below}");
    }

    #[test]
    fn scales_stay_within_their_bounds() {
        let splats = init_from_points(&slope(), (-100.0, -80.0, 100.0, 80.0), 0);
        let (lo, hi) = ((SCALE_M.0 * 0.999) as f32, (SCALE_M.1 * 1.001) as f32);
        assert!(splats.log_scale.iter().all(|s| (lo..=hi).contains(&s[0].exp())));
    }
}
