//! The state of the art that the thesis compares with, for comparison: the part's surface is a triangle mesh, its
//! outline is mapped to the unit square, its inner vertices to convex combinations of their neighbours, and the
//! drawing is scaled into the square (Chuang, Shape correction for laser marking, 2023, section 1.2.1; Floater,
//! Parametrization and smooth approximation of surface triangulations, 1997).
//!
//! The square does not depend on the part's size, so the drawing is scaled along each side of it. In the thesis the
//! drawing fills the square; here the scales minimise the length error. The limit of the method remains: lengths differ
//! from place to place.

use std::f64::consts::{FRAC_PI_4, TAU};

use nalgebra::{Point3, Vector2, Vector3};

use crate::geometry::fork::InTurn;
use crate::geometry::ink::{Ink, Piece};
use crate::geometry::normal_equations::elimination::Elimination;
use crate::geometry::normal_equations::factor::{Couplings, Factor};
use crate::geometry::space::{Extents, FlatPoint, ViewPoint};
use crate::geometry::surface::fit::FittedSurface;

/// The weights of a vertex's neighbours.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum FloaterWeights {
    /// Equal weights, as in the thesis. The result depends on the connectivity of the mesh, hardly on the part's shape.
    #[default]
    Uniform,
    /// Mean value coordinates, which follow the angles on the part (Floater, Mean value coordinates, 2003).
    MeanValue,
}

/// Why the part could not be mapped to the square for a drawing.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FloaterError {
    /// There is no surface at the middle of the part or at the anchor.
    #[error("there is no surface at the anchor ({:.2}, {:.2}) mm", at.x, at.y)]
    NoOutline {
        /// Position of the anchor.
        at: ViewPoint,
    },
    /// The equations could not be solved.
    #[error("the {unknowns} equations of the parametrisation could not be solved")]
    Unsolved {
        /// Number of inner vertices.
        unknowns: usize,
    },
    /// The drawing does not fit into the square.
    #[error("the point ({:.2}, {:.2}) mm of the placed drawing is outside the part's square of {:.1} x {:.1} mm",
        at.x, at.y, scale.x, scale.y)]
    Outside {
        /// The first point of the ink that is outside.
        at: FlatPoint,
        /// Sides of the square in the drawing, mm.
        scale: Vector2<f64>,
    },
}

/// A part mapped to the unit square, with the place and scale of a drawing in it: from the drawing to the view.
#[derive(Debug, Clone, PartialEq)]
pub struct FloaterMap {
    /// The weights it was made with.
    pub weights: FloaterWeights,
    /// Sides of the square in the drawing, mm.
    pub scale: Vector2<f64>,
    mesh: SquareMesh,
    anchor: FlatPoint,
    /// The anchor's place in the square.
    start: Vector2<f64>,
}

/// A triangulated part with the places of its vertices in the unit square.
#[derive(Debug, Clone, PartialEq)]
struct SquareMesh {
    /// On the part, mm.
    vertices: Vec<Point3<f64>>,
    /// In the square.
    places: Vec<Vector2<f64>>,
    triangles: Vec<[usize; 3]>,
    /// A search index: the unit square is divided into `side` × `side` cells, and the triangles that overlap a cell are
    /// `found[starts[cell]..starts[cell + 1]]`.
    side: usize,
    starts: Vec<usize>,
    found: Vec<usize>,
}

/// Length of the mesh edges, mm, unless [`CELLS`] requires another one.
const EDGE: f64 = 0.75;
/// The part has this many cells along its longer side; the length of the edges ([`EDGE`]) changes if it would
/// have fewer or more.
const CELLS: std::ops::RangeInclusive<f64> = 60.0..=150.0;
/// Number of rays that find the part's outline.
const RAYS: usize = 720;
/// Number of rays on each side over which the outline is smoothed, three times.
const SMOOTHED: usize = 6;
/// The relative step of the search for the scales at the start.
const FIRST_SCALE_STEP: f64 = 0.16;
/// The search for the scales ends with a relative step of this size.
const LAST_SCALE_STEP: f64 = 1e-4;

