//! One cloud of the depths of all photographs.

use super::neighbours::nearby;
use crate::frame::{Pixel, Point, Site};
use crate::io::Grid2;
use crate::perspective::PinholeCamera;
use rayon::prelude::*;

/// Depths of one surface differ by less than this share.
const SAME_DEPTH: f64 = 0.02;
/// Points are counted at every so many columns and rows.
const COUNTED_STRIDE: usize = 4;
/// Of the views with the nearest centres so many are asked whether they see a point too.
const ASKED: usize = 12;
/// Points where a view has no depth, and those beyond the frames of all views, are those of every so many of the columns and rows of
/// the others.
const HOLE_STRIDE: usize = 2;
const BEYOND_STRIDE: usize = 8;
/// Frames are extended by this share of their size on every side.
const BEYOND: f64 = 0.5;

/// A point of the surface that photographs show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MatchedPoint {
    /// Its place.
    pub position: Point<Site>,
    /// The view that it is from.
    pub view: usize,
    /// Its column and row there: outside of the image, if no view sees it.
    pub pixel: [i64; 2],
}

/// The points behind the pixels of photographs with depths, each surface from the view that sees it most closely of those nearby; of
/// more than about `most` points those of every second, third and so on column and row.
///
/// Where a view has no depth, points lie on a smooth surface through the depths around, so that every ray ends. This surface extends
/// beyond the frames, where no photograph shows anything.
#[must_use]
pub fn matched_points(cameras: &[PinholeCamera], depths: &[&Grid2], most: usize) -> Vec<MatchedPoint> {
    let others = nearby(cameras);
    let views: Vec<View> = cameras.iter().zip(depths).map(|(camera, depth)| View { camera, depth }).collect();
    let points = |stride| -> Vec<Vec<MatchedPoint>> {
        let of_view = |view: usize| of_view(&views, view, &others[view], stride);
        (0..cameras.len()).into_par_iter().map(of_view).collect()
    };
    let counted: usize = points(COUNTED_STRIDE).iter().map(Vec::len).sum();
    let all = counted * COUNTED_STRIDE.pow(2);
    points(((all as f64 / most.max(1) as f64).sqrt().round() as usize).max(1)).concat()
}

/// A view with depths.
struct View<'a> {
    camera: &'a PinholeCamera,
    depth: &'a Grid2,
}

/// What is known of the surface on the ray of a pixel.
#[derive(Clone, Copy, PartialEq)]
enum Place {
    /// Its depth.
    Known,
    /// The depths around.
    Hole,
    /// The depths in the frame, which does not reach there.
    Beyond,
}

impl Place {
    /// Points are those of every so many columns and rows.
    fn stride(self) -> usize {
        match self {
            Self::Known => 1,
            Self::Hole => HOLE_STRIDE,
            Self::Beyond => BEYOND_STRIDE,
        }
    }
}

impl View<'_> {
    /// The depth that the view has where it sees a point, and that of the point.
    fn depths_at(&self, p: Point<Site>) -> Option<(f64, f64)> {
        let px = self.camera.project(p)?;
        let there = f64::from(self.depth.get(px.col.round() as i64, px.row.round() as i64));
        (!there.is_nan()).then(|| (there, self.camera.depth(p)))
    }

    /// Whether a point lies in the frame.
    fn frames(&self, p: Point<Site>) -> bool {
        let is_inside = |v: f64, count: usize| v >= -0.5 && v < count as f64 - 0.5;
        self.camera
            .project(p)
            .is_some_and(|px| is_inside(px.col, self.depth.width) && is_inside(px.row, self.depth.height))
    }
}

