// The number of pairs of splats and tiles, and the sizes of the dispatches that follow from it. Where there is no room for them, the
// iteration is marked as halted: it and those behind it change nothing, until the host has made room and runs them again.

@group(0) @binding(0) var<uniform> plan: Plan;
/// The last of these is the number of pairs.
@group(0) @binding(1) var<storage, read> block_sums: array<u32>;
/// The halted iteration, or 0, and the number of pairs that it needs.
@group(0) @binding(2) var<storage, read_write> status: array<u32>;
/// Number of pairs, of blocks of the sort and of its counts; from 4 on workgroups of the sort, its scan, and of pairs.
@group(0) @binding(3) var<storage, read_write> size: array<u32>;

/// Workgroups in two dimensions.
fn write_groups(at: u32, groups: u32) {
    size[at] = min(groups, MAX_GROUPS);
    size[at + 1u] = (groups + MAX_GROUPS - 1u) / MAX_GROUPS;
    size[at + 2u] = 1u;
}

@compute @workgroup_size(1)
fn main() {
    let scan_blocks = (plan.splats + SCAN_BLOCK - 1u) / SCAN_BLOCK;
    var pairs = block_sums[scan_blocks];
    if status[0] == 0u && pairs > plan.pair_capacity {
        status[0] = plan.iteration;
        status[1] = pairs;
    }
    if status[0] != 0u {
        pairs = 0u;
    }
    let block = SORT_ROUNDS * GROUP;
    let blocks = (pairs + block - 1u) / block;
    size[0] = pairs;
    size[1] = blocks;
    size[2] = blocks * DIGITS;
    write_groups(4u, blocks);
    write_groups(8u, (blocks * DIGITS + SCAN_BLOCK - 1u) / SCAN_BLOCK);
    write_groups(12u, (pairs + GROUP - 1u) / GROUP);
}
