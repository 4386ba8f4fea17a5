//! Way of messages to the whiskers.

use std::sync::Arc;

use bag::messages::{AnyMessage, JointState, MagneticField, TfMessage, WrenchStamped};
use bag::{Message, topics};
use live::counts::Stream;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};

use crate::chain::{Measured, Part};
use crate::epoch::Epoch;
use crate::frames::FrameTransform;
use crate::mapping::{CountsEntry, Mapping};
use crate::whisker::{Content, Input};

/// Largest deviation of the norm of a quaternion from 1.
const NOT_UNIT: f64 = 1e-3;

/// Input of a whisker.
#[derive(Clone, Debug, PartialEq)]
pub struct Routed {
    /// Index of the whisker. `None`: of every whisker.
    pub whisker: Option<usize>,
    /// Time from the epoch of the stream (s).
    pub t_s: f64,
    /// The input.
    pub input: Input,
}

/// Content of a topic.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Use {
    /// Moment in this frame, that of the base.
    Moment(Arc<str>),
    Counts(Stream),
}

/// A subscribed topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topic {
    /// Its name.
    pub name: String,
    /// Type of its messages.
    pub type_name: &'static str,
}

/// Converter of messages into inputs of whiskers.
///
/// Times are seconds since the [`Epoch`] of the stream.
#[derive(Clone, Debug)]
pub struct Router {
    /// Topic, type, index of the whisker and content.
    uses: Vec<(Topic, usize, Use)>,
    joint_states: Option<String>,
    epoch: Epoch,
    refused: u64,
    foreign: u64,
    /// Topics whose moments in another frame have been noted.
    noted: Vec<String>,
    notes: Vec<String>,
}

impl Router {
    pub(crate) fn new(mapping: &Mapping, epoch: Epoch) -> Self {
        let mut uses = Vec::new();
        let topic = |name: &String, type_name| Topic { name: name.clone(), type_name };
        for (index, whisker) in mapping.whiskers.iter().enumerate() {
            let base = frame(&whisker.base_frame);
            let moment = whisker.moment.iter().map(|name| topic(name, WrenchStamped::TYPE));
            uses.extend(moment.map(|topic| (topic, index, Use::Moment(base.clone()))));
            if let Some(counts) = &whisker.counts {
                let type_name = counts.message.type_name();
                uses.push((topic(&counts.topic, type_name), index, Use::Counts(Stream::Own)));
                let reference = counts.reference.iter().map(|name| topic(name, type_name));
                uses.extend(reference.map(|topic| (topic, index, Use::Counts(Stream::Reference))));
            }
        }
        let joint_states = mapping.urdf.is_some().then(|| mapping.joint_states.clone());
        Self { uses, joint_states, epoch, refused: 0, foreign: 0, noted: Vec::new(), notes: Vec::new() }
    }

    /// Adds the topics of the neighbours of a whisker's sensor.
    pub(crate) fn add_neighbours(&mut self, whisker: usize, neighbours: &[&CountsEntry]) {
        for (place, counts) in neighbours.iter().enumerate() {
            let topic = Topic { name: counts.topic.clone(), type_name: counts.message.type_name() };
            self.uses.push((topic, whisker, Use::Counts(Stream::Neighbour(place))));
        }
    }

    /// Topics to subscribe to, each once.
    pub fn topics(&self) -> Vec<Topic> {
        let mut topics: Vec<Topic> = Vec::new();
        let mut add = |name: &str, type_name| {
            if !topics.iter().any(|topic| topic.name == name) {
                topics.push(Topic { name: name.into(), type_name });
            }
        };
        self.uses.iter().for_each(|(topic, _, _)| add(&topic.name, topic.type_name));
        match &self.joint_states {
            Some(name) => add(name, JointState::TYPE),
            None => {
                add(topics::TF, TfMessage::TYPE);
                add(topics::TF_STATIC, TfMessage::TYPE);
            }
        }
        topics
    }

    /// Number of transforms so far that were left out: their quaternions are no rotations, or static ones are not finite.
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// Number of moments so far that were left out: they are given in another frame than that of the base.
    pub fn foreign(&self) -> u64 {
        self.foreign
    }

