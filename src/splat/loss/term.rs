//! The interface of a loss term.

use super::prior_targets::PriorTargets;
use crate::perspective::PinholeCamera;
use crate::simd::Real;
use crate::splat::anchored::Anchoring;
use crate::splat::appearance::SplatLight;
use crate::splat::raster::{Image, Scaled};
use crate::splat::shear_warp::ShearWarp;
use crate::splat::splats::Splats;
use serde::{Deserialize, Serialize};

/// The trainings in which a term has a value: in others its weights must be zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TermScope {
    /// All; terms about the sun and virtual views are zero in perspective scenes.
    Any,
    /// Perspective scenes.
    Photographs,
    /// Discs in perspective scenes.
    PhotographedDiscs,
}

/// Names of a term's weights and columns, and its scope.
#[derive(Clone, Copy, Debug)]
pub struct TermInfo {
    /// Names of its weights in a recipe.
    pub weights: &'static [&'static str],
    /// Names of its columns in `train.csv`, whose values are unweighted; with the unit where there is one.
    pub columns: &'static [&'static str],
    /// Where it has a value.
    pub scope: TermScope,
}

/// Which depth of a pixel is that of the surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SurfaceDepth {
    /// The alpha-composited mean (2DGS, for scenes without bounds).
    #[default]
    Mean,
    /// The depth at which the transmittance falls to one half (2DGS, for bounded scenes).
    Median,
}

/// A perspective view of discs.
#[derive(Clone, Copy, Debug)]
pub struct DiscView<'a> {
    /// The camera.
    pub camera: &'a PinholeCamera,
    /// Which depth is the surface's.
    pub surface: SurfaceDepth,
}

/// What an iteration has rendered, as the input of the loss terms.
pub struct Rendered<'a, T> {
    /// The view's render: linear colour, altitude and transmittance ([`channel`](crate::splat::raster::channel)).
    pub view: &'a Image<T>,
    /// Of a perspective view of discs, which has all planes ([`disc_plane`](crate::splat::raster::disc_plane)): its camera, and
    /// which depth is the surface's. None for other splats and for satellite views.
    pub discs: Option<DiscView<'a>>,
    /// Depths and normals that are expected of the view, of its size; none without priors, as of satellite views.
    pub priors: Option<&'a PriorTargets>,
    /// The splats that are anchored to others.
    pub anchored: &'a [Anchoring],
    /// The picture: the view's render after shadows and colour model, linear colours, three channels; zero where masked.
    pub picture: &'a Image<T>,
    /// Share of sunlight, 0 to 1, one channel; none without shadows.
    pub sunlight: Option<&'a Image<T>>,
    /// Light and colours of the splats apart, and the visibility of the sun from each splat as the splats above it leave it, 0
    /// to 1. None if the colour model does not separate them, or without a sun.
    pub light: Option<(&'a SplatLight<T>, &'a [T])>,
    /// Visibility of each pixel, 0 to 1, one channel; none if all are visible.
    pub visibility: Option<&'a Image<T>>,
    /// Place of the crop that the perceptual term compares: 0 to 1 from the left and from the top of where it may lie; none
    /// without the term.
    pub crop: Option<[f64; 2]>,
    /// The virtual view: a render with the view's camera and a random shear, and the map from the view's pixels to it. None
    /// in iterations without one.
    pub virtual_view: Option<(&'a Image<T>, &'a ShearWarp<T>)>,
    /// The view's image: linear colours in [0, 1], three channels; zero where masked.
    pub target: &'a Image<T>,
    /// The splats.
    pub splats: &'a Splats<T>,
    /// Mean opacity of the splats.
    pub mean_opacity: f64,
}

#[cfg(test)]
impl<'a, T> Rendered<'a, T> {
    /// Splats alone, with the same empty image for everything that is rendered.
    pub fn of_splats(splats: &'a Splats<T>, image: &'a Image<T>) -> Self {
        Self {
            view: image,
            discs: None,
            priors: None,
            anchored: &[],
            picture: image,
            sunlight: None,
            light: None,
            visibility: None,
            crop: None,
            virtual_view: None,
            target: image,
            splats,
            mean_opacity: 0.0,
        }
    }
}

/// Derivatives by some channels of a render.
#[derive(Clone, Copy, Debug)]
pub struct ByView<'a, T> {
    /// The derivatives.
    pub scaled: Scaled<'a, T>,
    /// Which channel of the render each channel of the derivatives belongs to.
    pub channels: &'a [usize],
}

/// A term of the loss.
///
/// [`LossTerm::evaluate`] computes the value and all derivatives; the other methods then return those that the term has, with
/// the weights applied.
pub trait LossTerm<T: Real>: Send + Sync {
    /// Computes value and derivatives; writes the unweighted `columns` and returns the weighted value. `weights` and `columns`
    /// are in the order of the term's [`TermInfo`].
    fn evaluate(&mut self, rendered: &Rendered<T>, weights: &[f64], columns: &mut [f64]) -> f64;

    /// Derivatives with respect to the picture.
    fn by_picture(&self) -> Option<Scaled<'_, T>> {
        None
    }

    /// Derivatives with respect to the share of sunlight.
    fn by_sunlight(&self) -> Option<Scaled<'_, T>> {
        None
    }

    /// Derivatives with respect to channels of the view's render.
    fn by_view(&self) -> Option<ByView<'_, T>> {
        None
    }

    /// Derivatives with respect to the virtual view's rendered colours and altitudes, four channels.
    fn by_virtual_view(&self) -> Option<&Image<T>> {
        None
    }

    /// Derivatives with respect to light and colours of the splats.
    fn by_light(&self) -> Option<&SplatLight<T>> {
        None
    }

    /// Derivative with respect to the opacity of each splat, shown or not.
    fn by_opacity(&self) -> T {
        T::zero()
    }

    /// Adds derivatives with respect to the splats' parameters.
    fn add_by_splats(&self, _splats: &Splats<T>, _by: &mut Splats<T>) {}
}
