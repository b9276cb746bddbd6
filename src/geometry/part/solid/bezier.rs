//! Rational Bézier curves and patches in homogeneous coordinates (w·x, w·y, w·z, w).

use nalgebra::{Point3, Vector3, Vector4};

/// The largest degree of a spline that is read; CAD programs write up to 25.
pub const MAX_DEGREE: usize = 30;

/// Patches of smaller degrees are evaluated in short lists.
const LOW: usize = 6;

/// A point with its weight.
pub type Weighted = Vector4<f64>;

/// A point with weight 1.
pub fn plain(point: Point3<f64>) -> Weighted {
    point.to_homogeneous()
}

/// The point of homogeneous coordinates.
pub fn projected(weighted: &Weighted) -> Point3<f64> {
    Point3::from(weighted.xyz() / weighted.w)
}

/// The values of the Bernstein polynomials of a degree at `t`.
fn bernstein(degree: usize, t: f64) -> [f64; MAX_DEGREE + 1] {
    let [_, values] = two_degrees(degree, t);
    values
}

/// The values of the Bernstein polynomials of the degree below and of this one at `t`; `degree` is less than `MOST`.
#[inline(always)]
fn two_degrees<const MOST: usize>(degree: usize, t: f64) -> [[f64; MOST]; 2] {
    let mut values = [0.0; MOST];
    values[0] = 1.0;
    let mut below = values;
    for level in 1..=degree {
        below = values;
        let mut saved = 0.0;
        for value in values.iter_mut().take(level) {
            let old = *value;
            *value = saved + (1.0 - t) * old;
            saved = t * old;
        }
        values[level] = saved;
    }
    [below, values]
}

/// A curve segment over 0 to 1.
#[derive(Debug, Clone, PartialEq)]
pub struct BezierCurve {
    /// Its control points.
    pub points: Vec<Weighted>,
}

impl BezierCurve {
    /// The point at `t`.
    pub fn point(&self, t: f64) -> Point3<f64> {
        let values = bernstein(self.points.len() - 1, t);
        let sum: Weighted = self.points.iter().zip(values).map(|(point, value)| point * value).sum();
        projected(&sum)
    }

    /// The point at `t` and its derivative by `t`.
    pub fn jet(&self, t: f64) -> (Point3<f64>, Vector3<f64>) {
        let degree = self.points.len() - 1;
        let [lower, values] = two_degrees::<{ MAX_DEGREE + 1 }>(degree, t);
        let sum: Weighted = self.points.iter().zip(values).map(|(point, value)| point * value).sum();
        let at = projected(&sum);
        if degree == 0 {
            return (at, Vector3::zeros());
        }
        let pairs = self.points.windows(2).zip(lower);
        let slope: Weighted = pairs.map(|(pair, value)| (pair[1] - pair[0]) * (value * degree as f64)).sum();
        (at, (slope.xyz() - at.coords * slope.w) / sum.w)
    }

    /// The part of the curve between two parameters (de Casteljau).
    pub fn between(&self, [from, to]: [f64; 2]) -> Self {
        let mut points = self.points.clone();
        if to < 1.0 {
            cut(&mut points, to);
        }
        if from > 0.0 {
            points.reverse();
            cut(&mut points, 1.0 - from / to);
            points.reverse();
        }
        Self { points }
    }
}

/// Leaves the control points of the part before the parameter `at`.
fn cut(points: &mut [Weighted], at: f64) {
    for level in 1..points.len() {
        for index in (level..points.len()).rev() {
            points[index] = points[index - 1] + (points[index] - points[index - 1]) * at;
        }
    }
}

/// The place of a patch, its derivatives by u and v.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jet {
    /// The point, mm.
    pub point: Point3<f64>,
    /// The derivative by u.
    pub by_u: Vector3<f64>,
    /// The derivative by v.
    pub by_v: Vector3<f64>,
}

/// A patch over the unit square.
#[derive(Debug, Clone, PartialEq)]
pub struct BezierPatch {
    /// Degrees along u and v.
    pub degree: [usize; 2],
    /// Control points; v runs fastest.
    pub points: Vec<Weighted>,
}

impl BezierPatch {
    /// The control point with these numbers along u and v.
    pub fn control(&self, i: usize, j: usize) -> &Weighted {
        &self.points[i * (self.degree[1] + 1) + j]
    }

    /// The point and the derivatives at (u, v).
    pub fn jet(&self, u: f64, v: f64) -> Jet {
        // Nearly all patches are of a low degree, and long lists cost more than what is in them.
        if self.degree.iter().all(|&degree| degree < LOW) {
            self.jet_within::<LOW>(u, v)
        } else {
            self.jet_within::<{ MAX_DEGREE + 1 }>(u, v)
        }
    }

