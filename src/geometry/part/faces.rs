//! The faces of a height field. Edges of the part divide its smooth surface into faces, for example a flat
//! top and the chamfer round it.
//!
//! Edges are between the nodes. Beside an edge, the surface of a face is known from its own nodes. This also
//! shows where two faces meet.

use std::collections::BTreeSet;

use nalgebra::Vector2;

use super::disjoint_sets::DisjointSets;
use super::facing_part::PartSamples;
use super::height_field::{HeightField, NO_FACE, Node};
use crate::geometry::space::{Extents, ViewPoint};

/// A point is on one of two faces if it is farther from where they meet than this share of the distance
/// between nodes. Nearer to it there may be a narrow face between them that has no node.
const BESIDE_EDGE: f64 = 0.2;

/// At least this many nodes in a row show how a face is curved.
const LEAST_ACROSS: usize = 3;

/// Two faces meet at an edge if their slopes differ by at least this, no unit.
const LEAST_TURN: f64 = 1e-3;

impl PartSamples {
    /// For each node, the face that it is on: sides that continue each other are one.
    pub(crate) fn faces(&self) -> Vec<u32> {
        let sides: Vec<u32> = self.sides.iter().map(|side| side.unwrap_or(NO_FACE)).collect();
        joined(&sides, &self.continuing)
    }
}

/// The faces with those as one that continue each other.
pub(crate) fn joined(faces: &[u32], continuing: &BTreeSet<[u32; 2]>) -> Vec<u32> {
    let Some(largest) = continuing.iter().map(|[_, larger]| *larger).max() else { return faces.to_vec() };
    let mut sets = DisjointSets::new(largest as usize + 1);
    for [one, other] in continuing {
        sets.join(*one as usize, *other as usize);
    }
    let mut firsts: Vec<u32> = Vec::new();
    let numbers = sets.numbered().0;
    for (face, number) in (0..).zip(&numbers) {
        // Sets are numbered in the order of their first elements.
        if *number as usize == firsts.len() {
            firsts.push(face);
        }
    }
    let of_set = |face: u32| numbers.get(face as usize).map_or(face, |number| firsts[*number as usize]);
    faces.iter().map(|face| of_set(*face)).collect()
}

impl HeightField {
    /// Whether its smooth surface has nodes on several faces in a rectangle, mm, or just beside it.
    pub fn has_edge_within(&self, extents: &Extents) -> bool {
        if self.faces().is_empty() {
            return false;
        }
        let columns = self.size().0;
        let mut faces =
            self.surface_nodes_about(extents).map(|(column, row, _)| self.faces()[row * columns + column]);
        let first = faces.next();
        faces.any(|face| Some(face) != first)
    }

    /// Whether the node that is nearest to a point is known to be on another face than this one; `None` outside the field.
    pub fn is_on_other_face(&self, at: ViewPoint, face: u32) -> Option<bool> {
        let (column, row, place) = self.cell(at)?;
        let [right, up] = [place.x, place.y].map(|share| usize::from(share > 0.5));
        let nearest = self.faces().get((row + up) * self.size().0 + column + right);
        Some(nearest.is_some_and(|nearest| *nearest != face && *nearest != NO_FACE))
    }

    /// The face that a point is on; `None` beside the smooth surface, where that is not known or too few nodes there are on the face to
    /// show how it is curved, and within a fifth of a step from an edge.
    pub fn face_at(&self, at: ViewPoint) -> Option<u32> {
        let (column, row, _) = self.cell(at)?;
        let nodes = self.cell_nodes(column, row);
        let is_known = |node: &usize| {
            matches!(self.nodes()[*node], Node::Surface(_)) && self.faces().get(*node) != Some(&NO_FACE)
        };
        if self.faces().is_empty() || !nodes.iter().all(is_known) {
            return None;
        }
        let faces = nodes.map(|node| self.faces()[node]);
        let others = || faces.into_iter().filter(|face| *face != faces[0]);
        let face = match others().next() {
            None => faces[0],
            Some(other) if others().all(|face| face == other) => {
                self.face_beside_edge(at, nodes, [faces[0].min(other), faces[0].max(other)])?
            }
            Some(_) => return None,
        };
        let is_wide = |node: &usize| (0..2).all(|axis| self.nodes_across(*node, axis) >= LEAST_ACROSS);
        nodes.iter().filter(|node| self.faces()[**node] == face).all(is_wide).then_some(face)
    }

