// What projection and its gradient need of an ellipsoid beside its ellipse: nothing (compare `disc.wgsl`).

fn outlined(i: u32, splat: Core, image: Projected, covariance: vec3<f32>) -> Projected {
    return image;
}

fn plane_gradient(
    i: u32,
    image: Projected,
    position: vec3<f32>,
    normal: vec3<f32>,
    covariance: vec3<f32>,
    sums: array<f32, SLOT>,
) -> PlaneGradient {
    return PlaneGradient(image.conic, sums[0], vec2(0.0), vec3(0.0), vec3(0.0), vec3(0.0));
}
