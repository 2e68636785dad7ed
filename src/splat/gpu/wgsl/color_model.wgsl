// EOGS's colour model (src/splat/appearance/affine.rs): `pixel = (s + (1 - s) k) (W rgb + t)`.

/// The parameters of a view: `W` row by row, `t`, `k`; from `MOMENTS` on their first and from twice that on their second moments.
const PARAMETERS: u32 = 15u;
const MOMENTS: u32 = 16u;

struct ColorModel {
    map: mat3x3<f32>,
    offset: vec3<f32>,
    ambient: vec3<f32>,
}

fn sunlit(model: ColorModel, rgb: vec3<f32>) -> vec3<f32> {
    return model.map * rgb + model.offset;
}

/// The light relative to full sunlight at a share of sunlight.
fn light(model: ColorModel, share: f32) -> vec3<f32> {
    return share + model.ambient - share * model.ambient;
}
