// The affine camera with a quadratic term (src/camera/parallel.rs): what projection and its gradient need of a camera.

struct Camera {
    /// Rows of the linear part, each with an offset.
    column: vec4<f32>,
    row: vec4<f32>,
    /// Coefficients of xx, xy, xz, yy; then of yz, zz.
    column_bend: vec4<f32>,
    column_bend_end: vec2<f32>,
    row_bend: vec4<f32>,
    row_bend_end: vec2<f32>,
}

fn camera() -> Camera {
    let c = plan.camera;
    return Camera(c[0], c[1], c[2], c[3].xy, c[4], c[5].xy);
}

fn bent(p: vec3<f32>, bend: vec4<f32>, end: vec2<f32>) -> f32 {
    return (bend.x * p.x + bend.y * p.y + bend.z * p.z) * p.x + (bend.w * p.y + end.x * p.z) * p.y + end.y * p.z * p.z;
}

/// The derivative of the quadratic term by the position.
fn bend_slope(p: vec3<f32>, bend: vec4<f32>, end: vec2<f32>) -> vec3<f32> {
    return vec3(
        2.0 * bend.x * p.x + bend.y * p.y + bend.z * p.z,
        bend.y * p.x + 2.0 * bend.w * p.y + end.x * p.z,
        bend.z * p.x + end.x * p.y + 2.0 * end.y * p.z,
    );
}

fn image_of(p: vec3<f32>) -> vec2<f32> {
    let view = camera();
    return vec2(
        dot(view.column.xyz, p) + view.column.w + bent(p, view.column_bend, view.column_bend_end),
        dot(view.row.xyz, p) + view.row.w + bent(p, view.row_bend, view.row_bend_end),
    );
}

/// The rows of the 2x3 Jacobian: within the extent of a splat the quadratic term is negligible.
fn jacobian(p: vec3<f32>) -> array<vec3<f32>, 2> {
    let view = camera();
    return array(view.column.xyz, view.row.xyz);
}

/// The altitude of a splat.
fn depth_of(splat: Core) -> f32 {
    return splat.position.z;
}

/// All splats take part in every step.
fn is_seen(depth: f32) -> bool {
    return true;
}

/// The key by which splats are sorted, the smallest first: the highest splat comes first, for all cameras.
fn depth_key(image: Projected) -> u32 {
    let bits = bitcast<u32>(image.depth);
    let rising = bits ^ select(0x80000000u, 0xffffffffu, bits >= 0x80000000u);
    return ~rising;
}

/// Derivatives by the position of a splat, from those by its 2-D mean; the Jacobian is constant.
fn by_position(p: vec3<f32>, by_mean: vec2<f32>, by_jacobian: array<vec3<f32>, 2>) -> vec3<f32> {
    let view = camera();
    let column = view.column.xyz + bend_slope(p, view.column_bend, view.column_bend_end);
    let row = view.row.xyz + bend_slope(p, view.row_bend, view.row_bend_end);
    return column * by_mean.x + row * by_mean.y;
}

/// Colours do not depend on the direction of view: `plan.coefficients` is 0.
fn direction_to(position: vec3<f32>) -> vec4<f32> {
    return vec4(0.0, 0.0, -1.0, 0.0);
}
