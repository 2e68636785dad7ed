//! The check of a scene.

use super::super::pinhole::PinholeCamera;
use super::super::pose::Pose;
use super::super::pose_finding::PoseFinding;
use super::super::scene_parts::ScenePoint;
use super::super::view::PerspectiveView;
use super::convention::{Reading, other_focal};
use super::features::ViewFeatures;
use super::matched_pair::MatchedPair;
use super::pairs::{neighbours, usual_depths};
use super::strangers::Views;
use crate::stats::median;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeSet;
use std::fmt;

/// Largest number of views that are looked at: of more, every n-th.
const MOST_VIEWS: usize = 160;
/// Views beside each one with which it is compared, and with which it is if these do not match.
const COMPARED: usize = 2;
const COMPARED_AGAIN: usize = 6;
/// Pairs with matches that say something about a scene.
const FEWEST_PAIRS: usize = 3;
/// Share of the pairs that agree if the poses as a whole are right, and if another reading of them is.
const RIGHT: f64 = 0.5;
const OTHER_RIGHT: f64 = 0.6;
/// Share of the pairs of a view that disagree if its pose is wrong, and the fewest pairs that say so.
const MOST_OF_A_VIEW: f64 = 0.7;
const FEWEST_OF_A_VIEW: usize = 2;
/// Share of the views that match others, keypoints of a view and views it is compared with, so that it is strange that it matches
/// none of them.
const MATCHING: f64 = 0.8;
const MANY_KEYPOINTS: usize = 150;
const FEWEST_COMPARED: usize = 3;
/// Points that a reconstruction saw in a view, so that it matched others there. Whether the file is still that of these points is
/// told by their colours.
const FEWEST_OBSERVED: usize = 20;
/// Number of views beside a view without matches that are compared with each other, and the fewest pairs of them that must agree.
const WITNESSES: usize = 4;
const FEWEST_WITNESSING: usize = 2;

/// How well the stated cameras of a scene fit its photographs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PoseCheck {
    /// Number of views that were looked at.
    pub views: usize,
    /// Number of pairs of views with matches, and of these matches.
    pub pairs: usize,
    /// See [`PoseCheck::pairs`].
    pub matches: usize,
    /// Median distance of matches from their epipolar lines, pixels of the images as read; none without matches.
    pub median_px: Option<f64>,
    /// The view with the largest median distance.
    pub worst: Option<ViewResidual>,
    /// What the photographs say against the cameras.
    pub findings: Vec<PoseFinding>,
}

/// The residual of a view.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViewResidual {
    /// Its name.
    pub view: String,
    /// Median over its pairs of their median distances from epipolar lines, pixels of the image as read.
    pub median_px: f64,
}

/// A pair and its residual with the stated poses, pixels; infinite if points would lie behind the cameras.
struct Fitted {
    pair: MatchedPair,
    px: f64,
}

impl Fitted {
    fn agrees(&self) -> bool {
        self.pair.agrees(self.px)
    }

    fn has(&self, view: usize) -> bool {
        self.pair.views.contains(&view)
    }
}

impl PoseCheck {
    /// Compares views of a scene with each other. Images that cannot be read are passed over.
    #[must_use]
    pub fn of(views: &[PerspectiveView], points: &[ScenePoint]) -> Self {
        let step = views.len().div_ceil(MOST_VIEWS).max(1);
        let views: Vec<&PerspectiveView> = views.iter().step_by(step).collect();
        let cameras: Vec<PinholeCamera> = views.iter().map(|v| v.camera).collect();
        let pose = |c: &PinholeCamera| Pose { cam_from_world: c.cam_from_site, center: c.center };
        let poses: Vec<Pose> = cameras.iter().map(pose).collect();
        let features: Vec<Option<ViewFeatures>> =
            views.par_iter().map(|view| ViewFeatures::of(view)).collect();
        let beside = neighbours(&cameras, &usual_depths(&cameras, points), COMPARED_AGAIN);
        let is_reconstructed: Vec<bool> = views.iter().map(|v| v.observed.len() >= FEWEST_OBSERVED).collect();
        let all = Views {
            features: &features,
            poses: &poses,
            is_reconstructed: &is_reconstructed,
            neighbours: &beside,
        };
        let (pairs, compared) = all.matched();
        let residual = |pair: MatchedPair| {
            let px = pair.residual_px(pair.views.map(|v| &poses[v]))?;
            Some(Fitted { pair, px })
        };
        let fitted: Vec<Fitted> = pairs.into_iter().filter_map(residual).collect();
        let name = |i: usize| views[i].name.clone();
        let findings = findings(&all, &fitted, &compared, &name);
        let distances = |f: &Fitted| f.pair.distances_px(f.pair.views.map(|v| &poses[v]), 1.0);
        let of_view = |i: usize| {
            let px = median(fitted.iter().filter(|f| f.has(i)).map(|f| f.px).collect())?;
            Some(ViewResidual { view: name(i), median_px: px }).filter(|_| px.is_finite())
        };
        let worst = (0..views.len()).filter_map(of_view).max_by(|a, b| a.median_px.total_cmp(&b.median_px));
        Self {
            views: views.len(),
            pairs: fitted.len(),
            matches: fitted.iter().map(|f| f.pair.matches.rays.len()).sum(),
            median_px: median(fitted.iter().flat_map(distances).collect()),
            worst,
            findings,
        }
    }

