//! A trial in space: a trace with the noise of its readings, and the scores of estimates against its truth.

use std::sync::Arc;

use nalgebra::Vector3;
use statrs::distribution::{ChiSquared, ContinuousCDF};
use trace::{SpatialInstant, SpatialTrace, SpatialTruthInstant};
use whisker::space::estimators::{Estimate, Knowledge, Radius};
use whisker::space::frames::Point;
use whisker::space::sensor::CalibratedSpace;

use super::bound::{SpatialBoundAt, bound};
use super::object::TrueObject;
use super::rows::SpatialTrialRow;
use super::solid::Solid;
use super::to_base;
use crate::consistency::SPATIAL_NEES_FREEDOM;
use crate::metrics::{ContactCount, doubt};
use crate::statistics;

/// Time after the touch from which estimates are scored.
pub const START_S: f64 = 1.0;

/// Distance of the true point of the surface from an edge or corner within which the contact is one with this feature.
const FEATURE_M: f64 = 20e-6;

/// Probability of the ellipsoids and intervals whose coverage is measured.
const PROBABILITY: f64 = 0.95;

/// A trial in space: what does not depend on the estimator and the seed of the noise.
#[derive(Clone, Debug)]
pub struct SpatialTrial {
    /// The trace.
    pub trace: Arc<SpatialTrace>,
    /// Prior information available to an estimator.
    pub knowledge: Arc<Knowledge>,
    /// Bound at every instant; `None` while the whisker is free.
    bound: Vec<Option<SpatialBoundAt>>,
    /// Whether an estimate is expected at each instant.
    expected: Vec<bool>,
    object: Option<TrueObject>,
    solid: Option<Solid>,
}

/// Whether the true contact at each instant lies in the calibrated domain. `None` if it is unknown, at the tip or at several
/// places.
fn in_domain(trace: &SpatialTrace, calibrated: &CalibratedSpace) -> impl Iterator<Item = Option<bool>> {
    let instants = trace.recording.instants.iter().zip(&trace.truth.instants);
    instants.map(|(known, truth): (&SpatialInstant, &SpatialTruthInstant)| {
        let contact_m = truth.contact_m().filter(|_| truth.is_single())?;
        let at = calibrated.around(to_base(&known.base).apply(Point::from_vector(contact_m)));
        Some(calibrated.domain.contains(at))
    })
}

/// Number of true contacts of a trace in and outside of the calibrated domain.
pub fn contact_count(trace: &SpatialTrace, calibrated: &CalibratedSpace) -> ContactCount {
    in_domain(trace, calibrated).flatten().collect()
}

/// Sums of squared errors over a replay.
#[derive(Default)]
struct Sums {
    /// Instants at which an estimate is expected, and those of them with one.
    expected: usize,
    expected_answered: usize,
    /// Instants with an estimate, and those of them at which the true contact is completely known.
    answered: usize,
    complete: usize,
    contact: f64,
    out_of_plane: f64,
    bound: f64,
    object_bound: f64,
    objects: usize,
    direction_bound: f64,
    rods: usize,
    covered: usize,
    /// Instants before [`START_S`] with an estimate, and those of them at which its ellipsoid contains the true contact.
    early: usize,
    early_covered: usize,
    surface: f64,
    normal: f64,
    direction: f64,
    directions: usize,
    /// Distances from the touched edges and corners, and their numbers.
    edge: (f64, usize),
    corner: (f64, usize),
    nees: Vec<f64>,
    last_nees: Option<f64>,
    /// The last stated radius, and the bound of its variance relative to its square.
    last_radius: Option<(Radius, Option<f64>)>,
}

impl SpatialTrial {
    /// The trial of a trace whose estimators have this prior information.
    pub fn new(trace: Arc<SpatialTrace>, knowledge: Arc<Knowledge>) -> Self {
        let Knowledge { calibrated, noise_sd_n_m, .. } = &*knowledge;
        let solid = trace.sidecar.scene.get("solid").and_then(Solid::of_scene);
        let object = TrueObject::of(&trace, solid.as_ref());
        let bound = bound(&trace, calibrated, object.as_ref(), *noise_sd_n_m);
        let expected = in_domain(&trace, calibrated).map(|inside| inside == Some(true)).collect();
        Self { knowledge, bound, expected, object, solid, trace }
    }

