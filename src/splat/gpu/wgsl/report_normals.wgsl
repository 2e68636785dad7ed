// The sum of differences between normals, for the host: it follows the sums of `report_terms.wgsl`.

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<storage, read> normal_sums: array<f32>;
@group(0) @binding(2) var<storage, read_write> report: array<f32>;

alias Summed = f32;

var<workgroup> sums: array<Summed, GROUP>;

@compute @workgroup_size(GROUP)
fn main(@builtin(local_invocation_index) lane: u32) {
    var normals = 0.0;
    for (var k = lane; k < plan.tiles.x * plan.tiles.y; k += GROUP) {
        normals += normal_sums[k];
    }
    normals = sum_of_lanes(lane, normals);
    if lane == 0u {
        report[10] = normals;
    }
}
