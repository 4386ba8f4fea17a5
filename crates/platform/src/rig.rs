//! Geometry of the rig: the whisker on the printer's bed and the ruler on its head.
//!
//! All values are those of the OpenWhisker platform (a Prusa i3), in the printer's frame: x to the right, y away from the
//! front. The whisker lies along y, its tip to the front. The ruler hangs on the head; its end touches the whisker.

/// Range of the head in x (m).
pub const BED_X_M: [f64; 2] = [0.0, 0.250];
/// Range of the head in y (m).
pub const BED_Y_M: [f64; 2] = [0.0, 0.210];
/// Range of the head's speed (m/s): 1000 to 15000 mm/min.
pub const SPEEDS_M_S: [f64; 2] = [1.0 / 60.0, 0.25];
/// Default speed of the head (m/s): 2000 mm/min.
pub const SPEED_M_S: f64 = 2.0 / 60.0;
/// x of the ruler's left side relative to the nozzle (m).
pub const BEAM_START_M: f64 = -0.01320;
/// Width of the ruler in x (m).
pub const BEAM_THICKNESS_M: f64 = 0.01620;
/// x of the ruler's right side relative to the nozzle (m): this side pushes, from the whisker's left.
pub const BEAM_END_M: f64 = BEAM_START_M + BEAM_THICKNESS_M;
/// Distance of the ruler's end in front of the nozzle (m).
pub const BEAM_EDGE_M: f64 = 0.05675;
/// x of the undeflected whisker (m).
pub const WHISKER_X_M: f64 = 0.150;
/// y of the whisker's tip (m).
pub const WHISKER_TIP_Y_M: f64 = 0.035;
/// Length of the whisker, which lies along y (m).
pub const WHISKER_LENGTH_M: f64 = 0.150;
/// Clearance between ruler and whisker between two pushes (m).
pub const PADDING_M: f64 = 0.020;
/// Distance of the first place from the tip (m).
pub const FIRST_TOUCH_M: f64 = 0.005;

/// x of the nozzle at which the ruler, coming from the left, is this far past first contact (m).
pub fn nozzle_x_m(push_m: f64) -> f64 {
    WHISKER_X_M - BEAM_END_M + push_m
}

/// y of the nozzle at which the ruler's end is this far from the whisker's root along the undeflected whisker (m).
pub fn nozzle_y_m(distance_m: f64) -> f64 {
    WHISKER_TIP_Y_M + WHISKER_LENGTH_M - distance_m + BEAM_EDGE_M
}

/// Distance of the ruler's end from the whisker's root for this y of the nozzle (m).
pub fn distance_m(nozzle_y_m: f64) -> f64 {
    WHISKER_TIP_Y_M + WHISKER_LENGTH_M - (nozzle_y_m - BEAM_EDGE_M)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_first_contact_is_at_the_published_position() {
        // 56.75 + 35 + 5 mm.
        let y_m = nozzle_y_m(WHISKER_LENGTH_M - FIRST_TOUCH_M);
        assert!((y_m - 0.09675).abs() < 1e-12);
        assert!((distance_m(y_m) - 0.145).abs() < 1e-12);
    }
}
