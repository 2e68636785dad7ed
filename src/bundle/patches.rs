//! Least-squares matching: where a patch of one view lies in the others, to a few hundredths of a pixel.
//!
//! Keypoints are found in two or three views each, and many sit on corners that move with the sun and the line of
//! sight: of shadows, of what hides something. A patch is sought in every view. What moves is unlike itself on
//! another date, and a place that many views show alike is rarely a wrong one (Grün 1985).

use super::correction::Parameters;
use super::problem::{Block, Measurement};
use super::scale_space::blurred;
use crate::frame::{CenterPx, Pixel};
use crate::io::{Grid2, Window};
use nalgebra::{Matrix2, Matrix4, Vector2, Vector4};
use std::collections::BTreeMap;

/// Half the side of a patch, and its side, samples; they lie a pixel of the reference apart.
const HALF: usize = 7;
const SIDE: usize = 2 * HALF + 1;
/// Standard deviation of the patch's window, pixels.
const WINDOW_PX: f64 = 4.0;
/// Blur that keeps bilinear interpolation from favouring whole pixels, pixels.
const BLUR_PX: f64 = 0.7;
/// How far from its predicted place a patch is sought, samples.
const REACH: usize = 2;
/// Correlation at whole samples from which the search goes on between them, and that a patch needs in the end.
const PROMISING: f64 = 0.6;
const LEAST_CORRELATION: f64 = 0.85;
/// Standard deviation of a position beyond which the patch is plain, or an edge that slides along itself, pixels.
const WORST_SIGMA_PX: f64 = 0.12;
const MAX_ITERATIONS: usize = 8;
/// Steps below this end the search, pixels.
const SMALLEST_STEP_PX: f64 = 0.01;

/// What is read of an image beyond the places where patches are to be sought: as far as a patch and its search reach in
/// a view of twice the scale, pixels.
const MARGIN_PX: f64 = 40.0;

/// Some of the points (metres east, north and up), by index, in squares of ground of about `side_m`, row by row: only what
/// images show of one square needs to be in memory at once.
#[must_use]
pub fn squares(points: &[[f64; 3]], some: Vec<usize>, side_m: f64) -> Vec<Vec<usize>> {
    let extents: [(f64, f64); 2] = std::array::from_fn(|k| {
        let along = some.iter().map(|i| points[*i][k]);
        along.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
    });
    let place = |i: usize, k: usize| {
        let (low, high) = extents[k];
        let count = ((high - low) / side_m).ceil().max(1.0);
        // The last point lies on the border of the last square.
        ((points[i][k] - low) / (high - low).max(f64::MIN_POSITIVE) * count).min(count - 1.0) as usize
    };
    let mut squares = BTreeMap::<[usize; 2], Vec<usize>>::new();
    for i in some {
        squares.entry([place(i, 1), place(i, 0)]).or_default().push(i);
    }
    squares.into_values().collect()
}

/// A part of an image, ready for patches to be sought in it.
pub struct Part {
    /// Its first column and row.
    first: Vector2<f64>,
    raster: Grid2,
}

impl Part {
    /// The part of an image of (columns, rows) that holds the patches at some places.
    ///
    /// # Errors
    /// Those of `read`.
    pub fn around<E>(
        places: impl Iterator<Item = Pixel<CenterPx>>,
        size: (usize, usize),
        read: impl FnOnce(Window) -> Result<Grid2, E>,
    ) -> Result<Self, E> {
        let inside = |p: &Pixel<CenterPx>| {
            let within = |v: f64, n: usize| (0.0..n as f64).contains(&v);
            within(p.col, size.0) && within(p.row, size.1)
        };
        let (mut cols, mut rows) = ((f64::INFINITY, 0.0f64), (f64::INFINITY, 0.0f64));
        for p in places.filter(inside) {
            cols = (cols.0.min(p.col), cols.1.max(p.col));
            rows = (rows.0.min(p.row), rows.1.max(p.row));
        }
        let reach = |(low, high): (f64, f64), n: usize| {
            let first = (low - MARGIN_PX).max(0.0) as usize;
            (first, ((high + MARGIN_PX) as usize + 1).min(n).saturating_sub(first))
        };
        let ((col, width), (row, height)) = (reach(cols, size.0), reach(rows, size.1));
        let raster = match width.min(height) {
            0 => Grid2::filled(0, 0, f32::NAN),
            _ => blurred(&read(Window { col, row, width, height })?, BLUR_PX),
        };
        Ok(Self { first: Vector2::new(col as f64, row as f64), raster })
    }
}

