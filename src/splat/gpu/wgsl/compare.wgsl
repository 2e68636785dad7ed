// Consistency of the view with a virtual one (src/splat/loss/consistency.rs): differences of altitudes and colours where both show the
// same surface, and their derivatives, still to be divided by the number of such pixels.

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<uniform> shading: Shading;
@group(0) @binding(2) var<storage, read> frame: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> virtual_frame: array<vec4<f32>>;
/// By the virtual view, plane by plane, without the weights: `fixed`.
@group(0) @binding(4) var<storage, read_write> by_virtual: array<atomic<i32>>;
/// By the view.
@group(0) @binding(5) var<storage, read_write> by_view: array<vec4<f32>>;
/// Number of pixels, and sums of the differences of altitudes and colours, of each workgroup.
@group(0) @binding(6) var<storage, read_write> difference_sums: array<vec4<f32>>;

alias Summed = vec4<f32>;

var<workgroup> sums: array<Summed, GROUP>;

@compute @workgroup_size(16, 16)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(global_invocation_id) at: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    var sum = vec4(0.0);
    if all(at.xy < plan.size) {
        let i = at.y * plan.size.x + at.x;
        let own = frame[i];
        var by = vec4(0.0);
        let place = place_of(at.xy, own.w, shading.virtual_view, plan.size);
        if place.is_inside {
            let columns = plan.size.x;
            let pixels = columns * plan.size.y;
            let first = place.corner.y * columns + place.corner.x;
            let other = sampled(
                place.fraction,
                virtual_frame[first],
                virtual_frame[first + 1u],
                virtual_frame[first + columns],
                virtual_frame[first + columns + 1u],
            );
            let difference = own - other.value;
            if abs(difference.w) < SAME_SURFACE_M {
                let signs = sign(difference);
                let size = abs(difference);
                sum = vec4(1.0, size.w, size.x + size.y + size.z, 0.0);
                var weights = corner_weights(place.fraction);
                for (var plane = 0u; plane < 4u; plane++) {
                    for (var k = 0u; k < 4u; k++) {
                        let pixel = first + corner_offset(k, columns);
                        atomicAdd(&by_virtual[plane * pixels + pixel], fixed(-signs[plane] * weights[k]));
                    }
                }
                by = signs * vec4(vec3(shading.by_color), shading.by_altitude);
                by.w -= dot(by, by_altitude_of(shading.virtual_view, other));
            }
        }
        by_view[i] = by;
    }
    let total = sum_of_lanes(lane, sum);
    if lane == 0u {
        difference_sums[group.y * plan.tiles.x + group.x] = total;
    }
}
