//! The true object of a trace in space, as far as few parameters describe it where it is touched.

use nalgebra::{Matrix3, Vector3};
use trace::{Feature, SpatialContactTruth, SpatialTrace};

use super::solid::{Axial, Solid};

/// Smallest extent of the touched points along an edge (m).
const EXTENT_M: f64 = 1e-3;

/// Largest root mean square distance of the touched points from the line of an edge (m). Simulated contacts lie within about 10 um
/// of the object.
const OFF_LINE_M: f64 = 3e-5;

/// Smallest radius of rod and wire together.
const LEAST_RADIUS_M: f64 = 1e-5;

/// Largest deviation of touched points from the round side of a solid.
const ON_SIDE_M: f64 = 1e-5;

/// The part of an object that is touched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TrueObject {
    /// Rod, cylinder or edge.
    Rod(TrueRod),
    /// Sphere.
    Sphere {
        /// Radius of sphere and wire together (m).
        radius_m: f64,
    },
}

impl TrueObject {
    /// The object of a trace: that of its scene if this is a sphere, or a pin or cylinder that is touched on its side alone; for
    /// boxes and meshes, the edge on which the touched points lie. `None` if they do not lie on one, and for other solids.
    pub fn of(trace: &SpatialTrace, solid: Option<&Solid>) -> Option<Self> {
        let contacts = contacts(trace);
        match solid {
            Some(Solid::Sphere { center_m, .. }) => {
                let center = Vector3::from(*center_m);
                let radius_m = mean(&contacts, |contact| (contact.contact - center).norm())?;
                Some(Self::Sphere { radius_m })
            }
            Some(Solid::Pin { radius_m, place, .. } | Solid::Cylinder { radius_m, place, .. }) => {
                TrueRod::round(&contacts, place, *radius_m).map(Self::Rod)
            }
            Some(Solid::Cone { .. } | Solid::Torus { .. }) => None,
            // Boxes, and meshes, which are not known here.
            Some(Solid::Box { .. }) | None => TrueRod::edge(&contacts).map(Self::Rod),
        }
    }

    /// Radius of object and wire together (m).
    pub fn radius_m(&self) -> f64 {
        match self {
            Self::Rod(rod) => rod.radius_m,
            Self::Sphere { radius_m } => *radius_m,
        }
    }

    /// The rod or edge. `None` for a sphere.
    pub fn rod(&self) -> Option<&TrueRod> {
        match self {
            Self::Rod(rod) => Some(rod),
            Self::Sphere { .. } => None,
        }
    }
}

/// All contacts of a trace of which more than the place is known.
fn contacts(trace: &SpatialTrace) -> Vec<&SpatialContactTruth> {
    trace.truth.instants.iter().filter_map(|truth| truth.contact.as_ref()).collect()
}

/// Mean of a quantity over contacts. `None` without any.
fn mean(contacts: &[&SpatialContactTruth], of: impl Fn(&SpatialContactTruth) -> f64) -> Option<f64> {
    crate::statistics::mean(contacts.iter().map(|contact| of(contact)))
}

/// A rod or edge in World.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrueRod {
    /// A point of the axis.
    pub axis: Vector3<f64>,
    /// Unit vector along the axis.
    pub along: Vector3<f64>,
    /// Radius of rod and wire together.
    pub radius_m: f64,
}

impl TrueRod {
    /// The rod of a solid of revolution with a straight side. `None` if it is also touched elsewhere.
    fn round(contacts: &[&SpatialContactTruth], place: &Axial, radius_m: f64) -> Option<Self> {
        let (axis, along) = (Vector3::from(place.center_m), Vector3::from(place.axis).normalize());
        let from_axis_m = |point: Vector3<f64>| along.cross(&(point - axis)).norm();
        // The rim of a flat end is as far from the axis as the side is.
        let is_on_side = |contact: &&SpatialContactTruth| {
            contact.feature == Feature::Face && (from_axis_m(contact.surface) - radius_m).abs() < ON_SIDE_M
        };
        let with_wire_m = mean(contacts, |contact| from_axis_m(contact.contact))?;
        contacts.iter().all(is_on_side).then_some(Self { axis, along, radius_m: with_wire_m })
    }

    /// The edge of some contacts. `None` if not all of them are on edges, or if the touched points do not lie on a straight line of
    /// more than a millimetre.
    fn edge(contacts: &[&SpatialContactTruth]) -> Option<Self> {
        if contacts.iter().any(|contact| contact.feature != Feature::Edge) {
            return None;
        }
        let surface: Vec<_> = contacts.iter().map(|contact| contact.surface).collect();
        let along = direction(&surface)?;
        // The centres `p - rho n` lie on the axis: deviations of contacts and normals across it are proportional.
        let mean = |of: fn(&SpatialContactTruth) -> Vector3<f64>| {
            contacts.iter().map(|contact| of(contact)).sum::<Vector3<f64>>() / contacts.len() as f64
        };
        let (contact, normal) = (mean(|contact| contact.contact), mean(|contact| contact.normal));
        let across = Matrix3::identity() - along * along.transpose();
        let (mut product, mut square) = (0.0, 0.0);
        for here in contacts {
            let turned = across * (here.normal - normal);
            product += turned.dot(&(here.contact - contact));
            square += turned.norm_squared();
        }
        let radius_m = if square > 0.0 { (product / square).max(LEAST_RADIUS_M) } else { LEAST_RADIUS_M };
        Some(Self { axis: contact - normal * radius_m, along, radius_m })
    }
}

