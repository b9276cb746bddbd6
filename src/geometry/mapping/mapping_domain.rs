//! The thesis' own method, for comparison: lengths along the parameter lines of a surface define a flat "mapping
//! domain", in which the drawing is placed.
//!
//! Chuang, Shape correction for laser marking, 2023, algorithms 3.2 to 3.5 and A.3 to A.10. The view and the
//! drawing's anchor replace the rearrangement of A.1; algorithm 3.3 replaces A.2 in the thesis itself. The parameter
//! lines are laid out at right angles, although on the part the angle differs from a right angle by ω with sin ω =
//! z_x·z_y / √((1 + z_x²)(1 + z_y²)): this limit of the method cannot be corrected. The printed algorithms contain
//! errors. The following are corrected here:
//!
//! - 3.3: the height of the nearest vertex was used at another place; heights are sampled where they are needed,
//! - 3.4: the range of v in line 1; loops that left the grid unless the drawing was centred,
//! - 3.5: the sign in equation 3.1, the cell found by the sign of an offset, a division by an exact zero,
//! - A.4 and A.6: one knot too many, and no basis function at u = 1,
//! - A.10: a sum that was overwritten instead of accumulated,
//! - A.3 line 10, A.5 lines 6 and 10, 3.3 lines 7 and 8, equations 2.1, 2.8, 2.15 and 2.16: indices, brackets and
//!   signs.
//!
//! The errors in [`AsPrinted`], which change the result, are corrected by default and can be kept.

use std::ops::RangeInclusive;

use nalgebra::{Matrix2, Vector2, Vector3};

use self::surface::ChordSurface;
use crate::geometry::height_field::Node;
use crate::geometry::ink::Ink;
use crate::geometry::space::{Extents, FlatPoint, ViewPoint};
use crate::geometry::surface::fit::FittedSurface;

mod surface;

/// The resolution of the mapping domain, and the errors of the thesis that are kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MappingDomainOptions {
    /// Cells of the domain along each side, at least 2; the thesis recommends 30.
    pub grid: usize,
    /// Intervals of Simpson's rule along each side of a cell, even; the thesis recommends 50.
    pub intervals: usize,
    /// Largest distance between the samples that the surface passes through, mm; the thesis has 2.
    pub sample_step: f64,
    /// Errors of the thesis that are kept.
    pub as_printed: AsPrinted,
}

impl MappingDomainOptions {
    /// Allowed values of [`Self::grid`].
    pub const GRIDS: RangeInclusive<usize> = 2..=200;
    /// Allowed values of [`Self::intervals`]; only even ones.
    pub const INTERVALS: RangeInclusive<usize> = 2..=1000;
    /// The values that the thesis recommends, with all errors corrected.
    pub const THESIS: Self =
        Self { grid: 30, intervals: 50, sample_step: 2.0, as_printed: AsPrinted::NOTHING };
}

/// Errors of the printed algorithms that change the result and can be kept to study their effect.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct AsPrinted {
    /// A.10 line 6: Simpson's weights are swapped, so that with s intervals every length is too short by 2/(3s).
    pub simpson_weights: bool,
    /// 3.4 lines 18 to 29: lengths are added up along diagonals instead of rows and columns.
    pub diagonal_sums: bool,
    /// A.8: every row and column has its own knots, which bends the parameter lines; rows are assumed to be at v =
    /// j/n, and derivatives ignore that the knots vary.
    pub knot_vectors: bool,
}

impl AsPrinted {
    /// Everything corrected.
    pub const NOTHING: Self = Self { simpson_weights: false, diagonal_sums: false, knot_vectors: false };
    /// Only Simpson's weights as printed.
    pub const SIMPSON: Self = Self { simpson_weights: true, ..Self::NOTHING };
    /// Everything as printed.
    pub const EVERYTHING: Self = Self { simpson_weights: true, diagonal_sums: true, knot_vectors: true };
}

/// Why no mapping domain was found for a drawing.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MappingDomainError {
    /// The drawing does not fit into the domain.
    #[error("the point ({:.2}, {:.2}) mm of the placed drawing is outside the mapping domain: x from {:.1} to {:.1} \
        mm, y from {:.1} to {:.1} mm", at.x, at.y, domain.min.x, domain.max.x, domain.min.y, domain.max.y)]
    Outside {
        /// The first point of the ink that is outside.
        at: FlatPoint,
        /// The bounding rectangle of the domain.
        domain: Extents,
    },
    /// The anchor was not found on the interpolated surface.
    #[error("the interpolated surface does not reach the anchor at ({:.2}, {:.2}) mm", at.x, at.y)]
    AnchorNotMet {
        /// Position of the anchor.
        at: ViewPoint,
    },
}

