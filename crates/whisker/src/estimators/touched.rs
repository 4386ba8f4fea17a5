//! Places at which an object was touched, and the return of the whisker to one of them.
//!
//! A single contact determines the load and the shape of the whole whisker. If this shape lies past a place that was touched
//! before, the whisker bears on this place too: a second contact takes load. The readings show this late, because the second load
//! grows slowly and resembles a displacement of the first contact.

use std::collections::VecDeque;
use std::sync::Arc;

use nalgebra::Vector2;

use crate::elastica::{Elastica, Load};
use crate::face::Face;
use crate::frames::{Base, Point, Pose, Start};

/// Largest standard deviation of a contact whose place is remembered, and of one whose whisker is compared with the places. The
/// uncertainty is that along the whisker; across it, the errors are much smaller.
const PLACE_SD_M: f64 = 2e-3;
const CONTACT_SD_M: f64 = 3e-3;

/// Distance from the contact beyond which a place is another one.
const APART_M: f64 = 5e-3;

/// Distance between two successive estimates that is a jump.
const JUMP_M: f64 = 3e-3;

/// Distance between two remembered places.
const SPACING_M: f64 = 0.5e-3;

/// Largest number of places that are remembered.
const MOST_PLACES: usize = 200;

/// Time for which a contact must go on, without a jump, before its place is remembered: the last estimates before a jump is noticed
/// contain the load at the other place.
const LASTING_S: f64 = 0.4;

/// Number of chords by which the whisker's centre line is represented. Between their ends it deviates from them by some
/// micrometres.
const CHORDS: u32 = 40;

/// A place that was touched.
#[derive(Clone, Copy, Debug)]
struct Place {
    at: Point<Start>,
    /// Whether it has lain in front of the whisker during the present touch. A place from which the whisker has slipped off is past
    /// it from the beginning.
    was_in_front: bool,
}

/// Places that were touched on one face of the whisker.
#[derive(Clone, Debug)]
pub(super) struct TouchedPlaces {
    /// `None` if the parameters of the whisker are not valid.
    elastica: Option<Arc<Elastica>>,
    face: Face,
    /// Latest contacts, with their times.
    recent: VecDeque<(f64, Point<Start>)>,
    places: VecDeque<Place>,
    /// Time of contact up to the last estimate.
    now_s: f64,
    /// Load of the last contact, near which the next one is sought.
    near: Option<Load>,
}

impl TouchedPlaces {
    /// No places yet.
    pub(super) fn new(elastica: Option<Arc<Elastica>>, face: Face) -> Self {
        let (recent, places) = (VecDeque::new(), VecDeque::new());
        Self { elastica, face, recent, places, now_s: 0.0, near: None }
    }

    /// Begins the next touch on this face.
    pub(super) fn resume(&mut self, face: Face) {
        if face != self.face {
            self.places.clear();
        }
        self.face = face;
        self.places.iter_mut().for_each(|place| place.was_in_front = false);
        self.interrupt();
    }

    /// Interrupts the contact: its latest places are not remembered.
    pub(super) fn interrupt(&mut self) {
        self.forget_latest();
        self.near = None;
    }

    /// Forgets all places, as of an object that moves.
    pub(super) fn forget(&mut self) {
        self.places.clear();
        self.forget_latest();
    }

    /// Forgets the contacts since the last [`LASTING_S`], as after a jump.
    pub(super) fn forget_latest(&mut self) {
        self.recent.clear();
    }

    /// Takes the estimate of a contact, `dt_s` after the one before, with the pose of the base and the contact's largest standard
    /// deviation. Returns the place that the whisker is past by the largest distance, with this distance; where it is negative, the
    /// place lies in front of the whisker.
    pub(super) fn advance(
        &mut self,
        dt_s: f64,
        base: &Pose<Base, Start>,
        contact: Point<Base>,
        sd_m: f64,
    ) -> Option<(f64, Point<Base>)> {
        self.now_s += dt_s;
        self.remember(base.apply(contact), sd_m);
        let near = self.near.take();
        if sd_m > CONTACT_SD_M { None } else { self.farthest_past(base, contact, near) }
    }

