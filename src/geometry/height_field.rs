//! What the laser sees: the height of the part over a grid of the view.

use nalgebra::{Point3, Vector2, Vector3};

use super::curved_triangle::CurvedTriangle;
use super::mesh::TriMesh;
use super::normals::estimate_corner_normals;
use super::space::{Extents, View, ViewPoint};

/// Surface that leans further than this from the laser's axis is not marked, rad. The limit for marking is lower
/// (60° unless set otherwise); what lies between serves the fit as a border.
pub const STEEPEST_SURFACE: f64 = 75.0 * std::f64::consts::PI / 180.0;

/// What lies under a grid node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Node {
    /// Nothing: beside the part, or a hole through it.
    Empty,
    /// Surface that is too steep to mark, or the brink of a cliff: its height, mm, is no part of the smooth surface.
    Wall(f64),
    /// Surface at this height, mm.
    Surface(f64),
}

/// Heights of the part's side that faces the laser, on a square grid of the view, mm.
#[derive(Debug, Clone, PartialEq)]
pub struct HeightField {
    origin: Vector2<f64>,
    step: f64,
    columns: usize,
    rows: usize,
    nodes: Vec<Node>,
}

/// A part turned to the laser and ready to be sampled at any spacing.
#[derive(Debug, Clone)]
pub struct FacingPart {
    positions: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
    /// One for each corner of each triangle, or one for each vertex.
    normals: CornerNormals,
    extents: Extents,
}

#[derive(Debug, Clone)]
enum CornerNormals {
    OfVertices(Vec<Vector3<f64>>),
    OfCorners(Vec<[Vector3<f64>; 3]>),
}

impl FacingPart {
    /// The part as `view` shows it. Normals of the file are used; a mesh without any gets estimated ones
    /// ([`estimate_corner_normals`]).
    pub fn new(mesh: &TriMesh, view: &View) -> Self {
        let positions: Vec<_> = mesh.positions().iter().map(|&position| view.point(position)).collect();
        let triangles = mesh.triangles().to_vec();
        let normals = if mesh.normals().is_empty() {
            CornerNormals::OfCorners(estimate_corner_normals(&positions, &triangles))
        } else {
            CornerNormals::OfVertices(mesh.normals().iter().map(|&normal| view.vector(normal)).collect())
        };
        let extents =
            Extents::of(triangles.iter().flatten().map(|&index| positions[index as usize].coords.xy()));
        Self { positions, triangles, normals, extents }
    }

    /// The rectangle of the view that the part fills, mm.
    pub fn extents(&self) -> Extents {
        self.extents
    }

    /// The height field with `step` mm between nodes: for every node the point of the part nearest to the laser, on
    /// the curved triangles. Nodes lie at whole multiples of the step.
    pub fn sample(&self, step: f64) -> HeightField {
        let first = (self.extents.min / step).map(f64::floor);
        let last = (self.extents.max / step).map(f64::ceil);
        let (columns, rows) = ((last.x - first.x) as usize + 1, (last.y - first.y) as usize + 1);
        let origin = first * step;
        let mut hits: Vec<Option<super::curved_triangle::Hit>> = vec![None; columns * rows];
        for (triangle, corners) in self.triangles.iter().enumerate() {
            let points = corners.map(|index| self.positions[index as usize]);
            let extents = Extents::of(points.map(|point| point.coords.xy()));
            // An edge between normals 90° apart bulges by less than a quarter of its length.
            let reach = extents.size().norm() * 0.25;
            let grown = extents.grown(reach);
            let range = |low: f64, high: f64, count: usize| {
                let from = (low / step).ceil().max(0.0) as usize;
                let to = ((high / step).floor() + 1.0).clamp(0.0, count as f64) as usize;
                from..to
            };
            let in_columns = range(grown.min.x - origin.x, grown.max.x - origin.x, columns);
            let in_rows = range(grown.min.y - origin.y, grown.max.y - origin.y, rows);
            if in_columns.is_empty() || in_rows.is_empty() {
                continue;
            }
            let normals = match &self.normals {
                CornerNormals::OfVertices(normals) => corners.map(|index| normals[index as usize]),
                CornerNormals::OfCorners(normals) => normals[triangle],
            };
            let patch = CurvedTriangle::new(points, normals);
            let bulge = patch.largest_bulge();
            let near = extents.grown(bulge);
            for row in in_rows {
                for column in in_columns.clone() {
                    let at = origin + Vector2::new(column as f64, row as f64) * step;
                    if !near.contains(at) {
                        continue;
                    }
                    let Some(hit) = patch.hit(at) else { continue };
                    let seen = &mut hits[row * columns + column];
                    // A bare facet under a neighbour's bulge must not win over the true surface by its sagitta.
                    let lead = if hit.on_patch { 0.0 } else { 2.0 * bulge };
                    match seen {
                        Some(old) if old.on_patch && hit.height <= old.height + lead => {}
                        Some(old) if !old.on_patch && hit.height + 2.0 * bulge <= old.height => {}
                        Some(old) if !old.on_patch && !hit.on_patch && hit.height <= old.height => {}
                        _ => *seen = Some(hit),
                    }
                }
            }
        }
        HeightField::from_hits(origin, step, columns, rows, &hits)
    }
}

