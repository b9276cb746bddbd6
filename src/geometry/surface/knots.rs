//! Knot vectors and cubic B-spline basis functions.

use std::ops::{Add, Div, Mul, Range};

/// Degree of all splines in the program.
pub const DEGREE: usize = 3;

/// A uniform cubic knot vector over an interval in mm. The spline is not clamped: all spans are alike, and control
/// points do not accumulate at the borders.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UniformKnots {
    start: f64,
    step: f64,
    spans: usize,
}

/// Values, first and second derivatives of the four nonzero basis functions at a parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Basis {
    /// Index of the first of the four control points.
    pub first: usize,
    /// Values; they sum to 1.
    pub value: [f64; 4],
    /// First derivatives, 1/mm.
    pub slope: [f64; 4],
    /// Second derivatives, 1/mm².
    pub bend: [f64; 4],
}

impl UniformKnots {
    /// `spans` spans (at least one) of length `step` mm (positive), beginning at `start` mm.
    pub fn new(start: f64, step: f64, spans: usize) -> Self {
        debug_assert!(step > 0.0 && spans > 0);
        Self { start, step, spans }
    }

    /// The same interval with twice the spans.
    pub fn halved(&self) -> Self {
        Self { start: self.start, step: self.step / 2.0, spans: self.spans * 2 }
    }

    /// Some of the spans, counted from 0; `None` if it does not have them, or if there are none.
    pub(super) fn cropped(&self, spans: &Range<usize>) -> Option<Self> {
        let is_inside = !spans.is_empty() && spans.end <= self.spans;
        is_inside.then(|| Self {
            start: self.start + self.step * spans.start as f64,
            step: self.step,
            spans: spans.len(),
        })
    }

    /// The control net, row by row, of the same surface or map with every span halved along both directions; `net` holds
    /// the control values row by row, with the control points of `self` along each row.
    ///
    /// Lane & Riesenfeld, A theoretical development for the computer generation and display of piecewise polynomial
    /// surfaces, IEEE Transactions on Pattern Analysis and Machine Intelligence 2(1), 1980, for degree 3.
    pub fn halved_net<T>(&self, net: &[T]) -> Vec<T>
    where
        T: Copy + Add<Output = T> + Mul<f64, Output = T> + Div<f64, Output = T>,
    {
        let wide: Vec<Vec<T>> = net.chunks(self.control_points()).map(halved_line).collect();
        let columns = 0..wide.first().map_or(0, Vec::len);
        let tall: Vec<Vec<T>> = columns
            .map(|column| halved_line(&wide.iter().map(|row| row[column]).collect::<Vec<T>>()))
            .collect();
        let rows = 0..tall.first().map_or(0, Vec::len);
        rows.flat_map(|row| tall.iter().map(move |line| line[row])).collect()
    }

    /// Number of control points: spans + 3.
    pub fn control_points(&self) -> usize {
        self.spans + DEGREE
    }

    /// Number of spans.
    pub fn spans(&self) -> usize {
        self.spans
    }

    /// Length of a span, mm.
    pub fn step(&self) -> f64 {
        self.step
    }

    /// Start of the first span, mm.
    pub fn start(&self) -> f64 {
        self.start
    }

    /// End of the last span, mm.
    pub fn end(&self) -> f64 {
        self.start + self.step * self.spans as f64
    }

    /// All knots, mm: including three before the first span and three after the last one.
    pub fn knots(&self) -> Vec<f64> {
        (0..self.spans + 2 * DEGREE + 1).map(|index| self.start + self.step * (index as f64 - 3.0)).collect()
    }

    /// The Greville abscissa of a control point, mm: the mean of its three inner knots. With control points at these
    /// places, the spline reproduces its own parameter (Piegl & Tiller, The NURBS Book, 1997, section 9.2).
    pub fn greville(&self, control_point: usize) -> f64 {
        self.start + self.step * (control_point as f64 - 1.0)
    }

    /// The control values of the same spline with each end knot repeated four times, as CAD programs expect it.
    /// `values` are the control values, one for each control point. Only the outer two at each end change: they are
    /// the blossom at the repeated knot (Ramshaw, Blossoms are polar forms, 1989; for the knots used here f(a, a, a)
    /// = (d₀ + 4 d₁ + d₂)/6 and f(a, a, a + h) = (2 d₁ + d₂)/3).
    ///
    /// # Panics
    /// When the number of values is not that of the control points.
    pub fn clamped(&self, values: &[f64]) -> Vec<f64> {
        assert_eq!(values.len(), self.control_points(), "one value for each control point");
        let mut clamped = values.to_vec();
        let last = values.len() - 1;
        let ends = [[0, 1, 2], [last, last - 1, last - 2]];
        for [outer, middle, inner] in ends {
            clamped[outer] = (values[outer] + 4.0 * values[middle] + values[inner]) / 6.0;
            clamped[middle] = (2.0 * values[middle] + values[inner]) / 3.0;
        }
        clamped
    }

