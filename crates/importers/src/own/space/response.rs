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
use crate::own::{Agreement, Remark};

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
    /// Number of contacts of the calibration that the readings do not contradict, and of those to which the whisker does not reach.
    pub(super) contacts: usize,
    pub(super) unreached: usize,
    /// Number of rows of the calibration whose readings are far too small for their contact.
    pub(super) weak: usize,
}

/// Known contacts of a calibration.
struct Known {
    /// Number of contacts, without those that the readings contradict.
    contacts: usize,
    /// Number of rows whose readings are far too small for their contact.
    weak: usize,
    /// Moments of the rod (N m) and readings relative to rest, both 2x1, of the contacts to which the whisker reaches.
    pairs: Vec<(Vector2<f64>, Vector2<f64>)>,
}

impl Fitted {
    /// Fit to the moments of the rod at the contacts of a calibration.
    ///
    /// # Errors
    /// [`Error::Value`] if the contacts do not determine it.
    pub(super) fn new(
        path: &Path,
        calibration: &[&Sampled<'_, Space>],
        mechanics: &Mechanics,
        touch: f64,
    ) -> Result<Self, Error> {
        // Without a response, the side of the pin is that of `side_of_axis`, and the contacts contain those of a free whisker. With a
        // response, the side agrees with the readings, and such contacts are left out. The sides found in the two ways may differ in light touches.
        let known = Known::new(calibration, mechanics, touch, None);
        check_known_contacts(path, KEY, calibration.len(), known.contacts, touch)?;
        let response = known.rough().ok_or_else(|| known.undetermined(path))?;
        let known = Known::new(calibration, mechanics, touch, Some(&response));
        let response = BendingResponse::fit(&known.pairs).ok_or_else(|| known.undetermined(path))?;
        let Known { contacts, weak, pairs } = known;
        let residual_counts = response.residual_counts(&pairs);
        let squares: f64 = pairs.iter().map(|(_, counts)| counts.norm_squared()).sum();
        let residual = residual_counts.norm() / (squares / pairs.len() as f64).sqrt();
        Ok(Self { response, residual_counts, residual, contacts, unreached: contacts - pairs.len(), weak })
    }

    /// Remark about the agreement of the calibration with the rod.
    pub(super) fn remark(&self) -> Remark {
        let Self { residual, contacts, unreached, weak, .. } = *self;
        Agreement { residual, contacts, unreached, weak }.remark(
            "the rod",
            " unless the sensor is nonlinear",
            "compare `whisker`, `base` and `contact` of the mapping with the recordings, look for saturated, drifting or delayed \
             readings, and raise `touch` if the whisker oscillates while it is free",
        )
    }
}

impl Known {
    /// Contacts of a calibration. `response` is that by which the side of a pin is found.
    fn new(
        calibration: &[&Sampled<'_, Space>],
        mechanics: &Mechanics,
        touch: f64,
        response: Option<&BendingResponse>,
    ) -> Self {
        let (mut contacts, mut weak, mut pairs) = (0, 0, Vec::new());
        for recording in calibration {
            for (row, contact) in recording.contacts(mechanics, touch, response).into_iter().enumerate() {
                weak += usize::from(contact == Contact::Weak);
                contacts += usize::from(!matches!(contact, Contact::Unknown | Contact::Weak));
                pairs.extend(contact.moment_n_m(mechanics).map(|moment_n_m| (moment_n_m, recording.counts(row))));
            }
        }
        Self { contacts, weak, pairs }
    }

    /// Inverse of the linear fit of the moments to the readings. The small readings of a free whisker have little leverage in it. `None` if the contacts do not determine it.
    fn rough(&self) -> Option<BendingResponse> {
        let exchanged: Vec<_> = self.pairs.iter().map(|(moment_n_m, counts)| (*counts, *moment_n_m)).collect();
        BendingResponse::new(BendingResponse::fit(&exchanged)?.response().try_inverse()?)
    }

    fn undetermined(&self, path: &Path) -> Error {
        let Self { contacts, weak, pairs } = self;
        let mut found =
            format!("none, and {} of {contacts} contacts of the calibration within reach of the whisker", pairs.len());
        if *weak > 0 {
            found += &format!(", and {weak} further contacts whose readings are far smaller than those of the rod");
        }
        let cause = match (pairs.is_empty(), *weak) {
            (true, 0) => "; compare units and `base` of the mapping",
            (_, 0) => "",
            _ => {
                "; compare `whisker`, `base` and `contact` of the mapping, and raise `touch` if the whisker oscillates while it is free"
            }
        };
        let expected = format!(
            "contacts from several directions about the whisker, which determine the response to both bending moments, or a \
             stated response{cause}"
        );
        Error::value(path, KEY, found, expected)
    }
}

/// Factor by which a stated response is multiplied so that a wrong scale of the sensor or the whisker does not contradict all
/// contacts: the median ratio of the readings of contacts to those of the response, weighted by the readings. 1 without contacts.
pub(super) fn scale(
    recordings: &[&Sampled<'_, Space>],
    mechanics: &Mechanics,
    touch: f64,
    response: &BendingResponse,
) -> f64 {
    let known = Known::new(recordings, mechanics, touch, None);
    let ratio = |(moment_n_m, counts): &(Vector2<f64>, Vector2<f64>)| {
        let size = counts.norm();
        (size / response.counts(*moment_n_m).norm(), size)
    };
    let mut ratios: Vec<(f64, f64)> =
        known.pairs.iter().map(ratio).filter(|(ratio, size)| ratio.is_finite() && *size > 0.0).collect();
    ratios.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * ratios.iter().map(|(_, weight)| weight).sum::<f64>();
    let mut sum = 0.0;
    let median = ratios.iter().find(|(_, weight)| {
        sum += weight;
        sum >= half
    });
    median.map_or(1.0, |(ratio, _)| *ratio)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robust_contacts_that_are_left_out_are_stated_in_the_error() {
        let error = |contacts, weak| Known { contacts, weak, pairs: Vec::new() }.undetermined(Path::new("import.json"));
        let (unreached, weak) = (error(7, 0).to_string(), error(0, 12).to_string());
        assert!(
            unreached
                .contains("found none, and 0 of 7 contacts of the calibration within reach of the whisker, expected")
                && unreached.ends_with("; compare units and `base` of the mapping"),
            "{unreached}"
        );
        assert!(
            weak.contains(
                "within reach of the whisker, and 12 further contacts whose readings are far smaller than those of the rod, expected"
            ) && weak.ends_with("raise `touch` if the whisker oscillates while it is free"),
            "{weak}"
        );
    }
}
