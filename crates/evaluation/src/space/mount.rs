//! The mounting of a sensor, learnt from recordings of touches at known places.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use files::write_json;
use testbed::space::replay::{check_calibration, knowledge, read_calibration, samples};
use testbed::space::{readings_n_m, to_base};
use trace::{LearntMounting, SPATIAL_FORMAT, SpatialCalibrationFile, SpatialTrace, data_sha256};
use whisker::events::TouchConfig;
use whisker::space::estimators::{Knowledge, TouchDetector};
use whisker::space::frames::Point;
use whisker::space::sensor::{CalibratedSpace, FittedTouch, KnownContact, Mounting, MountingFit};

use crate::fit::check_replaces_calibration;

/// Largest [`FittedTouch::disagreement`] that is accepted.
const MOST_DISAGREEMENT: f64 = 2.0;

/// Result of [`mount`].
pub struct Mounted {
    /// The mounting and the touches from which it was learnt.
    pub learnt: MountingFit,
    /// Trace of each touch.
    pub trace_of_touch: Vec<String>,
    /// Largest reading of the calibration (N m).
    pub largest_reading_n_m: f64,
    /// Expected size of a residual (N m): that of the errors of the sensor model on held-out lines and of the noise of the traces.
    pub expected_residual_n_m: f64,
    /// Traces of the earlier mounting that was replaced. Empty if the calibration had none.
    pub replaced: Vec<String>,
}

/// Learns the mounting of a sensor from the known contacts of traces, and writes the calibration with it, in place of any earlier
/// mounting.
///
/// # Errors
/// If a file cannot be read, two traces are the same, the calibration is one of another whisker or of the counts of a sensor, a
/// trace states no contact, the contacts do not determine the mounting, the touches contradict one another, or `out` exists and is
/// not a calibration in space.
pub fn mount(calibration: &Path, traces: &[PathBuf], out: &Path) -> anyhow::Result<Mounted> {
    check_replaces_calibration(out, SPATIAL_FORMAT)?;
    let file = read_calibration(calibration)?;
    if file.front_end_sensor().is_some() {
        bail!(
            "{}: front_end: found a calibration through a modelled sensor, expected one of bending moments",
            calibration.display()
        );
    }
    let paths = traces;
    let traces = traces.iter().map(|path| SpatialTrace::read(path)).collect::<Result<Vec<_>, _>>()?;
    let mut first_with = BTreeMap::new();
    for (path, trace) in paths.iter().zip(&traces) {
        // Touches that are given twice would seem to determine the mounting better.
        if let Some(same) = first_with.insert(trace.sidecar.data_sha256(), path) {
            bail!("{}: found the same content as {}, expected each trace once", path.display(), same.display());
        }
    }
    let (mut touches, mut trace_of_touch) = (Vec::new(), Vec::new());
    let mut largest_sd_n_m = 0.0_f64;
    let calibrated = file.calibrated(calibration, None)?;
    for trace in &traces {
        check_calibration(calibration, &file, &trace.sidecar)?;
        let noise_sd_n_m = trace.sidecar.own_noise_sd_n_m();
        let of_trace = known_contacts(trace, &knowledge(&calibrated, noise_sd_n_m, None, trace.sidecar.rate_hz));
        if of_trace.is_empty() {
            bail!(
                "{}: found {} rows with a known single contact (`truth_contact_x_m`, `_y_m` and `_z_m`), none of them during a \
                detected touch, expected at least one; if the whisker does touch there, the readings may be in another unit than N m",
                trace.sidecar.name,
                trace.truth.instants.iter().filter(|truth| truth.is_single() && truth.contact_m().is_some()).count()
            );
        }
        trace_of_touch.extend(of_trace.iter().map(|_| trace.sidecar.name.clone()));
        largest_sd_n_m = largest_sd_n_m.max(noise_sd_n_m);
        touches.extend(of_trace);
    }
    let names: Vec<String> = traces.iter().map(|trace| trace.sidecar.name.clone()).collect();
    let learnt = Mounting::learnt(&calibrated, &touches, largest_sd_n_m).with_context(|| {
        format!(
            "{}: found {} known contacts, of which fewer than {} lie in the calibrated domain of {} and agree with one mounting; a \
            unit, a sign or a frame of the contacts, poses or readings may be wrong",
            names.join(", "),
            touches.iter().map(Vec::len).sum::<usize>(),
            Mounting::LEAST_CONTACTS,
            calibration.display()
        )
    })?;
    check_agreement(&learnt, &trace_of_touch)?;
    let mounting = LearntMounting {
        deviation: learnt.mounting,
        traces: names,
        data_sha256: data_sha256(traces.iter().map(|trace| trace.sidecar.data_sha256())),
    };
    let replaced = file.mounting.map(|before| before.traces).unwrap_or_default();
    write_json(out, &SpatialCalibrationFile { mounting: Some(mounting), ..file })?;
    let CalibratedSpace { largest_reading_n_m, heldout_rms_n_m, .. } = *calibrated;
    let expected_residual_n_m = heldout_rms_n_m.hypot(largest_sd_n_m);
    Ok(Mounted { learnt, trace_of_touch, largest_reading_n_m, expected_residual_n_m, replaced })
}

