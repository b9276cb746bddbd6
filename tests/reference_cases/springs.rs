//! The map with uniform weights, computed independently: a net of springs on the surface's formula, relaxed by the
//! Gauss–Newton method with conjugate gradients. It shares no code with the program: no mesh, no fit, no spline, no
//! sparse factorisation.

use isomark::geometry::space::{FlatPoint, ViewPoint};
use nalgebra::Vector2;

/// Distance between the knots of the net, mm.
const PITCH: f64 = 0.5;

/// A net of knots over a rectangle of the drawing, with springs along the sides and both diagonals of each cell.
pub(crate) struct Net {
    corner: Vector2<f64>,
    columns: usize,
    rows: usize,
    /// Positions of the knots in the view, row by row.
    knots: Vec<Vector2<f64>>,
}

/// A spring between two knots.
struct Spring {
    ends: [usize; 2],
    length: f64,
    weight: f64,
}

impl Net {
    /// The net over `width` × `height` mm of the drawing about `place` with the smallest mean squared strain of its
    /// springs, with four directions weighted equally. The middle stays at `place`, and the x direction is kept there.
    pub(crate) fn relaxed(height_at: fn(f64, f64) -> f64, place: [f64; 2], width: f64, height: f64) -> Self {
        let (columns, rows) = ((width / PITCH).round() as usize + 1, (height / PITCH).round() as usize + 1);
        assert!(columns % 2 == 1 && rows % 2 == 1, "a knot must be in the middle");
        let place = Vector2::from(place);
        let corner = place - Vector2::new(width, height) / 2.0;
        let knot =
            |index: usize| corner + Vector2::new((index % columns) as f64, (index / columns) as f64) * PITCH;
        let knots = (0..columns * rows).map(knot).collect();
        let mut net = Self { corner, columns, rows, knots };
        let springs = net.springs();
        let middle = (rows / 2) * columns + columns / 2;
        let mut energy = net.energy(height_at, &springs);
        for _ in 0..60 {
            let (rows_of_a, residuals) = net.linearised(height_at, &springs);
            let step = conjugate_gradients(&springs, &rows_of_a, &residuals, net.knots.len(), middle);
            let before = net.knots.clone();
            let mut fraction = 1.0;
            loop {
                for (knot, (old, shift)) in net.knots.iter_mut().zip(before.iter().zip(&step)) {
                    *knot = old + shift * fraction;
                }
                let reached = net.energy(height_at, &springs);
                if reached < energy || fraction < 1e-3 {
                    let has_converged = energy - reached < 1e-7 * energy;
                    energy = reached;
                    if has_converged {
                        return net;
                    }
                    break;
                }
                fraction /= 2.0;
            }
        }
        panic!("the net did not converge")
    }

    fn springs(&self) -> Vec<Spring> {
        let mut springs = Vec::new();
        let index = |column: usize, row: usize| row * self.columns + column;
        let diagonal = PITCH * std::f64::consts::SQRT_2;
        for row in 0..self.rows {
            for column in 0..self.columns {
                let (right, up) = (column + 1 < self.columns, row + 1 < self.rows);
                // A side belongs to two cells, at the border to one.
                if right {
                    let weight = if row == 0 || !up { 0.5 } else { 1.0 };
                    springs.push(Spring {
                        ends: [index(column, row), index(column + 1, row)],
                        length: PITCH,
                        weight,
                    });
                }
                if up {
                    let weight = if column == 0 || !right { 0.5 } else { 1.0 };
                    springs.push(Spring {
                        ends: [index(column, row), index(column, row + 1)],
                        length: PITCH,
                        weight,
                    });
                }
                if right && up {
                    for ends in [
                        [index(column, row), index(column + 1, row + 1)],
                        [index(column + 1, row), index(column, row + 1)],
                    ] {
                        springs.push(Spring { ends, length: diagonal, weight: 1.0 });
                    }
                }
            }
        }
        springs
    }

    fn strain(&self, height_at: fn(f64, f64) -> f64, spring: &Spring, ends: [Vector2<f64>; 2]) -> f64 {
        let lifted = |at: Vector2<f64>| at.push(height_at(at.x, at.y));
        let (from, to, middle) = (lifted(ends[0]), lifted(ends[1]), lifted((ends[0] + ends[1]) / 2.0));
        // One chord and two half chords give the arc length to fourth order (Richardson extrapolation).
        let (one, two) = ((to - from).norm(), (middle - from).norm() + (to - middle).norm());
        (4.0 * two - one) / 3.0 / spring.length - 1.0
    }

    fn energy(&self, height_at: fn(f64, f64) -> f64, springs: &[Spring]) -> f64 {
        let strain = |spring: &Spring| self.strain(height_at, spring, spring.ends.map(|end| self.knots[end]));
        springs.iter().map(|spring| spring.weight * strain(spring).powi(2)).sum()
    }

