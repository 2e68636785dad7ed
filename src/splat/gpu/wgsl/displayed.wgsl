// Colours of photographs.

/// Colours as displayed are not negative.
fn shown(color: vec3<f32>) -> vec3<f32> {
    return max(color, vec3(0.0));
}

/// Where `shown` has a slope.
fn is_shown(color: vec3<f32>) -> vec3<bool> {
    return color > vec3(0.0);
}
