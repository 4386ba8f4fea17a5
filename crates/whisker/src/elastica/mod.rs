//! The exact quasi-static whisker: an inextensible, unshearable elastic wire on a compliant root, loaded at one point.
//!
//! # Notation
//! | letter | meaning |
//! | --- | --- |
//! | `s` | arc length, from the root (0) to the tip (`L`) |
//! | `a` | arc length of the contact |
//! | `x, y, t` | position and tangent angle of the centre line in the contact's frame: the contact at the origin, its tangent along +x |
//! | `f_t, f_n` | force on the whisker along the tangent at the contact, and to the left of it |
//! | `c` | couple of the friction about the centre line at the contact |
//! | `q` | ratio of friction to normal force, positive if the friction on the whisker is towards its tip |
//! | `kappa0(s)` | pre-curvature, piecewise constant, positive to the left |
//! | `EI(s)` | bending stiffness `E pi d^4 / 64`, the diameter `d` linear in `s` |
//! | `k` | stiffness of the root |
//! | `m(s)` | bending moment; `M = m(0)` is the reading |
//! | `phi` | tangent angle at the contact in Base |
//!
//! # Equilibrium
//! The whisker is free of load beyond the contact. Up to the contact the moment about a section is that of the contact
//! force:
//!
//! ```text
//! dx/ds = cos t    dy/ds = sin t    dt/ds = kappa0 + m / EI    m = c + y f_t - x f_n
//! ```
//!
//! with `x = y = t = 0` at `s = a`. Integration from `s = a` back to `s = 0` is an initial-value problem for any load,
//! without shooting or a boundary-value problem (Euler's elastica; Frisch-Fay, "Flexible Bars", 1962). The suspension
//! turns by `M / k`, hence `phi = M / k - t(0)` and the contact lies at `-R(phi) (x(0), y(0))` in Base. The force of a
//! frictionless contact acts along the common normal of object and whisker: across the whisker, `f_t = 0`, if the
//! whisker is not tapered. The surface of a tapered whisker, and with it the force, is inclined by the slope `r'` of
//! the radius, `f_t = r' F`; at the tip the force has the direction of the object's normal. Friction acts on the surface,
//! at the distance of the radius `r` from the centre line: with the normal force `N`, and the object on the side `e` (+1
//! left), a friction `q N` along the surface has the couple `c = -e r q N`.
//!
//! [`Elastica::deflect`] is this forward map. Its derivatives with respect to `(a, f_t, f_n)` follow from the same
//! recurrences (the variational equations), so the inverse maps are Newton iterations: [`Elastica::at_point`] for a
//! contact at a known point, [`Elastica::against`] for a convex object in a known pose. Of several equilibria they give
//! the one reached from the undeflected whisker without passing a fold (a point where the determinant of the equations
//! changes its sign and the whisker would snap).
//!
//! # Limitations
//! Shear, extension (of the order of the square of diameter over length), weight, several simultaneous contacts and
//! self-contact of a curled wire are neglected. [`Elastica::at_point`] does not model the taper of the surface: without
//! friction its force is across the centre line, on a tapered whisker too. The ratio of friction to normal force is an
//! argument; which ratio Coulomb's law gives depends on the motion before.
//!
//! # Example
//! ```
//! use whisker::Whisker;
//! use whisker::elastica::{Elastica, Load};
//!
//! let elastica = Elastica::new(&Whisker::straight())?;
//! let pressed = elastica.deflect(Load { arc_m: 0.05, along_n: 0.0, left_n: 1e-3, couple_n_m: 0.0 })?;
//! let contact = elastica.at_point(pressed.point)?;
//! assert!((contact.load.left_n - 1e-3).abs() < 1e-15);
//! assert!((contact.deflection.moment_n_m - pressed.moment_n_m).abs() < 1e-17);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod contact;
mod line;
mod modes;
pub(crate) mod newton;
mod outline;
mod point;
mod series;

use std::f64::consts::PI;

use nalgebra::Vector2;

use crate::face::Face;
use crate::frames::{Base, Point};
use crate::rest::direction;
use crate::taylor::Stretch;
use crate::{Invalid, RestShape, Whisker};
use series::Parameter;

pub use contact::{Regime, Touch};
pub use line::CenterLine;
pub use modes::natural_frequencies_hz;
pub use outline::{Circle, Ellipse, Flat, NotConvex, Outline, Polygon, Support};
pub use point::{Friction, PointContact};

