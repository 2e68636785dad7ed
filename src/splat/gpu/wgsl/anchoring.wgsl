// A splat that is anchored to another (src/splat/anchored.rs).

/// They stand in the order of anchors, and of splats with the same anchor.
struct Anchoring {
    splat: u32,
    anchor: u32,
}
