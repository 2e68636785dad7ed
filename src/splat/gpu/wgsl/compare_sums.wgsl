// The sums of `compare.wgsl` over all pixels.

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<storage, read> difference_sums: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> compared: vec4<f32>;

alias Summed = vec4<f32>;

var<workgroup> sums: array<Summed, GROUP>;

@compute @workgroup_size(GROUP)
fn main(@builtin(local_invocation_index) lane: u32) {
    var sum = vec4(0.0);
    for (var k = lane; k < plan.tiles.x * plan.tiles.y; k += GROUP) {
        sum += difference_sums[k];
    }
    let total = sum_of_lanes(lane, sum);
    if lane == 0u {
        compared = total;
    }
}
