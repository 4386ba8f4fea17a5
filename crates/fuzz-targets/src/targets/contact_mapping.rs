//! Mapping of ROS 2 topics to whiskers, and the URDF of an arm. There is no calibration, so that every input ends with an error.

use live_ros::{Mapping, Setup};

use crate::properties::one_error;
use crate::scratch;

pub(super) fn run(bytes: &[u8]) {
    let [mapping, urdf] = scratch::parts(bytes);
    let path = scratch::file("robot/mapping.json", mapping);
    scratch::file("robot/arm.urdf", urdf);
    if let Some(mapping) = one_error(Mapping::read(&path), "mapping.json") {
        assert!(mapping.whiskers.iter().all(|whisker| whisker.moment.is_some() != whisker.counts.is_some()));
    }
    assert!(one_error(Setup::read(&path), "").is_none(), "a calibration appeared");
}
