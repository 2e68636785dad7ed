// The sums of the loss terms of satellite scenes, for the host: they follow those of `report.wgsl`.

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<uniform> shading: Shading;
@group(0) @binding(2) var<storage, read> entropy_sums: array<f32>;
@group(0) @binding(3) var<storage, read> compared: vec4<f32>;
@group(0) @binding(4) var<storage, read> distance_sums: array<f32>;
@group(0) @binding(5) var<storage, read_write> report: array<f32>;

alias Summed = f32;

var<workgroup> sums: array<Summed, GROUP>;

@compute @workgroup_size(GROUP)
fn main(@builtin(local_invocation_index) lane: u32) {
    var entropy = 0.0;
    for (var k = lane; k < plan.tiles.x * plan.tiles.y; k += GROUP) {
        entropy += entropy_sums[k];
    }
    var distance = 0.0;
    if shading.by_distance != 0.0 {
        for (var k = lane; k < (plan.splats + GROUP - 1u) / GROUP; k += GROUP) {
            distance += distance_sums[k];
        }
    }
    entropy = sum_of_lanes(lane, entropy);
    distance = sum_of_lanes(lane, distance);
    if lane == 0u {
        report[5] = entropy;
        report[6] = compared.x;
        report[7] = compared.y;
        report[8] = compared.z;
        report[9] = distance;
    }
}
