//! Places at which an object was touched, and the return of the whisker to one of them.
//!
//! A single contact determines the load and the shape of the whole whisker. If this shape lies past a place that was touched before,
//! the whisker bears on this place too: a second contact takes load. The readings show this late, because the second load grows
//! slowly and resembles a displacement of the first contact.

use std::collections::VecDeque;
use std::sync::Arc;

use super::second::SecondSettings;
use crate::elastica::{Elastica, Load};
use crate::face::Face;
use crate::frames::{Base, Point, Pose, Start};

/// Largest standard deviation of a contact whose place is remembered, and of one whose whisker is compared with the places.
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

/// Time for which a contact must have gone on, without a jump, before its place is remembered: the last estimates before a jump is
/// noticed contain the load at the other place.
const SETTLING_S: f64 = 0.4;

/// Number of chords by which the whisker's centre line is represented. Between their ends it deviates from them by some micrometres.
const CHORDS: u32 = 40;

/// The places of one object, in Start.
#[derive(Clone, Debug)]
pub(super) struct TouchedPlaces {
    /// `None` for a whisker without equilibria.
    elastica: Option<Arc<Elastica>>,
    face: Face,
    /// Latest contacts, with their times.
    recent: VecDeque<(f64, Point<Start>)>,
    places: VecDeque<Point<Start>>,
    /// Time of the last estimate.
    now_s: f64,
    /// Load of the last contact, near which the next one is sought.
    near: Option<Load>,
    /// Time for which the whisker has been past a place, `None` if it is not.
    past_s: Option<f64>,
}

impl TouchedPlaces {
    /// No places yet.
    pub(super) fn new(elastica: Option<Arc<Elastica>>, face: Face) -> Self {
        let (recent, places) = (VecDeque::new(), VecDeque::new());
        Self { elastica, face, recent, places, now_s: 0.0, near: None, past_s: None }
    }

    /// Begins the next touch on this face.
    pub(super) fn resume(&mut self, face: Face) {
        if face != self.face {
            self.places.clear();
        }
        self.face = face;
        self.forget_latest();
        (self.near, self.past_s) = (None, None);
    }

    /// Forgets all places, as of an object that moves.
    pub(super) fn forget(&mut self) {
        self.places.clear();
        self.forget_latest();
    }

    /// Forgets the contacts since the last [`SETTLING_S`], as after a jump.
    pub(super) fn forget_latest(&mut self) {
        self.recent.clear();
    }

    /// Takes the estimate of a contact, `dt_s` after the one before, with the pose of the base and the contact's largest standard
    /// deviation. Returns the place that the whisker has now been past by `past_m` for `past_s`, once per passage.
    pub(super) fn advance(
        &mut self,
        settings: &SecondSettings,
        dt_s: f64,
        base: &Pose<Base, Start>,
        contact: Point<Base>,
        sd_m: f64,
    ) -> Option<Point<Base>> {
        self.now_s += dt_s;
        self.remember(base.apply(contact), sd_m);
        let before_s = self.past_s.take();
        if sd_m > CONTACT_SD_M {
            return None;
        }
        let (_, place) = self.farthest_past(base, contact).filter(|(past_m, _)| *past_m > settings.past_m)?;
        let now_s = before_s.map_or(0.0, |before_s| before_s + dt_s);
        self.past_s = Some(now_s);
        (now_s >= settings.past_s && before_s.is_none_or(|before_s| before_s < settings.past_s)).then_some(place)
    }

    /// Remembers the places of contacts that have gone on for [`SETTLING_S`].
    fn remember(&mut self, at: Point<Start>, sd_m: f64) {
        if self.recent.back().is_some_and(|(_, last)| last.distance(&at) > JUMP_M) || sd_m > CONTACT_SD_M {
            self.forget_latest();
        }
        if sd_m > PLACE_SD_M {
            return;
        }
        self.recent.push_back((self.now_s, at));
        while let Some((_, place)) = self.recent.pop_front_if(|(time_s, _)| *time_s < self.now_s - SETTLING_S) {
            if self.places.iter().all(|other| other.distance(&place) > SPACING_M) {
                if self.places.len() == MOST_PLACES {
                    self.places.pop_front();
                }
                self.places.push_back(place);
            }
        }
    }

