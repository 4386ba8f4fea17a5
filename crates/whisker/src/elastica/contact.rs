//! The contact with a convex object.
//!
//! The whisker's surface is the envelope of circles of the wire's radius `r` around its centre line: a side that ends
//! in a round tip. The normal is inclined forwards from the direction across the centre line by the angle `beta`: on
//! the side by the slope of the taper, `sin beta = -r'`, on the tip by more. One coordinate runs along the surface: the
//! arc length `a` on the side, then `beta` on the tip. With `nu` the angle of the object's outward normal, the object
//! being on the side `e` (+1 left):
//!
//! ```text
//! nu = phi - e (pi/2 + beta)    S = p - r (cos nu, sin nu)    force N (cos nu, sin nu), N >= 0
//! ```
//!
//! A friction `q N` acts along the surface, in the direction `nu + e pi/2`, towards the tip.
//!
//! In contact `S` is the outline's support `P(nu)`. If `nu` is the normal of a straight side, the support is the whole
//! side: then `nu` is given and `S` lies on the side's line. There are two unknowns (`a` or `beta`, and `N`) and two
//! equations in four forms: side or tip of the whisker, against a straight side or the part between two of them (a
//! corner, or a curve). The solution in one form shows whether it belongs to the next. All forms share the sign of
//! their determinant, so each detects a fold.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::{Matrix2, Vector2};

use super::newton::{self, Equations};
use super::{Deflection, Elastica, Failure, Load, Outline, Parameter, Rate, finite, side};
use crate::face::Face;
use crate::frames::{Base, Point, Pose, World};
use crate::rest::direction;

/// Places on the side and on the tip at which the undeflected whisker is compared with the outline.
const SIDE_PLACES: usize = 96;
const TIP_PLACES: usize = 16;

/// Largest angle of the tip from the direction across the whisker; beyond it the other face touches first.
const TIP_END_RAD: f64 = FRAC_PI_2;

/// Depth, in lengths of the whisker, above which another part of it is in the object; larger than the error of a
/// contact found by bisection.
const CLEAR: f64 = 1e-8;

/// An angle within which a first guess takes the whisker for parallel to a straight side.
const PARALLEL_RAD: f64 = 1e-7;

/// Maximum number of changes of form within one solution.
const MOST_CHANGES: usize = 10;

/// The part of the whisker that touches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Regime {
    /// Side: the force is across the whisker, except for the slope of a taper.
    Side,
    /// Tip: the force is along the object's normal, at an angle to the whisker.
    Tip,
}

/// A contact with an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// The part of the whisker that touches.
    pub regime: Regime,
    /// The point of the object's surface.
    pub surface: Point<Base>,
    /// Angle of the object's outward normal there, in Base: without friction the direction of the force on the whisker.
    pub normal_rad: f64,
    /// Magnitude of the force, friction included.
    pub force_n: f64,
    /// Load on the whisker.
    pub load: Load,
    /// Deflection of the whisker.
    pub deflection: Deflection,
    form: Form,
}

/// The part of the outline that touches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Flat(usize),
    /// The part from the flat of this index, counter-clockwise, to the next flat.
    Between(usize),
}

/// The form of the equations, with the unknowns: `a` or `beta`, and `N`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Form {
    regime: Regime,
    part: Part,
    unknowns: Vector2<f64>,
}

/// A point of the whisker's surface, and its derivatives by the two unknowns.
struct Surface {
    deflection: Deflection,
    load: Load,
    normal_rad: f64,
    point: Vector2<f64>,
    point_rates: Matrix2<f64>,
    normal_rates: Vector2<f64>,
}

/// A point of the whisker that is parallel to the outline.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Nearby {
    regime: Regime,
    /// `a` or `beta`.
    slide: f64,
    normal_rad: f64,
    /// Distance from the outline, negative inside.
    gap_m: f64,
}

/// The outline in Base, shifted.
struct Placed<'a> {
    outline: &'a dyn Outline,
    world_in_base: Pose<World, Base>,
    yaw_rad: f64,
    shift: Vector2<f64>,
    /// Ratio of friction to normal force.
    friction: f64,
}