    /// Notes on messages that were left out, one for each topic, since the last call.
    pub fn take_notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }

    /// Converts a message of a topic. Messages of other topics and types are ignored.
    pub fn route(&mut self, topic: &str, message: &AnyMessage, routed: &mut Vec<Routed>) {
        match message {
            AnyMessage::TfMessage(frames) if self.joint_states.is_none() => {
                self.frames(frames, topic == topics::TF_STATIC, routed);
            }
            AnyMessage::JointState(joints) if self.joint_states.as_deref() == Some(topic) => {
                let t_s = self.epoch.seconds(&joints.header.stamp);
                for (name, position) in joints.name.iter().zip(&joints.position) {
                    let input = Input(Content::Motion(Measured(Part::Joint(Arc::from(name.as_str()), *position))));
                    routed.push(Routed { whisker: None, t_s, input });
                }
            }
            AnyMessage::WrenchStamped(WrenchStamped { header, wrench }) => {
                let t_s = self.epoch.seconds(&header.stamp);
                let torque = &wrench.torque;
                let moment_n_m = Vector3::new(torque.x, torque.y, torque.z);
                let stated = frame(&header.frame_id);
                let mut other = None;
                self.readings(topic, t_s, routed, |of| match of {
                    Use::Moment(base) if stated.is_empty() || stated == *base => Some(Content::Moment(moment_n_m)),
                    Use::Moment(base) => {
                        other = Some(base.clone());
                        None
                    }
                    Use::Counts(_) => None,
                });
                if let Some(base) = other {
                    self.leave_out(topic, &stated, &base);
                }
            }
            AnyMessage::MagneticField(field) => self.field(topic, field, routed),
            AnyMessage::MagneticFieldArray(fields) => {
                fields.magnetic_field_array.iter().for_each(|field| self.field(topic, field, routed));
            }
            _ => {}
        }
    }

    fn field(&mut self, topic: &str, field: &MagneticField, routed: &mut Vec<Routed>) {
        let t_s = self.epoch.seconds(&field.header.stamp);
        let of = &field.magnetic_field;
        let counts = [of.x, of.y, of.z];
        self.readings(topic, t_s, routed, |of| match of {
            Use::Counts(stream) => Some(Content::Counts(*stream, counts)),
            Use::Moment(_) => None,
        });
    }

    /// Leaves out a moment in another frame than that of the base, with a note on the first one of its topic.
    fn leave_out(&mut self, topic: &str, stated: &str, base: &str) {
        self.foreign += 1;
        if !self.noted.iter().any(|noted| noted == topic) {
            self.noted.push(topic.into());
            self.notes.push(format!(
                "{topic}: found a moment in the frame `{}`, expected one in the frame of the base, `{base}`, or none stated; it is left \
                 out, and so is every further one",
                stated.escape_debug()
            ));
        }
    }

    fn readings(
        &self,
        topic: &str,
        t_s: f64,
        routed: &mut Vec<Routed>,
        mut content: impl FnMut(&Use) -> Option<Content>,
    ) {
        for (name, whisker, of) in &self.uses {
            if name.name == topic
                && let Some(content) = content(of)
            {
                routed.push(Routed { whisker: Some(*whisker), t_s, input: Input(content) });
            }
        }
    }

    fn frames(&mut self, frames: &TfMessage, is_static: bool, routed: &mut Vec<Routed>) {
        for transform in &frames.transforms {
            let (at, turned) = (&transform.transform.translation, &transform.transform.rotation);
            let rotation = Quaternion::new(turned.w, turned.x, turned.y, turned.z);
            let is_rotation = (rotation.norm() - 1.0).abs() <= NOT_UNIT;
            let is_finite = [at.x, at.y, at.z].iter().all(|value| value.is_finite());
            // A moving transform that is not finite is counted by the estimator.
            if !is_rotation || (is_static && !is_finite) {
                self.refused += 1;
                continue;
            }
            let pose =
                Isometry3::from_parts(Translation3::new(at.x, at.y, at.z), UnitQuaternion::new_normalize(rotation));
            let (child, parent) = (frame(&transform.child_frame_id), frame(&transform.header.frame_id));
            // Static transforms hold at all times; their times may be zero.
            let t_s = if is_static { 0.0 } else { self.epoch.seconds(&transform.header.stamp) };
            let part = Part::Transform(FrameTransform { child, parent, pose, is_static });
            routed.push(Routed { whisker: None, t_s, input: Input(Content::Motion(Measured(part))) });
        }
    }
}

/// Name of a frame, without the slash of earlier versions of ROS.
fn frame(name: &str) -> Arc<str> {
    Arc::from(name.strip_prefix('/').unwrap_or(name))
}
