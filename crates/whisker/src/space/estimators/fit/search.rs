//! Levenberg-Marquardt search for the object that explains the readings, with a few readings per step.

use std::cmp::Ordering;

use filters::robust::logarithmic_cost;
use nalgebra::{Cholesky, Matrix2, Matrix2x4, SMatrix, SVector};

use super::correlated::Link;
use super::readings::Mean;
use crate::frames::{Base, Start};
use crate::space::estimators::motion::{Fitted, Object, Shape, TILT, TILT_S};
use crate::space::estimators::side::Side;
use crate::space::frames::Pose;
use crate::space::sensor::{Around, Axis};

/// Damping of the first step, its factors after accepted and rejected steps, and the damping that ends the search.
const FIRST_DAMPING: f64 = 1e-3;
const LESS: f64 = 0.1;
const MORE: f64 = 10.0;
const MOST_DAMPING: f64 = 1e4;

/// Expected decrease of the cost at which the search has converged: that of a seventh of a standard deviation.
const CONVERGED: f64 = 0.01;

/// Largest number of states that a search evaluates, including the first and the rejected ones.
pub(super) const MOST_TRIALS: usize = 5;

/// The same for a search that begins again from one of the first starts.
pub(super) const START_TRIALS: usize = 12;

/// Relative standard deviation of the tilt by inertia and damping, common to all contacts: errors of masses, frequency and damping.
/// Where the base moves to and fro, this tilt looks like another curvature of the object.
const DYNAMIC_SD: f64 = 0.4;

/// Work on a mean beside the search for its contact, in evaluations of the whisker's geometry.
const MEAN_WORK: usize = 2;

/// Prior of the state of a contact at its reference pose: independent entries.
#[derive(Clone, Copy, Debug)]
pub(super) struct Prior<const N: usize> {
    pub(super) mean: SVector<f64, N>,
    pub(super) sd: SVector<f64, N>,
}

/// Quadratic approximation of the cost: half the squared residuals of readings and prior in their standard deviations. The entry
/// of the tilt is held fixed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Quadratic<const N: usize> {
    pub(super) cost: f64,
    /// Sum over the means of half the logarithm of the ratio of the determinant of their covariance to that of the covariance to
    /// which the evidence compares it.
    log_spread: f64,
    gradient: SVector<f64, N>,
    curvature: SMatrix<f64, N, N>,
    /// Covariance of the gradient due to errors that are independent from reading to reading. If the links account for correlated
    /// errors of the sensor model, that of the changes from mean to mean, which includes the errors of the extrapolation.
    scatter: SMatrix<f64, N, N>,
    /// Gradients that errors add which are one standard deviation at all contacts: those of the sensor model, that of its
    /// extrapolation, that of the tilt, and that of the tilt by inertia and damping.
    pull: SMatrix<f64, N, 4>,
    /// Link of the last mean that the approximation includes. `None` if the errors of the sensor model are independent.
    last: Option<Link<N>>,
}

impl<const N: usize> Quadratic<N> {
    /// That of a prior at a state.
    fn of_prior(prior: &Prior<N>, x: &SVector<f64, N>) -> Self {
        let mut found = Self {
            cost: 0.0,
            log_spread: 0.0,
            gradient: SVector::zeros(),
            curvature: SMatrix::zeros(),
            scatter: SMatrix::zeros(),
            pull: SMatrix::zeros(),
            last: None,
        };
        for i in 0..N {
            let (away, weight) = (x[i] - prior.mean[i], prior.sd[i].powi(-2));
            if i == TILT {
                found.curvature[(i, i)] = 1.0;
            } else {
                found.cost += 0.5 * away * away * weight;
                found.gradient[i] = away * weight;
                found.curvature[(i, i)] = weight;
                found.scatter[(i, i)] = weight;
            }
        }
        found
    }

    /// Covariance of the state at a minimum. The inverse of the curvature maps errors of the gradient to errors of the state: those
    /// that are independent from reading to reading, and those that are common to all readings. Errors of the sensor model reduce
    /// the weight of a reading, but count only as common errors, unless the links account for them. The covariance of the tilt is
    /// zero. `None` unless the curvature is positive definite.
    pub(super) fn covariance(&self) -> Option<SMatrix<f64, N, N>> {
        let inverse = self.curvature.cholesky()?.inverse();
        let common = inverse * self.pull;
        Some(inverse * self.scatter * inverse + common * common.transpose())
    }

