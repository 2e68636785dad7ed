// The picture of a satellite view: each pixel's share of sunlight (src/splat/shadow.rs), its entropy (src/splat/loss/shadow_entropy.rs)
// and the colour model.

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<uniform> shading: Shading;
@group(0) @binding(2) var<storage, read> linear_target: array<vec4<f32>>;
/// The renders of the view and of the sun's image: colour and altitude.
@group(0) @binding(3) var<storage, read> frame: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> sun_frame: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> appearance: array<f32>;
/// The picture, zero where there are no data, and the share of sunlight.
@group(0) @binding(6) var<storage, read_write> picture: array<vec4<f32>>;
/// The sum of entropies of each workgroup, bits.
@group(0) @binding(7) var<storage, read_write> entropy_sums: array<f32>;

alias Summed = f32;

var<workgroup> sums: array<Summed, GROUP>;

fn share_of_sunlight(pixel: vec2<u32>, altitude: f32) -> f32 {
    let place = place_of(pixel, altitude, shading.sun, shading.sun_size);
    if !place.is_inside {
        return 1.0;
    }
    let first = place.corner.y * shading.sun_size.x + place.corner.x;
    let below = first + shading.sun_size.x;
    let higher =
        sampled(place.fraction, sun_frame[first], sun_frame[first + 1u], sun_frame[below], sun_frame[below + 1u]);
    return exp(SHADOW_RATE_PER_M * min(altitude - higher.value.w, 0.0));
}

@compute @workgroup_size(16, 16)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(global_invocation_id) at: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    var entropy = 0.0;
    if all(at.xy < plan.size) {
        let i = at.y * plan.size.x + at.x;
        let of_view = frame[i];
        var share = 1.0;
        if shading.sun_size.x > 0u {
            share = share_of_sunlight(at.xy, of_view.w);
            let clipped = clamp(share, ENTROPY_CLIP, 1.0 - ENTROPY_CLIP);
            entropy = -(share * log2(clipped) + (1.0 - share) * log2(1.0 - clipped));
        }
        let model = view_model();
        picture[i] = vec4(linear_target[i].w * sunlit(model, of_view.rgb) * light(model, share), share);
    }
    let total = sum_of_lanes(lane, entropy);
    if lane == 0u {
        entropy_sums[group.y * plan.tiles.x + group.x] = total;
    }
}
