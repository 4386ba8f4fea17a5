//! Rows of the table of quantities that estimators state beside the contact.

use testbed::bound::QuantityBounds;
use testbed::metrics::Scored;
use testbed::results::QuantityRow;
use trace::Miscalibration;
use whisker::estimators::{Installation, Uncertain, Velocity};
use whisker::frames::{Base, Pose, World};

/// A quantity with its estimate: name, true value, estimated value, standard deviation and bound.
type Stated = (&'static str, f64, f64, f64, Option<f64>);

/// Rows of a trial, from the last estimate during contact. The names of trace, estimator and trial are those of `of_trial`.
pub(super) fn quantity_rows(
    scored: &Scored<'_>,
    miscalibration: &Miscalibration,
    bounds: Option<&QuantityBounds>,
    of_trial: &QuantityRow,
) -> Vec<QuantityRow> {
    let Some((index, contact, estimate)) = scored
        .contacts
        .iter()
        .enumerate()
        .rev()
        .find_map(|(index, contact)| Some((index, contact, scored.estimates[contact.row]?)))
    else {
        return Vec::new();
    };
    let trace = &scored.trial.trace;
    let deviations = estimate.installation.map(|found| of_installation(&found, miscalibration, bounds));
    let base = &trace.recording.instants[contact.row].base;
    // The velocity of an object that gives way is not constant, and not stated by its trace.
    let velocity = estimate.velocity.filter(|_| !trace.sidecar.is_yielding());
    let velocity = velocity.map(|found| of_velocity(&found, base, trace.sidecar.object_velocity_m_s(), bounds));
    let contact_s = (index + 1) as f64 / trace.sidecar.rate_hz;
    let row = |(quantity, truth, estimate, sd, bound): Stated| QuantityRow {
        quantity: quantity.into(),
        contact_s,
        truth,
        estimate,
        error: estimate - truth,
        sd,
        bound,
        ..of_trial.clone()
    };
    deviations.into_iter().flatten().chain(velocity.into_iter().flatten()).map(row).collect()
}

fn of_installation(
    found: &Installation,
    miscalibration: &Miscalibration,
    bounds: Option<&QuantityBounds>,
) -> [Stated; 4] {
    let Miscalibration { gain, mount_rad, mount_x_m, mount_y_m, .. } = *miscalibration;
    let truths = [gain, mount_rad, mount_x_m, mount_y_m];
    let stated = found.by_name();
    std::array::from_fn(|i| {
        let (name, Uncertain { value, sd }) = stated[i];
        (name, truths[i], value, sd, bounds.map(|bounds| bounds.installation[i]))
    })
}

fn of_velocity(
    found: &Velocity,
    base: &Pose<Base, World>,
    truth: [f64; 2],
    bounds: Option<&QuantityBounds>,
) -> [Stated; 2] {
    let found = found.turned(base);
    let (velocity_m_s, sds_m_s) = (found.velocity_m_s, found.sds_m_s());
    let bound = |i: usize| bounds.and_then(|bounds| bounds.velocity_m_s).map(|bound| bound[i]);
    let of_axis = |name, axis: usize| (name, truth[axis], velocity_m_s[axis], sds_m_s[axis], bound(axis));
    [of_axis("object_vx_m_s", 0), of_axis("object_vy_m_s", 1)]
}
