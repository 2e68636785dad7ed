// The derivatives of L1 and SSIM by the colours of the render, and the sum of absolute differences
// (src/splat/loss/photometric.rs). The third dimension of the dispatch is the colour channel.

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<storage, read> frame: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> photograph: array<u32>;
@group(0) @binding(3) var<storage, read> by_moments: array<f32>;
/// Plane by plane.
@group(0) @binding(4) var<storage, read_write> by_pixel: array<f32>;
/// The sum of absolute differences of each workgroup.
@group(0) @binding(5) var<storage, read_write> l1_sums: array<f32>;

var<workgroup> halo: array<f32, 3u * HALO_PIXELS>;
var<workgroup> along_rows: array<f32, 3u * HALO_ROW_PIXELS>;
var<workgroup> sums: array<f32, GROUP>;

@compute @workgroup_size(16, 16)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) at: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let channel = group.z;
    let corner = vec2<i32>(group.xy * TILE) - i32(RADIUS);
    let size = vec2<i32>(plan.size);
    let pixels = plan.size.x * plan.size.y;
    for (var k = lane; k < 3u * HALO_PIXELS; k += GROUP) {
        let in_halo = k % HALO_PIXELS;
        let pixel = corner + vec2<i32>(vec2(in_halo % HALO, in_halo / HALO));
        var value = 0.0;
        if all(pixel >= vec2(0)) && all(pixel < size) {
            value = by_moments[(3u * channel + k / HALO_PIXELS) * pixels + u32(pixel.y * size.x + pixel.x)];
        }
        halo[k] = value;
    }
    workgroupBarrier();
    for (var k = lane; k < 3u * HALO_ROW_PIXELS; k += GROUP) {
        let first = k / TILE * HALO + k % TILE;
        var sum = WINDOW_5 * halo[first + 5u];
        sum += WINDOW_0 * (halo[first] + halo[first + 10u]);
        sum += WINDOW_1 * (halo[first + 1u] + halo[first + 9u]);
        sum += WINDOW_2 * (halo[first + 2u] + halo[first + 8u]);
        sum += WINDOW_3 * (halo[first + 3u] + halo[first + 7u]);
        sum += WINDOW_4 * (halo[first + 4u] + halo[first + 6u]);
        along_rows[k] = sum;
    }
    workgroupBarrier();
    let pixel = group.xy * TILE + at.xy;
    var difference = 0.0;
    if all(pixel < plan.size) {
        var by: array<f32, 3>;
        for (var n = 0u; n < 3u; n++) {
            let first = n * HALO_ROW_PIXELS + at.y * TILE + at.x;
            by[n] = WINDOW_5 * along_rows[first + 5u * TILE];
            by[n] += WINDOW_0 * (along_rows[first] + along_rows[first + 10u * TILE]);
            by[n] += WINDOW_1 * (along_rows[first + TILE] + along_rows[first + 9u * TILE]);
            by[n] += WINDOW_2 * (along_rows[first + 2u * TILE] + along_rows[first + 8u * TILE]);
            by[n] += WINDOW_3 * (along_rows[first + 3u * TILE] + along_rows[first + 7u * TILE]);
            by[n] += WINDOW_4 * (along_rows[first + 4u * TILE] + along_rows[first + 6u * TILE]);
        }
        let i = pixel.y * plan.size.x + pixel.x;
        var by_color = 0.0;
        if photograph[i] != NO_DATA {
            let x = frame[i][channel];
            let y = target_of(photograph[i], channel);
            difference = x - y;
            by_color = by[0] + 2.0 * x * by[1] + y * by[2] + plan.by_l1 * sign(difference);
        }
        by_pixel[channel * pixels + i] = by_color;
    }
    let total = sum_of_lanes(lane, abs(difference));
    if lane == 0u {
        l1_sums[(channel * plan.tiles.y + group.y) * plan.tiles.x + group.x] = total;
    }
}