impl FloaterMap {
    /// Maps the part to the square and the ink of a placed drawing into it; `anchor` keeps its place in the view, and
    /// the drawing's axes are those of the square.
    ///
    /// The mesh covers the whole side of the part that faces the laser, as far as rays from its middle (from the
    /// anchor, if the middle is a hole) find surface; the fit bridges holes in between. Its grid is stretched to the
    /// outline, so that squares about the middle become scaled copies of the outline, and its four corners are on the
    /// diagonals.
    ///
    /// # Errors
    /// See [`FloaterError`].
    pub fn find(
        part: &FittedSurface,
        ink: &Ink,
        anchor: FlatPoint,
        weights: FloaterWeights,
    ) -> Result<Self, FloaterError> {
        let mesh = SquareMesh::over(part, anchor, weights)?;
        let start = mesh.place_of(anchor.coords().into());
        let mut map = Self { weights, scale: Vector2::zeros(), mesh, anchor, start };
        map.scale = map.best_scale(part, ink);
        let ends = ink.pieces.iter().flat_map(|piece| [piece.from, piece.to]);
        let mut samples = ends.chain(ink.squares.iter().chain(&ink.dots).copied());
        let unit = Extents { min: Vector2::zeros(), max: Vector2::new(1.0, 1.0) };
        match samples.find(|at| !unit.grown(1e-9).contains(map.place(*at, map.scale))) {
            Some(at) => Err(FloaterError::Outside { at, scale: map.scale }),
            None => Ok(map),
        }
    }

    /// The image of a point of the drawing in the view; outside the square the nearest triangle is extrapolated.
    pub fn point(&self, at: FlatPoint) -> ViewPoint {
        self.mesh.seen(self.place(at, self.scale))
    }

    fn place(&self, at: FlatPoint, scale: Vector2<f64>) -> Vector2<f64> {
        self.start + (at - self.anchor).component_div(&scale)
    }

    /// The scales with the smallest sum of |length on the part − length drawn|. The sum has kinks everywhere, so a
    /// direct search is used: it starts with the scales that are exact at the anchor, tries steps along and across
    /// the axes, and halves them when none helps (Kolda, Lewis & Torczon, Optimization by direct search, 2003).
    fn best_scale(&self, part: &FittedSurface, ink: &Ink) -> Vector2<f64> {
        let lift = |place: Vector2<f64>| {
            let at = self.mesh.seen(place);
            Point3::new(at.x, at.y, part.nurbs.height(at))
        };
        let length_error = |scale: Vector2<f64>| -> f64 {
            let error = |piece: &Piece| {
                let [from, to] = [piece.from, piece.to].map(|end| lift(self.place(end, scale)));
                ((to - from).norm() - piece.length()).abs()
            };
            ink.pieces.iter().map(error).sum()
        };
        let side = |step: Vector2<f64>| (lift(self.start + step) - lift(self.start - step)).norm() / 0.02;
        let mut scale = Vector2::new(side(Vector2::new(0.01, 0.0)), side(Vector2::new(0.0, 0.01)));
        let mut reached = length_error(scale);
        let mut step = FIRST_SCALE_STEP;
        while step > LAST_SCALE_STEP {
            let turns = (0..8).map(|turn| direction(f64::from(turn) * FRAC_PI_4));
            let next = turns.map(|turn| scale.component_mul(&turn.map(|share| 1.0 + step * share)));
            let best = next.map(|next| (next, length_error(next))).min_by(|(_, a), (_, b)| a.total_cmp(b));
            match best.filter(|(_, error)| *error < reached) {
                Some((next, error)) => (scale, reached) = (next, error),
                None => step /= 2.0,
            }
        }
        scale
    }
}