/// Seeks patches in views whose cameras are right to a pixel.
pub struct Seeker<'a> {
    block: &'a Block<'a>,
    corrections: &'a [Parameters],
    images: Vec<Part>,
    window: Bell,
}

impl<'a> Seeker<'a> {
    /// A seeker in the views of a block with these corrections.
    #[must_use]
    pub fn new(block: &'a Block<'a>, corrections: &'a [Parameters], images: Vec<Part>) -> Self {
        Self { block, corrections, images, window: Bell::new() }
    }

    /// Where the views show the patch around an observation of a point, itself included.
    #[must_use]
    pub fn track(&self, reference: &Measurement, point: [f64; 3]) -> Vec<Measurement> {
        let mut found = vec![*reference];
        let own = &self.images[reference.view];
        let at = Vector2::new(reference.px.col, reference.px.row) - own.first;
        let template =
            Samples::<SIDE>::new(&own.raster, at, Matrix2::identity()).and_then(|s| self.window.template(&s));
        let inverse = self.place(reference.view, point).1.try_inverse();
        let (Some(template), Some(inverse)) = (template, inverse) else { return found };
        for (view, image) in self.images.iter().enumerate().filter(|(v, _)| *v != reference.view) {
            let (start, by_ground) = self.place(view, point);
            // The patch is taken to be level.
            let place =
                self.window.locate(&template, &image.raster, start - image.first, by_ground * inverse);
            if let Some(px) = place.map(|p| p + image.first) {
                found.push(Measurement { view, px: Pixel::<CenterPx>::new(px[0], px[1]), weight: 1.0 });
            }
        }
        found.sort_by_key(|m| m.view);
        found
    }

    /// Where a view shows a point, and how that moves by metres east and north.
    fn place(&self, view: usize, point: [f64; 3]) -> (Vector2<f64>, Matrix2<f64>) {
        let origin = Measurement { view, px: Pixel::new(0.0, 0.0), weight: 1.0 };
        let o = self.block.linearise(&origin, &self.corrections[view], point);
        let [a, b] = o.by_point;
        (-Vector2::from(o.residual), Matrix2::new(a[0], a[1], b[0], b[1]))
    }
}

/// `N` by `N` samples of an image around a position.
struct Samples<const N: usize>([[f64; N]; N]);

impl<const N: usize> Samples<N> {
    /// None where some are missing or outside.
    fn new(image: &Grid2, at: Vector2<f64>, warp: Matrix2<f64>) -> Option<Self> {
        let half = (N / 2) as f64;
        let reach = half * Vector2::new(warp.row(0).abs().sum(), warp.row(1).abs().sum());
        let (last_col, last_row) = (image.width as f64 - 1.0, image.height as f64 - 1.0);
        let (least, most) = (at - reach, at + reach);
        // A comparison that NaN fails too.
        let inside = least.min() >= 0.0 && most[0] < last_col && most[1] < last_row;
        if !inside {
            return None;
        }
        let mut sum = 0.0;
        let samples = std::array::from_fn(|r| {
            std::array::from_fn(|c| {
                let p = at + warp * Vector2::new(c as f64 - half, r as f64 - half);
                let (col, row) = (p[0] as usize, p[1] as usize);
                let (right, down) = (p[0] - col as f64, p[1] - row as f64);
                let here = row * image.width + col;
                let line = |i: usize| {
                    let (a, b) = (f64::from(image.data[i]), f64::from(image.data[i + 1]));
                    a + right * (b - a)
                };
                let (above, below) = (line(here), line(here + image.width));
                let value = above + down * (below - above);
                sum += value;
                value
            })
        });
        f64::is_finite(sum).then_some(Self(samples))
    }
}

/// A patch less its mean, of length one under the window.
type Template = [[f64; SIDE]; SIDE];

/// The weights of a patch's samples: their sum is one.
struct Bell([[f64; SIDE]; SIDE]);

impl Bell {
    fn new() -> Self {
        let offset = |i: usize| i as f64 - HALF as f64;
        let bell = |r: usize, c: usize| {
            (-(offset(r).powi(2) + offset(c).powi(2)) / (2.0 * WINDOW_PX * WINDOW_PX)).exp()
        };
        let sum: f64 = (0..SIDE * SIDE).map(|k| bell(k / SIDE, k % SIDE)).sum();
        Self(std::array::from_fn(|r| std::array::from_fn(|c| bell(r, c) / sum)))
    }

    fn template(&self, patch: &Samples<SIDE>) -> Option<Template> {
        let (_, mean, deviation) = self.compare(&[[0.0; SIDE]; SIDE], patch, [0, 0]);
        let unit = patch.0.map(|row| row.map(|v| (v - mean) / deviation));
        (deviation > 0.0).then_some(unit)
    }

