//! Live estimation of one whisker: inputs in, contacts, events, shapes and states out.

use std::sync::Arc;

use bag::messages::{DiagnosticStatus, Header, KeyValue, Level, PoseWithCovariance, PoseWithCovarianceStamped, Time};
use live::counts::{Converted, Counts, Reading, Stream};
use live::{Answer, Event, LiveEstimator, Output, Status};
use testbed::contour::Contour;
use testbed::map::{Observer, View};
use trace::Instant;
use whisker::elastica::Elastica;
use whisker::estimators::{Installation, Knowledge, Uncertain};
use whisker::frames::{Base, Point};

use crate::chain::{Chain, Measured, Plane};
use crate::drawing::{InSpace, Shape};
use crate::epoch::Epoch;

/// Number of points of a drawn whisker.
const POINTS: u32 = 24;

/// Largest number of kept touched points, beyond which the oldest touches are dropped.
const MOST_POINTS: usize = 50_000;

/// Longest time without an answer after which a whisker counts as silent (s).
const SILENT_S: f64 = 1.0;

/// Colours of a whisker, of its contact and of its outline.
const WHISKER_COLOR: [f32; 4] = [0.85, 0.85, 0.85, 1.0];
const CONTACT_COLOR: [f32; 4] = [1.0, 0.3, 0.1, 0.5];
const OUTLINE_COLOR: [f32; 3] = [1.0, 0.7, 0.0];

/// Measurement for a whisker from a message.
#[derive(Clone, Debug, PartialEq)]
pub struct Input(pub(crate) Content);

#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Content {
    /// Moment about the z axis of the base (N m).
    Moment(f64),
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

/// Values since the last diagnostics.
#[derive(Clone, Copy, Debug, Default)]
struct Window {
    answers: u64,
    estimates: u64,
    doubtful: u64,
    gated: u64,
    jumps: u64,
    nis: (f64, u64),
}

/// Live estimator of a whisker.
pub struct Whisker {
    fixed: Fixed,
    estimator: LiveEstimator<Chain>,
    counts: Option<Counts>,
    observer: Observer,
    elastica: Elastica,
    out: Output,
    last: Option<Answer>,
    /// The last stated deviation of the sensor.
    deviation: Option<Installation>,
    /// Arrival of the last answered reading.
    answered_s: Option<f64>,
    blocked: Option<Status>,
    window: Window,
}

/// Settings of a whisker.
pub(crate) struct Fixed {
    pub(crate) name: String,
    /// Frame of the published contacts.
    pub(crate) frame: String,
    pub(crate) plane: Plane,
    pub(crate) knowledge: Arc<Knowledge>,
    pub(crate) epoch: Epoch,
}

impl Whisker {
    pub(crate) fn new(
        fixed: Fixed,
        estimator: LiveEstimator<Chain>,
        counts: Option<Counts>,
        observer: Observer,
    ) -> anyhow::Result<Self> {
        let elastica = Elastica::new(&fixed.knowledge.whisker)?;
        let (out, last, window) = (Output::default(), None, Window::default());
        let (answered_s, blocked) = (None, None);
        let deviation = None;
        Ok(Self { fixed, estimator, counts, observer, elastica, out, last, deviation, answered_s, blocked, window })
    }

    /// Name of the whisker.
    pub fn name(&self) -> &str {
        &self.fixed.name
    }

    /// Takes an input of this time that arrives at `now_s`.
    ///
    /// # Errors
    /// If the estimator cannot be built again after a jump of a clock.
    pub fn take(&mut self, t_s: f64, Input(content): Input, now_s: f64, taken: &mut Taken) -> anyhow::Result<()> {
        match content {
            Content::Moment(n_m) => self.estimator.reading(t_s, n_m, now_s, &mut self.out)?,
            Content::Motion(measured) => self.estimator.pose(t_s, measured, now_s, &mut self.out)?,
            Content::Counts(stream, counts) => {
                self.counts.iter_mut().for_each(|of| of.take(stream, t_s, counts, now_s));
                self.convert(now_s)?;
            }
        }
        self.answer(taken);
        Ok(())
    }