/// Refuses touches of which one agrees in no contact, or contradicts the mounting by the others.
fn check_agreement(learnt: &MountingFit, traces: &[String]) -> anyhow::Result<()> {
    if let Some((touch, name)) = learnt.touches.iter().zip(traces).find(|(touch, _)| touch.used == 0) {
        bail!(
            "{name}: found a touch of which none of {} contacts lies in the calibrated domain and agrees with the mounting, expected \
            some: its known place, or a unit, a sign or a frame, may be wrong",
            touch.contacts
        );
    }
    let disagreement = |touch: &FittedTouch| touch.disagreement.unwrap_or_default();
    let touches = learnt.touches.iter().zip(traces).max_by(|a, b| disagreement(a.0).total_cmp(&disagreement(b.0)));
    let Some((worst, name)) = touches.filter(|(worst, _)| disagreement(worst) > MOST_DISAGREEMENT) else {
        return Ok(());
    };
    bail!(
        "{name}: found a touch whose residuals with the mounting by the other touches are {:.1} times as large as expected, expected \
        at most {MOST_DISAGREEMENT}: its known place may be wrong, or that of another touch",
        disagreement(worst)
    );
}

/// Known single contacts on the side of the whisker during the touches that the contact detector finds, one list per touch. The
/// readings are relative to rest.
fn known_contacts(trace: &SpatialTrace, knowledge: &Knowledge) -> Vec<Vec<KnownContact>> {
    let mut detector = TouchDetector::new(TouchConfig::default(), knowledge);
    let mut touches: Vec<Vec<KnownContact>> = Vec::new();
    let mut is_open = false;
    let rows = trace.recording.instants.iter().zip(&trace.truth.instants);
    for (sample, (known, truth)) in samples(trace, &readings_n_m(trace)).iter().zip(rows) {
        let Some((sample, touched)) = detector.step(sample) else { continue };
        let contact_m = truth.contact_m().filter(|_| touched && truth.is_single());
        let Some(contact_m) = contact_m else {
            is_open &= touched;
            continue;
        };
        if !std::mem::replace(&mut is_open, true) {
            touches.push(Vec::new());
        }
        let contact = to_base(&known.base).apply(Point::from_vector(contact_m));
        let touch = touches.last_mut().expect("a touch is open");
        touch.push(KnownContact { contact, reading_n_m: sample.reading_n_m });
    }
    touches
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix6, Vector3};

    use super::*;

    #[test]
    fn robust_touches_that_contradict_one_another_are_refused() {
        let with = |disagreements: &[Option<f64>]| {
            let touch = |disagreement: &Option<f64>| FittedTouch {
                contacts: 40,
                used: 40,
                residuals_n_m: Some([1e-6, 1e-7]),
                disagreement: *disagreement,
            };
            let covariance = Matrix6::identity() * 1e-8;
            MountingFit {
                mounting: Mounting { shift_m: Vector3::zeros(), turn_rad: Vector3::zeros(), covariance },
                touches: disagreements.iter().map(touch).collect(),
            }
        };
        let names = ["near", "far", "off"].map(String::from);
        for agreeing in [&[None][..], &[Some(0.9), Some(1.9), None]] {
            assert!(check_agreement(&with(agreeing), &names).is_ok());
        }
        let mut unused = with(&[None, None]);
        unused.touches[1].used = 0;
        let error = check_agreement(&unused, &names).unwrap_err().to_string();
        assert!(error.starts_with("far: found a touch of which none of 40 contacts"), "{error}");
        let error = check_agreement(&with(&[Some(2.1), Some(1.0), Some(7.34)]), &names).unwrap_err().to_string();
        assert!(error.starts_with("off: ") && error.contains("are 7.3 times") && error.contains("expected at most 2"));
    }
}
