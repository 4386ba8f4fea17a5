//! Time of one evaluation of each registered sensor model: the reading, and the reading with its gradient.

#[allow(dead_code, reason = "shared with tests that use the rest of it")]
#[path = "../tests/world/mod.rs"]
mod world;

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use whisker::frames::{Base, Point};
use whisker::sensor::MODELS;

/// Number of contacts, evaluated in turn so that no model can reuse its last result.
const CONTACTS: usize = 1000;

fn main() {
    divan::main();
}

/// Names of all registered models.
fn names() -> Vec<&'static str> {
    MODELS.iter().map(|row| row.kind).collect()
}

/// Contacts along the whisker.
fn contacts() -> Vec<Point<Base>> {
    (0..CONTACTS).map(|i| Point::new(0.03 + 4e-5 * i as f64, -0.008)).collect()
}

#[divan::bench(args = names(), max_time = 1)]
fn reading(bencher: Bencher, name: &str) {
    let (face, contacts) = (world::face(name), contacts());
    bencher.counter(ItemsCount::new(CONTACTS)).bench_local(|| {
        for contact in &contacts {
            black_box(face.model.reading_n_m(*contact));
        }
    });
}

#[divan::bench(args = names(), max_time = 1)]
fn reading_and_gradient(bencher: Bencher, name: &str) {
    let (face, contacts) = (world::face(name), contacts());
    bencher.counter(ItemsCount::new(CONTACTS)).bench_local(|| {
        for contact in &contacts {
            black_box(face.model.predict(*contact));
        }
    });
}
