//! The fitted surface: a bicubic B-spline whose x and y are its parameters.

use std::ops::Range;

use nalgebra::{Matrix2, Point3, Vector2};

use super::knots::{Basis, DEGREE, UniformKnots};
use crate::geometry::space::{Extents, ViewPoint};

/// A tensor-product cubic NURBS surface with unit weights over the view, z = f(x, y), in mm.
///
/// Its control points are at the Greville abscissae, so the parameters are x and y themselves (Piegl & Tiller, The
/// NURBS Book, 1997, eq. 3.11).
#[derive(Debug, Clone, PartialEq)]
pub struct NurbsSurface {
    knots_x: UniformKnots,
    knots_y: UniformKnots,
    heights: Vec<f64>,
}

/// Height, slope and curvature of a surface at a point of the view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceJet {
    /// Height z, mm.
    pub height: f64,
    /// (∂z/∂x, ∂z/∂y), no unit.
    pub gradient: Vector2<f64>,
    /// Second derivatives, 1/mm.
    pub hessian: Matrix2<f64>,
}

impl NurbsSurface {
    /// The surface with the given control heights (mm), row by row; `None` unless there is one finite height for each
    /// control point.
    pub fn new(knots_x: UniformKnots, knots_y: UniformKnots, heights: Vec<f64>) -> Option<Self> {
        let expected = knots_x.control_points() * knots_y.control_points();
        (heights.len() == expected && heights.iter().all(|height| height.is_finite())).then_some(Self {
            knots_x,
            knots_y,
            heights,
        })
    }

    /// The same surface with every span halved.
    pub fn halved(&self) -> Self {
        let heights = self.knots_x.halved_net(&self.heights);
        Self { knots_x: self.knots_x.halved(), knots_y: self.knots_y.halved(), heights }
    }

    /// The same surface over some of its spans only; `None` unless it has them.
    pub(super) fn cropped(&self, spans: &[Range<usize>; 2]) -> Option<Self> {
        let (x, y) = (self.knots_x.cropped(&spans[0])?, self.knots_y.cropped(&spans[1])?);
        let columns = self.knots_x.control_points();
        let rows = self.heights.chunks_exact(columns).skip(spans[1].start).take(y.control_points());
        let heights = rows.flat_map(|row| &row[spans[0].start..][..x.control_points()]).copied();
        Some(Self { knots_x: x, knots_y: y, heights: heights.collect() })
    }

    /// Takes the control heights of the spans `core` from another surface with spans of the same length. The spans of both are
    /// counted from the same place: those of this one are `spans`, those of the other one begin with `first`.
    pub(super) fn replace(
        &mut self,
        spans: &[Range<usize>; 2],
        other: &Self,
        first: [usize; 2],
        core: &[Range<usize>; 2],
    ) {
        let points = |axis: usize| {
            let (own, core) = (&spans[axis], &core[axis]);
            own.start.max(core.start)..(own.end + DEGREE).min(core.end + DEGREE)
        };
        let (across, up) = (points(0), points(1));
        if across.is_empty() {
            return;
        }
        let [columns, others] = [self.knots_x, other.knots_x].map(|knots| knots.control_points());
        for row in up {
            let to = (row - spans[1].start) * columns + across.start - spans[0].start;
            let from = (row - first[1]) * others + across.start - first[0];
            self.heights[to..to + across.len()].copy_from_slice(&other.heights[from..from + across.len()]);
        }
    }

    /// The surface with its control heights changed by `steps`, mm, row by row.
    pub(super) fn moved(mut self, steps: impl IntoIterator<Item = f64>) -> Self {
        self.heights.iter_mut().zip(steps).for_each(|(height, step)| *height += step);
        self
    }

    /// Knots along x and along y.
    pub fn knots(&self) -> (UniformKnots, UniformKnots) {
        (self.knots_x, self.knots_y)
    }

    /// Control heights, mm, row by row.
    pub fn heights(&self) -> &[f64] {
        &self.heights
    }

    /// The control net, mm, row by row.
    pub fn control_net(&self) -> Vec<Point3<f64>> {
        let columns = self.knots_x.control_points();
        let points = self.heights.iter().enumerate().map(|(index, &height)| {
            Point3::new(
                self.knots_x.greville(index % columns),
                self.knots_y.greville(index / columns),
                height,
            )
        });
        points.collect()
    }