/// A force on the whisker at one point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Load {
    /// Arc length of the contact.
    pub arc_m: f64,
    /// Force along the whisker's tangent at the contact, towards the tip; zero on the side of a whisker without
    /// friction or taper.
    pub along_n: f64,
    /// Force across the whisker, positive to its left: positive from an object on its right.
    pub left_n: f64,
    /// Couple about the centre line, positive to the left: that of friction, which acts on the whisker's surface; zero
    /// without friction.
    pub couple_n_m: f64,
}

/// The whisker in equilibrium under a load.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deflection {
    /// The contact on the centre line.
    pub point: Point<Base>,
    /// Angle of the tangent at the contact, in Base, not wrapped.
    pub tangent_rad: f64,
    /// Moment at the root, the reading: negative if the object lies on the left.
    pub moment_n_m: f64,
    /// Rotation of the root against the base.
    pub rotation_rad: f64,
    /// The tip.
    pub tip: Point<Base>,
}

/// Derivatives of a [`Deflection`] by one parameter of its load.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Rate {
    point: Vector2<f64>,
    tangent: f64,
    moment: f64,
}

/// Reason for a missing equilibrium.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Failure {
    /// A number is not finite.
    #[error("{what}: found {found}, expected a finite number")]
    NotFinite {
        /// Name of the quantity.
        what: &'static str,
        /// The number.
        found: f64,
    },
    /// The load is not on the whisker.
    #[error(
        "arc length of the contact: found {arc_m} m, expected more than 0 and at most the whisker's length of {length_m} m"
    )]
    OffTheWhisker {
        /// Arc length of the contact.
        arc_m: f64,
        /// Length of the whisker.
        length_m: f64,
    },
    /// The load exceeds the capacity of the whisker.
    #[error("force of {force_n} N at {arc_m} m: exceeds the capacity of the whisker")]
    TooStrong {
        /// Magnitude of the force.
        force_n: f64,
        /// Arc length of the contact.
        arc_m: f64,
    },
    /// The point is farther from the root than the whisker is long.
    #[error("point {distance_m} m from the root: out of reach of the whisker, which is {length_m} m long")]
    OutOfReach {
        /// Distance of the point from the root.
        distance_m: f64,
        /// Length of the whisker.
        length_m: f64,
    },
    /// The tip slips off the object before the whisker reaches the deflection.
    #[error("the whisker slips off: no equilibrium beyond {:.1} % of the deflection", 100.0 * reached)]
    SlippedOff {
        /// Share of the way from the undeflected whisker that has an equilibrium.
        reached: f64,
    },
    /// The whisker snaps to another shape before it reaches the deflection.
    #[error("the whisker buckles: no equilibrium beyond {:.1} % of the deflection", 100.0 * reached)]
    Buckled {
        /// Share of the way from the undeflected whisker that has an equilibrium.
        reached: f64,
    },
    /// The concave side of the whisker bridges the object: the contact is at more than one point.
    #[error("the whisker's concave side bridges the object around {arc_m} m: it touches at more than one point")]
    Bridged {
        /// Arc length around which it bridges the object.
        arc_m: f64,
    },
}

/// A whisker whose equilibria can be computed.
#[derive(Clone, Debug, PartialEq)]
pub struct Elastica {
    rest: RestShape,
    length_m: f64,
    root_diameter_m: f64,
    taper: f64,
    root_stiffness_n_m_rad: f64,
    /// `64 / (pi E)`.
    compliance_coefficient: f64,
    stretches: Vec<Stretch>,
}

impl Elastica {
    /// The whisker with these parameters.
    ///
    /// # Errors
    /// [`Invalid`] if they do not describe one.
    pub fn new(whisker: &Whisker) -> Result<Self, Invalid> {
        whisker.validate()?;
        let (rest, length_m) = (whisker.rest_shape(), whisker.length_m);
        let taper = (whisker.tip_diameter_m - whisker.root_diameter_m) / length_m;
        Ok(Self {
            rest,
            length_m,
            root_diameter_m: whisker.root_diameter_m,
            taper,
            root_stiffness_n_m_rad: whisker.root_stiffness_n_m_rad,
            compliance_coefficient: 64.0 / (PI * whisker.youngs_modulus_pa),
            stretches: Stretch::of(whisker),
        })
    }