/// The equivalent angle nearest to another one.
fn near(angle_rad: f64, other_rad: f64) -> f64 {
    angle_rad - TAU * ((angle_rad - other_rad) / TAU).round()
}

impl Placed<'_> {
    fn point(&self, point: Point<World>) -> Vector2<f64> {
        self.world_in_base.apply(point).vector() + self.shift
    }

    fn flats(&self) -> usize {
        self.outline.flats().len()
    }

    /// Support and radius of curvature in the direction `normal_rad` of Base.
    fn support(&self, normal_rad: f64) -> (Vector2<f64>, f64) {
        let support = self.outline.support(normal_rad + self.yaw_rad);
        (self.point(support.point), support.radius_m)
    }

    fn flat_normal_rad(&self, index: usize) -> f64 {
        self.outline.flats()[index % self.flats()].normal_rad - self.yaw_rad
    }

    /// Normals between which the part after the flat `index` lies, around `normal_rad`.
    fn range_rad(&self, index: usize, normal_rad: f64) -> (f64, f64) {
        if self.flats() == 0 {
            return (f64::NEG_INFINITY, f64::INFINITY);
        }
        let from = self.flat_normal_rad(index);
        let width = (self.flat_normal_rad(index + 1) - from).rem_euclid(TAU);
        let width = if width == 0.0 { TAU } else { width };
        let middle = near(from + 0.5 * width, normal_rad);
        (middle - 0.5 * width, middle + 0.5 * width)
    }

    /// The support of one part, extrapolated beyond its ends by a circle of the radius there, so that it is
    /// continuous for an iteration.
    fn support_between(&self, index: usize, normal_rad: f64) -> (Vector2<f64>, f64) {
        let (low, high) = self.range_rad(index, normal_rad);
        // Slightly inside: at the very end the outline chooses which end of the flat it returns.
        let hair = 1e-9;
        let inside = normal_rad.max(low + hair).min(high - hair);
        let (point, radius_m) = self.support(inside);
        (point + radius_m * (direction(normal_rad) - direction(inside)), radius_m)
    }

    /// The part to which this normal belongs.
    fn part(&self, normal_rad: f64) -> Part {
        let flats = self.outline.flats();
        let parallel =
            |index: &usize| (near(self.flat_normal_rad(*index), normal_rad) - normal_rad).abs() < PARALLEL_RAD;
        if let Some(index) = (0..flats.len()).find(parallel) {
            return Part::Flat(index);
        }
        let world_rad = (normal_rad + self.yaw_rad).rem_euclid(TAU);
        let after = flats.partition_point(|flat| flat.normal_rad < world_rad);
        Part::Between((after + flats.len().max(1) - 1) % flats.len().max(1))
    }
}

impl Elastica {
    /// The contact with `outline`, with the whisker's base at `base`. `None` if they do not touch.
    ///
    /// Of several, the one reached from the undeflected whisker when the object moves straight from its first touch to
    /// its place. `face` is the side of the whisker on which the object lies.
    ///
    /// # Errors
    /// [`Failure::SlippedOff`] or [`Failure::Buckled`] if there is no equilibrium, [`Failure::Bridged`] if the contact
    /// is at more than one point, [`Failure::NotFinite`].
    pub fn against(
        &self,
        outline: &dyn Outline,
        base: &Pose<Base, World>,
        face: Face,
    ) -> Result<Option<Touch>, Failure> {
        self.against_with_friction(outline, base, face, 0.0)
    }

    /// As [`Self::against`], with friction: `ratio` is that of friction to normal force, positive if the friction on the
    /// whisker is towards its tip.
    ///
    /// # Errors
    /// Those of [`Self::against`].
    pub fn against_with_friction(
        &self,
        outline: &dyn Outline,
        base: &Pose<Base, World>,
        face: Face,
        ratio: f64,
    ) -> Result<Option<Touch>, Failure> {
        let mut placed = place(outline, base, ratio)?;
        let Some((start, depth)) = self.first_touch(&placed, side(face)) else { return Ok(None) };
        let followed = newton::follow(start, |share, form| {
            placed.shift = (1.0 - share) * depth;
            self.solve_form(&placed, side(face), form)
        });
        let form = followed.map_err(|(reached, last)| match last.regime {
            Regime::Tip => Failure::SlippedOff { reached },
            Regime::Side => Failure::Buckled { reached },
        })?;
        placed.shift = Vector2::zeros();
        self.touch(&placed, side(face), form)
    }