    /// The control net of the same surface with clamped knots, mm, row by row: the corner points lie on the surface.
    /// The first and the last knot have multiplicity four, all others one; see [`UniformKnots::clamped`].
    pub fn clamped_net(&self) -> Vec<Point3<f64>> {
        let (columns, rows) = (self.knots_x.control_points(), self.knots_y.control_points());
        let abscissae = |knots: UniformKnots| {
            let greville: Vec<f64> = (0..knots.control_points()).map(|index| knots.greville(index)).collect();
            knots.clamped(&greville)
        };
        let (across, upwards) = (abscissae(self.knots_x), abscissae(self.knots_y));
        let mut net: Vec<Point3<f64>> = Vec::with_capacity(columns * rows);
        for (row, y) in self.heights.chunks_exact(columns).zip(&upwards) {
            let heights = self.knots_x.clamped(row);
            net.extend(heights.into_iter().zip(&across).map(|(z, x)| Point3::new(*x, *y, z)));
        }
        for column in 0..columns {
            let line: Vec<f64> = net.iter().skip(column).step_by(columns).map(|point| point.z).collect();
            let clamped = self.knots_y.clamped(&line);
            net.iter_mut().skip(column).step_by(columns).zip(clamped).for_each(|(point, z)| point.z = z);
        }
        net
    }

    /// The rectangle over which the surface is defined, mm.
    pub fn domain(&self) -> Extents {
        Extents {
            min: Vector2::new(self.knots_x.start(), self.knots_y.start()),
            max: Vector2::new(self.knots_x.end(), self.knots_y.end()),
        }
    }

    /// Height at a point of the view, mm; outside the domain the border polynomials are extrapolated.
    pub fn height(&self, at: ViewPoint) -> f64 {
        let (x, y) = (self.knots_x.basis(at.x), self.knots_y.basis(at.y));
        self.lines(&x, &y).zip(&y.value).map(|(line, weight)| weight * Self::along(line, &x.value)).sum()
    }

    /// Heights at every pair of `xs` and `ys`, mm, row by row: the same as [`height`](Self::height), in less time.
    pub fn heights_over(&self, xs: &[f64], ys: &[f64]) -> Vec<f64> {
        let mut heights = Vec::with_capacity(xs.len() * ys.len());
        self.for_each_row(xs, ys, |_, row| heights.extend_from_slice(row));
        heights
    }

    /// Calls `take` with the number of each of `ys` and the heights, mm, at all of `xs` there.
    pub(super) fn for_each_row(&self, xs: &[f64], ys: &[f64], mut take: impl FnMut(usize, &[f64])) {
        let columns = self.knots_x.control_points();
        let along: Vec<Basis> = xs.iter().map(|&x| self.knots_x.basis(x)).collect();
        let mut heights = vec![0.0; xs.len()];
        let mut line = vec![0.0; columns];
        for (row, &y) in ys.iter().enumerate() {
            let y = self.knots_y.basis(y);
            let [a, b, c, d] = [0, 1, 2, 3].map(|row| &self.heights[(y.first + row) * columns..][..columns]);
            for (column, sum) in line.iter_mut().enumerate() {
                *sum = (y.value[0] * a[column] + y.value[1] * b[column])
                    + (y.value[2] * c[column] + y.value[3] * d[column]);
            }
            for (height, x) in heights.iter_mut().zip(&along) {
                *height = Self::along(&line[x.first..x.first + 4], &x.value);
            }
            take(row, &heights);
        }
    }

    /// Height, gradient and second derivatives at a point of the view; outside the domain the border polynomials are
    /// extrapolated (Piegl & Tiller, The NURBS Book, 1997, algorithm A3.6).
    ///
    /// ```
    /// use isomark_geometry::space::ViewPoint;
    /// use isomark_geometry::surface::knots::UniformKnots;
    /// use isomark_geometry::surface::nurbs::NurbsSurface;
    ///
    /// // Control points on the plane z = 2 + x/2 make that plane.
    /// let knots = UniformKnots::new(0.0, 5.0, 4);
    /// let count = knots.control_points();
    /// let heights = (0..count * count).map(|index| 2.0 + knots.greville(index % count) / 2.0).collect();
    /// let surface = NurbsSurface::new(knots, knots, heights).expect("one finite height for each control point");
    /// let jet = surface.jet(ViewPoint::new(10.0, 7.0));
    /// assert!((jet.height - 7.0).abs() < 1e-12);
    /// assert!((jet.gradient.x - 0.5).abs() < 1e-12 && jet.gradient.y.abs() < 1e-12);
    /// assert!(jet.gaussian_curvature().abs() < 1e-12);
    /// ```
    #[inline(always)]
    pub fn jet(&self, at: ViewPoint) -> SurfaceJet {
        let (x, y) = (self.knots_x.basis(at.x), self.knots_y.basis(at.y));
        let [mut height, mut mixed] = [0.0; 2];
        let [mut gradient, mut bend] = [Vector2::zeros(); 2];
        for (row, line) in self.lines(&x, &y).enumerate() {
            let along = |weights: &[f64; 4]| Self::along(line, weights);
            let [value, slope, bend_x] = [&x.value, &x.slope, &x.bend].map(along);
            height += y.value[row] * value;
            gradient += Vector2::new(y.value[row] * slope, y.slope[row] * value);
            bend += Vector2::new(y.value[row] * bend_x, y.bend[row] * value);
            mixed += y.slope[row] * slope;
        }
        SurfaceJet { height, gradient, hessian: Matrix2::new(bend.x, mixed, mixed, bend.y) }
    }

