//! Data of sensor and printer as ROS 2 messages, for a recording or a live node.
//!
//! Topics, types and frames are those of OpenWhisker: the magnetic field holds the sensor's raw counts, and the whisker
//! lies along +y of its frame. Lengths are in metres, as in ROS.

use std::path::{Path, PathBuf};

use bag::messages::{
    Header, MagneticField, MagneticFieldArray, Point, Pose, PoseStamped, Quaternion, TfMessage, Time, Transform,
    TransformStamped, Vector3,
};
use bag::{Publisher, Writer, topics};

use crate::calibration::Detection;
use crate::printer::Head;
use crate::record::{Ending, LogSidecar, Sink};
use crate::routine::Contact;
use crate::{Error, Sample};

/// Duration of the samples in one message of a recording (s).
const BATCH_S: f64 = 0.1;

/// Topic of the printer's pushes, the ground truth of detected contacts.
pub const PUSHED: &str = "/truth/pushed";

/// Name of the attachment with the log's sidecar.
pub const SIDECAR: &str = "log.json";

/// Converter of samples, positions of the head and pushes into messages.
#[derive(Debug)]
pub struct Streams<P> {
    publisher: P,
    epoch_ns: u64,
    batch_s: f64,
    batch: Vec<MagneticField>,
    /// Time of the first sample of the batch (s).
    begin_s: f64,
    frames_sent: bool,
}

impl<P: Publisher> Streams<P> {
    /// Streams to a publisher. `epoch_ns` is time zero of the samples in the publisher's time (ns). The samples of one
    /// message span less than `batch_s`; at 0 each sample is one message.
    pub fn new(publisher: P, epoch_ns: u64, batch_s: f64) -> Self {
        Self { publisher, epoch_ns, batch_s, batch: Vec::new(), begin_s: 0.0, frames_sent: false }
    }

    /// Takes samples and publishes complete batches.
    ///
    /// # Errors
    /// Errors of the publisher.
    pub fn samples(&mut self, samples: &[Sample]) -> Result<(), bag::Error> {
        for sample in samples {
            if sample.t_s - self.begin_s >= self.batch_s {
                self.flush()?;
            }
            if self.batch.is_empty() {
                self.begin_s = sample.t_s;
            }
            let [x, y, z] = sample.counts.map(f64::from);
            self.batch.push(MagneticField {
                header: self.header(sample.t_s, topics::WHISKER),
                magnetic_field: Vector3 { x, y, z },
                magnetic_field_covariance: [0.0; 9],
            });
            if self.batch_s == 0.0 {
                self.flush()?;
            }
        }
        Ok(())
    }

    /// Publishes the incomplete batch.
    ///
    /// # Errors
    /// Errors of the publisher.
    pub fn flush(&mut self) -> Result<(), bag::Error> {
        if self.batch.is_empty() {
            return Ok(());
        }
        let readings = MagneticFieldArray { magnetic_field_array: std::mem::take(&mut self.batch) };
        let time_ns = self.time_ns(self.begin_s);
        self.publisher.write(topics::MAGNETOMETER, time_ns, &readings)
    }

    /// Publishes a position of the head as a frame in the printer's frame.
    ///
    /// # Errors
    /// Errors of the publisher.
    pub fn head(&mut self, Head { t_s, x_m, y_m, z_m }: Head) -> Result<(), bag::Error> {
        if !self.frames_sent {
            self.frames_sent = true;
            let whisker = self.transform(t_s, topics::WHISKER, Vector3::default());
            self.publisher.write(topics::TF_STATIC, self.time_ns(t_s), &whisker)?;
        }
        let head = self.transform(t_s, topics::PRINTER_HEAD, Vector3 { x: x_m, y: y_m, z: z_m });
        self.publisher.write(topics::TF, self.time_ns(t_s), &head)
    }

    /// Publishes a push, at its end.
    ///
    /// # Errors
    /// Errors of the publisher.
    pub fn pushed(&mut self, contact: &Contact) -> Result<(), bag::Error> {
        self.contact(PUSHED, contact.end_s, contact.distance_m)
    }

    /// Publishes a detected contact, if it has an estimate.
    ///
    /// # Errors
    /// Errors of the publisher.
    pub fn detected(&mut self, detection: &Detection) -> Result<(), bag::Error> {
        match detection {
            Detection::Pressed(press, Some(estimate)) => {
                self.contact(topics::DETECTED_CONTACT, press.t_s, estimate.distance_m)
            }
            Detection::Pressed(_, None) | Detection::Released(_) => Ok(()),
        }
    }

    /// Publishes the incomplete batch and returns the publisher.
    ///
    /// # Errors
    /// Errors of the publisher.
    pub fn finish(mut self) -> Result<P, bag::Error> {
        self.flush()?;
        Ok(self.publisher)
    }

    fn contact(&mut self, topic: &str, t_s: f64, distance_m: f64) -> Result<(), bag::Error> {
        let position = Point { x: 0.0, y: distance_m, z: 0.0 };
        let pose = Pose { position, orientation: Quaternion::about_z(0.0) };
        let message = PoseStamped { header: self.header(t_s, topics::WHISKER), pose };
        self.publisher.write(topic, self.time_ns(t_s), &message)
    }