    /// Logarithm of the probability of the readings under the object, up to a constant, by Laplace's approximation.
    pub(super) fn log_evidence(&self, prior: &Prior<N>) -> Option<f64> {
        let volume: f64 = (0..N).filter(|i| *i != TILT).map(|i| prior.sd[i].ln()).sum();
        let determinant: f64 = self.curvature.cholesky()?.l().diagonal().iter().map(|entry| entry.ln()).sum();
        Some(-self.cost - self.log_spread - determinant - volume)
    }

    /// Damped step, and the expected decrease of the cost. `None` unless the curvature is positive definite.
    fn step(&self, damping: f64) -> Option<(SVector<f64, N>, f64)> {
        let mut damped = self.curvature;
        for i in 0..N {
            damped[(i, i)] *= 1.0 + damping;
        }
        let step = -damped.cholesky()?.solve(&self.gradient);
        Some((step, -(self.gradient.dot(&step) + 0.5 * step.dot(&(self.curvature * step)))))
    }
}

/// The means that an object is to explain, and the models of sensor and object that predict them.
pub(super) struct Evidence<'a, Model, const N: usize> {
    pub(super) side: &'a Side,
    pub(super) shape: &'a Model,
    pub(super) means: &'a [Mean],
    pub(super) gate_sds: f64,
}

impl<Model: Shape<N>, const N: usize> Evidence<'_, Model, N> {
    /// Adds the residual of one mean to the approximation about a state at `reference`; `near` is the contact from which that with
    /// the mean's pose is sought, and is replaced by it if there is one. Residuals beyond the gate count by their logarithm.
    /// Whether there is a contact. `work` grows by the evaluations of the whisker's geometry.
    fn add(
        &self,
        quadratic: &mut Quadratic<N>,
        about: &Fitted<Model::Object, N>,
        reference: &Pose<Base, Start>,
        mean: &Mean,
        near: &mut Around,
        work: &mut usize,
    ) -> bool {
        let Self { side, shape, .. } = self;
        let motion = reference.then(&mean.base().inverse());
        let object = about.object(&motion);
        *work += MEAN_WORK;
        let Some(found) = about.touched(side, *shape, (&object, &motion), *near, work) else {
            // A contact that does not exist is as improbable as an outlier.
            quadratic.cost += self.gate_sds.powi(2);
            return false;
        };
        let place = &found.0;
        *near = place.at;
        let (slopes, by_tilt, here) = about.contact_slopes(*shape, &motion, &found);
        let dynamic =
            about.dynamic_tilt(side, *shape, &motion, (place, &found.1, &here), &mean.response).with(&mean.swing);
        let expected = side.expect(Around::of_state(&(near.vector() + by_tilt * dynamic.rad)));
        let by_contact = expected.slopes;
        let mut slopes = by_contact * slopes;
        // The mean of an oscillation decreases with the duration of a stay, its variance with the square.
        let repeats = 1.0 + (mean.stay_s() / (2.0 * TILT_S)).powi(2);
        let by_dynamics = by_contact * by_tilt * (dynamic.rad * DYNAMIC_SD);
        let by_tilt = by_contact * by_tilt * dynamic.sd_rad();
        let inertia_n2_m2 = side.inertia_n_m(*near, mean.acceleration2.sqrt()).powi(2) / repeats;
        let noise_n2_m2 = side.noise_of_mean_n2_m2(mean.count);
        let mut independent = noise_n2_m2 + Matrix2::identity() * inertia_n2_m2 + by_tilt * by_tilt.transpose();
        let covariance = expected.covariance_n2_m2() + independent;
        let Some(mut factor) = covariance.cholesky() else { return false };
        let mut residual = expected.reading_n_m - mean.reading_n_m;
        let model = expected.model_n2_m2.cholesky().map_or_else(Matrix2::zeros, |factor| factor.l());
        let common = [model.column(0).into(), model.column(1).into(), expected.beyond_n_m, by_dynamics];
        let mut common = Matrix2x4::from_columns(&common);
        if let Some(length_m) = side.calibrated.error.correlation_m {
            let reference = side.reference_n2_m2(expected.model_n2_m2);
            quadratic.log_spread += 0.5 * (covariance.determinant() / reference.determinant()).ln();
            // The links account for the correlated errors of the model.
            common.fixed_columns_mut::<2>(0).fill(0.0);
            let place = mean.base().apply(side.middle);
            let model_n2_m2 = expected.model_n2_m2.trace();
            let share = (model_n2_m2 / (model_n2_m2 + noise_n2_m2.trace())).sqrt();
            let link = Link::new(&factor, (residual, slopes, common), place, share);
            (residual, slopes, common) = link.change_from(quadratic.last.as_ref(), length_m);
            (factor, independent) = (Cholesky::pack_dirty(Matrix2::identity()), Matrix2::identity());
            quadratic.last = Some(link);
        } else {
            quadratic.log_spread += expected.log_spread(&(expected.model_n2_m2 + independent)).unwrap_or(0.0);
        }
        let (solved_residual, solved_slopes) = (factor.solve(&residual), factor.solve(&slopes));
        let (cost, weight) = logarithmic_cost(residual.dot(&solved_residual), self.gate_sds);
        quadratic.cost += cost;
        quadratic.gradient += slopes.tr_mul(&solved_residual) * weight;
        quadratic.curvature += slopes.tr_mul(&solved_slopes) * weight;
        // The variance of an outlier counts as larger by the inverse of its weight.
        quadratic.scatter += solved_slopes.tr_mul(&(independent * solved_slopes)) * weight;
        quadratic.pull += slopes.tr_mul(&factor.solve(&common)) * weight;
        true
    }
}

