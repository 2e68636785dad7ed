// The window of SSIM (src/splat/loss/photometric.rs), and the pixels that it covers: a tile with a border of `RADIUS` pixels. A kernel
// declares what it blurs: the type `Blurred`, `halo_value`, which is one of the halo, and `row_value`, one of the halo's rows that were
// blurred along themselves.

const HALO: u32 = TILE + 2u * RADIUS;
const HALO_PIXELS: u32 = HALO * HALO;
const HALO_ROW_PIXELS: u32 = HALO * TILE;
const TAPS: u32 = 2u * RADIUS + 1u;

/// Blurs along a row of the halo, from the value on that is the first under the window.
fn blurred_along(first: u32) -> Blurred {
    var window = WINDOW;
    var sum = Blurred();
    for (var t = 0u; t < TAPS; t++) {
        sum += window[t] * halo_value(first + t);
    }
    return sum;
}

/// Blurs down a column, from the row value on that is the first under the window.
fn blurred_down(first: u32) -> Blurred {
    var window = WINDOW;
    var sum = Blurred();
    for (var t = 0u; t < TAPS; t++) {
        sum += window[t] * row_value(first + t * TILE);
    }
    return sum;
}
