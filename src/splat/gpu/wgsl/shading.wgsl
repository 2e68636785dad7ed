// What the kernels of a satellite view's pixels share: their uniform, and the map from the view to the images of sheared cameras
// (src/splat/shear_warp.rs).

/// What they are told of an iteration; `ShadingUniform` in Rust writes it.
struct Shading {
    /// Shear of the sun's image, pixels per metre, and the position of its first pixel in the view's sheared coordinates.
    sun: Warp,
    virtual_view: Warp,
    /// Columns and rows of the sun's image; zero without shadows.
    sun_size: vec2<u32>,
    /// Resolution level of the image, and number of columns of the photograph.
    level: u32,
    photograph_columns: u32,
    /// Derivative of the loss by the sum of entropies.
    by_entropy: f32,
    /// Weight of the mean difference of colours, per unit, and of altitudes, per metre, in the virtual view.
    by_color: f32,
    by_altitude: f32,
    /// Derivative of the loss by the sum of the splats' robust distances from the prior's surface.
    by_distance: f32,
    /// Western and northern edge of the prior's grid, site metres; its columns and rows; the size of its cells.
    prior_corner: vec2<f32>,
    prior_size: vec2<u32>,
    prior_cell: f32,
    /// Adam for the colour model: corrected rate, and square root of the correction of the second moments.
    appearance_rate: f32,
    appearance_root_second: f32,
    /// Number of anchored splats.
    anchored: u32,
}

struct Warp {
    shear: vec2<f32>,
    origin: vec2<f32>,
}

/// A place between four pixels of an image.
struct Place {
    is_inside: bool,
    /// The upper left of them, and offsets to the right and down from there.
    corner: vec2<u32>,
    fraction: vec2<f32>,
}

/// Where a pixel of the view at this altitude appears in an image of this size.
fn place_of(pixel: vec2<u32>, altitude: f32, warp: Warp, size: vec2<u32>) -> Place {
    let at = vec2<f32>(pixel) - warp.origin - warp.shear * altitude;
    let is_inside = all(at >= vec2(0.0)) && all(at < vec2<f32>(size) - 1.0);
    let held = select(vec2(0.0), at, is_inside);
    let corner = floor(held);
    return Place(is_inside, vec2<u32>(corner), held - corner);
}

/// A bilinearly interpolated value, and its derivatives by column and row.
struct Sampled {
    value: vec4<f32>,
    by_column: vec4<f32>,
    by_row: vec4<f32>,
}

/// Of the pixels around a place: upper left, upper right, lower left, lower right.
fn sampled(at: vec2<f32>, a: vec4<f32>, b: vec4<f32>, c: vec4<f32>, d: vec4<f32>) -> Sampled {
    let upper = a + (b - a) * at.x;
    let lower = c + (d - c) * at.x;
    return Sampled(upper + (lower - upper) * at.y, (b - a) + ((d - c) - (b - a)) * at.y, lower - upper);
}

/// Derivative of a sampled value by the altitude of the view's pixel.
fn by_altitude_of(warp: Warp, value: Sampled) -> vec4<f32> {
    return -warp.shear.x * value.by_column - warp.shear.y * value.by_row;
}

/// Weights of the four pixels around a place.
fn corner_weights(at: vec2<f32>) -> array<f32, 4> {
    let rest = 1.0 - at;
    return array(rest.x * rest.y, at.x * rest.y, rest.x * at.y, at.x * at.y);
}

/// Offset of each of the four pixels from the upper left one.
fn corner_offset(k: u32, columns: u32) -> u32 {
    return (k & 1u) + (k >> 1u) * columns;
}

/// Derivatives are scattered as integers, whose sum does not depend on the order: fixed-point numbers of this many parts.
fn fixed(value: f32) -> i32 {
    return i32(round(clamp(value, -FIXED_LIMIT, FIXED_LIMIT) * FIXED_PARTS));
}
