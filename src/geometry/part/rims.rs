//! The borders of the surface that the laser sees.

use nalgebra::Point3;

use super::height_field::{HeightField, Node};

/// Marks a missing node.
const NONE: u32 = u32::MAX;
/// Steps towards the middle of the two neighbours, and back: this smooths the steps of the grid without shrinking the ring
/// (G. Taubin, Curve and surface smoothing without shrinkage, ICCV 1995).
const STEPS: [f64; 2] = [0.5, -0.526];
/// A ring is smoothed this many times with [`STEPS`].
const PASSES: usize = 12;

/// The borders of the smooth surface of a height field: closed rings of points close to it, mm in the view, with the surface
/// on their left, longest first. Their sum has at most `most` points; shorter rings are omitted.
#[must_use]
pub fn rims(field: &HeightField, most: usize) -> Vec<Vec<Point3<f64>>> {
    let mut rings = rings(field);
    // Stable: rings of equal length keep their order.
    rings.sort_by_key(|ring| std::cmp::Reverse(ring.len()));
    let mut points = 0;
    rings.retain(|ring| {
        points += ring.len();
        points <= most
    });
    rings.into_iter().map(smoothed).collect()
}

fn rings(field: &HeightField) -> Vec<Vec<Point3<f64>>> {
    let (columns, rows) = field.size();
    let height = |node: usize| match field.nodes()[node] {
        Node::Surface(height) => Some(height),
        Node::Wall(_) | Node::Empty => None,
    };
    let is_full = |column: usize, row: usize| {
        column + 1 < columns
            && row + 1 < rows
            && field.cell_nodes(column, row).iter().all(|node| height(*node).is_some())
    };
    // At most two borders leave a node: two cells may touch there.
    let mut next = vec![[NONE; 2]; columns * rows];
    for row in 0..rows - 1 {
        for column in 0..columns - 1 {
            if !is_full(column, row) {
                continue;
            }
            let [a, b, c, d] = field.cell_nodes(column, row);
            let beside = |right: isize, up: isize| {
                let (column, row) = (column.checked_add_signed(right), row.checked_add_signed(up));
                column.zip(row).is_some_and(|(column, row)| is_full(column, row))
            };
            for (from, to, is_inner) in
                [(a, b, beside(0, -1)), (b, d, beside(1, 0)), (d, c, beside(0, 1)), (c, a, beside(-1, 0))]
            {
                if !is_inner {
                    let [first, second] = &mut next[from];
                    *if *first == NONE { first } else { second } = to as u32;
                }
            }
        }
    }
    let mut rings = Vec::new();
    for start in 0..next.len() {
        while next[start][0] != NONE {
            let (mut ring, mut node) = (Vec::new(), start);
            while next[node][0] != NONE {
                let at = field.position(node % columns, node / columns);
                ring.push(Point3::new(at.x, at.y, height(node).unwrap_or_default()));
                let [first, second] = next[node];
                next[node] = [second, NONE];
                node = first as usize;
            }
            rings.push(ring);
        }
    }
    rings
}

fn smoothed(mut ring: Vec<Point3<f64>>) -> Vec<Point3<f64>> {
    let count = ring.len();
    for step in [STEPS; PASSES].concat() {
        let moved = |index: usize| {
            let [before, after] = [index + count - 1, index + 1].map(|beside| ring[beside % count]);
            ring[index] + (nalgebra::center(&before, &after) - ring[index]) * step
        };
        ring = (0..count).map(moved).collect();
    }
    ring
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::facing_part::FacingPart;
    use crate::geometry::height_field::Grid;
    use crate::geometry::shapes;
    use crate::geometry::space::{Extents, View};
    use nalgebra::Vector2;

    fn field(hole: bool) -> HeightField {
        let part = FacingPart::new(&shapes::graph(28.0, 0.75, shapes::sphere), &View::top());
        let extents = Extents { min: Vector2::new(-27.0, -27.0), max: Vector2::new(27.0, 27.0) };
        let sampled = part.sample(&Grid::over(&extents, 0.5)).field;
        let nodes = sampled.nodes().iter().enumerate().map(|(index, node)| {
            let at = sampled.position(index % sampled.size().0, index / sampled.size().0);
            if hole && at.coords().norm() < 6.0 { Node::Empty } else { *node }
        });
        let (columns, rows) = sampled.size();
        HeightField::new(sampled.origin(), sampled.step(), columns, rows, nodes.collect()).unwrap()
    }

    fn area(ring: &[Point3<f64>]) -> f64 {
        let pairs = ring.iter().zip(ring.iter().cycle().skip(1));
        pairs.map(|(a, b)| (a.x * b.y - a.y * b.x) / 2.0).sum()
    }

    #[test]
    fn the_rim_of_a_hole_is_a_smooth_ring_on_the_surface() {
        let rims = rims(&field(true), 10_000);
        assert_eq!(rims.len(), 2);
        assert!(area(&rims[0]) > 2000.0 && area(&rims[1]) < 0.0);
        // The outermost nodes beside the hole are up to a step and a half outside its circle.
        for point in &rims[1] {
            let radius = point.x.hypot(point.y);
            assert!((5.9..7.0).contains(&radius), "{radius}");
            assert!((point.z - shapes::sphere(point.x, point.y)).abs() < 0.02);
        }
    }

    #[test]
    fn shorter_rims_are_omitted_beyond_the_bound() {
        let all = rims(&field(true), 10_000);
        assert_eq!(rims(&field(true), all[0].len()), all[..1]);
        assert_eq!(rims(&field(true), 10), Vec::<Vec<Point3<f64>>>::new());
    }
}
