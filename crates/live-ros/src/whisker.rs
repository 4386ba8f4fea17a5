//! Live estimation of one whisker: inputs in, contacts, events, shapes and states out.

use bag::messages::{DiagnosticStatus, Header, KeyValue, Level, PoseWithCovariance, PoseWithCovarianceStamped, Time};
use live::counts::{Conversion, Converted, Reading, Stream};
use live::{AnswerOf, Counters, Event, Kind, LiveEstimator, OutputOf, Status};
use nalgebra::Vector3;
use whisker::estimators::{Installation, Uncertain};

use crate::chain::{Chain, Measured, Projection};
use crate::drawing::Shape;
use crate::epoch::Epoch;
use crate::map::Observed;

/// Longest time without an answer after which a whisker counts as silent (s).
const SILENT_S: f64 = 1.0;

/// Smallest number of readings in contact without an estimate that are a warning: an estimator may wait at the beginning of a
/// touch.
const FEW: u64 = 10;

/// Measurement for a whisker from a message.
#[derive(Clone, Debug, PartialEq)]
pub struct Input(pub(crate) Content);

#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Content {
    /// Moment at the root in Base (N m).
    Moment(Vector3<f64>),
    /// Counts of a sensor.
    Counts(Stream, [f64; 3]),
    /// Measurement of the motion.
    Motion(Measured),
}

/// Estimated contact.
#[derive(Clone, Debug, PartialEq)]
pub struct Contact {
    /// The message.
    pub message: PoseWithCovarianceStamped,
    /// Time of the reading (ns).
    pub time_ns: u64,
    /// Arrival of the reading (s).
    pub arrived_s: f64,
}

/// Contacts and events in the order in which they came about.
#[derive(Clone, Debug, Default)]
pub struct Taken {
    /// Contacts.
    pub contacts: Vec<Contact>,
    /// Events of the streams.
    pub events: Vec<Event>,
}

/// Latency from the arrival of a reading to its published contact (s).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Latency {
    /// Median.
    pub median_s: f64,
    /// 99th percentile.
    pub p99_s: f64,
    /// Largest.
    pub worst_s: f64,
}

/// Live estimation of one whisker, in the plane or in space.
pub trait Whisker: Send {
    /// Its name.
    fn name(&self) -> &str;

    /// Takes an input of this time that arrives at `now_s`.
    ///
    /// # Errors
    /// If the estimator cannot be built again after a jump of a clock.
    fn take(&mut self, t_s: f64, input: Input, now_s: f64, taken: &mut Taken) -> anyhow::Result<()>;

    /// Answers the readings that need not wait any longer at `now_s`.
    ///
    /// # Errors
    /// As [`Self::take`].
    fn poll(&mut self, now_s: f64, taken: &mut Taken) -> anyhow::Result<()>;

    /// Time of arrival at which [`Self::poll`] is due. `None` while no reading waits.
    fn deadline_s(&self) -> Option<f64>;

    /// Answers all readings at the end of the streams.
    ///
    /// # Errors
    /// As [`Self::take`].
    fn finish(&mut self, taken: &mut Taken) -> anyhow::Result<()>;

    /// Time of the last reading with a pose (ns).
    fn newest_ns(&self) -> Option<u64>;

    /// Observations so far, for the map.
    fn observed(&self) -> Observed;

    /// Counts of the messages so far.
    fn counters(&self) -> &live::Counters;

    /// The whisker, its contact with the ellipse or ellipsoid, and in the plane the outline of the object with its band, at the
    /// last answer, with its time (ns). `None` while poses or readings are missing at `now_s` on the clock of arrivals, and before
    /// the first ones.
    fn shapes(&self, now_s: f64) -> Option<(u64, Vec<Shape>)>;

    /// State since the last call, at `now_s` on the clock of arrivals.
    fn diagnose(&mut self, now_s: f64, latency: Latency) -> DiagnosticStatus;
}

/// Part of the live estimation that differs between the plane and space.
pub(crate) trait Geometry: Send {
    /// Kind of the estimator.
    type Kind: Kind;
    /// Conversion of counts.
    type Counts: Conversion<Reading = <Self::Kind as Kind>::Reading> + Send;
    /// Projection of the poses.
    type Projection: Projection<Base = <Self::Kind as Kind>::Base>;

