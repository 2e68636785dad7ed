// The gradient of alpha compositing, front to back, without atomic sums (src/splat/raster/backward.rs).
//
// A workgroup has a lane for each pixel of its tile. For a few splats at a time, each lane writes its weight and its derivative; then a lane
// for each splat and row of pixels sums a row, and a lane for each splat and number sums the rows into the slot of the pair.

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<storage, read> ranges: array<TileRange>;
@group(0) @binding(2) var<storage, read> slots: array<u32>;
@group(0) @binding(3) var<storage, read> splats: array<u32>;
@group(0) @binding(4) var<storage, read> projected: array<Projected>;
@group(0) @binding(5) var<storage, read> frame: array<vec4<f32>>;
/// Derivatives of the loss by the planes.
@group(0) @binding(6) var<storage, read> by_pixel: array<f32>;
/// `SLOT` numbers of each pair: moments 1, x, xx, y, xy, yy of alpha times the derivative by alpha about the splat's centre, then the
/// derivatives by the features, and of discs those from which the derivative by the slope follows.
@group(0) @binding(7) var<storage, read_write> sums: array<f32>;

var<workgroup> batch: array<Staged, STAGED>;
var<workgroup> range: TileRange;
/// Of each splat and pixel: weight, and alpha times the derivative by alpha.
var<workgroup> steps: array<vec2<f32>, TOGETHER * GROUP>;
var<workgroup> by_features: array<f32, FEATURES * GROUP>;
var<workgroup> row_sums: array<f32, TOGETHER * TILE * ROW_SUMS>;

/// Sums of a splat over a row of pixels.
fn sum_row(k: u32, splat: u32, row: u32, corner: vec2<f32>) {
    var sum = vec3(0.0);
    var features: array<f32, FEATURES>;
    var by_log_alpha = 0.0;
    var by_depth = 0.0;
    var by_plane = vec2(0.0);
    let middle = batch[splat].mean - corner;
    // Each row begins at another column, so that lanes do not wait for one bank of memory.
    for (var turn = 0u; turn < TILE; turn++) {
        let column = (turn + row) % TILE;
        let pixel = row * TILE + column;
        let own = steps[k * GROUP + pixel];
        let d = vec2(f32(column), f32(row)) - middle;
        let part = part_of(splat, own, d, pixel);
        sum += part.by_exponent * vec3(1.0, d.x, d.x * d.x);
        for (var f = 0u; f < FEATURES; f++) {
            features[f] += part.weight * by_features[f * GROUP + pixel];
        }
        if IS_FLAT {
            by_log_alpha += own.y;
            by_depth += part.by_depth;
            by_plane += part.by_plane * vec2(1.0, d.x);
        }
    }
    let at = (k * TILE + row) * ROW_SUMS;
    row_sums[at] = sum.x;
    row_sums[at + 1u] = sum.y;
    row_sums[at + 2u] = sum.z;
    for (var f = 0u; f < FEATURES; f++) {
        row_sums[at + 3u + f] = features[f];
    }
    if IS_FLAT {
        row_sums[at + 3u + DEPTH] = by_depth;
        row_sums[at + 3u + FEATURES] = by_log_alpha;
        row_sums[at + 4u + FEATURES] = by_plane.x;
        row_sums[at + 5u + FEATURES] = by_plane.y;
    }
}

/// One of the numbers of a slot, from the sums over rows.
fn sum_rows(k: u32, splat: u32, number: u32, first_row: f32) -> f32 {
    // Which sum over a row, and which power of y: the features follow the six moments. The last number of a disc is the moment y of the
    // derivative by its plane.
    var sources = array<u32, 6>(0u, 1u, 2u, 0u, 1u, 0u);
    var powers = array<u32, 6>(0u, 0u, 0u, 1u, 1u, 2u);
    var source = number - 3u;
    var power = 0u;
    if number < 6u {
        source = sources[number];
        power = powers[number];
    } else if number == 9u + FEATURES {
        source = 4u + FEATURES;
        power = 1u;
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
    var by_planes: array<f32, PLANES>;
    var by = Features();
    // What the splats behind and the background contribute to the product of features and derivatives.
    var remaining = 0.0;
    if is_inside {
        let i = pixel.y * plan.size.x + pixel.x;
        let pixels = plan.size.x * plan.size.y;
        for (var plane = 0u; plane < planes_used(); plane++) {
            by_planes[plane] = by_pixel[plane * pixels + i];
        }
        by = by_features_of(by_planes);
        var whole: array<vec4<f32>, PIXEL>;
        for (var part = 0u; part < PIXEL; part++) {
            whole[part] = frame[part * pixels + i];
        }
        remaining = product(by, features_at(whole));
        transmittance = 1.0;
    }
    for (var f = 0u; f < FEATURES; f++) {
        by_features[f * GROUP + lane] = by_planes[f];
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
                    let sample = sample_at(batch[first + k], place);
                    let alpha = min(sample.alpha, ALPHA_MAX);
                    let weight = transmittance * alpha;
                    let contribution = weight * product(sample.features, by);
                    let before = transmittance;
                    transmittance *= 1.0 - alpha;
                    remaining -= contribution;
                    // Where alpha is clamped it does not depend on the splat.
                    let by_alpha = contribution - remaining * alpha / (1.0 - alpha);
                    let by_log_alpha = select(0.0, by_alpha, sample.alpha <= ALPHA_MAX);
                    own = step_of(weight, by_log_alpha, before, transmittance);
                }
                steps[k * GROUP + lane] = own;
            }
            workgroupBarrier();
            if lane < together * TILE {
                sum_row(lane / TILE, first + lane / TILE, lane % TILE, vec2<f32>(corner));
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