    /// As [`Self::against`], starting from a nearby contact, such as that of the last sample, which selects the
    /// solution.
    ///
    /// # Errors
    /// Those of [`Self::against`], which is used if the nearby contact does not lead to a solution.
    pub fn against_near(
        &self,
        outline: &dyn Outline,
        base: &Pose<Base, World>,
        face: Face,
        near: &Touch,
    ) -> Result<Option<Touch>, Failure> {
        let placed = place(outline, base, 0.0)?;
        // The nearby contact may be one with another object, of fewer sides.
        let known = match near.form.part {
            Part::Flat(index) => index < placed.flats(),
            Part::Between(index) => index < placed.flats().max(1),
        };
        let solved = if known { self.solve_form(&placed, side(face), near.form) } else { None };
        match solved {
            Some(form) if form.unknowns.y > 0.0 => self.touch(&placed, side(face), form),
            _ => self.against(outline, base, face),
        }
    }

    /// The angle `beta` of the whisker's side.
    fn side_lean_rad(&self) -> f64 {
        -self.radius_slope().asin()
    }

    fn surface(&self, friction: f64, side: f64, regime: Regime, unknowns: Vector2<f64>) -> Option<Surface> {
        let normal_n = unknowns.y;
        let (arc_m, beta) = match regime {
            Regime::Side => (unknowns.x, self.side_lean_rad()),
            Regime::Tip => (self.length_m, unknowns.x),
        };
        if !(arc_m > 0.0 && arc_m < 1.5 * self.length_m && beta.abs() < PI) {
            return None;
        }
        let (sin, cos) = beta.sin_cos();
        // Components of the force, and its derivatives by `beta`, relative to the normal force.
        let (along, left) = (friction * cos - sin, -side * (cos + friction * sin));
        let (along_turned, left_turned) = (-cos - friction * sin, side * (sin - friction * cos));
        let couple_m = -side * friction * self.radius_m(arc_m);
        let load = Load { arc_m, along_n: normal_n * along, left_n: normal_n * left, couple_n_m: normal_n * couple_m };
        let by_slide = match regime {
            Regime::Side => Parameter::Arc { couple: -side * friction * self.radius_slope() * normal_n },
            Regime::Tip => {
                Parameter::Load { along: normal_n * along_turned, left: normal_n * left_turned, couple: 0.0 }
            }
        };
        let by_force = Parameter::Load { along, left, couple: couple_m };
        let (deflection, [slide, push]) = self.respond(load, [by_slide, by_force])?;
        let normal_rad = deflection.tangent_rad - side * (FRAC_PI_2 + beta);
        let (normal, across) = (direction(normal_rad), direction(normal_rad + FRAC_PI_2));
        let radius_m = self.radius_m(arc_m);
        let (own_turn, own_radius) = match regime {
            Regime::Side => (0.0, self.radius_slope()),
            Regime::Tip => (-side, 0.0),
        };
        let normal_rates = Vector2::new(slide.tangent + own_turn, push.tangent);
        let column = |rate: &Rate, turn: f64| rate.point - radius_m * turn * across;
        Some(Surface {
            point: deflection.point.vector() - radius_m * normal,
            point_rates: Matrix2::from_columns(&[
                column(&slide, normal_rates.x) - own_radius * normal,
                column(&push, normal_rates.y),
            ]),
            deflection,
            load,
            normal_rad,
            normal_rates,
        })
    }

