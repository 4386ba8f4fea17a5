//! Scoring of a map against the truth, without alignment.

use std::collections::{BTreeMap, BTreeSet};

use testbed::contour::{Comparison, Touched, true_circle};
use testbed::map::{FoundObject, SceneMap, Seen, View};
use testbed::statistics::{mean, quantile};
use trace::{ArrayRecording, Outline, Truth, TruthInstant};
use whisker::frames::{Point, World};

/// A detected object counts as merged if at least this fraction of its points belongs to another true object than the
/// majority.
const LEAST_MERGED: f64 = 0.1;

/// Score of a map.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct MapScore {
    /// Number of contact points of all whiskers.
    pub(super) points: usize,
    /// Number of further contact points that are left out because the models were in doubt or a second contact had taken load.
    pub(super) left_out: usize,
    /// Ratio of the number of points to the rows with a true contact. `None` without contacts.
    pub(super) share: Option<f64>,
    /// Mean distance of the points from the nearest true outline.
    pub(super) mean_m: Option<f64>,
    /// 95th percentile of that distance.
    pub(super) p95_m: Option<f64>,
    /// Number of true objects that were touched.
    pub(super) touched: usize,
    /// Number of detected objects beyond the first per true object.
    pub(super) split: usize,
    /// Number of detected objects with points of several true objects.
    pub(super) merged: usize,
    /// One entry per detected object.
    pub(super) objects: Vec<ObjectScore>,
}

/// Score of a detected object.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ObjectScore {
    /// Index in the recording of the true object whose outline is nearest to the points.
    pub(super) object: usize,
    /// Mean distance of the points from that outline.
    pub(super) mean_m: f64,
    /// 95th percentile of that distance.
    pub(super) p95_m: f64,
    /// Comparison of the outline with the true one.
    pub(super) contour: Comparison,
    /// Radius of the true outline, if round.
    pub(super) radius_m: Option<f64>,
    /// Distance between the centres of the fitted and the true circle, if both are round.
    pub(super) center_error_m: Option<f64>,
}

/// Ground truth per whisker index of a recording.
pub(super) type Truths<'a> = BTreeMap<usize, &'a Truth>;

/// True contact on the surface for an observed point.
fn touched_at(truths: &Truths, whisker: usize, seen: &Seen) -> Option<Point<World>> {
    truths.get(&whisker)?.instants[seen.point.row].surface
}

/// Scores a map against the truth. Without objects in the recording, only the numbers of points are available.
pub(super) fn score_map(map: &SceneMap, views: &[&View], truths: &Truths, array: &ArrayRecording) -> MapScore {
    let outlines = &array.outlines;
    let nearest = |point: Point<World>| {
        let distances = outlines.iter().map(|outline| outline.distance_m(point)).enumerate();
        distances.min_by(|a, b| a.1.total_cmp(&b.1))
    };
    let object_at = |whisker: usize, seen: &Seen| Some(nearest(touched_at(truths, whisker, seen)?)?.0);
    let points: Vec<(usize, &Seen)> =
        views.iter().flat_map(|view| view.points.iter().map(move |seen| (view.whisker, seen))).collect();
    let distances_m: Vec<f64> =
        points.iter().filter_map(|(_, seen)| Some(nearest(Point::from_vector(seen.point.at))?.1)).collect();
    let is_touching = |truth: &&TruthInstant| truth.surface.is_some() && truth.split != Some(true);
    let touching: usize = truths.values().map(|truth| truth.instants.iter().filter(is_touching).count()).sum();
    let touched: BTreeSet<usize> = points.iter().filter_map(|&(whisker, seen)| object_at(whisker, seen)).collect();
    let objects: Vec<ObjectScore> =
        map.objects.iter().filter_map(|found| score_object(found, truths, outlines)).collect();
    let matched: BTreeSet<usize> = objects.iter().map(|object| object.object).collect();
    let is_merged = |found: &&FoundObject| {
        let mut of_objects: BTreeMap<usize, usize> = BTreeMap::new();
        for object in found.points.iter().filter_map(|(whisker, seen)| object_at(*whisker, seen)) {
            *of_objects.entry(object).or_default() += 1;
        }
        let (all, most): (usize, usize) = (of_objects.values().sum(), of_objects.values().copied().max().unwrap_or(0));
        (all - most) as f64 > LEAST_MERGED * all as f64
    };
    MapScore {
        points: points.len(),
        left_out: views.iter().map(|view| view.left_out).sum(),
        share: (touching > 0).then(|| points.len() as f64 / touching as f64),
        mean_m: mean(distances_m.iter().copied()),
        p95_m: quantile(&distances_m, 0.95),
        touched: touched.len(),
        split: objects.len() - matched.len(),
        merged: map.objects.iter().filter(is_merged).count(),
        objects,
    }
}

fn score_object(found: &FoundObject, truths: &Truths, outlines: &[Outline]) -> Option<ObjectScore> {
    let distances_m = |outline: &Outline| -> Vec<f64> {
        found.points.iter().map(|(_, seen)| outline.distance_m(Point::from_vector(seen.point.at))).collect()
    };
    let candidates = outlines.iter().map(distances_m).enumerate();
    let mean_of = |distances_m: &[f64]| mean(distances_m.iter().copied()).unwrap_or(f64::INFINITY);
    let (object, distances_m) = candidates.min_by(|a, b| mean_of(&a.1).total_cmp(&mean_of(&b.1)))?;
    let touched: Vec<Point<World>> =
        found.points.iter().filter_map(|(whisker, seen)| touched_at(truths, *whisker, seen)).collect();
    let circle = true_circle(&outlines[object]);
    Some(ObjectScore {
        object,
        mean_m: mean_of(&distances_m),
        p95_m: quantile(&distances_m, 0.95)?,
        contour: Comparison::new(&found.contour, &outlines[object], &Touched::new(&outlines[object], touched)),
        radius_m: circle.map(|circle| circle.radius_m),
        center_error_m: found.circle.zip(circle).map(|(found, circle)| found.center.distance(&circle.center)),
    })
}
