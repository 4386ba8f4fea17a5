//! Kinematics of an arm from a URDF file and the angles of its joints, each interpolated in time.
//!
//! In its parent link, a joint has the pose `origin`; it moves its child link by a rotation about, or a displacement along,
//! its axis (URDF specification, joint element). Angles of continuous joints are interpolated by the shorter way.

use std::f64::consts::TAU;
use std::fs;
use std::path::Path;

use files::Error;
use live::{Sampled, Samples};
use nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion, Vector3};
use urdf_rs::{JointType, Robot};

/// Largest size of a URDF file in bytes.
const MOST_BYTES: u64 = 1 << 24;

/// Deepest nesting of elements; that of URDF is below ten. The parser recurses.
const MOST_DEPTH: usize = 64;

/// Deepest nesting of the elements of an XML text.
fn depth(text: &str) -> usize {
    let (mut depth, mut deepest, mut rest) = (0_usize, 0, text);
    while let Some((_, tag)) = rest.split_once('<') {
        let end = if tag.starts_with("!--") { "-->" } else { ">" };
        let (inside, after) = tag.split_once(end).unwrap_or((tag, ""));
        match inside.chars().next() {
            Some('!' | '?') => {}
            Some('/') => depth = depth.saturating_sub(1),
            _ if inside.ends_with('/') => {}
            _ => depth += 1,
        }
        deepest = deepest.max(depth);
        rest = after;
    }
    deepest
}

/// Kind of a joint on the chain.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Fixed,
    Turning(Unit<Vector3<f64>>),
    Sliding(Unit<Vector3<f64>>),
}

/// Joint between a link and its parent.
#[derive(Clone, Debug)]
struct Joint {
    origin: Isometry3<f64>,
    kind: Kind,
    /// Index of the measured position.
    source: usize,
    /// Position of this joint: `multiplier` times the measured one plus `offset`.
    multiplier: f64,
    offset: f64,
}

/// Position of a joint over time.
#[derive(Clone, Debug)]
struct Position {
    name: String,
    /// Whether it is an angle without limits, which may be wrapped.
    is_continuous: bool,
    samples: Samples<f64>,
}

/// Chain of joints from a fixed link to the base of a whisker.
#[derive(Clone, Debug)]
pub(crate) struct Arm {
    joints: Vec<Joint>,
    positions: Vec<Position>,
}

/// Reads a URDF file.
///
/// # Errors
/// If it cannot be read or is no URDF.
pub(crate) fn read_urdf(path: &Path) -> Result<Robot, Error> {
    let size = fs::metadata(path).map_err(Error::io(path))?.len();
    if size > MOST_BYTES {
        return Err(Error::value(path, "size", format!("{size} bytes"), format!("at most {MOST_BYTES}")));
    }
    let text = fs::read_to_string(path).map_err(Error::io(path))?;
    if depth(&text) > MOST_DEPTH {
        let expected = format!("elements nested at most {MOST_DEPTH} deep");
        return Err(Error::value(path, "robot", "deeper elements", expected));
    }
    let found = |error: urdf_rs::UrdfError| {
        let one_line: Vec<_> = error.to_string().split_whitespace().map(str::to_owned).collect();
        Error::value(path, "robot", one_line.join(" "), "the description of a robot (URDF)")
    };
    urdf_rs::read_from_string(&text).map_err(found)
}

impl Arm {
    /// Chain of a robot from the link `fixed` to the link `base`. The path is that of the URDF, for errors.
    ///
    /// # Errors
    /// If there is no such chain, or a joint of it has no axis or more than one degree of freedom.
    pub(crate) fn new(path: &Path, robot: &Robot, fixed: &str, base: &str) -> Result<Self, Error> {
        for name in [fixed, base] {
            if !robot.links.iter().any(|link| link.name == name) {
                let known: Vec<_> = robot.links.iter().map(|link| link.name.as_str()).collect();
                return Err(Error::value(path, "link", known.join(", "), format!("`{name}` among them")));
            }
        }
        let mut arm = Self { joints: Vec::new(), positions: Vec::new() };
        let mut link = base;
        while link != fixed {
            let above = robot.joints.iter().find(|joint| joint.child.link == link);
            let Some(joint) = above.filter(|_| arm.joints.len() <= robot.joints.len()) else {
                let found = format!("a chain from `{base}` that ends at `{link}`");
                return Err(Error::value(path, "joint", found, format!("one to the fixed frame `{fixed}`")));
            };
            arm.add(path, robot, joint)?;
            link = &joint.parent.link;
        }
        arm.joints.reverse();
        Ok(arm)
    }

