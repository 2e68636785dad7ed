//! Splats through one affine camera: image ellipses, the tiles they touch, and the gradient's way back.

use super::bands::Band;
use super::block::TILE;
use super::kernel::{Slot, add};
use super::prepare::{ELEMENTS, Prepared, PreparedSplat, SplatGradient, gather, scatter};
use super::{ALPHA_CUT, LOW_PASS_PX2};
use crate::affine::AffineCamera;
use crate::splat::lanes::{Kernel, LANES, Lanes, Lanewise, splat_each};
use crate::splat::real::Real;
use std::ops::Range;

/// Ranks that are projected together; fixed, so that sums do not depend on the number of threads.
pub(super) const CHUNK: usize = 2048;

/// An affine camera and the size of its image, in the numbers of the rasteriser.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameCamera<T> {
    /// Rows (col, row), columns (east, north, up), pixels per metre.
    pub linear: [[T; 3]; 2],
    /// Image position of the site's origin, pixels.
    pub offset: [T; 2],
    /// Columns of the image.
    pub width: usize,
    /// Rows of the image.
    pub height: usize,
}

impl<T: Real> FrameCamera<T> {
    /// The camera for an image of this size.
    #[must_use]
    pub fn new(camera: &AffineCamera, width: usize, height: usize) -> Self {
        Self { linear: camera.linear.map(|l| l.map(T::of)), offset: camera.offset.map(T::of), width, height }
    }
}

/// The ellipse at which a splat's alpha falls to the cut-off; or, of rows, those of several splats.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Footprint<N> {
    /// Centre, pixels.
    pub mean: [N; 2],
    /// Inverse covariance: xx, xy, yy; 1/px².
    pub conic: [N; 3],
    /// Binary logarithm of the opacity.
    pub log2_opacity: N,
    /// Squared Mahalanobis radius of the cut-off.
    pub radius2: N,
    /// Row (from the centre) of the rightmost column at the cut-off.
    pub lean: N,
}

impl<N: Copy> Footprint<N> {
    /// Its numbers, as they are stored.
    #[inline(always)]
    fn numbers(self) -> [N; 8] {
        let Self { mean: [u, v], conic: [a, b, c], log2_opacity, radius2, lean } = self;
        [u, v, a, b, c, log2_opacity, radius2, lean]
    }

    /// From [`Footprint::numbers`].
    #[inline(always)]
    pub fn of([u, v, a, b, c, log2_opacity, radius2, lean]: [N; 8]) -> Self {
        Self { mean: [u, v], conic: [a, b, c], log2_opacity, radius2, lean }
    }
}

/// A splat that the camera sees.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Seen<T> {
    /// [`Footprint::numbers`].
    pub footprint: [T; 8],
    /// Rank of the splat.
    pub rank: u32,
}

/// The tiles `first..=last` of one band that a footprint of a chunk touches.
#[derive(Clone, Copy, Debug)]
pub(super) struct Span {
    /// Index of the splat among those that its chunk's camera sees.
    pub splat: u32,
    pub first: u16,
    pub last: u16,
}

/// What a camera sees of a run of ranks, and where it lies.
pub(super) struct Chunk<T> {
    start: usize,
    seen: Vec<Seen<T>>,
    /// Spans sorted by band, within a band by rank.
    spans: Vec<Span>,
    /// Each span's splat: a band reads its own from first to last.
    drawn: Vec<Seen<T>>,
    /// Spans of band `b` are `spans[band_starts[b]..band_starts[b + 1]]`.
    band_starts: Vec<u32>,
    unsorted: Vec<(u32, Span)>,
    /// The derivative by each rank's image position; none where no pixel sees it.
    by_mean: Vec<Option<[T; 2]>>,
}

/// Projects a chunk; a kernel to be compiled with the processor's own rounding and fused instructions.
pub(super) struct Projection<'a, T> {
    pub chunk: &'a mut Chunk<T>,
    pub prepared: &'a Prepared<T>,
    pub ranks: Range<usize>,
    pub camera: &'a FrameCamera<T>,
}

