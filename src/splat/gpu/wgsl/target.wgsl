// The linear image of a view at a resolution level: means over the valid pixels of blocks (src/splat/loss/target.rs).

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<uniform> shading: Shading;
/// Stored colours, red, green and blue in a byte each; zero where masked.
@group(0) @binding(2) var<storage, read> photograph: array<u32>;
/// Linear value of each stored one.
@group(0) @binding(3) var<storage, read> linear: array<f32>;
@group(0) @binding(4) var<storage, read_write> linear_target: array<vec4<f32>>;

@compute @workgroup_size(16, 16)
fn main(@builtin(global_invocation_id) pixel: vec3<u32>) {
    if any(pixel.xy >= plan.size) {
        return;
    }
    let side = 1u << shading.level;
    var sum = vec3(0.0);
    var count = 0.0;
    for (var row = pixel.y * side; row < (pixel.y + 1u) * side; row++) {
        for (var column = pixel.x * side; column < (pixel.x + 1u) * side; column++) {
            let stored = photograph[row * shading.photograph_columns + column];
            if stored != 0u {
                sum += vec3(linear[stored & 0xffu], linear[(stored >> 8u) & 0xffu], linear[stored >> 16u]);
                count += 1.0;
            }
        }
    }
    linear_target[pixel.y * plan.size.x + pixel.x] = vec4(sum / max(count, 1.0), min(count, 1.0));
}
