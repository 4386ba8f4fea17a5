//! Scoring: estimates of one estimator on one trial against the truth.

use testbed::bound::TraceBound;
use testbed::contour::{Comparison, Contour, Touched};
use testbed::map::View;
use testbed::metrics::{Scored, Scores, Trial, Unscored, contour};
use testbed::replay::Replay;
use testbed::results::{ContourTrialRow, QuantityRow, TrialHead, TrialRow};
use whisker::estimators::ModelShares;

use super::contours::trial_row;
use super::job::{Replayed, TrialJob, TrialOutput};
use super::maps::MapView;
use super::quantities::quantity_rows;
use super::sense::Sensed;
use super::shards::EstimatorResult;
use super::tables::{self, OverTime};
use super::write;

impl TrialJob<'_> {
    /// Scores a replay, adds the results to the output, and writes the tables by instant if the job has a folder.
    ///
    /// # Errors
    /// If a table cannot be written.
    pub(super) fn score(
        &self,
        sensed: &Sensed<'_>,
        replayed: &Replayed<'_>,
        output: &mut TrialOutput,
    ) -> anyhow::Result<()> {
        let trial = self.trial(sensed, replayed);
        let (estimator, replay) = (replayed.estimator, &replayed.replay);
        let results = &mut output.results;
        results.failures.extend(replay.failure.iter().map(|reason| self.failure(Some(estimator), reason.clone())));
        match self.map_view(&trial, estimator, replay) {
            Ok(view) => output.views.extend(view),
            Err(error) => results.failures.push(self.failure(Some(estimator), format!("{error:#}"))),
        }
        let points = trial.surface_points(replay);
        let contour = trial.contour(replay, &points, 0).filter(|_| self.loaded.spec.array.is_none());
        if let Some(folder) = self.out {
            write::replayed(folder, &trial, replayed, contour.as_ref())?;
        }
        let scored = match Scored::new(&trial, replay, &points, contour.as_ref()) {
            Ok(scored) => Some(scored),
            Err(Unscored::TruthUnknown) => None,
            Err(Unscored::NeverTouches) => return Ok(()),
        };
        if self.loaded.spec.sidecar.object_class().has_outline() {
            results.contours.push(self.contour_row(&trial, estimator, contour.as_ref(), scored.as_ref()));
        }
        let is_known = self.loaded.spec.knows_quantities();
        if let Some(scored) = scored.as_ref().filter(|_| is_known) {
            results.quantities.extend(self.quantity_rows(sensed, estimator, scored));
        }
        results.estimators.extend(scored.map(|scored| self.estimator_result(estimator, replay, &scored)));
        Ok(())
    }

    /// Contribution to the map of the recording. `None` if the trial is a trace by itself.
    fn map_view(&self, trial: &Trial<'_>, estimator: &str, replay: &Replay) -> anyhow::Result<Option<MapView>> {
        let Some(member) = &self.loaded.spec.array else { return Ok(None) };
        Ok(Some(MapView {
            view: View::new(trial, replay, member.whisker(), &self.settings.map)?,
            member: member.clone(),
            group: trial.trace.sidecar.group.clone(),
            estimator: estimator.into(),
            noise: self.noise(),
            seed: self.seed,
        }))
    }

    /// Row of `contour_trials.csv`. Without a known contact the outline is still compared with the true one.
    fn contour_row(
        &self,
        trial: &Trial<'_>,
        estimator: &str,
        contour: Option<&Contour>,
        scored: Option<&Scored<'_>>,
    ) -> ContourTrialRow {
        let compared = match scored {
            Some(scored) => scored.contour,
            None => contour
                .zip(trial.outline)
                .map(|(contour, outline)| Comparison::new(contour, outline, &Touched::default())),
        };
        ContourTrialRow {
            estimator: estimator.into(),
            noise: self.noise(),
            seed: self.seed,
            contact_rmse_m: scored.and_then(contour::CONTACT_RMSE.measure),
            ..trial_row(&trial.trace.sidecar, contour, compared)
        }
    }

    fn quantity_rows(&self, sensed: &Sensed<'_>, estimator: &str, scored: &Scored<'_>) -> Vec<QuantityRow> {
        let sidecar = &scored.trial.trace.sidecar;
        let of_trial = QuantityRow {
            trace: sidecar.name.clone(),
            group: sidecar.group.clone(),
            whisker: sidecar.whisker.name.clone(),
            object: sidecar.object.clone(),
            estimator: estimator.into(),
            noise: self.noise(),
            seed: self.seed,
            ..QuantityRow::default()
        };
        let bounds = sensed.bound.and_then(TraceBound::quantities);
        quantity_rows(scored, &self.loaded.spec.miscalibration, bounds, &of_trial)
    }

    fn estimator_result(&self, estimator: &str, replay: &Replay, scored: &Scored<'_>) -> EstimatorResult {
        let stated = scored.contacts.iter().filter_map(|contact| replay.estimates[contact.row]?.models);
        let models = tables::mean_shares(stated);
        let sidecar = &scored.trial.trace.sidecar;
        let head = TrialHead {
            trace: sidecar.name.clone(),
            group: sidecar.group.clone(),
            whisker: sidecar.whisker.name.clone(),
            object: sidecar.object.clone(),
            estimator: estimator.into(),
            noise: self.noise(),
            seed: self.seed,
            touch_s: scored.touch_s,
            samples: scored.steady().len(),
            missing: scored.missing(),
            models: models.map(|models| models.to_string()),
        };
        EstimatorResult {
            row: TrialRow { head, scores: Scores::of(scored) },
            models: models.iter().flat_map(ModelShares::iter).map(|(name, share)| (name.into(), share)).collect(),
            over_time: OverTime::of(scored),
            elapsed_ns: replay.elapsed_ns as u64,
            steps: scored.trial.readings_n_m.len(),
        }
    }
}
