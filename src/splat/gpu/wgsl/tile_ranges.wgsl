// First pair of each tile's list and the first behind it, from the sorted tiles of all pairs.

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<storage, read> size: array<u32>;
@group(0) @binding(2) var<storage, read> tiles: array<u32>;
/// Zero before.
@group(0) @binding(3) var<storage, read_write> ranges: array<TileRange>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let pair = group_index(group, groups) * GROUP + lane;
    let pairs = size[0];
    if pair >= pairs {
        return;
    }
    let tile = tiles[pair];
    if tile >= plan.tiles.x * plan.tiles.y {
        return;
    }
    if pair == 0u || tiles[pair - 1u] != tile {
        ranges[tile].start = pair;
    }
    if pair + 1u == pairs || tiles[pair + 1u] != tile {
        ranges[tile].end = pair + 1u;
    }
}