    /// How many nodes in a row along x (0) or y (1), of those near a node of the smooth surface and with it, are on its face.
    fn nodes_across(&self, node: usize, axis: usize) -> usize {
        let (columns, rows) = self.size();
        let (at, count, apart) = [(node % columns, columns, 1), (node / columns, rows, columns)][axis];
        let on_face = |way: isize| {
            (1..LEAST_ACROSS as isize)
                .map_while(|steps| at.checked_add_signed(steps * way).filter(|place| *place < count))
                .map(|place| node + place * apart - at * apart)
                .take_while(|other| {
                    matches!(self.nodes()[*other], Node::Surface(_))
                        && self.faces()[*other] == self.faces()[node]
                })
                .count()
        };
        1 + on_face(-1) + on_face(1)
    }

    /// Of two faces with the nodes round a point, the one that it is on: each is continued with its slope as far as the other.
    fn face_beside_edge(&self, at: ViewPoint, nodes: [usize; 4], faces: [u32; 2]) -> Option<u32> {
        let [one, other] = [self.continued(nodes, faces[0])?, self.continued(nodes, faces[1])?];
        let turn = one.slope - other.slope;
        // How far it is from where the faces meet, to the side on which the first one is higher.
        let from_edge = |at: Vector2<f64>| (one.height(at) - other.height(at)) / turn.norm();
        let beside = BESIDE_EDGE * self.step();
        let side = from_edge(at.coords());
        if !(turn.norm() > LEAST_TURN) || side.abs() < beside {
            return None;
        }
        // The nodes show which face is on which side. One on the edge itself may be on either.
        let is_first_on = |is_higher: bool| {
            nodes.iter().all(|node| {
                let side = from_edge(self.place_of(*node));
                side.abs() < beside || (self.faces()[*node] == faces[0]) == ((side > 0.0) == is_higher)
            })
        };
        match (is_first_on(true), is_first_on(false)) {
            (true, false) => Some(faces[usize::from(side < 0.0)]),
            (false, true) => Some(faces[usize::from(side > 0.0)]),
            _ => None,
        }
    }

    /// The plane that continues a face from those of the nodes that are on it.
    fn continued(&self, nodes: [usize; 4], face: u32) -> Option<Plane> {
        let mut sum = Plane { place: Vector2::zeros(), height: 0.0, slope: Vector2::zeros() };
        let mut count = 0.0;
        for node in nodes.into_iter().filter(|node| self.faces()[*node] == face) {
            let Node::Surface(height) = self.nodes()[node] else { return None };
            sum.place += self.place_of(node);
            sum.height += height;
            sum.slope += self.gradient_beside(node, Vector2::zeros())?;
            count += 1.0;
        }
        (count > 0.0).then(|| Plane {
            place: sum.place / count,
            height: sum.height / count,
            slope: sum.slope / count,
        })
    }

    fn place_of(&self, node: usize) -> Vector2<f64> {
        let columns = self.size().0;
        self.position(node % columns, node / columns).coords()
    }
}

/// A plane over the view.
struct Plane {
    place: Vector2<f64>,
    /// There, mm.
    height: f64,
    slope: Vector2<f64>,
}

