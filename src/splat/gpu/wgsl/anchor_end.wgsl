// After the step of anchored splats: the residuals are what the step has left, and the parameters are those of the anchors plus them.

@group(0) @binding(0) var<uniform> shading: Shading;
@group(0) @binding(1) var<storage, read> anchorings: array<Anchoring>;
@group(0) @binding(2) var<storage, read> status: array<u32>;
@group(0) @binding(3) var<storage, read_write> residuals: array<Core>;
@group(0) @binding(4) var<storage, read_write> core: array<Core>;

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
    let residual = core[own.splat];
    residuals[k] = residual;
    var composed = core_sum(residual, core[own.anchor]);
    composed.anchored = 1.0;
    core[own.splat] = composed;
}
