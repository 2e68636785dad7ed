// The gradient of discs: what a pixel adds to their sums (src/splat/raster/disc.rs).

/// Sums over a row of pixels: moments 1, x, xx, the derivatives by the features, alpha times the derivative by alpha, and moments 1, x of
/// the derivative by the plane's denominator.
const ROW_SUMS: u32 = 3u + FEATURES + 3u;

/// Number of planes by which the loss has derivatives in this iteration: only colours where normals are not compared.
fn planes_used() -> u32 {
    return select(PLANES, DEPTH, plan.by_normals == 0.0);
}

fn product(a: Features, b: Features) -> f32 {
    return dot(a[0], b[0]) + dot(a[1], b[1]);
}

/// What is kept of a splat at a pixel: weight, negative of the splat of the median depth, and alpha times the derivative by alpha.
fn step_of(weight: f32, by_log_alpha: f32, before: f32, behind: f32) -> vec2<f32> {
    return vec2(select(weight, -weight, is_median(before, behind)), by_log_alpha);
}

/// Weight, the part of the moments, that of the derivative by the plane's denominator, and that by the depth of the centre.
struct Part {
    weight: f32,
    by_exponent: f32,
    by_plane: f32,
    by_depth: f32,
}

/// From the step of a staged splat in a pixel, at an offset from the mean.
fn part_of(splat: u32, step: vec2<f32>, d: vec2<f32>, pixel: u32) -> Part {
    if step.x == 0.0 {
        return Part();
    }
    let s = batch[splat];
    let inverse = 1.0 / (1.0 + dot(s.slope, d));
    let weight = abs(step.x);
    let share = select(weight, select(0.0, 1.0, step.x < 0.0), plan.is_median != 0u);
    let by_depth = share * by_features[DEPTH * GROUP + pixel] * inverse;
    let by_denominator = -2.0 * LN_2 * step.y * exponent_at(s, d, inverse) - by_depth * s.features[0].w;
    return Part(weight, step.y * inverse * inverse, by_denominator * inverse, by_depth);
}