    /// The equations, written along the whisker's surface and along the normal.
    fn equations(&self, placed: &Placed, side: f64, part: Part, surface: &Surface) -> Equations<2> {
        let normal = direction(surface.normal_rad);
        let turning = direction(surface.normal_rad + FRAC_PI_2);
        let forward = side * turning;
        match part {
            Part::Between(index) => {
                let (support, radius_m) = placed.support_between(index, surface.normal_rad);
                let miss = surface.point - support;
                let rates = surface.point_rates - radius_m * turning * surface.normal_rates.transpose();
                Equations {
                    residual_m: Vector2::new(forward.dot(&miss), normal.dot(&miss)),
                    jacobian: Matrix2::from_rows(&[forward.transpose() * rates, normal.transpose() * rates]),
                }
            }
            Part::Flat(index) => {
                let flat_rad = near(placed.flat_normal_rad(index), surface.normal_rad);
                let normal = direction(flat_rad);
                let height_m = normal.dot(&(surface.point - placed.point(placed.outline.flats()[index].from)));
                let scale = -side * self.length_m;
                Equations {
                    residual_m: Vector2::new(scale * (surface.normal_rad - flat_rad), height_m),
                    jacobian: Matrix2::from_rows(&[
                        scale * surface.normal_rates.transpose(),
                        normal.transpose() * surface.point_rates,
                    ]),
                }
            }
        }
    }

    /// The solution near `form`, in the form to which it belongs.
    fn solve_form(&self, placed: &Placed, side: f64, mut form: Form) -> Option<Form> {
        let side_lean_rad = self.side_lean_rad();
        for _ in 0..MOST_CHANGES {
            form.unknowns = newton::solve(form.unknowns, self.length_m, |unknowns| {
                let surface = self.surface(placed.friction, side, form.regime, unknowns)?;
                Some(self.equations(placed, side, form.part, &surface))
            })?;
            let surface = self.surface(placed.friction, side, form.regime, form.unknowns)?;
            let next = Form { part: next_part(placed, form.part, &surface), ..form };
            let next = match form.regime {
                Regime::Side if form.unknowns.x > self.length_m * (1.0 + 1e-12) => {
                    Form { regime: Regime::Tip, unknowns: Vector2::new(side_lean_rad, form.unknowns.y), ..next }
                }
                Regime::Tip if form.unknowns.x < side_lean_rad - 1e-12 => {
                    Form { regime: Regime::Side, unknowns: Vector2::new(self.length_m, form.unknowns.y), ..next }
                }
                _ => next,
            };
            if (next.regime, next.part) == (form.regime, form.part) {
                // Where side and tip meet, a solution may exceed its range by rounding.
                let slide = &mut form.unknowns.x;
                *slide = if form.regime == Regime::Side { slide.min(self.length_m) } else { slide.max(side_lean_rad) };
                return Some(form);
            }
            form = next;
        }
        None
    }

    /// First contact of the undeflected whisker with an object that moves straight to its place, and the displacement
    /// of the object from its place to there. `None` if it does not reach the whisker.
    fn first_touch(&self, placed: &Placed, side: f64) -> Option<(Form, Vector2<f64>)> {
        let at_rest = |arc_m: f64| (self.rest.point(arc_m), self.rest.tangent_rad(arc_m));
        let deepest = self.deepest(placed, side, at_rest).filter(|near| near.gap_m < 0.0)?;
        let form = Form {
            regime: deepest.regime,
            part: placed.part(deepest.normal_rad),
            unknowns: Vector2::new(deepest.slide, 0.0),
        };
        Some((form, deepest.gap_m * direction(deepest.normal_rad)))
    }

    /// Of the points where the whisker in the given shape (point and tangent at an arc length) is parallel to the
    /// outline as in a contact, the one deepest in the object.
    fn deepest(&self, placed: &Placed, side: f64, shape: impl Fn(f64) -> (Point<Base>, f64)) -> Option<Nearby> {
        let side_lean_rad = self.side_lean_rad();
        // Angle by which the whisker at `u` (0 to 1 on its side, up to 2 on its tip) is ahead of the outline's support.
        let compare = |u: f64| {
            let (regime, slide) = if u <= 1.0 {
                (Regime::Side, u * self.length_m)
            } else {
                (Regime::Tip, side_lean_rad + (u - 1.0) * (TIP_END_RAD - side_lean_rad))
            };
            let (arc_m, beta) = if regime == Regime::Side { (slide, side_lean_rad) } else { (self.length_m, slide) };
            let (point, tangent_rad) = shape(arc_m);
            let normal_rad = tangent_rad - side * (FRAC_PI_2 + beta);
            let normal = direction(normal_rad);
            let miss = point.vector() - self.radius_m(arc_m) * normal - placed.support(normal_rad).0;
            let ahead_m = side * direction(normal_rad + FRAC_PI_2).dot(&miss);
            (ahead_m, Nearby { regime, slide, normal_rad, gap_m: normal.dot(&miss) })
        };
        let grid = |i: usize| {
            if i <= SIDE_PLACES {
                i as f64 / SIDE_PLACES as f64
            } else {
                1.0 + (i - SIDE_PLACES) as f64 / TIP_PLACES as f64
            }
        };
        let mut deepest: Option<Nearby> = None;
        let mut behind = compare(grid(0)).0 < 0.0;
        for i in 1..=SIDE_PLACES + TIP_PLACES {
            let ahead = compare(grid(i)).0 >= 0.0;
            if behind && ahead {
                let (mut low, mut high) = (grid(i - 1), grid(i));
                for _ in 0..52 {
                    let middle = 0.5 * (low + high);
                    if compare(middle).0 < 0.0 { low = middle } else { high = middle }
                }
                let found = compare(high).1;
                if deepest.is_none_or(|deepest| found.gap_m < deepest.gap_m) {
                    deepest = Some(found);
                }
            }
            behind = !ahead;
        }
        deepest
    }

