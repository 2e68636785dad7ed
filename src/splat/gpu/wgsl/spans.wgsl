// The tiles that the ellipse of a splat touches, row of tiles by row (src/splat/raster/footprint.rs).

/// Outermost column of the ellipse on the left (`side` = -1) or right (`side` = 1) within rows of pixels; all relative to the centre.
fn edge_column(splat: Projected, side: f32, top: f32, bottom: f32) -> f32 {
    let extreme_dy = side * splat.rightmost_dy;
    if extreme_dy >= top && extreme_dy <= bottom {
        return side * splat.half_width;
    }
    let dy = clamp(extreme_dy, top, bottom);
    let k = splat.conic;
    let discriminant = k.y * k.y * dy * dy - k.x * (k.z * dy * dy - splat.radius2);
    return (side * sqrt(max(discriminant, 0.0)) - k.y * dy) / k.x;
}

/// First and last column of tiles that the ellipse touches in a row of tiles; none if the first is greater.
fn columns_of(splat: Projected, row: u32) -> vec2<u32> {
    let top = f32(row * TILE) - splat.mean.y;
    let bottom = top + f32(TILE - 1u);
    let left = ceil(max(splat.mean.x + edge_column(splat, -1.0, top, bottom), 0.0));
    let right = floor(min(splat.mean.x + edge_column(splat, 1.0, top, bottom), f32(plan.size.x - 1u)));
    if left > right {
        return vec2(1u, 0u);
    }
    return vec2(u32(left) / TILE, u32(right) / TILE);
}

/// First and last row of tiles that hold a row of pixels of the ellipse; none if the first is greater.
fn rows_of(splat: Projected) -> vec2<u32> {
    let low = splat.mean - vec2(splat.half_width, splat.half_height);
    let high = splat.mean + vec2(splat.half_width, splat.half_height);
    let size = vec2<f32>(plan.size);
    let first = ceil(clamp(low, vec2(0.0), size));
    let last = floor(clamp(high, vec2(0.0), size - 1.0));
    if any(high < vec2(0.0)) || any(first > last) {
        return vec2(1u, 0u);
    }
    return vec2(u32(first.y) / TILE, u32(last.y) / TILE);
}

/// Number of tiles that the ellipse touches.
fn tiles_touched(splat: Projected) -> u32 {
    let rows = rows_of(splat);
    var count = 0u;
    for (var row = rows.x; row <= rows.y; row++) {
        let columns = columns_of(splat, row);
        count += columns.y + 1u - columns.x;
    }
    return count;
}