impl SquareMesh {
    fn over(part: &FittedSurface, anchor: FlatPoint, weights: FloaterWeights) -> Result<Self, FloaterError> {
        let nodes = part.field.surface_nodes();
        let covered = Extents::of(nodes.map(|(column, row, _)| part.field.position(column, row).coords()));
        let outline =
            [covered.center(), anchor.coords()].into_iter().find_map(|middle| Outline::of(part, middle));
        let outline = outline.ok_or(FloaterError::NoOutline { at: anchor.coords().into() })?;
        let size = outline.extents().size();
        let edge = EDGE.clamp(size.max() / CELLS.end(), size.max() / CELLS.start());
        let [columns, rows] = [size.x, size.y].map(|side| 2 * (side / edge / 2.0).round().max(2.0) as usize);
        let width = columns + 1;
        let vertices: Vec<Point3<f64>> = (0..width * (rows + 1))
            .map(|index| {
                let across = 2.0 * (index % width) as f64 / columns as f64 - 1.0;
                let up = 2.0 * (index / width) as f64 / rows as f64 - 1.0;
                let at = outline.point(across, up, size);
                Point3::new(at.x, at.y, part.nurbs.height(at))
            })
            .collect();
        let mut triangles = Vec::with_capacity(2 * columns * rows);
        for row in 0..rows {
            for column in 0..columns {
                let [a, b] = [row * width + column, (row + 1) * width + column];
                // Diagonals alternate, so that none cuts off a corner of the square.
                triangles.extend(if (row + column) % 2 == 0 {
                    [[a, a + 1, b + 1], [a, b + 1, b]]
                } else {
                    [[a, a + 1, b], [a + 1, b + 1, b]]
                });
            }
        }
        let places = parametrise(&vertices, &triangles, [columns, rows], weights)?;
        Ok(Self::new(vertices, places, triangles))
    }

    fn new(vertices: Vec<Point3<f64>>, places: Vec<Vector2<f64>>, triangles: Vec<[usize; 3]>) -> Self {
        let side = ((triangles.len() as f64 / 2.0).sqrt() as usize).max(1);
        let squares = |triangle: &[usize; 3]| {
            let extents = Extents::of(triangle.map(|corner| places[corner]));
            let index = |place: f64| ((place * side as f64) as usize).min(side - 1);
            let columns = index(extents.min.x)..index(extents.max.x) + 1;
            let rows = index(extents.min.y)..index(extents.max.y) + 1;
            rows.flat_map(move |row| columns.clone().map(move |column| row * side + column))
        };
        let mut starts = vec![0; side * side + 1];
        triangles.iter().flat_map(squares).for_each(|square| starts[square + 1] += 1);
        (0..side * side).for_each(|square| starts[square + 1] += starts[square]);
        let mut next = starts.clone();
        let mut found = vec![0; starts[side * side]];
        for (index, triangle) in triangles.iter().enumerate() {
            for square in squares(triangle) {
                found[next[square]] = index;
                next[square] += 1;
            }
        }
        Self { vertices, places, triangles, side, starts, found }
    }

    /// The point of the view for a place in the square.
    fn seen(&self, place: Vector2<f64>) -> ViewPoint {
        let index = place.map(|value| ((value * self.side as f64) as usize).min(self.side - 1));
        let square = index.y * self.side + index.x;
        let inside = place.map(|value| value.clamp(0.0, 1.0));
        let candidates = &self.found[self.starts[square]..self.starts[square + 1]];
        let best = candidates
            .iter()
            .map(|&triangle| {
                (triangle, barycentric(self.triangles[triangle].map(|corner| self.places[corner]), inside))
            })
            .max_by(|(_, a), (_, b)| a.min().total_cmp(&b.min()));
        let Some((triangle, _)) = best else { return ViewPoint::new(f64::NAN, f64::NAN) };
        let corners = self.triangles[triangle];
        let shares = barycentric(corners.map(|corner| self.places[corner]), place);
        let points = corners.map(|corner| self.vertices[corner].coords.xy());
        (points[0] * shares[0] + points[1] * shares[1] + points[2] * shares[2]).into()
    }

