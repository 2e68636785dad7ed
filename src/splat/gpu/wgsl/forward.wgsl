// Alpha compositing front to back, a workgroup for each tile (src/splat/raster/forward.rs).

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<storage, read_write> ranges: array<TileRange>;
/// The slots of each tile's list, and the splat of each slot.
@group(0) @binding(2) var<storage, read> slots: array<u32>;
@group(0) @binding(3) var<storage, read> splats: array<u32>;
@group(0) @binding(4) var<storage, read> projected: array<Projected>;
/// Each pixel: `pixel_of`.
@group(0) @binding(5) var<storage, read_write> frame: array<vec4<f32>>;

var<workgroup> batch: array<Staged, GROUP>;
var<workgroup> range: TileRange;
/// The largest number of splats that a pixel has needed, and whether one is still translucent.
var<workgroup> useful: atomic<u32>;
var<workgroup> is_translucent: atomic<u32>;
var<workgroup> goes_on: u32;

@compute @workgroup_size(16, 16)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) at: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let tile = group.y * plan.tiles.x + group.x;
    if lane == 0u {
        range = ranges[tile];
        atomicStore(&useful, 0u);
    }
    let list = workgroupUniformLoad(&range);
    let pixel = group.xy * TILE + at.xy;
    let is_inside = all(pixel < plan.size);
    let place = vec2<f32>(pixel);
    var transmittance = select(0.0, 1.0, is_inside);
    var features = Features();
    var needed = 0u;
    for (var start = list.start; start < list.end; start += GROUP) {
        if lane == 0u {
            atomicStore(&is_translucent, 0u);
        }
        workgroupBarrier();
        if transmittance >= MIN_TRANSMITTANCE {
            atomicStore(&is_translucent, 1u);
        }
        workgroupBarrier();
        if lane == 0u {
            goes_on = atomicLoad(&is_translucent);
        }
        if workgroupUniformLoad(&goes_on) == 0u {
            break;
        }
        let entry = start + lane;
        if entry < list.end {
            let slot = slots[entry];
            let splat = splats[slot];
            batch[lane] = staged(projected[splat], splat, slot);
        }
        workgroupBarrier();
        let count = min(GROUP, list.end - start);
        for (var k = 0u; k < count && transmittance >= MIN_TRANSMITTANCE; k++) {
            let alpha = min(alpha_at(batch[k], place), ALPHA_MAX);
            features += transmittance * alpha * batch[k].features;
            transmittance *= 1.0 - alpha;
            needed = start + k + 1u - list.start;
        }
        workgroupBarrier();
    }
    atomicMax(&useful, needed);
    workgroupBarrier();
    if lane == 0u {
        ranges[tile].useful = atomicLoad(&useful);
    }
    if is_inside {
        frame[pixel.y * plan.size.x + pixel.x] = pixel_of(features + transmittance * features_behind(), transmittance);
    }
}
