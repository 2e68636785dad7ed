//! The first section of the page: what was made, how good it is, what needs attention, and the command.

use super::pictures::map_of_page;
use super::sections::read_if_present;
use super::{ReportError, map};
use crate::bundle::Report;
use crate::dsm::CellCounts;
use crate::estimate::{Imaging, best_convergence_deg};
use crate::io::{HeightSystem, ImageFile, VerticalReference, escape_xml};
use crate::mvs::PlaneSweep;
use crate::run_files::{
    ADJUSTMENT, ADJUSTMENT_REPORT, CONFIDENCE, DSM, EVALUATION, METRICS, NVS_SCORES, ORTHO, PREDICT_STAGE,
    SCENE, STAGE, TRAIN_STAGE,
};
use crate::scene::{Role, Scene, angle_between_deg};
use crate::splat::recipe::Recipe;
use crate::stats::quantile;
use serde_json::Value;
use std::fmt::Write;
use std::path::Path;

/// Completeness below which a mean error leaves out what is difficult.
const COMPLETE: f64 = 0.99;
/// Share of the cells with a height below which few of them are confirmed.
const FEW_CONFIRMED: f64 = 0.5;
/// Stages whose record holds the command, from the last one.
const STAGES: [&str; 4] = ["dsm", TRAIN_STAGE, ADJUSTMENT, PREDICT_STAGE];