/// Direction of points on a straight line. `None` if they do not lie on one.
fn direction(points: &[Vector3<f64>]) -> Option<Vector3<f64>> {
    if points.is_empty() {
        return None;
    }
    let count = points.len() as f64;
    let mean = points.iter().sum::<Vector3<f64>>() / count;
    let spread: Matrix3<f64> = points.iter().map(|point| (point - mean) * (point - mean).transpose()).sum();
    let parts = (spread / count).try_symmetric_eigen(f64::EPSILON, 0)?;
    let longest = parts.eigenvalues.imax();
    let along = parts.eigenvectors.column(longest).into_owned();
    let rest = (parts.eigenvalues.sum() - parts.eigenvalues[longest]).max(0.0);
    let places = points.iter().map(|point| along.dot(&(point - mean)));
    let (low, high) = places.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)));
    (high - low > EXTENT_M && rest.sqrt() < OFF_LINE_M).then_some(along)
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIRE_M: f64 = 1e-4;

    fn contact(surface: Vector3<f64>, normal: Vector3<f64>, feature: Feature) -> SpatialContactTruth {
        SpatialContactTruth {
            tip: false,
            split: false,
            feature,
            contact: surface + normal * WIRE_M,
            surface,
            normal,
            arc_m: 0.05,
            force: normal,
            tangent: Vector3::x(),
        }
    }

    #[test]
    fn verif_a_cylinder_is_a_rod_where_its_side_is_touched() {
        const RADIUS_M: f64 = 0.01;
        let place = Axial { center_m: [0.0, 0.0, 0.02], axis: [0.0, 0.0, 2.0] };
        let on_side = |angle: f64| {
            let normal = Vector3::new(angle.cos(), angle.sin(), 0.0);
            contact(normal * RADIUS_M + Vector3::z() * (0.03 + 0.01 * angle), normal, Feature::Face)
        };
        let side = [on_side(0.1), on_side(0.4)];
        let rod = TrueRod::round(&side.each_ref(), &place, RADIUS_M).expect("a rod");
        assert!((rod.radius_m - RADIUS_M - WIRE_M).abs() < 1e-15 && rod.along == Vector3::z());
        let on_rim = contact(Vector3::new(RADIUS_M, 0.0, 0.07), Vector3::new(0.6, 0.0, 0.8), Feature::Edge);
        let on_end = contact(Vector3::new(0.5 * RADIUS_M, 0.0, 0.07), Vector3::z(), Feature::Face);
        for elsewhere in [on_rim, on_end] {
            assert_eq!(TrueRod::round(&[&side[0], &elsewhere], &place, RADIUS_M), None);
        }
        assert_eq!(TrueRod::round(&[], &place, RADIUS_M), None);
    }

    #[test]
    fn verif_an_edge_is_a_rod_where_the_touched_points_lie_on_a_line() {
        let along = Vector3::new(0.6, 0.0, 0.8);
        let at = |way_m: f64, angle: f64| {
            let normal = Vector3::y() * angle.cos() + along.cross(&Vector3::y()) * angle.sin();
            contact(along * way_m, normal, Feature::Edge)
        };
        let line: Vec<_> = (0..20).map(|i| at(1e-4 * f64::from(i), 0.02 * f64::from(i))).collect();
        let rod = TrueRod::edge(&line.iter().collect::<Vec<_>>()).expect("an edge");
        assert!((rod.along.dot(&along).abs() - 1.0).abs() < 1e-12 && (rod.radius_m - WIRE_M).abs() < 1e-9, "{rod:?}");
        assert_eq!(TrueRod::edge(&line[..5].iter().collect::<Vec<_>>()), None);
        // A second edge, 6 degrees from the first, and a face.
        let bent = |way_m: f64| contact(along * way_m + Vector3::y() * 0.1 * way_m, Vector3::x(), Feature::Edge);
        let two: Vec<_> = line.iter().copied().chain((0..20).map(|i| bent(1e-4 * f64::from(i)))).collect();
        assert_eq!(TrueRod::edge(&two.iter().collect::<Vec<_>>()), None);
        let face: Vec<_> = line.iter().map(|at| SpatialContactTruth { feature: Feature::Face, ..*at }).collect();
        assert_eq!(TrueRod::edge(&face.iter().collect::<Vec<_>>()), None);
    }
}
