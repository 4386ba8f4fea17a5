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
use whisker::space::sensor::{KnownContact, Mounting};

use crate::fit::check_replaces_calibration;

/// Learns the mounting of a sensor from the known contacts of traces, writes the calibration with it, in place of any earlier
/// mounting, and returns it.
///
/// # Errors
/// If a file cannot be read, two traces are the same, the calibration is one of another whisker or of the counts of a sensor, a trace
/// states no contact, the contacts do not determine the mounting, or `out` exists and is not a calibration in space.
pub fn mount(calibration: &Path, traces: &[PathBuf], out: &Path) -> anyhow::Result<Mounting> {
    check_replaces_calibration(out, SPATIAL_FORMAT)?;
    let file = mounted(calibration, traces)?;
    write_json(out, &file)?;
    Ok(file.mounting.expect("it was learnt").deviation)
}

fn mounted(calibration: &Path, traces: &[PathBuf]) -> anyhow::Result<SpatialCalibrationFile> {
    let file = read_calibration(calibration)?;
    if file.sensor().is_some() {
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
    let (mut touches, mut used) = (Vec::new(), 0);
    let mut largest_sd_n_m = 0.0_f64;
    let calibrated = file.calibrated(calibration, None)?;
    for trace in &traces {
        check_calibration(calibration, &file, &trace.sidecar)?;
        let noise_sd_n_m = trace.sidecar.own_noise_sd_n_m();
        let of_trace = known_contacts(trace, &knowledge(&calibrated, noise_sd_n_m, None, trace.sidecar.rate_hz));
        if of_trace.is_empty() {
            bail!(
                "{}: found no touch with a known contact, expected `truth_contact_x_m`, `_y_m` and `_z_m` in rows in which a \
                touch is detected",
                trace.sidecar.name
            );
        }
        used += of_trace.iter().map(Vec::len).sum::<usize>();
        largest_sd_n_m = largest_sd_n_m.max(noise_sd_n_m);
        touches.extend(of_trace);
    }
    let deviation = Mounting::learnt(&calibrated, &touches, largest_sd_n_m).with_context(|| {
        format!(
            "{}: found too few of the {used} known contacts within the calibrated domain, expected at least {} whose readings a \
            mounting explains",
            calibration.display(),
            Mounting::LEAST_CONTACTS
        )
    })?;
    let mounting = LearntMounting {
        deviation,
        traces: traces.iter().map(|trace| trace.sidecar.name.clone()).collect(),
        data_sha256: data_sha256(traces.iter().map(|trace| trace.sidecar.data_sha256())),
    };
    Ok(SpatialCalibrationFile { mounting: Some(mounting), ..file })
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
