//! Samples and estimates of a sensor whose mounting deviates from that of its calibration.

use super::{Direction, Estimate, Sample};
use crate::frames::Base;
use crate::space::frames::Pose;
use crate::space::sensor::Mounting;

/// The sample in the Base of the calibration.
pub(super) fn corrected(mounting: &Mounting, sample: &Sample) -> Sample {
    let pose = mounting.pose();
    Sample { motion: pose.inverse().then(&sample.motion).then(&pose), ..*sample }
}

/// An estimate in the Base of the calibration, transformed to Base. The covariance of the mounting is added.
pub(super) fn stated(mounting: &Mounting, estimate: &Estimate) -> Estimate {
    let back: Pose<Base, Base> = mounting.pose().inverse();
    let covariance_m2 = estimate.covariance_m2 + mounting.contact_covariance_m2(&estimate.contact);
    let normal_covariance = estimate.normal_covariance + mounting.direction_covariance(&estimate.normal);
    let turned = |direction: Direction| {
        let turn_rad2 = mounting.direction_covariance(&direction.along).trace() / 2.0;
        Direction { along: back.turn_vector(direction.along), sd_rad: direction.sd_rad.hypot(turn_rad2.sqrt()) }
    };
    Estimate {
        contact: back.apply(estimate.contact),
        covariance_m2: back.turn(covariance_m2),
        normal: back.turn_vector(estimate.normal),
        normal_covariance: back.turn(normal_covariance),
        direction: estimate.direction.map(turned),
        ..*estimate
    }
}
