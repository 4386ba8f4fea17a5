//! Friction between the whisker and the pin of a calibration.
//!
//! With friction, the reading of a contact depends on the path by which the pin reached it: the force leans towards the tip while
//! the pin slides towards the tip, and towards the root while it slides back. A sensor model is a function of the contact alone,
//! and would be fitted to the mean of both. Here the coefficient of friction is estimated, and the readings are converted to those
//! without friction.
//!
//! ```text
//! s(p, q) = a(p, q) -+ R t(p, q)     q = mu while s increases, q = -mu while it decreases, |q| < mu while it rests
//! reading without friction = reading / r(p, q)
//! ```
//!
//! `a` is the arc length of a contact `p` and `t` the angle of the tangent there, both of the deflected whisker; `R` is the radius
//! of pin and wire together, about which the contact rolls (minus on the left face); `q` is the ratio of friction to normal force,
//! and `r` the ratio of the moment to that without friction. Arc length, angle and moment as functions of `q` are those of the
//! exact whisker ([`Lean`]). Successive samples of a trace are states of one quasi-static motion; a rotation of the base, by which
//! the contact rolls too, is neglected. Where a touch begins, the force vanishes, and with it the effect of `q`.
//!
//! The coefficient `mu` is that with the smallest sum of squared residuals of the whisker's mechanics, which are refitted for every
//! value tried.

use serde::{Deserialize, Serialize};

use super::{AlongAway, CalibratedFace, FitData, Lean, Region, Sample, elastica};

/// Smallest coefficient that is compared with no friction. If the residuals with it are not smaller, there is no search.
const LEAST: f64 = 0.03;

/// Largest coefficient of the search. One near it indicates another hysteresis than friction.
const MOST: f64 = 1.0;

/// Tolerance of the coefficient.
const TOLERANCE: f64 = 1e-3;

/// Step of the derivative of the residuals by the coefficient.
const STEP: f64 = 0.02;

/// Number of blocks of successive samples whose errors count as independent.
const BLOCKS: usize = 40;

/// Least ratio of a coefficient to its standard deviation at which a calibration counts as one with friction.
const LEAST_EVIDENCE: f64 = 5.0;

/// Least share of the squared readings that must have been taken while the pin slid in each direction. Friction in one direction
/// alone is indistinguishable from a different stiffness.
const LEAST_SHARE: f64 = 0.05;

/// Coefficient of friction between a whisker and the pin of its calibration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PinFriction {
    /// The coefficient.
    pub coefficient: f64,
    /// Its standard deviation, from the scatter between blocks of successive samples.
    pub coefficient_sd: f64,
}

/// Samples of a calibration, converted to readings without friction.
#[derive(Clone, Debug)]
pub struct WithoutFriction {
    /// The friction.
    pub friction: PinFriction,
    /// [`FitData::measured`] without friction.
    pub measured: Vec<Vec<Sample>>,
    /// [`FitData::reference`] without friction.
    pub reference: Vec<Vec<Sample>>,
}

impl WithoutFriction {
    /// The same data without friction.
    pub fn applied_to<'a>(&'a self, data: FitData<'a>) -> FitData<'a> {
        FitData { measured: &self.measured, reference: &self.reference, ..data }
    }
}

/// Estimates the friction of a calibration and removes it from the readings. `None` if the coefficient is not significant; if it is
/// at the end of the search, as with another hysteresis; if the pin slid in one direction only, so that friction cannot be
/// distinguished from stiffness; or if the readings do not determine the whisker's mechanics.
pub fn without_friction(data: &FitData<'_>) -> Option<WithoutFriction> {
    let row = super::model(elastica::KIND).ok()?;
    // The held-out error of this fit is not needed: as one trace, the samples are divided into the smallest number of parts.
    let (measured, reference) = ([data.measured.concat()], [data.reference.concat()]);
    let whole = FitData { measured: &measured, reference: &reference, ..*data };
    let face = super::fit(row, &(row.defaults)(), &whole).ok()?.face;
    let search = Search::new(data, &face);
    if search.cost(LEAST)? >= search.cost(0.0)? {
        return None;
    }
    let coefficient = search.best()?;
    if coefficient > MOST - STEP || !search.slides_both_ways(coefficient) {
        return None;
    }
    let friction = PinFriction { coefficient, coefficient_sd: search.coefficient_sd(coefficient)? };
    let is_evident = friction.coefficient >= LEAST_EVIDENCE * friction.coefficient_sd;
    if !is_evident {
        return None;
    }
    let ratios = search.ratios(coefficient);
    let (measured, reference) = (search.converted(data.measured, &ratios), search.converted(data.reference, &ratios));
    Some(WithoutFriction { friction, measured, reference })
}

