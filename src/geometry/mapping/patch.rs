//! The part under a drawing as points and normals, to which cylinders and cones are fitted.

use nalgebra::{DMatrix, DVector, Point3, Vector3};

use crate::geometry::space::{Extents, ViewPoint};
use crate::geometry::surface::fit::FittedSurface;

/// Maximum number of points; more would change a fit by less than a nanometre.
const MAX_POINTS: usize = 1500;
/// Minimum number of points.
const MIN_POINTS: usize = 25;
/// A fit has converged when its step is below this, mm and rad.
const CONVERGED: f64 = 1e-10;
/// Maximum number of steps.
const MAX_STEPS: usize = 30;

/// Sampled points of a part, mm, with their unit normals on the laser's side, in the frame of the view.
#[derive(Debug, Clone, PartialEq)]
pub struct SampledPatch {
    /// The points.
    pub points: Vec<Point3<f64>>,
    /// The normals.
    pub normals: Vec<Vector3<f64>>,
}

/// There are too few points of the part under the drawing.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("only {points} sampled points of the part are under the drawing")]
pub struct TooFewPoints {
    /// Number of points.
    pub points: usize,
}

impl SampledPatch {
    /// The part under the rectangle `under` of the view; a rectangle that is a single line is widened to a band.
    ///
    /// # Errors
    /// When fewer than 25 nodes of the height field are in the rectangle.
    pub fn under(surface: &FittedSurface, under: &Extents) -> Result<Self, TooFewPoints> {
        let min_side = (under.size().max() / 4.0).max(6.0 * surface.field.step());
        let under = under.grown_to(min_side);
        let nodes: Vec<(ViewPoint, f64)> = surface
            .field
            .surface_nodes()
            .map(|(column, row, height)| (surface.field.position(column, row), height))
            .filter(|(at, _)| under.contains(at.coords()))
            .collect();
        if nodes.len() < MIN_POINTS {
            return Err(TooFewPoints { points: nodes.len() });
        }
        let kept = nodes.iter().step_by(nodes.len().div_ceil(MAX_POINTS));
        let (points, normals) = kept
            .map(|(at, height)| {
                let gradient = surface.jet(*at).gradient;
                let normal = Vector3::new(-gradient.x, -gradient.y, 1.0).normalize();
                (Point3::new(at.x, at.y, *height), normal)
            })
            .unzip();
        Ok(Self { points, normals })
    }

    /// The largest distance of a point, mm, of which `distance` gives the signed one; infinite if one is not finite.
    pub(super) fn largest_distance(&self, distance: impl Fn(&Point3<f64>) -> f64) -> f64 {
        let distances = self.points.iter().map(|point| distance(point).abs());
        distances.fold(0.0, |largest, one| if one.is_finite() { one.max(largest) } else { f64::INFINITY })
    }

    /// Centre of the points, mm.
    pub fn center(&self) -> Point3<f64> {
        Point3::from(
            self.points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / self.points.len() as f64,
        )
    }

    /// Minimises the sum of the squared distances of the points from a shape with the Gauss–Newton method.
    /// `distance_of` returns the signed distance of a point and its derivatives by the shape's parameters, `moved`
    /// the shape after a step of the parameters.
    pub(super) fn fit<Shape: Copy, const PARAMETERS: usize>(
        &self,
        mut shape: Shape,
        distance_of: impl Fn(&Shape, &Point3<f64>) -> (f64, [f64; PARAMETERS]),
        moved: impl Fn(&Shape, &[f64; PARAMETERS]) -> Shape,
    ) -> Shape {
        for _ in 0..MAX_STEPS {
            let mut matrix = DMatrix::zeros(self.points.len(), PARAMETERS);
            let mut right = DVector::zeros(self.points.len());
            for (row, point) in self.points.iter().enumerate() {
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
}

/// Two unit vectors perpendicular to `axis` and to each other.
pub(super) fn cross_directions(axis: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let first = axis.cross(&if axis.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() }).normalize();
    (first, axis.cross(&first))
}
