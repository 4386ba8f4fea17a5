//! Contacts of the rows of a recording, in space.

use std::ops::Range;

use nalgebra::{Unit, Vector2, Vector3};
use trace::BendingResponse;

use super::Space;
use super::pin::{Mechanics, Pin, PinContact, PlaceOnPin, Side};
use crate::own::recording::Sampled;

/// Smallest interval between rows, in nominal intervals, that ends a touch.
const MOST_INTERVALS: f64 = 1.5;

/// Ratio of the reading of the deflected rod to the recorded one above which the whisker is taken to be free. It allows for friction,
/// for the nonlinearity of a sensor, and for parameters of the whisker that are only roughly known.
const WEAK: f64 = 4.0;

/// Contact in a row, in Base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Contact {
    /// The whisker is free, or the place is not known.
    Unknown,
    /// The reading is that of a touch, but there is no contact with the pin.
    NotFound,
    /// The reading is that of a touch, but far smaller than that of the whisker if it were deflected by the contact.
    Weak,
    /// Contact on the centre line (m), and the moments of the rod about y and z (N m) if they are known already.
    At(Vector3<f64>, Option<Vector2<f64>>),
}

impl Contact {
    pub(super) fn point(self) -> Option<Vector3<f64>> {
        match self {
            Self::At(point, _) => Some(point),
            Self::Unknown | Self::NotFound | Self::Weak => None,
        }
    }

    /// Moments of the rod about y and z (N m), 2x1. `None` if the whisker does not reach the contact.
    pub(super) fn moment_n_m(self, mechanics: &Mechanics) -> Option<Vector2<f64>> {
        match self {
            Self::At(point, moment_n_m) => moment_n_m.or_else(|| mechanics.moment_n_m(point)),
            Self::Unknown | Self::NotFound | Self::Weak => None,
        }
    }
}

impl From<PinContact> for Contact {
    fn from(contact: PinContact) -> Self {
        Self::At(contact.point, Some(contact.moment_n_m))
    }
}

impl Sampled<'_, Space> {
    /// Reading of both channels relative to rest in a row, 2x1.
    pub(super) fn counts(&self, row: usize) -> Vector2<f64> {
        Vector2::from_iterator(self.readings(row))
    }

    /// Contacts of all rows. The side of a pin is that which agrees with the readings, if the response of the sensor to the moments of
    /// the rod is known. Contacts whose readings are far too small for the deflection are then left out, unless the recording
    /// states that the whisker touches: a free whisker that oscillates, or whose base is accelerated, has the reading of a light
    /// touch wherever the pin is.
    pub(super) fn contacts(
        &self,
        mechanics: &Mechanics,
        touch: f64,
        response: Option<&BendingResponse>,
    ) -> Vec<Contact> {
        let rows = self.places.len();
        let place_in_base = |row: usize| {
            let place = self.places[row].filter(|_| self.touches(row, touch))?;
            let base = &self.base[row];
            Some(base.rotation.inverse() * (place - base.position))
        };
        let places: Vec<Option<Vector3<f64>>> = (0..rows).map(place_in_base).collect();
        let is_weak = |row: usize, moment_n_m: Vector2<f64>| {
            let most = WEAK * self.distance_from_rest(row).max(touch);
            response.is_some_and(|response| response.counts(moment_n_m).norm() > most)
        };
        let is_stated = |row: usize| self.touching[row] == Some(true);
        let Some((axis, radius_m)) = self.entry.contact.as_ref().and_then(|of| Some((of.axis()?, of.radius_m())))
        else {
            let contact = |row: usize, at: Vector3<f64>| {
                let moment_n_m = response.and_then(|_| mechanics.moment_n_m(at));
                let is_weak = moment_n_m.is_some_and(|moment_n_m| is_weak(row, moment_n_m));
                if is_weak && !is_stated(row) { Contact::Weak } else { Contact::At(at, moment_n_m) }
            };
            let places = places.into_iter().enumerate();
            return places.map(|(row, place)| place.map_or(Contact::Unknown, |at| contact(row, at))).collect();
        };
        let pin = |row: usize| {
            let axis = Unit::new_unchecked(self.base[row].rotation.inverse() * axis.into_inner());
            places[row].map(|place| Pin { place, axis, radius_m })
        };
        let agrees = |row: usize, contact: &PinContact| {
            response.is_none_or(|response| response.moment_n_m(self.counts(row)).dot(&contact.moment_n_m) > 0.0)
        };
        // Contact of a row on this side that agrees with the reading, or why there is none.
        let on_side = |row: usize, side: Side, near: Option<&PlaceOnPin>| {
            let contact = pin(row).and_then(|pin| mechanics.with_pin(&pin, side, near)).ok_or(Contact::NotFound)?;
            match (is_weak(row, contact.moment_n_m), is_stated(row)) {
                (true, false) => Err(Contact::Weak),
                // Within a touch the side is known; the sign of so small a reading may be wrong.
                (true, true) if near.is_some() => Ok(contact),
                _ => agrees(row, &contact).then_some(contact).ok_or(Contact::NotFound),
            }
        };
        let sides_of = |row: usize| match response {
            Some(_) => Side::BOTH.to_vec(),
            None => pin(row).and_then(|pin| mechanics.side_of_axis(&pin)).into_iter().collect(),
        };
        let mut contacts = vec![Contact::Unknown; rows];
        for touched in self.touches_of(&places) {
            contacts[touched.clone()].fill(Contact::NotFound);
            // From the deepest row with a contact on, where the side is most certain.
            let mut by_depth: Vec<usize> = touched.clone().collect();
            by_depth.sort_by(|a, b| self.distance_from_rest(*b).total_cmp(&self.distance_from_rest(*a)));
            // Side and contact in this row.
            let mut begun = |row: usize| {
                for side in sides_of(row) {
                    match on_side(row, side, None) {
                        Ok(contact) => return Some((side, contact)),
                        Err(Contact::Weak) => contacts[row] = Contact::Weak,
                        Err(_) => {}
                    }
                }
                None
            };
            let Some((deepest, (side, first))) = by_depth.into_iter().find_map(|row| Some((row, begun(row)?))) else {
                continue;
            };
            contacts[deepest] = first.into();
            let mut follow = |rows: &mut dyn Iterator<Item = usize>| {
                let mut near = first.place;
                for row in rows {
                    let contact = on_side(row, side, Some(&near));
                    near = contact.map_or(near, |contact| contact.place);
                    contacts[row] = contact.map_or_else(|lacking| lacking, Contact::from);
                }
            };
            follow(&mut (touched.start..deepest).rev());
            follow(&mut (deepest + 1..touched.end));
        }
        contacts
    }

    /// Rows of each touch: consecutive ones with a place, without a gap in the times.
    fn touches_of(&self, places: &[Option<Vector3<f64>>]) -> Vec<Range<usize>> {
        let t_s = &self.grid.t_s;
        let mut touches: Vec<Range<usize>> = Vec::new();
        for row in (0..places.len()).filter(|row| places[*row].is_some()) {
            match touches.last_mut() {
                Some(last) if last.end == row && t_s[row] - t_s[row - 1] < MOST_INTERVALS / self.rate_hz => {
                    last.end += 1
                }
                _ => touches.push(row..row + 1),
            }
        }
        touches
    }
}
