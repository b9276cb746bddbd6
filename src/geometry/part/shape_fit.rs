//! Fits a shape to points by least squares.

use nalgebra::{Matrix3, Point3, SMatrix, SVector, Unit, Vector3};

/// A fit has converged when its step is below this, mm and rad.
const CONVERGED: f64 = 1e-10;
/// Maximum number of steps.
pub(crate) const MAX_STEPS: usize = 30;

/// Minimises the sum of the squared distances of the points from a shape with the Gauss–Newton method, in at
/// most `steps` steps.
/// `distances_from` returns what returns the signed distance of a point from a shape and its derivatives by the shape's parameters,
/// `moved` the shape after a step of the parameters.
pub(crate) fn fitted<Shape: Copy, Distances, const PARAMETERS: usize>(
    steps: usize,
    points: &[Point3<f64>],
    mut shape: Shape,
    distances_from: impl Fn(Shape) -> Distances,
    moved: impl Fn(&Shape, &[f64; PARAMETERS]) -> Shape,
) -> Shape
where
    Distances: Fn(&Point3<f64>) -> (f64, [f64; PARAMETERS]),
{
    for _ in 0..steps {
        let distance_of = distances_from(shape);
        let mut matrix = SMatrix::<f64, PARAMETERS, PARAMETERS>::zeros();
        let mut right = SVector::<f64, PARAMETERS>::zeros();
        for point in points {
            let (distance, derivatives) = distance_of(point);
            // The upper half of the matrix is not read.
            for column in 0..PARAMETERS {
                for row in column..PARAMETERS {
                    matrix[(row, column)] += derivatives[row] * derivatives[column];
                }
                right[column] -= derivatives[column] * distance;
            }
        }
        let Some(factor) = matrix.cholesky() else { break };
        let step = factor.solve(&right);
        if !step.iter().all(|value| value.is_finite()) {
            break;
        }
        shape = moved(&shape, &step.into());
        if step.norm() < CONVERGED {
            break;
        }
    }
    shape
}

/// The rest of movements of points along the normals of a shape, mm, after the shape is fitted to the points
/// again: the mean products of movements that no small change of its parameters causes. 0 if the points do
/// not define the shape. `derivatives_at` returns the derivatives of a point's distance from the shape by its
/// parameters.
pub(crate) fn left_after_fit<const PARAMETERS: usize, const MOVEMENTS: usize>(
    points: &[Point3<f64>],
    derivatives_at: impl Fn(&Point3<f64>) -> [f64; PARAMETERS],
    movements_at: impl Fn(&Point3<f64>) -> [f64; MOVEMENTS],
) -> SMatrix<f64, MOVEMENTS, MOVEMENTS> {
    let mut matrix = SMatrix::<f64, PARAMETERS, PARAMETERS>::zeros();
    let mut right = SMatrix::<f64, PARAMETERS, MOVEMENTS>::zeros();
    let mut all = SMatrix::<f64, MOVEMENTS, MOVEMENTS>::zeros();
    for point in points {
        let derivatives = SVector::<f64, PARAMETERS>::from(derivatives_at(point));
        let movements = SVector::<f64, MOVEMENTS>::from(movements_at(point));
        matrix += derivatives * derivatives.transpose();
        right += derivatives * movements.transpose();
        all += movements * movements.transpose();
    }
    let Some(factor) = matrix.cholesky() else { return SMatrix::zeros() };
    let left = (all - right.transpose() * factor.solve(&right)) / points.len().max(1) as f64;
    if left.iter().all(|value| value.is_finite()) { left } else { SMatrix::zeros() }
}

/// A surface is curved in two directions if its normals leave the plane or the circle in which they should turn by more than the next
/// larger spread divided by this.
pub(crate) const ONE_WAY: f64 = 3.0;

/// The direction in which vectors spread least, and the root mean squares of their parts along it and along the two directions at right
/// angles to it, in ascending order, from the mean of the products of the vectors with themselves.
pub(crate) fn principal_directions(products: &Matrix3<f64>) -> (Unit<Vector3<f64>>, [f64; 3]) {
    let eigen = products.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    let thinnest = Unit::new_normalize(eigen.eigenvectors.column(order[0]).into_owned());
    (thinnest, order.map(|index| eigen.eigenvalues[index].max(0.0).sqrt()))
}

/// Two unit vectors perpendicular to `axis` and to each other.
pub(crate) fn cross_directions(axis: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let first = axis.cross(&if axis.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() }).normalize();
    (first, axis.cross(&first))
}
