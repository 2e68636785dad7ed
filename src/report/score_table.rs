//! Tables of an evaluation, for the HTML page and for the terminal.

use serde_json::Value;

/// A table of texts.
pub struct ScoreTable {
    /// Name of the table.
    pub name: &'static str,
    /// Headings of the columns.
    pub head: &'static [&'static str],
    /// Cells by row; each row has as many cells as there are headings.
    pub rows: Vec<Vec<String>>,
}

/// Two tables: the registrations, and the scores after each of them; after the last one also the scores of cells that two
/// views confirm, of those that are filled in, and of parts of the land.
///
/// `evaluation` is the content of `metrics.json`.
#[must_use]
pub fn score_tables(evaluation: &Value) -> [ScoreTable; 2] {
    let array = |v: &Value| v.as_array().cloned().unwrap_or_default();
    let registered_scores = array(&evaluation["registered_scores"]);
    let text = |v: &Value| v.as_str().unwrap_or_default().to_owned();
    let shifts = registered_scores.iter().map(|v| {
        let columns = [
            "dx_cells",
            "dy_cells",
            "east_m",
            "east_sigma_m",
            "north_m",
            "north_sigma_m",
            "dz_m",
            "dz_sigma_m",
        ];
        let numbers = columns.map(|key| number(&v[key], 3));
        [text(&v["method"])].into_iter().chain(numbers).collect()
    });
    let breakdown = registered_scores.last().map_or_else(Vec::new, |v| array(&v["breakdown"]));
    let all = registered_scores.iter().map(|v| score_row(format!("all, {}", text(&v["method"])), v));
    let last = registered_scores.last();
    let by_evidence = ["confirmed", "filled"].into_iter().filter_map(|key| {
        let v = last.filter(|v| v[key].is_object())?;
        Some(score_row(format!("{key}, {}", text(&v["method"])), &v[key]))
    });
    let parts = breakdown.iter().map(|s| score_row(text(&s["name"]), s));
    [
        ScoreTable {
            name: "Registrations",
            head: &["registration", "dx cells", "dy cells", "east m", "σ", "north m", "σ", "dz m", "σ"],
            rows: shifts.collect(),
        },
        ScoreTable {
            name: "Scores",
            head: &[
                "metres", "MAE", "no holes", "RMSE", "bias", "median", "NMAD", "LE90", "LE95", "<0.5m",
                "<1m", "<2m", "complete", "cells",
            ],
            rows: all.chain(by_evidence).chain(parts).collect(),
        },
    ]
}

/// Explanation of the columns of the table of scores.
pub const SCORE_NOTE: &str = "σ: standard deviation, – where the heights do not determine it; confirmed: cells that two views or more see; filled: the other \
     cells, filled in from their surroundings; no holes: MAE with holes filled by the nearest cell; median: of |error|; <: % of cells \
     with a smaller error; complete: predicted cells / cells of land; parts of the land: after xyz";

/// A sentence about the expected errors of a prediction; none if it has none. `evaluation` is the content of `metrics.json`.
#[must_use]
pub fn expected_error_text(evaluation: &Value) -> Option<String> {
    let ranking = &evaluation["expected_errors"];
    let correlation = ranking["rank_correlation"].as_f64()?;
    let mean_m = ranking["expected_mae_m"].as_f64()?;
    let large = ranking["large_in_least_sure_fifth"].as_f64().map_or_else(String::new, |share| {
        format!(
            "; the fifth of the cells with the largest expected errors has {:.0} % of the errors above 2 m",
            100.0 * share
        )
    });
    Some(format!(
        "expected errors: mean {mean_m:.3} m, rank correlation with the errors after xyz {correlation:.2}{large}"
    ))
}

fn score_row(name: String, scores: &Value) -> Vec<String> {
    let metres = ["mae_m", "filled_mae_m", "rmse_m", "bias_m", "median_m", "nmad_m", "le90_m", "le95_m"];
    let share = |i: usize| scores["within"][i].as_f64().map_or(Value::Null, |s| (100.0 * s).into());
    [name]
        .into_iter()
        .chain(metres.map(|key| number(&scores[key], 3)))
        .chain((0..3).map(|i| number(&share(i), 1)))
        .chain([number(&scores["completeness"], 4), number(&scores["cells"], 0)])
        .collect()
}

/// A number as text; a dash if there is none, for example because no cell is predicted.
fn number(value: &Value, digits: usize) -> String {
    value.as_f64().map_or_else(|| "–".into(), |n| format!("{n:.digits$}"))
}