    /// The place in the square of a point of the view.
    fn place_of(&self, at: ViewPoint) -> Vector2<f64> {
        let shares = |triangle: &[usize; 3]| {
            barycentric(triangle.map(|corner| self.vertices[corner].coords.xy()), at.coords())
        };
        let nearest = self.triangles.iter().max_by(|a, b| shares(a).min().total_cmp(&shares(b).min()));
        nearest.map_or(Vector2::new(0.5, 0.5), |triangle| {
            let places = triangle.map(|corner| self.places[corner]);
            let shares = shares(triangle);
            places[0] * shares[0] + places[1] * shares[1] + places[2] * shares[2]
        })
    }
}

/// The barycentric coordinates of a point; negative beyond the opposite side, −∞ in a triangle without area.
fn barycentric([a, b, c]: [Vector2<f64>; 3], at: Vector2<f64>) -> Vector3<f64> {
    let area = (b - a).perp(&(c - a));
    if area == 0.0 {
        return Vector3::repeat(f64::NEG_INFINITY);
    }
    let (second, third) = ((at - a).perp(&(c - a)) / area, (b - a).perp(&(at - a)) / area);
    Vector3::new(1.0 - second - third, second, third)
}

/// The distances from a point of the part to its outline, in all directions.
struct Outline {
    middle: Vector2<f64>,
    reach: Vec<f64>,
}

impl Outline {
    /// The outline about `middle`; `None` if there is no surface at `middle`.
    fn of(part: &FittedSurface, middle: Vector2<f64>) -> Option<Self> {
        let step = part.field.step();
        let (columns, rows) = part.field.size();
        let max_steps = 2 * (columns + rows);
        let is_surface = |at: Vector2<f64>| part.field.is_surface(at.into());
        if !is_surface(middle) {
            return None;
        }
        let farthest = |ray: usize| {
            let direction = direction(ray as f64 / RAYS as f64 * TAU);
            let reach = |steps: usize| steps as f64 * step / 2.0;
            let last = (0..max_steps).rev().find(|steps| is_surface(middle + direction * reach(*steps)));
            reach(last.unwrap_or(0)).max(step / 2.0)
        };
        let mut reach: Vec<f64> = (0..RAYS).map(farthest).collect();
        // In the height field the outline is a staircase; chords along it would be too long.
        for _ in 0..3 {
            let stairs = reach.clone();
            let mean = |ray: usize| {
                let near = (0..=2 * SMOOTHED).map(|shift| stairs[(ray + RAYS + shift - SMOOTHED) % RAYS]);
                near.sum::<f64>() / (2 * SMOOTHED + 1) as f64
            };
            reach = (0..RAYS).map(mean).collect();
        }
        Some(Self { middle, reach })
    }

    fn extents(&self) -> Extents {
        let ends = self.reach.iter().enumerate();
        Extents::of(ends.map(|(ray, reach)| self.middle + direction(ray as f64 / RAYS as f64 * TAU) * *reach))
    }

    /// The point of the view for a point of the square −1 to 1: squares about the middle become scaled copies of the
    /// outline, and equal steps along a side become equal steps of the angle (Shirley & Chiu, A low distortion map
    /// between disk and square, 1997). `size` is that of the outline's extents.
    fn point(&self, across: f64, up: f64, size: Vector2<f64>) -> ViewPoint {
        let out = across.abs().max(up.abs());
        if out == 0.0 {
            return self.middle.into();
        }
        let turn = if across.abs() >= up.abs() {
            FRAC_PI_4 * up / across + if across < 0.0 { std::f64::consts::PI } else { 0.0 }
        } else {
            2.0 * FRAC_PI_4 * up.signum() - FRAC_PI_4 * across / up
        };
        // The corners are on the diagonals of the part's extents, not at 45°.
        let along = direction(turn).component_mul(&size);
        let direction = along.normalize();
        let angle = direction.y.atan2(direction.x).rem_euclid(TAU);
        let ray = angle / TAU * RAYS as f64;
        let (low, share) = (ray as usize % RAYS, ray.fract());
        let reach = self.reach[low] * (1.0 - share) + self.reach[(low + 1) % RAYS] * share;
        (self.middle + direction * (reach * out)).into()
    }
}