    /// For every spring, the derivatives of its weighted strain by both ends (finite differences), and that strain.
    fn linearised(
        &self,
        height_at: fn(f64, f64) -> f64,
        springs: &[Spring],
    ) -> (Vec<[Vector2<f64>; 2]>, Vec<f64>) {
        const STEP: f64 = 1e-5;
        let row = |spring: &Spring| {
            let ends = spring.ends.map(|end| self.knots[end]);
            let scale = spring.weight.sqrt();
            let derivative = |end: usize, axis: usize| {
                let moved = |step: f64| {
                    let mut ends = ends;
                    ends[end][axis] += step;
                    self.strain(height_at, spring, ends)
                };
                scale * (moved(STEP) - moved(-STEP)) / (2.0 * STEP)
            };
            let by_ends = [0, 1].map(|end| Vector2::new(derivative(end, 0), derivative(end, 1)));
            (by_ends, scale * self.strain(height_at, spring, ends))
        };
        springs.iter().map(row).unzip()
    }

    /// The image of a point of the drawing: cubic interpolation between the 4 × 4 knots round it.
    pub(crate) fn point(&self, at: FlatPoint) -> ViewPoint {
        let place = (at.coords() - self.corner) / PITCH;
        let (first_column, across) = cubic(place.x, self.columns);
        let (first_row, up) = cubic(place.y, self.rows);
        let mut image = Vector2::zeros();
        for (row, share) in up.iter().enumerate() {
            for (column, other) in across.iter().enumerate() {
                image +=
                    self.knots[(first_row + row) * self.columns + first_column + column] * (share * other);
            }
        }
        image.into()
    }
}

/// Cubic Lagrange interpolation between four neighbouring knots: the first of them and their shares.
fn cubic(place: f64, count: usize) -> (usize, [f64; 4]) {
    let first = (place.floor() as isize - 1).clamp(0, count as isize - 4) as usize;
    let t = place - first as f64;
    let shares = [
        -(t - 1.0) * (t - 2.0) * (t - 3.0) / 6.0,
        t * (t - 2.0) * (t - 3.0) / 2.0,
        -t * (t - 1.0) * (t - 3.0) / 2.0,
        t * (t - 1.0) * (t - 2.0) / 6.0,
    ];
    (first, shares)
}

/// The shifts x that minimise |A x + residuals|², with the middle knot fixed and its left and right neighbours kept
/// level: conjugate gradients on the normal equations, preconditioned by their diagonal.
fn conjugate_gradients(
    springs: &[Spring],
    rows: &[[Vector2<f64>; 2]],
    residuals: &[f64],
    knots: usize,
    middle: usize,
) -> Vec<Vector2<f64>> {
    // Fixed unknowns are removed by zeroing their components in every vector; both neighbours get the mean of theirs.
    let hold = |vector: &mut Vec<Vector2<f64>>| {
        vector[middle] = Vector2::zeros();
        let level = (vector[middle - 1].y + vector[middle + 1].y) / 2.0;
        (vector[middle - 1].y, vector[middle + 1].y) = (level, level);
    };
    let transposed = |values: &[f64]| {
        let mut sum = vec![Vector2::zeros(); knots];
        for ((spring, row), value) in springs.iter().zip(rows).zip(values) {
            sum[spring.ends[0]] += row[0] * *value;
            sum[spring.ends[1]] += row[1] * *value;
        }
        hold(&mut sum);
        sum
    };
    let applied = |x: &[Vector2<f64>]| -> Vec<f64> {
        let value = |(spring, row): (&Spring, &[Vector2<f64>; 2])| {
            row[0].dot(&x[spring.ends[0]]) + row[1].dot(&x[spring.ends[1]])
        };
        springs.iter().zip(rows).map(value).collect()
    };
    let mut diagonal = vec![Vector2::repeat(1e-12); knots];
    for (spring, row) in springs.iter().zip(rows) {
        diagonal[spring.ends[0]] += row[0].component_mul(&row[0]);
        diagonal[spring.ends[1]] += row[1].component_mul(&row[1]);
    }
    let level = diagonal[middle - 1].y.max(diagonal[middle + 1].y);
    (diagonal[middle - 1].y, diagonal[middle + 1].y) = (level, level);
    let conditioned = |vector: &[Vector2<f64>]| -> Vec<Vector2<f64>> {
        vector.iter().zip(&diagonal).map(|(value, scale)| value.component_div(scale)).collect()
    };
    let dot = |a: &[Vector2<f64>], b: &[Vector2<f64>]| a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<f64>();
    let mut x = vec![Vector2::zeros(); knots];
    let mut rest: Vec<Vector2<f64>> = transposed(residuals).iter().map(|value| -value).collect();
    let mut direction = conditioned(&rest);
    let mut square = dot(&rest, &direction);
    let enough = square * 1e-12;
    for _ in 0..4000 {
        if square <= enough {
            break;
        }
        let image = transposed(&applied(&direction));
        let length = square / dot(&direction, &image);
        for ((x, rest), (step, change)) in x.iter_mut().zip(&mut rest).zip(direction.iter().zip(&image)) {
            *x += step * length;
            *rest -= change * length;
        }
        let next = conditioned(&rest);
        let following = dot(&rest, &next);
        let ratio = following / square;
        square = following;
        direction.iter_mut().zip(&next).for_each(|(old, new)| *old = new + *old * ratio);
    }
    x
}
