// Sums before each value within its block, and the sum of each block.

/// Lengths; the one that counts is `FIELD`.
@group(0) @binding(0) var<storage, read> size: array<u32>;
@group(0) @binding(1) var<storage, read_write> values: array<u32>;
@group(0) @binding(2) var<storage, read_write> block_sums: array<u32>;

override FIELD: u32;

var<workgroup> sums: array<u32, GROUP>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let length = size[FIELD];
    let block = group_index(group, groups);
    let first = block * SCAN_BLOCK + lane * SCAN_ROW;
    var row: array<u32, SCAN_ROW>;
    var sum = 0u;
    for (var k = 0u; k < SCAN_ROW; k++) {
        row[k] = sum;
        if first + k < length {
            sum += values[first + k];
        }
    }
    let before = sums_before(lane, sum);
    for (var k = 0u; k < SCAN_ROW; k++) {
        if first + k < length {
            values[first + k] = before + row[k];
        }
    }
    if lane == GROUP - 1u && block * SCAN_BLOCK < length {
        block_sums[block] = before + sum;
    }
}