impl HeightField {
    /// A height field from its nodes, row by row; `None` if their number does not fit or the grid is no grid.
    pub fn new(
        origin: Vector2<f64>,
        step: f64,
        columns: usize,
        rows: usize,
        nodes: Vec<Node>,
    ) -> Option<Self> {
        let fits = columns.checked_mul(rows) == Some(nodes.len()) && columns > 1 && rows > 1;
        (fits && step > 0.0 && step.is_finite() && origin.iter().all(|value| value.is_finite()))
            .then_some(Self { origin, step, columns, rows, nodes })
    }

    fn from_hits(
        origin: Vector2<f64>,
        step: f64,
        columns: usize,
        rows: usize,
        hits: &[Option<super::curved_triangle::Hit>],
    ) -> Self {
        let steepest = STEEPEST_SURFACE.tan();
        let mut nodes: Vec<Node> = hits
            .iter()
            .map(|hit| match hit {
                None => Node::Empty,
                Some(hit) if hit.steepness <= steepest => Node::Surface(hit.height),
                Some(hit) => Node::Wall(hit.height),
            })
            .collect();
        let steepness = |index: usize| hits[index].map_or(0.0, |hit| hit.steepness.min(steepest));
        let mut brink = |first: usize, second: usize| {
            let (Some(a), Some(b)) = (hits[first], hits[second]) else { return };
            // Between two nodes a smooth surface climbs no faster than its slopes there, with room for curvature.
            let climb = 2.0 * steepness(first).max(steepness(second)) + 1.0;
            if (a.height - b.height).abs() > climb * step {
                nodes[first] = Node::Wall(a.height);
                nodes[second] = Node::Wall(b.height);
            }
        };
        for row in 0..rows {
            for column in 0..columns {
                let here = row * columns + column;
                if column + 1 < columns {
                    brink(here, here + 1);
                }
                if row + 1 < rows {
                    brink(here, here + columns);
                }
            }
        }
        Self { origin, step, columns, rows, nodes }
    }

    /// The lower left node, mm.
    pub fn origin(&self) -> Vector2<f64> {
        self.origin
    }

    /// Distance between nodes, mm.
    pub fn step(&self) -> f64 {
        self.step
    }

    /// Number of columns and rows.
    pub fn size(&self) -> (usize, usize) {
        (self.columns, self.rows)
    }

    /// The nodes, row by row from the lower left.
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// Where a node lies.
    pub fn position(&self, column: usize, row: usize) -> ViewPoint {
        (self.origin + Vector2::new(column as f64, row as f64) * self.step).into()
    }

    /// All nodes on the smooth surface: (column, row, height in mm).
    pub fn surface_nodes(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        self.nodes.iter().enumerate().filter_map(|(index, node)| match node {
            Node::Surface(height) => Some((index % self.columns, index / self.columns, *height)),
            _ => None,
        })
    }