/// Place of a sample without friction.
#[derive(Clone, Copy)]
struct Place {
    /// Coordinates of the contact.
    at: AlongAway,
    /// Angle of the whisker's tangent there (rad).
    tangent_rad: f64,
}

/// Search for the coefficient of friction.
struct Search<'a> {
    data: &'a FitData<'a>,
    face: &'a CalibratedFace,
    lean: &'a Lean,
    /// Places of the samples of each trace.
    places: Vec<Vec<Place>>,
}

impl<'a> Search<'a> {
    fn new(data: &'a FitData<'a>, face: &'a CalibratedFace) -> Self {
        let turn = face.turn(data.whisker);
        let place = |sample: &Sample| {
            let at = face.along_and_away(sample.contact);
            Place { at, tangent_rad: face.rest.tangent_rad(at.along_m) + turn.at(at).0 }
        };
        let places = data.measured.iter().map(|trace| trace.iter().map(place).collect()).collect();
        Self { data, face, lean: face.lean(data.whisker), places }
    }

    /// Coordinate `s` of the module (m), which is constant while the pin sticks to the whisker.
    fn rolled_m(&self, &Place { at, tangent_rad }: &Place, ratio: f64) -> f64 {
        let tangent_rad = tangent_rad + self.lean.turn_rad(at, ratio).value;
        let arc_m = at.along_m + self.lean.beyond_m(at, ratio).value;
        arc_m + self.face.face.away_sign() * self.data.pin_radius_m * tangent_rad
    }

    /// Ratio of friction to normal force of every sample, by Coulomb's law. A trace begins without friction.
    fn ratios(&self, coefficient: f64) -> Vec<Vec<f64>> {
        let followed = |trace: &Vec<Place>| {
            let mut last_m = trace.first().map_or(0.0, |place| self.rolled_m(place, 0.0));
            let next = |place: &Place| {
                // The coordinate decreases as the ratio increases: friction draws the wire along with the pin.
                let (mut low, mut high) = (-coefficient, coefficient);
                let (farthest_m, nearest_m) = (self.rolled_m(place, low), self.rolled_m(place, high));
                if nearest_m >= last_m {
                    last_m = nearest_m;
                    return high;
                }
                if farthest_m <= last_m {
                    last_m = farthest_m;
                    return low;
                }
                while high - low > TOLERANCE {
                    let middle = 0.5 * (low + high);
                    if self.rolled_m(place, middle) > last_m { low = middle } else { high = middle }
                }
                0.5 * (low + high)
            };
            trace.iter().map(next).collect()
        };
        self.places.iter().map(followed).collect()
    }

    /// Samples with readings without friction.
    fn converted(&self, samples: &[Vec<Sample>], ratios: &[Vec<f64>]) -> Vec<Vec<Sample>> {
        let convert = |sample: &Sample, place: &Place, ratio: f64| Sample {
            reading_n_m: sample.reading_n_m / self.lean.moment_ratio(place.at, ratio).value,
            ..*sample
        };
        let trace = |((samples, places), ratios): ((&Vec<Sample>, &Vec<Place>), &Vec<f64>)| {
            let each = samples.iter().zip(places).zip(ratios);
            each.map(|((sample, place), ratio)| convert(sample, place, *ratio)).collect()
        };
        samples.iter().zip(&self.places).zip(ratios).map(trace).collect()
    }

    /// Residuals of the mechanics fitted to the readings without friction of this coefficient.
    fn residuals_n_m(&self, coefficient: f64) -> Option<Vec<f64>> {
        let samples = self.converted(self.data.measured, &self.ratios(coefficient)).concat();
        let region = Region { whisker: self.data.whisker, face: self.face.face, domain: &self.face.domain };
        let model = elastica::fit(&region, &samples, &elastica::defaults()).ok()?.model;
        Some(samples.iter().map(|sample| model.reading_n_m(sample.contact) - sample.reading_n_m).collect())
    }

    /// Sum of squared residuals of the mechanics fitted with this coefficient (N2 m2).
    fn cost(&self, coefficient: f64) -> Option<f64> {
        Some(self.residuals_n_m(coefficient)?.iter().map(|residual| residual * residual).sum())
    }

