// The gradient of ellipsoids: what a pixel adds to their sums.

/// Sums over a row of pixels: moments 1, x, xx, and the derivatives by the features.
const ROW_SUMS: u32 = 3u + FEATURES;

/// Number of planes by which the loss has derivatives in this iteration.
fn planes_used() -> u32 {
    return PLANES;
}

fn product(a: Features, b: Features) -> f32 {
    return dot(a, b);
}

/// What is kept of a splat at a pixel: weight, and alpha times the derivative by alpha.
fn step_of(weight: f32, by_log_alpha: f32, before: f32, behind: f32) -> vec2<f32> {
    return vec2(weight, by_log_alpha);
}

/// Weight, the part of the moments, and of sums that ellipsoids do without.
struct Part {
    weight: f32,
    by_exponent: f32,
    by_plane: f32,
    by_depth: f32,
}

/// From the step of a staged splat in a pixel, at an offset from the mean.
fn part_of(splat: u32, step: vec2<f32>, d: vec2<f32>, pixel: u32) -> Part {
    return Part(step.x, step.y, 0.0, 0.0);
}