impl<T: Lanewise> Kernel<T> for Projection<'_, T> {
    #[inline(always)]
    fn run<L: Lanes<Number = T>>(self, lanes: L) {
        self.chunk.project(lanes, self.prepared, self.ranks, self.camera);
    }
}

impl<T> Default for Chunk<T> {
    fn default() -> Self {
        Self {
            start: 0,
            seen: Vec::new(),
            spans: Vec::new(),
            drawn: Vec::new(),
            band_starts: Vec::new(),
            unsorted: Vec::new(),
            by_mean: Vec::new(),
        }
    }
}

impl<T: Real> Chunk<T> {
    /// Projects the splats of `ranks`, leaving out those that no pixel sees.
    #[inline(always)]
    fn project<L: Lanes<Number = T>>(
        &mut self,
        lanes: L,
        prepared: &Prepared<T>,
        ranks: Range<usize>,
        camera: &FrameCamera<T>,
    ) {
        self.start = ranks.start;
        self.seen.clear();
        self.unsorted.clear();
        let bands = camera.height.div_ceil(TILE);
        for (first, splats) in ranks.clone().step_by(L::WIDTH).zip(prepared.splats[ranks].chunks(L::WIDTH)) {
            let mut ellipses = [Ellipse::default(); LANES];
            Ellipse::of(lanes, splats, camera, &mut ellipses);
            for (k, (ellipse, splat)) in ellipses.iter().zip(splats).enumerate() {
                if !ellipse.is_seen(splat.opacity) {
                    continue;
                }
                let before = self.unsorted.len();
                let splat = self.seen.len() as u32;
                ellipse.for_each_span(camera, |band, first, last| {
                    self.unsorted.push((band, Span { splat, first, last }));
                });
                if self.unsorted.len() > before {
                    let Ellipse { mean, conic, log2_opacity, radius2, lean, .. } = *ellipse;
                    let rank = (first + k) as u32;
                    let footprint = Footprint { mean, conic, log2_opacity, radius2, lean }.numbers();
                    self.seen.push(Seen { footprint, rank });
                }
            }
        }
        self.sort_spans(bands);
    }

    /// A counting sort by band; equal bands keep their order.
    fn sort_spans(&mut self, bands: usize) {
        self.band_starts.clear();
        self.band_starts.resize(bands + 1, 0);
        for (band, _) in &self.unsorted {
            self.band_starts[*band as usize + 1] += 1;
        }
        for b in 0..bands {
            self.band_starts[b + 1] += self.band_starts[b];
        }
        self.spans.resize(self.unsorted.len(), Span { splat: 0, first: 0, last: 0 });
        self.drawn.resize(self.unsorted.len(), Seen::default());
        for (band, span) in &self.unsorted {
            let at = &mut self.band_starts[*band as usize];
            self.spans[*at as usize] = *span;
            self.drawn[*at as usize] = self.seen[span.splat as usize];
            *at += 1;
        }
        // The starts have become ends: shift them back.
        for b in (0..bands).rev() {
            self.band_starts[b + 1] = self.band_starts[b];
        }
        self.band_starts[0] = 0;
    }

    /// Spans in one band, by rank.
    pub fn spans(&self, band: usize) -> &[Span] {
        &self.spans[self.places(band)]
    }

    /// The splats of [`Chunk::spans`].
    pub fn drawn(&self, band: usize) -> &[Seen<T>] {
        &self.drawn[self.places(band)]
    }

    fn places(&self, band: usize) -> Range<usize> {
        self.band_starts[band] as usize..self.band_starts[band + 1] as usize
    }

    /// Sums the bands' slots per footprint and adds them, taken back through the camera, to the splats' gradients.
    pub fn gather<const C: usize>(
        &mut self,
        index: usize,
        bands: &[Band<T, C>],
        camera: &FrameCamera<T>,
        gradients: &mut [SplatGradient<T>],
        by_feature: &mut [[T; C]],
    ) {
        // By splat: small enough to stay in the cache, while all else is read and written from first to last.
        let mut sums = [Slot::default(); CHUNK];
        for (b, band) in bands.iter().enumerate() {
            for (span, slot) in self.spans(b).iter().zip(band.slots_of_chunk(index)) {
                sums[span.splat as usize].add(slot);
            }
        }
        self.by_mean.clear();
        self.by_mean.resize(gradients.len(), None);
        for (splat, sum) in self.seen.iter().zip(&sums) {
            let place = splat.rank as usize - self.start;
            let footprint = Footprint::of(splat.footprint);
            self.by_mean[place] = Some(footprint.back_project(camera, sum, &mut gradients[place]));
            add(&mut by_feature[place], sum.feature);
        }
    }

