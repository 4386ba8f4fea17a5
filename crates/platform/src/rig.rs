//! Geometry of the rig: where the whisker stands on the printer's bed, and the ruler on its head.
//!
//! All figures are those of the OpenWhisker platform (a Prusa i3), in the printer's coordinates: x to the right, y away from the
//! front. The whisker lies along y, its tip to the front, its root behind. The ruler hangs on the head; its end is the edge that touches.

/// How far the head can go in x.
pub const BED_X_M: [f64; 2] = [0.0, 0.250];
/// How far the head can go in y.
pub const BED_Y_M: [f64; 2] = [0.0, 0.210];
/// Slowest and fastest that the head may go: 1000 and 15000 mm/min.
pub const SPEEDS_M_S: [f64; 2] = [1.0 / 60.0, 0.25];
/// Speed of the head where nothing else is asked for: 2000 mm/min.
pub const SPEED_M_S: f64 = 2.0 / 60.0;
/// Left side of the ruler, seen from the nozzle.
pub const BEAM_START_M: f64 = -0.01320;
/// How wide the ruler is in x.
pub const BEAM_THICKNESS_M: f64 = 0.01620;
/// Right side of the ruler, seen from the nozzle: the one that pushes, from the whisker's left.
pub const BEAM_END_M: f64 = BEAM_START_M + BEAM_THICKNESS_M;
/// How far the ruler's end is in front of the nozzle.
pub const BEAM_EDGE_M: f64 = 0.05675;
/// Where the ruler meets the whisker in x.
pub const WHISKER_X_M: f64 = 0.150;
/// Where the whisker's tip is in y.
pub const WHISKER_TIP_Y_M: f64 = 0.035;
/// Length of the whisker, which lies along y.
pub const WHISKER_LENGTH_M: f64 = 0.150;
/// How far the ruler keeps from the whisker between two touches.
pub const PADDING_M: f64 = 0.020;
/// How far from the tip the first touch is.
pub const FIRST_TOUCH_M: f64 = 0.005;

/// Position of the nozzle in x at which the ruler, coming from the left, has gone this far past first touch.
pub fn nozzle_x_m(push_m: f64) -> f64 {
    WHISKER_X_M - BEAM_END_M + push_m
}

/// Position of the nozzle in y at which the ruler's end is this far from the whisker's root, along the undeflected whisker.
pub fn nozzle_y_m(distance_m: f64) -> f64 {
    WHISKER_TIP_Y_M + WHISKER_LENGTH_M - distance_m + BEAM_EDGE_M
}

/// Distance of the ruler's end from the whisker's root when the nozzle is there in y.
pub fn distance_m(nozzle_y_m: f64) -> f64 {
    WHISKER_TIP_Y_M + WHISKER_LENGTH_M - (nozzle_y_m - BEAM_EDGE_M)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_first_touch_is_where_the_published_controller_begins() {
        // 56.75 + 35 + 5 mm.
        let y_m = nozzle_y_m(WHISKER_LENGTH_M - FIRST_TOUCH_M);
        assert!((y_m - 0.09675).abs() < 1e-12);
        assert!((distance_m(y_m) - 0.145).abs() < 1e-12);
    }
}