    /// Reading from the moment at the root (N m).
    fn reading(moment_n_m: &Vector3<f64>) -> <Self::Kind as Kind>::Reading;

    /// Values of an estimate for the diagnostics.
    fn diagnosis(estimate: &<Self::Kind as Kind>::Estimate) -> Diagnosis;

    /// Takes an answer with a pose, for the map.
    fn observe(&mut self, answer: &AnswerOf<Self::Kind>);

    /// Observations so far, for the map.
    fn observed(&self, projection: &Self::Projection) -> Observed;

    /// The contact of an answer, if it has one. The x axis of its pose is the outward normal of the object.
    fn contact(&self, answer: &AnswerOf<Self::Kind>, projection: &Self::Projection) -> Option<PoseWithCovariance>;

    /// Shapes at an answer, whose names begin with `name`.
    fn shapes(&self, name: &str, answer: &AnswerOf<Self::Kind>, estimator: &EstimatorOf<Self>) -> Vec<Shape>;
}

/// Live estimator of a whisker on transforms or joints.
pub(crate) type EstimatorOf<S> = LiveEstimator<Chain<<S as Geometry>::Projection>, <S as Geometry>::Kind>;

/// Values of an estimate for the diagnostics.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Diagnosis {
    /// Whether the readings contradict the models.
    pub(crate) is_doubtful: bool,
    /// Normalised innovation squared, divided by the number of components of the reading.
    pub(crate) nis: Option<f64>,
    /// Deviation of the sensor.
    pub(crate) deviation: Option<Installation>,
}

/// Values since the last diagnostics.
#[derive(Clone, Copy, Debug, Default)]
struct Window {
    answers: u64,
    /// Readings that were given to the estimator, and their estimates.
    used: u64,
    estimates: u64,
    doubtful: u64,
    gated: u64,
    /// Readings that were not used because they are late, repeated or not finite.
    late: u64,
    repeated: u64,
    not_finite: u64,
    jumps: u64,
    nis: (f64, u64),
}

impl Window {
    /// Reasons for which all readings were left out. `None` if there are none, or one was not.
    fn left_out(&self) -> Option<String> {
        let counts = [(self.late, "late"), (self.repeated, "repeated"), (self.not_finite, "not finite")];
        let is_all = self.answers > 0 && counts.iter().map(|(count, _)| count).sum::<u64>() == self.answers;
        let reasons: Vec<&str> = counts.iter().filter(|(count, _)| *count > 0).map(|(_, reason)| *reason).collect();
        is_all.then(|| reasons.join(" or "))
    }
}

/// Settings of a whisker.
pub(crate) struct Fixed {
    pub(crate) name: String,
    /// Frame of the published contacts.
    pub(crate) frame: String,
    pub(crate) epoch: Epoch,
}

/// Estimator of a whisker with its conversion from and to messages.
pub(crate) struct Estimation<S: Geometry> {
    fixed: Fixed,
    geometry: S,
    estimator: EstimatorOf<S>,
    counts: Option<S::Counts>,
    out: OutputOf<S::Kind>,
    last: Option<AnswerOf<S::Kind>>,
    /// The last stated deviation of the sensor.
    deviation: Option<Installation>,
    /// Arrivals of the last answered reading, and of the last one with a pose.
    answered_s: Option<f64>,
    posed_s: Option<f64>,
    blocked: Option<Status>,
    window: Window,
    /// Counts at the beginning of the window.
    before: Counters,
}

impl<S: Geometry> Estimation<S> {
    pub(crate) fn new(fixed: Fixed, geometry: S, estimator: EstimatorOf<S>, counts: Option<S::Counts>) -> Self {
        let (out, last, window) = (OutputOf::<S::Kind>::default(), None, Window::default());
        let (deviation, answered_s, posed_s, blocked, before) = (None, None, None, None, Counters::default());
        Self { fixed, geometry, estimator, counts, out, last, deviation, answered_s, posed_s, blocked, window, before }
    }

