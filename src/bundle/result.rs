//! The result of an adjustment: corrected cameras, sparse points, residuals, precision and the report.

use super::adjuster::Adjuster;
use super::control_check::control_report;
use super::error::BundleError;
use super::network::Estimate;
use super::options::BundleOptions;
use super::output::{Adjustment, PointQuality, SparsePoint, TiePointObservation};
use super::report::{Report, ViewReport};
use super::used_view::UsedView;
use crate::progress::Event;
use crate::rpc::Rpc;

impl Adjuster<'_> {
    /// What defines the datum.
    fn gauge(&self, options: &BundleOptions) -> String {
        let cameras = self.gauge_of_cameras(options);
        match &options.height_prior {
            Some(prior) if !options.fixed => {
                format!("{cameras}; heights of the elevation model to {} m", prior.sigma_m)
            }
            _ => cameras,
        }
    }

    fn gauge_of_cameras(&self, options: &BundleOptions) -> String {
        match (options.fixed, self.control.is_empty(), options.reference.as_slice()) {
            (true, ..) => "cameras as delivered, not corrected".into(),
            (false, true, []) => "mean of the delivered cameras: robust priors on the shifts".into(),
            (false, false, []) => "ground control".into(),
            (false, true, names) => format!("reference views {}", names.join(", ")),
            (false, false, names) => format!("ground control and reference views {}", names.join(", ")),
        }
    }

    /// Gathers the result; with fixed cameras that of the cameras as delivered.
    ///
    /// # Errors
    /// [`BundleError::Solver`] when a point is not determined by its rays, [`BundleError::Refit`].
    pub(super) fn result(
        &self,
        estimate: &Estimate,
        options: &BundleOptions,
    ) -> Result<Adjustment, BundleError> {
        let block = self.network.block();
        let given = self.network.as_delivered(&estimate.tracks);
        let Estimate { corrections, tracks, points } = if options.fixed { &given } else { estimate };
        let before = self.network.distances(&given);
        let after = if options.fixed { before.clone() } else { self.network.distances(estimate) };
        let of = |all: &[(usize, f64)], view: usize| -> Vec<f64> {
            all.iter().filter(|d| d.0 == view).map(|d| d.1).collect()
        };
        let precision = |of: &Estimate, fixed: bool| {
            let undetermined =
                || BundleError::Solver { reason: "the rays of a point do not determine it".into() };
            self.network.precision(of, options.model, fixed).ok_or_else(undetermined)
        };
        let of_shifts = precision(estimate, false)?;
        let of_points = if options.fixed { precision(&given, true)?.points } else { of_shifts.points };
        let views = self.views.iter().enumerate().map(|(v, view)| {
            let sigma = of_shifts.corrections[v];
            ViewReport::new(&view.view.name, estimate.corrections[v], sigma, &of(&before, v), &of(&after, v))
        });
        let control = tracks.iter().zip(points).filter_map(|(t, p)| Some((t, t.prior?, p)));
        let control = control
            .flat_map(|(t, known, p)| t.observations.iter().map(move |m| (m, known, *p)).collect::<Vec<_>>());
        let control: Vec<_> = control
            .map(|(m, known, p)| {
                let residual_px = block.distance(m, &corrections[m.view], p);
                control_report(self.views[m.view].view, m, &known, p, residual_px, &options.control)
            })
            .collect();
        let none_agrees = !control.is_empty() && control.iter().all(|c| !c.agrees);
        for c in control.iter().filter(|c| !c.agrees) {
            self.progress.event(Event::Warning(format!(
                "ground control, line {}: the residual in `{}` is {:.1} px",
                c.line, c.view, c.residual_px
            )));
        }
        let gauge = match none_agrees && !options.fixed {
            true => {
                "priors on the shifts; the ground control, of which no point agrees, has little weight".into()
            }
            false => self.gauge(options),
        };
        let report = Report {
            gauge,
            rank_defect: of_shifts.rank_defect,
            sigma_px: of_shifts.sigma_px,
            model: options.model,
            tracks: tracks.iter().filter(|t| t.prior.is_none()).count(),
            control,
            views: views.collect(),
            left_out: self.left_out.clone(),
            ..Report::of(&before, &after)
        };
        let measured = tracks.iter().zip(&of_points).filter(|(t, _)| t.prior.is_none());
        let quality = measured
            .map(|(track, sigma_m)| PointQuality {
                sigma_m: *sigma_m,
                angle_deg: self.network.angle_deg(track),
            })
            .collect();
        let tied = tracks.iter().zip(points).filter(|(t, _)| t.prior.is_none()).enumerate();
        let (points, observations): (Vec<_>, Vec<_>) = tied
            .map(|(id, (track, p))| {
                let seen = track.observations.iter().map(|m| {
                    let predicted = block.project(m.view, &corrections[m.view], *p);
                    let residual_px = [m.px.col - predicted.col, m.px.row - predicted.row];
                    // The adjustment works in the pixels of the views' windows; the result is in those of whole images.
                    let px = self.views[m.view].view.px_of_whole(m.px);
                    TiePointObservation { point: id, view: m.view, px, residual_px }
                });
                let position = block.geodetic(*p);
                let views = track.observations.len() as u8;
                (SparsePoint { position, views, gray: track.gray }, seen.collect::<Vec<_>>())
            })
            .unzip();
        let whole = |(used, rpc): (&UsedView, Rpc)| (used.view.name.clone(), used.view.camera_of_whole(&rpc));
        let cameras = self.views.iter().zip(self.corrected(corrections)?).map(whole).collect();
        Ok(Adjustment { cameras, points, observations: observations.concat(), quality, report })
    }
}
