//! Remarks on the trials of an evaluation: what a user must know of them besides the scores.

use std::collections::BTreeMap;

use testbed::metrics::ContactCount;
use testbed::results::SetName;
use whisker::sensor::Face;

use crate::plausibility::Finding;

/// Share of the contacts of a set outside of the calibrated domain above which it is remarked.
const MOST_OUTSIDE: f64 = 0.1;

/// Remarks on the trials of an evaluation, in the plane or in space.
#[derive(Clone, Debug, Default)]
pub struct TrialRemarks {
    /// Traces whose sampling rate contradicts their times, by name.
    pub rates: Vec<(String, Finding)>,
    /// Number of true contacts of each set, and of those outside the calibrated domain.
    pub contacts: BTreeMap<SetName, ContactCount>,
    /// Number of traces of each set in which the sign of the moment is that of a face that is not calibrated, by set and face.
    pub uncalibrated: BTreeMap<(SetName, Face), usize>,
}

impl TrialRemarks {
    /// The remarks, one line each.
    pub fn lines(&self) -> Vec<String> {
        [self.on_rates(), self.on_faces(), self.on_contacts()].into_iter().flatten().collect()
    }

    fn on_rates(&self) -> Option<String> {
        let ((first, finding), others) = self.rates.split_first()?;
        let names: Vec<String> = others.iter().map(|(name, _)| name.clone()).collect();
        let others = if names.is_empty() {
            String::new()
        } else {
            format!("; rate_hz also contradicts the times of {}", named(&names, 5))
        };
        Some(format!("{}{others}", on_rate(first, finding)))
    }

    fn on_faces(&self) -> Option<String> {
        let of_set = |((SetName { group, whisker }, face), count): (&(SetName, Face), &usize)| {
            let traces = if *count == 1 { "trace" } else { "traces" };
            format!("`{}` in {count} {traces} of `{group}` with `{whisker}`", face.name())
        };
        let sets: Vec<String> = self.uncalibrated.iter().map(of_set).collect();
        (!sets.is_empty()).then(|| {
            format!(
                "contacts with a face that is not calibrated have no estimate: the sign of the moment is that of {}; calibrate that face, or correct \
                 `face` or the sign of the moment",
                named(&sets, 5)
            )
        })
    }

    fn on_contacts(&self) -> Option<String> {
        let outside = self.contacts.iter().filter(|(_, count)| count.share_outside() > MOST_OUTSIDE);
        let of_set = |(SetName { group, whisker }, count): (&SetName, &ContactCount)| {
            format!("{} of {} in `{group}` with `{whisker}`", count.outside, count.all)
        };
        let sets: Vec<String> = outside.map(of_set).collect();
        (!sets.is_empty()).then(|| {
            format!(
                "many true contacts lie outside the calibrated domain: {}; `answered` does not count them: calibrate where the whisker is \
                 touched, or check frames and units with `whisker check`",
                named(&sets, 5)
            )
        })
    }
}

/// The first names, at most `most`, and the number of the others.
pub fn named(names: &[impl AsRef<str>], most: usize) -> String {
    let (first, others) = names.split_at(names.len().min(most));
    let first: Vec<&str> = first.iter().map(AsRef::as_ref).collect();
    let others = if others.is_empty() { String::new() } else { format!(" and {} more", others.len()) };
    first.join(", ") + &others
}

/// Remark on the sampling rate of a trace that contradicts its times.
pub fn on_rate(trace: &str, finding: &Finding) -> String {
    format!("{trace}: {finding}; the estimators rely on rate_hz")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plausibility::TimeSteps;

    #[test]
    fn verif_rates_faces_and_contacts_are_one_remark_each() {
        let steps: TimeSteps = (0..100).map(|row| 0.004 * f64::from(row)).collect();
        let finding = steps.contradiction_with(2500.0, None).unwrap();
        let set = |group: &str| SetName { group: group.into(), whisker: "straight".into() };
        let remarks = TrialRemarks {
            rates: ["pin_0", "pin_1"].map(|name| (name.into(), finding.clone())).into(),
            contacts: [
                (set("inside"), ContactCount { all: 100, outside: 10 }),
                (set("outside"), ContactCount { all: 200, outside: 180 }),
                (set("free"), ContactCount::default()),
            ]
            .into(),
            uncalibrated: [((set("pin"), Face::Right), 1), ((set("rod"), Face::Right), 2)].into(),
        };
        let [rates, faces, contacts] = &remarks.lines()[..] else { panic!("{remarks:?}") };
        assert!(
            rates.starts_with("pin_0: rate_hz: found 2500 with")
                && rates.ends_with("; rate_hz also contradicts the times of pin_1"),
            "{rates}"
        );
        assert!(
            faces.contains(": the sign of the moment is that of `right` in 1 trace of `pin` with `straight`, `right` in 2 traces of `rod` with"),
            "{faces}"
        );
        assert!(
            contacts.contains("outside the calibrated domain: 180 of 200 in `outside` with `straight`; "),
            "{contacts}"
        );
        assert_eq!(TrialRemarks::default().lines(), [""; 0]);
        assert_eq!(named(&["a", "b", "c"], 2), "a, b and 1 more");
        assert_eq!(named(&["a", "b"], 2), "a, b");
    }
}
