// One step of Adam (src/nn/adam.rs).

/// Values after the step, and both moments.
struct Stepped {
    value: vec4<f32>,
    first: vec4<f32>,
    second: vec4<f32>,
}

fn adam(value: vec4<f32>, first: vec4<f32>, second: vec4<f32>, by: vec4<f32>, rate: vec4<f32>) -> Stepped {
    let m = BETA1 * first + (1.0 - BETA1) * by;
    let s = BETA2 * second + (1.0 - BETA2) * by * by;
    return Stepped(value - rate * m / (sqrt(s) / plan.root_second + EPSILON), m, s);
}
