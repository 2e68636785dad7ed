// The window of SSIM (src/splat/loss/photometric.rs) and the pixels that it covers: a tile with a border of `RADIUS` pixels.

const HALO: u32 = TILE + 2u * RADIUS;
const HALO_PIXELS: u32 = HALO * HALO;
const HALO_ROW_PIXELS: u32 = HALO * TILE;

/// The colour of a photograph's pixel on the background, and whether it has data: red, green, blue, opacity in a byte each.
fn target_of(packed: u32, channel: u32) -> f32 {
    let value = f32((packed >> (8u * channel)) & 0xffu) / 255.0;
    let opacity = f32(packed >> 24u) / 255.0;
    return value + (1.0 - opacity) * plan.background[channel];
}