    /// Answers the readings that need not wait any longer at `now_s`.
    ///
    /// # Errors
    /// As [`Self::take`].
    pub fn poll(&mut self, now_s: f64, taken: &mut Taken) -> anyhow::Result<()> {
        self.convert(now_s)?;
        self.estimator.poll(now_s, &mut self.out);
        self.answer(taken);
        Ok(())
    }

    /// Time of arrival at which [`Self::poll`] is due. `None` while no reading waits.
    pub fn deadline_s(&self) -> Option<f64> {
        let counts_s = self.counts.as_ref().and_then(Counts::deadline_s);
        [self.estimator.deadline_s(), counts_s].into_iter().flatten().reduce(f64::min)
    }

    /// Answers all readings at the end of the streams.
    ///
    /// # Errors
    /// As [`Self::take`].
    pub fn finish(&mut self, taken: &mut Taken) -> anyhow::Result<()> {
        self.convert(f64::INFINITY)?;
        self.estimator.finish(&mut self.out);
        self.answer(taken);
        Ok(())
    }

    /// Height of its plane above the origin of the fixed frame, along the normal; see [`Chain::height_m`].
    pub fn height_m(&self) -> Option<f64> {
        self.estimator.motion().height_m()
    }

    /// Time of the last reading with a pose (ns).
    pub fn newest_ns(&self) -> Option<u64> {
        self.last.as_ref().map(|answer| self.fixed.epoch.nanoseconds(answer.t_s))
    }

    /// Observations so far, for the map.
    pub fn view(&self) -> &View {
        self.observer.view()
    }

