// The alpha of a splat at a pixel (src/splat/raster/batch.rs).

/// What compositing needs of a splat.
struct Staged {
    mean: vec2<f32>,
    log2_opacity: f32,
    splat: u32,
    /// The conic times -log2(e) / 2, its middle element twice.
    exponent: vec3<f32>,
    slot: u32,
    features: Features,
}

fn staged(image: Projected, splat: u32, slot: u32) -> Staged {
    let exponent = -0.5 * LOG2_E * vec3(image.conic.x, 2.0 * image.conic.y, image.conic.z);
    return Staged(image.mean, image.log2_opacity, splat, exponent, slot, features_of(image));
}

/// Alpha before it is clamped to `ALPHA_MAX`; 0 below the cut-off.
fn alpha_at(s: Staged, pixel: vec2<f32>) -> f32 {
    let d = pixel - s.mean;
    let log2_alpha = s.log2_opacity + s.exponent.x * d.x * d.x + s.exponent.y * d.x * d.y + s.exponent.z * d.y * d.y;
    if log2_alpha < LOG2_ALPHA_CUT {
        return 0.0;
    }
    return exp2(log2_alpha);
}
