// Before the step of anchored splats: their gradients are added to those of their anchors, and residuals take the place of their
// parameters. A lane for each anchoring; the first of an anchor adds them all.

@group(0) @binding(0) var<uniform> shading: Shading;
@group(0) @binding(1) var<storage, read> anchorings: array<Anchoring>;
@group(0) @binding(2) var<storage, read> residuals: array<Core>;
@group(0) @binding(3) var<storage, read> status: array<u32>;
@group(0) @binding(4) var<storage, read_write> core: array<Core>;
@group(0) @binding(5) var<storage, read_write> gradient: array<Core>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let k = group_index(group, groups) * GROUP + lane;
    if k >= shading.anchored || status[0] != 0u {
        return;
    }
    let own = anchorings[k];
    core[own.splat] = residuals[k];
    if k > 0u && anchorings[k - 1u].anchor == own.anchor {
        return;
    }
    var by = gradient[own.anchor];
    for (var other = k; other < shading.anchored && anchorings[other].anchor == own.anchor; other++) {
        by = core_sum(by, gradient[anchorings[other].splat]);
    }
    gradient[own.anchor] = by;
}
