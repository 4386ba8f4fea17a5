//! Rig of the platform.

use platform::rig::Rig;
use platform::routine::{IncrementsBeamTest, Overload};
use strict_json::parse_json;

use crate::properties::{one_error, same_json};
use crate::scratch;

const FILE: &str = "untrusted_rig.json";

pub(super) fn run(bytes: &[u8]) {
    let Some(rig) = one_error(Rig::read(&scratch::file(FILE, bytes)), FILE) else { return };
    same_json(&parse_json(bytes).expect("it was read"), &serde_json::to_value(&rig).expect("it becomes JSON"));
    let routine = IncrementsBeamTest { speed_m_s: rig.speed_m_s(), ..Default::default() };
    if let Some(plan) = one_error(routine.on(&rig, Overload::Refused), "") {
        let pushes = rig.shaft.largest_pushes();
        for &distance_m in plan.distances_m() {
            let largest_m = pushes.at(distance_m).push_m;
            assert!(largest_m >= routine.total_x_m && largest_m <= rig.shaft.length_m, "{largest_m} at {distance_m}");
        }
    }
}