/// The mapping domain of a surface about an anchor: from the drawing to the view.
#[derive(Debug, Clone, PartialEq)]
pub struct MappingDomainMap {
    /// The options it was made with.
    pub options: MappingDomainOptions,
    surface: ChordSurface,
    /// Positions in the drawing of the nodes of the uniform grid over the parameters, row by row, mm.
    nodes: Vec<Vector2<f64>>,
    /// The cell that contains the anchor.
    start: [usize; 2],
}

/// Maximum number of samples along a side of the scanning area; larger areas are sampled more coarsely.
const MAX_SAMPLES: f64 = 400.0;
/// Minimum number of samples along a side.
const MIN_SAMPLES: f64 = 12.0;
/// A point this far outside a cell, in cells, is still treated as inside.
const ON_BORDER: f64 = 1e-9;

impl MappingDomainMap {
    /// Makes the domain for the ink of a placed drawing. `anchor` keeps its place in the view, and its column and row
    /// of the domain are the axes.
    ///
    /// # Errors
    /// When the drawing extends beyond the domain; see [`MappingDomainError`].
    pub fn find(
        part: &FittedSurface,
        ink: &Ink,
        anchor: FlatPoint,
        options: &MappingDomainOptions,
    ) -> Result<Self, MappingDomainError> {
        let (samples, columns) = zero_padded(part, anchor, options.sample_step);
        let surface = ChordSurface::through(&samples, columns, options.as_printed.knot_vectors);
        let mut map = Self { options: *options, surface, nodes: Vec::new(), start: [0; 2] };
        let place = map.parameters_of(anchor)?;
        let grid = options.grid as f64;
        let cell = |parameter: f64| ((parameter * grid) as usize).min(options.grid - 1);
        map.start = [cell(place.x), cell(place.y)];
        map.lay_out((place.y * grid).round() as usize);
        let shift = anchor.coords() - map.drawn(place);
        map.nodes.iter_mut().for_each(|node| *node += shift);
        let ends = ink.pieces.iter().flat_map(|piece| [piece.from, piece.to]);
        let mut samples = ends.chain(ink.squares.iter().chain(&ink.dots).copied());
        let inside = -ON_BORDER..=1.0 + ON_BORDER;
        match samples.find(|at| !map.invert(*at).iter().all(|parameter| inside.contains(parameter))) {
            Some(at) => {
                Err(MappingDomainError::Outside { at, domain: Extents::of(map.nodes.iter().copied()) })
            }
            None => Ok(map),
        }
    }

    /// The image of a point of the drawing in the view; outside the domain, extrapolated linearly from its border.
    pub fn point(&self, at: FlatPoint) -> ViewPoint {
        let place = self.invert(at);
        let inside = place.map(|parameter| parameter.clamp(0.0, 1.0));
        let seen = self.surface.at(inside.x, inside.y);
        let beyond = place - inside;
        (seen.point + seen.by_u * beyond.x + seen.by_v * beyond.y).xy().into()
    }

    /// The parameters of the surface under a point of the view, by Newton's method.
    fn parameters_of(&self, at: FlatPoint) -> Result<Vector2<f64>, MappingDomainError> {
        let mut place = Vector2::new(0.5, 0.5);
        for _ in 0..100 {
            let seen = self.surface.at(place.x, place.y);
            let rest = at.coords() - seen.point.xy();
            if rest.norm() < 1e-9 {
                return Ok(place);
            }
            let Some(inverse) = Matrix2::from_columns(&[seen.by_u.xy(), seen.by_v.xy()]).try_inverse() else {
                break;
            };
            // Derivatives as printed are not exactly those of the surface, and the knots jump, so steps are shortened.
            let step = inverse * rest;
            let fraction = (0.1 / step.norm()).min(if rest.norm() > 1e-3 { 0.7 } else { 1.0 });
            place = (place + step * fraction).map(|parameter| parameter.clamp(0.0, 1.0));
        }
        Err(MappingDomainError::AnchorNotMet { at: at.coords().into() })
    }