    /// The derivative by the image position of a splat, by its rank within the chunk; none if no pixel sees it.
    pub fn seen(&self, rank: usize) -> Option<[T; 2]> {
        self.by_mean[rank]
    }
}

impl<T: Real> Footprint<T> {
    /// Adds what the sums over the image mean for the splat; gives the derivative by the ellipse's centre.
    #[inline(always)]
    fn back_project<const C: usize>(
        &self,
        camera: &FrameCamera<T>,
        by: &Slot<T, C>,
        out: &mut SplatGradient<T>,
    ) -> [T; 2] {
        let m = &camera.linear;
        let ([a, b, c], [sum, x, xx, y, xy, yy]) = (self.conic, by.moments);
        let mean = [a * x + b * y, b * x + c * y];
        for k in 0..3 {
            out.position[k] = out.position[k] + m[0][k] * mean[0] + m[1][k] * mean[1];
        }
        out.log_opacity = out.log_opacity + sum;
        // By the image's covariance: half of conic * moments * conic.
        let half = T::of(0.5);
        let p = [[a * xx + b * xy, a * xy + b * yy], [b * xx + c * xy, b * xy + c * yy]];
        let gxx = half * (p[0][0] * a + p[0][1] * b);
        let gxy = half * (p[0][0] * b + p[0][1] * c);
        let gyy = half * (p[1][0] * b + p[1][1] * c);
        for (k, (i, j)) in ELEMENTS.into_iter().enumerate() {
            let [u, v] = [gxx * m[0][j] + gxy * m[1][j], gxy * m[0][j] + gyy * m[1][j]];
            out.covariance[k] = out.covariance[k] + m[0][i] * u + m[1][i] * v;
        }
        mean
    }
}

/// The ellipse at which a splat's alpha falls to the cut-off.
#[derive(Clone, Copy, Default)]
struct Ellipse<T> {
    mean: [T; 2],
    conic: [T; 3],
    /// Squared Mahalanobis radius of the cut-off.
    radius2: T,
    /// Half width and height, pixels.
    half_size: [T; 2],
    /// Row (from the centre) of the rightmost column.
    lean: T,
    log2_opacity: T,
}

impl<T: Real> Ellipse<T> {
    /// The ellipses of up to a row of splats, a lane each.
    #[inline(always)]
    fn of<L: Lanes<Number = T>>(
        lanes: L,
        splats: &[PreparedSplat<T>],
        camera: &FrameCamera<T>,
        out: &mut [Self; LANES],
    ) {
        let n = splats.len();
        let [x, y, z] = gather(lanes, n, |i| splats[i].position);
        let [sxx, sxy, sxz, syy, syz, szz] = gather(lanes, n, |i| splats[i].covariance);
        let [opacity] = gather(lanes, n, |i| [splats[i].opacity]);
        let (m, offset) = (camera.linear.map(|row| splat_each(lanes, row)), splat_each(lanes, camera.offset));
        let constants = [-ALPHA_CUT.log2(), 2.0 * std::f64::consts::LN_2, LOW_PASS_PX2, 0.0].map(T::of);
        let [above_cut, twice_ln_2, low_pass, zero] = splat_each(lanes, constants);
        let (mut mean, mut rows) = ([zero; 2], [[zero; 3]; 2]);
        for i in 0..2 {
            let [a, b, c] = m[i];
            mean[i] = a.mul_add(x, b.mul_add(y, c.mul_add(z, offset[i])));
            rows[i] = [a * sxx + b * sxy + c * sxz, a * sxy + b * syy + c * syz, a * sxz + b * syz + c * szz];
        }
        let [r, s] = rows;
        let xx = r[0] * m[0][0] + r[1] * m[0][1] + r[2] * m[0][2] + low_pass;
        let xy = r[0] * m[1][0] + r[1] * m[1][1] + r[2] * m[1][2];
        let yy = s[0] * m[1][0] + s[1] * m[1][1] + s[2] * m[1][2] + low_pass;
        let inverse = (xx * yy - xy * xy).reciprocal();
        let log2_opacity = opacity.log2();
        let radius2 = twice_ln_2 * (log2_opacity + above_cut);
        let half_size = [(radius2 * xx).sqrt(), (radius2 * yy).sqrt()];
        // The regression line of row on column.
        let lean = xy * xx.reciprocal() * half_size[0];
        let conic = [yy * inverse, zero - xy * inverse, xx * inverse];
        scatter([mean[0], mean[1], conic[0], conic[1], conic[2]], n, |i, [u, v, a, b, c]| {
            (out[i].mean, out[i].conic) = ([u, v], [a, b, c]);
        });
        scatter([radius2, half_size[0], half_size[1], lean, log2_opacity], n, |i, [r, w, h, l, o]| {
            (out[i].radius2, out[i].half_size, out[i].lean, out[i].log2_opacity) = (r, [w, h], l, o);
        });
    }