    /// Whether the whisker in this contact penetrates the object elsewhere.
    ///
    /// A force from the object bends the whisker away from it, so this requires a pre-curvature towards the object.
    fn bridges(&self, placed: &Placed, side: f64, load: Load) -> Result<bool, Failure> {
        if self.stretches.iter().all(|stretch| side * stretch.curvature_per_m <= 0.0) {
            return Ok(false);
        }
        let line = self.line(load)?;
        let deepest = self.deepest(placed, side, |arc_m| line.at(arc_m));
        Ok(deepest.is_some_and(|near| near.gap_m < -CLEAR * self.length_m))
    }

    fn touch(&self, placed: &Placed, side: f64, form: Form) -> Result<Option<Touch>, Failure> {
        let normal_n = form.unknowns.y;
        if normal_n <= 0.0 {
            return Ok(None);
        }
        let lost = Failure::Buckled { reached: 1.0 };
        let surface = self.surface(placed.friction, side, form.regime, form.unknowns).ok_or(lost)?;
        let arc_m = surface.load.arc_m;
        if self.bridges(placed, side, surface.load)? {
            return Err(Failure::Bridged { arc_m });
        }
        Ok(Some(Touch {
            regime: form.regime,
            surface: Point::from_vector(surface.point),
            normal_rad: surface.normal_rad,
            force_n: normal_n * placed.friction.hypot(1.0),
            load: surface.load,
            deflection: surface.deflection,
            form,
        }))
    }
}

/// The part of the outline to which a solution belongs, one step from the assumed one.
fn next_part(placed: &Placed, part: Part, surface: &Surface) -> Part {
    let flats = placed.flats();
    match part {
        Part::Between(index) => {
            let (low, high) = placed.range_rad(index, surface.normal_rad);
            if surface.normal_rad < low - 1e-12 {
                Part::Flat(index)
            } else if surface.normal_rad > high + 1e-12 {
                Part::Flat((index + 1) % flats)
            } else {
                part
            }
        }
        Part::Flat(index) => {
            let flat = &placed.outline.flats()[index];
            let (from, to) = (placed.point(flat.from), placed.point(flat.to));
            let share = (surface.point - from).dot(&(to - from)) / (to - from).norm_squared();
            if share < -1e-12 {
                Part::Between((index + flats - 1) % flats)
            } else if share > 1.0 + 1e-12 {
                Part::Between(index)
            } else {
                part
            }
        }
    }
}

fn place<'a>(outline: &'a dyn Outline, base: &Pose<Base, World>, friction: f64) -> Result<Placed<'a>, Failure> {
    finite("ratio", friction)?;
    finite("base.x", base.origin().x())?;
    finite("base.y", base.origin().y())?;
    finite("base.yaw", base.yaw_rad())?;
    let support = outline.support(0.0);
    for found in [support.point.x(), support.point.y(), support.radius_m] {
        finite("outline", found)?;
    }
    let shift = Vector2::zeros();
    Ok(Placed { outline, world_in_base: base.inverse(), yaw_rad: base.yaw_rad(), shift, friction })
}
