//! The solids of scenes in space: distance of a point from their surface, and curves that show them.

use std::f64::consts::{PI, TAU};

use nalgebra::{Quaternion, Rotation3, UnitQuaternion, Vector2, Vector3};
use serde::Deserialize;
use serde_json::Value;

/// Number of lines along the profile of a solid of revolution.
const LINES: usize = 8;
/// Points of a circle.
const CIRCLE: usize = 48;
/// Pieces of a round end.
const ROUND: usize = 6;

/// Place of a solid of revolution.
#[derive(Clone, Debug, Deserialize, PartialEq)]
pub struct Axial {
    /// Centre, in World.
    pub center_m: [f64; 3],
    /// Direction of the axis in World, of any length.
    pub axis: [f64; 3],
}

/// A solid as a scene describes it. Meshes are not known here, since a scene names their files only.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(tag = "shape", rename_all = "snake_case")]
pub enum Solid {
    /// Thin rod with hemispheres at its ends.
    Pin {
        /// Radius of the rod.
        radius_m: f64,
        /// Distance between the centres of the hemispheres.
        length_m: f64,
        /// Its place.
        #[serde(flatten)]
        place: Axial,
    },
    /// Sphere.
    Sphere {
        /// Its radius.
        radius_m: f64,
        /// Its centre, in World.
        center_m: [f64; 3],
    },
    /// Cylinder with flat ends.
    Cylinder {
        /// Its radius.
        radius_m: f64,
        /// Its length.
        length_m: f64,
        /// Its place.
        #[serde(flatten)]
        place: Axial,
    },
    /// Cone, also cut off.
    Cone {
        /// Radius at the lower end.
        radius_m: f64,
        /// Radius at the upper end.
        top_radius_m: f64,
        /// Distance between the ends.
        length_m: f64,
        /// Its place.
        #[serde(flatten)]
        place: Axial,
    },
    /// Torus.
    Torus {
        /// Radius of the circle along which the tube runs.
        radius_m: f64,
        /// Radius of the tube.
        tube_m: f64,
        /// Its place.
        #[serde(flatten)]
        place: Axial,
    },
    /// Box.
    Box {
        /// Lengths of the edges along the axes of its frame.
        size_m: [f64; 3],
        /// Its centre, in World.
        center_m: [f64; 3],
        /// Rotation of its frame to World as a unit quaternion (w, x, y, z).
        orientation: [f64; 4],
    },
}

impl Solid {
    /// The solid of a scene. `None` if its shape is not one of these.
    pub fn of_scene(description: &Value) -> Option<Self> {
        serde_json::from_value(description.clone()).ok()
    }

    /// Distance of a point in World (m, 3x1) from the surface, from outside or inside.
    pub fn distance_m(&self, point: Vector3<f64>) -> f64 {
        match self {
            Self::Pin { radius_m, length_m, place } => {
                let (away_m, height_m) = place.coordinates(point);
                (away_m.hypot(height_m - height_m.clamp(-0.5 * length_m, 0.5 * length_m)) - radius_m).abs()
            }
            Self::Sphere { radius_m, center_m } => ((point - Vector3::from(*center_m)).norm() - radius_m).abs(),
            Self::Cylinder { radius_m, length_m, place } => {
                from_frustum(place.coordinates(point), *radius_m, *radius_m, *length_m)
            }
            Self::Cone { radius_m, top_radius_m, length_m, place } => {
                from_frustum(place.coordinates(point), *radius_m, *top_radius_m, *length_m)
            }
            Self::Torus { radius_m, tube_m, place } => {
                let (away_m, height_m) = place.coordinates(point);
                ((away_m - radius_m).hypot(height_m) - tube_m).abs()
            }
            Self::Box { size_m, center_m, orientation } => {
                let local = rotation(*orientation).inverse() * (point - Vector3::from(*center_m));
                let beyond = local.abs() - 0.5 * Vector3::from(*size_m);
                if beyond.max() > 0.0 { beyond.map(|way_m| way_m.max(0.0)).norm() } else { -beyond.max() }
            }
        }
    }