/// A search from one state, in progress.
pub(super) struct Search<Body, const N: usize> {
    reference: Pose<Base, Start>,
    prior: Prior<N>,
    /// Contacts with the poses of the means, as far as they were found.
    near: Vec<Option<Around>>,
    /// The contact that was found last, with its pose.
    last: (Around, Pose<Base, Start>),
    /// The best state so far with the approximation about it.
    best: Option<(Fitted<Body, N>, Quadratic<N>)>,
    damping: f64,
    trials: usize,
    most_trials: usize,
    /// Cost after the next step, by the quadratic, above which the search is given up.
    most_cost: f64,
    /// The state that is evaluated, the approximation about it, and the number of means that this includes.
    trial: Fitted<Body, N>,
    quadratic: Quadratic<N>,
    done: usize,
}

impl<Body: Object, const N: usize> Search<Body, N> {
    /// A search from a state at `reference`, with the contact at the latest pose. `None` if the state is no contact.
    pub(super) fn new<Model: Shape<N, Object = Body>>(
        (side, shape): (&Side, &Model),
        reference: Pose<Base, Start>,
        prior: Prior<N>,
        x: &SVector<f64, N>,
        last: (Around, Pose<Base, Start>),
        most_trials: usize,
        most_cost: f64,
    ) -> Option<Self> {
        let trial = Fitted::new(side, shape, x)?;
        let quadratic = Quadratic::of_prior(&prior, x);
        let near = Vec::new();
        Some(Self {
            reference,
            prior,
            near,
            last,
            best: None,
            damping: FIRST_DAMPING,
            trials: 0,
            most_trials,
            most_cost,
            trial,
            quadratic,
            done: 0,
        })
    }

    /// Takes the residuals of means, from the latest to the first, and evaluates one state after another, until `work`, which grows
    /// by the evaluations of the whisker's geometry, reaches `most_work`. Whether the search has ended.
    pub(super) fn advance<Model: Shape<N, Object = Body>>(
        &mut self,
        evidence: &Evidence<'_, Model, N>,
        work: &mut usize,
        most_work: usize,
    ) -> bool {
        self.near.resize(evidence.means.len(), None);
        loop {
            while self.done < evidence.means.len() && !self.is_worse() {
                if *work >= most_work {
                    return false;
                }
                self.take(evidence, evidence.means.len() - 1 - self.done, work);
                self.done += 1;
            }
            *work += Fitted::<Body, N>::WORK;
            if self.conclude(evidence.side, evidence.shape) {
                return true;
            }
        }
    }

