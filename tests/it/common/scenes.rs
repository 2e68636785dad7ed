//! Scenes that many tests look at, made once a process below the temporary folder of the target. A test that changes
//! one works on a copy.

use super::succeeds;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// The simulated town in four views of 140 pixels.
pub fn town() -> &'static Path {
    static MADE: OnceLock<PathBuf> = OnceLock::new();
    MADE.get_or_init(|| {
        made("town", |scene| {
            succeeds(&["simulate", scene, "--size", "140", "--views", "4", "-q"]);
        })
    })
}

/// A run of [`town`] with adjusted cameras.
pub fn adjusted_town() -> &'static Path {
    static MADE: OnceLock<PathBuf> = OnceLock::new();
    MADE.get_or_init(|| {
        made("adjusted_town", |run| {
            succeeds(&["ba", town().to_str().unwrap(), "-o", run, "-q"]);
        })
    })
}

/// The folder of this process with a scene's name, filled by `make`.
fn made(name: &str, make: impl FnOnce(&str)) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(std::process::id().to_string());
    std::fs::create_dir_all(&folder).unwrap();
    let scene = folder.join(name);
    // A process with the same number may have left one behind.
    if scene.exists() {
        std::fs::remove_dir_all(&scene).unwrap();
    }
    make(scene.to_str().unwrap());
    scene
}
