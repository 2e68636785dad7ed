// One step of Adam (src/nn/adam.rs).

/// Values after the step, and both moments.
struct Stepped {
    value: vec4<f32>,
    first: vec4<f32>,
    second: vec4<f32>,
}

/// The step of parameters with this rule: the square root of the correction of the second moments, and epsilon.
fn adam_by(
    value: vec4<f32>,
    first: vec4<f32>,
    second: vec4<f32>,
    by: vec4<f32>,
    rate: vec4<f32>,
    root_second: f32,
    epsilon: f32,
) -> Stepped {
    let m = BETA1 * first + (1.0 - BETA1) * by;
    let s = BETA2 * second + (1.0 - BETA2) * by * by;
    return Stepped(value - rate * m / (sqrt(s) / root_second + epsilon), m, s);
}

/// The step of the splats' parameters.
fn adam(value: vec4<f32>, first: vec4<f32>, second: vec4<f32>, by: vec4<f32>, rate: vec4<f32>) -> Stepped {
    return adam_by(value, first, second, by, rate, plan.root_second, EPSILON);
}