    /// Lays out the nodes by the lengths between them (algorithm 3.4): the middle column and the row `axis` are
    /// straight.
    fn lay_out(&mut self, axis: usize) {
        let cells = self.options.grid;
        let (side, middle) = (cells + 1, cells / 2);
        let at = |index: usize| index as f64 / cells as f64;
        let mut along_u = vec![0.0; side * side];
        let mut along_v = vec![0.0; side * side];
        for row in 0..side {
            for column in 0..side {
                let from = [at(column), at(row)];
                if column < cells {
                    along_u[row * side + column] = self.length(from, [at(column + 1), at(row)]);
                }
                if row < cells {
                    along_v[row * side + column] = self.length(from, [at(column), at(row + 1)]);
                }
            }
        }
        // Signed length from one node to another in the same row or column.
        let length_u = |row: usize, from: usize, to: usize| {
            let sum = |low: usize, high: usize| (low..high).map(|c| along_u[row * side + c]).sum::<f64>();
            if from <= to { sum(from, to) } else { -sum(to, from) }
        };
        let length_v = |column: usize, from: usize, to: usize| {
            let sum = |low: usize, high: usize| (low..high).map(|r| along_v[r * side + column]).sum::<f64>();
            if from <= to { sum(from, to) } else { -sum(to, from) }
        };
        let axis_height = length_v(middle, middle, axis);
        let node = |index: usize| {
            let (column, row) = (index % side, index / side);
            if !self.options.as_printed.diagonal_sums {
                return Vector2::new(
                    length_u(row, middle, column),
                    axis_height + length_v(column, axis, row),
                );
            }
            // Starting from the axes, each node adds the lengths of its own row and column to its diagonal neighbour.
            let (right, up) = (column.abs_diff(middle), row.abs_diff(axis));
            let steps = right.min(up);
            let back = |from: usize, towards: usize, by: usize| {
                if from < towards { from + by } else { from - by }
            };
            let (mut x, mut y) = (0.0, axis_height);
            let (first_column, first_row) = (back(column, middle, steps), back(row, axis, steps));
            if up <= right {
                x += length_u(axis, middle, first_column);
            } else {
                y += length_v(middle, axis, first_row);
            }
            for step in 0..steps {
                let (c, r) = (back(column, middle, step), back(row, axis, step));
                x += length_u(r, back(c, middle, 1), c);
                y += length_v(c, back(r, axis, 1), r);
            }
            Vector2::new(x, y)
        };
        self.nodes = (0..side * side).map(node).collect();
    }

    /// Length of a straight line in the parameters, mm, by Simpson's rule over the square root of the first fundamental
    /// form (equations 2.18 and 2.19, algorithms A.9 and A.10).
    fn length(&self, from: [f64; 2], to: [f64; 2]) -> f64 {
        let intervals = self.options.intervals;
        let (du, dv) = (to[0] - from[0], to[1] - from[1]);
        let speed = |index: usize| {
            let t = index as f64 / intervals as f64;
            let seen = self.surface.at(from[0] + t * du, from[1] + t * dv);
            (seen.by_u * du + seen.by_v * dv).norm()
        };
        let (odd, even) = if self.options.as_printed.simpson_weights { (2.0, 4.0) } else { (4.0, 2.0) };
        let inner = (1..intervals).map(|index| if index % 2 == 1 { odd } else { even } * speed(index));
        (speed(0) + inner.sum::<f64>() + speed(intervals)) / (3 * intervals) as f64
    }

    fn cell(&self, [column, row]: [usize; 2]) -> [Vector2<f64>; 4] {
        let side = self.options.grid + 1;
        let lower = row * side + column;
        [lower, lower + 1, lower + side, lower + side + 1].map(|index| self.nodes[index])
    }

    /// The point of the drawing for a pair of parameters.
    fn drawn(&self, place: Vector2<f64>) -> Vector2<f64> {
        let scaled = place * self.options.grid as f64;
        let index = scaled.map(|value| (value as usize).min(self.options.grid - 1));
        let local = scaled - index.map(|value| value as f64);
        let [a, b, c, d] = self.cell(index.into());
        a.lerp(&b, local.x).lerp(&c.lerp(&d, local.x), local.y)
    }

