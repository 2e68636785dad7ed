// The gradient of `shade.wgsl`: from the derivatives by the picture to those by the renders of the view and of the sun's image, and by
// the colour model.

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<uniform> shading: Shading;
@group(0) @binding(2) var<storage, read> frame: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> picture: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> sun_frame: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> appearance: array<f32>;
/// Plane by plane: by the picture before, by colour and altitude of the view's render after.
@group(0) @binding(6) var<storage, read_write> by_pixel: array<f32>;
/// By the altitudes in the sun's image, times the number of the view's pixels: `fixed`.
@group(0) @binding(7) var<storage, read_write> by_sun: array<atomic<i32>>;
/// The sums of the derivatives by the model's parameters over each workgroup, four vectors each.
@group(0) @binding(8) var<storage, read_write> parameter_sums: array<vec4<f32>>;

alias Summed = vec4<f32>;

var<workgroup> sums: array<Summed, GROUP>;

/// The derivative by the altitude of a pixel by way of its share of sunlight; that by the sun's image is scattered.
fn shadow_backward(pixel: vec2<u32>, altitude: f32, share: f32, by_share: f32) -> f32 {
    let place = place_of(pixel, altitude, shading.sun, shading.sun_size);
    if !place.is_inside {
        return 0.0;
    }
    let first = place.corner.y * shading.sun_size.x + place.corner.x;
    let below = first + shading.sun_size.x;
    let higher =
        sampled(place.fraction, sun_frame[first], sun_frame[first + 1u], sun_frame[below], sun_frame[below + 1u]);
    if higher.value.w <= altitude {
        return 0.0;
    }
    let by_difference = SHADOW_RATE_PER_M * share * by_share;
    let scaled = by_difference * f32(plan.size.x * plan.size.y);
    var weights = corner_weights(place.fraction);
    for (var k = 0u; k < 4u; k++) {
        atomicAdd(&by_sun[first + corner_offset(k, shading.sun_size.x)], fixed(-weights[k] * scaled));
    }
    return by_difference * (1.0 - by_altitude_of(shading.sun, higher).w);
}

@compute @workgroup_size(16, 16)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(global_invocation_id) at: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    var by_parameters: array<vec4<f32>, 4>;
    if all(at.xy < plan.size) {
        let pixels = plan.size.x * plan.size.y;
        let i = at.y * plan.size.x + at.x;
        let of_view = frame[i];
        let share = picture[i].w;
        let model = view_model();
        // Zero where there are no data.
        let by = vec3(by_pixel[i], by_pixel[pixels + i], by_pixel[2u * pixels + i]);
        let by_sunlit = by * light(model, share);
        let by_light = by * sunlit(model, of_view.rgb);
        let by_ambient = by_light - by_light * share;
        let by_rgb = by_sunlit * model.map;
        let rgb = of_view.rgb;
        by_parameters = array(
            vec4(by_sunlit.x * rgb, by_sunlit.y * rgb.x),
            vec4(by_sunlit.y * rgb.yz, by_sunlit.z * rgb.xy),
            vec4(by_sunlit.z * rgb.z, by_sunlit),
            vec4(by_ambient, 0.0),
        );
        var by_height = 0.0;
        if shading.sun_size.x > 0u {
            let clipped = clamp(share, ENTROPY_CLIP, 1.0 - ENTROPY_CLIP);
            let by_share =
                dot(by_light, 1.0 - model.ambient) + shading.by_entropy * (log2(1.0 - clipped) - log2(clipped));
            by_height = shadow_backward(at.xy, of_view.w, share, by_share);
        }
        by_pixel[i] = by_rgb.x;
        by_pixel[pixels + i] = by_rgb.y;
        by_pixel[2u * pixels + i] = by_rgb.z;
        by_pixel[3u * pixels + i] = by_height;
    }
    for (var k = 0u; k < 4u; k++) {
        let total = sum_of_lanes(lane, by_parameters[k]);
        if lane == 0u {
            parameter_sums[4u * (group.y * plan.tiles.x + group.x) + k] = total;
        }
    }
}