    /// Length of the whisker.
    pub fn length_m(&self) -> f64 {
        self.length_m
    }

    /// The equilibrium under `load`.
    ///
    /// # Errors
    /// [`Failure::NotFinite`], [`Failure::OffTheWhisker`], [`Failure::TooStrong`].
    pub fn deflect(&self, load: Load) -> Result<Deflection, Failure> {
        self.check(&load)?;
        let (deflection, []) = self.respond(load, []).ok_or(load.too_strong())?;
        Ok(deflection)
    }

    fn check(&self, load: &Load) -> Result<(), Failure> {
        for (what, found) in
            [("arc_m", load.arc_m), ("along_n", load.along_n), ("left_n", load.left_n), ("couple_n_m", load.couple_n_m)]
        {
            finite(what, found)?;
        }
        on_the_whisker(load.arc_m, self.length_m)
    }

    /// The equilibrium and its derivatives. The contact may lie beyond the tip, on the whisker's continuation.
    fn respond<const N: usize>(&self, load: Load, parameters: [Parameter; N]) -> Option<(Deflection, [Rate; N])> {
        let (root, rates) =
            series::root(&self.stretches, self.compliance_coefficient, &load, parameters, |_, _, _| {})?;
        let moment_n_m = load.moment_n_m(root.x_m, root.y_m);
        let rotation_rad = moment_n_m / self.root_stiffness_n_m_rad;
        let tangent_rad = rotation_rad - root.t_rad;
        if !tangent_rad.is_finite() {
            return None;
        }
        let tangent = direction(tangent_rad);
        let point = turned(Vector2::new(-root.x_m, -root.y_m), tangent);
        let rates = std::array::from_fn(|i| {
            let rate = &rates[i];
            let moment = rate.y_m * load.along_n - rate.x_m * load.left_n + parameters[i].moment(root.x_m, root.y_m);
            let angle = moment / self.root_stiffness_n_m_rad - rate.t_rad;
            let shift = turned(Vector2::new(-rate.x_m, -rate.y_m), tangent);
            Rate { point: shift + angle * Vector2::new(-point.y, point.x), tangent: angle, moment }
        });
        // Beyond the contact the whisker keeps its undeflected shape.
        let (rest, at) = (&self.rest, load.arc_m);
        let beyond = rest.point(self.length_m).vector() - rest.point(at).vector();
        let tip = point + turned(beyond, direction(tangent_rad - rest.tangent_rad(at)));
        let (point, tip) = (Point::from_vector(point), Point::from_vector(tip));
        Some((Deflection { point, tangent_rad, moment_n_m, rotation_rad, tip }, rates))
    }

    /// Radius of the wire (m). Its surface is continued straight beyond the tip.
    pub fn radius_m(&self, arc_m: f64) -> f64 {
        0.5 * self.root_diameter_m + self.radius_slope() * arc_m
    }

    /// Change of the wire's radius per length.
    fn radius_slope(&self) -> f64 {
        0.5 * self.taper
    }
}

impl Load {
    /// Moment of the section at `x, y` in the contact's frame.
    fn moment_n_m(&self, x_m: f64, y_m: f64) -> f64 {
        self.couple_n_m + y_m * self.along_n - x_m * self.left_n
    }

    fn too_strong(&self) -> Failure {
        Failure::TooStrong { force_n: self.along_n.hypot(self.left_n), arc_m: self.arc_m }
    }
}

/// `v` turned by the angle of the unit vector `to`.
fn turned(v: Vector2<f64>, to: Vector2<f64>) -> Vector2<f64> {
    Vector2::new(to.x * v.x - to.y * v.y, to.y * v.x + to.x * v.y)
}

pub(crate) fn finite(what: &'static str, found: f64) -> Result<(), Failure> {
    if found.is_finite() { Ok(()) } else { Err(Failure::NotFinite { what, found }) }
}

/// Checks that a contact lies on the whisker.
pub(crate) fn on_the_whisker(arc_m: f64, length_m: f64) -> Result<(), Failure> {
    if arc_m > 0.0 && arc_m <= length_m { Ok(()) } else { Err(Failure::OffTheWhisker { arc_m, length_m }) }
}

/// +1 if the object lies on the left of the whisker, -1 if it lies on the right.
fn side(face: Face) -> f64 {
    -face.away_sign()
}
