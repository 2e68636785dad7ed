// Alpha compositing front to back, a workgroup for each tile (src/splat/raster/forward.rs).

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<storage, read_write> ranges: array<TileRange>;
/// The slots of each tile's list, and the splat of each slot.
@group(0) @binding(2) var<storage, read> slots: array<u32>;
@group(0) @binding(3) var<storage, read> splats: array<u32>;
@group(0) @binding(4) var<storage, read> projected: array<Projected>;
/// Each pixel: `pixel_of`, plane by plane.
@group(0) @binding(5) var<storage, read_write> frame: array<vec4<f32>>;

var<workgroup> batch: array<Staged, BATCH>;
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
    for (var start = list.start; start < list.end; start += BATCH) {
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
        if lane < BATCH && entry < list.end {
            let slot = slots[entry];
            let splat = splats[slot];
            batch[lane] = staged(projected[splat], splat, slot);
        }
        workgroupBarrier();
        let count = min(BATCH, list.end - start);
        for (var k = 0u; k < count && transmittance >= MIN_TRANSMITTANCE; k++) {
            let sample = sample_at(batch[k], place);
            let alpha = min(sample.alpha, ALPHA_MAX);
            let behind = transmittance * (1.0 - alpha);
            features += composited(sample, transmittance * alpha, transmittance, behind);
            transmittance = behind;
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
        var whole = pixel_of(features + transmittance * features_behind(), transmittance);
        let i = pixel.y * plan.size.x + pixel.x;
        for (var part = 0u; part < PIXEL; part++) {
            frame[part * plan.size.x * plan.size.y + i] = whole[part];
        }
    }
}
