// What is composited of satellite views: linear colour and altitude of splats. A pixel is both of them.

alias Features = vec4<f32>;

/// Whether the depth varies over the image of a splat.
const IS_FLAT: bool = false;
/// Features of a splat, planes by which the loss has derivatives, and vectors of a pixel.
const FEATURES: u32 = 4u;
const PLANES: u32 = FEATURES;
const PIXEL: u32 = 1u;
/// Numbers in the slot of a pair of a splat and a tile: six moments, and the derivatives by the features.
const SLOT: u32 = 6u + FEATURES;
/// Number of splats that the forward pass stages together, and the backward pass, which sums those of a few: as many as workgroup memory
/// has room for.
const BATCH: u32 = GROUP;
const STAGED: u32 = 32u;
const TOGETHER: u32 = 4u;

fn features_of(image: Projected) -> Features {
    return vec4(image.color, image.depth);
}

fn features_behind() -> Features {
    return plan.background;
}

fn pixel_of(features: Features, transmittance: f32) -> array<vec4<f32>, PIXEL> {
    return array<vec4<f32>, PIXEL>(features);
}

fn features_at(pixel: array<vec4<f32>, PIXEL>) -> Features {
    return pixel[0];
}

/// The loss's derivatives by the features, from those by the planes.
fn by_features_of(planes: array<f32, PLANES>) -> Features {
    return vec4(planes[0], planes[1], planes[2], planes[3]);
}

/// Linear colours may be negative: the colour model of the view maps them.
fn shown(color: vec3<f32>) -> vec3<f32> {
    return color;
}

/// Where `shown` has a slope.
fn is_shown(color: vec3<f32>) -> vec3<bool> {
    return vec3(true);
}

/// The derivative by the depth of a splat by way of its features, from the sums of its slots.
fn by_depth(sums: array<f32, SLOT>) -> f32 {
    return sums[SLOT - 1u];
}
