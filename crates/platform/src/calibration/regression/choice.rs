//! Choice of a regression by its errors at places that were held out.

use super::{Fit, REGRESSIONS, RegressionRow};
use crate::calibration::cross_validation::{HoldOut, Progress, cross_validate, inner};
use crate::calibration::{Error, LabelledPress};

/// A regression and its error at held-out inner places.
pub struct Candidate {
    /// Its row in the registry.
    pub row: &'static RegressionRow,
    /// Root mean square error (m), each place estimated by the regression without it; or the reason why there is none.
    pub rmse_m: Result<f64, Error>,
}

/// Every live regression with its error at held-out inner places, the smallest error first. The nearest and the
/// farthest place, at which the regression without them would extrapolate, do not count unless there are no others.
pub fn by_places(presses: &[LabelledPress], progress: &mut Progress<'_>) -> Vec<Candidate> {
    let inner = inner(presses);
    let rmse_m = |row, progress: &mut Progress<'_>| {
        let validation = cross_validate(row, presses, HoldOut::Place, progress)?;
        let rmse_m = validation.rmse_m(|i| inner[i]).or(validation.rmse_m(|_| true));
        rmse_m.filter(|rmse_m| rmse_m.is_finite()).ok_or(Error::Undetermined(row.name))
    };
    let live = REGRESSIONS.iter().filter(|row| matches!(row.fit, Fit::Live(_)));
    let mut candidates: Vec<Candidate> = live.map(|row| Candidate { row, rmse_m: rmse_m(row, progress) }).collect();
    let key = |candidate: &Candidate| *candidate.rmse_m.as_ref().unwrap_or(&f64::INFINITY);
    candidates.sort_by(|a, b| key(a).total_cmp(&key(b)));
    candidates
}
