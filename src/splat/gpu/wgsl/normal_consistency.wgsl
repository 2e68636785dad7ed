// Normals of discs and of the surface of their depths agree (src/splat/loss/normal_consistency.rs): the sum of differences over a tile,
// and the derivatives by depths, normals and transmittance.

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<storage, read> frame: array<vec4<f32>>;
/// Plane by plane.
@group(0) @binding(2) var<storage, read_write> by_pixel: array<f32>;
/// The sum of differences of each workgroup.
@group(0) @binding(3) var<storage, read_write> normal_sums: array<f32>;

/// A tile with the pixels around it, whose differences its points are part of, and with those around these.
const COMPARED: u32 = TILE + 2u;
const SIDE: u32 = TILE + 4u;

/// Depth of the surface in each pixel; zero where the opacity is below one half, and outside of the image.
var<workgroup> depths: array<f32, SIDE * SIDE>;
/// Derivatives by the differences of points, to the right and down, at each pixel.
var<workgroup> by_differences: array<array<vec3<f32>, 2>, COMPARED * COMPARED>;

alias Summed = f32;

var<workgroup> sums: array<Summed, GROUP>;

/// The rows of the rotation from site to camera axes as columns.
fn axes() -> mat3x3<f32> {
    let view = camera();
    return mat3x3(view.right.xyz, view.down.xyz, view.forward.xyz);
}

/// Camera coordinates, per unit of depth, of the points that a pixel shows.
fn ray(pixel: vec2<i32>) -> vec3<f32> {
    let view = camera();
    return vec3((vec2<f32>(pixel) - view.principal) / view.focal, 1.0);
}

fn is_inside(pixel: vec2<i32>) -> bool {
    return all(pixel >= vec2(0)) && all(pixel < vec2<i32>(plan.size));
}

fn index(pixel: vec2<i32>) -> u32 {
    return u32(pixel.y) * plan.size.x + u32(pixel.x);
}

/// Normal and transmittance of a pixel.
fn normal_of(pixel: vec2<i32>) -> vec4<f32> {
    return frame[plan.size.x * plan.size.y + index(pixel)];
}

/// What the depth of a pixel is divided by: mean depths are sums of weighted ones.
fn divisor(opacity: f32) -> f32 {
    return select(opacity + OPACITY_OFFSET, 1.0, plan.is_median != 0u);
}

fn depth_at(pixel: vec2<i32>) -> f32 {
    if !is_inside(pixel) {
        return 0.0;
    }
    let opacity = 1.0 - normal_of(pixel).w;
    if opacity < 0.5 {
        return 0.0;
    }
    return frame[index(pixel)].w / divisor(opacity);
}

/// The point of the surface in a pixel, given its place among `depths`.
fn point_at(place: u32, pixel: vec2<i32>) -> vec3<f32> {
    return depths[place] * ray(pixel);
}

/// What the comparison in a pixel adds to the loss, and its derivatives, without weight.
struct Compared {
    difference: f32,
    by_normal: vec3<f32>,
    by_along: vec3<f32>,
    by_down: vec3<f32>,
}

/// Compares a pixel, given its place among `depths`; zeros where a point is missing.
fn compared(place: u32, pixel: vec2<i32>) -> Compared {
    let right = vec2(1, 0);
    let lower = vec2(0, 1);
    let depths_around = vec4(depths[place - 1u], depths[place + 1u], depths[place - SIDE], depths[place + SIDE]);
    if depths[place] == 0.0 || any(depths_around == vec4(0.0)) {
        return Compared();
    }
    let along = point_at(place + 1u, pixel + right) - point_at(place - 1u, pixel - right);
    let down = point_at(place + SIDE, pixel + lower) - point_at(place - SIDE, pixel - lower);
    let w = cross(down, along);
    let length2 = dot(w, w);
    if !(length2 > 0.0) {
        return Compared();
    }
    let inverse = 1.0 / sqrt(length2);
    let of_depths = w * inverse;
    let own = normal_of(pixel);
    let opacity = 1.0 - own.w;
    let rendered = own.xyz * axes();
    let agreement = dot(rendered, of_depths);
    let by_w = -opacity * inverse * (rendered - agreement * of_depths);
    return Compared(1.0 - opacity * agreement, -opacity * (axes() * of_depths), cross(by_w, down), cross(along, by_w));
}

@compute @workgroup_size(16, 16)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) at: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let corner = vec2<i32>(group.xy * TILE);
    for (var k = lane; k < SIDE * SIDE; k += GROUP) {
        depths[k] = depth_at(corner - 2 + vec2<i32>(vec2(k % SIDE, k / SIDE)));
    }
    workgroupBarrier();
    let pixels = plan.size.x * plan.size.y;
    var difference = 0.0;
    for (var k = lane; k < COMPARED * COMPARED; k += GROUP) {
        let place = vec2(k % COMPARED, k / COMPARED);
        let pixel = corner - 1 + vec2<i32>(place);
        let result = compared((place.y + 1u) * SIDE + place.x + 1u, pixel);
        by_differences[k] = array(result.by_along, result.by_down);
        if all(place >= vec2(1u)) && all(place <= vec2(TILE)) && is_inside(pixel) {
            difference += result.difference;
            for (var axis = 0u; axis < 3u; axis++) {
                by_pixel[(NORMAL + axis) * pixels + index(pixel)] = plan.by_normals * result.by_normal[axis];
            }
        }
    }
    workgroupBarrier();
    let pixel = corner + vec2<i32>(at.xy);
    if is_inside(pixel) {
        // The point is the right one of the pixel to the left, and so on.
        let own = (at.y + 1u) * COMPARED + at.x + 1u;
        let by_point = by_differences[own - 1u][0] - by_differences[own + 1u][0]
            + by_differences[own - COMPARED][1] - by_differences[own + COMPARED][1];
        let by_depth = plan.by_normals * dot(by_point, ray(pixel));
        let depth = depths[(at.y + 2u) * SIDE + at.x + 2u];
        let opacity = 1.0 - normal_of(pixel).w;
        let by_plane = select(by_depth / divisor(opacity), 0.0, depth == 0.0);
        by_pixel[DEPTH * pixels + index(pixel)] = by_plane;
        by_pixel[TRANSMITTANCE * pixels + index(pixel)] = select(by_plane * depth, 0.0, plan.is_median != 0u);
    }
    let total = sum_of_lanes(lane, difference);
    if lane == 0u {
        normal_sums[group.y * plan.tiles.x + group.x] = total;
    }
}
