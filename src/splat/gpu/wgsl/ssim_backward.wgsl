// The derivatives of L1 and SSIM by the colours of the render, and the sum of absolute differences
// (src/splat/loss/photometric.rs). The third dimension of the dispatch is the colour channel.

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<storage, read> frame: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> by_moments: array<f32>;
/// Plane by plane.
@group(0) @binding(4) var<storage, read_write> by_pixel: array<f32>;
/// The sum of absolute differences of each workgroup.
@group(0) @binding(5) var<storage, read_write> l1_sums: array<f32>;

var<workgroup> halo: array<f32, 3u * HALO_PIXELS>;
var<workgroup> along_rows: array<f32, 3u * HALO_ROW_PIXELS>;
alias Summed = f32;

var<workgroup> sums: array<Summed, GROUP>;

alias Blurred = f32;

fn halo_value(at: u32) -> Blurred {
    return halo[at];
}

fn row_value(at: u32) -> Blurred {
    return along_rows[at];
}

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
        along_rows[k] = blurred_along(k / TILE * HALO + k % TILE);
    }
    workgroupBarrier();
    let pixel = group.xy * TILE + at.xy;
    var difference = 0.0;
    if all(pixel < plan.size) {
        var by: array<f32, 3>;
        for (var n = 0u; n < 3u; n++) {
            by[n] = blurred_down(n * HALO_ROW_PIXELS + at.y * TILE + at.x);
        }
        let i = pixel.y * plan.size.x + pixel.x;
        var by_color = 0.0;
        if has_target(i) {
            let x = frame[i][channel];
            let y = target_of(i, channel);
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
