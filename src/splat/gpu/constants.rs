//! The constants that shaders share with the processor's code, as WGSL. The values stand where the processor's code has them.

use crate::nn::adam::AdamRule;
use crate::splat::adam::RULE;
use crate::splat::harmonics::{C1, C2, C3};
use crate::splat::loss::Prior;
use crate::splat::loss::consistency::SAME_SURFACE_M;
use crate::splat::loss::photometric::{RADIUS, SSIM_C1, SSIM_C2, window};
use crate::splat::loss::shadow_entropy::CLIP;
use crate::splat::pinhole::{ellipsoid_reach, least_logit, least_reach_px};
use crate::splat::raster::{ALPHA_CUT, ALPHA_MAX, LOW_PASS_PX2, MIN_TRANSMITTANCE, TILE};
use crate::splat::shadow::SHADOW_RATE_PER_M;
use crate::splat::splats::SH_C0;
use std::fmt::Write;

/// Lanes of a workgroup.
pub const GROUP: u32 = 256;
/// Largest number of workgroups in one dimension of a dispatch (WebGPU).
pub const MAX_GROUPS: u32 = 65_535;
/// Values that a workgroup of a scan sums up.
pub const SCAN_BLOCK: u32 = GROUP * SCAN_ROW;
/// Values that a lane of a scan sums up.
const SCAN_ROW: u32 = 4;
/// Bits of a digit of the radix sort.
pub const DIGIT_BITS: u32 = 8;
/// Values of a digit: one for each lane.
pub const DIGITS: u32 = 1 << DIGIT_BITS;
/// Keys that a workgroup of the sort works on.
pub const SORT_BLOCK: u32 = GROUP * SORT_ROUNDS;
/// Keys that a lane of the sort works on.
const SORT_ROUNDS: u32 = 4;
/// Derivatives by the pixels of sheared images are summed as integers: parts of one, and the largest value. A sum of 255 of them, times
/// the number of the view's pixels, does not overflow; they are below one as a rule.
const FIXED_PARTS: f64 = (1 << 20) as f64;
const FIXED_LIMIT: f64 = 8.0;
/// A pixel without data: white that is wholly transparent, which no pixel on black is.
pub const NO_DATA: u32 = 0x00FF_FFFF;

/// The constants as WGSL.
pub fn wgsl() -> String {
    let mut out = String::new();
    let integers = [
        ("GROUP", GROUP),
        ("MAX_GROUPS", MAX_GROUPS),
        ("SCAN_BLOCK", SCAN_BLOCK),
        ("SCAN_ROW", SCAN_ROW),
        ("DIGITS", DIGITS),
        ("SORT_ROUNDS", SORT_ROUNDS),
        ("NO_DATA", NO_DATA),
        ("TILE", TILE as u32),
        ("RADIUS", RADIUS as u32),
    ];
    for (name, value) in integers {
        let _ = writeln!(out, "const {name}: u32 = {value}u;");
    }
    let numbers = [
        ("LN_2", std::f64::consts::LN_2),
        ("LOG2_E", std::f64::consts::LOG2_E),
        ("ALPHA_CUT", ALPHA_CUT),
        ("LOG2_ALPHA_CUT", ALPHA_CUT.log2()),
        ("ALPHA_MAX", ALPHA_MAX),
        ("LOW_PASS_PX2", LOW_PASS_PX2),
        ("MIN_TRANSMITTANCE", MIN_TRANSMITTANCE),
        ("REACH", ellipsoid_reach()),
        ("LEAST_REACH_PX", least_reach_px(ellipsoid_reach())),
        ("LEAST_LOGIT", least_logit()),
        ("SH_C0", SH_C0),
        ("SH_C1", C1),
        ("SSIM_C1", SSIM_C1),
        ("SSIM_C2", SSIM_C2),
        ("BETA1", RULE.beta1.into()),
        ("BETA2", RULE.beta2.into()),
        ("EPSILON", RULE.epsilon.into()),
        ("APPEARANCE_EPSILON", AdamRule::DEFAULT.epsilon.into()),
        ("FIXED_PARTS", FIXED_PARTS),
        ("FIXED_LIMIT", FIXED_LIMIT),
        ("SHADOW_RATE_PER_M", SHADOW_RATE_PER_M),
        ("ENTROPY_CLIP", CLIP),
        ("SAME_SURFACE_M", SAME_SURFACE_M),
        ("PRIOR_SCALE_M", Prior::SCALE_M),
    ];
    let row = |name: &'static str, values: &[f64]| -> Vec<(String, f64)> {
        values.iter().enumerate().map(|(k, v)| (format!("{name}_{k}"), *v)).collect()
    };
    let numbers = numbers.map(|(name, value)| (name.to_owned(), value));
    let rows = [row("SH_C2", &C2), row("SH_C3", &C3)];
    for (name, value) in numbers.into_iter().chain(rows.into_iter().flatten()) {
        let _ = writeln!(out, "const {name}: f32 = {:e};", value as f32);
    }
    let half = window::<f32>();
    let taps = half.iter().chain(half.iter().rev().skip(1)).map(|tap| format!("{tap:e}"));
    let taps: Vec<String> = taps.collect();
    let _ = writeln!(out, "const WINDOW = array<f32, {}>({});", taps.len(), taps.join(", "));
    out
}
