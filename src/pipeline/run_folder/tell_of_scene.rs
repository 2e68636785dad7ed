//! What a user is told about a perspective scene when it is read.

use crate::perspective::PerspectiveScene;
use crate::progress::{Event, Progress};

/// Says what of a scene is left out, which colour camera it has, and where it lies on Earth.
pub fn tell_of_scene(scene: &PerspectiveScene, progress: &dyn Progress) {
    for (name, reason) in &scene.skipped {
        progress.event(Event::Warning(format!("`{name}` is left out: {reason}")));
    }
    if let Some((images, meaning)) = scene.transparency() {
        let text = format!("transparent pixels of {images} images are {}", meaning.meaning());
        progress.event(Event::Note(text));
    }
    if let Some(registration) = &scene.registration {
        progress.event(Event::Note(registration.to_string()));
    }
    if let Some(georeference) = &scene.georeference {
        progress.event(Event::Note(georeference.to_string()));
        georeference.warnings().for_each(|warning| progress.event(Event::Warning(warning.clone())));
    }
}
