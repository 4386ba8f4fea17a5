//! Drawn shapes, independent of the program that shows them, and their form as ROS 2 markers.

use bag::messages::{Color, Duration, Header, Marker, MarkerArray, Point, Pose, Quaternion, Time, Vector3, marker};
use nalgebra::{Matrix2, Matrix3, Rotation3, UnitQuaternion};
use testbed::contour::Contour;
use testbed::statistics::{CHI2_2_95, CHI2_3_95, NORMAL_95};

/// Probability of the drawn ellipses and bands.
pub const COVERAGE: f64 = 0.95;

/// Colours of a whisker, and of the ellipse or ellipsoid of its contact.
pub(crate) const WHISKER_COLOR: [f32; 4] = [0.85, 0.85, 0.85, 1.0];
pub(crate) const CONTACT_COLOR: [f32; 4] = [1.0, 0.3, 0.1, 0.5];

/// Number of sections of a drawn whisker.
pub(crate) const SECTIONS: u32 = 24;

/// Width of drawn lines and smallest diameter of an ellipse (m).
const LINE_M: f64 = 6e-4;
const LEAST_M: f64 = 2e-4;

/// Form of a drawn shape, in the fixed frame.
#[derive(Clone, Debug, PartialEq)]
pub enum Form {
    /// Line through points, and its width (m).
    Line(Vec<Point>, f64),
    /// Ellipsoid with these diameters (m).
    Ellipsoid(Pose, [f64; 3]),
    /// Triangles, three points each.
    Triangles(Vec<Point>),
}

impl Form {
    /// Line through points.
    pub(crate) fn line(points: impl IntoIterator<Item = nalgebra::Vector3<f64>>) -> Self {
        Self::Line(points.into_iter().map(point).collect(), LINE_M)
    }

    /// Ellipsoid that contains a point of this covariance (m2) with probability [`COVERAGE`]. `None` if it is not finite.
    pub(crate) fn ellipsoid(at: nalgebra::Vector3<f64>, covariance_m2: &Matrix3<f64>) -> Option<Self> {
        if !at.iter().chain(covariance_m2).all(|value| value.is_finite()) {
            return None;
        }
        let eigen = covariance_m2.symmetric_eigen();
        let diameters = eigen.eigenvalues.map(|variance_m2| diameter_m(CHI2_3_95, variance_m2));
        // The sign of an eigenvector is arbitrary; a rotation requires right-handed axes.
        let axes = eigen.eigenvectors * eigen.eigenvectors.determinant().signum();
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        let pose = Pose { position: point(at), orientation: quaternion(&rotation) };
        Some(Self::Ellipsoid(pose, diameters.into()))
    }
}

/// Diameter of an ellipse along an axis of this variance, for a quantile of the squared distance.
fn diameter_m(quantile: f64, variance_m2: f64) -> f64 {
    (2.0 * (quantile * variance_m2.max(0.0)).sqrt()).max(LEAST_M)
}

pub(crate) fn point(at: nalgebra::Vector3<f64>) -> Point {
    Point { x: at.x, y: at.y, z: at.z }
}

pub(crate) fn quaternion(of: &UnitQuaternion<f64>) -> Quaternion {
    Quaternion { x: of.i, y: of.j, z: of.k, w: of.w }
}

/// A drawn shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// Name; a later shape of the same name replaces it.
    pub name: String,
    /// Number, if several have the name.
    pub number: i32,
    /// Red, green, blue and opacity, from 0 to 1.
    pub color: [f32; 4],
    /// Form.
    pub form: Form,
}

/// Shapes of one instant.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing {
    /// Frame of the shapes.
    pub frame: String,
    /// Time (ns).
    pub time_ns: u64,
    /// Time until they disappear (s).
    pub lifetime_s: f64,
    /// The shapes.
    pub shapes: Vec<Shape>,
}

