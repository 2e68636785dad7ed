// The gradient of alpha compositing, front to back, without atomic sums (src/splat/raster/backward.rs).
//
// A workgroup has a lane for each pixel of its tile. For four splats at a time, each lane writes its weight and its derivative; then a lane
// for each splat and row of pixels sums a row, and a lane for each splat and number sums the rows into the slot of the pair.

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<storage, read> ranges: array<TileRange>;
@group(0) @binding(2) var<storage, read> slots: array<u32>;
@group(0) @binding(3) var<storage, read> splats: array<u32>;
@group(0) @binding(4) var<storage, read> projected: array<Projected>;
@group(0) @binding(5) var<storage, read> frame: array<vec4<f32>>;
/// Derivatives of the loss by the features, plane by plane.
@group(0) @binding(6) var<storage, read> by_pixel: array<f32>;
/// `SLOT` numbers of each pair: moments 1, x, xx, y, xy, yy of alpha times the derivative by alpha about the splat's centre, then the
/// derivatives by the features.
@group(0) @binding(7) var<storage, read_write> sums: array<f32>;

/// Number of splats whose sums are computed together.
const TOGETHER: u32 = 4u;
/// Sums over a row of pixels: moments 1, x, xx, and the derivatives by the features.
const ROW_SUMS: u32 = 3u + FEATURES;

var<workgroup> batch: array<Staged, STAGED>;
var<workgroup> range: TileRange;
/// Of each splat and pixel: weight, and alpha times the derivative by alpha.
var<workgroup> steps: array<vec2<f32>, TOGETHER * GROUP>;
var<workgroup> by_features: array<f32, FEATURES * GROUP>;
var<workgroup> row_sums: array<f32, TOGETHER * TILE * ROW_SUMS>;

/// Sums of a splat over a row of pixels.
fn sum_row(k: u32, splat: u32, row: u32, first_column: f32) {
    var sum = vec3(0.0);
    var features = Features();
    let middle = batch[splat].mean.x - first_column;
    // Each row begins at another column, so that lanes do not wait for one bank of memory.
    for (var turn = 0u; turn < TILE; turn++) {
        let column = (turn + row) % TILE;
        let pixel = row * TILE + column;
        let own = steps[k * GROUP + pixel];
        let x = f32(column) - middle;
        sum += own.y * vec3(1.0, x, x * x);
        for (var f = 0u; f < FEATURES; f++) {
            features[f] += own.x * by_features[f * GROUP + pixel];
        }
    }
    let at = (k * TILE + row) * ROW_SUMS;
    row_sums[at] = sum.x;
    row_sums[at + 1u] = sum.y;
    row_sums[at + 2u] = sum.z;
    for (var f = 0u; f < FEATURES; f++) {
        row_sums[at + 3u + f] = features[f];
    }
}

/// One of the numbers of a slot, from the sums over rows.
fn sum_rows(k: u32, splat: u32, number: u32, first_row: f32) -> f32 {
    // Which sum over a row, and which power of y: the features follow the six moments.
    var sources = array<u32, 6>(0u, 1u, 2u, 0u, 1u, 0u);
    var powers = array<u32, 6>(0u, 0u, 0u, 1u, 1u, 2u);
    var source = number - 3u;
    var power = 0u;
    if number < 6u {
        source = sources[number];
        power = powers[number];
    }
    let middle = batch[splat].mean.y - first_row;
    var sum = 0.0;
    for (var row = 0u; row < TILE; row++) {
        let y = f32(row) - middle;
        let factor = select(select(1.0, y, power == 1u), y * y, power == 2u);
        sum += factor * row_sums[(k * TILE + row) * ROW_SUMS + source];
    }
    return sum;
}

@compute @workgroup_size(16, 16)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) at: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    if lane == 0u {
        range = ranges[group.y * plan.tiles.x + group.x];
    }
    let list = workgroupUniformLoad(&range);
    let corner = group.xy * TILE;
    let pixel = corner + at.xy;
    let is_inside = all(pixel < plan.size);
    let place = vec2<f32>(pixel);
    var transmittance = 0.0;
    var by = Features();
    // What the splats behind and the background contribute to the product of features and derivatives.
    var remaining = 0.0;
    if is_inside {
        let i = pixel.y * plan.size.x + pixel.x;
        let pixels = plan.size.x * plan.size.y;
        for (var f = 0u; f < FEATURES; f++) {
            by[f] = by_pixel[f * pixels + i];
        }
        remaining = dot(by, features_at(frame[i]));
        transmittance = 1.0;
    }
    for (var f = 0u; f < FEATURES; f++) {
        by_features[f * GROUP + lane] = by[f];
    }
    let end = list.start + list.useful;
    for (var start = list.start; start < end; start += STAGED) {
        let count = min(STAGED, end - start);
        workgroupBarrier();
        if lane < count {
            let slot = slots[start + lane];
            let splat = splats[slot];
            batch[lane] = staged(projected[splat], splat, slot);
        }
        workgroupBarrier();
        for (var first = 0u; first < count; first += TOGETHER) {
            let together = min(TOGETHER, count - first);
            for (var k = 0u; k < together; k++) {
                var own = vec2(0.0);
                if transmittance >= MIN_TRANSMITTANCE {
                    let unclamped = alpha_at(batch[first + k], place);
                    let alpha = min(unclamped, ALPHA_MAX);
                    let weight = transmittance * alpha;
                    let contribution = weight * dot(batch[first + k].features, by);
                    transmittance *= 1.0 - alpha;
                    remaining -= contribution;
                    // Where alpha is clamped it does not depend on the splat.
                    let by_alpha = contribution - remaining * alpha / (1.0 - alpha);
                    own = vec2(weight, select(0.0, by_alpha, unclamped <= ALPHA_MAX));
                }
                steps[k * GROUP + lane] = own;
            }
            workgroupBarrier();
            if lane < together * TILE {
                sum_row(lane / TILE, first + lane / TILE, lane % TILE, f32(corner.x));
            }
            workgroupBarrier();
            if lane < together * SLOT {
                let k = lane / SLOT;
                let number = lane % SLOT;
                sums[batch[first + k].slot * SLOT + number] = sum_rows(k, first + k, number, f32(corner.y));
            }
        }
    }
    for (var entry = end + lane; entry < list.end; entry += GROUP) {
        for (var number = 0u; number < SLOT; number++) {
            sums[slots[entry] * SLOT + number] = 0.0;
        }
    }
}