    /// Passes complete counts on as readings.
    fn convert(&mut self, now_s: f64) -> anyhow::Result<()> {
        while let Some(converted) = self.counts.as_mut().and_then(|counts| counts.next(now_s)) {
            let Converted { t_s, arrived_s, reading: Reading::Of(reading_n_m) } = converted else { continue };
            // Its arrival is that of the counts; the clock of arrivals does not run back.
            self.estimator.reading(t_s, reading_n_m, arrived_s, &mut self.out)?;
        }
        Ok(())
    }

    /// Takes the answers of the estimator.
    fn answer(&mut self, taken: &mut Taken) {
        for event in self.out.events.drain(..) {
            if matches!(event, Event::Jumped { .. }) {
                self.window.jumps += 1;
                self.deviation = None;
            }
            taken.events.push(event);
        }
        for answer in std::mem::take(&mut self.out.answers) {
            self.window.answers += 1;
            self.answered_s = Some(answer.arrived_s);
            match answer.status {
                Status::Used | Status::Gated => {
                    self.blocked = None;
                    self.window.used += 1;
                    self.window.gated += u64::from(answer.status == Status::Gated);
                }
                Status::Frozen | Status::Stale | Status::OffPlane => self.blocked = Some(answer.status),
                Status::Late => self.window.late += 1,
                Status::Repeated => self.window.repeated += 1,
                Status::NotFinite => self.window.not_finite += 1,
                Status::Dropped => {}
            }
            if answer.base.is_none() {
                continue;
            }
            self.posed_s = Some(answer.arrived_s);
            self.geometry.observe(&answer);
            if let Some(estimate) = &answer.estimate {
                let Diagnosis { is_doubtful, nis, deviation } = S::diagnosis(estimate);
                self.deviation = deviation.or(self.deviation);
                self.window.estimates += 1;
                self.window.doubtful += u64::from(is_doubtful);
                if let Some(nis) = nis {
                    self.window.nis.0 += nis;
                    self.window.nis.1 += 1;
                }
            }
            taken.contacts.extend(self.contact(&answer));
            self.last = Some(answer);
        }
    }

    fn is_silent(last_s: Option<f64>, now_s: f64) -> bool {
        last_s.is_none_or(|last_s| now_s - last_s > SILENT_S)
    }

    /// Level and message of the diagnostics of a window.
    fn state(&self, window: &Window, now_s: f64) -> (Level, String) {
        let counters = self.estimator.counters();
        let [touching, unanswered] =
            [counters.touching - self.before.touching, counters.unanswered - self.before.unanswered];
        let is_unanswered = unanswered >= FEW && unanswered == touching && touching == window.used;
        if window.jumps > 0 {
            return (Level::ERROR, "a clock jumped; the estimator restarted".into());
        }
        if let Some(reasons) = window.left_out() {
            return (Level::STALE, format!("all readings are {reasons}: no estimates"));
        }
        let (level, message) = match self.blocked {
            Some(Status::OffPlane) => (Level::ERROR, "the pose is off the plane: no estimates"),
            Some(Status::Stale) => (Level::STALE, "no poses: no estimates"),
            _ if Self::is_silent(self.answered_s, now_s) => (Level::STALE, "no readings"),
            Some(_) => (Level::WARN, "frozen readings, although the touched whisker moves: no estimates"),
            None if is_unanswered => (Level::WARN, "in contact without an estimate"),
            None if window.doubtful > 0 => (Level::WARN, "the readings contradict the models"),
            None if window.gated > 0 => (Level::WARN, "readings beyond the largest plausible one were left out"),
            None => (Level::OK, "running"),
        };
        (level, message.into())
    }

    fn contact(&self, answer: &AnswerOf<S::Kind>) -> Option<Contact> {
        let pose = self.geometry.contact(answer, self.estimator.motion().projection())?;
        let time_ns = self.fixed.epoch.nanoseconds(answer.t_s);
        let header = Header { stamp: Time::from_nanoseconds(time_ns), frame_id: self.fixed.frame.clone() };
        Some(Contact { message: PoseWithCovarianceStamped { header, pose }, time_ns, arrived_s: answer.arrived_s })
    }
}

