//! What training starts from in a run that was predicted.

use crate::frame::SiteGrid;
use crate::io::{ReadError, read_georeference, read_json};
use crate::pipeline::PipelineError;
use crate::pipeline::run_folder::stage::{Fingerprint, hash_file, made_from};
use crate::run_files::{PREDICT_STAGE, PREDICTED, PREDICTED_LIGHTS, STAGE};
use crate::splat::appearance::Appearance;
use crate::splat::ply;
use crate::splat::splats::Splats;
use std::path::Path;

/// What tells the prediction in a run folder from others, if it is one of this scene.
pub fn prediction_of(run: &Path, scene: &Fingerprint) -> Result<Option<String>, PipelineError> {
    let record = run.join(PREDICT_STAGE).join(STAGE);
    if !record.exists() {
        return Ok(None);
    }
    let before = made_from(&record)?;
    let is_own = scene.iter().all(|(key, value)| before.get(key) == Some(value));
    Ok(is_own.then(|| hash_file(&record)))
}

/// Splats, and the colour models of the views by their names, which photographs do not have.
pub type PredictedStart = (Splats, Vec<(String, Appearance)>);

/// The splats that a training of this scene begins with if the run was predicted from it; none if it was not. `site` is the frame of
/// the training, which a later alignment may have moved against that of the splats.
pub fn read_predicted(
    run: &Path,
    scene: &Fingerprint,
    site: Option<&SiteGrid>,
) -> Result<Option<PredictedStart>, PipelineError> {
    if prediction_of(run, scene)?.is_none() {
        return Ok(None);
    }
    let made_by = "`satgs predict RUN -o RUN2 --overwrite` makes it";
    let damaged = |source| PipelineError::RunFile { source, made_by };
    let path = run.join(PREDICTED_LIGHTS);
    let lights: Vec<(String, Appearance)> = read_json(&path).map_err(damaged)?;
    if let Some((name, _)) = lights.iter().find(|(_, light)| !light.is_whole()) {
        return Err(damaged(ReadError::new(
            &path,
            format!("the light of `{name}` has another number of values"),
        )));
    }
    let mut splats = ply::read(&run.join(PREDICTED))?;
    let own = read_georeference(&run.join(PREDICTED)).map_err(damaged)?;
    if let Some((own, site)) = own.zip(site) {
        let [x, y, z] = (own.origin - site.origin).xyz().map(|v| v as f32);
        splats.position.iter_mut().for_each(|p| *p = [p[0] + x, p[1] + y, p[2] + z]);
    }
    Ok(Some((splats, lights)))
}
