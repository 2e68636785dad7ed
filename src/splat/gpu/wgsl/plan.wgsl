// What all kernels of an iteration share: its uniform, and the records that they exchange.

/// The camera, the sizes and the rates of one render in an iteration; `PlanUniform` in Rust writes it.
struct Plan {
    /// `Camera` in `pinhole.wgsl` or `parallel.wgsl`.
    camera: array<vec4<f32>, 6>,
    /// What is behind the splats: a colour, and in parallel projections an altitude.
    background: vec4<f32>,
    /// Corrected learning rates of Adam: position, opacity, scale, rotation.
    rates: vec4<f32>,
    /// The same of f_dc and f_rest.
    color_rates: vec2<f32>,
    /// Square root of the correction of the second moments.
    root_second: f32,
    /// Derivative of the loss by the opacity of each splat.
    by_opacity: f32,
    /// Derivative of the loss by the sum of SSIM, and by the sum of absolute differences.
    by_ssim: f32,
    by_l1: f32,
    /// Number of harmonic coefficients of a channel in use, above degree 0.
    coefficients: u32,
    splats: u32,
    /// Columns and rows of the image.
    size: vec2<u32>,
    /// Columns and rows of tiles.
    tiles: vec2<u32>,
    /// Number of pairs of splats and tiles for which there is room.
    pair_capacity: u32,
    iteration: u32,
    /// Whether another render of the iteration has begun the gradient; it alone counts in the statistics for densification.
    adds_gradient: u32,
}

/// The parameters of a splat but for f_rest; also their moments and derivatives.
struct Core {
    position: vec3<f32>,
    opacity_logit: f32,
    log_scale: vec3<f32>,
    /// Of derivatives: 1 if the view may show the splat, else 0. Unused otherwise.
    seen: f32,
    rotation: vec4<f32>,
    /// Of derivatives: by the colour, not by f_dc.
    f_dc: vec3<f32>,
    /// Of parameters: 1 if the splat is anchored to another. Unused otherwise.
    anchored: f32,
}

/// The sum of two records, with what is no number of the first.
fn core_sum(a: Core, b: Core) -> Core {
    var out = a;
    out.position += b.position;
    out.opacity_logit += b.opacity_logit;
    out.log_scale += b.log_scale;
    out.rotation += b.rotation;
    out.f_dc += b.f_dc;
    return out;
}

/// The image of a splat.
struct Projected {
    mean: vec2<f32>,
    /// Squared Mahalanobis radius of the ellipse on which alpha equals the cut-off.
    radius2: f32,
    /// Row of the ellipse's rightmost point, relative to the centre.
    rightmost_dy: f32,
    /// Inverse of the 2-D covariance: xx, xy, yy.
    conic: vec3<f32>,
    log2_opacity: f32,
    color: vec3<f32>,
    /// Half of the ellipse's width.
    half_width: f32,
    half_height: f32,
    /// Number of tiles that the ellipse touches.
    tiles: u32,
    /// Slot of the first of them.
    first_slot: u32,
    /// What splats are ordered by: `depth_of` in `pinhole.wgsl` or `parallel.wgsl`.
    depth: f32,
}

/// The number of a workgroup: there are at most 65,535 in a dimension, so that long rows are folded.
fn group_index(group: vec3<u32>, groups: vec3<u32>) -> u32 {
    return group.y * groups.x + group.x;
}

fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}

/// The list of a tile.
struct TileRange {
    start: u32,
    end: u32,
    /// Number of its first splats behind which no pixel is translucent.
    useful: u32,
    unused: u32,
}
