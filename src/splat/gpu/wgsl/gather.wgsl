// From the slots of a splat to the derivatives by its parameters (src/splat/raster/footprint.rs, covariance.rs, src/splat/harmonics.rs),
// and the statistics for densification.

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<storage, read> core: array<Core>;
@group(0) @binding(2) var<storage, read> rest: array<f32>;
@group(0) @binding(3) var<storage, read> projected: array<Projected>;
@group(0) @binding(4) var<storage, read> slots: array<f32>;
@group(0) @binding(5) var<storage, read> status: array<u32>;
@group(0) @binding(6) var<storage, read_write> gradient: array<Core>;
/// Of each splat: the sum over views of the norm of the derivative by its 2-D mean, per half image side; the number of views (as bits).
@group(0) @binding(7) var<storage, read_write> statistics: array<vec2<f32>>;

/// Derivatives by a quaternion from those by the rows of its rotation.
fn by_quaternion(q: vec4<f32>, m: array<vec3<f32>, 3>) -> vec4<f32> {
    let w = q.x;
    let x = q.y;
    let y = q.z;
    let z = q.w;
    let inverse = inverse_length2(q);
    let by = vec4(
        x * (m[2].y - m[1].z) + y * (m[0].z - m[2].x) + z * (m[1].x - m[0].y),
        w * (m[2].y - m[1].z) + y * (m[0].y + m[1].x) + z * (m[0].z + m[2].x) - 2.0 * x * (m[1].y + m[2].z),
        w * (m[0].z - m[2].x) + x * (m[0].y + m[1].x) + z * (m[1].z + m[2].y) - 2.0 * y * (m[0].x + m[2].z),
        w * (m[1].x - m[0].y) + x * (m[0].z + m[2].x) + y * (m[1].z + m[2].y) - 2.0 * z * (m[0].x + m[1].y),
    );
    return 2.0 * inverse * (by - q * (dot(q, by) * inverse));
}

/// Derivatives by the position by way of the colour.
fn by_direction(i: u32, position: vec3<f32>, by_color: vec3<f32>) -> vec3<f32> {
    let direction = direction_to(position);
    let d = direction.xyz;
    var w: array<f32, 15>;
    for (var k = 0u; k < plan.coefficients; k++) {
        let at = i * 45u + k;
        w[k] = dot(by_color, vec3(rest[at], rest[at + 15u], rest[at + 30u]));
    }
    let by = harmonics_gradient(d, w);
    return (by - d * dot(by, d)) * direction.w;
}

fn gather(i: u32) -> Core {
    var out = Core();
    let splat = core[i];
    let image = projected[i];
    let opacity = 1.0 / (1.0 + exp(-splat.opacity_logit));
    var sums: array<f32, SLOT>;
    for (var tile = 0u; tile < image.tiles; tile++) {
        for (var number = 0u; number < SLOT; number++) {
            sums[number] += slots[(image.first_slot + tile) * SLOT + number];
        }
    }
    out.opacity_logit = (sums[0] + plan.by_opacity * opacity) * (1.0 - opacity);
    out.seen = select(0.0, 1.0, is_seen(image.depth));
    if image.tiles == 0u {
        return out;
    }
    let k = image.conic;
    let conic = mat2x2(k.x, k.y, k.y, k.z);
    let by_mean = conic * vec2(sums[1], sums[3]);
    // The derivative by the 2-D covariance.
    let g = 0.5 * (conic * mat2x2(sums[2], sums[4], sums[4], sums[5]) * conic);
    let j = jacobian(splat.position);
    let rows = rotation_rows(splat.rotation);
    let variance = exp(2.0 * splat.log_scale);
    let s = covariance(rows, variance);
    // The 2-D covariance is J S Jᵀ: the derivative by J is 2 G J S, that by S is Jᵀ G J.
    let gj = array(g[0].x * j[0] + g[0].y * j[1], g[0].y * j[0] + g[1].y * j[1]);
    let by_jacobian = array(2.0 * times_covariance(gj[0], s), 2.0 * times_covariance(gj[1], s));
    out.position = by_position(splat.position, by_mean, by_jacobian);
    out.position.z += by_altitude(sums);
    // With M = R diag(scale), S is M Mᵀ: the derivative by R is 2 Jᵀ G J R diag(variance).
    var by_rows: array<vec3<f32>, 3>;
    let columns = transpose(mat3x3(rows[0], rows[1], rows[2]));
    for (var axis = 0u; axis < 3u; axis++) {
        let v = columns[axis];
        let image_of_axis = vec2(dot(j[0], v), dot(j[1], v));
        let by_axis = 2.0 * variance[axis] * (gj[0] * image_of_axis.x + gj[1] * image_of_axis.y);
        out.log_scale[axis] = dot(v, by_axis);
        by_rows[0][axis] = by_axis.x;
        by_rows[1][axis] = by_axis.y;
        by_rows[2][axis] = by_axis.z;
    }
    out.rotation = by_quaternion(splat.rotation, by_rows);
    // Colours that are clamped at zero have no derivative.
    out.f_dc = select(vec3(0.0), vec3(sums[6], sums[7], sums[8]), is_shown(image.color));
    if plan.coefficients > 0u {
        out.position += by_direction(i, splat.position, out.f_dc);
    }
    if plan.adds_gradient == 0u {
        let norm = length(by_mean * 0.5 * vec2<f32>(plan.size));
        let seen = statistics[i];
        statistics[i] = vec2(seen.x + norm, bitcast<f32>(bitcast<u32>(seen.y) + 1u));
    }
    return out;
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = group_index(group, groups) * GROUP + lane;
    if i >= plan.splats || status[0] != 0u {
        return;
    }
    var by = gather(i);
    if plan.adds_gradient != 0u {
        by = core_sum(by, gradient[i]);
    }
    gradient[i] = by;
}
