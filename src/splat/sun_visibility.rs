//! Visibility of the sun from each splat, by the altitudes in the sun's image (SatGS, equation 10, along the rays of the sun).
//!
//! A splat sees the sun as far as nothing in the sun's image lies higher on its ray: the visibility is `exp(-ρ d)` for what
//! lies a distance of more than a bias above it, by `d` metres of altitude more than that. The bias lets the splats of one
//! roof not shadow each other.

use super::raster::Image;
use super::sheared_camera::ShearedCamera;
use super::splats::Splats;
use crate::simd::SimdReal;
use rayon::prelude::*;

/// What lies less than this above a splat does not hide the sun, metres.
const BIAS_M: f64 = 1.0;
/// The constant ρ, per metre of altitude.
const RATE_PER_M: f64 = 1.0;

/// Computes the visibility of the sun from the centre of each splat, 0 to 1, from the sun's image of altitudes. It is 1 for
/// splats outside of the image.
pub fn sun_visibility<T: SimdReal>(
    splats: &Splats<T>,
    sun: &ShearedCamera<T>,
    image: &Image<T>,
    out: &mut Vec<T>,
) {
    let of = |p: &[T; 3]| visibility_from(image, sun.camera.kernel.project(*p), p[2]);
    splats.position.par_iter().with_min_len(1024).map(of).collect_into_vec(out);
}

/// Visibility of a point of this altitude from where an image was taken, 0 to 1: whether nothing in the image of altitudes lies
/// higher at the pixel (column, row) that shows the point. It is 1 outside of the image.
#[must_use]
pub fn visibility_from<T: SimdReal>(image: &Image<T>, px: [T; 2], altitude: T) -> T {
    let Some(higher) = sample(image, px) else { return T::one() };
    let above = higher - altitude - T::from_f64(BIAS_M);
    (-T::from_f64(RATE_PER_M) * above.max(T::zero())).exp()
}

/// The altitude at a position between the pixels' centres; none outside of them.
fn sample<T: SimdReal>(image: &Image<T>, [col, row]: [T; 2]) -> Option<T> {
    let last = |n: usize| T::from_f64(n as f64 - 1.0);
    let inside = |v: T, n: usize| v >= T::zero() && v < last(n);
    if !inside(col, image.width) || !inside(row, image.height) {
        return None;
    }
    let (c, r) = (col.as_u32() as usize, row.as_u32() as usize);
    let (u, v) = (col - T::from_f64(c as f64), row - T::from_f64(r as f64));
    let at = |c: usize, r: usize| image.row(0, r)[c];
    let along = |r: usize| at(c, r) + u * (at(c + 1, r) - at(c, r));
    Some(along(r) + v * (along(r + 1) - along(r)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::affine::ViewCamera;
    use crate::splat::sheared_camera::SunView;

    #[test]
    fn the_sun_is_hidden_below_a_roof_and_visible_from_the_roof_and_beside_it() {
        let camera = ViewCamera::affine([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], [20.0, 20.0]);
        // The sun stands in the south-east: what is 1 m higher appears one pixel up and left of its place in its image.
        let sun = SunView::<f64>::new(&camera, (41, 41), [1.0, 1.0], (0.0, 10.0)).image;
        let mut image = Image::zeros(sun.camera.width, sun.camera.height, 2);
        let roof = sun.camera.kernel.project([0.0, 0.0, 10.0]).map(|v| v.round() as usize);
        for (col, row) in (0..25).map(|i| (roof[0] + i % 5 - 2, roof[1] + i / 5 - 2)) {
            *image.at_mut(0, col, row) = 10.0;
        }
        let mut splats = Splats::default();
        for position in [[0.0, 0.0, 10.0], [-10.0, 10.0, 0.0], [5.0, 5.0, 0.0]] {
            splats.push(position, 1.0, 0.5, [0.5; 3]);
        }
        let mut visibility = Vec::new();
        sun_visibility(&splats, &sun, &image, &mut visibility);
        assert!(visibility[0] == 1.0 && visibility[1] < 1e-3 && visibility[2] == 1.0, "{visibility:?}");
    }
}