    /// Covariance with the template of the samples that start at (row, column), their mean, standard deviation.
    fn compare<const N: usize>(
        &self,
        template: &Template,
        there: &Samples<N>,
        [row, col]: [usize; 2],
    ) -> (f64, f64, f64) {
        // A sum a column: one sum would wait for itself.
        let mut sums = [[0.0; SIDE]; 3];
        for r in 0..SIDE {
            let values = &there.0[row + r][col..col + SIDE];
            for c in 0..SIDE {
                let weighted = self.0[r][c] * values[c];
                sums[0][c] += weighted * template[r][c];
                sums[1][c] += weighted;
                sums[2][c] += weighted * values[c];
            }
        }
        let [product, sum, square] = sums.map(|s| s.iter().sum::<f64>());
        (product, sum, (square - sum * sum).max(0.0).sqrt())
    }

    /// Where the template lies in an image; `warp` leads from its samples to the image's pixels.
    fn locate(
        &self,
        template: &Template,
        image: &Grid2,
        start: Vector2<f64>,
        warp: Matrix2<f64>,
    ) -> Option<Vector2<f64>> {
        let around = Samples::<{ SIDE + 2 * REACH }>::new(image, start, warp)?;
        let mut best = (PROMISING, None);
        for row in 0..=2 * REACH {
            for col in 0..=2 * REACH {
                let (product, _, deviation) = self.compare(template, &around, [row, col]);
                if product > best.0 * deviation {
                    best = (product / deviation, Some([col, row]));
                }
            }
        }
        let mut at = start + warp * Vector2::from(best.1?.map(|k| k as f64 - REACH as f64));
        for _ in 0..MAX_ITERATIONS {
            let there = Samples::<{ SIDE + 2 }>::new(image, at, warp)?;
            let (inverse, right) = self.normal(template, &there)?;
            let step = inverse * right;
            let moved = warp * Vector2::new(step[0], step[1]);
            at += moved;
            // NaN is too far as well.
            let near = (at - start).norm() < 2.0 * REACH as f64;
            if !near {
                return None;
            }
            if moved.norm() < SMALLEST_STEP_PX {
                let (product, _, deviation) = self.compare(template, &there, [1, 1]);
                let left = (deviation * deviation - product * product).max(0.0);
                // The weights sum to one: so many samples count in full.
                let samples = std::f64::consts::TAU * WINDOW_PX * WINDOW_PX;
                let sigma = (inverse[(0, 0)].max(inverse[(1, 1)]) * left / samples).sqrt();
                return (product >= LEAST_CORRELATION * deviation && sigma <= WORST_SIGMA_PX).then_some(at);
            }
        }
        None
    }

