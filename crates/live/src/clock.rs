//! Order of the times in the messages of one stream, and jumps of their clock.

use std::fmt;

/// Number of consecutive messages far behind the newest one after which the clock is taken to have been set back.
const MOST_BEHIND: usize = 5;

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

/// Newest message of a stream.
#[derive(Clone, Copy, Debug, Default)]
pub struct Clock {
    /// Its time and its arrival.
    newest: Option<(f64, f64)>,
    /// Number of consecutive messages far behind it.
    behind: usize,
}

impl Clock {
    /// Checks the time of a message that arrives at `now_s`. A clock jumps ahead if the time of a message increases by `jump_s`
    /// more than its arrival, and back if five messages in a row lie more than `jump_s` behind the newest one.
    pub fn check(&mut self, t_s: f64, now_s: f64, jump_s: f64) -> Order {
        let Some((from_s, arrived_s)) = self.newest else {
            self.newest = Some((t_s, now_s));
            return Order::Next;
        };
        let (step_s, elapsed_s) = (t_s - from_s, now_s - arrived_s);
        let jumped = Order::Jumped(Jump { from_s, to_s: t_s, elapsed_s });
        if step_s > 0.0 {
            *self = Self { newest: Some((t_s, now_s)), behind: 0 };
            return if step_s - elapsed_s > jump_s { jumped } else { Order::Next };
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
    fn robust_a_clock_that_is_set_back_is_found_after_five_messages() {
        let mut clock = Clock::default();
        clock.check(5.0, 0.0, JUMP_S);
        for i in 1..5 {
            assert_eq!(clock.check(0.004 * f64::from(i), 0.004 * f64::from(i), JUMP_S), Order::Behind);
        }
        assert!(matches!(clock.check(0.02, 0.02, JUMP_S), Order::Jumped(_)));
    }
}
