//! The splats: one array for each parameter group.
//!
//! `parameter_groups!` below is the only list of a splat's parameters. Storage, learning rates ([`PerGroup`]), Adam's
//! moments, densification and pruning ([`Edit`]), checkpoints and the columns of the PLY file follow from it: a new parameter
//! is one line there.

use super::edit::Edit;
use super::primitive::{FLAT_LOG_SCALE, PrimitiveKind};
use crate::simd::{Real, Simd, SimdKernel, SimdReal, SimdVec};
use glam::{DQuat, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Value of the zeroth spherical harmonic: `rgb = SH_C0 * f_dc + 0.5`, as in 3DGS.
pub const SH_C0: f64 = 0.282_094_791_773_878_14;

/// Name, size and file columns of a parameter group.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GroupInfo {
    /// Its name.
    pub name: &'static str,
    /// Number of scalars for each splat.
    pub width: usize,
    /// Its columns in a PLY file.
    pub ply: &'static [&'static str],
    /// Whether splats may be without it: then its array is empty.
    pub is_optional: bool,
}

macro_rules! parameter_groups {
    ($($(#[$doc:meta])* $name:ident: $width:literal = $default:expr, ply $ply:expr
        $(, optional $(#[$of_value:meta])*)?;)*) => {
        /// Splats in the site frame: 3-D Gaussians as a structure of arrays, in the parametrisation that is optimised. The
        /// same structure holds gradients and moments.
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
        #[serde(bound(deserialize = "T: Deserialize<'de> + Copy"))]
        pub struct Splats<T = f32> {
            $($(#[$doc])* pub $name: Vec<[T; $width]>,)*
        }

        /// A value for each parameter group, such as its learning rate.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        #[serde(bound(serialize = "V: Serialize + Default + PartialEq"))]
        #[serde(bound(deserialize = "V: Deserialize<'de> + Default"))]
        pub struct PerGroup<V> {
            $(
                #[doc = concat!("The value of [`Splats::", stringify!($name), "`].")]
                $($(#[$of_value])*)?
                pub $name: V,
            )*
        }

        /// Number of parameter groups.
        pub const GROUPS: usize = [$(stringify!($name)),*].len();

        /// The parameter groups, in the order of [`Splats::groups`] and of the columns of a PLY file.
        pub const GROUP_INFO: [GroupInfo; GROUPS] =
            [$(GroupInfo {
                name: stringify!($name),
                width: $width,
                ply: &$ply,
                is_optional: !stringify!($($(#[$of_value])*)?).is_empty(),
            }),*];

        impl<V: Copy> PerGroup<V> {
            /// The values in the order of [`Splats::groups`].
            #[must_use]
            pub fn to_array(self) -> [V; GROUPS] {
                [$(self.$name),*]
            }

            /// The values after a change.
            #[must_use]
            pub fn map<W>(self, change: impl Fn(V) -> W) -> PerGroup<W> {
                PerGroup { $($name: change(self.$name)),* }
            }
        }

        impl<T: Real> Splats<T> {
            /// `n` splats whose parameters are all zero, without the optional groups.
            #[must_use]
            pub fn zeros(n: usize) -> Self {
                let of_group = |info: &GroupInfo| if info.is_optional { 0 } else { n };
                let mut groups = GROUP_INFO.iter().map(of_group);
                Self { $($name: vec![[T::zero(); $width]; groups.next().unwrap_or(0)],)* }
            }

            /// Changes the number of splats, and which groups they have, to those of `other`; new parameters are zero.
            pub fn resize_like<U>(&mut self, other: &Splats<U>) {
                $(self.$name.resize(other.$name.len(), [T::zero(); $width]);)*
            }

            /// Appends splats that have the same groups.
            pub fn append(&mut self, more: Self) {
                $(self.$name.extend(more.$name);)*
            }

            /// Appends a splat with the default value of every parameter group that the splats have.
            fn push_default(&mut self) {
                let mut groups = self.groups().map(<[T]>::is_empty).into_iter().zip(GROUP_INFO);
                $(
                    if groups.next().is_some_and(|(is_empty, info)| !(is_empty && info.is_optional)) {
                        self.$name.push($default.map(T::from_f64));
                    }
                )*
            }

            /// Applies an edit: splat `i` becomes a copy of what splat `edit.source[i]` was.
            pub fn apply(&mut self, edit: &Edit) {
                $(
                    if !self.$name.is_empty() {
                        edit.gather(&mut self.$name);
                    }
                )*
            }

            /// Makes these the splats of `all` with the given indices.
            pub fn take_from(&mut self, all: &Self, indices: &[u32]) {
                $(
                    let count = if all.$name.is_empty() { 0 } else { indices.len() };
                    self.$name.resize(count, [T::zero(); $width]);
                    let values = self.$name.par_iter_mut().zip(indices).with_min_len(1024);
                    values.for_each(|(value, i)| *value = all.$name[*i as usize]);
                )*
            }

            /// Sets every parameter of an edit's new splats to zero, as needed for moments.
            pub fn zero_fresh(&mut self, edit: &Edit) {
                $(
                    if !self.$name.is_empty() {
                        self.$name[edit.fresh()].fill([T::zero(); $width]);
                    }
                )*
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
    /// Coefficients of the spherical harmonics of degrees 1 to 3, channel by channel: fifteen for red, green, blue each. The
    /// colour of splats without them does not depend on the direction ([`harmonics`](super::harmonics)).
    #[serde(with = "flat")]
    f_rest: 45 = [0.0; 45], ply F_REST_COLUMNS, optional #[serde(default, skip_serializing_if = "is_default")];
    /// Logit of the opacity ([`logit`]).
    opacity_logit: 1 = [0.0], ply ["opacity"];
    /// Natural logarithm of the standard deviations along the splat's own axes, metres.
    log_scale: 3 = [0.0; 3], ply ["scale_0", "scale_1", "scale_2"];
    /// Orientation, a quaternion (w, x, y, z) of any length.
    rotation: 4 = [1.0, 0.0, 0.0, 0.0], ply ["rot_0", "rot_1", "rot_2", "rot_3"];
}

/// The columns of `f_rest` in a PLY file.
const F_REST_COLUMNS: [&str; 45] = [
    "f_rest_0",
    "f_rest_1",
    "f_rest_2",
    "f_rest_3",
    "f_rest_4",
    "f_rest_5",
    "f_rest_6",
    "f_rest_7",
    "f_rest_8",
    "f_rest_9",
    "f_rest_10",
    "f_rest_11",
    "f_rest_12",
    "f_rest_13",
    "f_rest_14",
    "f_rest_15",
    "f_rest_16",
    "f_rest_17",
    "f_rest_18",
    "f_rest_19",
    "f_rest_20",
    "f_rest_21",
    "f_rest_22",
    "f_rest_23",
    "f_rest_24",
    "f_rest_25",
    "f_rest_26",
    "f_rest_27",
    "f_rest_28",
    "f_rest_29",
    "f_rest_30",
    "f_rest_31",
    "f_rest_32",
    "f_rest_33",
    "f_rest_34",
    "f_rest_35",
    "f_rest_36",
    "f_rest_37",
    "f_rest_38",
    "f_rest_39",
    "f_rest_40",
    "f_rest_41",
    "f_rest_42",
    "f_rest_43",
    "f_rest_44",
];

/// Whether a value is that of its type's `Default`.
fn is_default<V: Default + PartialEq>(value: &V) -> bool {
    *value == V::default()
}

/// Arrays that are too long for serde, as one flat sequence.
mod flat {
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<T: Serialize, S: Serializer, const W: usize>(
        values: &[[T; W]],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        values.as_flattened().serialize(serializer)
    }

    pub fn deserialize<'de, T: Deserialize<'de> + Copy, D: Deserializer<'de>, const W: usize>(
        deserializer: D,
    ) -> Result<Vec<[T; W]>, D::Error> {
        let values = Vec::<T>::deserialize(deserializer)?;
        let (whole, rest) = values.as_chunks::<W>();
        if !rest.is_empty() {
            return Err(D::Error::custom("the last splat is cut off"));
        }
        Ok(whole.to_vec())
    }
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

    /// Whether every parameter group has a value for each of `n` splats, or none if it is optional.
    #[must_use]
    pub fn is_whole(&self, n: usize) -> bool {
        let is_absent = |len: usize, info: &GroupInfo| len == 0 && info.is_optional;
        let groups = self.groups().map(<[T]>::len).into_iter().zip(&GROUP_INFO);
        groups.into_iter().all(|(len, info)| len == n * info.width || is_absent(len, info))
    }

    /// Whether the number of splats and the groups they have are those of `other`.
    #[must_use]
    pub fn is_like(&self, other: &Self) -> bool {
        self.groups().map(<[T]>::len) == other.groups().map(<[T]>::len)
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

    /// Discs if no splat has an extent along its third axis, else ellipsoids.
    #[must_use]
    pub fn primitive(&self) -> PrimitiveKind {
        let flat = T::from_f64(0.9 * f64::from(FLAT_LOG_SCALE));
        let is_flat = !self.is_empty() && self.log_scale.iter().all(|s| s[2] < flat);
        if is_flat { PrimitiveKind::Disc } else { PrimitiveKind::Ellipsoid }
    }

    /// Removes the extent of every splat along its third axis, which becomes the normal of a disc.
    pub fn flatten(&mut self) {
        self.log_scale.iter_mut().for_each(|s| s[2] = T::from_f64(FLAT_LOG_SCALE.into()));
    }

    /// The same splats in these colours, one for each.
    #[must_use]
    pub fn colored(&self, colors: &[[T; 3]]) -> Self {
        let f_dc = colors.iter().map(|color| f_dc_from_color(*color)).collect();
        Self { f_dc, ..self.clone() }
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
        let mut out = Splats::default();
        out.resize_like(self);
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

/// Writes the opacities of these logits, as [`sigmoid`] but with vectors; that of NaN is not defined.
pub fn opacities<T: SimdReal>(logits: &[[T; 1]], out: &mut [T]) {
    T::dispatch(Opacities { logits: logits.as_flattened(), out });
}

struct Opacities<'a, T> {
    logits: &'a [T],
    out: &'a mut [T],
}

impl<T: SimdReal> SimdKernel<T> for Opacities<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let [zero, one] = [T::zero(), T::one()].map(|v| SimdVec::broadcast(simd, v));
        for start in (0..self.out.len()).step_by(S::WIDTH) {
            let logits = SimdVec::load_from(simd, self.logits, start);
            (one / (one + (zero - logits).exp())).store_to(self.out, start);
        }
    }
}

/// The inverse of [`sigmoid`]: `ln(p / (1 - p))`.
pub fn logit<T: Real>(p: T) -> T {
    (p / (T::one() - p)).ln()
}

/// The orientation, a quaternion (w, x, y, z), of a splat whose third axis is a unit normal.
#[must_use]
pub fn rotation_to(normal: DVec3) -> [f64; 4] {
    let turn = DQuat::from_rotation_arc(DVec3::Z, normal);
    [turn.w, turn.x, turn.y, turn.z]
}

/// The unit quaternion (w, x, y, z) of a splat's orientation; zero, which rotates nothing, stays zero.
pub fn unit_quaternion<T: Real>(rotation: [T; 4]) -> [T; 4] {
    let norm = rotation.iter().map(|v| *v * *v).sum::<T>().sqrt().max(T::from_f64(1e-12));
    rotation.map(|v| v / norm)
}
