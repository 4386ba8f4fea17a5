//! The exact quasi-static whisker in space: an inextensible, unshearable Kirchhoff rod on a compliant root, loaded at one point.
//!
//! # Notation
//! | letter | meaning |
//! | --- | --- |
//! | `s` | arc length, from the root (0) to the tip (`L`) |
//! | `a` | arc length of the contact |
//! | `p` | centre of a section in the frame of the contact: the contact at the origin |
//! | `d1, d2, d3` | directors of a section: its tangent, and its left and upper normals, which are those of Base at the undeflected root |
//! | `f` | force on the whisker at the contact, in the frame of the contact |
//! | `m` | bending and twisting moment |
//! | `kappa0(s)` | pre-curvature, about `d3`, piecewise constant |
//! | `EI(s)`, `GJ(s)` | stiffness in bending, `E pi d^4 / 64`, and in twist, `EI / (1 + nu)` for a round wire with the Poisson ratio `nu` |
//!
//! # Equilibrium
//! The whisker is free of load beyond the contact, and the contact transmits no moment. Hence (Love, "A Treatise on the
//! Mathematical Theory of Elasticity", chapters 18 and 19; Antman, "Nonlinear Problems of Elasticity", chapter 8)
//!
//! ```text
//! dp/ds = d1    d di/ds = kappa x di    m = f x p
//! kappa = (m . d1) / GJ d1 + (m . d2) / EI d2 + (kappa0 + (m . d3) / EI) d3
//! ```
//!
//! with `p = 0` at `s = a`. As in the plane ([`crate::elastica`]), integration from the contact back to the root is an
//! initial-value problem for any load, and the rotation of the root follows from the moment there ([`Suspension`]). A
//! load in the plane of the whisker gives the planar equilibrium.
//!
//! # Limitations
//! Those of [`crate::elastica`]: shear, extension, weight, several simultaneous contacts and self-contact are neglected.
//!
//! # Example
//! A straight whisker is pressed from below and from its right: the contact rises and moves to the left.
//! ```
//! use nalgebra::Vector3;
//! use whisker::Whisker;
//! use whisker::rod::{Rod, SpatialLoad};
//!
//! let rod = Rod::round(&Whisker::straight(), 0.33)?;
//! let force_n = Vector3::new(0.0, 1e-3, 2e-3);
//! let pressed = rod.deflect(SpatialLoad { arc_m: 0.05, force_n })?;
//! assert!(pressed.point.y > 1e-3 && pressed.point.z > 2e-3);
//!
//! let contact = rod.at_point(pressed.point)?;
//! assert!((contact.load.force_n - force_n).norm() < 1e-12);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod line;
mod point;
mod series;
mod suspension;

use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};

use crate::elastica::{Failure, finite, on_the_whisker};
use crate::taylor::Stretch;
use crate::{Invalid, RestShape, Whisker};
use series::Parameter;

pub use line::SpatialLine;
pub use point::SpatialContact;
pub use suspension::{RootAngles, Suspension};

/// A force on the whisker at one point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpatialLoad {
    /// Arc length of the contact.
    pub arc_m: f64,
    /// Force (N) along the tangent at the contact, towards the tip, and along the left and upper normals of the material there.
    pub force_n: Vector3<f64>,
}

/// The whisker in equilibrium under a load, in Base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpatialDeflection {
    /// Contact on the centre line (m).
    pub point: Vector3<f64>,
    /// Directors at the contact as columns: tangent, left and upper normal of the material.
    pub directors: Matrix3<f64>,
    /// Moment at the root (N m): twisting about x, bending about y and z.
    pub moment_n_m: Vector3<f64>,
    /// Force on the whisker (N).
    pub force_n: Vector3<f64>,
    /// Rotation of the root.
    pub root: RootAngles,
}

/// Derivatives of a [`SpatialDeflection`] by one parameter of its load, in Base.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Rate {
    point: Vector3<f64>,
    moment: Vector3<f64>,
    /// Rotation of the directors at the contact.
    rotation: Vector3<f64>,
}

/// A whisker whose equilibria in space can be computed.
#[derive(Clone, Debug, PartialEq)]
pub struct Rod {
    rest: RestShape,
    length_m: f64,
    suspension: Suspension,
    /// Ratio `EI / GJ`.
    twist: f64,
    /// `64 / (pi E)`.
    compliance_coefficient: f64,
    stretches: Vec<Stretch>,
}

