//! The surface of the thesis: bicubic, through a grid of samples, with chord-length parameters. It is used only here:
//! the zeros outside the part make it oscillate, and knots that differ from row to row bend its parameter lines.

use nalgebra::Vector3;

use crate::geometry::surface::knots::DEGREE;

/// A surface S(u, v) over 0 ≤ u, v ≤ 1 whose knots may vary with the other parameter (algorithm 3.2).
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ChordSurface {
    columns: usize,
    /// Row by row, mm.
    control: Vec<Vector3<f64>>,
    /// Knots for u of each row, and for v of each column.
    along_u: Vec<Vec<f64>>,
    along_v: Vec<Vec<f64>>,
}

/// A point of the surface with its derivatives by the parameters, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SurfacePoint {
    pub(super) point: Vector3<f64>,
    pub(super) by_u: Vector3<f64>,
    pub(super) by_v: Vector3<f64>,
}

/// The four nonzero basis functions of a span, and their derivatives.
struct SpanBasis {
    first: usize,
    value: [f64; 4],
    slope: [f64; 4],
}

impl ChordSurface {
    /// The surface through `samples` (row by row, mm, at least four rows and columns, no two neighbours equal).
    ///
    /// Rows are interpolated first, then the columns of their control points (algorithms A.3, A.4 and A.5). All rows
    /// use the mean of their parameters, and so do all columns (Piegl & Tiller, The NURBS Book, 1997, algorithms A9.3
    /// and A9.4). So the parameter lines of samples in straight rows are straight, and across a cylinder they still
    /// follow the arc. With `as_printed`, each row and column keeps its own parameters, and the knots between two of
    /// them are interpolated as in algorithm A.8: rows are assumed to be at v = j/n, and derivatives ignore that the
    /// knots vary.
    pub(super) fn through(samples: &[Vector3<f64>], columns: usize, as_printed: bool) -> Self {
        let rows = samples.len() / columns;
        let mut in_rows: Vec<_> =
            samples.chunks_exact(columns).map(|row| chord_parameters(row.iter())).collect();
        let mut in_columns: Vec<_> =
            (0..columns).map(|column| chord_parameters(samples[column..].iter().step_by(columns))).collect();
        if !as_printed {
            average(&mut in_rows);
            average(&mut in_columns);
        }
        let knots =
            |slices: &[Vec<f64>]| slices.iter().map(|slice| averaged_knots(slice)).collect::<Vec<_>>();
        let (along_u, along_v) = (knots(&in_rows), knots(&in_columns));
        let mut control = samples.to_vec();
        for (row, line) in control.chunks_exact_mut(columns).enumerate() {
            interpolate(line, &in_rows[row], &along_u[row]);
        }
        for column in 0..columns {
            let mut line: Vec<_> = (0..rows).map(|row| control[row * columns + column]).collect();
            interpolate(&mut line, &in_columns[column], &along_v[column]);
            line.into_iter().enumerate().for_each(|(row, point)| control[row * columns + column] = point);
        }
        Self { columns, control, along_u, along_v }
    }

    /// Point and derivatives (algorithms 3.2 and A.6 to A.8, equations 2.15 and 2.16; the weights are 1, so the
    /// rational functions are the products of the basis functions). Parameters outside 0 to 1 are clamped.
    pub(super) fn at(&self, u: f64, v: f64) -> SurfacePoint {
        let (u, v) = (u.clamp(0.0, 1.0), v.clamp(0.0, 1.0));
        let (in_u, in_v) = (basis_between(&self.along_u, u, v), basis_between(&self.along_v, v, u));
        let zero = Vector3::zeros();
        let mut sum = SurfacePoint { point: zero, by_u: zero, by_v: zero };
        for row in 0..4 {
            let start = (in_v.first + row) * self.columns + in_u.first;
            for (column, control) in self.control[start..start + 4].iter().enumerate() {
                sum.point += control * (in_u.value[column] * in_v.value[row]);
                sum.by_u += control * (in_u.slope[column] * in_v.value[row]);
                sum.by_v += control * (in_u.value[column] * in_v.slope[row]);
            }
        }
        sum
    }
}

/// Replaces the parameters of every slice by their means over all slices.
fn average(slices: &mut [Vec<f64>]) {
    let count = slices.len() as f64;
    let mean: Vec<f64> = (0..slices[0].len())
        .map(|index| slices.iter().map(|slice| slice[index]).sum::<f64>() / count)
        .collect();
    slices.iter_mut().for_each(|slice| slice.clone_from(&mean));
}

/// Cumulative chord lengths, with a total of 1 (equation 2.4, algorithm A.3).
fn chord_parameters<'a>(points: impl Iterator<Item = &'a Vector3<f64>> + Clone) -> Vec<f64> {
    let mut way = 0.0;
    let chords = points.clone().zip(points.skip(1)).map(|(from, to)| {
        way += (to - from).norm();
        way
    });
    let parameters: Vec<f64> = std::iter::once(0.0).chain(chords).collect();
    parameters.into_iter().map(|parameter| parameter / way).collect()
}

/// Clamped knots; the inner knots are means of three neighbouring parameters (equation 2.3, algorithm A.4, with
/// i = 1 … m − p, as in figure 2.8 of the thesis).
fn averaged_knots(parameters: &[f64]) -> Vec<f64> {
    let inner = parameters[1..parameters.len() - 1].windows(DEGREE);
    let inner = inner.map(|window| window.iter().sum::<f64>() / DEGREE as f64);
    std::iter::repeat_n(0.0, DEGREE + 1).chain(inner).chain(std::iter::repeat_n(1.0, DEGREE + 1)).collect()
}