fn direction(angle: f64) -> Vector2<f64> {
    let (sin, cos) = angle.sin_cos();
    Vector2::new(cos, sin)
}

/// The border vertices of a grid: one list for each side, including both of its corners, counter-clockwise from the
/// lower left.
fn border(columns: usize, rows: usize) -> [Vec<usize>; 4] {
    let width = columns + 1;
    let at = |column: usize, row: usize| row * width + column;
    [
        (0..=columns).map(|column| at(column, 0)).collect(),
        (0..=rows).map(|row| at(columns, row)).collect(),
        (0..=columns).rev().map(|column| at(column, rows)).collect(),
        (0..=rows).rev().map(|row| at(0, row)).collect(),
    ]
}

/// The weights of the neighbours of every vertex of a grid, by columns and rows from −1 to 1, with their sum in the
/// middle: Σ weight · (own place − place of the neighbour) = 0.
struct Means {
    width: usize,
    weights: Vec<[f64; 9]>,
}

impl Means {
    /// Adds the weight of a neighbour.
    fn couple(&mut self, vertex: usize, neighbour: usize, weight: f64) {
        let right = 1 + neighbour % self.width - vertex % self.width;
        let up = 1 + neighbour / self.width - vertex / self.width;
        self.weights[vertex][4] += weight;
        self.weights[vertex][up * 3 + right] += weight;
    }

    /// The neighbours of an inner vertex with their index among its weights.
    fn neighbours(&self, vertex: usize) -> impl Iterator<Item = (usize, usize)> {
        let first = vertex - self.width - 1;
        let all = (0..9).map(move |index| (first + index / 3 * self.width + index % 3, index));
        all.filter(|(_, index)| *index != 4)
    }
}

impl Couplings<1, 2> for Means {
    fn each(&self, vertex: usize, mut add: impl FnMut(usize, &[[[f64; 1]; 1]; 2])) {
        add(vertex, &[[[self.weights[vertex][4]]]; 2]);
        for (neighbour, index) in self.neighbours(vertex) {
            add(neighbour, &[[[-self.weights[neighbour][8 - index]]], [[-self.weights[vertex][index]]]]);
        }
    }
}

