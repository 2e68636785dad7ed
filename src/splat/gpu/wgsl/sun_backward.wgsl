// The derivatives by the sun's image, from what the view's pixels have scattered, which becomes zero for the next iteration.

/// Of the sun's image.
@group(0) @binding(0) var<uniform> plan: Plan;
/// Of the view.
@group(0) @binding(1) var<uniform> view: Plan;
@group(0) @binding(2) var<storage, read_write> scattered: array<i32>;
/// Plane by plane; only the last, by the altitudes, is not zero.
@group(0) @binding(3) var<storage, read_write> by_pixel: array<f32>;

@compute @workgroup_size(16, 16)
fn main(@builtin(global_invocation_id) at: vec3<u32>) {
    if any(at.xy >= plan.size) {
        return;
    }
    let i = at.y * plan.size.x + at.x;
    let pixels = plan.size.x * plan.size.y;
    for (var plane = 0u; plane < 3u; plane++) {
        by_pixel[plane * pixels + i] = 0.0;
    }
    by_pixel[3u * pixels + i] = f32(scattered[i]) / FIXED_PARTS / f32(view.size.x * view.size.y);
    scattered[i] = 0;
}
