// Adam for f_rest: a lane for each splat and coefficient, with its three channels. It comes before `step_core`, which moves the splats.
// Splats whose colour has no derivative wait (src/splat/adam.rs).

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<storage, read> gradient: array<Core>;
@group(0) @binding(2) var<storage, read> status: array<u32>;
@group(0) @binding(3) var<storage, read> core: array<Core>;
@group(0) @binding(4) var<storage, read_write> rest: array<f32>;
@group(0) @binding(5) var<storage, read_write> first: array<f32>;
@group(0) @binding(6) var<storage, read_write> second: array<f32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let work = group_index(group, groups) * GROUP + lane;
    let i = work / 15u;
    let k = work % 15u;
    if i >= plan.splats || status[0] != 0u {
        return;
    }
    let by_color = gradient[i].f_dc;
    if gradient[i].seen == 0.0 || all(by_color == vec3(0.0)) {
        return;
    }
    var by = vec3(0.0);
    if k < plan.coefficients {
        var functions = basis(direction_to(core[i].position).xyz);
        by = functions[k] * by_color;
    }
    let at = i * 45u + k;
    let stepped = adam(
        vec4(rest[at], rest[at + 15u], rest[at + 30u], 0.0),
        vec4(first[at], first[at + 15u], first[at + 30u], 0.0),
        vec4(second[at], second[at + 15u], second[at + 30u], 0.0),
        vec4(by, 0.0),
        vec4(plan.color_rates.y),
    );
    for (var c = 0u; c < 3u; c++) {
        rest[at + 15u * c] = stepped.value[c];
        first[at + 15u * c] = stepped.first[c];
        second[at + 15u * c] = stepped.second[c];
    }
}