impl Rod {
    /// The whisker with these parameters, a suspension, and the Poisson ratio of its round wire.
    ///
    /// # Errors
    /// [`Invalid`] if a parameter is out of its range: stiffness must be positive, the Poisson ratio in (-1, 0.5].
    pub fn new(whisker: &Whisker, suspension: Suspension, poisson_ratio: f64) -> Result<Self, Invalid> {
        whisker.validate()?;
        for (key, found) in [
            ("suspension.yaw_n_m_rad", suspension.yaw_n_m_rad),
            ("suspension.pitch_n_m_rad", suspension.pitch_n_m_rad),
            ("suspension.twist_n_m_rad", suspension.twist_n_m_rad),
        ] {
            if !(found.is_finite() && found > 0.0) {
                return Err(Invalid { key, found, expected: "a positive number".into() });
            }
        }
        if !(poisson_ratio > -1.0 && poisson_ratio <= 0.5) {
            let expected = "more than -1 and at most 0.5".into();
            return Err(Invalid { key: "poisson_ratio", found: poisson_ratio, expected });
        }
        Ok(Self {
            rest: whisker.rest_shape(),
            length_m: whisker.length_m,
            suspension,
            twist: 1.0 + poisson_ratio,
            compliance_coefficient: 64.0 / (PI * whisker.youngs_modulus_pa),
            stretches: Stretch::of(whisker),
        })
    }

    /// The whisker on a suspension that is equally stiff about every axis.
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub fn round(whisker: &Whisker, poisson_ratio: f64) -> Result<Self, Invalid> {
        let stiffness = whisker.root_stiffness_n_m_rad;
        let suspension = Suspension { yaw_n_m_rad: stiffness, pitch_n_m_rad: stiffness, twist_n_m_rad: stiffness };
        Self::new(whisker, suspension, poisson_ratio)
    }

    /// The equilibrium under `load`.
    ///
    /// # Errors
    /// [`Failure::NotFinite`], [`Failure::OffTheWhisker`], [`Failure::TooStrong`].
    pub fn deflect(&self, load: SpatialLoad) -> Result<SpatialDeflection, Failure> {
        let SpatialLoad { arc_m, force_n } = load;
        for (what, found) in
            [("arc_m", arc_m), ("force_n.x", force_n.x), ("force_n.y", force_n.y), ("force_n.z", force_n.z)]
        {
            finite(what, found)?;
        }
        on_the_whisker(arc_m, self.length_m)?;
        let (deflection, []) = self.respond(load, []).ok_or(Failure::TooStrong { force_n: force_n.norm(), arc_m })?;
        Ok(deflection)
    }

    /// The equilibrium and its derivatives. The contact may lie beyond the tip, on the whisker's continuation.
    fn respond<const N: usize>(
        &self,
        load: SpatialLoad,
        parameters: [Parameter; N],
    ) -> Option<(SpatialDeflection, [Rate; N])> {
        let SpatialLoad { arc_m, force_n: force } = load;
        let (root, rates) = series::root(
            &self.stretches,
            self.compliance_coefficient,
            self.twist,
            arc_m,
            force,
            parameters,
            |_, _, _| {},
        )?;
        let to_root = root.directors.transpose();
        let moment = force.cross(&root.position);
        let in_root = to_root * moment;
        let turned = self.suspension.turn(in_root);
        // From the frame of the contact to Base.
        let directors = turned.rotation * to_root;
        let point = -(directors * root.position);
        if !point.iter().all(|x| x.is_finite()) {
            return None;
        }
        let moment_n_m = turned.rotation * in_root;
        let rates = std::array::from_fn(|i| {
            let rate = &rates[i];
            let change = force.cross(&rate.position) + parameters[i].moment(root.position);
            let in_root = to_root * (change + moment.cross(&rate.rotation));
            let turn = turned.flexibility * in_root;
            let rotation = turn - directors * rate.rotation;
            Rate {
                point: rotation.cross(&point) - directors * rate.position,
                moment: turn.cross(&moment_n_m) + turned.rotation * in_root,
                rotation,
            }
        });
        let deflection =
            SpatialDeflection { point, directors, moment_n_m, force_n: directors * force, root: turned.angles };
        Some((deflection, rates))
    }
}