    /// The grid cell that holds a point and the point's place in it, 0 to 1 along x and y.
    pub fn cell(&self, at: ViewPoint) -> Option<(usize, usize, Vector2<f64>)> {
        let place = (at.coords() - self.origin) / self.step;
        let largest = Vector2::new((self.columns - 1) as f64, (self.rows - 1) as f64);
        if !(place.x >= 0.0 && place.y >= 0.0 && place.x <= largest.x && place.y <= largest.y) {
            return None;
        }
        let (column, row) = ((place.x as usize).min(self.columns - 2), (place.y as usize).min(self.rows - 2));
        Some((column, row, place - Vector2::new(column as f64, row as f64)))
    }

    /// The four nodes round a cell: lower left, lower right, upper left, upper right.
    pub fn cell_nodes(&self, column: usize, row: usize) -> [usize; 4] {
        let lower = row * self.columns + column;
        [lower, lower + 1, lower + self.columns, lower + self.columns + 1]
    }

    /// Whether the point lies on the smooth surface: all four nodes round it do.
    pub fn is_surface(&self, at: ViewPoint) -> bool {
        self.cell(at).is_some_and(|(column, row, _)| {
            self.cell_nodes(column, row).iter().all(|&index| matches!(self.nodes[index], Node::Surface(_)))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::space::Facing;

    fn mesh(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> TriMesh {
        TriMesh::new(positions.iter().map(|&p| Point3::from(p)).collect(), Vec::new(), triangles.to_vec())
            .unwrap()
    }

    /// A 10 × 10 mm plate at z = 0 with a 4 × 4 mm plate 3 mm above its middle.
    fn two_floors() -> TriMesh {
        let square =
            |half: f64, z: f64| [[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]];
        let positions: Vec<_> = square(5.0, 0.0).into_iter().chain(square(2.0, 3.0)).collect();
        mesh(&positions, &[[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    }

    #[test]
    fn the_side_nearest_to_the_laser_is_seen_and_cliffs_are_walls() {
        let field = FacingPart::new(&two_floors(), &View::top()).sample(0.5);
        let node = |x: f64, y: f64| {
            let (column, row, _) = field.cell(ViewPoint::new(x, y)).unwrap();
            field.nodes()[field.cell_nodes(column, row)[0]]
        };
        assert_eq!(node(0.0, 0.0), Node::Surface(3.0));
        assert_eq!(node(4.0, 4.0), Node::Surface(0.0));
        assert_eq!(node(2.0, 0.0), Node::Wall(3.0));
        assert_eq!(node(2.5, 0.0), Node::Wall(0.0));
        assert!(!field.is_surface(ViewPoint::new(2.2, 0.0)) && field.is_surface(ViewPoint::new(3.2, 0.0)));
    }

    #[test]
    fn from_below_the_other_side_is_seen() {
        let below = View::new(Facing::towards(-Vector3::z()).unwrap(), 0.0);
        let field = FacingPart::new(&two_floors(), &below).sample(1.0);
        assert!(field.surface_nodes().all(|(_, _, height)| height.abs() < 1e-12));
        assert_eq!(field.surface_nodes().count(), 121);
    }

    #[test]
    fn a_hole_stays_visible() {
        let ring = mesh(
            &[
                [-4.0, -4.0, 1.0],
                [4.0, -4.0, 1.0],
                [4.0, 4.0, 1.0],
                [-4.0, 4.0, 1.0],
                [-1.0, -1.0, 1.0],
                [1.0, -1.0, 1.0],
                [1.0, 1.0, 1.0],
                [-1.0, 1.0, 1.0],
            ],
            &[[0, 1, 5], [0, 5, 4], [1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6], [3, 0, 4], [3, 4, 7]],
        );
        let field = FacingPart::new(&ring, &View::top()).sample(0.5);
        assert!(!field.is_surface(ViewPoint::new(0.1, 0.1)) && field.is_surface(ViewPoint::new(2.1, 2.1)));
    }
}
