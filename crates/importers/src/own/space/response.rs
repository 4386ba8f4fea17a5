//! Response of a sensor with two channels, fitted to the known contacts of its calibration.

use std::path::Path;

use files::Error;
use nalgebra::Vector2;
use trace::BendingResponse;

use super::Space;
use super::contact::Contact;
use super::pin::Mechanics;
use crate::own::recording::Sampled;
use crate::own::rest::check_known_contacts;

/// Key of the mapping that states the response.
const KEY: &str = "reading.counts_per_n_m";

/// A response, and the readings that it does not explain.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fitted {
    pub(super) response: BendingResponse,
    /// RMS residual of each channel, 2x1.
    pub(super) residual_counts: Vector2<f64>,
    /// Size of the residuals relative to that of the readings (RMS).
    pub(super) residual: f64,
    /// Number of contacts of the calibration, and of those to which the whisker does not reach.
    pub(super) contacts: usize,
    pub(super) unreached: usize,
}

impl Fitted {
    /// Fit to the moments of the rod at the contacts of a calibration. `known` is the response by which the side of a pin is found.
    ///
    /// # Errors
    /// [`Error::Value`] if the contacts do not determine it.
    pub(super) fn new(
        path: &Path,
        calibration: &[&Sampled<'_, Space>],
        mechanics: &Mechanics,
        touch: f64,
        known: Option<&BendingResponse>,
    ) -> Result<Self, Error> {
        let (mut contacts, mut pairs) = (0, Vec::<(Vector2<f64>, Vector2<f64>)>::new());
        for recording in calibration {
            for (row, contact) in recording.contacts(mechanics, touch, known).into_iter().enumerate() {
                contacts += usize::from(contact != Contact::Unknown);
                pairs.extend(contact.moment_n_m(mechanics).map(|moment_n_m| (moment_n_m, recording.counts(row))));
            }
        }
        check_known_contacts(path, KEY, calibration.len(), contacts, touch)?;
        let response = BendingResponse::fit(&pairs).ok_or_else(|| {
            let found =
                format!("none, and {} of {contacts} contacts of the calibration within reach of the whisker", pairs.len());
            let cause = if pairs.is_empty() { "; compare units and `base` of the mapping" } else { "" };
            let expected = format!(
                "contacts from several directions about the whisker, which determine the response to both bending moments, or a \
                 stated response{cause}"
            );
            Error::value(path, KEY, found, expected)
        })?;
        let residual_counts = response.residual_counts(&pairs);
        let squares: f64 = pairs.iter().map(|(_, counts)| counts.norm_squared()).sum();
        let residual = residual_counts.norm() / (squares / pairs.len() as f64).sqrt();
        Ok(Self { response, residual_counts, residual, contacts, unreached: contacts - pairs.len() })
    }

    /// Remark about the agreement of the calibration with the mechanics of the whisker.
    pub(super) fn remark(&self) -> String {
        let percent = 100.0 * self.residual;
        let unreached = match (self.unreached, self.contacts) {
            (0, _) => String::new(),
            (unreached, all) => format!("; the whisker does not reach {unreached} of {all} contacts"),
        };
        format!(
            "the readings of the calibration deviate by {percent:.1} % (RMS) from those of the rod through the known contacts{unreached}"
        )
    }
}