    /// The coefficient with the smallest cost, by golden-section search.
    fn best(&self) -> Option<f64> {
        let inner = |low: f64, high: f64| low + (high - low) * (3.0 - 5.0_f64.sqrt()) / 2.0;
        let (mut low, mut high) = (0.0, MOST);
        let (mut left, mut right) = (inner(low, high), inner(high, low));
        let (mut left_cost, mut right_cost) = (self.cost(left)?, self.cost(right)?);
        while high - low > TOLERANCE {
            if left_cost <= right_cost {
                (high, right, right_cost) = (right, left, left_cost);
                left = inner(low, high);
                left_cost = self.cost(left)?;
            } else {
                (low, left, left_cost) = (left, right, right_cost);
                right = inner(high, low);
                right_cost = self.cost(right)?;
            }
        }
        Some(0.5 * (low + high))
    }

    /// Whether the pin slid in both directions.
    fn slides_both_ways(&self, coefficient: f64) -> bool {
        let squares = self.data.measured.iter().flatten().map(|sample| sample.reading_n_m.powi(2));
        let (mut to_tip, mut to_root, mut all) = (0.0, 0.0, 0.0);
        for (square, ratio) in squares.zip(self.ratios(coefficient).concat()) {
            all += square;
            to_tip += if ratio >= coefficient { square } else { 0.0 };
            to_root += if ratio <= -coefficient { square } else { 0.0 };
        }
        to_tip.min(to_root) >= LEAST_SHARE * all
    }