/// Places in the unit square of a grid of `columns` × `rows` squares: border vertices are on its sides by chord length,
/// every inner vertex is at the weighted mean of its neighbours (Floater, 1997, section 3). In every row of the equations
/// the entry on the diagonal is the sum of the others, so that they are solved without pivoting.
fn parametrise(
    vertices: &[Point3<f64>],
    triangles: &[[usize; 3]],
    [columns, rows]: [usize; 2],
    weights: FloaterWeights,
) -> Result<Vec<Vector2<f64>>, FloaterError> {
    let mut places = vec![Vector2::zeros(); vertices.len()];
    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]].map(Vector2::from);
    for (side, line) in border(columns, rows).iter().enumerate() {
        let chords = line.windows(2).map(|pair| (vertices[pair[1]] - vertices[pair[0]]).norm());
        let whole: f64 = chords.clone().sum();
        let mut length = 0.0;
        for (vertex, chord) in line.iter().zip(std::iter::once(0.0).chain(chords)) {
            length += chord;
            places[*vertex] = corners[side].lerp(&corners[side + 1], (length / whole).min(1.0));
        }
    }
    let width = columns + 1;
    let mut means = Means { width, weights: vec![[0.0; 9]; vertices.len()] };
    for corners in triangles {
        for turn in 0..3 {
            let [here, next, last] = [0, 1, 2].map(|step| corners[(turn + step) % 3]);
            let (to_next, to_last) = (vertices[next] - vertices[here], vertices[last] - vertices[here]);
            let (near, far) = (to_next.norm(), to_last.norm());
            // Each neighbour occurs in two triangles, so each occurrence gets half of a uniform weight.
            let [weight_next, weight_last] = match weights {
                FloaterWeights::Uniform => [0.5, 0.5],
                FloaterWeights::MeanValue => {
                    let half = to_next.cross(&to_last).norm() / (near * far + to_next.dot(&to_last));
                    [half / near, half / far]
                }
            };
            means.couple(here, next, weight_next);
            means.couple(here, last, weight_last);
        }
    }
    let is_inner =
        |vertex: usize| (1..columns).contains(&(vertex % width)) && (1..rows).contains(&(vertex / width));
    let unsolved = FloaterError::Unsolved { unknowns: columns.saturating_sub(1) * rows.saturating_sub(1) };
    let elimination = Elimination::new((width, rows + 1), 1, is_inner).ok_or(unsolved)?;
    let factor = Factor::new(&elimination, &means, &InTurn).map_err(|_| unsolved)?;
    for axis in 0..2 {
        let right = |vertex: &u32| {
            let vertex = *vertex as usize;
            let on_border = means.neighbours(vertex).filter(|(neighbour, _)| !is_inner(*neighbour));
            [on_border.map(|(neighbour, index)| means.weights[vertex][index] * places[neighbour][axis]).sum()]
        };
        let mut found: Vec<[f64; 1]> = elimination.order().iter().map(right).collect();
        factor.solve(&mut found, &InTurn);
        // Convex combinations stay inside the square; anything else is not a solution.
        if !found.as_flattened().iter().all(|place| (-1e-9..=1.0 + 1e-9).contains(place)) {
            return Err(unsolved);
        }
        elimination
            .order()
            .iter()
            .zip(found)
            .for_each(|(vertex, [place])| places[*vertex as usize][axis] = place);
    }
    Ok(places)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grid whose inner vertices are displaced, lifted by `height`.
    fn grid(height: impl Fn(f64, f64) -> f64) -> (Vec<Point3<f64>>, Vec<[usize; 3]>) {
        let (columns, rows) = (12, 10);
        let vertex = |index: usize| {
            let (column, row) = (index % (columns + 1), index / (columns + 1));
            let inner = column % columns != 0 && row % rows != 0;
            let push = if inner { 0.25 * (index as f64 * 2.4).sin() } else { 0.0 };
            let (x, y) = (column as f64 + push, row as f64 - push);
            Point3::new(x, y, height(x, y))
        };
        let vertices = (0..(columns + 1) * (rows + 1)).map(vertex).collect();
        let cell = |index: usize| {
            let a = index / columns * (columns + 1) + index % columns;
            let b = a + columns + 1;
            [[a, a + 1, b + 1], [a, b + 1, b]]
        };
        (vertices, (0..columns * rows).flat_map(cell).collect())
    }

    #[test]
    fn mean_value_weights_reproduce_a_flat_grid() {
        let (vertices, triangles) = grid(|_, _| 0.0);
        let places = parametrise(&vertices, &triangles, [12, 10], FloaterWeights::MeanValue).unwrap();
        for (vertex, place) in vertices.iter().zip(&places) {
            assert!((place.x * 12.0 - vertex.x).abs() < 1e-9 && (place.y * 10.0 - vertex.y).abs() < 1e-9);
        }
    }

    #[test]
    fn no_triangle_is_flipped() {
        let (vertices, triangles) = grid(|x, y| 4.0 * (0.7 * x).sin() * (0.9 * y).cos());
        for weights in [FloaterWeights::Uniform, FloaterWeights::MeanValue] {
            let places = parametrise(&vertices, &triangles, [12, 10], weights).unwrap();
            let mesh = SquareMesh::new(vertices.clone(), places, triangles.clone());
            let mut whole = 0.0;
            for corners in &mesh.triangles {
                let [a, b, c] = corners.map(|corner| mesh.places[corner]);
                assert!((b - a).perp(&(c - a)) > 0.0);
                whole += (b - a).perp(&(c - a)) / 2.0;
            }
            assert!((whole - 1.0).abs() < 1e-9);
            // Every place is found in its triangle.
            for at in [[3.3, 4.1], [0.0, 0.0], [11.9, 9.7]].map(|[x, y]| ViewPoint::new(x, y)) {
                assert!(mesh.seen(mesh.place_of(at)).distance(at) < 1e-9);
            }
        }
    }
}