/// The points of a view at every `stride`-th column and row. `others` are the views nearby, the nearest first.
fn of_view(views: &[View], view: usize, others: &[usize], stride: usize) -> Vec<MatchedPoint> {
    let View { camera, depth } = views[view];
    let asked = &others[..others.len().min(ASKED)];
    let margin = [depth.width, depth.height].map(|side| (BEYOND * side as f64) as usize);
    let wide = Grid2::from_fn(depth.width + 2 * margin[0], depth.height + 2 * margin[1], |col, row| {
        depth.get(col as i64 - margin[0] as i64, row as i64 - margin[1] as i64)
    });
    let filled = filled(&wide);
    let mut out = Vec::new();
    for row in (stride / 2..wide.height).step_by(stride) {
        for col in (stride / 2..wide.width).step_by(stride) {
            let pixel = [col as i64 - margin[0] as i64, row as i64 - margin[1] as i64];
            let is_framed = pixel[0] >= 0
                && pixel[1] >= 0
                && pixel[0] < depth.width as i64
                && pixel[1] < depth.height as i64;
            let place = match is_framed {
                _ if !wide.at(col, row).is_nan() => Place::Known,
                true => Place::Hole,
                false => Place::Beyond,
            };
            let z = f64::from(filled.at(col, row));
            let is_chosen = [col, row].iter().all(|at| (at / stride).is_multiple_of(place.stride()));
            if z.is_nan() || !is_chosen {
                continue;
            }
            let [x, y, z] = camera.at_depth(Pixel::new(pixel[0] as f64, pixel[1] as f64), z);
            let position = Point::new(x, y, z);
            let own_scale = camera.focal.x / camera.depth(position);
            // Whether another view has the point, and sees it more closely; of equal ones the first has it.
            let has_it = |other: &usize| {
                let Some((there, depth)) = views[*other].depths_at(position) else { return false };
                let scale = views[*other].camera.focal.x / there;
                let is_closer = scale > own_scale || scale >= own_scale && *other < view;
                (depth / there - 1.0).abs() < SAME_DEPTH && is_closer
            };
            // Whether another view has what would be at the place of the point, or what it would hide.
            let contradicts = |other: &usize| {
                views[*other].depths_at(position).is_some_and(|(there, z)| z < (1.0 + SAME_DEPTH) * there)
            };
            let is_left_out = match place {
                Place::Known => asked.iter().any(has_it),
                Place::Hole => asked.iter().any(contradicts),
                Place::Beyond => others.iter().any(|other| views[*other].frames(position)),
            };
            if !is_left_out {
                out.push(MatchedPoint { position, view, pixel });
            }
        }
    }
    out
}

/// The depths, and where there are none, those of a smooth surface through the ones around: the mean of the inverse depths of the
/// smallest square of a pyramid that has some.
fn filled(depth: &Grid2) -> Grid2 {
    let mut inverse = depth.clone();
    inverse.data.iter_mut().for_each(|z| *z = z.recip());
    fill(&mut inverse);
    inverse.data.iter_mut().for_each(|w| *w = w.recip());
    inverse
}

/// Fills the cells without a value from the grid at half the size, which is filled first.
fn fill(grid: &mut Grid2) {
    if grid.width < 2 || grid.height < 2 || grid.data.iter().all(|v| !v.is_nan()) {
        return;
    }
    let mut half = grid.halved();
    fill(&mut half);
    let most = [half.width - 1, half.height - 1].map(|n| n as f64);
    for row in 0..grid.height {
        for col in 0..grid.width {
            let at = [col, row].map(|v| 0.5 * (v as f64 + 0.5) - 0.5);
            let value = &mut grid.data[row * grid.width + col];
            if value.is_nan() {
                *value = half.bilinear(at[0].clamp(0.0, most[0]), at[1].clamp(0.0, most[1]));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holes_are_filled_smoothly_and_depths_stay() {
        let depth = Grid2::from_fn(32, 24, |col, row| match col {
            8..20 if row > 5 => f32::NAN,
            _ => 1.0 / (0.2 + 0.01 * col as f32),
        });
        let found = filled(&depth);
        for (i, (a, b)) in found.data.iter().zip(&depth.data).enumerate() {
            let exact = 1.0 / (0.2 + 0.01 * (i % 32) as f32);
            assert!((a / exact - 1.0).abs() < 0.2 && (b.is_nan() || (a - b).abs() < 1e-5), "{a} {exact}");
        }
        assert!(filled(&Grid2::filled(9, 9, f32::NAN)).data.iter().all(|z| z.is_nan()));
    }
}