    /// The place beside the contact that lies farthest past the whisker, with its distance from the centre line.
    fn farthest_past(&mut self, base: &Pose<Base, Start>, contact: Point<Base>) -> Option<(f64, Point<Base>)> {
        let elastica = self.elastica.as_ref()?;
        let to_base = base.inverse();
        let mut apart =
            self.places.iter().map(|place| to_base.apply(*place)).filter(|at| is_apart(*at, contact)).peekable();
        apart.peek()?;
        let found = match &self.near {
            Some(near) => elastica.at_point_near(contact, near),
            None => elastica.at_point(contact),
        };
        let load = found.ok()?.load;
        self.near = Some(load);
        let line = elastica.line(load).ok()?;
        let ends: Vec<_> = arcs(elastica.length_m()).map(|arc_m| line.at(arc_m).0).collect();
        // Away from the object is past it.
        let past = |at| Some((self.face.away_sign() * left_of(&ends, at)?, at));
        apart.filter_map(past).max_by(|(one_m, _), (other_m, _)| one_m.total_cmp(other_m))
    }
}

fn is_apart(place: Point<Base>, contact: Point<Base>) -> bool {
    place.distance(&contact) > APART_M
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
    let nearest = (0..=last).min_by(|i, j| offset(*i).1.norm_squared().total_cmp(&offset(*j).1.norm_squared()))?;
    let (share, offset, chord) = offset(nearest);
    let is_beyond = (nearest == 0 && share < 0.0) || (nearest == last && share > 1.0);
    (!is_beyond).then(|| offset.norm().copysign(chord.perp(&offset)))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use nalgebra::Vector2;

    use super::*;
    use crate::Whisker;
    use crate::rest::direction;

    const PERIOD_S: f64 = 0.01;
    const SETTINGS: SecondSettings = SecondSettings { past_m: 0.15e-3, past_s: 0.03, ..SecondSettings::NONE };

    /// A contact at 35 mm, a place at 60 mm of the loaded whisker, and the unit vector from there to the object.
    fn loaded() -> (Arc<Elastica>, Point<Base>, Point<Base>, Vector2<f64>) {
        let elastica = Arc::new(Elastica::new(&Whisker::straight()).unwrap());
        let load = Load { arc_m: 0.035, along_n: 0.0, left_n: -5e-3, couple_n_m: 0.0 };
        let line = elastica.line(load).unwrap();
        let ((contact, _), (beside, angle_rad)) = (line.at(0.035), line.at(0.06));
        (elastica, contact, beside, direction(angle_rad + FRAC_PI_2))
    }

    /// Ways of the base towards the object at which the whisker is found past a place that was touched 0.5 mm in front of it. The
    /// base moves to and fro by 1.5 mm, at 10 mm/s.
    fn found_m(remember_s: f64, sd_m: f64, forgets: bool) -> Vec<f64> {
        let (elastica, contact, beside, left) = loaded();
        let mut touched = TouchedPlaces::new(Some(elastica), Face::Left);
        let pose = |way_m: f64| Pose::new(way_m * left.x, way_m * left.y, 0.0);
        let place = beside.shifted(0.5e-3 * left);
        for _ in 0..(remember_s / PERIOD_S) as usize {
            touched.advance(&SETTINGS, PERIOD_S, &pose(0.0), place, sd_m);
        }
        if forgets {
            touched.forget();
        }
        let ways_m = (0..=60).map(|i| 1.5e-3 * (1.0 - (f64::from(i) / 15.0 % 2.0 - 1.0).abs()));
        let mut step = |way_m: f64| touched.advance(&SETTINGS, PERIOD_S, &pose(way_m), contact, 1e-4).map(|_| way_m);
        ways_m.filter_map(&mut step).collect()
    }

    #[test]
    fn verif_a_whisker_past_a_touched_place_is_found_once_per_passage() {
        let found_m = found_m(1.0, 1e-4, false);
        // 0.65 mm and three periods later, in both passages.
        assert_eq!(found_m.len(), 2, "{found_m:?}");
        assert!(found_m.iter().all(|way_m| (0.65e-3..1.15e-3).contains(way_m)), "{found_m:?}");
    }

    #[test]
    fn verif_places_that_are_new_or_uncertain_or_forgotten_are_not_found() {
        assert!(found_m(0.3, 1e-4, false).is_empty());
        assert!(found_m(1.0, 2.5e-3, false).is_empty());
        assert!(found_m(1.0, 1e-4, true).is_empty());
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
