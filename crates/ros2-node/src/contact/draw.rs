//! Drawings, maps and diagnostics, at intervals.

use std::sync::atomic::Ordering;
use std::thread;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use bag::messages::{DiagnosticArray, Header, Time};
use bag::{Publisher, topics};
use live_ros::{Drawing, Latency, Mapper, Observed, Shape};

use super::{NAP, Session, Shared, layer_topic, locked};
use crate::outlet::Outlet;

/// Interval between two diagnostics without an event.
const DIAGNOSE_EVERY: Duration = Duration::from_secs(1);

/// Number of intervals after which a drawing that is not renewed disappears.
const LIFETIME: f64 = 5.0;

/// Topics on which maps, and the objects of a map, are published. Without a subscriber to any of them no map is computed.
const OF_MAPS: [&str; 5] = [topics::MAP, topics::MAP_POINTS, topics::MAP_VOXELS, topics::MARKERS, topics::SCENE];

/// Repetition at an interval.
struct Every {
    interval: Duration,
    last: Instant,
}

impl Every {
    fn new(interval: Duration) -> Self {
        Self { interval, last: Instant::now() }
    }

    /// Whether the interval has passed since it was last due.
    fn is_due(&mut self) -> bool {
        let is_due = self.last.elapsed() >= self.interval;
        if is_due {
            self.last = Instant::now();
        }
        is_due
    }
}

impl Session {
    /// Publishes drawings, maps and diagnostics until an interrupt.
    pub(super) fn draw_until_stopped(&self, draw_every_s: f64, map_every_s: f64) -> anyhow::Result<()> {
        let mapper = Mapper::new(&self.mapping);
        let mut draws = Every::new(Duration::from_secs_f64(draw_every_s));
        let (mut maps, mut diagnoses) = (Every::new(Duration::from_secs_f64(map_every_s)), Every::new(DIAGNOSE_EVERY));
        let (mut objects, mut was_too_large) = (Vec::new(), false);
        while !self.stop.load(Ordering::Relaxed) {
            thread::sleep(NAP.min(draws.interval));
            if diagnoses.is_due() || self.urgent.swap(false, Ordering::Relaxed) {
                self.diagnose()?;
            }
            if draws.is_due() {
                self.draw(&objects, LIFETIME * draw_every_s)?;
            }
            if self.is_heard(&OF_MAPS)
                && maps.is_due()
                && let Some((time_ns, observed)) = self.observed()
            {
                let map = mapper.map(observed, time_ns);
                objects = map.shapes;
                for (layer, message) in &map.layers {
                    message.write(&mut *locked(&self.outlet), &layer_topic(&self.mapping, layer), time_ns)?;
                }
                if map.is_too_large && !std::mem::replace(&mut was_too_large, true) {
                    eprintln!("error: the map has too many cells, and is not published");
                }
            }
        }
        Ok(())
    }

    /// Publishes the state of each whisker.
    fn diagnose(&self) -> anyhow::Result<()> {
        let now_s = self.origin.elapsed().as_secs_f64();
        let state = |shared: &Shared| {
            let latency = {
                let times = locked(&shared.latency);
                let [median_s, p99_s, worst_s] = [0.5, 0.99, 1.0].map(|share| times.quantile(share).as_secs_f64());
                Latency { median_s, p99_s, worst_s }
            };
            locked(&shared.whisker).diagnose(now_s, latency)
        };
        let status = self.whiskers.iter().map(state).collect();
        // States are those of this machine, hence its clock.
        let time_ns = u64::try_from(SystemTime::now().duration_since(UNIX_EPOCH)?.as_nanos())?;
        let header = Header { stamp: Time::from_nanoseconds(time_ns), frame_id: String::new() };
        Ok(locked(&self.outlet).write(topics::DIAGNOSTICS, time_ns, &DiagnosticArray { header, status })?)
    }

    /// Publishes the shapes of the whiskers and of the objects, if somebody listens.
    fn draw(&self, objects: &[Shape], lifetime_s: f64) -> anyhow::Result<()> {
        let prefix = &self.mapping.prefix;
        if !self.is_heard(&[topics::MARKERS, topics::SCENE]) {
            return Ok(());
        }
        let (mut time_ns, mut shapes) = (None, objects.to_vec());
        let now_s = self.origin.elapsed().as_secs_f64();
        for shared in &self.whiskers {
            if let Some((of_whisker_ns, of_whisker)) = locked(&shared.whisker).shapes(now_s) {
                time_ns = time_ns.max(Some(of_whisker_ns));
                shapes.extend(of_whisker);
            }
        }
        let Some(time_ns) = time_ns else { return Ok(()) };
        let drawing = Drawing { frame: self.mapping.fixed_frame.clone(), time_ns, lifetime_s, shapes };
        Ok(locked(&self.outlet).draw(prefix, &drawing)?)
    }

    /// Whether somebody listens to one of these topics, which are given by the last part of their names.
    fn is_heard(&self, names: &[&str]) -> bool {
        let outlet = locked(&self.outlet);
        names.iter().any(|name| outlet.is_heard(&layer_topic(&self.mapping, name)))
    }

    /// The time of the newest observation (ns), and the observations of each whisker. `None` before the first used reading.
    fn observed(&self) -> Option<(u64, Vec<Observed>)> {
        let (mut time_ns, mut observed) = (None, Vec::new());
        for shared in &self.whiskers {
            let whisker = locked(&shared.whisker);
            time_ns = time_ns.max(whisker.newest_ns());
            observed.push(whisker.observed());
        }
        Some((time_ns?, observed))
    }
}