    /// Remembers the places of contacts that have gone on for [`LASTING_S`].
    fn remember(&mut self, at: Point<Start>, sd_m: f64) {
        if self.recent.back().is_some_and(|(_, last)| last.distance(&at) > JUMP_M) || sd_m > CONTACT_SD_M {
            self.forget_latest();
        }
        if sd_m > PLACE_SD_M {
            return;
        }
        self.recent.push_back((self.now_s, at));
        while let Some((_, place)) = self.recent.pop_front_if(|(time_s, _)| *time_s < self.now_s - LASTING_S) {
            if self.places.iter().all(|other| other.at.distance(&place) > SPACING_M) {
                if self.places.len() == MOST_PLACES {
                    self.places.pop_front();
                }
                self.places.push_back(Place { at: place, was_in_front: false });
            }
        }
    }

    /// The place that the whisker is past by the largest distance, of those that lay in front of it before; with this distance.
    fn farthest_past(
        &mut self,
        base: &Pose<Base, Start>,
        contact: Point<Base>,
        near: Option<Load>,
    ) -> Option<(f64, Point<Base>)> {
        let elastica = self.elastica.as_ref()?;
        let (to_base, here) = (base.inverse(), base.apply(contact));
        let is_apart = |place: &Place| place.at.distance(&here) > APART_M;
        if !self.places.iter().any(is_apart) {
            return None;
        }
        let found = match &near {
            Some(near) => elastica.at_point_near(contact, near),
            None => elastica.at_point(contact),
        };
        let load = found.ok()?.load;
        self.near = Some(load);
        let line = elastica.line(load).ok()?;
        let ends: Vec<_> = arcs(elastica.length_m()).map(|arc_m| line.at(arc_m).0).collect();
        let away_sign = self.face.away_sign();
        let past = |place: &mut Place| {
            let at = to_base.apply(place.at);
            // The object is at rest: a place on the whisker's other side is one that the whisker has passed.
            let past_m = away_sign * left_of(&ends, at)?;
            place.was_in_front |= past_m < 0.0;
            place.was_in_front.then_some((past_m, at))
        };
        let apart = self.places.iter_mut().filter(|place| is_apart(place));
        apart.filter_map(past).max_by(|(one_m, _), (other_m, _)| one_m.total_cmp(other_m))
    }
}

/// Arc lengths of the ends of the chords.
fn arcs(length_m: f64) -> impl Iterator<Item = f64> {
    (0..=CHORDS).map(move |i| length_m * f64::from(i) / f64::from(CHORDS))
}