    /// The span that contains `parameter` (mm); the first or last span for a parameter outside.
    pub fn span(&self, parameter: f64) -> usize {
        // A cast saturates, so a parameter before the start (or NaN) gives span 0.
        (((parameter - self.start) / self.step) as usize).min(self.spans - 1)
    }

    /// The basis functions at `parameter` (mm). Outside the interval the polynomials of the border spans are
    /// extrapolated.
    ///
    /// Piegl & Tiller, The NURBS Book, 1997, algorithm A2.3, written out for uniform cubic knots.
    #[inline(always)]
    pub fn basis(&self, parameter: f64) -> Basis {
        let first = self.span(parameter);
        let t = (parameter - self.start) / self.step - first as f64;
        let s = 1.0 - t;
        let (per_step, per_square) = (1.0 / self.step, 1.0 / (self.step * self.step));
        Basis {
            first,
            value: [
                s * s * s / 6.0,
                (4.0 + t * t * (3.0 * t - 6.0)) / 6.0,
                (4.0 + s * s * (3.0 * s - 6.0)) / 6.0,
                t * t * t / 6.0,
            ],
            slope: [
                -0.5 * s * s * per_step,
                t * (1.5 * t - 2.0) * per_step,
                -s * (1.5 * s - 2.0) * per_step,
                0.5 * t * t * per_step,
            ],
            bend: [
                s * per_square,
                (3.0 * t - 2.0) * per_square,
                (3.0 * s - 2.0) * per_square,
                t * per_square,
            ],
        }
    }
}

/// The control values of one spline after its spans were halved.
fn halved_line<T>(line: &[T]) -> Vec<T>
where
    T: Copy + Add<Output = T> + Mul<f64, Output = T> + Div<f64, Output = T>,
{
    let mut fine = Vec::with_capacity(2 * line.len());
    for (index, pair) in line.windows(2).enumerate() {
        if index > 0 {
            fine.push((line[index - 1] + pair[0] * 6.0 + pair[1]) / 8.0);
        }
        fine.push((pair[0] + pair[1]) / 2.0);
    }
    fine
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Cox–de Boor recursion, straight from the definition (The NURBS Book, eq. 2.5).
    fn cox_de_boor(knots: &[f64], index: usize, degree: usize, u: f64) -> f64 {
        if degree == 0 {
            return f64::from(u >= knots[index] && u < knots[index + 1]);
        }
        let left = (u - knots[index]) / (knots[index + degree] - knots[index]);
        let right = (knots[index + degree + 1] - u) / (knots[index + degree + 1] - knots[index + 1]);
        left * cox_de_boor(knots, index, degree - 1, u) + right * cox_de_boor(knots, index + 1, degree - 1, u)
    }

    proptest! {
        #[test]
        fn basis_agrees_with_its_definition_and_sums_to_one(t in 0.0..0.999_999f64, start in -9.0..9.0f64, step in 0.1..4.0f64) {
            let knots = UniformKnots::new(start, step, 5);
            let u = start + t * 5.0 * step;
            let basis = knots.basis(u);
            for (local, value) in basis.value.iter().enumerate() {
                let expected = cox_de_boor(&knots.knots(), basis.first + local, DEGREE, u);
                prop_assert!((value - expected).abs() < 1e-12);
            }
            prop_assert!((basis.value.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            let reproduced: f64 =
                basis.value.iter().enumerate().map(|(local, value)| value * knots.greville(basis.first + local)).sum();
            prop_assert!((reproduced - u).abs() < 1e-11);
        }

        #[test]
        fn derivatives_match_differences_of_the_values(t in 0.1..4.9f64) {
            let knots = UniformKnots::new(-1.0, 0.5, 5);
            let (u, h) = (-1.0 + t * 0.5, 1e-6);
            let (before, here, after) = (knots.basis(u - h), knots.basis(u), knots.basis(u + h));
            prop_assume!(before.first == after.first);
            for local in 0..4 {
                prop_assert!(((after.value[local] - before.value[local]) / (2.0 * h) - here.slope[local]).abs() < 1e-7);
                prop_assert!(((after.slope[local] - before.slope[local]) / (2.0 * h) - here.bend[local]).abs() < 1e-6);
            }
        }
    }
}
