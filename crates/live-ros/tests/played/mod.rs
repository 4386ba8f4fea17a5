//! Recordings played as messages.

use std::path::Path;

use bag::Reader;
use bag::messages::AnyMessage;
use live_ros::{Setup, Taken};

/// Messages of a recording with the times of their arrival (s) and their topics.
pub(crate) fn messages_of(recording: &Path) -> Vec<(f64, String, AnyMessage)> {
    let reader = Reader::open(recording).expect("a recording");
    let records = reader.records().map(|record| record.expect("whole"));
    let message = |record: &bag::Record| record.decode_any().expect("valid").expect("a known type");
    records.map(|record| (1e-9 * record.time_ns as f64, record.topic.clone(), message(&record))).collect()
}

/// Plays messages, each at its time of arrival.
pub(crate) fn play(setup: &mut Setup, messages: &[(f64, String, AnyMessage)]) -> Taken {
    let (mut taken, mut routed) = (Taken::default(), Vec::new());
    for (at_s, topic, message) in messages {
        setup.router.route(topic, message, &mut routed);
        for input in routed.drain(..) {
            let whisker = &mut setup.whiskers[input.whisker.unwrap_or(0)];
            whisker.take(input.t_s, input.input, *at_s, &mut taken).expect("taken");
        }
    }
    setup.whiskers[0].finish(&mut taken).expect("finished");
    taken
}

/// Reads a mapping.
pub(crate) fn read(path: &Path) -> Setup {
    Setup::read(path).unwrap_or_else(|error| panic!("{error:#}"))
}