    /// Radius of a sphere or cylinder. `None` for other solids.
    pub fn radius_m(&self) -> Option<f64> {
        match self {
            Self::Sphere { radius_m, .. } | Self::Cylinder { radius_m, .. } => Some(*radius_m),
            _ => None,
        }
    }

    /// Distances of a point in World (m, 3x1) from the nearest edge and the nearest corner of a box. `None` for other solids.
    pub fn features_m(&self, point: Vector3<f64>) -> Option<(f64, f64)> {
        let Self::Box { size_m, center_m, orientation } = self else { return None };
        let local = rotation(*orientation).inverse() * (point - Vector3::from(*center_m));
        let from_corner = local.abs() - 0.5 * Vector3::from(*size_m);
        // An edge extends from a corner inwards along one axis.
        let from_edge = |along: usize| {
            let mut from = from_corner;
            from[along] = from[along].max(0.0);
            from.norm()
        };
        Some(((0..3).map(from_edge).fold(f64::INFINITY, f64::min), from_corner.norm()))
    }

    /// Curves of the surface, in World (m).
    pub fn curves_m(&self) -> Vec<Vec<Vector3<f64>>> {
        match self {
            Self::Pin { radius_m, length_m, place } => {
                let end = |from: f64, height_m: f64| {
                    (0..=ROUND).map(move |i| {
                        let angle = from + 0.5 * PI * i as f64 / ROUND as f64;
                        (radius_m * angle.cos(), height_m + radius_m * angle.sin())
                    })
                };
                let profile = end(-0.5 * PI, -0.5 * length_m).chain(end(0.0, 0.5 * length_m));
                place.turned(&profile.collect::<Vec<_>>())
            }
            Self::Sphere { radius_m, center_m } => {
                let place = Axial { center_m: *center_m, axis: [0.0, 0.0, 1.0] };
                let angles = (0..=2 * ROUND).map(|i| PI * (i as f64 / (2 * ROUND) as f64 - 0.5));
                place.turned(&angles.map(|angle| (radius_m * angle.cos(), radius_m * angle.sin())).collect::<Vec<_>>())
            }
            Self::Cylinder { radius_m, length_m, place } => place.turned(&frustum(*radius_m, *radius_m, *length_m)),
            Self::Cone { radius_m, top_radius_m, length_m, place } => {
                place.turned(&frustum(*radius_m, *top_radius_m, *length_m))
            }
            Self::Torus { radius_m, tube_m, place } => {
                let angles = (0..=4 * ROUND).map(|i| TAU * i as f64 / (4 * ROUND) as f64);
                let at = |angle: f64| (radius_m + tube_m * angle.cos(), tube_m * angle.sin());
                place.turned(&angles.map(at).collect::<Vec<_>>())
            }
            Self::Box { size_m, center_m, orientation } => edges(*size_m, *center_m, *orientation),
        }
    }
}

fn rotation([w, x, y, z]: [f64; 4]) -> UnitQuaternion<f64> {
    UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
}