    /// What the user should know, each with what to do about it.
    pub fn warnings(&self) -> impl Iterator<Item = String> {
        self.findings.iter().map(|finding| format!("{finding}; {}", finding.next_step()))
    }

    /// What makes training on the scene useless, if something does: poses in another convention.
    #[must_use]
    pub fn refusal(&self) -> Option<&PoseFinding> {
        self.findings.iter().find(|f| matches!(f, PoseFinding::Convention { .. }))
    }
}

impl fmt::Display for PoseCheck {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Some(median_px) = self.median_px else {
            return write!(f, "poses: not checked, no features match between views");
        };
        write!(
            f,
            "poses: {} matched features of {} pairs of views lie {median_px:.2} px (median) from their epipolar lines",
            self.matches, self.pairs
        )?;
        if let Some(ViewResidual { view, median_px }) = &self.worst {
            write!(f, ", those of `{view}`, the worst, {median_px:.2} px")?;
        }
        Ok(())
    }
}

impl Views<'_> {
    /// Pairs with matches, and with how many others each view was compared.
    fn matched(&self) -> (Vec<MatchedPair>, Vec<usize>) {
        let count = self.poses.len();
        let mut tried: BTreeSet<[usize; 2]> = BTreeSet::new();
        let mut found: Vec<MatchedPair> = Vec::new();
        let mut add = |tried: &mut BTreeSet<[usize; 2]>, wanted: BTreeSet<[usize; 2]>| {
            let new: Vec<[usize; 2]> = wanted.difference(tried).copied().collect();
            tried.extend(&new);
            found.extend(MatchedPair::find(self.features, &new));
            (0..count).filter(|i| !found.iter().any(|pair| pair.views.contains(i))).collect::<Vec<usize>>()
        };
        let pair = |i: usize, j: usize| [i.min(j), i.max(j)];
        let beside = |i: usize, most: usize| self.neighbours[i].iter().take(most).map(move |j| pair(i, *j));
        // Images whose names follow each other mostly see the same, whatever their poses.
        let next = |i: usize, by: usize| (i + by < count).then(|| [i, i + by]);
        let first = (0..count).flat_map(|i| beside(i, COMPARED).chain(next(i, 1))).collect();
        let unmatched = add(&mut tried, first);
        let again = unmatched.iter().flat_map(|i| {
            beside(*i, COMPARED_AGAIN).chain(next(*i, 2)).chain(i.checked_sub(2).map(|j| [j, *i]))
        });
        // Whether the views beside one without matches match each other tells whether it should.
        let among = unmatched.iter().flat_map(|i| {
            let beside = &self.neighbours[*i][..self.neighbours[*i].len().min(WITNESSES)];
            beside.iter().flat_map(move |a| beside.iter().filter(move |b| a < *b).map(move |b| [*a, *b]))
        });
        add(&mut tried, again.chain(among).collect());
        let compared = (0..count).map(|i| tried.iter().filter(|pair| pair.contains(&i)).count()).collect();
        (found, compared)
    }
}

fn share(part: usize, all: usize) -> f64 {
    part as f64 / all.max(1) as f64
}

