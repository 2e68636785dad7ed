// The derivatives of `compare.wgsl` by both renders, divided by the number of compared pixels. What was scattered becomes zero for the
// next iteration.

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<uniform> shading: Shading;
@group(0) @binding(2) var<storage, read> compared: vec4<f32>;
@group(0) @binding(3) var<storage, read> by_view: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> scattered: array<i32>;
/// Plane by plane.
@group(0) @binding(5) var<storage, read_write> by_pixel: array<f32>;
@group(0) @binding(6) var<storage, read_write> by_virtual_pixel: array<f32>;

@compute @workgroup_size(16, 16)
fn main(@builtin(global_invocation_id) at: vec3<u32>) {
    if any(at.xy >= plan.size) {
        return;
    }
    let i = at.y * plan.size.x + at.x;
    let pixels = plan.size.x * plan.size.y;
    let share = 1.0 / max(compared.x, 1.0);
    let weights = vec4(vec3(shading.by_color), shading.by_altitude) * share;
    let own = by_view[i] * share;
    for (var plane = 0u; plane < 4u; plane++) {
        let k = plane * pixels + i;
        by_pixel[k] += own[plane];
        by_virtual_pixel[k] = weights[plane] * f32(scattered[k]) / FIXED_PARTS;
        scattered[k] = 0;
    }
}