/// The twelve edges of a box.
fn edges(size_m: [f64; 3], center_m: [f64; 3], orientation: [f64; 4]) -> Vec<Vec<Vector3<f64>>> {
    let turn = rotation(orientation);
    let corner = |signs: [f64; 3]| Vector3::from(center_m) + turn * Vector3::from_fn(|i, _| 0.5 * signs[i] * size_m[i]);
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

/// Distance of a point, given by its distance from the axis and its height, from the surface of a frustum with flat ends.
fn from_frustum((away_m, height_m): (f64, f64), radius_m: f64, top_radius_m: f64, length_m: f64) -> f64 {
    let half_m = 0.5 * length_m;
    let profile = [[0.0, -half_m], [radius_m, -half_m], [top_radius_m, half_m], [0.0, half_m]].map(Vector2::from);
    let point = Vector2::new(away_m, height_m);
    let from_piece = |ends: &[Vector2<f64>]| {
        let (along, to) = (ends[1] - ends[0], point - ends[0]);
        let share = if along.norm() > 0.0 { (to.dot(&along) / along.norm_squared()).clamp(0.0, 1.0) } else { 0.0 };
        (to - share * along).norm()
    };
    profile.windows(2).map(from_piece).fold(f64::INFINITY, f64::min)
}

/// Profile of the side of a frustum.
fn frustum(radius_m: f64, top_radius_m: f64, length_m: f64) -> Vec<(f64, f64)> {
    let shares = (0..=ROUND).map(|i| i as f64 / ROUND as f64);
    shares.map(|share| (radius_m + share * (top_radius_m - radius_m), length_m * (share - 0.5))).collect()
}

impl Axial {
    /// Distance of a point in World from the axis, and its height along it above the centre.
    fn coordinates(&self, point: Vector3<f64>) -> (f64, f64) {
        let from_center = point - Vector3::from(self.center_m);
        let height_m = Vector3::from(self.axis).normalize().dot(&from_center);
        ((from_center.norm_squared() - height_m * height_m).max(0.0).sqrt(), height_m)
    }

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

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    const CENTER: [f64; 3] = [0.01, -0.02, 0.03];

    fn solids() -> Vec<Solid> {
        let axis = [0.3, -0.2, 1.0];
        [
            json!({"shape": "pin", "radius_m": 5e-4, "length_m": 0.1, "center_m": CENTER, "axis": axis}),
            json!({"shape": "sphere", "radius_m": 0.02, "center_m": CENTER}),
            json!({"shape": "cylinder", "radius_m": 0.01, "length_m": 0.1, "center_m": CENTER, "axis": axis}),
            json!({
                "shape": "cone", "radius_m": 0.02, "top_radius_m": 0.0, "length_m": 0.05, "center_m": CENTER, "axis": axis
            }),
            json!({"shape": "torus", "radius_m": 0.03, "tube_m": 0.005, "center_m": CENTER, "axis": [0.0, 0.0, -1.0]}),
            json!({
                "shape": "box", "size_m": [0.02, 0.04, 0.06], "center_m": CENTER, "orientation": [0.8, 0.0, 0.6, 0.0]
            }),
        ]
        .iter()
        .map(|description| Solid::of_scene(description).expect("known"))
        .collect()
    }

    #[test]
    fn verif_curves_of_a_solid_lie_on_its_surface() {
        for solid in solids() {
            let curves = solid.curves_m();
            assert!(curves.len() >= 12, "{solid:?}");
            for point in curves.iter().flatten() {
                assert!(solid.distance_m(*point) < 1e-12, "{solid:?} at {point}");
            }
        }
        assert!(Solid::of_scene(&json!({"shape": "mesh", "file": "solid.stl"})).is_none());
    }

    #[test]
    fn verif_edges_and_corners_of_a_box_are_those_of_its_curves() {
        let solids = solids();
        let block = solids.last().expect("a box");
        for edge in block.curves_m() {
            let (from_edge, from_corner) = block.features_m(edge[0]).expect("a box");
            assert!(from_edge < 1e-12 && from_corner < 1e-12);
            let middle = 0.5 * (edge[0] + edge[1]);
            let (from_edge, from_corner) = block.features_m(middle).expect("a box");
            assert!(from_edge < 1e-12 && (from_corner - 0.5 * (edge[1] - edge[0]).norm()).abs() < 1e-12);
            let outwards = (middle - Vector3::from(CENTER)).normalize();
            let (from_edge, _) = block.features_m(middle + 1e-3 * outwards).expect("a box");
            assert!((from_edge - 1e-3).abs() < 1e-12);
        }
        assert!(solids[0].features_m(Vector3::zeros()).is_none());
    }

    #[test]
    fn verif_distances_inside_and_outside_are_the_closed_forms() {
        let center = Vector3::from(CENTER);
        // Distance of the centre from the surface. That of a cone is half its radius, seen along the slope.
        let expected = [5e-4, 0.02, 0.01, 0.01 * 0.05 / 0.05_f64.hypot(0.02), 0.03 - 0.005, 0.01];
        for (solid, expected) in solids().iter().zip(expected) {
            let found = solid.distance_m(center);
            assert!((found - expected).abs() < 1e-12, "{solid:?}: {found} instead of {expected}");
            // Far away the distance is that of the centre, up to the size of the solid.
            let far = solid.distance_m(center + Vector3::new(10.0, 0.0, 0.0));
            assert!((far - 10.0).abs() < 0.06, "{solid:?}: {far}");
        }
    }
}
