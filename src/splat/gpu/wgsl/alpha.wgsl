// An ellipsoid at a pixel (src/splat/raster/batch.rs).

/// What compositing needs of a splat.
struct Staged {
    mean: vec2<f32>,
    log2_opacity: f32,
    slot: u32,
    /// The conic times -log2(e) / 2, its middle element twice.
    exponent: vec3<f32>,
    features: Features,
}

fn staged(image: Projected, splat: u32, slot: u32) -> Staged {
    let exponent = -0.5 * LOG2_E * vec3(image.conic.x, 2.0 * image.conic.y, image.conic.z);
    return Staged(image.mean, image.log2_opacity, slot, exponent, features_of(image));
}

/// A splat at a pixel: alpha before it is clamped to `ALPHA_MAX`, 0 below the cut-off, and the features there.
struct Sample {
    alpha: f32,
    features: Features,
}

/// What a sample adds to the features of a pixel.
fn composited(sample: Sample, weight: f32, before: f32, behind: f32) -> Features {
    return weight * sample.features;
}

fn sample_at(s: Staged, pixel: vec2<f32>) -> Sample {
    let d = pixel - s.mean;
    let log2_alpha = s.log2_opacity + s.exponent.x * d.x * d.x + s.exponent.y * d.x * d.y + s.exponent.z * d.y * d.y;
    if log2_alpha < LOG2_ALPHA_CUT {
        return Sample(0.0, s.features);
    }
    return Sample(exp2(log2_alpha), s.features);
}
