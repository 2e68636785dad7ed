//! `satgs simulate --room` and `--aerial`: test sets of photographs.

use super::super::{CliError, Ui};
use super::Args;
use crate::scene::Role;
use crate::simulate::{AerialOptions, RoomOptions, TestSetSummary, simulate_aerial, simulate_room};
use std::fmt::Write;

/// Runs the command for photographs.
pub(super) fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    if args.room {
        let defaults = RoomOptions::default();
        let options = RoomOptions {
            seed: args.seed,
            views: args.views.unwrap_or(defaults.views),
            size_px: args.size.unwrap_or(defaults.size_px),
            frames: args.frames.map(Into::into),
            overwrite: args.overwrite,
        };
        let summary = simulate_room(&args.out, &options, ui)?;
        let json = serde_json::json!({ "out": args.out, "options": options, "summary": summary });
        return ui.summary("simulate", Some(&text(args, options.size_px, &summary)), &json);
    }
    let defaults = AerialOptions::default();
    let options = AerialOptions {
        seed: args.seed,
        views: args.views.unwrap_or(defaults.views),
        size_px: args.size.unwrap_or(defaults.size_px),
        relief: args.relief(),
        overwrite: args.overwrite,
    };
    let summary = simulate_aerial(&args.out, &options, ui)?;
    let json = serde_json::json!({ "out": args.out, "options": options, "summary": summary });
    ui.summary("simulate", Some(&text(args, options.size_px, &summary)), &json)
}

fn text(args: &Args, size_px: usize, summary: &TestSetSummary) -> String {
    let (views, out) = (&summary.views, args.out.display());
    let mut t = format!("{} photographs of {size_px} x {size_px} px in {out}\n", views.len());
    t += "\nview   position (x, y, z) in m           depths in m         points\n";
    for v in views {
        let ([x, y, z], [near, far]) = (v.center, v.depths_m);
        // Writing to a string cannot fail.
        let _ = writeln!(
            t,
            "{:<6} {x:>9.2} {y:>9.2} {z:>9.2}   {near:>8.2} to {far:>8.2} {:>8}",
            v.name, v.points
        );
    }
    let _ = writeln!(t, "\npoints: {}", summary.points);
    let _ = writeln!(t, "exact mesh: {}, {} triangles", summary.mesh.display(), summary.mesh_triangles);
    let _ = writeln!(t, "exact depths and normals: {out}/truth/depths, {out}/truth/normals");
    let _ = write!(t, "with smooth errors: {out}/priors/depths, {out}/priors/normals");
    if let Some(list) = &summary.test_list {
        let training: Vec<_> =
            views.iter().filter(|v| v.role == Role::Train).map(|v| v.name.as_str()).collect();
        let _ = write!(t, "\ntraining views: {}; all others are in {}", training.join(", "), list.display());
    }
    t
}