    /// The parameters of a point of the drawing: moves from cell to cell towards it, then inverts the bilinear map
    /// there (algorithm 3.5). Outside the domain the border cell is extrapolated.
    fn invert(&self, at: FlatPoint) -> Vector2<f64> {
        let last = (self.options.grid - 1) as f64;
        let mut cell = self.start;
        let mut local = inverse_bilinear(&self.cell(cell), at);
        for _ in 0..4 * self.options.grid {
            let onwards = |index: usize, place: f64| {
                let steps = if (-ON_BORDER..=1.0 + ON_BORDER).contains(&place) { 0.0 } else { place.floor() };
                (index as f64 + steps.clamp(-2.0, 2.0)).clamp(0.0, last) as usize
            };
            let next = [onwards(cell[0], local.x), onwards(cell[1], local.y)];
            if next == cell {
                break;
            }
            cell = next;
            local = inverse_bilinear(&self.cell(cell), at);
        }
        (Vector2::new(cell[0] as f64, cell[1] as f64) + local) / self.options.grid as f64
    }
}

/// The heights of the scanning area (algorithm 3.3), row by row, and the number of columns: the part as the laser
/// sees it, centred on the anchor's column, and "zero" outside the part. Here "zero" is the lowest height seen; in
/// the thesis it is the table.
fn zero_padded(part: &FittedSurface, anchor: FlatPoint, largest_step: f64) -> (Vec<Vector3<f64>>, usize) {
    let field = &part.field;
    let seen = |node: &Node| match node {
        Node::Empty => None,
        Node::Wall(height) | Node::Surface(height) => Some(*height),
    };
    let (field_columns, _) = field.size();
    let nodes = field.nodes().iter().enumerate().filter_map(|(index, node)| Some((index, seen(node)?)));
    let mut floor = f64::INFINITY;
    let mut covered = Extents::EMPTY;
    for (index, height) in nodes {
        floor = floor.min(height);
        covered.include(field.position(index % field_columns, index / field_columns).coords());
    }
    let reach = (covered.max.x - anchor.x).max(anchor.x - covered.min.x).max(0.0);
    let (half, middle) = (Vector2::new(reach, covered.size().y / 2.0), covered.center().y);
    let step = largest_step.min(2.0 * half.min() / MIN_SAMPLES).max(2.0 * half.max() / MAX_SAMPLES);
    // One more sample on every side is on the table.
    let count = half.map(|half| (half / step).ceil() as usize + 1);
    let height = |at: ViewPoint| {
        part.sampled_height(at).or_else(|| {
            let (column, row, place) = field.cell(at)?;
            let nearest = [place.x, place.y].map(|place| usize::from(place > 0.5));
            seen(&field.nodes()[field.cell_nodes(column, row)[nearest[0] + 2 * nearest[1]]])
        })
    };
    let columns = 2 * count.x + 1;
    let sample = |index: usize| {
        let steps = Vector2::new(
            (index % columns) as f64 - count.x as f64,
            (index / columns) as f64 - count.y as f64,
        );
        let at = Vector2::new(anchor.x, middle) + steps * step;
        Vector3::new(at.x, at.y, height(at.into()).unwrap_or(floor))
    };
    ((0..columns * (2 * count.y + 1)).map(sample).collect(), columns)
}

/// The place in a cell (corners lower left, lower right, upper left, upper right) whose bilinear image is `at`; 0 to
/// 1 inside. Of two solutions, the one nearer to the cell's middle is returned; for a cell that folds over, the place
/// nearest to the fold.
fn inverse_bilinear([a, b, c, d]: &[Vector2<f64>; 4], at: FlatPoint) -> Vector2<f64> {
    let (h, e, f, g) = (at.coords() - a, b - a, c - a, a - b + d - c);
    let (k2, k1, k0) = (g.perp(&f), e.perp(&f) + h.perp(&g), h.perp(&e));
    // k2·y² + k1·y + k0 = 0, solved without dividing by a vanishing k2 (Press et al., Numerical Recipes, 2007,
    // section 5.6).
    let root = (k1 * k1 - 4.0 * k0 * k2).max(0.0).sqrt();
    let q = -0.5 * (k1 + root.copysign(k1));
    let off_middle = |y: &f64| if y.is_finite() { (y - 0.5).abs() } else { f64::INFINITY };
    let y = if off_middle(&(k0 / q)) <= off_middle(&(q / k2)) { k0 / q } else { q / k2 };
    let (along, rest) = (e + g * y, h - f * y);
    Vector2::new(rest.dot(&along) / along.norm_squared(), y)
}
