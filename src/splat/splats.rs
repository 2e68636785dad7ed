//! The splats: what is trained, as plain arrays.

use crate::simd::Real;
use serde::{Deserialize, Serialize};

/// Zeroth spherical harmonic: `rgb = SH_C0 * f_dc + 0.5`, as every 3DGS file means it.
pub const SH_C0: f64 = 0.282_094_791_773_878_14;

/// 3-D Splats in the site frame, structure of arrays, in the parametrisation that is optimised.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Splats<T = f32> {
    /// Centre: metres east, north, up from the site's origin.
    pub position: Vec<[T; 3]>,
    /// Natural logarithm of the standard deviations along the splat's own axes, metres.
    pub log_scale: Vec<[T; 3]>,
    /// Orientation, a quaternion (w, x, y, z) of any length.
    pub rotation: Vec<[T; 4]>,
    /// Opacity before the logistic function.
    pub logit: Vec<T>,
    /// Colour before `SH_C0 * f_dc + 0.5`.
    pub f_dc: Vec<[T; 3]>,
}

impl<T: Real> Splats<T> {
    /// Number of splats.
    #[must_use]
    pub fn len(&self) -> usize {
        self.logit.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.logit.is_empty()
    }

    /// As many splats, every parameter zero: a gradient or a moment to be summed into.
    #[must_use]
    pub fn zeros(n: usize) -> Self {
        let z = T::zero();
        Self {
            position: vec![[z; 3]; n],
            log_scale: vec![[z; 3]; n],
            rotation: vec![[z; 4]; n],
            logit: vec![z; n],
            f_dc: vec![[z; 3]; n],
        }
    }

    /// Takes this number of splats; new ones are zero.
    pub fn resize(&mut self, n: usize) {
        let z = T::zero();
        self.position.resize(n, [z; 3]);
        self.log_scale.resize(n, [z; 3]);
        self.rotation.resize(n, [z; 4]);
        self.logit.resize(n, z);
        self.f_dc.resize(n, [z; 3]);
    }

    /// Appends a round splat.
    pub fn push(&mut self, position: [T; 3], scale_m: T, opacity: T, rgb: [T; 3]) {
        let (zero, one) = (T::zero(), T::one());
        self.position.push(position);
        self.log_scale.push([scale_m.ln(); 3]);
        self.rotation.push([one, zero, zero, zero]);
        self.logit.push(logit(opacity));
        self.f_dc.push(rgb.map(|v| (v - T::from_f64(0.5)) / T::from_f64(SH_C0)));
    }

    /// Appends a copy of splat `i` of `from`.
    pub fn push_copy(&mut self, from: &Self, i: usize) {
        self.position.push(from.position[i]);
        self.log_scale.push(from.log_scale[i]);
        self.rotation.push(from.rotation[i]);
        self.logit.push(from.logit[i]);
        self.f_dc.push(from.f_dc[i]);
    }

    /// Splat `i` alone.
    #[must_use]
    pub fn clone_one(&self, i: usize) -> Self {
        let mut one = Self::zeros(0);
        one.push_copy(self, i);
        one
    }

    /// Keeps the splats for which `keep` holds, in order.
    pub fn retain(&mut self, keep: &[bool]) {
        fn filter<V>(values: &mut Vec<V>, keep: &[bool]) {
            let mut flags = keep.iter();
            values.retain(|_| *flags.next().unwrap_or(&true));
        }
        filter(&mut self.position, keep);
        filter(&mut self.log_scale, keep);
        filter(&mut self.rotation, keep);
        filter(&mut self.logit, keep);
        filter(&mut self.f_dc, keep);
    }

    /// Puts splat `order[k]` at place `k`.
    pub fn permute(&mut self, order: &[u32]) {
        fn reorder<V: Copy>(values: &mut Vec<V>, order: &[u32]) {
            *values = order.iter().map(|i| values[*i as usize]).collect();
        }
        reorder(&mut self.position, order);
        reorder(&mut self.log_scale, order);
        reorder(&mut self.rotation, order);
        reorder(&mut self.logit, order);
        reorder(&mut self.f_dc, order);
    }

    /// Changes each channel of every colour.
    pub fn recolor(&mut self, change: impl Fn(T) -> T) {
        let (half, c0) = (T::from_f64(0.5), T::from_f64(SH_C0));
        self.f_dc.as_flattened_mut().iter_mut().for_each(|v| *v = (change(*v * c0 + half) - half) / c0);
    }

    /// Every parameter group as one flat slice: position, log scale, rotation, logit, colour.
    pub fn groups_mut(&mut self) -> [&mut [T]; 5] {
        [
            self.position.as_flattened_mut(),
            self.log_scale.as_flattened_mut(),
            self.rotation.as_flattened_mut(),
            &mut self.logit,
            self.f_dc.as_flattened_mut(),
        ]
    }

    /// As [`Splats::groups_mut`], to read.
    #[must_use]
    pub fn groups(&self) -> [&[T]; 5] {
        [
            self.position.as_flattened(),
            self.log_scale.as_flattened(),
            self.rotation.as_flattened(),
            &self.logit,
            self.f_dc.as_flattened(),
        ]
    }
}

#[cfg(test)]
impl Splats<f64> {
    /// As f32.
    pub fn narrow(&self) -> Splats {
        Splats {
            position: self.position.iter().map(|v| v.map(|x| x as f32)).collect(),
            log_scale: self.log_scale.iter().map(|v| v.map(|x| x as f32)).collect(),
            rotation: self.rotation.iter().map(|v| v.map(|x| x as f32)).collect(),
            logit: self.logit.iter().map(|x| *x as f32).collect(),
            f_dc: self.f_dc.iter().map(|v| v.map(|x| x as f32)).collect(),
        }
    }
}

/// The logistic function.
pub fn sigmoid<T: Real>(x: T) -> T {
    T::one() / (T::one() + (-x).exp())
}

/// Inverse of [`sigmoid`].
pub fn logit<T: Real>(p: T) -> T {
    (p / (T::one() - p)).ln()
}

/// Rotation matrix of a quaternion of any length, and that length.
pub fn rotation_matrix<T: Real>(q: [T; 4]) -> ([[T; 3]; 3], T) {
    let norm = q.iter().map(|v| *v * *v).sum::<T>().sqrt().max(T::from_f64(1e-12));
    let [w, x, y, z] = q.map(|v| v / norm);
    let (one, two) = (T::one(), T::from_f64(2.0));
    let matrix = [
        [one - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)],
        [two * (x * y + w * z), one - two * (x * x + z * z), two * (y * z - w * x)],
        [two * (x * z - w * y), two * (y * z + w * x), one - two * (x * x + y * y)],
    ];
    (matrix, norm)
}
