//! `satgs info` of a perspective scene.

use super::{CliError, Ui};
use crate::perspective::colmap::Reprojection;
use crate::perspective::{LensModel, PerspectiveScene, PerspectiveView, PoseCheck};
use crate::progress::{Event, Progress};
use crate::scene::Role;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::Path;

/// Names that are listed of what was left out and of the test views.
const LISTED: usize = 5;

/// Shows a scene that was read from `path`.
pub fn run(path: &Path, scene: &PerspectiveScene, ui: &Ui) -> Result<(), CliError> {
    let reprojection = PerspectiveScene::reprojection(path)?;
    let lenses = lenses(scene);
    let check = PoseCheck::of(&scene.views, &scene.points);
    let text = text(scene, &lenses, reprojection) + &check.to_string() + "\n";
    let rejected = scene.rejected_registration.iter().map(ToString::to_string);
    let changed = reprojection.and_then(|r| r.warning());
    for warning in rejected.chain(changed).chain(check.warnings()) {
        ui.event(Event::Warning(warning));
    }
    let mut summary = summary(scene, &lenses, reprojection);
    summary["poses"] = json!(check);
    ui.summary("info", Some(&text), &summary)
}

/// The cameras of one model.
struct Lenses<'a> {
    model: LensModel,
    views: Vec<&'a PerspectiveView>,
    cameras: usize,
    distortion_px: f64,
}

impl Lenses<'_> {
    /// Smallest and largest value over the views.
    fn range(&self, value: impl Fn(&PerspectiveView) -> f64) -> (f64, f64) {
        let values = self.views.iter().map(|v| value(v));
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
    }

    fn focal_px(&self) -> (f64, f64) {
        let (x, y) = (self.range(|v| v.lens_camera.focal.x), self.range(|v| v.lens_camera.focal.y));
        (x.0.min(y.0), x.1.max(y.1))
    }
}

fn lenses(scene: &PerspectiveScene) -> Vec<Lenses<'_>> {
    let mut out: Vec<Lenses> = Vec::new();
    for view in &scene.views {
        let lens = view.lens_camera;
        let place = out.iter().position(|l| l.model == lens.model);
        let group = match place {
            Some(place) => &mut out[place],
            None => {
                out.push(Lenses { model: lens.model, views: Vec::new(), cameras: 0, distortion_px: 0.0 });
                let last = out.len() - 1;
                &mut out[last]
            }
        };
        if group.views.iter().all(|v| v.lens_camera != lens) {
            group.cameras += 1;
            group.distortion_px = group.distortion_px.max(lens.largest_distortion_px());
        }
        group.views.push(view);
    }
    out
}

fn plural(n: usize, word: &str) -> String {
    format!("{n} {word}{}", if n == 1 { "" } else { "s" })
}

/// `a` or `a to b`.
fn span((low, high): (f64, f64), digits: usize) -> String {
    let (low, high) = (format!("{low:.digits$}"), format!("{high:.digits$}"));
    if low == high { low } else { format!("{low} to {high}") }
}

