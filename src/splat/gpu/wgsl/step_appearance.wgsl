// Adam for the colour model of the view.

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<uniform> shading: Shading;
/// Of each workgroup of pixels: the sums of the derivatives by the parameters, four vectors.
@group(0) @binding(2) var<storage, read> parameter_sums: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> status: array<u32>;
@group(0) @binding(4) var<storage, read_write> appearance: array<f32>;

alias Summed = vec4<f32>;

var<workgroup> sums: array<Summed, GROUP>;

fn four(at: u32) -> vec4<f32> {
    return vec4(appearance[at], appearance[at + 1u], appearance[at + 2u], appearance[at + 3u]);
}

fn write_four(at: u32, values: vec4<f32>) {
    for (var k = 0u; k < 4u; k++) {
        appearance[at + k] = values[k];
    }
}

@compute @workgroup_size(GROUP)
fn main(@builtin(local_invocation_index) lane: u32) {
    for (var k = 0u; k < 4u; k++) {
        var sum = vec4(0.0);
        for (var tile = lane; tile < plan.tiles.x * plan.tiles.y; tile += GROUP) {
            sum += parameter_sums[4u * tile + k];
        }
        let by = sum_of_lanes(lane, sum);
        if lane == 0u && status[0] == 0u {
            let at = 4u * k;
            let stepped = adam_by(
                four(at),
                four(MOMENTS + at),
                four(2u * MOMENTS + at),
                by,
                vec4(shading.appearance_rate),
                shading.appearance_root_second,
                APPEARANCE_EPSILON,
            );
            write_four(at, stepped.value);
            write_four(MOMENTS + at, stepped.first);
            write_four(2u * MOMENTS + at, stepped.second);
        }
    }
}