/// Replaces points by the control points of the cubic spline that passes through them at `parameters` (algorithm A.5).
///
/// The matrix is totally positive with four values per row, so banded elimination without pivoting is stable (de Boor
/// & Pinkus, Backward error analysis for totally positive linear systems, 1977).
fn interpolate(line: &mut [Vector3<f64>], parameters: &[f64], knots: &[f64]) {
    let count = line.len();
    let mut band = vec![[0.0; 2 * DEGREE + 1]; count];
    for (row, &parameter) in parameters.iter().enumerate() {
        let SpanBasis { first, value, .. } = basis(parameter, count, |index| knots[index]);
        for (local, value) in value.into_iter().enumerate() {
            // With averaged knots, the row's own basis function is nonzero at its parameter (Schoenberg & Whitney).
            if let Some(cell) =
                (first + local + DEGREE).checked_sub(row).and_then(|place| band[row].get_mut(place))
            {
                *cell = value;
            }
        }
    }
    for pivot in 0..count {
        for row in pivot + 1..(pivot + DEGREE + 1).min(count) {
            let factor = band[row][DEGREE + pivot - row] / band[pivot][DEGREE];
            for ahead in 0..=DEGREE {
                band[row][DEGREE + pivot + ahead - row] -= factor * band[pivot][DEGREE + ahead];
            }
            let known = line[pivot];
            line[row] -= known * factor;
        }
    }
    for row in (0..count).rev() {
        for ahead in 1..=DEGREE.min(count - 1 - row) {
            let known = line[row + ahead];
            line[row] -= known * band[row][DEGREE + ahead];
        }
        line[row] /= band[row][DEGREE];
    }
}

/// The basis at a parameter, with knots interpolated between the two slices next to the other parameter (algorithm
/// A.8).
fn basis_between(slices: &[Vec<f64>], own: f64, other: f64) -> SpanBasis {
    let place = other * (slices.len() - 1) as f64;
    let below = (place as usize).min(slices.len() - 2);
    let (low, high, share) = (&slices[below], &slices[below + 1], place - below as f64);
    basis(own, low.len() - DEGREE - 1, |index| low[index] + (high[index] - low[index]) * share)
}

/// The basis at a parameter for `count` control points (algorithm A.6 and equation 2.12; The NURBS Book, algorithms
/// A2.1 and A2.2). The last span is closed.
fn basis(parameter: f64, count: usize, knot: impl Fn(usize) -> f64) -> SpanBasis {
    let (mut span, mut end) = (DEGREE, count);
    while end - span > 1 {
        let middle = (span + end) / 2;
        if knot(middle) <= parameter { span = middle } else { end = middle }
    }
    let (mut value, mut slope) = ([1.0, 0.0, 0.0, 0.0], [0.0; 4]);
    for degree in 1..=DEGREE {
        let mut saved = 0.0;
        slope = [0.0; 4];
        for index in 0..degree {
            let (left, right) = (knot(span + 1 + index - degree), knot(span + 1 + index));
            let share = value[index] / (right - left);
            value[index] = saved + (right - parameter) * share;
            saved = (parameter - left) * share;
            slope[index] -= degree as f64 * share;
            slope[index + 1] += degree as f64 * share;
        }
        value[degree] = saved;
    }
    SpanBasis { first: span - DEGREE, value, slope }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wavy(columns: usize, rows: usize) -> Vec<Vector3<f64>> {
        let at = |index: usize| {
            let (x, y) = ((index % columns) as f64, (index / columns) as f64);
            Vector3::new(x, y, (0.5 * x).sin() * (0.4 * y).cos())
        };
        (0..columns * rows).map(at).collect()
    }

    #[test]
    fn the_surface_passes_through_its_samples_at_their_chord_parameters() {
        // All rows are equal, so they have the same knots and the surface passes through every sample.
        let samples: Vec<_> =
            wavy(9, 7).into_iter().map(|p| Vector3::new(p.x, p.y, (0.5 * p.x).sin())).collect();
        let surface = ChordSurface::through(&samples, 9, false);
        let parameters = chord_parameters(samples[..9].iter());
        assert_eq!((parameters[0], parameters[8]), (0.0, 1.0));
        for (index, sample) in samples.iter().enumerate() {
            let found = surface.at(parameters[index % 9], (index / 9) as f64 / 6.0).point;
            assert!((found - sample).norm() < 1e-12, "{found} for {sample}");
        }
    }

    #[test]
    fn averaged_knots_give_straight_parameter_lines_and_exact_derivatives() {
        let samples = wavy(12, 10);
        let (corrected, printed) =
            (ChordSurface::through(&samples, 12, false), ChordSurface::through(&samples, 12, true));
        // The deviation of a parameter line from a straight line, and the error of the derivatives.
        let errors = |surface: &ChordSurface| {
            let h = 1e-6;
            let (mut bend, mut slope) = (0.0f64, 0.0f64);
            for (u, v) in [(0.21, 0.33), (0.52, 0.47), (0.77, 0.81)] {
                let seen = surface.at(u, v);
                let by_u = (surface.at(u + h, v).point - surface.at(u - h, v).point) / (2.0 * h);
                let by_v = (surface.at(u, v + h).point - surface.at(u, v - h).point) / (2.0 * h);
                slope = slope.max((seen.by_u - by_u).norm()).max((seen.by_v - by_v).norm());
                bend = bend.max((seen.point.x - surface.at(u, 0.1).point.x).abs());
            }
            (bend, slope)
        };
        let ((bend, slope), (printed_bend, printed_slope)) = (errors(&corrected), errors(&printed));
        assert!(bend < 1e-12 && slope < 1e-6, "{bend} {slope}");
        assert!(printed_bend > 1e-2 && printed_slope > 1e-2, "{printed_bend} {printed_slope}");
    }
}
