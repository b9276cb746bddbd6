//! The part under a drawing as points and normals, to which cylinders and cones are fitted.

use nalgebra::{Point3, Vector3};

use crate::geometry::shape_fit::{MAX_STEPS, fitted};
use crate::geometry::space::{Extents, ViewPoint};
use crate::geometry::surface::fit::FittedSurface;

/// Maximum number of points; more would change a fit by less than a nanometre.
const MAX_POINTS: usize = 1500;
/// Number of points that show where a primitive is, and where there is none.
pub(super) const FEW_POINTS: usize = 200;
/// Minimum number of points.
const MIN_POINTS: usize = 25;
/// With this many sampled points, points between samples are not needed.
const LEAST_SAMPLED: usize = 4 * MIN_POINTS;
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
        Self::sampled(surface, under, MAX_POINTS)
    }

    /// About [`FEW_POINTS`] of the points of [`Self::under`].
    pub(super) fn roughly_under(surface: &FittedSurface, under: &Extents) -> Result<Self, TooFewPoints> {
        Self::sampled(surface, under, FEW_POINTS)
    }

    fn sampled(surface: &FittedSurface, under: &Extents, most: usize) -> Result<Self, TooFewPoints> {
        let min_side = (under.size().max() / 4.0).max(6.0 * surface.field.step());
        let under = under.grown_to(min_side);
        let columns = surface.field.size().0;
        let mut nodes: Vec<(ViewPoint, f64, bool)> = surface
            .field
            .surface_nodes_about(&under)
            .map(|(column, row, height)| {
                (surface.field.position(column, row), height, surface.is_sampled(row * columns + column))
            })
            .filter(|(at, ..)| under.contains(at.coords()))
            .collect();
        // What is between samples is only near the part.
        if nodes.iter().filter(|(_, _, is_sampled)| *is_sampled).count() >= LEAST_SAMPLED {
            nodes.retain(|(_, _, is_sampled)| *is_sampled);
        }
        if nodes.len() < MIN_POINTS {
            return Err(TooFewPoints { points: nodes.len() });
        }
        let step = nodes.len().div_ceil(MAX_POINTS);
        let kept = nodes.iter().step_by(step * nodes.len().div_ceil(step * most));
        let (points, normals) = kept
            .map(|(at, height, _)| {
                let gradient = surface.jet(*at).gradient;
                let normal = Vector3::new(-gradient.x, -gradient.y, 1.0).normalize();
                (Point3::new(at.x, at.y, *height), normal)
            })
            .unzip();
        Ok(Self { points, normals })
    }

    /// Only the points for which `is_kept`, with their normals.
    pub(super) fn kept(self, is_kept: impl Fn(&Point3<f64>) -> bool) -> Self {
        let pairs = self.points.into_iter().zip(self.normals);
        let (points, normals) = pairs.filter(|(point, _)| is_kept(point)).unzip();
        Self { points, normals }
    }

    /// The largest distance of a point, mm; `distance` returns the signed distance of one. Infinite if a
    /// distance is not finite.
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

    /// The shape with the smallest sum of the squared distances of the points ([`shape_fit`](crate::geometry::shape_fit)).
    pub(super) fn fit<Shape: Copy, Distances, const PARAMETERS: usize>(
        &self,
        shape: Shape,
        distances_from: impl Fn(Shape) -> Distances,
        moved: impl Fn(&Shape, &[f64; PARAMETERS]) -> Shape,
    ) -> Shape
    where
        Distances: Fn(&Point3<f64>) -> (f64, [f64; PARAMETERS]),
    {
        fitted(MAX_STEPS, &self.points, shape, distances_from, moved)
    }
}
