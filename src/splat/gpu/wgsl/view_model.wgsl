// The colour model of the view, whose parameters a kernel binds as `appearance`.

fn view_model() -> ColorModel {
    let rows = mat3x3(
        appearance[0], appearance[1], appearance[2],
        appearance[3], appearance[4], appearance[5],
        appearance[6], appearance[7], appearance[8],
    );
    return ColorModel(
        transpose(rows),
        vec3(appearance[9], appearance[10], appearance[11]),
        vec3(appearance[12], appearance[13], appearance[14]),
    );
}