/// A figure: its name, its value, and what it means.
type Fact = (&'static str, String, String);

/// The result of a run, as HTML.
///
/// # Errors
/// [`ReportError`] if a file of the run is damaged.
pub fn result(run: &Path) -> Result<String, ReportError> {
    // Scenes of photographs have another form.
    let scene = read_if_present::<Scene>(&run.join(SCENE)).ok().flatten();
    let scores = read_if_present::<Value>(&run.join(EVALUATION).join(METRICS))?;
    let novel = read_if_present::<Value>(&run.join(NVS_SCORES))?;
    let report = read_if_present::<Report>(&run.join(ADJUSTMENT).join(ADJUSTMENT_REPORT))?;
    let dsm = run.join(DSM);
    let counts = dsm.exists().then(|| CellCounts::of_files(&dsm, &run.join(CONFIDENCE))).transpose()?;

    let mut facts: Vec<Fact> = Vec::new();
    let scored = scores.as_ref().and_then(score_fact);
    let training = read_if_present::<Value>(&run.join(TRAIN_STAGE).join(STAGE))?;
    let expected = || expected_fact(scene.as_ref()?, &training?["made_from"]);
    facts.extend(scored.or_else(expected));
    facts.extend(counts.as_ref().map(surface_fact));
    facts.extend(novel.as_ref().and_then(novel_fact));
    facts.extend(report.as_ref().map(|r| {
        let before =
            format!("mean reprojection error; {:.2} px with the cameras as delivered", r.mean_before_px);
        ("Cameras agree to", format!("{:.2} px", r.mean_px), before)
    }));
    let mut out = String::from("<dl class=\"facts\">\n");
    for (name, value, meaning) in &facts {
        let _ = writeln!(
            out,
            "<div><dt>{name}</dt><dd><strong>{}</strong><span>{}</span></dd></div>",
            escape_xml(value),
            escape_xml(meaning)
        );
    }
    out.push_str("</dl>\n");
    out.push_str(&attention(scene.as_ref(), report.as_ref(), scores.as_ref(), counts.as_ref()));
    out.push_str(&maps(run)?);
    if let Some(command) = command(run)? {
        let _ = writeln!(out, "<p>Made by <code>{}</code></p>", escape_xml(&command));
    }
    Ok(out)
}

/// The error against the truth.
fn score_fact(scores: &Value) -> Option<Fact> {
    let last = scores["registered_scores"].as_array()?.last()?;
    let (mae, median) = (last["mae_m"].as_f64()?, last["median_m"].as_f64()?);
    let confirmed = last["confirmed"]["mae_m"]
        .as_f64()
        .map_or_else(String::new, |m| format!("; {m:.2} m where two views confirm it"));
    let meaning = format!("mean against the truth after registration xyz, median {median:.2} m{confirmed}");
    Some(("Height error", format!("{mae:.2} m"), meaning))
}

/// The error to expect of a scene that has not been scored, if its heights were `made_from` what such errors were measured with:
/// recipe `best`, trained to its end where training changes the heights.
fn expected_fact(scene: &Scene, made_from: &Value) -> Option<Fact> {
    let (low, high) = scene.height_range();
    let middle = 0.5 * (low + high);
    let views: Vec<_> = scene.views.iter().filter(|view| view.role == Role::Train).collect();
    let best = Recipe::named(Recipe::NAMES[0])?;
    if !is_as_measured(made_from, &best, views.len()) {
        return None;
    }
    let directions: Vec<(f64, f64)> = views.iter().filter_map(|view| view.direction_deg(middle)).collect();
    let pairs =
        directions.iter().enumerate().flat_map(|(i, a)| directions[i + 1..].iter().map(move |b| (a, b)));
    let sizes = views.iter().filter_map(|view| view.gsd_m(middle)).map(|(col, row)| (col * row).sqrt());
    let imaging = Imaging {
        views: views.len(),
        convergence_deg: best_convergence_deg(pairs.map(|(a, b)| angle_between_deg(*a, *b))),
        gsd_m: quantile(sizes.collect(), 0.5)?,
    };
    let expected = imaging.expectation();
    let meaning = format!(
        "expected mean with {} views, from simulated towns{}; --truth scores it",
        imaging.views,
        if expected.is_measured { "" } else { ", with a better convergence than here" }
    );
    Some(("Height error", format!("about {:.1} m", expected.error_m), meaning))
}

/// Whether the heights of so many views were made as those whose errors were measured.
fn is_as_measured(made_from: &Value, best: &Recipe, views: usize) -> bool {
    let usual = best.clone().for_views(views).iterations.to_string();
    let is_whole = made_from["--iterations"] == usual.as_str() && made_from["--no-splats"].is_null();
    made_from["--recipe"] == best.name.as_str() && (is_whole || !PlaneSweep::can_refine(views))
}

fn surface_fact(counts: &CellCounts) -> Fact {
    // With a no-break space.
    let percent = |cells: u64| format!("{:.0}\u{a0}%", 100.0 * cells as f64 / counts.all.max(1) as f64);
    match (counts.confirmed, counts.filled) {
        (Some(confirmed), Some(filled)) => {
            let meaning = format!(
                "of the cells are confirmed by two views or more; {} are filled in, {} have no height",
                percent(filled),
                percent(counts.all.saturating_sub(counts.with_height))
            );
            ("Surface", percent(confirmed), meaning)
        }
        _ => ("Surface", percent(counts.with_height), "of the cells have a height".into()),
    }
}

fn novel_fact(scores: &Value) -> Option<Fact> {
    let (psnr, ssim) = (scores["mean"]["psnr_db"].as_f64()?, scores["mean"]["ssim"].as_f64()?);
    let views = scores["views"].as_array()?.len();
    let meaning = format!("mean PSNR of {views} held-back views; SSIM {ssim:.3}");
    Some(("Rendered views", format!("{psnr:.1} dB"), meaning))
}

/// What a reader should know before using the result; empty if there is nothing.
fn attention(
    scene: Option<&Scene>,
    report: Option<&Report>,
    scores: Option<&Value>,
    counts: Option<&CellCounts>,
) -> String {
    let mut items: Vec<String> = Vec::new();
    for (view, reason) in report.into_iter().flat_map(|report| &report.left_out) {
        items.push(format!("{view} was left out: {reason}"));
    }
    items.extend(scene.into_iter().flat_map(|scene| scene.warnings.clone()));
    let few = counts.and_then(|c| Some(c.confirmed? as f64 / c.with_height.max(1) as f64));
    if let Some(share) = few.filter(|share| *share < FEW_CONFIRMED) {
        items.push(format!("only {:.0} % of the heights are confirmed by two views or more", 100.0 * share));
    }
    let last = scores.and_then(|s| s["registered_scores"].as_array()?.last());
    if let Some(complete) = last.and_then(|s| s["completeness"].as_f64()).filter(|c| *c < COMPLETE) {
        items.push(format!(
            "the surface covers only {:.1} % of the land of the truth: mean errors leave out difficult places",
            100.0 * complete
        ));
    }
    if report.is_some_and(|report| report.rank_defect > 0) {
        items.push(
            "tie points do not determine the position of the scene: it is that of the delivered cameras, usually some metres off \
             (satgs align, --gcps or --dem-sigma fix it)"
                .into(),
        );
    }
    if items.is_empty() {
        return String::new();
    }
    let items: String = items.iter().map(|item| format!("<li>{}</li>\n", escape_xml(item))).collect();
    format!("<div class=\"attention\"><h3>Needs attention</h3>\n<ul>\n{items}</ul></div>\n")
}

/// Surface and orthophoto, if they are there.
fn maps(run: &Path) -> Result<String, ReportError> {
    let (dsm, ortho) = (run.join(DSM), run.join(ORTHO));
    let mut out = String::new();
    if dsm.exists() {
        let (bands, grid) = map_of_page(&dsm)?;
        let from = HeightSystem::of_raster(&ImageFile::open(&dsm)?)?.from;
        let unit = match from.as_deref() {
            Some(VerticalReference::ELLIPSOID) => "Height, m above the WGS 84 ellipsoid".to_owned(),
            Some(name) => format!("Height, m above {name}"),
            None => "Height, m".to_owned(),
        };
        let picture =
            map::relief(&bands[0], &grid, "Surface model in colours of height, lit from the north-west")?;
        let legend = map::height_legend(&bands[0], &unit);
        let caption = format!("Surface ({DSM}), EPSG:{}, lit from the north-west", grid.epsg);
        out += &map::figure(&picture, &grid, &legend, &caption);
    }
    if ortho.exists() {
        let (bands, grid) = map_of_page(&ortho)?;
        let picture = map::colors(&bands, &grid, "Orthophoto without shadows")?;
        out += &map::figure(&picture, &grid, "", &format!("Orthophoto ({ORTHO}), without shadows"));
    }
    Ok(if out.is_empty() { out } else { format!("<div class=\"maps\">\n{out}</div>\n") })
}

/// The command that made the last stage.
fn command(run: &Path) -> Result<Option<String>, ReportError> {
    for stage in STAGES {
        if let Some(record) = read_if_present::<Value>(&run.join(stage).join(STAGE))? {
            return Ok(record["command"].as_str().map(str::to_owned));
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn an_error_is_expected_only_of_heights_that_are_made_as_the_measured_ones() {
        let best = Recipe::named(Recipe::NAMES[0]).unwrap();
        let whole = |views: usize| best.clone().for_views(views).iterations.to_string();
        let of = |recipe: &str, iterations: &str, views| {
            is_as_measured(&json!({ "--recipe": recipe, "--iterations": iterations }), &best, views)
        };
        assert!(of("best", &whole(8), 8) && of("best", &whole(2), 2) && of("best", "5", 2));
        assert!(!of("best", "5", 8) && !of("eogs", &whole(8), 8) && !of("eogs", &whole(2), 2));
        let bare = json!({ "--recipe": "best", "--iterations": whole(8), "--no-splats": "given" });
        assert!(!is_as_measured(&bare, &best, 8) && is_as_measured(&bare, &best, 2));
    }
}