    fn transform(&self, t_s: f64, frame: &str, translation: Vector3) -> TfMessage {
        TfMessage {
            transforms: vec![TransformStamped {
                header: self.header(t_s, topics::PRINTER),
                child_frame_id: frame.into(),
                transform: Transform { translation, rotation: Quaternion::about_z(0.0) },
            }],
        }
    }

    fn header(&self, t_s: f64, frame: &str) -> Header {
        Header { stamp: Time::from_nanoseconds(self.time_ns(t_s)), frame_id: frame.into() }
    }

    fn time_ns(&self, t_s: f64) -> u64 {
        // No recorded time is before the beginning of the recording.
        self.epoch_ns + (1e9 * t_s.max(0.0)).round() as u64
    }
}

/// Recording of a session into a rosbag2 folder. Times count from the beginning of the session.
pub struct Bag {
    folder: PathBuf,
    streams: Streams<Writer>,
    sidecar: LogSidecar,
}

impl Bag {
    /// Creates a recording with the final name `folder`; `sidecar` is that of the log.
    ///
    /// # Errors
    /// If the folder exists or cannot be created.
    pub fn create(folder: &Path, sidecar: LogSidecar) -> Result<Self, Error> {
        Ok(Self { folder: folder.into(), streams: Streams::new(Writer::create(folder)?, 0, BATCH_S), sidecar })
    }
}

impl Sink for Bag {
    fn samples(&mut self, samples: &[Sample]) -> Result<(), Error> {
        Ok(self.streams.samples(samples)?)
    }

    fn detected(&mut self, detection: &Detection) -> Result<(), Error> {
        Ok(self.streams.detected(detection)?)
    }

    fn head(&mut self, head: Head) -> Result<(), Error> {
        Ok(self.streams.head(head)?)
    }

    fn contact(&mut self, contact: Contact) -> Result<(), Error> {
        self.streams.pushed(&contact)?;
        self.sidecar.contacts.push(contact);
        Ok(())
    }

    fn finish(self: Box<Self>, ending: Ending) -> Result<Vec<PathBuf>, Error> {
        let mut writer = self.streams.finish()?;
        let mut sidecar = serde_json::to_vec_pretty(&self.sidecar).expect("texts and numbers become JSON");
        sidecar.push(b'\n');
        writer.attach(SIDECAR, "application/json", &sidecar)?;
        match ending {
            Ending::Complete => {
                writer.finish()?;
                Ok(vec![self.folder])
            }
            Ending::Interrupted => Ok(vec![writer.leave()?]),
        }
    }
}

#[cfg(test)]
mod tests {
    use bag::Reader;
    use files::Watermark;

    use super::*;

    fn sidecar() -> LogSidecar {
        let watermark =
            Watermark { tool: "test".into(), version: "0".into(), git_commit: None, inputs_sha256: String::new() };
        LogSidecar::new("hex", 800.0, watermark)
    }

    fn record(folder: &Path, ending: Ending) -> PathBuf {
        let mut bag = Box::new(Bag::create(folder, sidecar()).expect("a recording"));
        for i in 0..800_u16 {
            bag.samples(&[Sample { t_s: f64::from(i) / 800.0, counts: [i, 65535, 0] }]).expect("kept");
        }
        bag.head(Head { t_s: 0.25, x_m: 0.127, y_m: 0.09675, z_m: 0.0 }).expect("kept");
        bag.contact(Contact { start_s: 0.1, end_s: 0.4, distance_m: 0.145, push_m: 0.006 }).expect("kept");
        bag.finish(ending).expect("written").remove(0)
    }

    #[test]
    fn verif_every_sample_is_in_the_recording() {
        let home = tempfile::tempdir().expect("a folder");
        let folder = record(&home.path().join("run"), Ending::Complete);
        let reader = Reader::open(&folder).expect("a recording");
        let records: Vec<_> = reader.records().collect::<Result<_, _>>().expect("whole");
        let readings = records.iter().filter(|record| record.topic == topics::MAGNETOMETER);
        let fields: Vec<_> = readings
            .flat_map(|record| record.decode::<MagneticFieldArray>().expect("readings").magnetic_field_array)
            .collect();
        assert_eq!(fields.len(), 800);
        for (i, field) in (0..).zip(&fields) {
            assert_eq!(field.magnetic_field, Vector3 { x: f64::from(i), y: 65535.0, z: 0.0 });
            assert_eq!(field.header.stamp.nanoseconds(), i64::from(i) * 1_250_000);
        }
        let pushed = records.iter().find(|record| record.topic == PUSHED).expect("a push");
        assert_eq!(pushed.decode::<PoseStamped>().expect("a pose").pose.position.y, 0.145);
        assert_eq!(reader.attachments().expect("read")[0].name, SIDECAR);
    }

    #[test]
    fn robust_an_interrupted_session_is_named_so() {
        let home = tempfile::tempdir().expect("a folder");
        let folder = record(&home.path().join("run"), Ending::Interrupted);
        assert_eq!(folder, home.path().join("run.part"));
        assert!(Reader::open(&folder).expect("a recording").records().all(|record| record.is_ok()));
    }
}
