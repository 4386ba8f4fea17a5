//! Contacts that a map leaves out.

#[path = "../../whisker/tests/world/mod.rs"]
mod world;

use nalgebra::Matrix2;
use testbed::map::{MapConfig, Observer};
use trace::Instant;
use whisker::estimators::{Estimate, estimator};

/// Contacts of the world, certain to 0.1 mm, of which those selected by `change` are changed: number of points, and of those left
/// out.
fn observed(change: impl Fn(usize, &mut Estimate)) -> (usize, usize) {
    let knowledge = world::knowledge(3e-7);
    let mut recommended = world::estimator(estimator("recommended").unwrap(), &knowledge, 1);
    let mut observer = Observer::new(&knowledge, 0, &MapConfig::default()).unwrap();
    for (row, (t_s, sample)) in world::samples(&knowledge, 0.6, |_| true).into_iter().enumerate() {
        let base = world::base(t_s);
        let moment_z_n_m = sample.reading_n_m;
        let known = Instant { t_s, base, twist: None, moment_z_n_m, rotation_z_rad: None };
        let estimate = recommended.step(&sample).map(|estimate| {
            let contact = base.inverse().apply(world::contact());
            let covariance_m2 = Some(Matrix2::identity() * 1e-8);
            let mut found = Estimate { contact, covariance_m2, at_tip: false, calibrated: true, ..estimate };
            (found.model_doubtful, found.second_contact) = (false, false);
            change(row, &mut found);
            found
        });
        observer.observe(&knowledge, &known, sample.reading_n_m, estimate.as_ref());
    }
    (observer.view().points.len(), observer.view().left_out)
}

#[test]
fn verif_contacts_in_doubt_are_left_out_and_counted() {
    let (all, none) = observed(|_, _| ());
    assert!(all > 50 && none == 0, "{all} {none}");
    let (points, left_out) = observed(|row, estimate| estimate.model_doubtful = row % 4 == 0);
    assert!(points + left_out == all && left_out.abs_diff(all / 4) <= 1, "{points} {left_out} {all}");
    let (points, left_out) = observed(|row, estimate| estimate.second_contact = row % 2 == 0);
    assert!(points + left_out == all && left_out.abs_diff(all / 2) <= 1, "{points} {left_out} {all}");
    // A contact that is too uncertain for the map is not one that is left out for doubt.
    let vague = |_: usize, estimate: &mut Estimate| {
        estimate.model_doubtful = true;
        estimate.covariance_m2 = Some(Matrix2::identity() * 1e-4);
    };
    assert_eq!(observed(vague), (0, 0));
}
