//! Live estimation of a whisker in space.

use std::f64::consts::PI;
use std::sync::Arc;

use bag::messages::{Pose, PoseWithCovariance};
use live::counts::BendingCounts;
use live::{Spatial, SpatialAnswer};
use nalgebra::{Matrix3, Vector2, Vector3};
use testbed::space::run::SpatialRunWhisker;
use testbed::space::view::{SpatialObserver, SpatialView};
use testbed::space::{SpatialEstimateRow, spatial_estimate_row, to_world, turned_to};
use trace::{SpatialInstant, SpatialTruthInstant};
use whisker::space::estimators::{Estimate, Knowledge};

use crate::chain::InSpace;
use crate::drawing::{CONTACT_COLOR, Form, SECTIONS, Shape, WHISKER_COLOR, point, quaternion};
use crate::map::{MOST_ENTRIES, Observed};
use crate::whisker::{Diagnosis, EstimatorOf, Geometry};

/// Length of the drawn normal (m), and its colour.
const NORMAL_M: f64 = 5e-3;
const NORMAL_COLOR: [f32; 4] = [1.0, 0.3, 0.1, 1.0];

/// Spatial readings, contacts, shapes and observations.
pub(crate) struct SpatialGeometry {
    knowledge: Arc<Knowledge>,
    observer: SpatialObserver,
    view: SpatialView,
}

impl SpatialGeometry {
    pub(crate) fn new(whisker: &SpatialRunWhisker, knowledge: Arc<Knowledge>) -> anyhow::Result<Self> {
        let observer = SpatialObserver::new(whisker)?;
        Ok(Self { knowledge, observer, view: SpatialView::default() })
    }

    /// The answer with positions and directions in the fixed frame. `None` without a pose.
    fn row(&self, answer: &SpatialAnswer) -> Option<SpatialEstimateRow> {
        let SpatialAnswer { t_s, base: Some(base), reading_n_m, .. } = *answer else { return None };
        let now = SpatialInstant::measured(t_s, base, reading_n_m);
        let (truth, calibrated) = (SpatialTruthInstant::default(), &self.knowledge.calibrated);
        Some(spatial_estimate_row(&now, &truth, calibrated, reading_n_m, answer.estimate.as_ref()))
    }
}

impl Geometry for SpatialGeometry {
    type Kind = Spatial;
    type Counts = BendingCounts;
    type Projection = InSpace;

    fn reading(moment_n_m: &Vector3<f64>) -> Vector2<f64> {
        Vector2::new(moment_n_m.y, moment_n_m.z)
    }

    fn diagnosis(estimate: &Estimate) -> Diagnosis {
        Diagnosis {
            is_doubtful: estimate.model_doubtful == Some(true),
            nis: estimate.innovation.map(|innovation| 0.5 * innovation.nis),
            deviation: None,
        }
    }

    fn observe(&mut self, answer: &SpatialAnswer) {
        if self.view.len() <= MOST_ENTRIES
            && let Some(row) = self.row(answer)
        {
            self.observer.observe(&row, &mut self.view);
        }
    }

    fn observed(&self, _projection: &InSpace) -> Observed {
        Observed::InSpace(self.view.clone())
    }

    fn contact(&self, answer: &SpatialAnswer, _projection: &InSpace) -> Option<PoseWithCovariance> {
        let (base, estimate) = (to_world(&answer.base?), answer.estimate?);
        let normal = base.turn_vector(estimate.normal);
        let mut covariance = [[0.0; 6]; 6];
        let mut enter = |of: &Matrix3<f64>, first: usize| {
            (0..3)
                .for_each(|row| (0..3).for_each(|column| covariance[first + row][first + column] = of[(row, column)]));
        };
        enter(&base.turn(estimate.covariance_m2), 0);
        if estimate.normal_covariance.trace() > 0.0 {
            enter(&rotations(&normal, &base.turn(estimate.normal_covariance)), 3);
        } else {
            covariance[3][3] = -1.0;
        }
        let pose = Pose {
            position: point(base.apply(estimate.contact).vector()),
            orientation: quaternion(&turned_to(&normal)),
        };
        Some(PoseWithCovariance { pose, covariance })
    }

    fn shapes(&self, name: &str, answer: &SpatialAnswer, _estimator: &EstimatorOf<Self>) -> Vec<Shape> {
        let Some(row) = self.row(answer) else { return Vec::new() };
        let count = SECTIONS as usize + 1;
        let contact = row.contact_m();
        let wire = self.observer.wire();
        let bent = contact.and_then(|contact| wire.points_m(&row, Some(contact), count));
        let wire = bent.or_else(|| wire.points_m(&row, None, count));
        let ellipsoid = contact.zip(row.covariance_m2());
        let normal = row.surface_m().zip(row.normal());
        let forms = [
            ("whisker", WHISKER_COLOR, wire.map(Form::line)),
            ("contact", CONTACT_COLOR, ellipsoid.and_then(|(at, covariance_m2)| Form::ellipsoid(at, &covariance_m2))),
            ("normal", NORMAL_COLOR, normal.map(|(at, normal)| Form::line([at, at + NORMAL_M * normal]))),
        ];
        let shape = |(part, color, form): (&str, _, Option<Form>)| {
            Some(Shape { name: format!("{name}/{part}"), number: 0, color, form: form? })
        };
        forms.into_iter().filter_map(shape).collect()
    }
}

/// Covariance of small rotations about the axes of the fixed frame (rad2) from the covariance of a unit vector in that frame. The
/// rotation about the vector is undetermined; its variance is that of a uniformly distributed angle.
fn rotations(along: &Vector3<f64>, covariance: &Matrix3<f64>) -> Matrix3<f64> {
    // A rotation w changes the vector n by w x n, hence the part of w across n is n x dn.
    let cross = along.cross_matrix();
    cross * covariance * cross.transpose() + along * along.transpose() * (PI * PI / 3.0)
}
