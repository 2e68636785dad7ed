// Lists the pairs of splats and tiles in the order of ranks. The pairs of a splat have successive slots.

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<storage, read> order: array<u32>;
/// Pairs before each rank within its block of the scan, and before the block.
@group(0) @binding(2) var<storage, read> counts: array<u32>;
@group(0) @binding(3) var<storage, read> block_sums: array<u32>;
@group(0) @binding(4) var<storage, read> size: array<u32>;
@group(0) @binding(5) var<storage, read_write> projected: array<Projected>;
/// The tile of each slot, the slot itself, and its splat.
@group(0) @binding(6) var<storage, read_write> tiles: array<u32>;
@group(0) @binding(7) var<storage, read_write> slots: array<u32>;
@group(0) @binding(8) var<storage, read_write> splats: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let rank = group_index(group, groups) * GROUP + lane;
    if rank >= plan.splats || size[0] == 0u {
        return;
    }
    let i = order[rank];
    let splat = projected[i];
    if splat.tiles == 0u {
        return;
    }
    var slot = counts[rank] + block_sums[rank / SCAN_BLOCK];
    let end = slot + splat.tiles;
    projected[i].first_slot = slot;
    let rows = rows_of(splat);
    for (var row = rows.x; row <= rows.y; row++) {
        let columns = columns_of(splat, row);
        for (var column = columns.x; column <= columns.y && slot < end; column++) {
            tiles[slot] = row * plan.tiles.x + column;
            slots[slot] = slot;
            splats[slot] = i;
            slot++;
        }
    }
    // Two compilations of one test can differ by a rounding: what is left belongs to no tile, and sorts behind all tiles.
    for (; slot < end; slot++) {
        tiles[slot] = plan.tiles.x * plan.tiles.y;
        slots[slot] = slot;
        splats[slot] = i;
    }
}
