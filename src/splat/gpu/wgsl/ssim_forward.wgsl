// SSIM and its derivatives by the blurred x, xx + yy and xy, where x is the picture and y the photograph
// (src/splat/loss/photometric.rs). The third dimension of the dispatch is the colour channel.

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<storage, read> frame: array<vec4<f32>>;
/// Three planes of each channel.
@group(0) @binding(3) var<storage, read_write> by_moments: array<f32>;
/// The sum of SSIM over each workgroup.
@group(0) @binding(4) var<storage, read_write> ssim_sums: array<f32>;

var<workgroup> halo: array<vec2<f32>, HALO_PIXELS>;
var<workgroup> along_rows: array<vec4<f32>, HALO_ROW_PIXELS>;
alias Summed = f32;

var<workgroup> sums: array<Summed, GROUP>;

/// Moments of a pixel: x, y, xx + yy, xy.
alias Blurred = vec4<f32>;

fn halo_value(at: u32) -> Blurred {
    let v = halo[at];
    return vec4(v, dot(v, v), v.x * v.y);
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
    for (var k = lane; k < HALO_PIXELS; k += GROUP) {
        let pixel = corner + vec2<i32>(vec2(k % HALO, k / HALO));
        var value = vec2(0.0);
        if all(pixel >= vec2(0)) && all(pixel < size) {
            let i = u32(pixel.y * size.x + pixel.x);
            if has_target(i) {
                value = vec2(frame[i][channel], target_of(i, channel));
            }
        }
        halo[k] = value;
    }
    workgroupBarrier();
    for (var k = lane; k < HALO_ROW_PIXELS; k += GROUP) {
        along_rows[k] = blurred_along(k / TILE * HALO + k % TILE);
    }
    workgroupBarrier();
    let pixel = group.xy * TILE + at.xy;
    var ssim = 0.0;
    if all(pixel < plan.size) {
        let blurred = blurred_down(at.y * TILE + at.x);
        let ux = blurred.x;
        let uy = blurred.y;
        let means = ux * ux + uy * uy;
        let a1 = 2.0 * ux * uy + SSIM_C1;
        let a2 = 2.0 * (blurred.w - ux * uy) + SSIM_C2;
        let b1 = means + SSIM_C1;
        let b2 = blurred.z - means + SSIM_C2;
        let inverse = 1.0 / (b1 * b2);
        ssim = a1 * a2 * inverse;
        let pixels = plan.size.x * plan.size.y;
        let i = 3u * channel * pixels + pixel.y * plan.size.x + pixel.x;
        by_moments[i] = plan.by_ssim * 2.0 * (uy * (a2 - a1) - ux * ssim * (b2 - b1)) * inverse;
        by_moments[i + pixels] = -plan.by_ssim * ssim * b1 * inverse;
        by_moments[i + 2u * pixels] = plan.by_ssim * 2.0 * a1 * inverse;
    }
    let total = sum_of_lanes(lane, ssim);
    if lane == 0u {
        ssim_sums[(channel * plan.tiles.y + group.y) * plan.tiles.x + group.x] = total;
    }
}
