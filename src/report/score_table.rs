//! The tables of an evaluation, for the page and for the terminal alike.

use serde_json::Value;

/// A table: what it is called, the headings of its columns, its rows.
pub struct ScoreTable {
    /// Name.
    pub name: &'static str,
    /// Headings.
    pub head: &'static [&'static str],
    /// Cells, as many a row as there are headings.
    pub rows: Vec<Vec<String>>,
}

/// The registrations, and the scores after each; after the last also those of parts of the land.
///
/// `evaluation` is what `metrics.json` holds.
#[must_use]
pub fn score_tables(evaluation: &Value) -> [ScoreTable; 2] {
    let array = |v: &Value| v.as_array().cloned().unwrap_or_default();
    let registered_scores = array(&evaluation["registered_scores"]);
    let text = |v: &Value| v.as_str().unwrap_or_default().to_owned();
    let shifts = registered_scores.iter().map(|v| {
        let numbers = ["dx_cells", "dy_cells", "east_m", "north_m", "dz_m"].map(|key| number(&v[key], 3));
        [text(&v["method"])].into_iter().chain(numbers).collect()
    });
    let breakdown = registered_scores.last().map_or_else(Vec::new, |v| array(&v["breakdown"]));
    let all = registered_scores.iter().map(|v| score_row(format!("all, {}", text(&v["method"])), v));
    let parts = breakdown.iter().map(|s| score_row(text(&s["name"]), s));
    [
        ScoreTable {
            name: "Registrations",
            head: &["registration", "dx cells", "dy cells", "east m", "north m", "dz m"],
            rows: shifts.collect(),
        },
        ScoreTable {
            name: "Scores",
            head: &[
                "metres", "MAE", "filled", "RMSE", "bias", "median", "NMAD", "LE90", "LE95", "<0.5m", "<1m",
                "<2m", "complete", "cells",
            ],
            rows: all.chain(parts).collect(),
        },
    ]
}

/// What the columns of scores mean.
pub const SCORE_NOTE: &str = "filled: MAE with holes filled by the nearest cell; median: of |error|; <: % of cells; \
                              complete: predicted cells / cells of land; parts of the land: after xyz";

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

/// A number; of nothing, as where no cell is predicted, a dash.
fn number(value: &Value, digits: usize) -> String {
    value.as_f64().map_or_else(|| "–".into(), |n| format!("{n:.digits$}"))
}
