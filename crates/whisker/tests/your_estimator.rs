//! The worked example of `docs/your-estimator.md` compiles, works, and is shown there unchanged.

#[path = "../../../examples/swarm.rs"]
mod swarm;
mod world;

use serde_json::json;
use world::{base, contact, estimator, knowledge, samples};

#[test]
fn verif_the_example_finds_the_contact() {
    let knowledge = knowledge(3e-7);
    let samples = samples(&knowledge, 6.0, |_| true);
    let mut estimator = estimator(&swarm::ROW, &knowledge, 1);
    let estimates: Vec<_> = samples.iter().map(|(_, sample)| estimator.step(sample)).collect();
    let estimate = estimates.last().unwrap().expect("the contact is tracked to the end");
    let error_m = base(samples.last().unwrap().0).apply(estimate.contact).distance(&contact());
    assert!(error_m < 0.3e-3, "{} mm", 1e3 * error_m);
}

#[test]
fn robust_its_settings_are_checked() {
    let knowledge = knowledge(3e-7);
    for (config, expected) in
        [(json!({"nodes": 1}), "`nodes`: found 1, expected 2 or more"), (json!({"node": 9}), "`node`")]
    {
        let message = (swarm::ROW.build)(&config, &knowledge).err().expect(expected).to_string();
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn verif_the_page_shows_the_example_unchanged() {
    let page = include_str!("../../../docs/your-estimator.md");
    assert!(
        page.contains(include_str!("../../../examples/swarm.rs")),
        "docs/your-estimator.md differs from examples/swarm.rs"
    );
}
