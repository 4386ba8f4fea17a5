//! Planar traces as traces in space: nothing leaves the plane, so that one of the two bending moments is zero.

use nalgebra::{UnitQuaternion, Vector2, Vector3};
use whisker::frames::{Point, World};

use super::{
    Feature, SPATIAL_FORMAT, SpatialContactTruth, SpatialInstant, SpatialPose, SpatialRecording, SpatialSidecar,
    SpatialTrace, SpatialTruth, SpatialTruthInstant, StatedSuspension,
};
use crate::{Trace, TruthInstant};

impl SpatialTrace {
    /// A planar trace in the plane z = 0, with the properties of the whisker out of its plane. The
    /// moment about y is zero. There is a true contact where contact, surface, arc length, force and tangent are known, and it is
    /// one with a smooth face, of which planar traces do not tell edges apart.
    pub fn lifted(trace: &Trace, suspension: StatedSuspension, poisson_ratio: f64) -> Self {
        let planar = &trace.sidecar;
        let sidecar = SpatialSidecar {
            format: SPATIAL_FORMAT,
            kind: planar.kind.clone(),
            name: planar.name.clone(),
            role: planar.role,
            group: planar.group.clone(),
            object: planar.object.clone(),
            seed: planar.seed,
            rate_hz: planar.rate_hz,
            rows: planar.rows,
            whisker: planar.whisker.clone(),
            suspension,
            poisson_ratio,
            scene: planar.scene.clone(),
            generator: planar.generator.clone(),
            inputs_sha256: planar.inputs_sha256.clone(),
            csv_sha256: planar.csv_sha256.clone(),
            certificate: None,
            recorded: None,
        };
        let instants = trace.recording.instants.iter().map(|now| SpatialInstant {
            t_s: now.t_s,
            base: SpatialPose {
                position: raised(now.base.origin()),
                rotation: UnitQuaternion::from_axis_angle(&Vector3::z_axis(), now.base.yaw_rad()),
            },
            twist: None,
            moment_x_n_m: None,
            moment_y_n_m: 0.0,
            moment_z_n_m: now.moment_z_n_m,
            force_x_n: None,
            rotation: None,
        });
        let truth = trace.truth.instants.iter().map(|truth| SpatialTruthInstant {
            touching: truth.touching,
            contact: contact(truth),
            place: None,
        });
        let recording = SpatialRecording { instants: instants.collect() };
        Self { sidecar, recording, truth: SpatialTruth { instants: truth.collect() } }
    }
}

fn raised(point: Point<World>) -> Vector3<f64> {
    Vector3::new(point.x(), point.y(), 0.0)
}

/// The true contact. `None` if a part of it is not known.
fn contact(truth: &TruthInstant) -> Option<SpatialContactTruth> {
    let (contact, surface) = (raised(truth.contact?), raised(truth.surface?));
    let normal = (contact - surface).try_normalize(0.0)?;
    let along = Vector2::new(truth.tangent_rad?.cos(), truth.tangent_rad?.sin());
    Some(SpatialContactTruth {
        tip: truth.tip.unwrap_or(false),
        split: truth.split.unwrap_or(false),
        feature: Feature::Face,
        contact,
        surface,
        normal,
        arc_m: truth.arc_m?,
        force: normal * truth.force_n?,
        tangent: Vector3::new(along.x, along.y, 0.0),
    })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn verif_a_lifted_trace_stays_in_the_plane() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden/golden_circle.csv");
        let planar = Trace::read(&path).expect("a golden trace");
        let suspension = StatedSuspension { yaw_n_m_rad: 1e-4, pitch_n_m_rad: 2e-4, twist_n_m_rad: 3e-4 };
        let lifted = SpatialTrace::lifted(&planar, suspension, 0.3);
        assert_eq!((lifted.sidecar.suspension, lifted.sidecar.poisson_ratio), (suspension, 0.3));
        assert_eq!(lifted.sidecar.whisker, planar.sidecar.whisker);
        let mut contacts = 0;
        for (row, known) in planar.recording.instants.iter().enumerate() {
            let (now, truth) = (&lifted.recording.instants[row], &lifted.truth.instants[row]);
            assert_eq!((now.t_s, now.moment_y_n_m, now.moment_z_n_m), (known.t_s, 0.0, known.moment_z_n_m));
            let Some(contact) = truth.contact else { continue };
            // A contact in Base is the same in the plane and in space.
            let in_plane = known.base.inverse().apply(planar.truth.instants[row].contact.expect("a contact"));
            let in_space = now.base.rotation.inverse() * (contact.contact - now.base.position);
            assert!((in_space - Vector3::new(in_plane.x(), in_plane.y(), 0.0)).norm() < 1e-12);
            // The wire slides without friction: its tangent lies in the surface.
            assert!(contact.normal.dot(&contact.tangent).abs() < 1e-2, "{row}");
            contacts += 1;
        }
        assert!(contacts > 100, "{contacts}");
    }
}
