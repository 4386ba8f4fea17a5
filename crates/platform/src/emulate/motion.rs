//! Motion of a printer's head: straight moves with constant acceleration, each from standstill to standstill.

use std::collections::VecDeque;

/// Acceleration of the head (mm/s^2), the default of Prusa's firmware.
const ACCELERATION_MM_S2: f64 = 1000.0;
/// Time for which an ended move is kept, for late queries (s).
const MEMORY_S: f64 = 1.0;

/// Position of the head (mm) as a function of time.
#[derive(Clone, Debug, Default)]
pub(super) struct Motion {
    /// Position before the first move (mm).
    start_mm: [f64; 3],
    moves: VecDeque<Move>,
}

#[derive(Clone, Copy, Debug)]
struct Move {
    begin_s: f64,
    from_mm: [f64; 3],
    to_mm: [f64; 3],
    length_mm: f64,
    /// Largest speed of the move (mm/s).
    speed_mm_s: f64,
}

impl Move {
    fn new(begin_s: f64, from_mm: [f64; 3], to_mm: [f64; 3], speed_mm_s: f64) -> Self {
        let length_mm = (0..3).map(|axis| (to_mm[axis] - from_mm[axis]).powi(2)).sum::<f64>().sqrt();
        // A short move ends before the requested speed is reached.
        let speed_mm_s = speed_mm_s.min((ACCELERATION_MM_S2 * length_mm).sqrt());
        Self { begin_s, from_mm, to_mm, length_mm, speed_mm_s }
    }

    fn ramp_s(&self) -> f64 {
        self.speed_mm_s / ACCELERATION_MM_S2
    }

    fn end_s(&self) -> f64 {
        if self.length_mm == 0.0 {
            return self.begin_s;
        }
        self.begin_s + self.ramp_s() + self.length_mm / self.speed_mm_s
    }

    fn position_mm(&self, t_s: f64) -> [f64; 3] {
        let (since_s, left_s) = (t_s - self.begin_s, self.end_s() - t_s);
        if left_s <= 0.0 {
            return self.to_mm;
        }
        let ramp_mm = |ramp_s: f64| 0.5 * ACCELERATION_MM_S2 * ramp_s * ramp_s;
        let gone_mm = if since_s < self.ramp_s() {
            ramp_mm(since_s.max(0.0))
        } else if left_s < self.ramp_s() {
            self.length_mm - ramp_mm(left_s)
        } else {
            self.speed_mm_s * (since_s - 0.5 * self.ramp_s())
        };
        let share = gone_mm / self.length_mm;
        std::array::from_fn(|axis| self.from_mm[axis] + share * (self.to_mm[axis] - self.from_mm[axis]))
    }
}

impl Motion {
    /// Appends a move at a time (s).
    pub(super) fn go(&mut self, now_s: f64, to_mm: [f64; 3], speed_mm_s: f64) {
        while self.moves.front().is_some_and(|first| first.end_s() < now_s - MEMORY_S) {
            let over = self.moves.pop_front().expect("there is one");
            self.start_mm = over.to_mm;
        }
        let begin_s = self.end_s().max(now_s);
        self.moves.push_back(Move::new(begin_s, self.goal_mm(), to_mm, speed_mm_s));
    }

    /// Stops at once.
    pub(super) fn stop(&mut self, now_s: f64) {
        self.start_mm = self.position_mm(now_s);
        self.moves.clear();
    }

    /// Final position (mm).
    pub(super) fn goal_mm(&self) -> [f64; 3] {
        self.moves.back().map_or(self.start_mm, |last| last.to_mm)
    }

    /// End of the last move (s).
    pub(super) fn end_s(&self) -> f64 {
        self.moves.back().map_or(f64::NEG_INFINITY, Move::end_s)
    }

    /// Number of moves that have not ended.
    pub(super) fn waiting(&self, now_s: f64) -> usize {
        self.moves.iter().filter(|waiting| waiting.end_s() > now_s).count()
    }

    /// Position at a time (mm).
    pub(super) fn position_mm(&self, t_s: f64) -> [f64; 3] {
        let begun = self.moves.iter().rev().find(|last| last.begin_s <= t_s);
        begun.map_or(self.start_mm, |under_way| under_way.position_mm(t_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_position_and_time_of_uniform_acceleration() {
        let mut motion = Motion::default();
        motion.go(1.0, [30.0, 40.0, 0.0], 100.0);
        // 5 mm of acceleration to 100 mm/s, 40 mm at constant speed, 5 mm of deceleration.
        assert!((motion.end_s() - 1.6).abs() < 1e-12);
        let along = |t_s| motion.position_mm(t_s)[0] / 0.6;
        assert!(
            (along(1.1) - 5.0).abs() < 1e-9 && (along(1.5) - 45.0).abs() < 1e-9 && (along(1.3) - 25.0).abs() < 1e-9
        );
        assert_eq!(motion.position_mm(0.5), [0.0; 3]);
        assert_eq!(motion.position_mm(9.0), [30.0, 40.0, 0.0]);
        // Too short to reach the speed: 2 sqrt(1 mm / 1000 mm/s^2).
        motion.go(5.0, [31.0, 40.0, 0.0], 100.0);
        assert!((motion.end_s() - 5.0 - 2.0 * 1e-3_f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn verif_moves_are_sequential_and_stop() {
        let mut motion = Motion::default();
        motion.go(0.0, [10.0, 0.0, 0.0], 10.0);
        motion.go(0.0, [10.0, 10.0, 0.0], 10.0);
        assert_eq!(motion.waiting(0.1), 2);
        assert_eq!(motion.position_mm(motion.end_s() / 2.0), [10.0, 0.0, 0.0]);
        motion.stop(0.5);
        let at_mm = motion.position_mm(0.5);
        assert!(at_mm[0] > 0.0 && at_mm[0] < 10.0 && motion.position_mm(9.0) == at_mm && motion.goal_mm() == at_mm);
    }
}
