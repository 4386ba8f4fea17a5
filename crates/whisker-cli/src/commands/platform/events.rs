//! Output of detections as they occur.

use std::path::PathBuf;

use clap::ValueEnum;
use platform::calibration::{Detection, Press};
use platform::printer::Head;
use platform::record::{Ending, Sink};
use platform::routine::Contact;
use platform::{Error, Sample};
use serde_json::{Value, json};

use crate::commands::table::millimetres;
use crate::commands::{diagnose, print};

/// Format of events.
#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub(super) enum Form {
    /// One JSON object a line
    Json,
    /// Comma-separated values with a header
    Csv,
}

/// Output of events to stdout. If it receives pushes too, it prints a summary of the errors at the end.
pub(super) struct Events {
    form: Form,
    /// Onset (s) and estimated distance (m) of the last press.
    last: Option<(f64, Option<f64>)>,
    /// Error of each push (m). `None` for a push that was not detected.
    errors_m: Vec<Option<f64>>,
}

impl Events {
    pub(super) fn begin(form: Form) -> anyhow::Result<Self> {
        if form == Form::Csv {
            print("t_s,event,onset_s,distance_m,low_m,high_m,slope_counts_per_s\n")?;
        }
        Ok(Self { form, last: None, errors_m: Vec::new() })
    }

    pub(super) fn report(&mut self, detection: &Detection) -> std::io::Result<()> {
        match detection {
            Detection::Pressed(press, estimate) => {
                let Press { t_s, onset_s, features, .. } = press;
                let (distance_m, interval_m) = (estimate.map(|e| e.distance_m), estimate.and_then(|e| e.interval_m));
                self.last = Some((*onset_s, distance_m));
                match self.form {
                    Form::Json => print(&format!("{}\n", pressed(press, distance_m, interval_m))),
                    Form::Csv => {
                        let cell = |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:.6}"));
                        let [distance, low, high] =
                            [distance_m, interval_m.map(|[low, _]| low), interval_m.map(|[_, high]| high)].map(cell);
                        let slope = features.slope_counts_per_s;
                        print(&format!("{t_s:.6},pressed,{onset_s:.6},{distance},{low},{high},{slope:.3}\n"))
                    }
                }
            }
            Detection::Released(t_s) => match self.form {
                Form::Json => print(&format!("{}\n", json!({"t_s": t_s, "event": "released"}))),
                Form::Csv => print(&format!("{t_s:.6},released,,,,,\n")),
            },
        }
    }

    /// Prints a push, after its detection.
    fn pushed(&mut self, Contact { start_s, end_s, distance_m, .. }: Contact) -> std::io::Result<()> {
        let found = self.last.filter(|(onset_s, _)| (start_s..end_s).contains(onset_s));
        self.errors_m.push(found.and_then(|(_, found_m)| found_m).map(|found_m| found_m - distance_m));
        match self.form {
            Form::Json => {
                let pushed = json!({"t_s": end_s, "event": "pushed", "onset_s": start_s, "distance_m": distance_m});
                print(&format!("{pushed}\n"))
            }
            Form::Csv => print(&format!("{end_s:.6},pushed,{start_s:.6},{distance_m:.6},,,\n")),
        }
    }

    fn summary(&self) -> String {
        let errors_m: Vec<f64> = self.errors_m.iter().copied().flatten().collect();
        let mut text = format!("{} of {} pushes found", errors_m.len(), self.errors_m.len());
        if !errors_m.is_empty() {
            let rmse_m = (errors_m.iter().map(|error_m| error_m * error_m).sum::<f64>() / errors_m.len() as f64).sqrt();
            let worst_m = errors_m.iter().fold(0.0, |worst: f64, error_m| worst.max(error_m.abs()));
            let [rmse, worst] = [rmse_m, worst_m].map(|error_m| millimetres(Some(error_m)));
            text.push_str(&format!(": RMSE {rmse}, worst {worst} mm"));
        }
        text
    }
}

/// Event of a press. The interval is absent if it is not known.
fn pressed(press: &Press, distance_m: Option<f64>, interval_m: Option<[f64; 2]>) -> Value {
    let Press { t_s, onset_s, features, .. } = press;
    let mut event = json!({"t_s": t_s, "event": "pressed", "onset_s": onset_s, "distance_m": distance_m});
    if let Some(interval_m) = interval_m {
        event["interval_m"] = json!(interval_m);
    }
    event["features"] = json!(features);
    event
}

impl Sink for Events {
    fn samples(&mut self, _: &[Sample]) -> Result<(), Error> {
        Ok(())
    }

    fn detected(&mut self, detection: &Detection) -> Result<(), Error> {
        self.report(detection).map_err(Error::system("standard output"))
    }

    fn head(&mut self, _: Head) -> Result<(), Error> {
        Ok(())
    }

    fn contact(&mut self, contact: Contact) -> Result<(), Error> {
        self.pushed(contact).map_err(Error::system("standard output"))
    }

    fn finish(self: Box<Self>, _: Ending) -> Result<Vec<PathBuf>, Error> {
        diagnose(&self.summary());
        Ok(Vec::new())
    }
}

#[cfg(test)]
mod tests {
    use platform::calibration::Features;

    use super::*;

    #[test]
    fn verif_an_unknown_interval_is_absent() {
        let press = Press { onset_s: 1.0, t_s: 1.5, direction: 1.0, features: Features::of_slope(9.0) };
        let keys = |interval_m| {
            pressed(&press, Some(0.1), interval_m).as_object().unwrap().keys().cloned().collect::<Vec<_>>()
        };
        assert_eq!(keys(None), ["t_s", "event", "onset_s", "distance_m", "features"]);
        assert_eq!(keys(Some([0.09, 0.11])), ["t_s", "event", "onset_s", "distance_m", "interval_m", "features"]);
    }
}