    /// Bound at every instant of the trace; `None` while the whisker is free. Without noise it is undefined.
    pub fn bound(&self) -> &[Option<SpatialBoundAt>] {
        &self.bound
    }

    /// Whether an estimate is expected at each instant: whether the true contact lies in the calibrated domain, not at the tip and
    /// not at several places.
    pub fn expected(&self) -> &[bool] {
        &self.expected
    }

    /// The touched object. `None` if it is no rod, cylinder, edge or sphere.
    pub fn object(&self) -> Option<&TrueObject> {
        self.object.as_ref()
    }

    /// Scores of the estimates of one replay with the noise of a seed, one per instant of the trace.
    ///
    /// # Errors
    /// If the quantiles of the intervals cannot be computed.
    pub fn score(&self, estimator: &str, seed: u64, estimates: &[Option<Estimate>]) -> anyhow::Result<SpatialTrialRow> {
        let within = |degrees: f64| Ok::<_, anyhow::Error>(ChiSquared::new(degrees)?.inverse_cdf(PROBABILITY));
        let within = [within(1.0)?, within(3.0)?];
        let mut sums = Sums::default();
        for (i, (bound, estimate)) in self.bound.iter().zip(estimates).enumerate() {
            let is_early = bound.is_some_and(|bound| bound.since_touch_s < START_S);
            if let Some((_, nees)) = estimate.as_ref().filter(|_| is_early).and_then(|estimate| self.error(i, estimate))
            {
                sums.early += 1;
                sums.early_covered += usize::from(nees.is_some_and(|nees| nees <= within[1]));
            }
            if let Some(bound) = bound.filter(|_| !is_early) {
                if self.expected[i] {
                    sums.expected += 1;
                    sums.expected_answered += usize::from(estimate.is_some());
                }
                if let Some(object) = bound.object {
                    sums.object_bound += object.covariance_m2.trace();
                    sums.objects += 1;
                    if let Some(direction_rad2) = object.direction_rad2 {
                        sums.direction_bound += direction_rad2;
                        sums.rods += 1;
                    }
                }
                if let Some(estimate) = estimate {
                    self.add(&mut sums, i, estimate, &bound, within[1]);
                }
            }
        }
        let (answered, noise_sd_n_m) = (sums.answered, self.knowledge.noise_sd_n_m);
        let mean = |sum: f64| (answered > 0).then(|| sum / answered as f64);
        let rms = |sum: f64| mean(sum).map(f64::sqrt);
        let of_complete = |sum: f64| (sums.complete > 0).then(|| (sum / sums.complete as f64).sqrt());
        let of_bound = |sum: f64, count: usize| (count > 0 && noise_sd_n_m > 0.0).then(|| (sum / count as f64).sqrt());
        let radius = sums.last_radius.zip(self.solid.as_ref().and_then(Solid::radius_m));
        let radius_bound = sums.last_radius.and_then(|(_, bound)| bound).filter(|_| noise_sd_n_m > 0.0);
        // The bound is that of object and wire together.
        let of_both_m = self.object.as_ref().map_or(0.0, TrueObject::radius_m);
        let of_feature = |(sum, count): (f64, usize)| (count > 0).then(|| sum / count as f64);
        let sidecar = &self.trace.sidecar;
        let signals = || {
            let rows = self.bound.iter().zip(estimates);
            rows.filter_map(|(bound, estimate)| {
                Some((bound.as_ref()?.since_touch_s, estimate.as_ref()?.model_doubtful?))
            })
        };
        let stated = self.bound.iter().zip(estimates).filter(|(bound, of)| bound.is_some() && of.is_some());
        Ok(SpatialTrialRow {
            trace: sidecar.name.clone(),
            group: sidecar.group.clone(),
            whisker: sidecar.whisker.name.clone(),
            estimator: estimator.into(),
            seed,
            noise_sd_n_m,
            answered: (sums.expected > 0).then(|| sums.expected_answered as f64 / sums.expected as f64),
            rmse_m: rms(sums.contact),
            out_of_plane_m: of_complete(sums.out_of_plane),
            bound_m: rms(sums.bound).filter(|_| noise_sd_n_m > 0.0),
            object_bound_m: of_bound(sums.object_bound, sums.objects),
            nees: sums.last_nees,
            coverage: mean(sums.covered as f64),
            early_coverage: (sums.early > 0).then(|| sums.early_covered as f64 / sums.early as f64),
            surface_m: self.solid.as_ref().and_then(|_| mean(sums.surface)),
            normal_rad: of_complete(sums.normal),
            direction_rad: (sums.directions > 0).then(|| (sums.direction / sums.directions as f64).sqrt()),
            direction_bound_rad: of_bound(sums.direction_bound, sums.rods),
            radius_error: radius.map(|((stated, _), truth_m)| stated.radius_m / truth_m - 1.0),
            radius_bound: radius.zip(radius_bound).map(|((_, truth_m), bound)| bound.sqrt() * of_both_m / truth_m),
            radius_coverage: radius.map(|((stated, _), truth_m)| {
                f64::from((stated.radius_m - truth_m).powi(2) <= within[0] * stated.sd_m.powi(2))
            }),
            edge_m: of_feature(sums.edge),
            corner_m: of_feature(sums.corner),
            nees_mean: statistics::mean(sums.nees.iter().copied()),
            nees_samples: statistics::effective_samples(&sums.nees, SPATIAL_NEES_FREEDOM as f64),
            contact_s: stated.count() as f64 / sidecar.rate_hz,
            doubted: doubt::doubted(signals()),
            doubt_time_s: doubt::doubt_time_s(signals()),
        })
    }

