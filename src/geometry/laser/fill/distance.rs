//! The distance across the lines of a fill, measured on the part: a function of the drawing's plane whose gradient has the
//! length 1 on the part everywhere, so that its level lines are as far apart there as their levels.

use nalgebra::{Matrix2, Vector2};

use crate::geometry::normal_equations::{CellRow, CellSum, GridSolver, NormalEquations, SolveError};
use crate::geometry::space::{Extents, FlatPoint};
use crate::geometry::surface::knots::{Basis, UniformKnots};

/// Samples along each side of a cell.
const SAMPLES: usize = 3;
/// Cells of the first grid.
const FIRST_CELLS: f64 = 600.0;
/// Largest side of a cell, mm.
const LARGEST_CELL: f64 = 2.0;
/// Cells that a finer grid must not exceed.
const MOST_CELLS: usize = 12_000;
/// The grid is made finer while more than a hundredth of the samples deviate by more than this share of the spacing.
const GOAL: f64 = 0.002;
/// Maximum number of steps on one grid.
const MAX_STEPS: usize = 8;
/// The search ends when no control value moves by more than this, mm.
const MIN_STEP: f64 = 1e-5;
/// Weight of the squared second derivatives, mm²: it selects the smoothest of all solutions.
const SMOOTHNESS: f64 = 1e-4;
/// Weight of the squared slope along the lines: it keeps their direction.
const DIRECTION: f64 = 1e-6;
/// Weight of the value at the origin.
const PIN: f64 = 1.0;
/// Newton's steps to a level.
const NEWTON_STEPS: usize = 8;
/// A level is reached to within this, mm.
const ON_LEVEL: f64 = 1e-9;

/// The distance across the lines of a fill, as a bicubic B-spline over the drawing.
#[derive(Debug, Clone)]
pub(super) struct DistanceField {
    knots_s: UniformKnots,
    knots_t: UniformKnots,
    control: Vec<f64>,
    /// Direction of the lines as drawn.
    along: Vector2<f64>,
    /// The direction to their left.
    across: Vector2<f64>,
    /// The place with the distance 0, mm.
    origin: Vector2<f64>,
}

/// A place where the distance is wanted to be true.
struct Sample {
    s: Basis,
    t: Basis,
    /// The inverse of the first fundamental form of the part over the drawing; `None` where there is no fill.
    inverse_metric: Option<Matrix2<f64>>,
}

impl DistanceField {
    /// The distance as drawn, for lines in the direction `angle` (rad): true on the part where the map is.
    pub(super) fn straight(extents: &Extents, angle: f64) -> Self {
        let size = extents.size().map(|side| side.max(1e-3));
        let share = |cells: f64| (size.x * size.y / cells).sqrt();
        let cell =
            share(FIRST_CELLS).min(LARGEST_CELL).max(share(MOST_CELLS as f64 / 4.0)).max(size.max() / 500.0);
        let knots = |start: f64, length: f64| {
            let spans = (length / cell).ceil().max(2.0);
            UniformKnots::new(start, length / spans, spans as usize)
        };
        let (knots_s, knots_t) = (knots(extents.min.x, size.x), knots(extents.min.y, size.y));
        let along = Vector2::new(angle.cos(), angle.sin());
        let across = Vector2::new(-along.y, along.x);
        let origin = extents.center();
        let columns = knots_s.control_points();
        let place = |index: usize| {
            across.dot(
                &(Vector2::new(knots_s.greville(index % columns), knots_t.greville(index / columns))
                    - origin),
            )
        };
        let control = (0..columns * knots_t.control_points()).map(place).collect();
        Self { knots_s, knots_t, control, along, across, origin }
    }

