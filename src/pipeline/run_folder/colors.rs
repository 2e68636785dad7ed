//! The trained colours of a run: its splats with the colour model that they belong to.

use super::super::PipelineError;
use crate::affine::SiteScene;
use crate::io::Grid2;
use crate::run_files::{APPEARANCE, SPLATS};
use crate::scene::days_of;
use crate::splat::appearance::satgs::{AppearanceError, SatGs, TrainedAppearance};
use crate::splat::appearance::{Appearance, AppearanceModel, ColorInput, ModelParameters};
use crate::splat::ply;
use crate::splat::satellite::{NovelView, Picture};
use crate::splat::splats::Splats;
use crate::splat::visibility::PatchVisibility;
use crate::stats::quantile;
use std::path::Path;

/// Splats and the colour model that they belong to.
pub struct SceneColors {
    /// The splats, with the colours that the model takes.
    pub splats: Splats,
    /// The colour model.
    pub appearance: TrainedAppearance,
}

impl SceneColors {
    /// Reads the trained colours of a run; none if the run was trained by a recipe without them.
    ///
    /// # Errors
    /// [`PipelineError`]: a file is damaged, or the two belong to different trainings.
    pub fn read(run: &Path) -> Result<Option<Self>, PipelineError> {
        let (path, of_splats) = (run.join(APPEARANCE), run.join(SPLATS));
        if !path.exists() {
            return Ok(None);
        }
        let appearance = TrainedAppearance::read(&path)?;
        let mut splats = ply::read(&of_splats)?;
        if appearance.content.splats != hash_of_splats(&of_splats)? || appearance.colors.len() != splats.len()
        {
            return Err(AppearanceError::OtherSplats { path, splats: of_splats }.into());
        }
        splats.f_dc.clone_from(&appearance.colors);
        Ok(Some(Self { splats, appearance }))
    }

    /// The model, with its buffers.
    pub fn model(&self) -> Box<dyn AppearanceModel<f32>> {
        let content = &self.appearance.content;
        Box::new(SatGs::new(content.networks.clone(), content.cube))
    }

    /// The parameters with this embedding.
    pub fn parameters<'a>(&'a self, embedding: &'a [f32]) -> ModelParameters<'a, f32> {
        ModelParameters { shared: &self.appearance.shared, view: embedding }
    }

    /// The embedding of the reference view.
    pub fn reference(&self) -> &[f32] {
        &self.appearance.embeddings[self.appearance.content.reference]
    }

    /// Median time of day of the training views, hours UTC; none if no view has one.
    pub fn usual_hour(&self) -> Option<f64> {
        let times = self.appearance.content.views.iter().filter_map(|v| v.acquired.as_deref());
        // Days count from noon.
        let hours =
            times.filter(|t| t.contains('T')).filter_map(|t| Some((days_of(t)? + 0.5).rem_euclid(1.0)));
        quantile(hours.map(|day| 24.0 * day).collect(), 0.5)
    }

    /// The visibility of the pixels of a training view of this size (columns, rows), 0 to 1; none where pixels count alike.
    pub fn visibility(&self, name: &str, size: (usize, usize)) -> Option<Grid2> {
        let index = self.appearance.view(name)?;
        let patches = self.appearance.visibility[index].clone()?;
        let patch_px = self.appearance.content.views[index].patch_px?;
        Some(PatchVisibility { patch_px, patches }.at_pixels(size))
    }

    /// Renders a view with an embedding.
    pub fn picture(&self, view: &NovelView, embedding: &[f32], setup: &SiteScene) -> Picture {
        view.picture_of(&self.splats, self.model(), self.parameters(embedding), setup.altitudes)
    }

    /// The share of sunlight that the model gives each pixel of a view, 0 to 1; 1 without a sun.
    pub fn sunlit(&self, view: &NovelView, setup: &SiteScene) -> Grid2 {
        let (mut model, parameters) = (self.model(), self.parameters(self.reference()));
        view.splat_colors(&self.splats, model.as_mut(), parameters, setup.altitudes);
        let share = |i: usize| model.light().map_or(1.0, |light| light.sunlit[i]);
        let shares: Vec<[f32; 3]> = (0..self.splats.len()).map(|i| [share(i); 3]).collect();
        let splats = self.splats.colored(&shares);
        let plain = NovelView { sun_shear: None, ..*view };
        let [sunlit, ..] = plain.picture(&splats, &Appearance::default(), setup.altitudes).colors;
        sunlit
    }

    /// The splats in their colours for an embedding in full sunlight.
    pub fn baked_in_sunlight(&self, embedding: &[f32]) -> Splats {
        let (parameters, mut colors) = (self.parameters(embedding), Vec::new());
        self.model().splat_colors(ColorInput { parameters, splats: &self.splats, sun: None }, &mut colors);
        self.splats.colored(&colors)
    }
}

/// The hash of a file of splats.
pub fn hash_of_splats(splats: &Path) -> Result<String, PipelineError> {
    let failed = |e: std::io::Error| AppearanceError::Io { path: splats.into(), reason: e.to_string() };
    let mut hasher = blake3::Hasher::new();
    let mut file = std::fs::File::open(splats).map_err(failed)?;
    std::io::copy(&mut file, &mut hasher).map_err(failed)?;
    Ok(hasher.finalize().to_hex().to_string())
}
