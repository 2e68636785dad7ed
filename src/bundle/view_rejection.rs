//! Which views contradict the others, or have too few tie points to be corrected.

use super::adjuster::Adjuster;
use super::problem::Track;
use super::report::LeftOut;

/// A view with fewer tie points is left out, unless half of the median view's are fewer still.
const MIN_OBSERVATIONS: usize = 20;
/// A view is left out when the fraction of its matches that survive the adjustment is below this multiple of the median
/// view's fraction. On JAX_068 and on simulated scenes sound views reach 0.87 of the median or more, an image rotated by
/// 2 degrees 0.33.
const MIN_KEPT_RATIO: f64 = 0.5;

impl Adjuster<'_> {
    /// The view that keeps the smallest fraction of its matches after the adjustment, if that is far less than what most
    /// views keep. `triangulated` and `kept` are the observations of each view before and after.
    ///
    /// An image that is slightly rotated, or that belongs to another camera, agrees with the others in a strip only. Of
    /// two views both keep the same fraction, so that neither can be told to be wrong.
    pub(super) fn worst_view(&self, triangulated: &[usize], kept: &[usize]) -> Option<LeftOut> {
        let share = |v: &usize| kept[*v] as f64 / triangulated[*v] as f64;
        let mut views: Vec<usize> = (0..self.views.len()).filter(|v| triangulated[*v] > 0).collect();
        views.sort_by(|a, b| share(a).total_cmp(&share(b)));
        let usual = share(views.get(views.len() / 2)?);
        tracing::debug!(
            "views keep {:.2} of their matches or more, half of them {usual:.2}",
            share(&views[0])
        );
        let worst = views.into_iter().find(|v| !self.network.is_fixed[*v])?;
        let reason = || {
            let (kept, triangulated) = (kept[worst], triangulated[worst]);
            format!(
                "only {kept} of {triangulated} matches agree with the other views: is the image rotated, or does the RPC belong to another image?"
            )
        };
        (share(&worst) < MIN_KEPT_RATIO * usual).then(|| (self.views[worst].view.name.clone(), reason()))
    }

    /// The view with the fewest tie points, if these are too few to determine its correction and far fewer than those of
    /// most views. Reference views and views of ground control are never named.
    pub(super) fn weakest_view(&self, tracks: &[Track]) -> Option<LeftOut> {
        let kept = self.observation_counts(tracks);
        let mut views: Vec<usize> = (0..self.views.len()).collect();
        views.sort_by_key(|v| kept[*v]);
        let needed = MIN_OBSERVATIONS.min(kept[views[views.len() / 2]] / 2);
        let surveyed =
            |v: usize| tracks.iter().any(|t| t.prior.is_some() && t.observations.iter().any(|m| m.view == v));
        let fewest = views.into_iter().find(|v| !self.network.is_fixed[*v] && !surveyed(*v))?;
        let reason = || format!("it has only {} tie points", kept[fewest]);
        (kept[fewest] < needed).then(|| (self.views[fewest].view.name.clone(), reason()))
    }
}