    /// The smoothest distance that is true on the part at the places for which `is_filled` is true. `metric` is the first
    /// fundamental form of the part over the drawing; where it cannot be inverted, the place is left out.
    ///
    /// Gauss–Newton steps on |∇u| = 1, the eikonal equation, whose level lines are geodesic parallels (do Carmo,
    /// Differential Geometry of Curves and Surfaces, 1976, section 4-6).
    ///
    /// # Errors
    /// When the equations of a step cannot be solved.
    pub(super) fn true_on_part(
        extents: &Extents,
        angle: f64,
        is_filled: impl Fn(&UniformKnots, &UniformKnots, usize) -> Vec<bool>,
        metric: impl Fn(FlatPoint) -> Matrix2<f64>,
    ) -> Result<Self, SolveError> {
        let mut field = Self::straight(extents, angle);
        loop {
            let mask = is_filled(&field.knots_s, &field.knots_t, SAMPLES);
            let samples = field.samples(&mask, &metric);
            let solver = GridSolver::new(field.knots_s.control_points(), field.knots_t.control_points())?;
            let regular = field.regular(&samples);
            for _ in 0..MAX_STEPS {
                let control = field.linearised(&samples, &regular).solve(&solver)?;
                let steps = control.iter().zip(&field.control).map(|([new], old)| (new - old).abs());
                let largest = steps.fold(0.0, f64::max);
                if !largest.is_finite() {
                    break;
                }
                field.control = control.into_iter().map(|[value]| value).collect();
                if largest < MIN_STEP {
                    break;
                }
            }
            let cells = field.knots_s.spans() * field.knots_t.spans();
            if 4 * cells > MOST_CELLS || field.deviation_of_99_percent(&samples) <= GOAL {
                return Ok(field);
            }
            field.control = field.knots_s.halved_net(&field.control);
            (field.knots_s, field.knots_t) = (field.knots_s.halved(), field.knots_t.halved());
        }
    }

    /// The samples, cell by cell.
    fn samples(&self, mask: &[bool], metric: &impl Fn(FlatPoint) -> Matrix2<f64>) -> Vec<Sample> {
        let (columns, rows) = (self.knots_s.spans(), self.knots_t.spans());
        let at = |knots: &UniformKnots, index: usize| {
            knots.start() + knots.step() * (index as f64 + 0.5) / SAMPLES as f64
        };
        let mut samples = Vec::with_capacity(columns * rows * SAMPLES * SAMPLES);
        for cell in 0..columns * rows {
            for local in 0..SAMPLES * SAMPLES {
                let column = cell % columns * SAMPLES + local % SAMPLES;
                let row = cell / columns * SAMPLES + local / SAMPLES;
                let (s, t) = (at(&self.knots_s, column), at(&self.knots_t, row));
                let is_filled = mask.get(row * columns * SAMPLES + column).is_some_and(|filled| *filled);
                let inverse_metric = is_filled
                    .then(|| metric(FlatPoint::new(s, t)).try_inverse())
                    .flatten()
                    .filter(|inverse| inverse.iter().all(|value| value.is_finite()));
                samples.push(Sample { s: self.knots_s.basis(s), t: self.knots_t.basis(t), inverse_metric });
            }
        }
        samples
    }

    /// The equations that do not change from step to step: for the smoothest field with the direction of the lines and the value 0 at
    /// the origin.
    fn regular(&self, samples: &[Sample]) -> NormalEquations<1> {
        let mut equations =
            NormalEquations::new(self.knots_s.control_points(), self.knots_t.control_points());
        for cell in samples.chunks(SAMPLES * SAMPLES) {
            let mut sum = CellSum::default();
            for Sample { s, t, .. } in cell {
                sum.add(&row(self.along, s, t), 0.0, DIRECTION);
                let bends = [
                    (products(&s.bend, &t.value), 1.0),
                    (products(&s.slope, &t.slope), 2.0),
                    (products(&s.value, &t.bend), 1.0),
                ];
                for (bend, share) in bends {
                    sum.add(&bend.map(|value| [value]), 0.0, SMOOTHNESS * share);
                }
            }
            equations.add_cell(cell[0].s.first, cell[0].t.first, &sum);
        }
        let (s, t) = (self.knots_s.basis(self.origin.x), self.knots_t.basis(self.origin.y));
        let mut pinned = CellSum::default();
        pinned.add(&products(&s.value, &t.value).map(|value| [value]), 0.0, PIN);
        equations.add_cell(s.first, t.first, &pinned);
        equations
    }

