// The surface prior (src/splat/loss/surface_prior.rs): the sum of the splats' robust distances from a surface, and the derivatives by
// their altitudes.

@group(0) @binding(0) var<uniform> plan: Plan;
@group(0) @binding(1) var<uniform> shading: Shading;
@group(0) @binding(2) var<storage, read> core: array<Core>;
/// Altitude and weight of each cell, row by row.
@group(0) @binding(3) var<storage, read> cells: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read> status: array<u32>;
@group(0) @binding(5) var<storage, read_write> gradient: array<Core>;
/// The sum of each workgroup.
@group(0) @binding(6) var<storage, read_write> distance_sums: array<f32>;

alias Summed = f32;

var<workgroup> sums: array<Summed, GROUP>;

/// The robust distance of a splat, and its derivative by the altitude.
fn robust_distance(position: vec3<f32>) -> vec2<f32> {
    let offset = position.xy - shading.prior_corner;
    let place = vec2(offset.x, -offset.y) / shading.prior_cell;
    if !(all(place >= vec2(0.0)) && all(place < vec2<f32>(shading.prior_size))) {
        return vec2(0.0);
    }
    let cell = cells[u32(place.y) * shading.prior_size.x + u32(place.x)];
    let r = (position.z - cell.x) / PRIOR_SCALE_M;
    if !(cell.y > 0.0) || !is_finite(r) {
        return vec2(0.0);
    }
    let robust = r * r + 1.0;
    return cell.y * vec2(r * r / robust, 2.0 * r / (PRIOR_SCALE_M * robust * robust));
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let block = group_index(group, groups);
    let i = block * GROUP + lane;
    var distance = 0.0;
    if i < plan.splats {
        // Anchored splats count as zero: those of walls do not lie on the surface.
        if core[i].anchored == 0.0 {
            let robust = robust_distance(core[i].position);
            distance = robust.x;
            if status[0] == 0u {
                gradient[i].position.z += shading.by_distance * robust.y;
            }
        }
    }
    let sum = sum_of_lanes(lane, distance);
    if lane == 0u && block * GROUP < plan.splats {
        distance_sums[block] = sum;
    }
}
