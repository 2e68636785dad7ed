//! The splats: one array for each parameter group.
//!
//! `parameter_groups!` below is the only list of a splat's parameters. Storage, learning rates ([`PerGroup`]), Adam's
//! moments, densification and pruning ([`Edit`]), checkpoints and the columns of the PLY file follow from it: a new parameter
//! is one line there.

use super::edit::Edit;
use crate::simd::Real;
use serde::{Deserialize, Serialize};

/// Value of the zeroth spherical harmonic: `rgb = SH_C0 * f_dc + 0.5`, as in 3DGS.
const SH_C0: f64 = 0.282_094_791_773_878_14;

/// Name, size and file columns of a parameter group.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GroupInfo {
    /// Its name.
    pub name: &'static str,
    /// Number of scalars for each splat.
    pub width: usize,
    /// Its columns in a PLY file.
    pub ply: &'static [&'static str],
}

macro_rules! parameter_groups {
    ($($(#[$doc:meta])* $name:ident: $width:literal = $default:expr, ply $ply:expr;)*) => {
        /// Splats in the site frame: 3-D Gaussians as a structure of arrays, in the parametrisation that is optimised. The
        /// same structure holds gradients and moments.
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
        pub struct Splats<T = f32> {
            $($(#[$doc])* pub $name: Vec<[T; $width]>,)*
        }

        /// A value for each parameter group, such as its learning rate.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct PerGroup<V> {
            $(#[doc = concat!("The value of [`Splats::", stringify!($name), "`].")] pub $name: V,)*
        }

        /// Number of parameter groups.
        pub const GROUPS: usize = [$(stringify!($name)),*].len();

        /// The parameter groups, in the order of [`Splats::groups`] and of the columns of a PLY file.
        pub const GROUP_INFO: [GroupInfo; GROUPS] =
            [$(GroupInfo { name: stringify!($name), width: $width, ply: &$ply }),*];

        impl<V: Copy> PerGroup<V> {
            /// The values in the order of [`Splats::groups`].
            #[must_use]
            pub fn to_array(self) -> [V; GROUPS] {
                [$(self.$name),*]
            }
        }

        impl<T: Real> Splats<T> {
            /// `n` splats whose parameters are all zero, such as gradients or moments before the first sum.
            #[must_use]
            pub fn zeros(n: usize) -> Self {
                Self { $($name: vec![[T::zero(); $width]; n],)* }
            }

            /// Changes the number of splats; the parameters of new ones are zero.
            pub fn resize(&mut self, n: usize) {
                $(self.$name.resize(n, [T::zero(); $width]);)*
            }

            /// Appends a splat with the default value of every parameter group.
            fn push_default(&mut self) {
                $(self.$name.push($default.map(T::from_f64));)*
            }

            /// Applies an edit: splat `i` becomes a copy of what splat `edit.source[i]` was.
            pub fn apply(&mut self, edit: &Edit) {
                $(edit.gather(&mut self.$name);)*
            }

            /// Sets every parameter of an edit's new splats to zero, as needed for moments.
            pub fn zero_fresh(&mut self, edit: &Edit) {
                for i in edit.fresh() {
                    $(self.$name[i] = [T::zero(); $width];)*
                }
            }

            /// Every parameter group as a flat slice, in the order of [`GROUP_INFO`].
            #[must_use]
            pub fn groups(&self) -> [&[T]; GROUPS] {
                [$(self.$name.as_flattened()),*]
            }

            /// As [`Splats::groups`], mutable.
            pub fn groups_mut(&mut self) -> [&mut [T]; GROUPS] {
                [$(self.$name.as_flattened_mut()),*]
            }
        }
    };
}

parameter_groups! {
    /// Centre: metres east, north, up from the site's origin.
    position: 3 = [0.0; 3], ply ["x", "y", "z"];
    /// Colour, `SH_C0 * f_dc + 0.5` (see [`color_from_f_dc`]).
    f_dc: 3 = [0.0; 3], ply ["f_dc_0", "f_dc_1", "f_dc_2"];
    /// Logit of the opacity ([`logit`]).
    opacity_logit: 1 = [0.0], ply ["opacity"];
    /// Natural logarithm of the standard deviations along the splat's own axes, metres.
    log_scale: 3 = [0.0; 3], ply ["scale_0", "scale_1", "scale_2"];
    /// Orientation, a quaternion (w, x, y, z) of any length.
    rotation: 4 = [1.0, 0.0, 0.0, 0.0], ply ["rot_0", "rot_1", "rot_2", "rot_3"];
}

impl<T: Real> Splats<T> {
    /// Number of splats.
    #[must_use]
    pub fn len(&self) -> usize {
        self.position.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.position.is_empty()
    }

    /// Whether every parameter group has a value for each of `n` splats.
    #[must_use]
    pub fn is_whole(&self, n: usize) -> bool {
        self.groups().iter().zip(GROUP_INFO).all(|(group, info)| group.len() == n * info.width)
    }

    /// Appends an isotropic splat: centre (site frame) and standard deviation in metres, opacity in (0, 1), and linear
    /// colour in [0, 1].
    pub fn push(&mut self, position: [T; 3], scale_m: T, opacity: T, rgb: [T; 3]) {
        let i = self.len();
        self.push_default();
        self.position[i] = position;
        self.log_scale[i] = [scale_m.ln(); 3];
        self.opacity_logit[i] = [logit(opacity)];
        self.f_dc[i] = f_dc_from_color(rgb);
    }

    /// Applies `change` to each channel of every splat's linear colour.
    pub fn recolor(&mut self, change: impl Fn(T) -> T) {
        self.f_dc.iter_mut().for_each(|f| *f = f_dc_from_color(color_from_f_dc(*f).map(&change)));
    }
}

#[cfg(test)]
impl Splats<f64> {
    /// As f32.
    pub fn narrow(&self) -> Splats {
        let mut out = Splats::zeros(self.len());
        for (narrow, wide) in out.groups_mut().into_iter().zip(self.groups()) {
            narrow.iter_mut().zip(wide).for_each(|(n, w)| *n = *w as f32);
        }
        out
    }
}

/// Linear colour from the coefficients of the zeroth spherical harmonic.
#[inline(always)]
pub fn color_from_f_dc<T: Real>(f_dc: [T; 3]) -> [T; 3] {
    f_dc.map(|f| f * T::from_f64(SH_C0) + T::from_f64(0.5))
}

/// Coefficients of the zeroth spherical harmonic from the linear colour; the inverse of [`color_from_f_dc`].
#[inline(always)]
pub fn f_dc_from_color<T: Real>(rgb: [T; 3]) -> [T; 3] {
    rgb.map(|v| (v - T::from_f64(0.5)) / T::from_f64(SH_C0))
}

/// Derivatives with respect to the coefficients, from those with respect to the colour.
#[inline(always)]
pub fn f_dc_gradient<T: Real>(by_color: [T; 3]) -> [T; 3] {
    by_color.map(|by| by * T::from_f64(SH_C0))
}

/// The logistic function `1 / (1 + exp(-x))`: an opacity from its logit.
pub fn sigmoid<T: Real>(x: T) -> T {
    T::one() / (T::one() + (-x).exp())
}

/// The inverse of [`sigmoid`]: `ln(p / (1 - p))`.
pub fn logit<T: Real>(p: T) -> T {
    (p / (T::one() - p)).ln()
}

/// The unit quaternion (w, x, y, z) of a splat's orientation; zero, which rotates nothing, stays zero.
pub fn unit_quaternion<T: Real>(rotation: [T; 4]) -> [T; 4] {
    let norm = rotation.iter().map(|v| *v * *v).sum::<T>().sqrt().max(T::from_f64(1e-12));
    rotation.map(|v| v / norm)
}