impl Plane {
    fn height(&self, at: Vector2<f64>) -> f64 {
        self.height + self.slope.dot(&(at - self.place))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nodes 1 mm apart over two planes that meet along a line, of a ridge or of a valley.
    fn folded(slopes: [[f64; 2]; 2], is_ridge: bool) -> HeightField {
        let nodes = (0..21 * 21).map(|index| {
            let at = Vector2::new((index % 21) as f64 - 10.0, (index / 21) as f64 - 10.0);
            let heights = slopes.map(|slope| Vector2::from(slope).dot(&at) + 0.3 * slope[1]);
            let is_first = (heights[0] < heights[1]) == is_ridge;
            (Node::Surface(heights[usize::from(!is_first)]), if is_first { 4 } else { 9 })
        });
        let (nodes, faces) = nodes.unzip();
        HeightField::new(Vector2::repeat(-10.0), 1.0, 21, 21, nodes).unwrap().with_faces(faces)
    }

    #[test]
    fn beside_an_edge_a_point_is_on_the_face_on_its_side() {
        for slopes in [[[0.0, 0.0], [0.2, -1.0]], [[0.7, 0.1], [-0.4, -0.3]], [[0.0, 0.02], [0.0, -0.02]]] {
            for is_ridge in [true, false] {
                let field = folded(slopes, is_ridge);
                let turn = Vector2::from(slopes[0]) - Vector2::from(slopes[1]);
                let (mut near, mut far) = (0, 0);
                for step in 0..4000 {
                    let at = [2.399_963, 3.7].map(|turn: f64| (f64::from(step) * turn).sin() * 8.0);
                    let at = Vector2::from(at);
                    // How far it is from the edge, to the side on which the first plane is higher.
                    let side = (turn.dot(&at) + 0.3 * turn.y) / turn.norm();
                    let expected = if (side < 0.0) == is_ridge { 4 } else { 9 };
                    match field.face_at(at.into()) {
                        Some(face) => assert_eq!(face, expected, "{slopes:?} {is_ridge} {at} {side}"),
                        // In the corner of a cell that holds no node of the face, it may be farther.
                        None if side.abs() < 0.2 + 1e-9 => near += 1,
                        None => far += 1,
                    }
                }
                assert!(near > 20 && far == 0, "{slopes:?} {is_ridge}: {near} {far}");
            }
        }
    }

    #[test]
    fn only_where_the_field_has_several_faces_is_there_an_edge() {
        let field = folded([[0.0, 0.0], [0.0, -1.0]], true);
        let square = |x: f64, y: f64| {
            let middle = Vector2::new(x, y);
            Extents { min: middle.add_scalar(-2.0), max: middle.add_scalar(2.0) }
        };
        assert!(field.has_edge_within(&square(3.0, 0.0)) && !field.has_edge_within(&square(0.0, 6.0)));
        assert_eq!(field.face_at(ViewPoint::new(0.5, 5.0)), Some(9));
        assert_eq!(field.face_at(ViewPoint::new(11.0, 5.0)), None);
        assert_eq!(field.is_on_other_face(ViewPoint::new(0.4, 5.0), 4), Some(true));
        assert_eq!(field.is_on_other_face(ViewPoint::new(0.4, -5.0), 4), Some(false));
        assert_eq!(field.is_on_other_face(ViewPoint::new(0.4, 50.0), 4), None);
        let mut strip = field.faces().to_vec();
        // Two nodes do not show how the face between these is curved; three do.
        for (rows, known) in [(10..12, None), (10..13, Some(7))] {
            rows.for_each(|row| strip[row * 21..(row + 1) * 21].fill(7));
            assert_eq!(field.clone().with_faces(strip.clone()).face_at(ViewPoint::new(3.5, 0.5)), known);
        }
        let smooth = field.with_faces(Vec::new());
        assert!(!smooth.has_edge_within(&square(3.0, 0.0)));
        assert_eq!(smooth.face_at(ViewPoint::new(0.5, 5.0)), None);
    }

    #[test]
    fn sides_that_continue_each_other_are_one_face() {
        let faces = [7, 3, NO_FACE, 5, 9, 3, 12];
        assert_eq!(joined(&faces, &BTreeSet::new()), faces);
        let continuing = BTreeSet::from([[3, 7], [7, 9]]);
        assert_eq!(joined(&faces, &continuing), [3, 3, NO_FACE, 5, 3, 3, 12]);
    }
}
