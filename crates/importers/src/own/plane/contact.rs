//! Contact of a whisker with a pin, in the plane.

use std::path::Path;

use files::Error;
use nalgebra::Vector2;
use whisker::Whisker;
use whisker::elastica::Elastica;
use whisker::frames::{Base, Point, Pose, World};
use whisker::sensor::Face;

/// Iterations that find the tangent of the whisker at a pin of finite radius.
const ITERATIONS: usize = 5;

/// Contact of a whisker with a pin.
#[derive(Clone, Copy, Debug)]
pub(super) struct Contact {
    pub(super) centre_line: Point<World>,
    /// `None` if the radius of the pin is not known.
    pub(super) surface: Option<Point<World>>,
}

/// Mechanics of a whisker.
pub(crate) struct Mechanics {
    whisker: Whisker,
    elastica: Elastica,
}

impl Mechanics {
    /// # Errors
    /// [`Error::Value`] of the mapping's parameter that has no elastica.
    pub(super) fn new(path: &Path, whisker: &Whisker) -> Result<Self, Error> {
        let elastica = Elastica::new(whisker)
            .map_err(|error| Error::value(path, format!("whisker.{}", error.key), error.found, error.expected))?;
        Ok(Self { whisker: whisker.clone(), elastica })
    }

    /// Contact at a place, or with a pin of this radius whose axis is the place: along the normal of the deflected
    /// whisker. Its tangent is that of the elastica through the contact, found by iteration, or else that of the
    /// undeflected whisker.
    pub(super) fn contact(
        &self,
        base: &Pose<Base, World>,
        place: Point<World>,
        radius_m: Option<f64>,
        face: Face,
    ) -> Contact {
        let Some(radius_m) = radius_m else { return Contact { centre_line: place, surface: None } };
        let rest = self.whisker.rest_shape();
        let axis = base.inverse().apply(place);
        let away = |tangent_rad: f64| Vector2::new(-tangent_rad.sin(), tangent_rad.cos()) * face.away_sign();
        let mut contact = axis;
        let mut normal = Vector2::zeros();
        for _ in 0..ITERATIONS {
            let foot = rest.foot(contact);
            let tangent_rad = self
                .elastica
                .at_point(contact)
                .map_or_else(|_| rest.tangent_rad(foot.arc_m), |contact| contact.deflection.tangent_rad);
            normal = away(tangent_rad);
            contact = axis.shifted(normal * (radius_m + 0.5 * self.whisker.diameter_m(foot.arc_m)));
        }
        Contact { centre_line: base.apply(contact), surface: Some(base.apply(axis.shifted(normal * radius_m))) }
    }

    /// Moment of the elastica through a contact. `None` if the whisker does not reach it.
    pub(super) fn moment_n_m(&self, base: &Pose<Base, World>, contact: &Contact) -> Option<f64> {
        let contact = self.elastica.at_point(base.inverse().apply(contact.centre_line)).ok()?;
        Some(contact.deflection.moment_n_m)
    }
}