    /// Whether the means so far make the evaluated state no better than the best: no mean has a negative cost.
    fn is_worse(&self) -> bool {
        let is_less = |best: f64| self.quadratic.cost.partial_cmp(&best) == Some(Ordering::Less);
        self.best.as_ref().is_some_and(|(_, best)| !is_less(best.cost))
    }

    /// Takes the residual of a mean.
    fn take<Model: Shape<N, Object = Body>>(&mut self, evidence: &Evidence<'_, Model, N>, i: usize, work: &mut usize) {
        let mean = &evidence.means[i];
        // At first from the last contact, as if it rested.
        let mut near = self.near[i].unwrap_or_else(|| {
            let (at, base) = self.last;
            let axis = evidence.side.axis();
            Around::of(axis, base.then(&mean.base().inverse()).apply(at.contact(axis)))
        });
        if evidence.add(&mut self.quadratic, &self.trial, &self.reference, mean, &mut near, work) {
            self.near[i] = Some(near);
            self.last = (near, *mean.base());
        }
    }

    /// Accepts or rejects the evaluated state and begins the next one. Whether the search has ended.
    fn conclude<Model: Shape<N, Object = Body>>(&mut self, side: &Side, shape: &Model) -> bool {
        self.trials += 1;
        if !self.is_worse() {
            if self.best.is_some() {
                self.damping *= LESS;
            }
            self.best = Some((self.trial, self.quadratic));
        } else {
            self.damping *= MORE;
        }
        let Some((about, best)) = &self.best else { return true };
        while self.trials < self.most_trials && self.damping < MOST_DAMPING {
            let Some((step, decrease)) = best.step(self.damping) else { return true };
            // At the first state, the quadratic overestimates the cost of residuals beyond the gate.
            let is_hopeless = self.trials > 1 && best.cost - decrease > self.most_cost;
            if decrease < CONVERGED || is_hopeless {
                return true;
            }
            let mut moved = about.x + step;
            side.hold(&mut moved);
            if let Some(trial) = Fitted::new(side, shape, &moved) {
                self.quadratic = Quadratic::of_prior(&self.prior, &moved);
                (self.trial, self.done) = (trial, 0);
                return false;
            }
            self.damping *= MORE;
        }
        true
    }

    /// The contact found at the pose nearest to `base`: the one that `base` carries least far away.
    pub(super) fn nearest(&self, means: &[Mean], base: &Pose<Base, Start>, axis: &Axis) -> Option<Around> {
        let found = means.iter().zip(&self.near).filter_map(|(mean, near)| Some((mean.base(), (*near)?)));
        let distance_m = |(pose, near): &(&Pose<Base, Start>, Around)| {
            let contact = near.contact(axis);
            pose.apply(contact).distance(&base.apply(contact))
        };
        found.min_by(|a, b| distance_m(a).total_cmp(&distance_m(b))).map(|(_, near)| near)
    }

    /// The best state with the approximation about it.
    pub(super) fn best(self) -> Option<(Fitted<Body, N>, Quadratic<N>)> {
        self.best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean of readings with independent errors of variance `n` and one common error of variance `m` has the variance
    /// `n / readings + m`, whatever the weight of the readings.
    #[test]
    fn verif_common_errors_are_counted_once_and_not_reduced_by_the_number_of_readings() {
        let (n, m) = (4.0, 0.25_f64);
        let weight = 1.0 / (n + m);
        let variances = |readings: f64| {
            let on_diagonal =
                |value: f64| SMatrix::from_fn(|i, j| if i == j && i != TILT { readings * value } else { 0.0 });
            let mut curvature = on_diagonal(weight);
            curvature[(TILT, TILT)] = 1.0;
            let quadratic = Quadratic::<5> {
                cost: 0.0,
                log_spread: 0.0,
                gradient: SVector::zeros(),
                curvature,
                scatter: on_diagonal(weight * n * weight),
                pull: SMatrix::from_fn(|i, j| if (i, j) == (1, 0) { readings * weight * m.sqrt() } else { 0.0 }),
                last: None,
            };
            quadratic.covariance().unwrap().diagonal()
        };
        for readings in [10.0, 1e6] {
            let found = variances(readings);
            assert!((found[0] - n / readings).abs() < 1e-12 && found[TILT] == 0.0);
            assert!((found[1] - (n / readings + m)).abs() < 1e-12, "{found}");
        }
    }
}
