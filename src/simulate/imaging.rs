//! Taking the images: from a planned view to its files.

use super::appearance;
use super::calendar::season_day;
use super::cars::{Cars, Roads, Traffic};
use super::error::SimulateError;
use super::export;
use super::folder::APPEARANCE;
use super::geodesy;
use super::landscape::{Landscape, colors};
use super::options::SimulateOptions;
use super::radiometry::Radiometry;
use super::rays::ViewRays;
use super::render::{Picture, Shot};
use super::season::Palette;
use super::summary::ViewFigures;
use super::truth;
use super::view::SimulatedView;
use crate::scene::Role;
use std::path::Path;

/// What all images of a scene share.
pub(super) struct Studio<'a> {
    pub(super) options: &'a SimulateOptions,
    pub(super) landscape: &'a Landscape,
}

impl Studio<'_> {
    /// Takes the image of a view. Writes it to `out`, and what is known about it to `truth_folder`.
    pub(super) fn take(
        &self,
        out: &Path,
        truth_folder: &Path,
        view: &SimulatedView,
    ) -> Result<ViewFigures, SimulateError> {
        let (name, size_px) = (&view.plan.name, self.options.size_px);
        let palette = self.palette(view.plan.day_of_year);
        let radiometry = self.radiometry(view);
        let mut picture = self.picture(view, &palette, &radiometry)?;
        let bands = std::mem::take(&mut picture.bands);
        export::write_view(&out.join(format!("{name}.tif")), view, size_px, &bands, self.options.depth)?;
        let rpc = truth_folder.join("rpcs").join(format!("{name}.json"));
        truth::write_rpc(&rpc, view, size_px, self.landscape.field.height_range())?;
        let appearance = if self.options.has_appearance_truth() {
            let folder = truth_folder.join(APPEARANCE);
            Some(appearance::write(&folder, name, size_px, &picture, &palette, &radiometry)?)
        } else {
            None
        };
        Ok(ViewFigures::new(view, appearance))
    }

    fn palette(&self, day_of_year: u32) -> Palette {
        let of_day = if self.options.seasons { Palette::seasonal } else { Palette::mild };
        of_day(season_day(day_of_year, self.landscape.center), colors(self.options.seed))
    }

    fn radiometry(&self, view: &SimulatedView) -> Radiometry {
        let radiometry = Radiometry::new(view.rng.key(1), self.sun(view), self.options.depth);
        match view.role {
            Role::Train => radiometry,
            Role::Test => radiometry.without_noise(),
        }
    }

    /// Unit vector to the sun on the map.
    fn sun(&self, view: &SimulatedView) -> [f64; 3] {
        geodesy::sun_on_map(&self.landscape.grid, self.landscape.center, view.plan.sun)
    }

    fn picture(
        &self,
        view: &SimulatedView,
        palette: &Palette,
        radiometry: &Radiometry,
    ) -> Result<Picture, SimulateError> {
        let Landscape { field, plan, grid, .. } = self.landscape;
        let (low, high) = field.height_range();
        let size_px = self.options.size_px;
        let rays = ViewRays::new(&view.true_rpc, grid, size_px, (low - 1.0, high + 1.0))
            .map_err(|source| SimulateError::Ray { view: view.plan.name.clone(), source })?;
        let mut shot = Shot {
            field,
            rays: &rays,
            cars: None,
            palette,
            radiometry,
            colors: colors(self.options.seed),
            grain: view.rng.key(3),
            size_px,
        };
        let roads = match plan {
            Some(plan) => Some(Roads::Streets(plan)),
            None => self.options.terrain.has_streets().then_some(Roads::Open(field)),
        };
        if let Some(roads) = roads.filter(|_| view.role == Role::Train) {
            let cars = |traffic| Cars::new(roads, view.rng.key(2), radiometry.sun, traffic);
            shot.cars = Some(match self.options.cars_percent {
                None => cars(Traffic::LIGHT),
                Some(percent) => {
                    let jam = cars(Traffic::JAM);
                    let fill = shot.fill_for(&jam, percent);
                    jam.filled(fill)
                }
            });
        }
        Ok(shot.picture())
    }
}
