// Adam for all parameters but f_rest. Splats that the view cannot show wait, but for their opacities (src/splat/adam.rs).

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<storage, read> gradient: array<Core>;
@group(0) @binding(2) var<storage, read> status: array<u32>;
@group(0) @binding(3) var<storage, read_write> core: array<Core>;
@group(0) @binding(4) var<storage, read_write> first: array<Core>;
@group(0) @binding(5) var<storage, read_write> second: array<Core>;

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
    let by = gradient[i];
    var value = core[i];
    var m = first[i];
    var s = second[i];
    let place = adam(
        vec4(value.position, value.opacity_logit),
        vec4(m.position, m.opacity_logit),
        vec4(s.position, s.opacity_logit),
        vec4(by.position, by.opacity_logit),
        vec4(vec3(plan.rates.x), plan.rates.y),
    );
    value.opacity_logit = place.value.w;
    m.opacity_logit = place.first.w;
    s.opacity_logit = place.second.w;
    if by.seen > 0.0 {
        let extent = adam(
            vec4(value.log_scale, 0.0),
            vec4(m.log_scale, 0.0),
            vec4(s.log_scale, 0.0),
            vec4(by.log_scale, 0.0),
            vec4(plan.rates.z),
        );
        let turn = adam(value.rotation, m.rotation, s.rotation, by.rotation, vec4(plan.rates.w));
        let color = adam(
            vec4(value.f_dc, 0.0),
            vec4(m.f_dc, 0.0),
            vec4(s.f_dc, 0.0),
            vec4(SH_C0 * by.f_dc, 0.0),
            vec4(plan.color_rates.x),
        );
        value.position = place.value.xyz;
        m.position = place.first.xyz;
        s.position = place.second.xyz;
        value.log_scale = extent.value.xyz;
        m.log_scale = extent.first.xyz;
        s.log_scale = extent.second.xyz;
        value.rotation = turn.value;
        m.rotation = turn.first;
        s.rotation = turn.second;
        value.f_dc = color.value.xyz;
        m.f_dc = color.first.xyz;
        s.f_dc = color.second.xyz;
    }
    core[i] = value;
    first[i] = m;
    second[i] = s;
}
