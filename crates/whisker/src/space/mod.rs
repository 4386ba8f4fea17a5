//! Contacts in space: frames, sensor models and estimators with three coordinates of the contact and two bending moments.
//!
//! | module | contents |
//! | --- | --- |
//! | [`frames`] | points and poses in space |
//! | [`estimators`] | estimators of the contact, the surface normal and the direction of an edge |
//! | [`sensor`] | sensor models: fit, calibrated domain, model error, geometry of the contact |
//! | [`surface`] | estimate of a surface from oriented points |
//!
//! The mechanics are those of [`crate::rod`]. Base has its x along the tangent of the undeflected root, y to the left and z up; the
//! undeflected whisker lies in the plane `z = 0`.

pub mod estimators;
pub mod frames;
pub mod sensor;
pub mod surface;