    /// Counts of the messages so far.
    pub fn counters(&self) -> &live::Counters {
        self.estimator.counters()
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
            self.window.gated += u64::from(answer.status == Status::Gated);
            self.answered_s = Some(answer.arrived_s);
            match answer.status {
                Status::Used | Status::Gated => self.blocked = None,
                Status::Stale | Status::OffPlane => self.blocked = Some(answer.status),
                Status::Late | Status::Repeated | Status::NotFinite | Status::Dropped => {}
            }
            let Some(base) = answer.base else { continue };
            let known =
                Instant { t_s: answer.t_s, base, twist: None, moment_z_n_m: answer.reading_n_m, rotation_z_rad: None };
            self.observer.observe(&self.fixed.knowledge, &known, answer.reading_n_m, answer.estimate.as_ref());
            self.observer.view_mut().limit(MOST_POINTS);
            if let Some(estimate) = &answer.estimate {
                self.deviation = estimate.installation.or(self.deviation);
                self.window.estimates += 1;
                self.window.doubtful += u64::from(estimate.model_doubtful);
                if let Some(innovation) = estimate.innovation {
                    self.window.nis.0 += innovation.nis;
                    self.window.nis.1 += 1;
                }
            }
            taken.contacts.extend(self.contact(&answer));
            self.last = Some(answer);
        }
    }

    /// The contact of an answer, if it has one. The x axis of its pose is the outward normal of the object.
    fn contact(&self, answer: &Answer) -> Option<Contact> {
        let (base, estimate) = (answer.base?, answer.estimate?);
        let at = base.apply(estimate.contact);
        let tangent_rad = self.fixed.knowledge.tangent_rad(&estimate, answer.reading_n_m) + base.yaw_rad();
        let normal_rad = tangent_rad + estimate.face.away_sign() * std::f64::consts::FRAC_PI_2;
        let in_space = self.in_space();
        let mut covariance = [[0.0; 6]; 6];
        match estimate.covariance_m2.map(|covariance_m2| base.turn(covariance_m2)) {
            Some(in_plane) => {
                let turn = *self.fixed.plane.rotation.to_rotation_matrix().matrix();
                let turn = turn.fixed_view::<3, 2>(0, 0);
                let in_space = turn * in_plane * turn.transpose();
                (0..3).for_each(|row| (0..3).for_each(|column| covariance[row][column] = in_space[(row, column)]));
            }
            None => covariance[0][0] = -1.0,
        }
        let time_ns = self.fixed.epoch.nanoseconds(answer.t_s);
        let pose = bag::messages::Pose {
            position: in_space.point(at.x(), at.y()),
            orientation: in_space.orientation(normal_rad),
        };
        let header = Header { stamp: Time::from_nanoseconds(time_ns), frame_id: self.fixed.frame.clone() };
        let message = PoseWithCovarianceStamped { header, pose: PoseWithCovariance { pose, covariance } };
        Some(Contact { message, time_ns, arrived_s: answer.arrived_s })
    }

    fn in_space(&self) -> InSpace {
        InSpace { rotation: self.fixed.plane.rotation, height_m: self.height_m().unwrap_or(0.0) }
    }

    /// The whisker, its contact with the ellipse, and the outline of the object with its band, at the last answer, and the time of
    /// that (ns). `None` while the poses are missing, and before the first one.
    pub fn shapes(&self) -> Option<(u64, Vec<Shape>)> {
        let answer = self.last.as_ref().filter(|_| self.blocked.is_none())?;
        let (base, in_space) = (answer.base?, self.in_space());
        let name = |part: &str| format!("{}/{part}", self.fixed.name);
        let on_plane = |at: Point<Base>| {
            let at = base.apply(at);
            (at.x(), at.y())
        };
        let form = in_space.line(self.wire(answer).into_iter().map(on_plane));
        let mut shapes = vec![Shape { name: name("whisker"), number: 0, color: WHISKER_COLOR, form }];
        if let Some(estimate) = &answer.estimate
            && let Some(covariance_m2) = estimate.covariance_m2
        {
            let form = in_space.ellipse(on_plane(estimate.contact), &base.turn(covariance_m2));
            shapes.extend(form.map(|form| Shape { name: name("contact"), number: 0, color: CONTACT_COLOR, form }));
        }
        let outline = self.estimator.outline().zip(self.estimator.start());
        if let Some(contour) = outline.and_then(|(outline, start)| Contour::carried(&start, &outline)) {
            shapes.extend(in_space.outline(&self.fixed.name, 0, &contour, OUTLINE_COLOR));
        }
        Some((self.fixed.epoch.nanoseconds(answer.t_s), shapes))
    }

    /// Points of the whisker from the root to the tip: bent to its contact, or at rest.
    fn wire(&self, answer: &Answer) -> Vec<Point<Base>> {
        let length_m = self.fixed.knowledge.rest.length_m();
        let arcs = (0..=POINTS).map(|step| length_m * f64::from(step) / f64::from(POINTS));
        let contact = answer.estimate.map(|estimate| estimate.contact);
        let load = contact.and_then(|contact| self.elastica.at_point(contact).ok()).map(|found| found.load);
        match load.and_then(|load| self.elastica.line(load).ok()) {
            Some(line) => arcs.map(|arc_m| line.at(arc_m).0).collect(),
            None => arcs.map(|arc_m| self.fixed.knowledge.rest.point(arc_m)).collect(),
        }
    }

    /// State since the last call, at `now_s` on the clock of arrivals.
    pub fn diagnose(&mut self, now_s: f64, latency: Latency) -> DiagnosticStatus {
        let window = std::mem::take(&mut self.window);
        let is_silent = self.answered_s.is_none_or(|answered_s| now_s - answered_s > SILENT_S);
        let (level, message) = match self.blocked {
            _ if window.jumps > 0 => (Level::ERROR, "a clock jumped; the estimator restarted"),
            Some(Status::OffPlane) => (Level::ERROR, "the pose is off the plane: no estimates"),
            Some(_) => (Level::STALE, "no poses: no estimates"),
            None if is_silent => (Level::STALE, "no readings"),
            None if window.doubtful > 0 => (Level::WARN, "the readings contradict the models"),
            None if window.gated > 0 => (Level::WARN, "readings beyond the largest plausible one were left out"),
            None => (Level::OK, "running"),
        };
        let counters = self.estimator.counters();
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
            values.push(("counts_incomplete", counts.incomplete.to_string()));
            values.push(("counts_late", counts.late.to_string()));
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
            message: message.into(),
            hardware_id: self.fixed.name.clone(),
            values,
        }
    }
}

/// A number with four decimals.
fn shown(value: f64) -> String {
    format!("{value:.4}")
}
