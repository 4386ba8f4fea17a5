//! The true rod or edge of a trace in space, from the contacts of its truth.

use nalgebra::{Matrix3, Vector3};
use trace::{SpatialContactTruth, SpatialTrace};

/// Smallest extent of the touched points of a rod or edge, and largest deviation from a line relative to it.
const EXTENT_M: f64 = 1e-3;
const STRAIGHT: f64 = 0.05;

/// Smallest radius of rod and wire together.
const LEAST_RADIUS_M: f64 = 1e-5;

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
    /// The rod of a trace's contacts. `None` if the touched points do not lie on a straight line of more than a millimetre.
    pub fn of(trace: &SpatialTrace) -> Option<Self> {
        let contacts: Vec<&SpatialContactTruth> =
            trace.truth.instants.iter().filter_map(|truth| truth.contact.as_ref()).collect();
        let surface: Vec<_> = contacts.iter().map(|contact| contact.surface).collect();
        let along = direction(&surface)?;
        // The centres `p - rho n` lie on the axis: deviations of contacts and normals across it are proportional.
        let mean = |of: fn(&SpatialContactTruth) -> Vector3<f64>| {
            contacts.iter().map(|contact| of(contact)).sum::<Vector3<f64>>() / contacts.len() as f64
        };
        let (contact, normal) = (mean(|contact| contact.contact), mean(|contact| contact.normal));
        let across = Matrix3::identity() - along * along.transpose();
        let (mut product, mut square) = (0.0, 0.0);
        for here in &contacts {
            let turned = across * (here.normal - normal);
            product += turned.dot(&(here.contact - contact));
            square += turned.norm_squared();
        }
        let radius_m = if square > 0.0 { (product / square).max(LEAST_RADIUS_M) } else { LEAST_RADIUS_M };
        Some(Self { axis: contact - normal * radius_m, along, radius_m })
    }

    /// Unit vectors that complete the direction to orthogonal axes.
    pub fn across(&self) -> [Vector3<f64>; 2] {
        let one = self.along.cross(&Vector3::ith(self.along.iamin(), 1.0)).normalize();
        [one, self.along.cross(&one)]
    }
}

/// Direction of points on a straight line. `None` if they do not lie on one.
fn direction(points: &[Vector3<f64>]) -> Option<Vector3<f64>> {
    let count = points.len() as f64;
    let mean = points.iter().sum::<Vector3<f64>>() / count;
    let spread: Matrix3<f64> = points.iter().map(|point| (point - mean) * (point - mean).transpose()).sum();
    let parts = (spread / count).try_symmetric_eigen(f64::EPSILON, 0)?;
    let longest = parts.eigenvalues.imax();
    let along = parts.eigenvectors.column(longest).into_owned();
    let rest = (parts.eigenvalues.sum() - parts.eigenvalues[longest]).max(0.0);
    let places = points.iter().map(|point| along.dot(&(point - mean)));
    let (low, high) = places.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)));
    (high - low > EXTENT_M && rest.sqrt() < STRAIGHT * parts.eigenvalues[longest].sqrt()).then_some(along)
}
