// What is composited of satellite views: linear colour and altitude of splats. A pixel is both of them.

alias Features = vec4<f32>;

const FEATURES: u32 = 4u;
/// Numbers in the slot of a pair of a splat and a tile: six moments, and the derivatives by the features.
const SLOT: u32 = 6u + FEATURES;
/// Number of splats that the backward pass stages together: as many as workgroup memory has room for.
const STAGED: u32 = 32u;

fn features_of(image: Projected) -> Features {
    return vec4(image.color, image.depth);
}

fn features_behind() -> Features {
    return plan.background;
}

fn pixel_of(features: Features, transmittance: f32) -> vec4<f32> {
    return features;
}

fn features_at(pixel: vec4<f32>) -> Features {
    return pixel;
}

/// Linear colours may be negative: the colour model of the view maps them.
fn shown(color: vec3<f32>) -> vec3<f32> {
    return color;
}

/// Where `shown` has a slope.
fn is_shown(color: vec3<f32>) -> vec3<bool> {
    return vec3(true);
}

/// The derivative by the altitude of a splat by way of its features, from the sums of its slots.
fn by_altitude(sums: array<f32, SLOT>) -> f32 {
    return sums[SLOT - 1u];
}
