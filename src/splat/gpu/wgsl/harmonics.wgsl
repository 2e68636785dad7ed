// Real spherical harmonics of degrees 1 to 3 (src/splat/harmonics.rs).

/// The fifteen basis functions above degree 0 for a unit vector.
fn basis(d: vec3<f32>) -> array<f32, 15> {
    let xx = d.x * d.x;
    let yy = d.y * d.y;
    let zz = d.z * d.z;
    let xy = d.x * d.y;
    let four_zz_less = 4.0 * zz - xx - yy;
    return array(
        -SH_C1 * d.y,
        SH_C1 * d.z,
        -SH_C1 * d.x,
        SH_C2_0 * xy,
        SH_C2_1 * d.y * d.z,
        SH_C2_2 * (2.0 * zz - xx - yy),
        SH_C2_3 * d.x * d.z,
        SH_C2_4 * (xx - yy),
        SH_C3_0 * d.y * (3.0 * xx - yy),
        SH_C3_1 * xy * d.z,
        SH_C3_2 * d.y * four_zz_less,
        SH_C3_3 * d.z * (2.0 * zz - 3.0 * (xx + yy)),
        SH_C3_4 * d.x * four_zz_less,
        SH_C3_5 * d.z * (xx - yy),
        SH_C3_6 * d.x * (xx - 3.0 * yy),
    );
}

/// The derivatives by the unit vector of the sum of the basis functions with these weights.
fn harmonics_gradient(d: vec3<f32>, weights: array<f32, 15>) -> vec3<f32> {
    let x = d.x;
    let y = d.y;
    let z = d.z;
    let xx = x * x;
    let yy = y * y;
    let zz = z * z;
    let factors = array(
        -SH_C1, SH_C1, -SH_C1,
        SH_C2_0, SH_C2_1, SH_C2_2, SH_C2_3, SH_C2_4,
        SH_C3_0, SH_C3_1, SH_C3_2, SH_C3_3, SH_C3_4, SH_C3_5, SH_C3_6,
    );
    var w = weights;
    for (var k = 0u; k < 15u; k++) {
        w[k] *= factors[k];
    }
    let by_x = w[2] + y * w[3] + z * w[6] + 2.0 * x * (w[7] - w[5]) + 6.0 * x * (y * w[8] - z * w[11]) + y * z * w[9]
        + (4.0 * zz - 3.0 * xx - yy) * w[12] + 3.0 * (xx - yy) * w[14] + 2.0 * x * (z * w[13] - y * w[10]);
    let by_y = w[0] + x * w[3] + z * w[4] - 2.0 * y * (w[5] + w[7]) + 3.0 * (xx - yy) * w[8] + x * z * w[9]
        + (4.0 * zz - xx - 3.0 * yy) * w[10] - 6.0 * y * (z * w[11] + x * w[14]) - 2.0 * y * (x * w[12] + z * w[13]);
    let by_z = w[1] + y * w[4] + 4.0 * z * w[5] + x * w[6] + x * y * w[9] + 8.0 * z * (y * w[10] + x * w[12])
        + (6.0 * zz - 3.0 * (xx + yy)) * w[11] + (xx - yy) * w[13];
    return vec3(by_x, by_y, by_z);
}
