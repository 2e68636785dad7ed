//! Colours at a date: embeddings interpolated along the year (SatGS, figure 8).

use crate::pipeline::run_folder::colors::SceneColors;
use crate::scene::days_of;

/// Days of a year, on average.
const YEAR: f64 = 365.25;

/// The embedding at a day ([`days_of`]): interpolated between the views taken before and after it in the
/// course of a year, whichever year they are of. None if fewer than two views have a known date.
pub fn embedding_at(colors: &SceneColors, day: f64) -> Option<Vec<f32>> {
    let views = colors.appearance.content.views.iter().zip(&colors.appearance.embeddings);
    let mut dated: Vec<(f64, &Vec<f32>)> = views
        .filter_map(|(view, embedding)| Some((days_of(view.acquired.as_deref()?)?, embedding)))
        .collect();
    if dated.len() < 2 {
        return None;
    }
    let in_year = |day: f64| day.rem_euclid(YEAR);
    let day = in_year(day);
    dated.iter_mut().for_each(|(d, _)| *d = in_year(*d));
    dated.sort_by(|a, b| a.0.total_cmp(&b.0));
    let after = dated.iter().position(|(d, _)| *d > day).unwrap_or(0);
    let before = (after + dated.len() - 1) % dated.len();
    let since = (day - dated[before].0).rem_euclid(YEAR);
    let between = (dated[after].0 - dated[before].0).rem_euclid(YEAR);
    let part = if between > 0.0 { (since / between) as f32 } else { 0.0 };
    let pairs = dated[before].1.iter().zip(dated[after].1);
    Some(pairs.map(|(a, b)| a + part * (b - a)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splat::appearance::satgs::{
        AppearanceContent, Cube, Networks, TrainedAppearance, TrainedView,
    };
    use crate::splat::splats::Splats;

    fn colors(dates: &[&str]) -> SceneColors {
        let view = |date: &&str| TrainedView {
            name: (*date).into(),
            acquired: Some((*date).into()),
            sun: None,
            patch_px: None,
        };
        let content = AppearanceContent {
            networks: Networks::default(),
            cube: Cube::default(),
            views: dates.iter().map(view).collect(),
            reference: 0,
            splats: String::new(),
        };
        let embeddings = (0..dates.len()).map(|k| vec![k as f32]).collect();
        let appearance = TrainedAppearance {
            content,
            shared: Vec::new(),
            embeddings,
            colors: Vec::new(),
            visibility: Vec::new(),
        };
        SceneColors { splats: Splats::default(), appearance }
    }

    #[test]
    fn embeddings_are_interpolated_within_the_year_and_across_its_end() {
        let colors = colors(&["2015-03-02", "2014-12-22T10:00:00Z", "2016-01-11"]);
        let at = |date: &str| embedding_at(&colors, days_of(date).unwrap()).unwrap()[0];
        assert!(at("2015-03-02") == 0.0 && at("2014-12-22T10:00:00Z") == 1.0 && at("2016-01-11") == 2.0);
        // Years of 365 and 366 days shift a date by less than a day, a twentieth of the time between
        // 22 December and 11 January.
        assert!((at("2020-03-02") - 0.0).abs() < 0.05 && (at("2020-12-22") - 1.0).abs() < 0.05);
        // Half way between 22 December and 11 January.
        assert!((at("2021-01-01") - 1.5).abs() < 0.05, "{}", at("2021-01-01"));
        assert!(at("2021-02-05") > 0.5 && at("2021-02-05") < 1.9);
        assert!(at("2021-07-20") > 0.3 && at("2021-07-20") < 0.7);
    }

    #[test]
    fn a_single_date_is_no_season() {
        assert!(embedding_at(&colors(&["2015-03-02"]), 3.0).is_none());
    }
}
