//! Evidence of a fit: that of the readings of the last round of searches, of those since, and of those before the fit began anew.

/// Logarithm of the evidence of the model.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct LogEvidence {
    /// That of all modes in the last round. `None` before the first has ended.
    round: Option<f64>,
    /// That of the readings since the means of that round were taken.
    pub(super) since: f64,
    /// That of the readings before the fit began anew. `None` if it never did.
    before: Option<f64>,
    /// That of all readings at the end of the last round in which they did not contradict the object. `None` if there was none.
    consistent: Option<f64>,
}

impl LogEvidence {
    /// That of all readings. A fit that began anew is one of two objects, one after the other, and has the evidence of both.
    pub(super) fn total(&self) -> Option<f64> {
        match self.round {
            Some(round) => Some(self.before.unwrap_or(0.0) + round + self.since),
            None => self.before,
        }
    }

    /// Whether a round has ended.
    pub(super) fn is_weighed(&self) -> bool {
        self.round.is_some()
    }

    /// That of a fit which began anew, if one object explains the readings of both fits: `of_all` is the evidence of the means of
    /// both, `since` that of the readings since these means were taken.
    pub(super) fn joined(&self, forerunner: &Self, of_all: f64, since: f64) -> Self {
        let joined = Self { round: Some(of_all), since, before: forerunner.before, consistent: None };
        joined.consistent()
    }

    /// Whether the fit began anew.
    pub(super) fn is_anew(&self) -> bool {
        self.before.is_some()
    }

    /// That after a round, `since` whose means were taken the readings have another. If the round has none, that of the readings
    /// since the last one still counts.
    pub(super) fn after(&self, round: Option<f64>, since: f64) -> Self {
        match round {
            Some(_) => Self { round, since, ..*self },
            None => *self,
        }
    }

    /// The same, after a round in which the readings do not contradict the object.
    pub(super) fn consistent(&self) -> Self {
        Self { consistent: self.total(), ..*self }
    }

    /// Decrease since the last round in which the readings did not contradict the object. 0 if there was none.
    pub(super) fn lost(&self) -> f64 {
        self.consistent.zip(self.total()).map_or(0.0, |(consistent, total)| (consistent - total).max(0.0))
    }

    /// That of a fit which began anew, with evidence restored that was lost before.
    pub(super) fn with_restored(&self, lost: f64) -> Self {
        let [before, consistent] =
            [self.before, self.consistent].map(|evidence| evidence.map(|evidence| evidence + lost));
        Self { before, consistent, ..*self }
    }

    /// That of a fit which begins anew.
    pub(super) fn anew(&self) -> Self {
        Self { before: self.total(), ..Self::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_a_round_without_a_solution_keeps_the_evidence_since_the_last_one() {
        let first = LogEvidence::default().after(Some(-80.0), -2.0);
        assert_eq!(first.total(), Some(-82.0));
        let later = LogEvidence { since: -20.0, ..first };
        assert_eq!(later.after(None, -5.0).total(), Some(-100.0));
        assert_eq!(later.after(Some(-90.0), -5.0).total(), Some(-95.0));
    }

    #[test]
    fn regress_a_fit_that_begins_anew_keeps_the_evidence_of_the_readings_before() {
        let mut evidence = LogEvidence::default();
        assert_eq!(evidence.total(), None);
        (evidence.round, evidence.since) = (Some(-80.0), -20.0);
        let mut anew = evidence.anew();
        assert_eq!(anew.total(), Some(-100.0), "a model that lost the contact is not forgiven");
        (anew.round, anew.since) = (Some(-5.0), 1.0);
        assert_eq!(anew.total(), Some(-104.0));
        assert_eq!(anew.anew().total(), Some(-104.0));
    }

    #[test]
    fn verif_the_evidence_of_one_object_replaces_that_of_two() {
        let first = LogEvidence::default().after(Some(-500.0), -20.0);
        let second = first.anew().after(Some(-30.0), -2.0);
        let joined = second.joined(&first, -60.0, -1.0);
        assert_eq!((second.total(), joined.total(), joined.is_anew()), (Some(-552.0), Some(-61.0), false));
        let third = second.anew().after(Some(-10.0), 0.0);
        assert_eq!(third.joined(&second, -45.0, 0.0).total(), Some(-565.0), "that of the first fit still counts");
    }

    #[test]
    fn verif_evidence_lost_by_a_contradiction_can_be_restored() {
        let first = LogEvidence::default().after(Some(-80.0), 0.0);
        assert_eq!(first.lost(), 0.0, "contradicted from the beginning");
        let contradicted = first.consistent().after(Some(-300.0), -20.0);
        assert_eq!(contradicted.lost(), 240.0);
        let anew = contradicted.anew().after(Some(-10.0), 0.0).consistent();
        assert_eq!((anew.total(), anew.lost()), (Some(-330.0), 0.0));
        let restored = anew.with_restored(240.0);
        assert_eq!((restored.total(), restored.lost()), (Some(-90.0), 0.0));
    }
}
