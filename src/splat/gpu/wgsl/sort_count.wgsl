// First step of a pass of the radix sort: how often each value of a digit occurs in each block of keys.

/// Number of keys, of blocks, and of counts.
@group(0) @binding(0) var<storage, read> size: array<u32>;
@group(0) @binding(1) var<storage, read> keys: array<u32>;
/// Digit by digit, the number of its occurrences in each block.
@group(0) @binding(2) var<storage, read_write> counts: array<u32>;

override SHIFT: u32;

var<workgroup> occurrences: array<atomic<u32>, DIGITS>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let block = group_index(group, groups);
    if block >= size[1] {
        return;
    }
    atomicStore(&occurrences[lane], 0u);
    workgroupBarrier();
    for (var round = 0u; round < SORT_ROUNDS; round++) {
        let at = (block * SORT_ROUNDS + round) * GROUP + lane;
        if at < size[0] {
            atomicAdd(&occurrences[(keys[at] >> SHIFT) % DIGITS], 1u);
        }
    }
    workgroupBarrier();
    counts[lane * size[1] + block] = atomicLoad(&occurrences[lane]);
}
