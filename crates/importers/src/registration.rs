//! Registration of a wire on a rig from a calibration: pose of the base, shape and stiffness.
//!
//! A rig measures the position of its pin in its own frame. The root, about which the wire rotates, lies inside the
//! suspension; neither its position nor the wire's shape and stiffness are documented. They are estimated jointly with
//! the sensor's characteristic, as the parameters of the elastica that fit the readings best: the moment `M` at the
//! root of a whisker deflected by the pin, and `counts = c0 + c1 M + c2 M^2 + c3 M^3`, a [`Characteristic`] with an
//! offset.
//!
//! The scale of the forces is unobservable, since no force was measured. The root stiffness keeps its nominal value, so
//! that all moments are nominal, with a common unknown factor.

use filters::least_squares::{Damping, Evaluated, Method, Residuals, Settings, forward_jacobian, minimise};
use nalgebra::{DMatrix, DVector, Matrix4, Vector4};
use trace::Characteristic;
use whisker::elastica::Elastica;
use whisker::frames::{Base, Point, Pose, World};
use whisker::{Curvature, Whisker};

/// Wire on a rig. World is the rig's frame.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Mounted {
    /// The wire: a straight piece from the root, followed by an arc.
    pub whisker: Whisker,
    /// Pose of the wire's base.
    pub base: Pose<Base, World>,
}

/// Reading with the pin pressed against the wire.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pressed {
    /// Position of the pin.
    pub pin: Point<World>,
    /// Counts relative to rest.
    pub counts: f64,
}

/// Maximum-a-posteriori registration of a calibration.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Registration {
    /// Wire and its pose.
    pub mounted: Mounted,
    /// Characteristic of the sensor.
    pub characteristic: Characteristic,
    /// Moment of largest magnitude in the calibration, signed.
    pub largest_n_m: f64,
    /// RMS residual in counts.
    pub residual_counts: f64,
}

/// Parameters as deviations from the drawing, in units of their prior standard deviation: x, y, yaw, straight length,
/// curvature, and logarithm of the ratio of bending stiffness to root stiffness.
type Unknowns = DVector<f64>;

/// Prior standard deviations of the parameters about the drawing: m, m, rad, m, 1/m, 1.
const SCATTER: [f64; 6] = [0.01, 0.01, 0.3, 0.01, 10.0, 1.0];

/// Standard deviation of the readings about the elastica, relative to the largest reading. It covers friction, which
/// the elastica neglects.
const READING_SCATTER: f64 = 0.01;

/// Standard deviation of the offset `c0`, relative to the largest reading: the drift of the rest reading within a
/// recording. With a larger value, friction would be attributed to an offset that other recordings do not have.
const REST_SCATTER: f64 = 0.005;

/// Levenberg-Marquardt method, until the cost decreases by less than a millionth.
const SETTINGS: Settings = Settings {
    method: Method::LevenbergMarquardt(Damping { decrease: 0.2, increase: 5.0, ..Damping::MARQUARDT }),
    iterations: 60,
    absolute: 0.0,
    relative: 1e-6,
    step: 0.0,
};

/// Shortest straight piece.
const SHORTEST_M: f64 = 1e-4;

/// Factor on the wire's length during the search; the part beyond a contact carries no load.
const SPARE: f64 = 1.6;

/// Smallest ratio of the wire's length to the arc length of its outermost contact.
const BEYOND_CONTACT: f64 = 1.02;

/// Estimates the wire near its `drawing` that fits a calibration best: nonlinear least squares with the drawing as
/// prior, solved by the Levenberg-Marquardt method. `None` if the pins do not determine the wire.
pub(crate) fn register(drawing: &Mounted, pressed: &[Pressed]) -> Option<Registration> {
    let largest_counts = largest(pressed);
    let problem = Problem {
        drawing,
        pressed,
        scatter_counts: READING_SCATTER * largest_counts,
        rest_scatter_counts: REST_SCATTER * largest_counts,
    };
    let start = Evaluated::new(&problem, DVector::zeros(SCATTER.len()))?;
    let at = minimise(&problem, start, &SETTINGS)?.state.x;
    let state = problem.evaluate(&at)?;
    let residuals = state.residuals.rows(0, pressed.len()) * problem.scatter_counts;
    let largest_n_m = state.largest_n_m;
    let coefficients = [1, 2, 3].map(|power| state.counts[power]).to_vec();
    Some(Registration {
        mounted: problem.trimmed(&problem.mounted(&at)),
        characteristic: Characteristic::new(coefficients, [largest_n_m.min(0.0), largest_n_m.max(0.0)])?,
        largest_n_m,
        residual_counts: (residuals.norm_squared() / pressed.len() as f64).sqrt(),
    })
}

