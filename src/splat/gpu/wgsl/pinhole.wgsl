// The pinhole camera (src/perspective/kernel.rs): what projection and its gradient need of a camera.

struct Camera {
    /// Rows of the rotation from site to camera axes (right, down, forward), each with a translation.
    right: vec4<f32>,
    down: vec4<f32>,
    forward: vec4<f32>,
    focal: vec2<f32>,
    principal: vec2<f32>,
    /// Lowest and highest x / z, then y / z, at which the Jacobian is evaluated.
    limits: vec4<f32>,
    /// The camera's centre.
    center: vec3<f32>,
    /// Depth up to which nothing is drawn.
    nearest: f32,
}

/// Key of splats that are not drawn: they come last.
const BEHIND: u32 = 0xffffffffu;

fn camera() -> Camera {
    let c = plan.camera;
    return Camera(c[0], c[1], c[2], c[3].xy, c[3].zw, c[4], c[5].xyz, c[5].w);
}

fn camera_from_site(p: vec3<f32>) -> vec3<f32> {
    let view = camera();
    return vec3(
        dot(view.right.xyz, p) + view.right.w,
        dot(view.down.xyz, p) + view.down.w,
        dot(view.forward.xyz, p) + view.forward.w,
    );
}

/// The image of a point in front of the camera.
fn image_of(p: vec3<f32>) -> vec2<f32> {
    let view = camera();
    let c = camera_from_site(p);
    return view.focal * (c.xy * (1.0 / c.z)) + view.principal;
}

/// The rows of the 2x3 Jacobian of the projection at a point.
fn jacobian(p: vec3<f32>) -> array<vec3<f32>, 2> {
    let view = camera();
    let c = camera_from_site(p);
    let inverse = 1.0 / max(c.z, view.nearest);
    let limited = clamp(c.xy * inverse, view.limits.xz, view.limits.yw);
    let scale = view.focal * inverse;
    return array(
        scale.x * (view.right.xyz - limited.x * view.forward.xyz),
        scale.y * (view.down.xyz - limited.y * view.forward.xyz),
    );
}

/// Whether an image with these margins may show a point.
fn is_within(point: vec2<f32>, margin: f32) -> bool {
    let size = vec2<f32>(plan.size);
    return all(point + margin >= vec2(0.0)) && all(point - margin <= size);
}

/// The depth of a splat along the optical axis; 0 if the camera shows nothing of it (src/splat/pinhole/seen.rs).
fn depth_of(splat: Core) -> f32 {
    let view = camera();
    let c = camera_from_site(splat.position);
    let is_in_front = is_finite(c.z) && c.z > view.nearest;
    if !is_in_front || !(splat.opacity_logit >= LEAST_LOGIT) {
        return 0.0;
    }
    let inverse = 1.0 / c.z;
    let ratio = c.xy * inverse;
    let mean = view.focal * ratio + view.principal;
    let largest = max(max(splat.log_scale.x, splat.log_scale.y), splat.log_scale.z);
    let px_per_m = max(view.focal.x, view.focal.y) * inverse * sqrt(1.0 + dot(ratio, ratio));
    let may_show = is_within(mean, LEAST_REACH_PX)
        || is_within(mean, LEAST_REACH_PX + REACH * px_per_m * exp(largest));
    return select(0.0, c.z, may_show);
}

/// Whether the camera may show a splat of this depth.
fn is_seen(depth: f32) -> bool {
    return depth > 0.0;
}

/// The key by which splats are sorted, the smallest first.
fn depth_key(image: Projected) -> u32 {
    return select(BEHIND, bitcast<u32>(image.depth), image.tiles > 0u);
}

/// Derivatives by the position of a splat, from those by its 2-D mean and by the rows of the Jacobian.
fn by_position(p: vec3<f32>, by_mean: vec2<f32>, by_jacobian: array<vec3<f32>, 2>) -> vec3<f32> {
    let view = camera();
    let c = camera_from_site(p);
    let inverse = 1.0 / max(c.z, view.nearest);
    let scale = view.focal * inverse;
    let ratio = c.xy * inverse;
    let limited = clamp(ratio, view.limits.xz, view.limits.yw);
    let slope = select(vec2(0.0), vec2(1.0), limited == ratio);
    let by_own = vec2(dot(view.right.xyz, by_jacobian[0]), dot(view.down.xyz, by_jacobian[1]));
    let by_forward = vec2(dot(view.forward.xyz, by_jacobian[0]), dot(view.forward.xyz, by_jacobian[1]));
    let by_limited = -scale * by_forward * slope;
    let by_scale = by_own - limited * by_forward;
    let by_depth = -scale * ratio * by_mean - (by_limited * ratio + by_scale * scale) * inverse;
    let by_camera = vec3(scale * by_mean + by_limited * inverse, by_depth.x + by_depth.y);
    return view.right.xyz * by_camera.x + view.down.xyz * by_camera.y + view.forward.xyz * by_camera.z;
}

/// The direction from the camera's centre to a splat, and the reciprocal of its distance.
fn direction_to(position: vec3<f32>) -> vec4<f32> {
    let d = position - camera().center;
    let inverse = 1.0 / sqrt(max(dot(d, d), 1e-24));
    return vec4(d * inverse, inverse);
}
