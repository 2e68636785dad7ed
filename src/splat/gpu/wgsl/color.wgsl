// What is composited of photographs: the colour of splats. A pixel is a colour and the transmittance.

alias Features = vec3<f32>;

const FEATURES: u32 = 3u;
/// Numbers in the slot of a pair of a splat and a tile: six moments, and the derivatives by the features.
const SLOT: u32 = 6u + FEATURES;
/// Number of splats that the backward pass stages together: as many as workgroup memory has room for.
const STAGED: u32 = 64u;

fn features_of(image: Projected) -> Features {
    return image.color;
}

fn features_behind() -> Features {
    return plan.background.rgb;
}

fn pixel_of(features: Features, transmittance: f32) -> vec4<f32> {
    return vec4(features, transmittance);
}

fn features_at(pixel: vec4<f32>) -> Features {
    return pixel.rgb;
}

/// Colours as displayed are not negative.
fn shown(color: vec3<f32>) -> vec3<f32> {
    return max(color, vec3(0.0));
}

/// Where `shown` has a slope.
fn is_shown(color: vec3<f32>) -> vec3<bool> {
    return color > vec3(0.0);
}

/// The derivative by the altitude of a splat by way of its features, from the sums of its slots.
fn by_altitude(sums: array<f32, SLOT>) -> f32 {
    return 0.0;
}
