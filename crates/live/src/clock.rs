//! Order of the times in the messages of one stream, and jumps of their clock.

use std::fmt;

/// Number of consecutive messages far behind the newest one after which the clock is taken to have been set back.
const MOST_BEHIND: usize = 5;

/// Duration (s) of the intervals of arrivals over which the smallest latency is taken. Clocks drift apart by less in this time than
/// they jump.
const INTERVAL_S: f64 = 1.0;

/// Jump of the clock of a stream.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jump {
    /// Time of the newest message before it.
    pub from_s: f64,
    /// Time of the message that shows it.
    pub to_s: f64,
    /// Time between the arrivals of both.
    pub elapsed_s: f64,
}

impl fmt::Display for Jump {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { from_s, to_s, elapsed_s } = self;
        write!(f, "found the time {to_s} s, {elapsed_s:.3} s after {from_s} s had arrived")
    }
}

/// Place of a message in the order of time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Order {
    /// After all messages so far.
    Next,
    /// Not after all messages so far.
    Behind,
    /// On another clock than the messages so far.
    Jumped(Jump),
}

/// Newest message of a stream, and the smallest latency of the messages in the last one to two seconds of arrivals.
#[derive(Clone, Copy, Debug, Default)]
pub struct Clock {
    /// Its time and its arrival.
    newest: Option<(f64, f64)>,
    /// Number of consecutive messages far behind it.
    behind: usize,
    /// Times of messages relative to their arrivals.
    ahead: Ahead,
}

/// Largest time of a message relative to its arrival (s), which is that of the smallest latency, in this interval and in the last
/// one.
#[derive(Clone, Copy, Debug)]
struct Ahead {
    since_s: f64,
    present_s: f64,
    before_s: f64,
}

impl Default for Ahead {
    fn default() -> Self {
        Self { since_s: f64::NEG_INFINITY, present_s: f64::NEG_INFINITY, before_s: f64::NEG_INFINITY }
    }
}

impl Ahead {
    fn most_s(&self) -> f64 {
        self.present_s.max(self.before_s)
    }

    fn add(&mut self, ahead_s: f64, now_s: f64) {
        if now_s - self.since_s >= INTERVAL_S {
            *self = Self { since_s: now_s, present_s: f64::NEG_INFINITY, before_s: self.present_s };
        }
        self.present_s = self.present_s.max(ahead_s);
    }
}

impl Clock {
    /// Checks the time of a message that arrives at `now_s`. A clock jumps ahead if the time of a message relative to its arrival
    /// exceeds by `jump_s` that of the message with the smallest latency: a message after a delayed one is no jump. It jumps back
    /// if five messages in a row lie more than `jump_s` behind the newest one.
    pub fn check(&mut self, t_s: f64, now_s: f64, jump_s: f64) -> Order {
        let ahead_s = t_s - now_s;
        let Some((from_s, arrived_s)) = self.newest else {
            self.newest = Some((t_s, now_s));
            self.ahead.add(ahead_s, now_s);
            return Order::Next;
        };
        let (step_s, elapsed_s) = (t_s - from_s, now_s - arrived_s);
        let jumped = Order::Jumped(Jump { from_s, to_s: t_s, elapsed_s });
        if step_s > 0.0 {
            (self.newest, self.behind) = (Some((t_s, now_s)), 0);
            let is_jump = ahead_s - self.ahead.most_s() > jump_s;
            if is_jump {
                self.ahead = Ahead::default();
            }
            self.ahead.add(ahead_s, now_s);
            return if is_jump { jumped } else { Order::Next };
        }
        self.behind = if step_s < -jump_s { self.behind + 1 } else { 0 };
        if self.behind == MOST_BEHIND { jumped } else { Order::Behind }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const JUMP_S: f64 = 0.1;

    #[test]
    fn verif_messages_in_order_with_jitter_are_no_jump() {
        let mut clock = Clock::default();
        for i in 0..100 {
            let t_s = 0.004 * f64::from(i);
            let arrived_s = 7.0 + t_s + if i % 3 == 0 { 0.02 } else { 0.015 };
            assert_eq!(clock.check(t_s, arrived_s, JUMP_S), Order::Next);
        }
        // A pause of all messages, and a message that was overtaken.
        assert_eq!(clock.check(3.0, 10.0, JUMP_S), Order::Next);
        assert_eq!(clock.check(2.99, 10.0, JUMP_S), Order::Behind);
        assert_eq!(clock.check(3.0, 10.0, JUMP_S), Order::Behind);
    }

    #[test]
    fn robust_a_clock_that_jumps_ahead_is_found_at_once() {
        let mut clock = Clock::default();
        clock.check(1.0, 0.0, JUMP_S);
        let jump = Jump { from_s: 1.0, to_s: 1.2, elapsed_s: 0.004 };
        assert_eq!(clock.check(1.2, 0.004, JUMP_S), Order::Jumped(jump));
    }

    #[test]
    fn robust_a_message_after_a_delayed_one_is_no_jump() {
        // The sender stamps a message, hangs, sends it, and goes on.
        for hang_s in [0.2, 3.0] {
            let mut clock = Clock::default();
            (0..500)
                .for_each(|i| assert_eq!(clock.check(0.004 * f64::from(i), 0.004 * f64::from(i), JUMP_S), Order::Next));
            assert_eq!(clock.check(2.0, 2.0 + hang_s, JUMP_S), Order::Next);
            for i in 1..500 {
                let t_s = 2.0 + hang_s + 0.004 * f64::from(i);
                assert_eq!(clock.check(t_s, t_s, JUMP_S), Order::Next, "{t_s} s");
            }
            // A step ahead is still found at once.
            let t_s = 5.0 + hang_s;
            assert!(matches!(clock.check(t_s, t_s - 0.12, JUMP_S), Order::Jumped(_)));
            assert_eq!(clock.check(t_s + 0.004, t_s - 0.116, JUMP_S), Order::Next);
        }
    }

    #[test]
    fn robust_a_clock_that_drifts_does_not_jump() {
        // By 1 ms a second, for ten minutes at ten messages a second, faster and slower than that of the arrivals.
        for rate in [1.001, 0.999] {
            let mut clock = Clock::default();
            for i in 0..6000 {
                let now_s = 0.1 * f64::from(i);
                assert_eq!(clock.check(rate * now_s, now_s, JUMP_S), Order::Next);
            }
            // A step is measured from the recent offset.
            assert!(matches!(clock.check(rate * 600.0 + 0.2, 600.0, JUMP_S), Order::Jumped(_)));
        }
    }

    #[test]
    fn robust_a_clock_that_is_set_back_is_found_after_five_messages() {
        let mut clock = Clock::default();
        clock.check(5.0, 0.0, JUMP_S);
        for i in 1..5 {
            assert_eq!(clock.check(0.004 * f64::from(i), 0.004 * f64::from(i), JUMP_S), Order::Behind);
        }
        assert!(matches!(clock.check(0.02, 0.02, JUMP_S), Order::Jumped(_)));
    }
}
