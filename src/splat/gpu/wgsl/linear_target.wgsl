// The image of a satellite view that a picture is compared with: linear colours, and 1 where there are data.

@group(0) @binding(2) var<storage, read> linear_target: array<vec4<f32>>;

fn has_target(i: u32) -> bool {
    return linear_target[i].w > 0.0;
}

/// The colour of a pixel.
fn target_of(i: u32, channel: u32) -> f32 {
    return linear_target[i][channel];
}
