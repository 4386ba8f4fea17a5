//! The recordings in space as traces.
//!
//! Base is that of the planar registration, in the whisker's plane, with z along the z axis of the stage. The readings are nominal
//! bending moments: those of the Kirchhoff rod through the known contacts of the calibration give the [`BendingResponse`] of the
//! two channels, whose inverse converts the counts. `docs/REAL.md` specifies frames, time and units.

use std::f64::consts::PI;
use std::path::Path;

use files::{Digest, Error, sha256};
use nalgebra::{Rotation3, UnitQuaternion, Vector2, Vector3};
use trace::{
    BendingResponse, Role, SPATIAL_FORMAT, SpatialInstant, SpatialPose, SpatialRecorded, SpatialRecording,
    SpatialSidecar, SpatialTrace, SpatialTruth, SpatialTruthInstant, StatedSuspension,
};
use whisker::Whisker;
use whisker::rod::Rod;

use super::{Labelled, Source, SpatialCalibration, SpatialRecordings, Wire, stanford_in_space, with_length};
use crate::provenance::generator;
use crate::stanford_whisker::{NAME, NOMINAL_RATE_HZ, TOUCH_SHARE, class_of};
use crate::{Imported, POISSON_RATIO, Progress};

/// Nominal pause between two lines of a calibration, from which a fit sees that they are two.
const PAUSE_S: f64 = 1.0;

/// Ratio of the wire's length to the arc length of its outermost contact, as in the planar registration.
const BEYOND_CONTACT: f64 = 1.02;

/// Distance below which two stage positions are the same (m).
const SAME_M: f64 = 1e-6;

/// Imports the recordings in space of a clone of the repository.
///
/// # Errors
/// As [`stanford_in_space`], and if the contacts of a calibration do not determine the response of its sensor.
pub(crate) fn import(folder: &Path, progress: Progress<'_>) -> Result<Imported, Error> {
    let SpatialRecordings { calibrations, pins, sweeps, failures } = stanford_in_space(folder)?;
    let all = (calibrations.len() + pins.len() + sweeps.len()) as u64;
    let (mut spatial_traces, mut sensors) = (Vec::new(), Vec::new());
    for calibration in &calibrations {
        progress(spatial_traces.len() as u64, all);
        let sensor = Converted::new(calibration)?;
        spatial_traces.push(sensor.calibration());
        sensors.push(sensor);
    }
    for trial in &pins {
        progress(spatial_traces.len() as u64, all);
        spatial_traces.push(sensors[trial.calibration].pin(&trial.name, &trial.rows, &trial.source));
    }
    for sweep in &sweeps {
        progress(spatial_traces.len() as u64, all);
        let head = Head { name: &sweep.name, role: Role::Trial, group: "real objects", object: &sweep.object };
        spatial_traces.push(sensors[sweep.calibration].sweep(head, &sweep.rows, &sweep.source));
    }
    Ok(Imported { spatial_traces, failures, ..Imported::default() })
}

/// A calibration with the conversion of its readings, common to all recordings of the sensor.
struct Converted<'a> {
    calibration: &'a SpatialCalibration,
    /// The wire, long enough for every contact.
    whisker: Whisker,
    suspension: StatedSuspension,
    response: BendingResponse,
    residual_counts: Vector2<f64>,
    /// Reading at rest above that of the first row.
    rest_counts: Vector2<f64>,
    touch_counts: f64,
}

/// Name and classification of a trace.
struct Head<'a> {
    name: &'a str,
    role: Role,
    group: &'static str,
    object: &'a str,
}

/// Reading of a row, and what is known about its pose and contact.
struct Row {
    t_s: f64,
    base: SpatialPose,
    /// Counts above rest.
    counts: Vector2<f64>,
    /// Axis of the pin in World (m).
    pin: Option<Vector3<f64>>,
}

impl<'a> Converted<'a> {
    fn new(calibration: &'a SpatialCalibration) -> Result<Self, Error> {
        let rest_counts = rest_counts(&calibration.rows);
        let sizes = calibration.rows.iter().map(|row| (row.counts - rest_counts).norm());
        let touch_counts = TOUCH_SHARE * sizes.fold(0.0, f64::max);
        let undetermined = |found: String| {
            let expected =
                "contacts with the wire, in and out of its plane, that determine the response of both channels";
            Error::value(&calibration.path, "sx, sy", found, expected)
        };
        let registered = &calibration.mounted.whisker;
        let rod = with_length(registered, Wire::LENGTH_M).and_then(|whisker| Rod::round(&whisker, POISSON_RATIO).ok());
        let rod = rod.ok_or_else(|| undetermined("no wire".into()))?;
        let mut outermost_m: f64 = 0.0;
        let mut pairs: Vec<(Vector2<f64>, Vector2<f64>)> = Vec::new();
        for row in &calibration.rows {
            let counts = row.counts - rest_counts;
            if counts.norm() <= touch_counts {
                continue;
            }
            let Ok(contact) = rod.at_point(in_base(calibration, &row.contact_m)) else { continue };
            outermost_m = outermost_m.max(contact.load.arc_m);
            pairs.push((contact.deflection.moment_n_m.yz(), counts));
        }
        let response = BendingResponse::fit(&pairs)
            .ok_or_else(|| undetermined(format!("{} contacts within reach of the wire", pairs.len())))?;
        let residual_counts = response.residual_counts(&pairs);
        let length_m = registered.length_m.max(BEYOND_CONTACT * outermost_m);
        let whisker = with_length(registered, length_m).unwrap_or_else(|| registered.clone());
        let suspension = StatedSuspension::isotropic(whisker.root_stiffness_n_m_rad);
        Ok(Self { calibration, whisker, suspension, response, residual_counts, rest_counts, touch_counts })
    }