fn text(scene: &PerspectiveScene, lenses: &[Lenses], reprojection: Option<Reprojection>) -> String {
    let (tests, trained): (Vec<&PerspectiveView>, Vec<_>) =
        scene.views.iter().partition(|v| v.role == Role::Test);
    let mut out = format!(
        "{}: {}, {} to train on, {} held back",
        scene.layout.name(),
        plural(scene.views.len(), "view"),
        trained.len(),
        tests.len()
    );
    if !tests.is_empty() {
        let _ = write!(out, " ({})", listed(tests.iter().map(|v| v.name.clone())));
    }
    out.push('\n');
    for lens in lenses {
        let (width, height) =
            (lens.range(|v| v.lens_camera.size.0 as f64), lens.range(|v| v.lens_camera.size.1 as f64));
        let _ = write!(
            out,
            "{}: {} of {}, {} x {} px, focal length {} px",
            lens.model.name(),
            plural(lens.cameras, "camera"),
            plural(lens.views.len(), "view"),
            span(width, 0),
            span(height, 0),
            span(lens.focal_px(), 1)
        );
        let _ = match lens.distortion_px {
            0.0 => writeln!(out, ", no distortion"),
            px if px.is_finite() => writeln!(out, ", distortion up to {px:.1} px"),
            _ => writeln!(out, ", distortion without an inverse in parts of the image, which are left out"),
        };
    }
    let count = |has: fn(&PerspectiveView) -> bool| scene.views.iter().filter(|v| has(v)).count();
    for (what, n) in [("depth maps", count(|v| v.depth.is_some())), ("masks", count(|v| !v.masks.is_empty()))]
    {
        if n > 0 {
            let _ = writeln!(out, "{what}: {n}");
        }
    }
    if let Some((images, meaning)) = scene.transparency() {
        let _ = writeln!(out, "transparent pixels of {} are {}", plural(images, "image"), meaning.meaning());
    }
    let _ = writeln!(out, "points: {}", scene.points.len());
    if let Some(r) = reprojection {
        let stated = r.stated_px.map_or(String::new(), |px| format!("; the file states {px:.3} px"));
        let _ = writeln!(
            out,
            "reprojection error: {:.3} px, mean over the points and their {} observations{stated}",
            r.mean_px, r.observations
        );
    }
    if let Some([low, high]) = scene.extent() {
        let unit = if scene.is_metric() { "m" } else { "units of the file" };
        let [x, y, z] = std::array::from_fn(|i| format!("{:.2} to {:.2}", low[i], high[i]));
        let _ = writeln!(out, "extent of points and cameras: x {x}, y {y}, z {z} {unit}");
    }
    let _ = match &scene.georeference {
        None => writeln!(out, "georeference: none"),
        Some(georeference) => writeln!(out, "{georeference}"),
    };
    if let Some(registration) = &scene.registration {
        let _ = writeln!(out, "{registration}");
    }
    if !scene.skipped.is_empty() {
        let named = listed(scene.skipped.iter().map(|(name, reason)| format!("{name} ({reason})")));
        let _ = writeln!(out, "left out: {}: {named}", scene.skipped.len());
    }
    for (name, reason) in &scene.unused {
        let _ = writeln!(out, "not used: {name}: {reason}");
    }
    out
}

/// The first names, and how many more there are.
fn listed(names: impl ExactSizeIterator<Item = String>) -> String {
    let more = names.len().saturating_sub(LISTED);
    let first = names.take(LISTED).collect::<Vec<_>>().join(", ");
    if more > 0 { format!("{first} and {more} more") } else { first }
}

fn summary(scene: &PerspectiveScene, lenses: &[Lenses], reprojection: Option<Reprojection>) -> Value {
    let view = |v: &PerspectiveView| {
        json!({
            "name": v.name, "image": v.image, "role": v.role, "model": v.lens_camera.model.name(),
            "width": v.lens_camera.size.0, "height": v.lens_camera.size.1,
            "focal_px": v.lens_camera.focal.to_array(), "center": v.camera.center.to_array(),
            "masks": v.masks.iter().map(|m| &m.path).collect::<Vec<_>>(), "depth": v.depth.as_ref().map(|d| &d.path),
        })
    };
    let lens = |l: &Lenses| {
        let (low, high) = l.focal_px();
        json!({
            "model": l.model.name(), "views": l.views.len(), "cameras": l.cameras, "focal_px": [low, high],
            "distortion_px": Some(l.distortion_px).filter(|d| d.is_finite()),
        })
    };
    let count = |role: Role| scene.views.iter().filter(|v| v.role == role).count();
    json!({
        "layout": scene.layout,
        "train": count(Role::Train), "test": count(Role::Test),
        "cameras": lenses.iter().map(lens).collect::<Vec<_>>(),
        "views": scene.views.iter().map(view).collect::<Vec<_>>(),
        "points": scene.points.len(),
        "reprojection": reprojection,
        "extent": scene.extent(),
        "georeference": scene.georeference,
        "skipped": scene.skipped,
        "unused": scene.unused,
        "transparent": scene.transparency().map(|(images, meaning)| json!({ "images": images, "meaning": meaning })),
        "registration": scene.registration,
        "rejected_registration": scene.rejected_registration,
    })
}