fn findings(
    views: &Views,
    fitted: &[Fitted],
    compared: &[usize],
    name: &dyn Fn(usize) -> String,
) -> Vec<PoseFinding> {
    if fitted.len() < FEWEST_PAIRS {
        return Vec::new();
    }
    let agree = share(fitted.iter().filter(|f| f.agrees()).count(), fitted.len());
    let mut out = Vec::new();
    if agree < RIGHT
        && let Some(found) = other_reading(views, fitted, agree)
    {
        return vec![found];
    }
    let doubted = misplaced(fitted, agree);
    let sound = |f: &&Fitted| f.px.is_finite() && !f.pair.views.iter().any(|v| doubted.contains(v));
    let pairs: Vec<&MatchedPair> = fitted.iter().filter(sound).map(|f| &f.pair).collect();
    if let Some(fit) = other_focal(&pairs, views.poses) {
        out.push(PoseFinding::Focal { factor: fit.factor, px: fit.px });
        return out;
    }
    if agree < RIGHT {
        let px = median(fitted.iter().map(|f| f.px).collect()).unwrap_or(0.0);
        out.push(PoseFinding::Inaccurate { px, agree });
        return out;
    }
    let has_pair = |i: usize| fitted.iter().any(|f| f.has(i));
    let matching = share((0..views.poses.len()).filter(|i| has_pair(*i)).count(), views.poses.len());
    let is_rich = |i: usize| views.features[i].as_ref().is_some_and(|f| f.len() >= MANY_KEYPOINTS);
    // The views beside it see the same by their poses, and by what they show.
    let is_between = |i: usize| {
        let beside = &views.neighbours[i];
        let is_inside = |f: &&Fitted| f.agrees() && f.pair.views.iter().all(|v| beside.contains(v));
        fitted.iter().filter(is_inside).count() >= FEWEST_WITNESSING
    };
    // A view of a reconstruction has matched others there, in more detail than here.
    let may_be_strange = |i: usize| !has_pair(i) && is_rich(i) && !views.is_reconstructed[i];
    let is_strange = |i: &usize| may_be_strange(*i) && compared[*i] >= FEWEST_COMPARED && is_between(*i);
    let strange: Vec<usize> = match matching >= MATCHING {
        true => (0..views.poses.len()).filter(is_strange).collect(),
        false => Vec::new(),
    };
    // A single pair that disagrees is no proof, but it may be of the image that was exchanged with one in doubt.
    let is_weak = |i: &usize| {
        let mut pairs = fitted.iter().filter(|f| f.has(*i)).peekable();
        !doubted.contains(i) && pairs.peek().is_some() && pairs.all(|f| !f.agrees())
    };
    let weak = (0..views.poses.len()).filter(is_weak);
    let all: Vec<usize> = doubted.iter().chain(&strange).copied().chain(weak).collect();
    let exchanged = views.exchanged(&all);
    out.extend(exchanged.iter().map(|pair| PoseFinding::Exchanged { views: pair.map(name) }));
    let is_explained = |i: &usize| exchanged.iter().any(|pair| pair.contains(i));
    for i in doubted.iter().filter(|i| !is_explained(i)) {
        let px = median(fitted.iter().filter(|f| f.has(*i)).map(|f| f.px).collect());
        out.push(PoseFinding::Misplaced { view: name(*i), px: px.filter(|px| px.is_finite()) });
    }
    for i in strange.iter().filter(|i| !is_explained(i)) {
        out.push(PoseFinding::Unmatched { view: name(*i), compared: compared[*i] });
    }
    out
}

/// The reading of all poses that fits most pairs, if they are as many as of right poses.
fn other_reading(views: &Views, fitted: &[Fitted], agree: f64) -> Option<PoseFinding> {
    let residuals = |reading: &Reading| {
        let poses: Vec<Pose> = views.poses.iter().map(|pose| reading.of(pose)).collect();
        let of = |f: &Fitted| f.pair.residual_px(f.pair.views.map(|v| &poses[v])).unwrap_or(f64::INFINITY);
        fitted.par_iter().map(of).collect::<Vec<f64>>()
    };
    let agreeing =
        |px: &[f64]| share(fitted.iter().zip(px).filter(|(f, px)| f.pair.agrees(**px)).count(), fitted.len());
    let scored = Reading::others().map(|reading| {
        let px = residuals(&reading);
        (agreeing(&px), reading, px)
    });
    let (fitted_agree, reading, px) = scored.max_by(|a, b| a.0.total_cmp(&b.0))?;
    // Of poses as stated, also distances of points behind the cameras are told.
    let stated = |f: &Fitted| median(f.pair.distances_px(f.pair.views.map(|v| &views.poses[v]), 1.0));
    let stated_px = median(fitted.iter().filter_map(stated).collect())?;
    (fitted_agree >= OTHER_RIGHT && fitted_agree > 1.5 * agree).then_some(PoseFinding::Convention {
        reading: reading.to_string(),
        px: [stated_px, median(px)?],
        agree: [agree, fitted_agree],
    })
}

/// Views that do not fit their poses, those first of which most pairs disagree; none if the poses as a whole are wrong.
fn misplaced(fitted: &[Fitted], agree: f64) -> Vec<usize> {
    let mut out: Vec<usize> = Vec::new();
    if agree < RIGHT {
        return out;
    }
    loop {
        let left: Vec<&Fitted> = fitted.iter().filter(|f| !out.iter().any(|i| f.has(*i))).collect();
        let views: BTreeSet<usize> = left.iter().flat_map(|f| f.pair.views).collect();
        let disagreeing = |i: usize| {
            let (mut off, mut all) = (0, 0);
            for f in left.iter().filter(|f| f.has(i)) {
                all += 1;
                off += usize::from(!f.agrees());
            }
            (all >= FEWEST_OF_A_VIEW && share(off, all) >= MOST_OF_A_VIEW).then(|| (off, share(off, all)))
        };
        let worst = views.iter().filter_map(|i| disagreeing(*i).map(|d| (*i, d)));
        match worst.max_by(|a, b| a.1.1.total_cmp(&b.1.1).then(a.1.0.cmp(&b.1.0)).then(b.0.cmp(&a.0))) {
            Some((i, _)) => out.push(i),
            None => return out,
        }
    }
}
