//! Solids as curves, for pictures.

use std::f64::consts::{PI, TAU};

use nalgebra::{Quaternion, Rotation3, UnitQuaternion, Vector3};
use serde::Deserialize;
use serde_json::Value;

/// Number of lines along the profile of a solid of revolution.
const LINES: usize = 8;
/// Points of a circle.
const CIRCLE: usize = 48;
/// Pieces of a round end.
const ROUND: usize = 6;

/// Place of a solid of revolution.
#[derive(Deserialize)]
struct Axial {
    center_m: [f64; 3],
    axis: [f64; 3],
}

/// A solid as a scene describes it. Its meshes are not known here.
#[derive(Deserialize)]
#[serde(tag = "shape", rename_all = "snake_case")]
enum Solid {
    Pin {
        radius_m: f64,
        length_m: f64,
        #[serde(flatten)]
        place: Axial,
    },
    Sphere {
        radius_m: f64,
        center_m: [f64; 3],
    },
    Cylinder {
        radius_m: f64,
        length_m: f64,
        #[serde(flatten)]
        place: Axial,
    },
    Cone {
        radius_m: f64,
        top_radius_m: f64,
        length_m: f64,
        #[serde(flatten)]
        place: Axial,
    },
    Torus {
        radius_m: f64,
        tube_m: f64,
        #[serde(flatten)]
        place: Axial,
    },
    Box {
        size_m: [f64; 3],
        center_m: [f64; 3],
        orientation: [f64; 4],
    },
}

/// Curves of the surface of a solid, in World (m). Empty for a solid that is not known.
pub(super) fn curves_m(description: &Value) -> Vec<Vec<Vector3<f64>>> {
    let Ok(solid) = serde_json::from_value::<Solid>(description.clone()) else { return Vec::new() };
    match solid {
        Solid::Pin { radius_m, length_m, place } => {
            let end = |from: f64, height_m: f64| {
                (0..=ROUND).map(move |i| {
                    let angle = from + 0.5 * PI * i as f64 / ROUND as f64;
                    (radius_m * angle.cos(), height_m + radius_m * angle.sin())
                })
            };
            let profile = end(-0.5 * PI, -0.5 * length_m).chain(end(0.0, 0.5 * length_m));
            place.turned(&profile.collect::<Vec<_>>())
        }
        Solid::Sphere { radius_m, center_m } => {
            let place = Axial { center_m, axis: [0.0, 0.0, 1.0] };
            let angles = (0..=2 * ROUND).map(|i| PI * (i as f64 / (2 * ROUND) as f64 - 0.5));
            place.turned(&angles.map(|angle| (radius_m * angle.cos(), radius_m * angle.sin())).collect::<Vec<_>>())
        }
        Solid::Cylinder { radius_m, length_m, place } => place.turned(&frustum(radius_m, radius_m, length_m)),
        Solid::Cone { radius_m, top_radius_m, length_m, place } => {
            place.turned(&frustum(radius_m, top_radius_m, length_m))
        }
        Solid::Torus { radius_m, tube_m, place } => {
            let angles = (0..=4 * ROUND).map(|i| TAU * i as f64 / (4 * ROUND) as f64);
            let at = |angle: f64| (radius_m + tube_m * angle.cos(), tube_m * angle.sin());
            place.turned(&angles.map(at).collect::<Vec<_>>())
        }
        Solid::Box { size_m, center_m, orientation: [w, x, y, z] } => {
            let turn = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
            let corner =
                |signs: [f64; 3]| Vector3::from(center_m) + turn * Vector3::from_fn(|i, _| 0.5 * signs[i] * size_m[i]);
            let mut edges = Vec::new();
            for along in 0..3 {
                for signs in [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]] {
                    let end = |sign: f64| {
                        let mut all = [sign; 3];
                        (all[(along + 1) % 3], all[(along + 2) % 3]) = (signs[0], signs[1]);
                        corner(all)
                    };
                    edges.push(vec![end(-1.0), end(1.0)]);
                }
            }
            edges
        }
    }
}

/// Profile of the side of a frustum.
fn frustum(radius_m: f64, top_radius_m: f64, length_m: f64) -> Vec<(f64, f64)> {
    let shares = (0..=ROUND).map(|i| i as f64 / ROUND as f64);
    shares.map(|share| (radius_m + share * (top_radius_m - radius_m), length_m * (share - 0.5))).collect()
}

impl Axial {
    /// Curves of the solid whose surface the profile (distance from the axis, height) describes by its revolution: lines along
    /// the profile, and a circle through each of its points.
    fn turned(&self, profile: &[(f64, f64)]) -> Vec<Vec<Vector3<f64>>> {
        let axis = Vector3::from(self.axis);
        // Two opposite directions have no unique rotation between them; any serves.
        let turn = Rotation3::rotation_between(&Vector3::z(), &axis)
            .unwrap_or_else(|| Rotation3::from_axis_angle(&Vector3::x_axis(), PI));
        let point = |radius_m: f64, angle: f64, height_m: f64| {
            let local = Vector3::new(radius_m * angle.cos(), radius_m * angle.sin(), height_m);
            Vector3::from(self.center_m) + turn * local
        };
        let lines = (0..LINES).map(|line| {
            let angle = TAU * line as f64 / LINES as f64;
            profile.iter().map(|&(radius_m, height_m)| point(radius_m, angle, height_m)).collect()
        });
        let wide = profile.iter().filter(|(radius_m, _)| *radius_m > 1e-9);
        let circles = wide.map(|&(radius_m, height_m)| {
            (0..=CIRCLE).map(|i| point(radius_m, TAU * i as f64 / CIRCLE as f64, height_m)).collect()
        });
        lines.chain(circles).collect()
    }
}