    /// Standard deviation of the coefficient. The residuals within a block may have any correlation (clustered sandwich estimator,
    /// Liang and Zeger 1986).
    fn coefficient_sd(&self, coefficient: f64) -> Option<f64> {
        let below = (coefficient - STEP).max(0.0);
        let (less, more) = (self.residuals_n_m(below)?, self.residuals_n_m(coefficient + STEP)?);
        let residuals = self.residuals_n_m(coefficient)?;
        let slopes: Vec<f64> =
            less.iter().zip(&more).map(|(less, more)| (more - less) / (coefficient + STEP - below)).collect();
        let length = residuals.len().div_ceil(BLOCKS);
        let scores = residuals.chunks(length).zip(slopes.chunks(length)).map(|(residuals, slopes)| {
            residuals.iter().zip(slopes).map(|(residual, slope)| residual * slope).sum::<f64>()
        });
        let information: f64 = slopes.iter().map(|slope| slope * slope).sum();
        Some(scores.map(|score| score * score).sum::<f64>().sqrt() / information)
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    use super::*;
    use crate::elastica::{Circle, Elastica, Touch};
    use crate::estimators::testing::swept;
    use crate::frames::{Base, Point, Pose, World};
    use crate::sensor::Face;
    use crate::{Curvature, Whisker};

    const PIN_RADIUS_M: f64 = 0.8e-3;

    fn whisker() -> Whisker {
        Whisker { damping_s: 0.0, ..Whisker::curved() }.with_curvature([Curvature::new(0.08, 12.5)])
    }

    /// The mirror image of samples, at a whisker of opposite curvature.
    fn mirrored(lines: &[Vec<Sample>]) -> Vec<Vec<Sample>> {
        let mirror = |sample: &Sample| Sample {
            contact: Point::new(sample.contact.x(), -sample.contact.y()),
            reading_n_m: -sample.reading_n_m,
        };
        lines.iter().map(|line| line.iter().map(mirror).collect()).collect()
    }

    /// Motion of the base on a line of the calibration.
    #[derive(Clone, Copy)]
    enum Way {
        /// The whisker is pressed against the pin and withdrawn.
        ToAndFro,
        /// The pressed whisker is drawn back, so that the pin slides towards its tip.
        ToTip,
    }

    impl Way {
        fn bases(self, arc_m: f64) -> Vec<Pose<Base, World>> {
            let base = |share: f64| match self {
                Self::ToAndFro => Pose::new(0.0, 0.3 * arc_m * (1.0 - (2.0 * share - 1.0).abs()), 0.0),
                Self::ToTip => Pose::new(-4e-3 * share, 0.2 * arc_m, 0.0),
            };
            (1..80).map(|step| base(f64::from(step) / 80.0)).collect()
        }
    }

    /// Samples of a calibration with a pin of this coefficient of friction, line by line.
    fn lines(coefficient: f64, noise_sd_n_m: f64, way: Way) -> Vec<Vec<Sample>> {
        let (whisker, mut noise) = (whisker(), Pcg64::seed_from_u64(1));
        let (elastica, rest) = (Elastica::new(&whisker).unwrap(), whisker.rest_shape());
        let line = |i: u32| {
            let arc_m = 0.028 + 0.003 * f64::from(i);
            let center = Point::from_vector(rest.beside(arc_m, PIN_RADIUS_M).vector());
            let touches = swept(&elastica, &Circle { center, radius_m: PIN_RADIUS_M }, coefficient, way.bases(arc_m));
            let sample = |(touch, _): &(Touch, f64)| {
                let drawn: f64 = StandardNormal.sample(&mut noise);
                let reading_n_m = touch.deflection.moment_n_m + noise_sd_n_m * drawn;
                Sample { contact: touch.deflection.point, reading_n_m }
            };
            touches.iter().map(sample).collect()
        };
        (0..15).map(line).collect()
    }

    fn found(lines: &[Vec<Sample>]) -> Option<WithoutFriction> {
        found_at(&whisker(), Face::Left, lines)
    }

    fn found_at(whisker: &Whisker, face: Face, lines: &[Vec<Sample>]) -> Option<WithoutFriction> {
        without_friction(&FitData {
            whisker,
            face,
            measured: lines,
            reference: lines,
            reference_noise_sd_n_m: 0.0,
            pin_radius_m: PIN_RADIUS_M,
        })
    }

    #[test]
    fn val_friction_of_the_exact_whisker_is_found_and_removed() {
        for (coefficient, noise_sd_n_m) in [(0.1, 0.0), (0.3, 5e-7), (0.5, 0.0)] {
            let without = found(&lines(coefficient, noise_sd_n_m, Way::ToAndFro)).unwrap();
            let PinFriction { coefficient: stated, coefficient_sd } = without.friction;
            assert!(
                (stated - coefficient).abs() < 0.02 + 2.0 * coefficient_sd,
                "{coefficient}: {:?}",
                without.friction
            );
        }
    }

    #[test]
    fn val_the_removed_friction_is_that_of_the_exact_whisker() {
        let (lines, whisker) = (lines(0.3, 0.0, Way::ToAndFro), whisker());
        let elastica = Elastica::new(&whisker).unwrap();
        let largest_n_m = lines.iter().flatten().map(|sample| sample.reading_n_m.abs()).fold(0.0, f64::max);
        // Largest difference from the reading without friction, relative to the largest reading.
        let difference = |lines: &[Vec<Sample>]| {
            let of_sample = |sample: &Sample| {
                let exact = elastica.at_point(sample.contact).unwrap().deflection.moment_n_m;
                (sample.reading_n_m - exact).abs() / largest_n_m
            };
            lines.iter().flatten().map(of_sample).fold(0.0, f64::max)
        };
        let without = found(&lines).unwrap();
        let (before, after) = (difference(&lines), difference(&without.measured));
        assert!(before > 5e-3 && after < 0.1 * before, "{before} {after}");
        assert_eq!(without.measured, without.reference);
    }

    #[test]
    fn verif_the_mirror_image_has_the_same_friction() {
        let lines = lines(0.3, 0.0, Way::ToAndFro);
        let mirror = whisker().with_curvature([Curvature::new(0.08, -12.5)]);
        let (left, right) = (found(&lines).unwrap(), found_at(&mirror, Face::Right, &mirrored(&lines)).unwrap());
        let difference = left.friction.coefficient - right.friction.coefficient;
        assert!(difference.abs() < 2.0 * TOLERANCE, "{:?} {:?}", left.friction, right.friction);
    }

    #[test]
    fn verif_readings_without_friction_are_left_alone() {
        for noise_sd_n_m in [0.0, 2e-6] {
            let without = found(&lines(0.0, noise_sd_n_m, Way::ToAndFro));
            assert!(without.is_none(), "{noise_sd_n_m}: {:?}", without.map(|it| it.friction));
        }
    }

    #[test]
    fn robust_friction_of_one_direction_is_not_told_from_stiffness() {
        let without = found(&lines(0.3, 0.0, Way::ToTip));
        assert!(without.is_none(), "{:?}", without.map(|it| it.friction));
    }
}