impl Drawing {
    /// The shapes as ROS 2 markers.
    pub fn markers(&self) -> MarkerArray {
        let header = Header { stamp: Time::from_nanoseconds(self.time_ns), frame_id: self.frame.clone() };
        let lifetime_ns = (1e9 * self.lifetime_s) as i64;
        let lifetime = Duration {
            sec: i32::try_from(lifetime_ns / 1_000_000_000).unwrap_or(i32::MAX),
            nanosec: (lifetime_ns % 1_000_000_000) as u32,
        };
        let marker = |shape: &Shape| {
            let [r, g, b, a] = shape.color;
            let rest = Pose { orientation: Quaternion::about_z(0.0), ..Pose::default() };
            let unit = Vector3 { x: 1.0, y: 1.0, z: 1.0 };
            let (r#type, pose, scale, points) = match &shape.form {
                Form::Line(points, width_m) => {
                    (marker::LINE_STRIP, rest, Vector3 { x: *width_m, ..Vector3::default() }, points.clone())
                }
                Form::Ellipsoid(pose, [x, y, z]) => {
                    (marker::SPHERE, pose.clone(), Vector3 { x: *x, y: *y, z: *z }, Vec::new())
                }
                Form::Triangles(points) => (marker::TRIANGLE_LIST, rest, unit, points.clone()),
            };
            Marker {
                header: header.clone(),
                ns: shape.name.clone(),
                id: shape.number,
                r#type,
                action: marker::ADD,
                pose,
                scale,
                color: Color { r, g, b, a },
                lifetime: lifetime.clone(),
                points,
                ..Marker::default()
            }
        };
        MarkerArray { markers: self.shapes.iter().map(marker).collect() }
    }
}

/// Place of the plane of a whisker in the fixed frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PlacedPlane {
    pub(crate) rotation: UnitQuaternion<f64>,
    pub(crate) height_m: f64,
}

impl PlacedPlane {
    /// A point of the plane.
    pub(crate) fn point(&self, x_m: f64, y_m: f64) -> Point {
        point(self.rotation * nalgebra::Vector3::new(x_m, y_m, self.height_m))
    }

    /// Orientation of axes that are turned in the plane.
    pub(crate) fn orientation(&self, yaw_rad: f64) -> Quaternion {
        let turned = self.rotation * UnitQuaternion::from_axis_angle(&nalgebra::Vector3::z_axis(), yaw_rad);
        quaternion(&turned)
    }

    /// Ellipse that contains a point of this covariance with probability [`COVERAGE`].
    pub(crate) fn ellipse(&self, at: (f64, f64), covariance_m2: &Matrix2<f64>) -> Option<Form> {
        if !covariance_m2.iter().all(|value| value.is_finite()) {
            return None;
        }
        let eigen = covariance_m2.symmetric_eigen();
        let along = eigen.eigenvectors.column(0);
        let [x, y] = [eigen.eigenvalues[0], eigen.eigenvalues[1]].map(|variance_m2| diameter_m(CHI2_2_95, variance_m2));
        let pose = Pose { position: self.point(at.0, at.1), orientation: self.orientation(along.y.atan2(along.x)) };
        Some(Form::Ellipsoid(pose, [x, y, LINE_M]))
    }

    /// Line through points of the plane.
    pub(crate) fn line(&self, points: impl IntoIterator<Item = (f64, f64)>) -> Form {
        Form::Line(points.into_iter().map(|(x_m, y_m)| self.point(x_m, y_m)).collect(), LINE_M)
    }

    /// An outline, and its band of probability [`COVERAGE`] as far as the covariance is known.
    pub(crate) fn outline(&self, name: &str, number: i32, contour: &Contour, color: [f32; 3]) -> Vec<Shape> {
        let [r, g, b] = color;
        let line = self.line(contour.vertices.iter().map(|vertex| (vertex.at.x(), vertex.at.y())));
        let edge = |side: f64| {
            contour.vertices.iter().map(move |vertex| {
                let (sin, cos) = vertex.normal_rad.sin_cos();
                let way_m = side * NORMAL_95 * vertex.sd_m()?;
                Some((vertex.at.x() + way_m * cos, vertex.at.y() + way_m * sin))
            })
        };
        let edges: Option<Vec<_>> = edge(-1.0).zip(edge(1.0)).map(|(inner, outer)| inner.zip(outer)).collect();
        let mut band = Vec::new();
        for pair in edges.iter().flat_map(|edges| edges.windows(2)) {
            let [(a, b), (c, d)] = [pair[0], pair[1]];
            band.extend([a, b, c, c, b, d].map(|(x_m, y_m)| self.point(x_m, y_m)));
        }
        let shape = |name: String, color, form| Shape { name, number, color, form };
        let mut shapes = vec![shape(format!("{name}/outline"), [r, g, b, 1.0], line)];
        if !band.is_empty() {
            shapes.push(shape(format!("{name}/band"), [r, g, b, 0.3], Form::Triangles(band)));
        }
        shapes
    }
}
