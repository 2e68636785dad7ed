//! Splats of points without a network: the surface that tells what hides what, and what predictions are compared with.

use super::head::Base;
use super::input::SeenCloud;
use super::network::{FeatureBlocks, OUTPUTS};
use super::queries::queries;
use super::{Cloud, SplatSampling, tiles};
use crate::frame::SiteBox;
use crate::splat::splats::{Splats, logit, rotation_to};

/// Opacity of splats of points.
const OPACITY: f32 = 0.9;
/// Opacity of the surface.
const OPAQUE: f32 = 0.99;
/// Part of the spacing that is the standard deviation across the surface.
const ACROSS: f32 = 0.3;

/// Grey opaque splats that lie flat on the surface of a cloud in a level area (west, south, east, north; metres), those of walls
/// without points included if asked.
#[must_use]
pub fn surface(cloud: &Cloud, sampling: &SplatSampling, area: SiteBox, has_walls: bool) -> Splats {
    let queries = queries(cloud, sampling, area, has_walls);
    let bases: Vec<Base> = queries.iter().map(|query| Base::new(query, [0.5; 3])).collect();
    let head = tiles::head(sampling, cloud.spacing_m(), 0.0);
    let mut out = head.splats(&FeatureBlocks::zeros(OUTPUTS, bases.len()), &bases);
    out.opacity_logit.fill([logit(OPAQUE)]);
    out
}

/// An isotropic splat for each point, as large as the distance to its nearest three points (3DGS), in the median colour of the
/// images.
#[must_use]
pub fn isotropic(seen: &SeenCloud) -> Splats {
    let mut out = Splats::default();
    let points = seen.cloud.positions().iter().zip(seen.cloud.spacings()).zip(seen.colors());
    for ((p, spacing), color) in points {
        out.push(p.map(|v| v as f32), spacing.max(1e-3) as f32, OPACITY, *color);
    }
    out
}

/// As [`isotropic`], flattened along the normals of the planes around the points.
#[must_use]
pub fn flattened(seen: &SeenCloud) -> Splats {
    let mut out = isotropic(seen);
    for ((scale, rotation), plane) in out.log_scale.iter_mut().zip(&mut out.rotation).zip(seen.cloud.planes())
    {
        scale[2] += ACROSS.ln();
        *rotation = rotation_to(plane.normal).map(|v| v as f32);
    }
    out
}
