//! Depth maps of photographs with known poses, by matching.
//!
//! 1. Each view in turn is the reference view, and is matched with source views (`neighbours`): first, at low resolution, with
//!    views at several distances, because nothing is known of the scene's depth yet; then, at low and at full resolution, with
//!    those that see the same surface under the best angles.
//! 2. The planes of the sweep lie across the optical axis, evenly spaced in the inverse of the depth (`planes`; Collins 1996), so
//!    that points move by about half a pixel from one to the next. At low resolution all are tested, from infinity to where no
//!    source view sees anything; at full resolution those near the surface of the low one, block by block (`search`).
//! 3. Costs, semi-global matching and the consistency check between the views are those of satellite images ([`super`]). What too
//!    few source views confirm has no depth.
//!
//! A view has the same number of source views in a scene of any size: time grows with the number of views.

mod neighbours;
mod planes;
mod points;
mod search;

pub use points::{MatchedPoint, matched_points};

use super::consistency::{Check, consistent};
use super::image::MatchImage;
use super::pairs::MatchError;
use super::ray_map::RayMap;
use super::reference_view::ReferenceView;
use crate::checkpoint::PartStore;
use crate::io::Grid2;
use crate::perspective::PinholeCamera;
use crate::progress::{Event, Progress};
use neighbours::{best_sources, first_sources};
use rayon::prelude::*;
use search::{Resolution, Search};

/// Views are matched at about this number of pixels, or a whole fraction of their size that comes near it.
const PIXELS: f64 = 350_000.0;
/// Columns or rows, whichever are more, of the images of the search at low resolution.
const COARSE_PX: usize = 200;
/// How depths are checked at low and at full resolution.
const COARSE_CHECK: Check = Check { confirmations: 1, least_part_px: 6 };
const CHECK: Check = Check { confirmations: 2, least_part_px: 40 };

/// A photograph that is to be matched, at the size at which it is.
#[derive(Clone, Debug)]
pub struct Photograph(MatchImage<PinholeCamera>);

impl Photograph {
    /// A photograph of this camera. Its gray values are as displayed, NaN where it has no data or shows nothing. Large ones are
    /// reduced by a whole factor.
    #[must_use]
    pub fn new(camera: PinholeCamera, gray: Grid2) -> Self {
        let factor = Self::reduction((gray.width, gray.height));
        let image = MatchImage::of_gray(gray, camera);
        Self(if factor == 1 { image } else { image.reduced(factor) })
    }

    /// The whole factor by which a photograph of so many columns and rows is reduced.
    #[must_use]
    pub fn reduction((width, height): (usize, usize)) -> usize {
        ((width * height) as f64 / PIXELS).sqrt().round().max(1.0) as usize
    }

    /// The camera of the photograph as it is matched.
    #[must_use]
    pub fn camera(&self) -> &PinholeCamera {
        &self.0.camera
    }
}

/// The depths of photographs along the optical axis, in their order: in each pixel of the photograph as it is matched, in the unit of
/// the cameras; NaN where views do not agree on one. Maps that are found go to `parts`, and are taken from there.
///
/// # Errors
/// [`MatchError::Interrupted`] when `progress` cancels, [`MatchError::Write`] when a part cannot be stored.
pub fn match_photographs(
    views: Vec<Photograph>,
    parts: Option<&PartStore>,
    progress: &dyn Progress,
) -> Result<Vec<Grid2>, MatchError> {
    progress.event(Event::Started { stage: "matching photographs", total: 3 * views.len() as u64 });
    let fine: Vec<MatchImage<PinholeCamera>> = views.into_iter().map(|view| view.0).collect();
    let coarse: Vec<MatchImage<PinholeCamera>> =
        fine.par_iter().map(|image| image.reduced(coarse_factor(image))).collect();
    let cameras: Vec<PinholeCamera> = fine.iter().map(|image| image.camera).collect();

    let mut steps = Steps { done: 0, parts, progress };
    let first = first_sources(&cameras);
    let found = steps.search("first", &coarse, &first, None)?;
    if let Some(parts) = parts {
        parts.tell(progress);
    }
    let seen = found.confirmed(&coarse, COARSE_CHECK);
    let best = best_sources(&coarse, &found.in_order(&seen));
    let found = steps.search("low", &coarse, &best, None)?;
    let seen = found.confirmed(&coarse, COARSE_CHECK);
    let found = steps.search("full", &fine, &best, Some(&found.in_order(&seen)))?;
    let seen = found.confirmed(&fine, CHECK);
    let depths = fine.iter().zip(found.in_order(&seen)).map(|(view, map)| match map {
        Some(RayMap { value: Grid2 { width, height, data }, .. }) => {
            Grid2 { width: *width, height: *height, data: data.iter().map(|value| value.recip()).collect() }
        }
        None => Grid2::filled(view.gray.width, view.gray.height, f32::NAN),
    });
    let depths = depths.collect();
    progress.event(Event::Finished);
    Ok(depths)
}

/// By how much an image is reduced for the search at low resolution.
fn coarse_factor(image: &MatchImage<PinholeCamera>) -> usize {
    image.gray.width.max(image.gray.height).div_ceil(COARSE_PX)
}

/// The maps of some views.
struct Found {
    references: Vec<ReferenceView>,
    maps: Vec<RayMap>,
    /// For each view the place of its map.
    places: Vec<Option<usize>>,
}

impl Found {
    /// The maps without what the source views do not confirm.
    fn confirmed(&self, images: &[MatchImage<PinholeCamera>], check: Check) -> Vec<RayMap> {
        consistent(images, &self.maps, &self.references, check)
    }

    /// Those of maps in the order of the references, in the order of the views.
    fn in_order<'a>(&self, maps: &'a [RayMap]) -> Vec<Option<&'a RayMap>> {
        self.places.iter().map(|place| maps.get((*place)?)).collect()
    }
}

/// What is done of the matching.
struct Steps<'a> {
    done: u64,
    parts: Option<&'a PartStore>,
    progress: &'a dyn Progress,
}

impl Steps<'_> {
    /// Matches all views with their source views, in a step of this name, near the surface of a search at low resolution if there is one.
    fn search(
        &mut self,
        step: &str,
        images: &[MatchImage<PinholeCamera>],
        sources: &[Vec<usize>],
        near: Option<&[Option<&RayMap>]>,
    ) -> Result<Found, MatchError> {
        let mut found = Found { references: Vec::new(), maps: Vec::new(), places: vec![None; images.len()] };
        for (view, sources) in sources.iter().enumerate() {
            self.progress.check()?;
            let search = Search::new(images, view, sources);
            let map = |search: &Search| match near {
                None => Some(search.everywhere()),
                Some(maps) => Some(search.near(maps[view]?, coarse_factor(&images[view]))),
            };
            let resolution = if near.is_none() { Resolution::Low } else { Resolution::Full };
            let map = search.map(|search| {
                let name = format!("{step}_{view:03}");
                let map = PartStore::part(self.parts, &name, "", || Ok::<_, MatchError>(map(&search)))?;
                Ok::<_, MatchError>(map.map(|map| (search.reference(resolution), map)))
            });
            if let Some((reference, map)) = map.transpose()?.flatten() {
                found.places[view] = Some(found.maps.len());
                found.references.push(reference);
                found.maps.push(map);
            }
            self.done += 1;
            self.progress.event(Event::Advanced { done: self.done, status: String::new() });
        }
        Ok(found)
    }
}

#[cfg(test)]
mod tests;
