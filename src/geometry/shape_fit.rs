//! Fits a shape to points by least squares.

use nalgebra::{DMatrix, DVector, Point3, Vector3};

/// A fit has converged when its step is below this, mm and rad.
const CONVERGED: f64 = 1e-10;
/// Maximum number of steps.
const MAX_STEPS: usize = 30;

/// Minimises the sum of the squared distances of the points from a shape with the Gauss–Newton method.
/// `distance_of` returns the signed distance of a point and its derivatives by the shape's parameters, `moved`
/// the shape after a step of the parameters.
pub(super) fn fitted<Shape: Copy, const PARAMETERS: usize>(
    points: &[Point3<f64>],
    mut shape: Shape,
    distance_of: impl Fn(&Shape, &Point3<f64>) -> (f64, [f64; PARAMETERS]),
    moved: impl Fn(&Shape, &[f64; PARAMETERS]) -> Shape,
) -> Shape {
    for _ in 0..MAX_STEPS {
        let mut matrix = DMatrix::zeros(points.len(), PARAMETERS);
        let mut right = DVector::zeros(points.len());
        for (row, point) in points.iter().enumerate() {
            let (distance, derivatives) = distance_of(&shape, point);
            derivatives.iter().enumerate().for_each(|(column, value)| matrix[(row, column)] = *value);
            right[row] = -distance;
        }
        let Some(factor) = matrix.tr_mul(&matrix).cholesky() else { break };
        let solution = factor.solve(&matrix.tr_mul(&right));
        let step: [f64; PARAMETERS] = std::array::from_fn(|index| solution[index]);
        if !step.iter().all(|value| value.is_finite()) {
            break;
        }
        shape = moved(&shape, &step);
        if solution.norm() < CONVERGED {
            break;
        }
    }
    shape
}

/// Two unit vectors perpendicular to `axis` and to each other.
pub(super) fn cross_directions(axis: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let first = axis.cross(&if axis.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() }).normalize();
    (first, axis.cross(&first))
}