fn largest(pressed: &[Pressed]) -> f64 {
    pressed.iter().map(|sample| sample.counts.abs()).fold(0.0, f64::max)
}

struct Problem<'a> {
    drawing: &'a Mounted,
    pressed: &'a [Pressed],
    scatter_counts: f64,
    rest_scatter_counts: f64,
}

/// Residuals in units of their standard deviation (readings, offset, prior) and the polynomial from moment to counts.
struct State {
    residuals: DVector<f64>,
    counts: Vector4<f64>,
    /// Moment of largest magnitude, signed.
    largest_n_m: f64,
}

impl Problem<'_> {
    /// Wire with these parameters, long enough for every pin. The arc is split into two pieces, because the rotation of
    /// a piece is limited.
    fn mounted(&self, unknowns: &Unknowns) -> Mounted {
        let [x, y, yaw, straight, curvature, stiffness]: [f64; 6] = std::array::from_fn(|i| unknowns[i] * SCATTER[i]);
        let Mounted { whisker, base } = self.drawing;
        let length_m = SPARE * whisker.length_m;
        let straight_m = (whisker.curvature[0].length_m + straight).clamp(SHORTEST_M, length_m - SHORTEST_M);
        let curvature_per_m = whisker.curvature[1].curvature_per_m + curvature;
        let straight = Curvature { length_m: straight_m, curvature_per_m: 0.0 };
        let half_arc = Curvature { length_m: 0.5 * (length_m - straight_m), curvature_per_m };
        Mounted {
            whisker: Whisker {
                length_m,
                youngs_modulus_pa: whisker.youngs_modulus_pa * stiffness.exp(),
                curvature: vec![straight, half_arc, half_arc],
                ..whisker.clone()
            },
            base: Pose::new(base.origin().x() + x, base.origin().y() + y, base.yaw_rad() + yaw),
        }
    }

    /// Wire whose length covers all contacts, at least the length of the drawing.
    fn trimmed(&self, mounted: &Mounted) -> Mounted {
        let outermost_m = Elastica::new(&mounted.whisker).map_or(0.0, |elastica| {
            let base = mounted.base.inverse();
            let contacts = self.pressed.iter().filter_map(|s| elastica.at_point(base.apply(s.pin)).ok());
            contacts.map(|contact| contact.load.arc_m).fold(0.0, f64::max)
        });
        let [straight, arc] = [&mounted.whisker.curvature[0], &mounted.whisker.curvature[1]];
        let length_m = (BEYOND_CONTACT * outermost_m).max(self.drawing.whisker.length_m);
        let straight_m = straight.length_m.min(length_m - SHORTEST_M);
        let curvature = pieces(straight_m, length_m, arc.curvature_per_m);
        Mounted { whisker: Whisker { length_m, curvature, ..mounted.whisker.clone() }, base: mounted.base }
    }

    fn evaluate(&self, unknowns: &Unknowns) -> Option<State> {
        let Mounted { whisker, base } = self.mounted(unknowns);
        let elastica = Elastica::new(&whisker).ok()?;
        let base = base.inverse();
        // A pin out of reach does not deflect the wire. Moments in units of the root stiffness keep the polynomial well
        // conditioned.
        let unit_n_m = whisker.root_stiffness_n_m_rad;
        let moment = |sample: &Pressed| {
            elastica.at_point(base.apply(sample.pin)).map_or(0.0, |contact| contact.deflection.moment_n_m / unit_n_m)
        };
        let rows: Vec<Vector4<f64>> =
            self.pressed.iter().map(moment).map(|m| Vector4::new(1.0, m, m * m, m * m * m)).collect();
        let mut normal: Matrix4<f64> = rows.iter().map(|row| row * row.transpose()).sum();
        normal[(0, 0)] += (self.scatter_counts / self.rest_scatter_counts).powi(2);
        let right: Vector4<f64> = rows.iter().zip(self.pressed).map(|(row, sample)| row * sample.counts).sum();
        let counts = normal.cholesky()?.solve(&right);
        let own = rows.iter().zip(self.pressed).map(|(row, s)| (row.dot(&counts) - s.counts) / self.scatter_counts);
        let rest = std::iter::once(counts[0] / self.rest_scatter_counts);
        let all = own.chain(rest).chain(unknowns.iter().copied());
        let residuals = DVector::from_iterator(rows.len() + 1 + unknowns.len(), all);
        let counts = Vector4::from_fn(|power, _| counts[power] / unit_n_m.powi(power as i32));
        let largest = rows.iter().map(|row| row[1]).max_by(|a, b| a.abs().total_cmp(&b.abs()))?;
        let all_finite = residuals.iter().all(|residual| residual.is_finite());
        all_finite.then_some(State { residuals, counts, largest_n_m: largest * unit_n_m })
    }
}

