// What is composited of photographs with discs: colour, depth, and the normal that faces the camera, in site axes. A pixel is these and the
// transmittance, which counts as a feature that splats lack and the background has.

/// Colour and depth; normal and transmittance. The depth of a pixel is the sum of weighted ones, or the median.
alias Features = mat2x4<f32>;

/// Whether the depth varies over the image of a splat.
const IS_FLAT: bool = true;
/// Features of a splat, planes by which the loss has derivatives, and vectors of a pixel.
const FEATURES: u32 = 7u;
const PLANES: u32 = 8u;
const PIXEL: u32 = 2u;
/// Which plane is the transmittance.
const TRANSMITTANCE: u32 = 7u;
/// Numbers in the slot of a pair of a splat and a tile: six moments, the derivatives by the features, and those from which the
/// derivative by the slope of its plane follows.
const SLOPE_SUMS: u32 = 6u + FEATURES;
const SLOT: u32 = SLOPE_SUMS + 4u;
/// Number of splats that the forward pass stages together, and the backward pass, which sums those of a few: as many as workgroup memory
/// has room for.
const BATCH: u32 = 128u;
const STAGED: u32 = 32u;
const TOGETHER: u32 = 2u;

/// The plane of a disc, and the ellipse that its exponent follows; `Projected` has the ellipse on which alpha equals the cut-off.
struct Plane {
    mean: vec2<f32>,
    /// At an offset d of pixels from the mean the depth is that of the centre / (1 + slope . d).
    slope: vec2<f32>,
    conic: vec3<f32>,
    /// Whether it is drawn with its slope: the plane stays away from the camera's own.
    has_slope: u32,
    /// In site axes, on the side of the camera.
    normal: vec3<f32>,
}

fn features_behind() -> Features {
    return mat2x4(vec4(plan.background.rgb, 0.0), vec4(0.0, 0.0, 0.0, 1.0));
}

fn pixel_of(features: Features, transmittance: f32) -> array<vec4<f32>, PIXEL> {
    return array<vec4<f32>, PIXEL>(features[0], features[1]);
}

fn features_at(pixel: array<vec4<f32>, PIXEL>) -> Features {
    return mat2x4(pixel[0], pixel[1]);
}

/// The loss's derivatives by the features, from those by the planes. A median depth does not depend on the weights of the splats.
fn by_features_of(planes: array<f32, PLANES>) -> Features {
    return mat2x4(
        vec4(planes[0], planes[1], planes[2], select(planes[DEPTH], 0.0, plan.is_median != 0u)),
        vec4(planes[NORMAL], planes[NORMAL + 1u], planes[NORMAL + 2u], planes[TRANSMITTANCE]),
    );
}

/// The derivative by the depth of a splat by way of its features, from the sums of its slots.
fn by_depth(sums: array<f32, SLOT>) -> f32 {
    return sums[6u + DEPTH];
}
