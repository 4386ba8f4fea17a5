//! Live estimation of a whisker in the plane.

use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

use bag::messages::PoseWithCovariance;
use live::counts::Counts;
use live::{Answer, Planar};
use nalgebra::Vector3;
use testbed::contour::Contour;
use testbed::map::Observer;
use trace::Instant;
use whisker::elastica::Elastica;
use whisker::estimators::{Estimate, Knowledge};
use whisker::frames::{Base, Point};

use crate::chain::{OnPlane, Plane};
use crate::drawing::{CONTACT_COLOR, PlacedPlane, SECTIONS, Shape, WHISKER_COLOR};
use crate::map::Observed;
use crate::whisker::{Diagnosis, EstimatorOf, Geometry};

/// Largest number of kept touched points, beyond which the oldest touches are dropped.
const MOST_POINTS: usize = 50_000;

/// Red, green and blue of the outline.
const OUTLINE_COLOR: [f32; 3] = [1.0, 0.7, 0.0];

/// Planar readings, contacts, shapes and observations.
pub(crate) struct PlanarGeometry {
    plane: Plane,
    knowledge: Arc<Knowledge>,
    observer: Observer,
    elastica: Elastica,
}

impl PlanarGeometry {
    pub(crate) fn new(plane: Plane, knowledge: Arc<Knowledge>, observer: Observer) -> anyhow::Result<Self> {
        let elastica = Elastica::new(&knowledge.whisker)?;
        Ok(Self { plane, knowledge, observer, elastica })
    }

    fn placed(&self, projection: &OnPlane) -> PlacedPlane {
        PlacedPlane { rotation: self.plane.rotation, height_m: projection.height_m().unwrap_or(0.0) }
    }

    /// Points of the whisker from the root to the tip: bent to its contact, or at rest.
    fn wire(&self, answer: &Answer) -> Vec<Point<Base>> {
        let length_m = self.knowledge.rest.length_m();
        let arcs = (0..=SECTIONS).map(|step| length_m * f64::from(step) / f64::from(SECTIONS));
        let contact = answer.estimate.map(|estimate| estimate.contact);
        let load = contact.and_then(|contact| self.elastica.at_point(contact).ok()).map(|found| found.load);
        match load.and_then(|load| self.elastica.line(load).ok()) {
            Some(line) => arcs.map(|arc_m| line.at(arc_m).0).collect(),
            None => arcs.map(|arc_m| self.knowledge.rest.point(arc_m)).collect(),
        }
    }
}

impl Geometry for PlanarGeometry {
    type Kind = Planar;
    type Counts = Counts;
    type Projection = OnPlane;

    fn reading(moment_n_m: &Vector3<f64>) -> f64 {
        moment_n_m.z
    }

    fn diagnosis(estimate: &Estimate) -> Diagnosis {
        Diagnosis {
            is_doubtful: estimate.model_doubtful,
            nis: estimate.innovation.map(|innovation| innovation.nis),
            deviation: estimate.installation,
        }
    }

    fn observe(&mut self, answer: &Answer) {
        let Answer { t_s, base: Some(base), reading_n_m, .. } = *answer else { return };
        let known = Instant { t_s, base, twist: None, moment_z_n_m: reading_n_m, rotation_z_rad: None };
        self.observer.observe(&self.knowledge, &known, reading_n_m, answer.estimate.as_ref());
        self.observer.view_mut().limit(MOST_POINTS);
    }

    fn observed(&self, projection: &OnPlane) -> Observed {
        Observed::InPlane { view: self.observer.view().clone(), height_m: projection.height_m() }
    }

    fn contact(&self, answer: &Answer, projection: &OnPlane) -> Option<PoseWithCovariance> {
        let (base, estimate) = (answer.base?, answer.estimate?);
        let at = base.apply(estimate.contact);
        let tangent_rad = self.knowledge.tangent_rad(&estimate, answer.reading_n_m) + base.yaw_rad();
        let normal_rad = tangent_rad + estimate.face.away_sign() * FRAC_PI_2;
        let placed = self.placed(projection);
        let mut covariance = [[0.0; 6]; 6];
        match estimate.covariance_m2.map(|covariance_m2| base.turn(covariance_m2)) {
            Some(in_plane) => {
                let turn = *self.plane.rotation.to_rotation_matrix().matrix();
                let turn = turn.fixed_view::<3, 2>(0, 0);
                let in_space = turn * in_plane * turn.transpose();
                (0..3).for_each(|row| (0..3).for_each(|column| covariance[row][column] = in_space[(row, column)]));
            }
            None => covariance[0][0] = -1.0,
        }
        let pose =
            bag::messages::Pose { position: placed.point(at.x(), at.y()), orientation: placed.orientation(normal_rad) };
        Some(PoseWithCovariance { pose, covariance })
    }

    fn shapes(&self, name: &str, answer: &Answer, estimator: &EstimatorOf<Self>) -> Vec<Shape> {
        let Some(base) = answer.base else { return Vec::new() };
        let placed = self.placed(estimator.motion().projection());
        let on_plane = |at: Point<Base>| {
            let at = base.apply(at);
            (at.x(), at.y())
        };
        let form = placed.line(self.wire(answer).into_iter().map(on_plane));
        let mut shapes = vec![Shape { name: format!("{name}/whisker"), number: 0, color: WHISKER_COLOR, form }];
        if let Some(estimate) = &answer.estimate
            && let Some(covariance_m2) = estimate.covariance_m2
        {
            let form = placed.ellipse(on_plane(estimate.contact), &base.turn(covariance_m2));
            shapes.extend(form.map(|form| Shape {
                name: format!("{name}/contact"),
                number: 0,
                color: CONTACT_COLOR,
                form,
            }));
        }
        let outline = estimator.outline().zip(estimator.start());
        if let Some(contour) = outline.and_then(|(outline, start)| Contour::carried(&start, &outline)) {
            shapes.extend(placed.outline(name, 0, &contour, OUTLINE_COLOR));
        }
        shapes
    }
}
