// Rotations and covariances of splats (src/splat/raster/covariance.rs): what projection and its gradient share.

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
