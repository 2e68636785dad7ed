// The pinhole camera (src/perspective/kernel.rs), rotations and harmonics: what projection and its gradient share.

fn camera_from_site(p: vec3<f32>) -> vec3<f32> {
    return vec3(
        dot(plan.right.xyz, p) + plan.right.w,
        dot(plan.down.xyz, p) + plan.down.w,
        dot(plan.forward.xyz, p) + plan.forward.w,
    );
}

/// The rows of the 2x3 Jacobian of the projection at camera coordinates `c`.
fn jacobian(c: vec3<f32>) -> array<vec3<f32>, 2> {
    let inverse = 1.0 / max(c.z, plan.nearest);
    let limited = clamp(c.xy * inverse, plan.limits.xz, plan.limits.yw);
    let scale = plan.focal * inverse;
    return array(
        scale.x * (plan.right.xyz - limited.x * plan.forward.xyz),
        scale.y * (plan.down.xyz - limited.y * plan.forward.xyz),
    );
}

/// The reciprocal of the squared length of a quaternion.
fn inverse_length2(q: vec4<f32>) -> f32 {
    return 1.0 / max(dot(q, q), 1e-24);
}

/// The rows of the rotation of a quaternion (w, x, y, z) of any length.
fn rotation_rows(q: vec4<f32>) -> array<vec3<f32>, 3> {
    let two = 2.0 * inverse_length2(q);
    let w = q.x;
    let x = q.y;
    let y = q.z;
    let z = q.w;
    return array(
        vec3(1.0 - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)),
        vec3(two * (x * y + w * z), 1.0 - two * (x * x + z * z), two * (y * z - w * x)),
        vec3(two * (x * z - w * y), two * (y * z + w * x), 1.0 - two * (x * x + y * y)),
    );
}

/// The elements xx, xy, xz and yy, yz, zz of a covariance.
fn covariance(rows: array<vec3<f32>, 3>, variance: vec3<f32>) -> array<vec3<f32>, 2> {
    return array(
        vec3(dot(rows[0] * rows[0], variance), dot(rows[0] * rows[1], variance), dot(rows[0] * rows[2], variance)),
        vec3(dot(rows[1] * rows[1], variance), dot(rows[1] * rows[2], variance), dot(rows[2] * rows[2], variance)),
    );
}

/// A vector times a covariance.
fn times_covariance(v: vec3<f32>, s: array<vec3<f32>, 2>) -> vec3<f32> {
    return vec3(
        dot(v, s[0]),
        v.x * s[0].y + v.y * s[1].x + v.z * s[1].y,
        v.x * s[0].z + v.y * s[1].y + v.z * s[1].z,
    );
}

/// The direction from the camera's centre to a splat, and the reciprocal of its distance.
fn direction_to(position: vec3<f32>) -> vec4<f32> {
    let d = position - plan.center;
    let inverse = 1.0 / sqrt(max(dot(d, d), 1e-24));
    return vec4(d * inverse, inverse);
}