    /// The equations of a step, for the control values after it.
    fn linearised(&self, samples: &[Sample], regular: &NormalEquations<1>) -> NormalEquations<1> {
        let mut equations = regular.clone();
        for cell in samples.chunks(SAMPLES * SAMPLES) {
            if cell.iter().all(|sample| sample.inverse_metric.is_none()) {
                continue;
            }
            let mut sum = CellSum::default();
            for sample in cell {
                let Some(inverse) = &sample.inverse_metric else { continue };
                let gradient = self.gradient_at(&sample.s, &sample.t);
                let raised = inverse * gradient;
                let length = gradient.dot(&raised).sqrt();
                if length > 1e-6 {
                    // The derivative of the length by the gradient, times the gradient, is the length itself.
                    sum.add(&row(raised / length, &sample.s, &sample.t), 1.0, 1.0);
                }
            }
            equations.add_cell(cell[0].s.first, cell[0].t.first, &sum);
        }
        equations
    }

    fn gradient_at(&self, s: &Basis, t: &Basis) -> Vector2<f64> {
        Vector2::new(
            self.sum(s, t, &products(&s.slope, &t.value)),
            self.sum(s, t, &products(&s.value, &t.slope)),
        )
    }

    /// The deviation of the gradient's length from 1 that 99 % of the filled samples stay below.
    fn deviation_of_99_percent(&self, samples: &[Sample]) -> f64 {
        let deviation = |sample: &Sample| {
            let inverse = sample.inverse_metric?;
            let gradient = self.gradient_at(&sample.s, &sample.t);
            Some((gradient.dot(&(inverse * gradient)).sqrt() - 1.0).abs())
        };
        let mut deviations: Vec<f64> = samples.iter().filter_map(deviation).collect();
        deviations.sort_unstable_by(f64::total_cmp);
        deviations.get(deviations.len() * 99 / 100).copied().unwrap_or(0.0)
    }

    fn sum(&self, s: &Basis, t: &Basis, products: &[f64; 16]) -> f64 {
        let columns = self.knots_s.control_points();
        let mut total = 0.0;
        for row in 0..4 {
            let start = (t.first + row) * columns + s.first;
            for column in 0..4 {
                total += self.control[start + column] * products[row * 4 + column];
            }
        }
        total
    }

    /// The distance at a point of the drawing, mm.
    pub(super) fn distance(&self, at: FlatPoint) -> f64 {
        let (s, t) = (self.knots_s.basis(at.x), self.knots_t.basis(at.y));
        self.sum(&s, &t, &products(&s.value, &t.value))
    }

    /// The gradient of the distance over the drawing.
    pub(super) fn gradient(&self, at: FlatPoint) -> Vector2<f64> {
        self.gradient_at(&self.knots_s.basis(at.x), &self.knots_t.basis(at.y))
    }

    /// How far along the lines a point is, mm, in the drawing.
    pub(super) fn along(&self, at: FlatPoint) -> f64 {
        self.along.dot(&(at.coords() - self.origin))
    }

    /// The point of a level line that is `along` mm along it; `guess` mm to the left of the origin is near it. Also returns how
    /// far to the left it is.
    pub(super) fn on_level(&self, level: f64, along: f64, guess: f64) -> (FlatPoint, f64) {
        let start = self.origin + self.along * along;
        let mut left = guess;
        for _ in 0..NEWTON_STEPS {
            let at = FlatPoint::from(start + self.across * left);
            let (s, t) = (self.knots_s.basis(at.x), self.knots_t.basis(at.y));
            let missing = level - self.sum(&s, &t, &products(&s.value, &t.value));
            let slope = self.across.x * self.sum(&s, &t, &products(&s.slope, &t.value))
                + self.across.y * self.sum(&s, &t, &products(&s.value, &t.slope));
            // Where the distance does not grow to the left, there is no line to follow.
            let step = missing / slope.max(0.1);
            left += step;
            if missing.abs() <= ON_LEVEL || !step.is_finite() {
                break;
            }
        }
        (FlatPoint::from(start + self.across * left), left)
    }

    /// How far to the left of the origin a point is, mm, in the drawing.
    pub(super) fn left(&self, at: FlatPoint) -> f64 {
        self.across.dot(&(at.coords() - self.origin))
    }
}

/// The derivative of the field in a direction by its control values.
fn row(direction: Vector2<f64>, s: &Basis, t: &Basis) -> CellRow<1> {
    let (by_s, by_t) = (products(&s.slope, &t.value), products(&s.value, &t.slope));
    std::array::from_fn(|index| [direction.x * by_s[index] + direction.y * by_t[index]])
}

fn products(s: &[f64; 4], t: &[f64; 4]) -> [f64; 16] {
    std::array::from_fn(|local| s[local % 4] * t[local / 4])
}
