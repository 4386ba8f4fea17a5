//! Dynamics of the emulated whisker under the ruler.
//!
//! In contact the whisker is quasi-static, since its inertia is negligible at the speeds of a printer. After a release
//! or a slip it rings: from the rotation `q0` and rate `v0` of that instant, a damped oscillation
//! `exp(-t / decay) (q0 cos(w t) + (v0 + q0 / decay) / w sin(w t))`, until the next contact.

use std::f64::consts::TAU;
use std::sync::Arc;

use super::table::RigTable;
use crate::rig::Rig;

/// State of a whisker.
#[derive(Debug)]
pub(super) struct Whisker {
    rig: Arc<Rig>,
    table: Arc<RigTable>,
    t_s: f64,
    rotation_rad: f64,
    rate_rad_s: f64,
    state: State,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    /// Free, with the ruler on this side; ringing since this time, from this rotation and rate.
    Free { side: Side, since_s: f64, rotation_rad: f64, rate_rad_s: f64 },
    /// Pushed by the ruler.
    Touched(Side),
}

/// Side of the whisker on which the ruler is, seen from the tip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    Left,
    Right,
}

impl Whisker {
    /// Whisker at rest, with the ruler on its left.
    pub(super) fn new(rig: Arc<Rig>, table: Arc<RigTable>) -> Self {
        let state = State::Free { side: Side::Left, since_s: 0.0, rotation_rad: 0.0, rate_rad_s: 0.0 };
        Self { rig, table, t_s: 0.0, rotation_rad: 0.0, rate_rad_s: 0.0, state }
    }

    /// Rotation of the root (rad) at a time, with the nozzle at this position (m). Times must increase.
    pub(super) fn rotation_rad(&mut self, t_s: f64, nozzle_m: [f64; 2]) -> f64 {
        let contact_m = self.rig.distance_m(nozzle_m[1]);
        let side = match self.state {
            State::Touched(side) => side,
            State::Free { side, .. } => self.side_of(nozzle_m[0]).unwrap_or(side),
        };
        let (push_m, sign) = match side {
            Side::Left => (nozzle_m[0] - self.rig.nozzle_x_m(0.0), 1.0),
            Side::Right => (self.rig.shaft.x_m - (nozzle_m[0] + self.rig.ruler.left_m), -1.0),
        };
        let pushed = if push_m > 0.0 { self.table.rotation_rad(contact_m, push_m) } else { None };
        let before_rad = self.rotation_rad;
        match pushed {
            Some(rotation_rad) => {
                self.state = State::Touched(side);
                self.rotation_rad = sign * rotation_rad;
                if t_s > self.t_s {
                    self.rate_rad_s = (self.rotation_rad - before_rad) / (t_s - self.t_s);
                }
            }
            None => {
                let (since_s, start_rad, rate_rad_s) = match self.state {
                    State::Free { since_s, rotation_rad, rate_rad_s, .. } => (since_s, rotation_rad, rate_rad_s),
                    State::Touched(_) => (self.t_s, self.rotation_rad, self.rate_rad_s),
                };
                self.state = State::Free { side, since_s, rotation_rad: start_rad, rate_rad_s };
                self.rotation_rad = self.ringing_rad(t_s - since_s, start_rad, rate_rad_s);
            }
        }
        self.t_s = t_s;
        self.rotation_rad
    }

    /// Side of the whole ruler for this x of the nozzle. `None` if the ruler is across the whisker.
    fn side_of(&self, nozzle_x_m: f64) -> Option<Side> {
        let Rig { ruler, shaft, .. } = &*self.rig;
        if nozzle_x_m + self.rig.ruler_right_m() <= shaft.x_m {
            Some(Side::Left)
        } else if nozzle_x_m + ruler.left_m >= shaft.x_m {
            Some(Side::Right)
        } else {
            None
        }
    }

    fn ringing_rad(&self, since_s: f64, start_rad: f64, rate_rad_s: f64) -> f64 {
        let (w, decay_s) = (TAU * self.table.ring_hz, self.table.decay_s);
        let sine = (rate_rad_s + start_rad / decay_s) / w;
        (-since_s / decay_s).exp() * (start_rad * (w * since_s).cos() + sine * (w * since_s).sin())
    }
}

#[cfg(test)]
mod tests {
    use super::super::table::tests::small;
    use super::*;

    fn whisker(table: Arc<RigTable>) -> Whisker {
        Whisker::new(Arc::new(Rig::built_in()), table)
    }

    fn at(whisker: &mut Whisker, t_s: f64, push_m: f64, distance_m: f64) -> f64 {
        let rig = whisker.rig.clone();
        whisker.rotation_rad(t_s, [rig.nozzle_x_m(push_m), rig.nozzle_y_m(distance_m)])
    }

    #[test]
    fn verif_the_table_while_touched_and_ringing_once_free() {
        let table = Arc::new(small());
        let mut whisker = whisker(table.clone());
        assert_eq!(at(&mut whisker, 0.00, -0.010, 0.1), 0.0);
        assert!((at(&mut whisker, 0.10, 0.005, 0.1) - 0.05).abs() < 1e-9);
        assert!((at(&mut whisker, 0.11, 0.004, 0.1) - 0.04).abs() < 1e-9);
        // After a sudden release: half a period later it is on the other side, with a smaller amplitude.
        let half_s = 0.5 / table.ring_hz;
        let swung_rad = at(&mut whisker, 0.11 + half_s, -0.010, 0.1);
        let expected_rad = -0.04 * (-half_s / table.decay_s).exp();
        assert!((swung_rad - expected_rad).abs() < 1e-9, "{swung_rad} {expected_rad}");
        assert!(at(&mut whisker, 5.0, -0.010, 0.1).abs() < 1e-12);
    }

    #[test]
    fn verif_the_other_side_bends_the_other_way() {
        let mut whisker = whisker(Arc::new(small()));
        let rig = Rig::built_in();
        let x_m = |push_m: f64| rig.shaft.x_m - rig.ruler.left_m - push_m;
        let y_m = rig.nozzle_y_m(0.1);
        assert_eq!(whisker.rotation_rad(0.0, [x_m(-0.001), y_m]), 0.0);
        assert!((whisker.rotation_rad(0.1, [x_m(0.005), y_m]) + 0.05).abs() < 1e-9);
    }

    #[test]
    fn verif_no_contact_beyond_the_tip() {
        let mut whisker = whisker(Arc::new(small()));
        assert_eq!(at(&mut whisker, 0.1, 0.005, 0.16), 0.0);
    }
}