    fn add(&mut self, path: &Path, robot: &Robot, joint: &urdf_rs::Joint) -> Result<(), Error> {
        let key = |key: &str| format!("joint `{}`: {key}", joint.name);
        let finite = |name: &str, values: &[f64; 3]| {
            let all = values.iter().all(|value| value.is_finite());
            all.then_some(Vector3::from(*values))
                .ok_or_else(|| Error::value(path, key(name), format!("{values:?}"), "finite numbers"))
        };
        let (xyz, rpy) = (finite("origin.xyz", &joint.origin.xyz)?, finite("origin.rpy", &joint.origin.rpy)?);
        let origin = Isometry3::from_parts(xyz.into(), UnitQuaternion::from_euler_angles(rpy.x, rpy.y, rpy.z));
        let axis = Unit::try_new(finite("axis", &joint.axis.xyz)?, 1e-9);
        let axis = axis.ok_or_else(|| Error::value(path, key("axis"), "the zero vector", "a direction"));
        let kind = match &joint.joint_type {
            JointType::Fixed => Kind::Fixed,
            JointType::Revolute | JointType::Continuous => Kind::Turning(axis?),
            JointType::Prismatic => Kind::Sliding(axis?),
            other => {
                let expected = "fixed, revolute, continuous or prismatic";
                return Err(Error::value(path, key("type"), format!("{other:?}").to_lowercase(), expected));
            }
        };
        let mimic = joint.mimic.as_ref();
        let named = mimic.map_or(&joint.name, |mimic| &mimic.joint);
        let source = if kind == Kind::Fixed { 0 } else { self.position(path, robot, named)? };
        let multiplier = mimic.and_then(|mimic| mimic.multiplier).unwrap_or(1.0);
        let offset = mimic.and_then(|mimic| mimic.offset).unwrap_or(0.0);
        if !(multiplier.is_finite() && offset.is_finite()) {
            return Err(Error::value(path, key("mimic"), format!("{multiplier}, {offset}"), "finite numbers"));
        }
        self.joints.push(Joint { origin, kind, source, multiplier, offset });
        Ok(())
    }

    /// Index of the position of a joint.
    fn position(&mut self, path: &Path, robot: &Robot, name: &str) -> Result<usize, Error> {
        if let Some(known) = self.positions.iter().position(|position| position.name == name) {
            return Ok(known);
        }
        let Some(joint) = robot.joints.iter().find(|joint| joint.name == name) else {
            return Err(Error::value(path, "mimic", format!("`{name}`"), "the name of a joint"));
        };
        let is_continuous = joint.joint_type == JointType::Continuous;
        self.positions.push(Position { name: name.into(), is_continuous, samples: Samples::default() });
        Ok(self.positions.len() - 1)
    }

    /// Samples of a joint of the chain.
    pub(crate) fn samples(&self, name: &str) -> Option<&Samples<f64>> {
        self.positions.iter().find(|position| position.name == name).map(|position| &position.samples)
    }

    /// As [`Self::samples`], to be changed.
    pub(crate) fn samples_mut(&mut self, name: &str) -> Option<&mut Samples<f64>> {
        self.positions.iter_mut().find(|position| position.name == name).map(|position| &mut position.samples)
    }

    /// Pose of the base in the fixed link.
    pub(crate) fn at(&self, t_s: f64, gap_s: f64) -> Sampled<Isometry3<f64>> {
        let mut measured = Vec::with_capacity(self.positions.len());
        let mut is_pending = false;
        for Position { samples, is_continuous, .. } in &self.positions {
            let between = |before: &f64, after: &f64, share: f64| {
                let turns = if *is_continuous { ((after - before) / TAU).round() } else { 0.0 };
                before + (after - before - turns * TAU) * share
            };
            match samples.at(t_s, gap_s, between) {
                Sampled::At(position) => measured.push(position),
                Sampled::Pending => is_pending = true,
                Sampled::Unknown(lack) => return Sampled::Unknown(lack),
            }
        }
        if is_pending { Sampled::Pending } else { Sampled::At(self.pose(&measured)) }
    }

    /// Pose of the base for measured positions of the joints.
    fn pose(&self, measured: &[f64]) -> Isometry3<f64> {
        self.joints.iter().fold(Isometry3::identity(), |pose, joint| {
            let position = || joint.multiplier * measured[joint.source] + joint.offset;
            match joint.kind {
                Kind::Fixed => pose * joint.origin,
                Kind::Turning(axis) => pose * joint.origin * UnitQuaternion::from_axis_angle(&axis, position()),
                Kind::Sliding(axis) => pose * joint.origin * Translation3::from(axis.into_inner() * position()),
            }
        })
    }

    /// Time up to which every joint is known.
    pub(crate) fn newest_s(&self) -> Option<f64> {
        let newest_s = self.positions.iter().map(|position| position.samples.newest_s());
        newest_s.reduce(|one, other| Some(one?.min(other?)))?
    }

    /// Drops the positions that no time from `t_s` on requires.
    pub(crate) fn settle(&mut self, t_s: f64) {
        self.positions.iter_mut().for_each(|position| position.samples.settle(t_s));
    }

    /// Drops all positions.
    pub(crate) fn restart(&mut self) {
        self.positions.iter_mut().for_each(|position| position.samples.clear());
    }
}
