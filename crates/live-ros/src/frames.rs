//! Frames of `/tf` and `/tf_static`: a tree of transforms, each interpolated in time.

use std::collections::HashMap;
use std::sync::Arc;

use live::{Sampled, Samples};
use nalgebra::Isometry3;

/// Largest number of frames.
const MOST_FRAMES: usize = 1 << 12;

/// Pose of a frame in its parent.
#[derive(Clone, Debug)]
enum Placed {
    Fixed(Isometry3<f64>),
    Moving(Samples<Isometry3<f64>>),
}

/// A frame in its parent.
#[derive(Clone, Debug)]
struct Link {
    parent: Arc<str>,
    placed: Placed,
}

/// Transform of a message.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct FrameTransform {
    /// The frame.
    pub(crate) child: Arc<str>,
    /// Its parent.
    pub(crate) parent: Arc<str>,
    /// Its pose in the parent.
    pub(crate) pose: Isometry3<f64>,
    /// Whether it holds for all times.
    pub(crate) is_static: bool,
}

/// Tree of frames, and the chain between two of them.
#[derive(Clone, Debug)]
pub(crate) struct Frames {
    fixed: Arc<str>,
    base: Arc<str>,
    links: HashMap<Arc<str>, Link>,
    /// Frames between the base, and the fixed frame, and their common ancestor. `None` while they are not connected.
    chain: Option<[Vec<Arc<str>>; 2]>,
}

impl Frames {
    /// A tree without transforms.
    pub(crate) fn new(fixed: &str, base: &str) -> Self {
        let mut frames = Self { fixed: fixed.into(), base: base.into(), links: HashMap::new(), chain: None };
        frames.chain = frames.connect();
        frames
    }

    /// Samples of the frame of a transform, if it moves and belongs to the chain. A new frame is added to the tree.
    pub(crate) fn samples(&mut self, transform: &FrameTransform) -> Option<&mut Samples<Isometry3<f64>>> {
        let FrameTransform { child, parent, is_static, pose } = transform;
        let is_as_before = self
            .links
            .get(child)
            .is_some_and(|link| link.parent == *parent && *is_static == matches!(link.placed, Placed::Fixed(_)));
        if !is_as_before {
            if self.links.len() >= MOST_FRAMES && !self.links.contains_key(child) {
                return None;
            }
            let placed = if *is_static { Placed::Fixed(*pose) } else { Placed::Moving(Samples::default()) };
            self.links.insert(child.clone(), Link { parent: parent.clone(), placed });
            self.chain = self.connect();
        }
        let is_in_chain = self.chain.iter().flatten().any(|frames| frames.contains(child));
        match &mut self.links.get_mut(child)?.placed {
            Placed::Moving(samples) if is_in_chain => Some(samples),
            _ => None,
        }
    }

    /// Adds a transform and returns whether there was none of its frame and time.
    pub(crate) fn insert(&mut self, t_s: f64, transform: &FrameTransform) -> bool {
        self.samples(transform);
        match self.links.get_mut(&transform.child).map(|link| &mut link.placed) {
            Some(Placed::Moving(samples)) => samples.insert(t_s, transform.pose),
            Some(Placed::Fixed(pose)) => {
                *pose = transform.pose;
                true
            }
            None => true,
        }
    }

    /// Whether a time lies before all transforms of this frame.
    pub(crate) fn is_before_all(&self, t_s: f64, transform: &FrameTransform) -> bool {
        match self.links.get(&transform.child).map(|link| &link.placed) {
            Some(Placed::Moving(samples)) => samples.is_before_all(t_s),
            _ => false,
        }
    }

    /// Pose of the base in the fixed frame.
    pub(crate) fn at(&self, t_s: f64, gap_s: f64) -> Sampled<Isometry3<f64>> {
        let Some([from_base, from_fixed]) = &self.chain else { return Sampled::Pending };
        let base = self.above(from_base, t_s, gap_s);
        if from_fixed.is_empty() {
            return base;
        }
        match (base, self.above(from_fixed, t_s, gap_s)) {
            (Sampled::At(base), Sampled::At(fixed)) => Sampled::At(fixed.inv_mul(&base)),
            (Sampled::Unknown(lack), _) | (_, Sampled::Unknown(lack)) => Sampled::Unknown(lack),
            _ => Sampled::Pending,
        }
    }

    /// Time up to which every moving frame of the chain is known.
    pub(crate) fn newest_s(&self) -> Option<f64> {
        let mut newest_s = None::<f64>;
        for child in self.chain.as_ref()?.iter().flatten() {
            if let Placed::Moving(samples) = &self.links[child].placed {
                let of_frame_s = samples.newest_s()?;
                newest_s = Some(newest_s.map_or(of_frame_s, |newest_s| newest_s.min(of_frame_s)));
            }
        }
        newest_s
    }

    /// Drops the transforms that no time from `t_s` on requires.
    pub(crate) fn settle(&mut self, t_s: f64) {
        for link in self.links.values_mut() {
            if let Placed::Moving(samples) = &mut link.placed {
                samples.settle(t_s);
            }
        }
    }

    /// Drops the moving transforms.
    pub(crate) fn restart(&mut self) {
        for link in self.links.values_mut() {
            if let Placed::Moving(samples) = &mut link.placed {
                samples.clear();
            }
        }
    }

    /// Pose of the first of these frames in the parent of the last.
    fn above(&self, frames: &[Arc<str>], t_s: f64, gap_s: f64) -> Sampled<Isometry3<f64>> {
        let mut pose: Option<Isometry3<f64>> = None;
        let mut is_pending = false;
        for child in frames {
            let in_parent = match &self.links[child].placed {
                Placed::Fixed(fixed) => Sampled::At(*fixed),
                Placed::Moving(samples) => samples.at(t_s, gap_s, between),
            };
            match in_parent {
                Sampled::At(in_parent) => pose = Some(pose.map_or(in_parent, |pose| in_parent * pose)),
                Sampled::Pending => is_pending = true,
                Sampled::Unknown(lack) => return Sampled::Unknown(lack),
            }
        }
        if is_pending { Sampled::Pending } else { Sampled::At(pose.unwrap_or_default()) }
    }

    /// The chain, if both frames have a common ancestor.
    fn connect(&self) -> Option<[Vec<Arc<str>>; 2]> {
        let ancestors = |frame: &Arc<str>| {
            let mut ancestors = vec![frame.clone()];
            while let Some(link) = self.links.get(ancestors.last()?)
                // A loop is not a tree; its frames have no common ancestor with others.
                && !ancestors.contains(&link.parent)
            {
                ancestors.push(link.parent.clone());
            }
            Some(ancestors)
        };
        let (mut base, mut fixed) = (ancestors(&self.base)?, ancestors(&self.fixed)?);
        let meeting = base.iter().find(|frame| fixed.contains(frame))?.clone();
        for frames in [&mut base, &mut fixed] {
            frames.truncate(frames.iter().position(|frame| *frame == meeting)?);
        }
        Some([base, fixed])
    }
}

/// Pose at a share of the way: the origin on the straight line, the rotation about a fixed axis (Shoemake 1985).
fn between(before: &Isometry3<f64>, after: &Isometry3<f64>, share: f64) -> Isometry3<f64> {
    before.try_lerp_slerp(after, share, 1e-12).unwrap_or(if share < 0.5 { *before } else { *after })
}