    fn jet_within<const MOST: usize>(&self, u: f64, v: f64) -> Jet {
        let [p, q] = self.degree;
        let [lower_u, in_u] = two_degrees::<MOST>(p, u);
        let [lower_v, in_v] = two_degrees::<MOST>(q, v);
        let (mut sum, mut du, mut dv) = (Weighted::zeros(), Weighted::zeros(), Weighted::zeros());
        let mut previous = Weighted::zeros();
        for i in 0..=p {
            let row = &self.points[i * (q + 1)..(i + 1) * (q + 1)];
            let mut along = Weighted::zeros();
            let mut slope = Weighted::zeros();
            for j in 0..=q {
                along += row[j] * in_v[j];
                if j > 0 {
                    slope += (row[j] - row[j - 1]) * (lower_v[j - 1] * q as f64);
                }
            }
            sum += along * in_u[i];
            dv += slope * in_u[i];
            if i > 0 {
                du += (along - previous) * (lower_u[i - 1] * p as f64);
            }
            previous = along;
        }
        let point = projected(&sum);
        let derivative = |weighted: Weighted| (weighted.xyz() - point.coords * weighted.w) / sum.w;
        Jet { point, by_u: derivative(du), by_v: derivative(dv) }
    }

    /// The halves along u (`axis` 0) or v (`axis` 1).
    pub fn halves(&self, axis: usize) -> [Self; 2] {
        let [p, q] = self.degree;
        let (mut low, mut high) = (self.clone(), self.clone());
        let (count, lines, step, line_step) =
            if axis == 0 { (p + 1, q + 1, q + 1, 1) } else { (q + 1, p + 1, 1, q + 1) };
        let mut work = [Weighted::zeros(); MAX_DEGREE + 1];
        for line in 0..lines {
            let at = |index: usize| line * line_step + index * step;
            for (index, value) in work.iter_mut().take(count).enumerate() {
                *value = self.points[at(index)];
            }
            for level in 0..count {
                low.points[at(level)] = work[0];
                high.points[at(count - 1 - level)] = work[count - 1 - level];
                for index in 0..count - 1 - level {
                    work[index] = (work[index] + work[index + 1]) * 0.5;
                }
            }
        }
        [low, high]
    }
}

/// Why knots, degree and control points are not a spline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SplineError {
    /// The degree is zero or too high.
    #[error("the degree {0} is not from 1 to {MAX_DEGREE}")]
    Degree(usize),
    /// The number of knots does not fit.
    #[error("{knots} knots do not fit {points} control points of degree {degree}")]
    KnotCount {
        /// Number of knots.
        knots: usize,
        /// Number of control points.
        points: usize,
        /// The degree.
        degree: usize,
    },
    /// The knots descend, are not finite or span nothing.
    #[error("invalid knot vector")]
    Knots,
    /// A weight is not positive.
    #[error("a weight is not positive")]
    Weight,
    /// A coordinate is not finite.
    #[error("a control point has invalid coordinates")]
    Point,
}

/// Checks the knots of a spline with this degree and number of control points.
///
/// # Errors
/// See [`SplineError`].
pub fn check_knots(degree: usize, knots: &[f64], points: usize) -> Result<(), SplineError> {
    if degree == 0 || degree > MAX_DEGREE {
        return Err(SplineError::Degree(degree));
    }
    if points <= degree || knots.len() != points + degree + 1 {
        return Err(SplineError::KnotCount { knots: knots.len(), points, degree });
    }
    let ascend = knots.windows(2).all(|pair| pair[0] <= pair[1]) && knots.iter().all(|knot| knot.is_finite());
    if !ascend || !(knots[degree] < knots[points]) {
        return Err(SplineError::Knots);
    }
    Ok(())
}

/// Checks weighted points.
///
/// # Errors
/// See [`SplineError`].
pub fn check_points(points: &[Weighted]) -> Result<(), SplineError> {
    if points.iter().any(|point| !(point.w > 0.0 && point.w.is_finite())) {
        return Err(SplineError::Weight);
    }
    if points.iter().any(|point| !point.iter().all(|value| value.is_finite())) {
        return Err(SplineError::Point);
    }
    Ok(())
}

/// The number of the first knot of each span that is not empty.
pub fn spans(degree: usize, knots: &[f64], points: usize) -> Vec<usize> {
    (degree..points).filter(|&index| knots[index] < knots[index + 1]).collect()
}

/// The Bézier control points of the span that starts at knot `span`: the blossom of the spline at the ends of the span.
pub fn span_points(
    degree: usize,
    knots: &[f64],
    span: usize,
    point: impl Fn(usize) -> Weighted,
) -> Vec<Weighted> {
    let (a, b) = (knots[span], knots[span + 1]);
    (0..=degree)
        .map(|high| {
            let mut work: Vec<Weighted> = (0..=degree).map(|index| point(span - degree + index)).collect();
            for level in 1..=degree {
                let x = if level <= degree - high { a } else { b };
                for index in (level..=degree).rev() {
                    let first = knots[span - degree + index];
                    let last = knots[span + 1 + index - level];
                    let share = (x - first) / (last - first);
                    work[index] = work[index - 1] * (1.0 - share) + work[index] * share;
                }
            }
            work[degree]
        })
        .collect()
}
