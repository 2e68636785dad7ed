// The sums of an iteration, for the host.

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<storage, read> status: array<u32>;
@group(0) @binding(2) var<storage, read> opacity_sums: array<f32>;
@group(0) @binding(3) var<storage, read> ssim_sums: array<f32>;
@group(0) @binding(4) var<storage, read> l1_sums: array<f32>;
@group(0) @binding(5) var<storage, read_write> report: Report;

struct Report {
    /// The halted iteration, or 0, and the number of pairs that it needs.
    halted: u32,
    pairs: u32,
    opacity: f32,
    ssim: f32,
    l1: f32,
}

alias Summed = f32;

var<workgroup> sums: array<Summed, GROUP>;

@compute @workgroup_size(GROUP)
fn main(@builtin(local_invocation_index) lane: u32) {
    var opacity = 0.0;
    for (var k = lane; k < (plan.splats + GROUP - 1u) / GROUP; k += GROUP) {
        opacity += opacity_sums[k];
    }
    var ssim = 0.0;
    var l1 = 0.0;
    for (var k = lane; k < 3u * plan.tiles.x * plan.tiles.y; k += GROUP) {
        ssim += ssim_sums[k];
        l1 += l1_sums[k];
    }
    opacity = sum_of_lanes(lane, opacity);
    ssim = sum_of_lanes(lane, ssim);
    l1 = sum_of_lanes(lane, l1);
    if lane == 0u {
        report = Report(status[0], status[1], opacity, ssim, l1);
    }
}
