//! The regions of a height field: places of the smooth surface that are joined without crossing a cliff, as the part round a
//! drilled hole, the floor of the hole, and the top of a boss.

use std::collections::BTreeSet;

use super::height_field::{HeightField, Node};
use crate::geometry::space::{Extents, ViewPoint};

/// For each node of a height field, the region that it belongs to.
#[derive(Debug, Clone, PartialEq)]
pub struct Regions<'a> {
    field: &'a HeightField,
    /// The region of each node; `None` beside the part and at walls.
    of_nodes: Vec<Option<u32>>,
}

impl<'a> Regions<'a> {
    /// The regions of a field, numbered in the order of their first nodes.
    pub fn of(field: &'a HeightField) -> Self {
        let is_surface = |node: usize| matches!(field.nodes()[node], Node::Surface(_));
        let mut of_nodes: Vec<Option<u32>> = vec![None; field.nodes().len()];
        let (mut found, mut open) = (0, Vec::new());
        for first in 0..of_nodes.len() {
            if of_nodes[first].is_some() || !is_surface(first) {
                continue;
            }
            of_nodes[first] = Some(found);
            open.push(first);
            while let Some(node) = open.pop() {
                for next in field.grid().beside(node) {
                    if of_nodes[next].is_none() && is_surface(next) {
                        of_nodes[next] = Some(found);
                        open.push(next);
                    }
                }
            }
            found += 1;
        }
        Self { field, of_nodes }
    }

    /// The region of the node that is nearest to a point, or `Some(None)` if that is beside the part or at a wall; `None` outside the
    /// field.
    pub fn nearest(&self, at: ViewPoint) -> Option<Option<u32>> {
        let (column, row, place) = self.field.cell(at)?;
        let [right, up] = [place.x, place.y].map(|share| usize::from(share > 0.5));
        Some(self.of_nodes[(row + up) * self.field.size().0 + column + right])
    }

    /// The region that a point is on: that of all four nodes round it. `None` where there is no smooth surface.
    pub fn at(&self, at: ViewPoint) -> Option<u32> {
        let (column, row, _) = self.field.cell(at)?;
        let [first, rest @ ..] = self.field.cell_nodes(column, row).map(|node| self.of_nodes[node]);
        first.filter(|_| rest.iter().all(|region| *region == first))
    }

    /// The regions with nodes within a rectangle, mm.
    pub fn within(&self, extents: &Extents) -> BTreeSet<u32> {
        let columns = self.field.size().0;
        let nodes = self.field.surface_nodes_about(extents);
        nodes.filter_map(|(column, row, _)| self.of_nodes[row * columns + column]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;

    #[test]
    fn a_wall_round_a_floor_makes_it_a_region_and_a_gap_in_the_wall_does_not() {
        // Nodes 1 mm apart; the floor is within a square wall.
        let field = |has_gap: bool| {
            let node = |index: usize| {
                let (column, row) = (index % 21, index / 21);
                let ring = column.abs_diff(10).max(row.abs_diff(10));
                match ring {
                    4 if has_gap && column == 14 && row == 10 => Node::Surface(0.0),
                    4 => Node::Wall(0.0),
                    10 => Node::Empty,
                    _ => Node::Surface(if ring < 4 { -9.0 } else { 0.0 }),
                }
            };
            HeightField::new(Vector2::repeat(-10.0), 1.0, 21, 21, (0..21 * 21).map(node).collect()).unwrap()
        };
        let (closed, open) = (field(false), field(true));
        let (closed, open) = (Regions::of(&closed), Regions::of(&open));
        let [floor, wall, beside, outside] =
            [[0.5, 0.5], [4.4, 0.5], [7.5, 0.5], [9.5, 0.5]].map(|at| ViewPoint::from(Vector2::from(at)));
        assert_eq!([floor, wall, beside, outside].map(|at| closed.at(at)), [Some(1), None, Some(0), None]);
        assert_eq!([floor, wall].map(|at| closed.nearest(at)), [Some(Some(1)), Some(None)]);
        assert_eq!(closed.nearest(ViewPoint::new(10.6, 0.0)), None);
        assert_eq!([floor, beside].map(|at| open.at(at)), [Some(0), Some(0)]);
        let square = |half: f64| Extents { min: Vector2::repeat(-half), max: Vector2::repeat(half) };
        assert_eq!(closed.within(&square(2.0)), BTreeSet::from([1]));
        assert_eq!(closed.within(&square(8.0)), BTreeSet::from([0, 1]));
        assert_eq!(open.within(&square(8.0)), BTreeSet::from([0]));
    }
}
