// Projects the splats: ellipses, colours, depth keys (src/splat/raster/project.rs).

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<storage, read> core: array<Core>;
@group(0) @binding(2) var<storage, read> rest: array<f32>;
@group(0) @binding(3) var<storage, read_write> projected: array<Projected>;
@group(0) @binding(4) var<storage, read_write> keys: array<u32>;
@group(0) @binding(5) var<storage, read_write> indices: array<u32>;
/// The sum of the opacities of each workgroup.
@group(0) @binding(6) var<storage, read_write> opacity_sums: array<f32>;

alias Summed = f32;

var<workgroup> sums: array<Summed, GROUP>;

fn color_of(i: u32, f_dc: vec3<f32>, position: vec3<f32>) -> vec3<f32> {
    var color = f_dc * SH_C0 + 0.5;
    if plan.coefficients > 0u {
        var functions = basis(direction_to(position).xyz);
        for (var k = 0u; k < plan.coefficients; k++) {
            let at = i * 45u + k;
            color += functions[k] * vec3(rest[at], rest[at + 15u], rest[at + 30u]);
        }
    }
    return shown(color);
}

fn project(i: u32, splat: Core, opacity: f32) -> Projected {
    var out = Projected();
    out.depth = depth_of(splat);
    if !is_seen(out.depth) {
        return out;
    }
    let mean = image_of(splat.position);
    let s = covariance(rotation_rows(splat.rotation), exp(2.0 * splat.log_scale));
    let j = jacobian(splat.position);
    let by_right = times_covariance(j[0], s);
    let by_down = times_covariance(j[1], s);
    let xx = dot(by_right, j[0]) + LOW_PASS_PX2;
    let xy = dot(by_right, j[1]);
    let yy = dot(by_down, j[1]) + LOW_PASS_PX2;
    let inverse_area = 1.0 / (xx * yy - xy * xy);
    out.mean = mean;
    out.conic = vec3(yy * inverse_area, -xy * inverse_area, xx * inverse_area);
    out.log2_opacity = log2(opacity);
    out.radius2 = 2.0 * LN_2 * (out.log2_opacity - LOG2_ALPHA_CUT);
    out.half_width = sqrt(out.radius2 * xx);
    out.half_height = sqrt(out.radius2 * yy);
    out.rightmost_dy = xy / xx * out.half_width;
    let is_sound = is_finite(mean.x) && is_finite(mean.y) && is_finite(out.half_width) && is_finite(out.half_height)
        && is_finite(out.conic.x) && is_finite(out.conic.y) && is_finite(out.conic.z);
    if !is_sound || !(opacity > ALPHA_CUT) || out.radius2 <= 0.0 || out.conic.x <= 0.0 || out.conic.z <= 0.0 {
        return out;
    }
    out.color = color_of(i, splat.f_dc, splat.position);
    out.tiles = tiles_touched(out);
    return out;
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let block = group_index(group, groups);
    let i = block * GROUP + lane;
    var opacity = 0.0;
    if i < plan.splats {
        let splat = core[i];
        opacity = 1.0 / (1.0 + exp(-splat.opacity_logit));
        let image = project(i, splat, opacity);
        projected[i] = image;
        keys[i] = depth_key(image);
        indices[i] = i;
    }
    let sum = sum_of_lanes(lane, opacity);
    if lane == 0u && block * GROUP < plan.splats {
        opacity_sums[block] = sum;
    }
}