impl<S: Geometry> Whisker for Estimation<S> {
    fn name(&self) -> &str {
        &self.fixed.name
    }

    fn take(&mut self, t_s: f64, Input(content): Input, now_s: f64, taken: &mut Taken) -> anyhow::Result<()> {
        match content {
            Content::Moment(moment_n_m) => {
                self.estimator.reading(t_s, S::reading(&moment_n_m), now_s, &mut self.out)?;
            }
            Content::Motion(measured) => self.estimator.pose(t_s, measured, now_s, &mut self.out)?,
            Content::Counts(stream, counts) => {
                self.counts.iter_mut().for_each(|of| of.take(stream, t_s, counts, now_s));
                self.convert(now_s)?;
            }
        }
        self.answer(taken);
        Ok(())
    }

    fn poll(&mut self, now_s: f64, taken: &mut Taken) -> anyhow::Result<()> {
        self.convert(now_s)?;
        self.estimator.poll(now_s, &mut self.out);
        self.answer(taken);
        Ok(())
    }

    fn deadline_s(&self) -> Option<f64> {
        let counts_s = self.counts.as_ref().and_then(Conversion::deadline_s);
        [self.estimator.deadline_s(), counts_s].into_iter().flatten().reduce(f64::min)
    }

    fn finish(&mut self, taken: &mut Taken) -> anyhow::Result<()> {
        self.convert(f64::INFINITY)?;
        self.estimator.finish(&mut self.out);
        self.answer(taken);
        Ok(())
    }

    fn newest_ns(&self) -> Option<u64> {
        self.last.as_ref().map(|answer| self.fixed.epoch.nanoseconds(answer.t_s))
    }

    fn observed(&self) -> Observed {
        self.geometry.observed(self.estimator.motion().projection())
    }

    fn counters(&self) -> &live::Counters {
        self.estimator.counters()
    }

    fn shapes(&self, now_s: f64) -> Option<(u64, Vec<Shape>)> {
        let is_known = self.blocked.is_none() && !Self::is_silent(self.posed_s, now_s);
        let answer = self.last.as_ref().filter(|_| is_known)?;
        let shapes = self.geometry.shapes(&self.fixed.name, answer, &self.estimator);
        Some((self.fixed.epoch.nanoseconds(answer.t_s), shapes))
    }

    fn diagnose(&mut self, now_s: f64, latency: Latency) -> DiagnosticStatus {
        let window = std::mem::take(&mut self.window);
        let (level, message) = self.state(&window, now_s);
        let counters = self.estimator.counters();
        self.before = *counters;
        let mut values: Vec<(&str, String)> = vec![
            ("nis_mean", (window.nis.1 > 0).then(|| window.nis.0 / window.nis.1 as f64).map_or("".into(), shown)),
            ("model_doubtful", (window.doubtful > 0).to_string()),
            ("window_readings", window.answers.to_string()),
            ("window_estimates", window.estimates.to_string()),
            ("window_gated", window.gated.to_string()),
            ("latency_median_ms", shown(1e3 * latency.median_s)),
            ("latency_p99_ms", shown(1e3 * latency.p99_s)),
            ("latency_worst_ms", shown(1e3 * latency.worst_s)),
        ];
        values.extend(counters.named().map(|(name, count)| (name, count.to_string())));
        if let Some(counts) = &self.counts {
            values.push(("counts_incomplete", counts.incomplete().to_string()));
            values.push(("counts_late", counts.late().to_string()));
            values.push(("zeroings_repeated", counts.zeroings_repeated().to_string()));
        }
        values.extend(
            self.deviation
                .iter()
                .flat_map(Installation::by_name)
                .map(|(name, Uncertain { value, sd })| (name, format!("{value:.2e} (standard deviation {sd:.1e})"))),
        );
        let values = values.into_iter().map(|(key, value)| KeyValue { key: key.into(), value }).collect();
        DiagnosticStatus {
            level,
            name: format!("whisker {}", self.fixed.name),
            message,
            hardware_id: self.fixed.name.clone(),
            values,
        }
    }
}

/// A number with four decimals.
fn shown(value: f64) -> String {
    format!("{value:.4}")
}
