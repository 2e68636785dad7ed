//! Light and colours of splats apart.

/// Light and colours of splats apart, or derivatives by them: of a model in which the colour of a splat is its colour in
/// full sunlight times `s + (1 - s) a`, with `s` its share of sunlight and `a` the ambient light.
#[derive(Clone, Debug, Default)]
pub struct SplatLight<T> {
    /// Colours in full sunlight.
    pub toned: Vec<[T; 3]>,
    /// Shares of sunlight, 0 to 1.
    pub sunlit: Vec<T>,
    /// Ambient light relative to sunlight.
    pub ambient: [T; 3],
}