    /// Inverse normal matrix and right side of `there + gradient · step = gain · template + offset`.
    fn normal(
        &self,
        template: &Template,
        Samples(v): &Samples<{ SIDE + 2 }>,
    ) -> Option<(Matrix4<f64>, Vector4<f64>)> {
        let mut sums = [[0.0; SIDE]; 11];
        for r in 0..SIDE {
            for c in 0..SIDE {
                let (here, t) = (v[r + 1][c + 1], template[r][c]);
                let (x, y) = (0.5 * (v[r + 1][c + 2] - v[r + 1][c]), 0.5 * (v[r + 2][c + 1] - v[r][c + 1]));
                let terms = [x * x, x * y, y * y, x * t, y * t, x, y, x * here, y * here, t * here, here];
                for (sum, term) in sums.iter_mut().zip(terms) {
                    sum[c] += self.0[r][c] * term;
                }
            }
        }
        let [xx, xy, yy, xt, yt, x, y, xv, yv, tv, sum] = sums.map(|s| s.iter().sum::<f64>());
        // The template has no mean and length one.
        let normal = Matrix4::new(
            xx, xy, -xt, -x, //
            xy, yy, -yt, -y, //
            -xt, -yt, 1.0, 0.0, //
            -x, -y, 0.0, 1.0,
        );
        Some((normal.try_inverse()?, Vector4::new(-xv, -yv, tv, sum)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A smooth scene without a period that fits into a patch.
    fn scene(x: f64, y: f64) -> f64 {
        let waves = [(0.31, 0.17, 0.4), (-0.23, 0.41, 1.3), (0.52, -0.29, 2.1), (0.11, 0.63, 0.2)];
        waves.iter().map(|(u, v, phase)| 0.1 * (u * x + v * y + phase).sin()).sum::<f64>() + 0.5
    }

    fn image(f: impl Fn(f64, f64) -> f64) -> Grid2 {
        Grid2::from_fn(64, 64, |c, r| f(c as f64, r as f64) as f32)
    }

    /// Where the patch at (30.3, 31.6) of `a` is found in `b`, sought from `start` on.
    fn found(a: &Grid2, b: &Grid2, start: [f64; 2], warp: Matrix2<f64>) -> Option<Vector2<f64>> {
        let window = Bell::new();
        let patch = Samples::new(a, Vector2::new(30.3, 31.6), Matrix2::identity()).unwrap();
        window.locate(&window.template(&patch)?, b, start.into(), warp)
    }

    #[test]
    fn a_patch_is_found_in_a_warped_image_of_other_brightness() {
        // A pixel (c, r) of the second view shows what the first shows at warp⁻¹ ((c, r) - offset).
        let warp = Matrix2::new(0.95, 0.1, -0.06, 1.04);
        let offset = Vector2::new(1.7, -2.4);
        let back = warp.try_inverse().unwrap();
        let other = image(|c, r| {
            let p = back * (Vector2::new(c, r) - offset);
            0.2 + 0.6 * scene(p[0], p[1])
        });
        let exact = warp * Vector2::new(30.3, 31.6) + offset;
        for off in [[0.0, 0.0], [1.4, -1.2], [-0.6, 1.9]] {
            let at = found(&image(scene), &other, [exact[0] + off[0], exact[1] + off[1]], warp).unwrap();
            assert!((at - exact).norm() < 0.02, "{at} {exact}");
        }
    }

    #[test]
    fn points_are_taken_by_squares_of_the_ground_they_cover() {
        let points: Vec<[f64; 3]> =
            (0..60).map(|i| [f64::from(i % 10) * 10.0 - 30.0, f64::from(i / 10) * 10.0, 5.0]).collect();
        // 90 by 50 metres, without the first point.
        let made = squares(&points, (1..60).collect(), 50.0);
        assert_eq!(made.iter().map(Vec::len).collect::<Vec<_>>(), [29, 30]);
        assert!(made[0].iter().all(|i| points[*i][0] < 15.0), "{made:?}");
        assert_eq!(squares(&points, vec![7], 50.0), [[7]]);
        assert!(squares(&points, Vec::new(), 50.0).is_empty());
    }

    #[test]
    fn a_part_of_an_image_holds_what_is_sought_and_nothing_of_places_outside() {
        let whole = Grid2::from_fn(400, 300, |c, r| scene(c as f64, r as f64) as f32);
        let read = |w: Window| Ok::<_, std::convert::Infallible>(whole.window(w));
        let places = [[210.0, 170.5], [230.25, 160.0], [-50.0, 20.0]].map(|[c, r]| Pixel::new(c, r));
        let Ok(part) = Part::around(places.into_iter(), (400, 300), read);
        assert_eq!([part.first[0], part.first[1]], [170.0, 120.0]);
        assert_eq!((part.raster.width, part.raster.height), (101, 91));
        let (bell, blurred) = (Bell::new(), blurred(&whole, BLUR_PX));
        let at = Vector2::new(228.3, 161.6);
        let template = bell.template(&Samples::new(&blurred, at, Matrix2::identity()).unwrap()).unwrap();
        let start = at + Vector2::new(0.8, -1.1);
        let there = bell.locate(&template, &part.raster, start - part.first, Matrix2::identity()).unwrap();
        assert!((there + part.first - at).norm() < 1e-3, "{there}");
        let Ok(nothing) = Part::around(places[2..].iter().copied(), (400, 300), read);
        assert_eq!(nothing.raster.data.len(), 0);
    }

    #[test]
    fn what_is_plain_an_edge_or_something_else_is_not_found() {
        let here = [30.3, 31.6];
        let same = |a: &Grid2, b: &Grid2| found(a, b, here, Matrix2::identity());
        assert!(same(&image(scene), &image(scene)).is_some());
        let plain = image(|_, _| 0.5);
        assert!(same(&plain, &plain).is_none());
        let mut seed = 1u32;
        let mut grain = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            0.05 * ((seed >> 8) as f32 / (1u32 << 24) as f32 - 0.5)
        };
        let mut edge = || {
            let exact = image(|c, r| (0.5 * (c + 0.4 * r - 43.0)).tanh());
            Grid2 { data: exact.data.iter().map(|v| v + grain()).collect(), ..exact }
        };
        let (a, b) = (edge(), edge());
        assert!(same(&a, &b).is_none());
        assert!(same(&image(scene), &image(|c, r| scene(r + 7.0, -c))).is_none());
        let mut hole = image(scene);
        hole.data[33 * 64 + 28] = f32::NAN;
        assert!(same(&image(scene), &hole).is_none());
    }
}
