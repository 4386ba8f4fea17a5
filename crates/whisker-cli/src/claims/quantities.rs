//! Quantities that `recommended` states with contacts: the gain and mounting of a sensor that deviates from its calibration, and
//! the velocity of moving objects.

use testbed::results::QuantityRow;
use testbed::statistics::{NORMAL_95, mean, rms};

use super::{Claim, Context, RECOMMENDED, WHISKERS, hollow};

/// Run of the suite of contacts of 22 s, in which gain and mounting deviate.
const DEVIATIONS: &str = "deviations";

/// Runs of these claims.
pub(super) const RUNS: &[&str] = &[DEVIATIONS, hollow::RUN];

/// Duration of contact after which gain and mounting are compared with their bounds.
const FOUND_S: f64 = 20.0;

/// Deviations that the readings determine, in words. They hardly determine the position of the mounting: an estimator that states
/// its prior is at the bound.
const DETERMINED: [(&str, &str); 2] = [("gain", "gain of the sensor"), ("mount_rad", "yaw of the mounting")];

/// Objects that move, by the beginning of the names of their groups.
const MOVING: [(&str, &str); 2] = [("moving_pin", "pin"), ("moving_circle", "circle")];

/// A quantity of a run: those of its rows by `recommended` that are selected.
#[derive(Clone)]
struct Selected<F> {
    run: &'static str,
    id: String,
    words: String,
    is_in: F,
}

pub(super) fn claims() -> Vec<Claim> {
    let deviations = WHISKERS.into_iter().flat_map(|whisker| DETERMINED.map(|quantity| (whisker, quantity)));
    let deviations = deviations.flat_map(|(whisker, (quantity, words))| {
        let selected = Selected {
            run: DEVIATIONS,
            id: format!("{quantity}_{whisker}"),
            words: format!("{words}, {whisker} whisker, after 20 s of contact"),
            is_in: move |row: &QuantityRow| {
                row.whisker == whisker && row.quantity == quantity && row.contact_s >= FOUND_S
            },
        };
        [selected.over_bound(), selected.covered()]
    });
    let velocities = WHISKERS.into_iter().flat_map(|whisker| MOVING.map(|object| (whisker, object)));
    let velocities = velocities.flat_map(|(whisker, (group, words))| {
        let selected = Selected {
            run: hollow::RUN,
            id: format!("velocity_{group}_{whisker}"),
            words: format!(
                "velocity in each direction of a {words} that moves, {whisker} whisker, at the last contact"
            ),
            is_in: move |row: &QuantityRow| {
                row.whisker == whisker && row.group.starts_with(group) && row.quantity.starts_with("object_v")
            },
        };
        [selected.error_mm_s(), selected.covered()]
    });
    let stated = [
        stated(DEVIATIONS, "gain", "gain and mounting after at least 20 s of contact", FOUND_S, |_| true),
        stated(hollow::RUN, "object_vx_m_s", "the velocity of an object that moves", 0.0, |group| {
            group.starts_with("moving")
        }),
    ];
    deviations.chain(velocities).chain(stated).collect()
}

impl<F: Fn(&QuantityRow) -> bool + Clone + 'static> Selected<F> {
    fn over_bound(&self) -> Claim {
        let rows = self.clone();
        let about = self.about("ratio of the root mean square error to the posterior Cramér–Rao bound");
        Claim::at_most(format!("{}_over_bound", self.id), about, 1.3, "times", move |context| {
            let bounds: Option<Vec<f64>> = rows.of(context).map(|row| row.bound).collect();
            Ok(rows.error(context).zip(bounds.and_then(|bounds| rms(&bounds))).map(|(error, bound)| error / bound))
        })
    }

    fn error_mm_s(&self) -> Claim {
        let rows = self.clone();
        let about = self.about("root mean square error");
        Claim::at_most(format!("{}_error", self.id), about, 0.2, "mm/s", move |context| {
            Ok(rows.error(context).map(|error_m_s| 1e3 * error_m_s))
        })
    }

    fn covered(&self) -> Claim {
        let rows = self.clone();
        let about = self.about("95 % intervals that contain the true value");
        Claim::at_least(format!("{}_covered", self.id), about, 88.0, "%", move |context| {
            let covered = |row: &QuantityRow| f64::from(row.error.abs() <= NORMAL_95 * row.sd);
            Ok(mean(rows.of(context).map(covered)).map(|share| 100.0 * share))
        })
    }

    fn about(&self, what: &str) -> String {
        format!("suite {}, {RECOMMENDED}: {}: {what}", self.run, self.words)
    }

    fn of<'a>(&'a self, context: &'a Context) -> impl Iterator<Item = &'a QuantityRow> {
        let rows = context.run(self.run).quantities.iter();
        rows.filter(|row| row.estimator == RECOMMENDED && (self.is_in)(row))
    }

    fn error(&self, context: &Context) -> Option<f64> {
        rms(&self.of(context).map(|row| row.error).collect::<Vec<_>>())
    }
}

/// Share of the trials whose last estimate states a quantity, after this duration of contact.
fn stated(run: &'static str, quantity: &'static str, words: &str, least_s: f64, is_of: fn(&str) -> bool) -> Claim {
    let about = format!("suite {run}, {RECOMMENDED}: trials whose last estimate states {words}");
    Claim::at_least(format!("{quantity}_stated"), about, 90.0, "%", move |context| {
        let run = context.run(run);
        let trials = run.trials_in(RECOMMENDED, is_of).count();
        let is_stated = |row: &&QuantityRow| {
            row.estimator == RECOMMENDED && row.quantity == quantity && is_of(&row.group) && row.contact_s >= least_s
        };
        let stated = run.quantities.iter().filter(is_stated).count();
        Ok((trials > 0).then(|| 100.0 * stated as f64 / trials as f64))
    })
}