    /// Base in the frame of the resting sensor.
    fn base(&self) -> SpatialPose {
        let base = self.calibration.mounted.base;
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), base.yaw_rad());
        SpatialPose { position: self.calibration.root_m, rotation }
    }

    /// The calibration: World is the frame of the resting sensor, and the pin moves.
    fn calibration(&self) -> SpatialTrace {
        let SpatialCalibration { rows, lines, name, source, .. } = self.calibration;
        let numbered = lines.iter().enumerate().flat_map(|(line, of_line)| of_line.iter().map(move |&row| (line, row)));
        let rows = numbered.map(|(line, row)| Row {
            t_s: row as f64 / NOMINAL_RATE_HZ + line as f64 * PAUSE_S,
            base: self.base(),
            counts: rows[row].counts - self.rest_counts,
            pin: Some(rows[row].contact_m),
        });
        let head = Head { name, role: Role::Calibration, group: "calibration", object: "pin" };
        self.trace(head, rows, source, source.first_counts + self.rest_counts)
    }

    /// A pin trial: World is fixed to the pin, and the sensor moves against the stage.
    fn pin(&self, name: &str, rows: &[Labelled], source: &Source) -> SpatialTrace {
        let base = self.base();
        let rows = rows.iter().enumerate().map(|(row, known)| Row {
            t_s: row as f64 / NOMINAL_RATE_HZ,
            base: SpatialPose { position: base.position - known.contact_m, ..base },
            counts: known.counts,
            pin: Some(Vector3::zeros()),
        });
        let head = Head { name, role: Role::Trial, group: "real pins", object: "pin" };
        self.trace(head, rows, source, source.first_counts)
    }

    /// A sweep: World is the frame of the objects, in which the sensor is rotated by half a turn about z.
    fn sweep(&self, head: Head<'_>, rows: &[(Vector3<f64>, Vector2<f64>)], source: &Source) -> SpatialTrace {
        let base = self.base();
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI);
        let rows = rows.iter().enumerate().map(|(row, (origin_m, counts))| Row {
            t_s: row as f64 / NOMINAL_RATE_HZ,
            base: SpatialPose { position: origin_m + turn * base.position, rotation: turn * base.rotation },
            counts: *counts,
            pin: None,
        });
        self.trace(head, rows, source, source.first_counts)
    }

    fn trace(
        &self,
        head: Head<'_>,
        rows: impl Iterator<Item = Row>,
        source: &Source,
        rest_counts: Vector2<f64>,
    ) -> SpatialTrace {
        let (mut instants, mut truth) = (Vec::new(), Vec::new());
        for Row { t_s, base, counts, pin } in rows {
            let moment_n_m = self.response.moment_n_m(counts);
            instants.push(SpatialInstant::measured(t_s, base, moment_n_m));
            let place = pin.filter(|_| counts.norm() > self.touch_counts);
            truth.push(SpatialTruthInstant { touching: place.map(|_| true), contact: None, place });
        }
        let mut inputs = Digest::default();
        inputs.add(&source.sha256).add(&self.calibration.source.sha256).add(source_sha256());
        let sidecar = SpatialSidecar {
            format: SPATIAL_FORMAT,
            kind: "trace".into(),
            name: head.name.into(),
            role: head.role,
            group: head.group.into(),
            object: head.object.into(),
            seed: 0,
            rate_hz: NOMINAL_RATE_HZ,
            rows: instants.len(),
            whisker: self.whisker.clone(),
            suspension: self.suspension,
            poisson_ratio: POISSON_RATIO,
            scene: serde_json::Value::Null,
            generator: generator(NAME, source_sha256()),
            inputs_sha256: inputs.finish(),
            csv_sha256: String::new(),
            certificate: None,
            recorded: Some(SpatialRecorded {
                clock: "nominal, a row a stage step".into(),
                counts_per_n_m: self.response,
                residual_counts: self.residual_counts.into(),
                rest_counts: rest_counts.into(),
                noise_sd_n_m: self.response.noise_sd_n_m(self.calibration.noise_sd_counts).into(),
                touch_counts: self.touch_counts,
                object_class: class_of(head.object),
            }),
        };
        let (recording, truth) = (SpatialRecording { instants }, SpatialTruth { instants: truth });
        let mut trace = SpatialTrace { sidecar, recording, truth };
        trace.sidecar.csv_sha256 = sha256(trace.to_csv());
        trace
    }
}

/// A contact of a calibration in Base.
fn in_base(calibration: &SpatialCalibration, contact_m: &Vector3<f64>) -> Vector3<f64> {
    let yaw_rad = calibration.mounted.base.yaw_rad();
    Rotation3::from_axis_angle(&Vector3::z_axis(), -yaw_rad) * (contact_m - calibration.root_m)
}

/// Reading at rest: the median over the visits of the first place, because the first readings drift.
fn rest_counts(rows: &[Labelled]) -> Vector2<f64> {
    let visits = || rows.iter().filter(|row| (row.contact_m - rows[0].contact_m).norm() < SAME_M);
    Vector2::new(0, 1).map(|channel| {
        let mut values: Vec<f64> = visits().map(|row| row.counts[channel]).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    })
}

fn source_sha256() -> String {
    let mut sources = Digest::default();
    sources.add(crate::stanford_whisker::source_sha256());
    for source in [&include_bytes!("traces.rs")[..], include_bytes!("../space.rs")] {
        sources.add(source);
    }
    sources.finish()
}