    /// Whether a splat of this opacity can be seen, and its numbers are sound.
    #[inline(always)]
    fn is_seen(&self, opacity: T) -> bool {
        let [a, _, c] = self.conic;
        let sound = |v: T| v > T::zero() && v.is_finite();
        opacity > T::of(ALPHA_CUT)
            && sound(self.radius2)
            && sound(a)
            && sound(c)
            && self.mean[0].is_finite()
            && self.mean[1].is_finite()
    }

    /// Visits the bands it touches, each with its first and last tile.
    #[inline(always)]
    fn for_each_span(&self, camera: &FrameCamera<T>, mut visit: impl FnMut(u32, u16, u16)) {
        let [mx, my] = self.mean;
        let [half_cols, half_rows] = self.half_size;
        let (top, bottom) = pixels_within(my - half_rows, my + half_rows, camera.height);
        let (left, right) = pixels_within(mx - half_cols, mx + half_cols, camera.width);
        if top > bottom || left > right {
            return;
        }
        let (first, last) = (tile_of(left), tile_of(right));
        for band in tile_of(top)..=tile_of(bottom) {
            // Most splats are narrower than a tile: nothing is to be told apart.
            if first == last {
                visit(band.into(), first, last);
                continue;
            }
            let band_top = T::of(f64::from(band) * TILE as f64) - my;
            let band_bottom = band_top + T::of(TILE as f64 - 1.0);
            let from = mx + self.furthest(-T::one(), band_top, band_bottom);
            let to = mx + self.furthest(T::one(), band_top, band_bottom);
            let (left, right) = pixels_within(from, to, camera.width);
            if left <= right {
                visit(band.into(), tile_of(left), tile_of(right));
            }
        }
    }

    /// Column (from the centre) of the ellipse's edge on one `side` (-1 or 1) within a band's rows.
    #[inline(always)]
    fn furthest(&self, side: T, top: T, bottom: T) -> T {
        let lean = side * self.lean;
        if lean >= top && lean <= bottom {
            return side * self.half_size[0];
        }
        let dy = lean.max(top).min(bottom);
        let [a, b, c] = self.conic;
        let inside = b * b * dy * dy - a * (c * dy * dy - self.radius2);
        // A band that the ellipse only grazes can miss it by rounding.
        (side * inside.max(T::zero()).sqrt() - b * dy) / a
    }
}

/// First and last pixel from `low` to `high` of `count` in a line; none if the first lies beyond the last.
#[inline(always)]
fn pixels_within<T: Real>(low: T, high: T, count: usize) -> (T, T) {
    (low.max(T::zero()).ceil(), high.min(T::of(count as f64 - 1.0)).floor())
}

/// The tile that a pixel's column or row lies in.
#[inline(always)]
fn tile_of<T: Real>(pixel: T) -> u16 {
    (pixel.small() / TILE as u32) as u16
}
