//! The map beside the truth, unaligned.

use std::collections::{BTreeMap, BTreeSet};

use trace::{ArrayRecording, Outline, Truth, TruthInstant};
use whisker::frames::{Point, World};

use super::{FoundObject, SceneMap, Seen, View};
use crate::contour::{Comparison, Touched, true_circle};
use crate::statistics::{mean, quantile};

/// A found object is merged of several where at least this share of its points was truly on another than most are.
const LEAST_MERGED: f64 = 0.1;

/// What the judge says of a map.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Judged {
    /// Contact points of all whiskers.
    pub(crate) points: usize,
    /// Over the rows in which a whisker truly touches.
    pub(crate) share: Option<f64>,
    /// Mean distance of the points from the nearest true outline.
    pub(crate) mean_m: Option<f64>,
    /// 95th percentile of that distance.
    pub(crate) p95_m: Option<f64>,
    /// True objects that were touched.
    pub(crate) touched: usize,
    /// Found objects beyond the first of each true one.
    pub(crate) split: usize,
    /// Found objects with points of several true ones.
    pub(crate) merged: usize,
    /// One entry a found object.
    pub(crate) objects: Vec<JudgedObject>,
}

/// What the judge says of a found object.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct JudgedObject {
    /// Place of the true object in the recording: that whose outline is nearest to its points.
    pub(crate) object: usize,
    /// Mean distance of its points from that outline.
    pub(crate) mean_m: f64,
    /// 95th percentile of that distance.
    pub(crate) p95_m: f64,
    /// Its outline beside the true one.
    pub(crate) contour: Comparison,
    /// Radius of the true outline, where that is round.
    pub(crate) radius_m: Option<f64>,
    /// Distance of the middle of its circle from the true one, where both are round.
    pub(crate) center_error_m: Option<f64>,
}

/// What the whiskers of a recording truly did, by their places in it.
pub(crate) type Truths<'a> = BTreeMap<usize, &'a Truth>;

/// What a whisker truly touched when it saw a point.
fn touched_at(truths: &Truths, whisker: usize, seen: &Seen) -> Option<Point<World>> {
    truths.get(&whisker)?.instants[seen.point.row].surface
}

/// Lays a map beside the truth. Of a recording without objects there is nothing to say but how much was seen.
pub(crate) fn judged(map: &SceneMap, views: &[&View], truths: &Truths, array: &ArrayRecording) -> Judged {
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
    let objects: Vec<JudgedObject> =
        map.objects.iter().filter_map(|found| judged_object(found, truths, outlines)).collect();
    let matched: BTreeSet<usize> = objects.iter().map(|object| object.object).collect();
    let is_merged = |found: &&FoundObject| {
        let mut of_objects: BTreeMap<usize, usize> = BTreeMap::new();
        for object in found.points.iter().filter_map(|(whisker, seen)| object_at(*whisker, seen)) {
            *of_objects.entry(object).or_default() += 1;
        }
        let (all, most): (usize, usize) = (of_objects.values().sum(), of_objects.values().copied().max().unwrap_or(0));
        (all - most) as f64 > LEAST_MERGED * all as f64
    };
    Judged {
        points: points.len(),
        share: (touching > 0).then(|| points.len() as f64 / touching as f64),
        mean_m: mean(distances_m.iter().copied()),
        p95_m: quantile(&distances_m, 0.95),
        touched: touched.len(),
        split: objects.len() - matched.len(),
        merged: map.objects.iter().filter(is_merged).count(),
        objects,
    }
}

fn judged_object(found: &FoundObject, truths: &Truths, outlines: &[Outline]) -> Option<JudgedObject> {
    let distances_m = |outline: &Outline| -> Vec<f64> {
        found.points.iter().map(|(_, seen)| outline.distance_m(Point::from_vector(seen.point.at))).collect()
    };
    let candidates = outlines.iter().map(distances_m).enumerate();
    let mean_of = |distances_m: &[f64]| mean(distances_m.iter().copied()).unwrap_or(f64::INFINITY);
    let (object, distances_m) = candidates.min_by(|a, b| mean_of(&a.1).total_cmp(&mean_of(&b.1)))?;
    let touched: Vec<Point<World>> =
        found.points.iter().filter_map(|(whisker, seen)| touched_at(truths, *whisker, seen)).collect();
    let circle = true_circle(&outlines[object]);
    Some(JudgedObject {
        object,
        mean_m: mean_of(&distances_m),
        p95_m: quantile(&distances_m, 0.95)?,
        contour: Comparison::new(&found.contour, &outlines[object], &Touched::new(&outlines[object], touched)),
        radius_m: circle.map(|circle| circle.radius_m),
        center_error_m: found.circle.zip(circle).map(|(found, circle)| found.center.distance(&circle.center)),
    })
}
