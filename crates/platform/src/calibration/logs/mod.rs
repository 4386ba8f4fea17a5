//! Recorded logs: samples, and what is known of their presses.
