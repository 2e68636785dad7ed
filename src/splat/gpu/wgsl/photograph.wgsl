// The photograph that a render is compared with: red, green, blue and opacity in a byte each.

@group(0) @binding(2) var<storage, read> photograph: array<u32>;

fn has_target(i: u32) -> bool {
    return photograph[i] != NO_DATA;
}

/// The colour of a pixel on the background.
fn target_of(i: u32, channel: u32) -> f32 {
    let packed = photograph[i];
    let value = f32((packed >> (8u * channel)) & 0xffu) / 255.0;
    let opacity = f32(packed >> 24u) / 255.0;
    return value + (1.0 - opacity) * plan.background[channel];
}