/// Distance of a point from the polyline through `ends`, negative on the right. `None` if the nearest point is one of its two ends.
fn left_of(ends: &[Point<Base>], at: Point<Base>) -> Option<f64> {
    let offset = |i: usize| {
        let (from, chord) = (at.vector() - ends[i].vector(), ends[i + 1].vector() - ends[i].vector());
        let share = from.dot(&chord) / chord.norm_squared();
        (share, from - share.clamp(0.0, 1.0) * chord, chord)
    };
    let last = ends.len() - 2;
    let offsets = (0..=last).map(|i| (i, offset(i)));
    let squared = |(_, offset, _): &(f64, Vector2<f64>, Vector2<f64>)| offset.norm_squared();
    let (nearest, (share, offset, chord)) =
        offsets.min_by(|(_, one), (_, other)| squared(one).total_cmp(&squared(other)))?;
    let is_beyond = (nearest == 0 && share < 0.0) || (nearest == last && share > 1.0);
    (!is_beyond).then(|| offset.norm().copysign(chord.perp(&offset)))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;
    use crate::Whisker;
    use crate::rest::direction;

    const PERIOD_S: f64 = 0.01;

    /// A contact at 35 mm, pressed on this face, a place at 60 mm of the loaded whisker, and the unit vector from there to the
    /// object.
    fn loaded(face: Face) -> (Arc<Elastica>, Point<Base>, Point<Base>, Vector2<f64>) {
        let elastica = Arc::new(Elastica::new(&Whisker::straight()).unwrap());
        let load = Load { arc_m: 0.035, along_n: 0.0, left_n: 5e-3 * face.away_sign(), couple_n_m: 0.0 };
        let line = elastica.line(load).unwrap();
        let ((contact, _), (beside, angle_rad)) = (line.at(0.035), line.at(0.06));
        (elastica, contact, beside, -face.away_sign() * direction(angle_rad + FRAC_PI_2))
    }

    /// How the place was touched and what happened before the whisker came back.
    #[derive(Clone, Copy)]
    struct Case {
        face: Face,
        /// Distance of the place in front of the whisker.
        ahead_m: f64,
        touched_s: f64,
        sd_m: f64,
        between: fn(&mut TouchedPlaces),
    }

    const TOUCHED: Case = Case {
        face: Face::Left,
        ahead_m: 0.5e-3,
        touched_s: 1.0,
        sd_m: 1e-4,
        between: |touched| touched.resume(touched.face),
    };

    /// Ways of the base towards the object at which the whisker is found past the place, and the distances. The base moves to and
    /// fro twice, by 1.5 mm at 10 mm/s.
    fn ways_found_m(case: Case) -> Vec<(f64, f64)> {
        let (elastica, contact, beside, ahead) = loaded(case.face);
        let mut touched = TouchedPlaces::new(Some(elastica), case.face);
        let pose = |way_m: f64| Pose::new(way_m * ahead.x, way_m * ahead.y, 0.0);
        let place = beside.shifted(case.ahead_m * ahead);
        for _ in 0..(case.touched_s / PERIOD_S) as usize {
            touched.advance(PERIOD_S, &pose(0.0), place, case.sd_m);
        }
        (case.between)(&mut touched);
        let ways_m = (0..=60).map(|i| 1.5e-3 * (1.0 - (f64::from(i) / 15.0 % 2.0 - 1.0).abs()));
        let mut step = |way_m: f64| Some((way_m, touched.advance(PERIOD_S, &pose(way_m), contact, 1e-4)?.0));
        ways_m.filter_map(&mut step).filter(|(_, past_m)| *past_m > 0.0).collect()
    }

    #[test]
    fn verif_a_whisker_past_a_touched_place_is_found_in_every_passage() {
        for face in [Face::Left, Face::Right] {
            let found_m = ways_found_m(Case { face, ..TOUCHED });
            // Nine periods from 0.6 to 1.4 mm on each of the four ways, and one at each turn.
            assert_eq!(found_m.len(), 38, "{found_m:?}");
            // The rest of the whisker does not move relative to the base as the contact stays.
            assert!(found_m.iter().all(|(way_m, past_m)| (past_m - (way_m - 0.5e-3)).abs() < 0.02e-3), "{found_m:?}");
        }
    }

    #[test]
    fn verif_places_that_are_new_or_uncertain_or_forgotten_are_not_found() {
        assert!(ways_found_m(Case { touched_s: 0.3, ..TOUCHED }).is_empty());
        assert!(ways_found_m(Case { sd_m: 2.5e-3, ..TOUCHED }).is_empty());
        assert!(ways_found_m(Case { between: TouchedPlaces::forget, ..TOUCHED }).is_empty());
        let other_face =
            |touched: &mut TouchedPlaces| [Face::Right, Face::Left].into_iter().for_each(|face| touched.resume(face));
        assert!(ways_found_m(Case { between: other_face, ..TOUCHED }).is_empty());
    }

    #[test]
    fn verif_a_place_from_which_the_whisker_slipped_off_is_not_found() {
        assert!(ways_found_m(Case { ahead_m: -0.5e-3, ..TOUCHED }).is_empty());
    }

    #[test]
    fn verif_the_latest_places_before_an_interruption_are_not_remembered() {
        let (elastica, contact, ..) = loaded(Face::Left);
        let mut touched = TouchedPlaces::new(Some(elastica), Face::Left);
        let touch = |touched: &mut TouchedPlaces, count: usize, contact| {
            for _ in 0..count {
                touched.advance(PERIOD_S, &Pose::new(0.0, 0.0, 0.0), contact, 1e-4);
            }
        };
        touch(&mut touched, 30, contact);
        touched.interrupt();
        touch(&mut touched, 30, contact);
        // A jump interrupts too.
        let other = contact.shifted(Vector2::new(4e-3, 0.0));
        touch(&mut touched, 30, other);
        assert!(touched.places.is_empty());
        touch(&mut touched, 30, other);
        assert!(touched.places.len() == 1 && touched.places[0].at.vector() == other.vector());
    }

    #[test]
    fn verif_left_of_a_line() {
        let ends = [[0.0, 0.0], [1.0, 0.0], [2.0, 1.0]].map(|[x, y]| Point::<Base>::new(x, y));
        assert_eq!(left_of(&ends, Point::new(0.5, 0.25)), Some(0.25));
        assert_eq!(left_of(&ends, Point::new(0.5, -0.25)), Some(-0.25));
        assert!((left_of(&ends, Point::new(1.0, 1.0)).unwrap() - 0.5_f64.sqrt()).abs() < 1e-15);
        assert_eq!(left_of(&ends, Point::new(-0.1, 0.0)), None);
        assert_eq!(left_of(&ends, Point::new(2.5, 1.5)), None);
    }
}