    /// Error of the contact in Base (m), and its normalised square. `None` if the true contact is not known.
    fn error(&self, i: usize, estimate: &Estimate) -> Option<(Vector3<f64>, Option<f64>)> {
        let to_base = to_base(&self.trace.recording.instants[i].base);
        let contact = to_base.apply(Point::from_vector(self.trace.truth.instants[i].contact_m()?));
        let error = estimate.contact.vector() - contact.vector();
        Some((error, estimate.covariance_m2.cholesky().map(|factor| error.dot(&factor.solve(&error)))))
    }

    fn add(&self, sums: &mut Sums, i: usize, estimate: &Estimate, bound: &SpatialBoundAt, within: f64) {
        let Some((error, nees)) = self.error(i, estimate) else { return };
        let (truth, to_base) = (&self.trace.truth.instants[i], to_base(&self.trace.recording.instants[i].base));
        sums.answered += 1;
        sums.contact += error.norm_squared();
        sums.bound += bound.covariance_m2.trace();
        sums.covered += usize::from(nees.is_some_and(|nees| nees <= within));
        sums.nees.extend(nees);
        sums.last_nees = nees;
        // The other scores compare more than the place of the contact.
        let Some(truth) = truth.contact else { return };
        sums.complete += 1;
        let (tangent, normal) = (to_base.turn_vector(truth.tangent), to_base.turn_vector(truth.normal));
        sums.out_of_plane += error.dot(&tangent.cross(&normal).normalize()).powi(2);
        if let Some(solid) = &self.solid {
            let surface =
                to_base.inverse().apply(self.knowledge.calibrated.surface(estimate.contact, estimate.normal)).vector();
            sums.surface += solid.distance_m(surface);
            let features = solid.features_m(truth.surface).zip(solid.features_m(surface));
            if let Some(((edge_m, corner_m), (from_edge_m, from_corner_m))) = features
                && edge_m < FEATURE_M
            {
                let is_corner = corner_m < FEATURE_M;
                let (sum, error_m) =
                    if is_corner { (&mut sums.corner, from_corner_m) } else { (&mut sums.edge, from_edge_m) };
                (sum.0, sum.1) = (sum.0 + error_m, sum.1 + 1);
            }
        }
        sums.last_radius = estimate.radius.map(|radius| (radius, bound.object.map(|object| object.log_radius2)));
        sums.normal += normal.angle(&estimate.normal).powi(2);
        if let (Some(rod), Some(found)) = (self.object.as_ref().and_then(TrueObject::rod), estimate.direction) {
            // The direction of an edge has no sign.
            let cosine = to_base.turn_vector(rod.along).dot(&found.along).abs().min(1.0);
            sums.direction += cosine.acos().powi(2);
            sums.directions += 1;
        }
    }
}