    /// The gradient of the height at a point of the view; outside the domain the border polynomials are extrapolated.
    pub fn gradient(&self, at: ViewPoint) -> Vector2<f64> {
        let (x, y) = (self.knots_x.basis(at.x), self.knots_y.basis(at.y));
        let mut gradient = Vector2::zeros();
        for (row, line) in self.lines(&x, &y).enumerate() {
            let [value, slope] = [&x.value, &x.slope].map(|weights| Self::along(line, weights));
            gradient += Vector2::new(y.value[row] * slope, y.slope[row] * value);
        }
        gradient
    }

    /// The heights of the 4 × 4 control points of a cell, row by row.
    fn lines<'a>(&'a self, x: &Basis, y: &Basis) -> impl Iterator<Item = &'a [f64]> {
        let columns = self.knots_x.control_points();
        let start = y.first * columns + x.first;
        (0..4).map(move |row| &self.heights[start + row * columns..start + row * columns + 4])
    }

    fn along(line: &[f64], weights: &[f64; 4]) -> f64 {
        line.iter().zip(weights).map(|(height, weight)| height * weight).sum()
    }
}

impl SurfaceJet {
    /// The first fundamental form (E, F; F, G) of the surface over the view, no unit: a step d in the view has the
    /// length √(dᵀ·I·d) on the surface (do Carmo, Differential Geometry of Curves and Surfaces, section 2-5, for a
    /// graph).
    ///
    /// ```
    /// use isomark_geometry::surface::nurbs::SurfaceJet;
    /// use nalgebra::{Matrix2, Vector2};
    ///
    /// // On a slope of 45 degrees along x, a step of 1 mm along x is √2 mm long.
    /// let slope = SurfaceJet { height: 0.0, gradient: Vector2::new(1.0, 0.0), hessian: Matrix2::zeros() };
    /// let form = slope.first_fundamental_form();
    /// let step = Vector2::new(1.0, 0.0);
    /// assert!(((step.transpose() * form * step).x.sqrt() - 2f64.sqrt()).abs() < 1e-15);
    /// assert!((form.determinant().sqrt() - 2f64.sqrt()).abs() < 1e-15);
    /// ```
    pub fn first_fundamental_form(&self) -> Matrix2<f64> {
        Matrix2::identity() + self.gradient * self.gradient.transpose()
    }

    /// Gaussian curvature, 1/mm² (do Carmo, Differential Geometry of Curves and Surfaces, section 3-3, example 5).
    pub fn gaussian_curvature(&self) -> f64 {
        self.hessian.determinant() / (1.0 + self.gradient.norm_squared()).powi(2)
    }

    /// Angle between the surface normal and the laser's axis, rad.
    pub fn tilt(&self) -> f64 {
        self.gradient.norm().atan()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quadratic_surface_is_reproduced_with_its_derivatives() {
        let knots = UniformKnots::new(-2.0, 0.5, 8);
        // The control value of x² over uniform cubic knots is ξ² − h²/3 (blossom of x² at the three inner knots).
        let square = |greville: f64| greville * greville - 0.25 / 3.0;
        let mut heights = Vec::new();
        for row in 0..knots.control_points() {
            for column in 0..knots.control_points() {
                let (x, y) = (knots.greville(column), knots.greville(row));
                heights.push(3.0 * square(x) - square(y) + 0.5 * x * y + x);
            }
        }
        let surface = NurbsSurface::new(knots, knots, heights).unwrap();
        let halved = surface.halved();
        assert_eq!(halved.knots().0.step(), 0.25);
        for (x, y) in [(-2.0, -2.0), (0.3, -1.2), (1.99, 2.0)] {
            let jet = surface.jet(ViewPoint::new(x, y));
            assert!((halved.height(ViewPoint::new(x, y)) - jet.height).abs() < 1e-12);
            assert!((jet.height - (3.0 * x * x - y * y + 0.5 * x * y + x)).abs() < 1e-12);
            let over = surface.heights_over(&[x - 1.0, x], &[y, y + 9.0]);
            assert!((over[1] - jet.height).abs() < 1e-12);
            assert!((over[2] - surface.height(ViewPoint::new(x - 1.0, y + 9.0))).abs() < 1e-9);
            assert!(
                (jet.gradient - Vector2::new(6.0 * x + 0.5 * y + 1.0, -2.0 * y + 0.5 * x)).norm() < 1e-11
            );
            assert!((jet.hessian - Matrix2::new(6.0, 0.5, 0.5, -2.0)).norm() < 1e-10);
        }
    }
}
