//! The faces of a part on which ink may be, as the laser sees them.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector2};

use super::adjacency::weld;
use super::height_field::{Grid, HeightField, Node};
use crate::geometry::space::{View, ViewPoint};

/// Distances from the border are known up to this many steps of the grid.
const REACH: f64 = 8.0;
/// A face is hidden if it is at least this far below the surface that the laser sees, mm. Chords of curved
/// faces are nearer.
const HIDDEN: f64 = 0.3;

/// Where ink may be: the distance of every node of a grid over the view from the border of the region.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkRegion {
    grid: Grid,
    /// Positive inside, mm.
    distances: Vec<f32>,
}

impl MarkRegion {
    /// The region of these faces, in the part frame, mm, as far as the laser sees them. The order of their corners does not
    /// matter.
    pub fn seen(faces: &[[Point3<f64>; 3]], view: &View, field: &HeightField) -> Self {
        let grid = *field.grid();
        let faces: Vec<[Point3<f64>; 3]> =
            faces.iter().map(|face| face.map(|corner| view.point(corner))).collect();
        let far = REACH * grid.step;
        let mut nearest = vec![far; grid.count()];
        for [from, to] in borders(&faces) {
            if [0.0, 0.5, 1.0].iter().any(|t| is_visible(&from.lerp(&to, *t), field)) {
                lower_distances(&mut nearest, &grid, from.coords.xy(), to.coords.xy());
            }
        }
        let mut is_inside = vec![false; grid.count()];
        for face in &faces {
            cover(&mut is_inside, face, field);
        }
        let signed = nearest.iter().zip(is_inside);
        let distances = signed.map(|(near, inside)| if inside { *near } else { -near } as f32).collect();
        Self { grid, distances }
    }

    /// A region with these distances at the nodes of a field, as [`distances`](Self::distances) returns them; `None` if
    /// their number does not match.
    pub fn with_distances(field: &HeightField, distances: Vec<f32>) -> Option<Self> {
        let grid = *field.grid();
        (distances.len() == grid.count()).then_some(Self { grid, distances })
    }

    /// The distance of each node from the border, mm, positive inside.
    pub fn distances(&self) -> &[f32] {
        &self.distances
    }

    /// The distance of a point from the border, mm, positive inside; limited to [`farthest`](Self::farthest).
    pub fn distance(&self, at: ViewPoint) -> f64 {
        let Some((column, row, place)) = self.grid.cell(at) else { return -self.farthest() };
        let [a, b, c, d] = self.grid.cell_nodes(column, row).map(|index| f64::from(self.distances[index]));
        let mix = |left: f64, right: f64, t: f64| left + (right - left) * t;
        mix(mix(a, b, place.x), mix(c, d, place.x), place.y)
    }

    /// The largest distance that is known, mm.
    pub fn farthest(&self) -> f64 {
        REACH * self.grid.step
    }
}

/// The sides of faces that no other face shares.
fn borders(faces: &[[Point3<f64>; 3]]) -> impl Iterator<Item = [Point3<f64>; 2]> {
    let corners = faces.as_flattened();
    let places = weld(corners);
    let mut sides: BTreeMap<[u32; 2], (usize, [Point3<f64>; 2])> = BTreeMap::new();
    for corner in 0..corners.len() {
        let next = corner / 3 * 3 + (corner + 1) % 3;
        let mut ends = [places[corner], places[next]];
        ends.sort_unstable();
        // A face with two corners at one place is between its neighbours.
        if ends[0] != ends[1] {
            sides.entry(ends).or_insert((0, [corners[corner], corners[next]])).0 += 1;
        }
    }
    sides.into_values().filter(|(count, _)| count % 2 == 1).map(|(_, ends)| ends)
}

/// Whether the laser sees a point of the part; beside the part nothing hides it.
fn is_visible(point: &Point3<f64>, field: &HeightField) -> bool {
    let at = ViewPoint::new(point.x, point.y);
    let Some((column, row, place)) = field.grid().cell(at) else { return true };
    let nearest =
        field.grid().cell_nodes(column, row)[usize::from(place.x > 0.5) + 2 * usize::from(place.y > 0.5)];
    match field.nodes()[nearest] {
        Node::Empty => true,
        // Beside a slope the nearest node is higher or lower than the point.
        Node::Wall(height) | Node::Surface(height) => point.z >= height - HIDDEN - 2.0 * field.step(),
    }
}

