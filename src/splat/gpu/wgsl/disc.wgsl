// What projection and its gradient need of a flat disc: the slope of its plane (src/splat/raster/slope.rs, footprint.rs).

@group(0) @binding(8) var<storage, read_write> planes: array<Plane>;

/// 1 if a normal points to the side of its plane on which the camera is, else -1.
fn side_of(normal: vec3<f32>, position: vec3<f32>) -> f32 {
    return select(1.0, -1.0, dot(normal, camera().center - position) < 0.0);
}

/// A symmetric matrix (xx, xy, yy) times a vector.
fn times(m: vec3<f32>, v: vec2<f32>) -> vec2<f32> {
    return vec2(m.x * v.x + m.y * v.y, m.y * v.x + m.z * v.y);
}

/// The share of its slope with which a disc is drawn, from the covariance (xx, xy, yy) of its image without the low-pass filter, and the
/// derivatives by it.
fn slope_damping(c: vec3<f32>) -> vec4<f32> {
    let trace = max(c.x + c.z, LEAST_PX2);
    let determinant = max(c.x * c.z - c.y * c.y, 0.0);
    let factor = 2.0 / LOW_PASS_PX2;
    let damping = factor * determinant / trace;
    if damping >= 1.0 {
        return vec4(1.0, 0.0, 0.0, 0.0);
    }
    let by = vec3(c.z * trace - determinant, -2.0 * c.y * trace, c.x * trace - determinant);
    return vec4(damping, by * factor / (trace * trace));
}

/// Stores the plane of a disc whose image has this covariance (xx, xy, yy); returns the image with the ellipse on which alpha equals the
/// cut-off.
fn outlined(i: u32, splat: Core, image: Projected, covariance: vec3<f32>) -> Projected {
    let rows = rotation_rows(splat.rotation);
    let normal = vec3(rows[0].z, rows[1].z, rows[2].z);
    let damping = slope_damping(covariance - vec3(LOW_PASS_PX2, 0.0, LOW_PASS_PX2)).x;
    var slope = damping * plane_slope(splat.position, normal, vec2(0.0)).slope;
    let r2 = image.radius2;
    let has_slope = r2 * dot(slope, times(covariance, slope)) <= MAX_TILT;
    slope = select(vec2(0.0), slope, has_slope);
    planes[i] = Plane(image.mean, slope, image.conic, u32(has_slope), side_of(normal, splat.position) * normal);
    // With the conic L, the slope g and the squared radius r², alpha equals the cut-off where d L d = r² (1 + g . d)².
    let s = times(covariance, slope);
    let widening = 1.0 / (1.0 - r2 * dot(slope, s));
    let shift = r2 * widening;
    let wide = covariance + shift * vec3(s.x * s.x, s.x * s.y, s.y * s.y);
    var out = image;
    out.mean += shift * s;
    out.conic -= r2 * vec3(slope.x * slope.x, slope.x * slope.y, slope.y * slope.y);
    out.radius2 = shift;
    out.half_width = sqrt(shift * wide.x);
    out.half_height = sqrt(shift * wide.z);
    out.rightmost_dy = wide.y / wide.x * out.half_width;
    return out;
}

/// Derivatives by way of the plane; `covariance` is that of the image without the low-pass filter.
fn plane_gradient(
    i: u32,
    image: Projected,
    position: vec3<f32>,
    normal: vec3<f32>,
    covariance: vec3<f32>,
    sums: array<f32, SLOT>,
) -> PlaneGradient {
    let plane = planes[i];
    var out = PlaneGradient();
    out.conic = plane.conic;
    out.log_opacity = sums[SLOPE_SUMS];
    out.mean = -plane.slope * sums[SLOPE_SUMS + 1u];
    out.normal = side_of(normal, position) * vec3(sums[6u + NORMAL], sums[7u + NORMAL], sums[8u + NORMAL]);
    if plane.has_slope != 0u {
        let by = vec2(sums[SLOPE_SUMS + 2u], sums[SLOPE_SUMS + 3u]);
        let damping = slope_damping(covariance);
        let undamped = plane_slope(position, normal, by * damping.x);
        out.position = undamped.by_position;
        out.normal += undamped.by_normal;
        out.covariance = damping.yzw * dot(undamped.slope, by);
    }
    return out;
}