impl Residuals for Problem<'_> {
    fn residuals(&self, unknowns: &Unknowns) -> Option<DVector<f64>> {
        self.evaluate(unknowns).map(|state| state.residuals)
    }

    /// Jacobian along the unknowns, with the polynomial fitted anew at each.
    fn jacobian(&self, at: &Evaluated) -> Option<DMatrix<f64>> {
        forward_jacobian(self, at, 1e-5)
    }
}

/// Straight piece from the root, followed by an arc.
pub(crate) fn pieces(straight_m: f64, length_m: f64, curvature_per_m: f64) -> Vec<Curvature> {
    vec![
        Curvature { length_m: straight_m, curvature_per_m: 0.0 },
        Curvature { length_m: length_m - straight_m, curvature_per_m },
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawing() -> Mounted {
        let whisker =
            Whisker { curvature: pieces(0.02, 0.05, -50.0), damping_s: 0.0, ..Whisker::stanford() }.named("drawn");
        Mounted { whisker, base: Pose::new(0.0, 0.005, -1.8) }
    }

    /// Wire that differs from its drawing in all parameters.
    fn true_wire() -> Mounted {
        let mut wire = drawing();
        wire.whisker.curvature = pieces(0.012, 0.05, -44.0);
        wire.whisker.youngs_modulus_pa = 48e9;
        wire.base = Pose::new(0.003, 0.001, -1.65);
        wire
    }

    fn pressed_by(wire: &Mounted, counts: impl Fn(f64) -> f64) -> Vec<Pressed> {
        let elastica = Elastica::new(&wire.whisker).unwrap();
        let rest = wire.whisker.rest_shape();
        let places = (0..9).flat_map(|i| (1..8).map(move |j| (0.012 + 0.004 * f64::from(i), 0.001 * f64::from(j))));
        places
            .filter_map(|(arc_m, away_m)| {
                let point = rest.beside(arc_m, -away_m);
                let moment_n_m = elastica.at_point(point).ok()?.deflection.moment_n_m;
                Some(Pressed { pin: wire.base.apply(point), counts: counts(moment_n_m) })
            })
            .collect()
    }

    #[test]
    fn verif_recovers_the_wire_of_a_simulated_calibration() {
        let wire = true_wire();
        let characteristic = |moment: f64| -2e7 * moment - 1e15 * moment.powi(3);
        let pressed = pressed_by(&wire, characteristic);
        let found = register(&drawing(), &pressed).unwrap();
        let error_m = found.mounted.base.origin().distance(&wire.base.origin());
        assert!(error_m < 1e-3, "root {error_m} m off");
        assert!((found.mounted.base.yaw_rad() - wire.base.yaw_rad()).abs() < 0.05);
        for moment_n_m in [-1e-5, -3e-5, -6e-5] {
            let recovered = found.characteristic.moment_n_m(characteristic(moment_n_m));
            assert!((recovered / moment_n_m - 1.0).abs() < 0.1, "{moment_n_m} N m: {recovered}");
        }
        assert!(found.residual_counts < 0.002 * largest(&pressed), "{}", found.residual_counts);
    }

    #[test]
    fn robust_degenerate_pins_have_no_registration() {
        let pin = Pressed { pin: Point::new(0.0, 0.0), counts: 100.0 };
        assert_eq!(register(&drawing(), &[pin; 3]), None);
    }
}