/// The indices of the nodes in a rectangle.
fn nodes_in(
    grid: &Grid,
    low: Vector2<f64>,
    high: Vector2<f64>,
) -> impl Iterator<Item = (usize, Vector2<f64>)> {
    let along = |low: f64, high: f64, start: f64, count: usize| {
        let from = ((low - start) / grid.step).ceil().max(0.0) as usize;
        let to = (((high - start) / grid.step).floor() + 1.0).clamp(0.0, count as f64) as usize;
        from..to
    };
    let columns = along(low.x, high.x, grid.origin.x, grid.columns);
    let grid = *grid;
    along(low.y, high.y, grid.origin.y, grid.rows).flat_map(move |row| {
        let node = move |column| (row * grid.columns + column, grid.position(column, row).coords());
        columns.clone().map(node)
    })
}

/// Lowers the distances of the nodes round a line to theirs from it.
fn lower_distances(nearest: &mut [f64], grid: &Grid, from: Vector2<f64>, to: Vector2<f64>) {
    let far = Vector2::repeat(REACH * grid.step);
    // A long line across the grid is near few of the nodes in its rectangle.
    let pieces = ((to - from).norm() / (REACH * grid.step)).ceil().max(1.0);
    for piece in 0..pieces as usize {
        let at = |end: usize| from.lerp(&to, end as f64 / pieces);
        let (start, end) = (at(piece), at(piece + 1));
        let step = end - start;
        for (index, place) in nodes_in(grid, start.inf(&end) - far, start.sup(&end) + far) {
            let t = ((place - start).dot(&step) / step.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
            nearest[index] = nearest[index].min((place - start - step * t).norm());
        }
    }
}

/// Marks the nodes that a face covers where the laser sees it.
fn cover(is_inside: &mut [bool], face: &[Point3<f64>; 3], field: &HeightField) {
    let [a, b, c] = face.map(|corner| corner.coords.xy());
    let across = |u: Vector2<f64>, v: Vector2<f64>| u.x * v.y - u.y * v.x;
    let whole = across(b - a, c - a);
    if whole == 0.0 {
        return;
    }
    for (index, at) in nodes_in(field.grid(), a.inf(&b).inf(&c), a.sup(&b).sup(&c)) {
        let shares = [across(b - at, c - at), across(c - at, a - at), across(a - at, b - at)];
        let shares = shares.map(|share| share / whole);
        // A node on the side of two faces is in one of them at least.
        if shares.iter().any(|share| *share < -1e-9) {
            continue;
        }
        let height: f64 = shares.iter().zip(face).map(|(share, corner)| share * corner.z).sum();
        is_inside[index] |= match field.nodes()[index] {
            Node::Empty => false,
            Node::Wall(top) | Node::Surface(top) => height >= top - HIDDEN,
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::facing_part::FacingPart;
    use crate::geometry::shapes;

    #[test]
    fn faces_whose_corners_differ_by_rounding_have_no_border_between_them() {
        let view = View::top();
        let part = FacingPart::new(&shapes::graph(20.0, 1.0, |_, _| 0.0), &view);
        let field = part.sample(&Grid::over(&part.extents(), 0.5)).field;
        let corner = |x: f64, y: f64| Point3::new(x, y, 0.0);
        let [a, b, c, d] = [corner(-8.0, -8.0), corner(8.0, -8.0), corner(8.0, 8.0), corner(-8.0, 8.0)];
        for rounding in [0.0, 1e-6, 1e-4] {
            let moved = |at: Point3<f64>| at + nalgebra::Vector3::new(rounding, -rounding, rounding);
            let region = MarkRegion::seen(&[[a, b, c], [moved(a), moved(c), moved(d)]], &view, &field);
            // The diagonal is near the middle, the sides are far.
            let distance = region.distance(ViewPoint::new(0.0, 0.0));
            assert!(distance > 0.99 * region.farthest(), "{distance} mm with a rounding of {rounding} mm");
        }
    }
}
