// A disc at a pixel (src/splat/raster/disc.rs).

@group(0) @binding(8) var<storage, read> planes: array<Plane>;

/// What compositing needs of a splat.
struct Staged {
    mean: vec2<f32>,
    slope: vec2<f32>,
    /// The conic times -log2(e) / 2, its middle element twice.
    exponent: vec3<f32>,
    log2_opacity: f32,
    features: Features,
    slot: u32,
}

fn staged(image: Projected, splat: u32, slot: u32) -> Staged {
    let plane = planes[splat];
    let exponent = -0.5 * LOG2_E * vec3(plane.conic.x, 2.0 * plane.conic.y, plane.conic.z);
    let features = mat2x4(vec4(image.color, image.depth), vec4(plane.normal, 0.0));
    return Staged(plane.mean, plane.slope, exponent, image.log2_opacity, features, slot);
}

/// A splat at a pixel: alpha before it is clamped to `ALPHA_MAX`, 0 below the cut-off, and the features there.
struct Sample {
    alpha: f32,
    features: Features,
}

/// Whether the depth of a splat is the median, given the transmittance before and behind it.
fn is_median(before: f32, behind: f32) -> bool {
    return plan.is_median != 0u && before > 0.5 && behind <= 0.5;
}

/// What a sample adds to the features of a pixel.
fn composited(sample: Sample, weight: f32, before: f32, behind: f32) -> Features {
    var out = weight * sample.features;
    if plan.is_median != 0u {
        out[0].w = select(0.0, sample.features[0].w, is_median(before, behind));
    }
    return out;
}

/// Base-2 logarithm of alpha without the opacity, given the reciprocal of the plane's denominator.
fn exponent_at(s: Staged, d: vec2<f32>, inverse: f32) -> f32 {
    let square = s.exponent.x * d.x * d.x + s.exponent.y * d.x * d.y + s.exponent.z * d.y * d.y;
    return square * inverse * inverse;
}

fn sample_at(s: Staged, pixel: vec2<f32>) -> Sample {
    let d = pixel - s.mean;
    var out = Sample(0.0, s.features);
    // Behind the line where the plane meets the camera's plane, its denominator is negative.
    let denominator = 1.0 + dot(s.slope, d);
    if denominator <= 0.0 {
        return out;
    }
    let inverse = 1.0 / denominator;
    let log2_alpha = s.log2_opacity + exponent_at(s, d, inverse);
    if log2_alpha < LOG2_ALPHA_CUT {
        return out;
    }
    out.alpha = exp2(log2_alpha);
    out.features[0].w *= inverse;
    return out;
}
