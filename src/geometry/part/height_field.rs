//! The height field: the height of the part over a grid of the view, as the laser sees it.

use nalgebra::Vector2;

use crate::geometry::space::{Extents, ViewPoint};

/// Surface whose normal differs from the laser's axis by more than this, rad, is treated as a wall. The limit
/// for marking is lower (60° by default); the fit uses the surface between the two limits as a border.
pub const STEEPEST_SURFACE: f64 = 75.0 * std::f64::consts::PI / 180.0;

/// The largest squared slope of surface whose steps and details are looked for: 60°, the angle beyond which drawings are rejected by
/// default. Steeper surface is fitted without them.
pub(crate) const STEEPEST_REFINED: f64 = 3.0;

/// The number that stands for no face: the face of a node is not known, or there is none.
pub(crate) const NO_FACE: u32 = u32::MAX;

/// What the laser meets at a grid node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Node {
    /// Nothing: outside the part, or a hole through it.
    Empty,
    /// Surface that is too steep to mark, or at a cliff. Its height, mm, is not part of the smooth surface.
    Wall(f64),
    /// Surface at this height, mm.
    Surface(f64),
}

/// A square grid over the view, mm; its nodes are at whole multiples of the step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// The lower left node.
    pub origin: Vector2<f64>,
    /// Distance between nodes, mm.
    pub step: f64,
    /// Nodes along x.
    pub columns: usize,
    /// Nodes along y.
    pub rows: usize,
}

/// Heights of the part's side that faces the laser, on a square grid of the view, mm.
#[derive(Debug, Clone, PartialEq)]
pub struct HeightField {
    pub(super) grid: Grid,
    pub(super) nodes: Vec<Node>,
    /// For each node, the face of the part that it is on; empty if no edge is between two faces.
    pub(super) faces: Vec<u32>,
}

impl Grid {
    /// The grid over `extents`, with an odd number of nodes along both sides.
    pub fn over(extents: &Extents, step: f64) -> Self {
        let first = (extents.min / step).map(f64::floor);
        let count = (extents.max / step).map(f64::ceil) - first;
        let odd = |count: f64| (count as usize).next_multiple_of(2) + 1;
        Self { origin: first * step, step, columns: odd(count.x), rows: odd(count.y) }
    }

    /// The grid over the same rectangle with half the step.
    pub fn halved(&self) -> Self {
        Self { step: self.step / 2.0, columns: 2 * self.columns - 1, rows: 2 * self.rows - 1, ..*self }
    }

    /// The position of a node.
    pub fn position(&self, column: usize, row: usize) -> ViewPoint {
        (self.origin + Vector2::new(column as f64, row as f64) * self.step).into()
    }

    /// Where the columns are along x and the rows along y, mm.
    pub fn coordinates(&self) -> (Vec<f64>, Vec<f64>) {
        let along = |first: f64, count: usize| (0..count).map(|at| first + at as f64 * self.step).collect();
        (along(self.origin.x, self.columns), along(self.origin.y, self.rows))
    }

    /// Number of nodes.
    pub fn count(&self) -> usize {
        self.columns * self.rows
    }

    /// The column and row of the grid cell that contains a point, and the point's place in it, 0 to 1 along x and y.
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

    /// The nodes beside a node along x and y.
    pub(crate) fn beside(&self, node: usize) -> impl Iterator<Item = usize> + use<> {
        let (column, row) = (node % self.columns, node / self.columns);
        let beside = [
            (column > 0).then(|| node - 1),
            (column + 1 < self.columns).then_some(node + 1),
            (row > 0).then(|| node - self.columns),
            (row + 1 < self.rows).then_some(node + self.columns),
        ];
        beside.into_iter().flatten()
    }

    /// The nodes from `low` to `high` along a side of `count` nodes that starts at `start`.
    pub(super) fn range(&self, low: f64, high: f64, start: f64, count: usize) -> std::ops::Range<usize> {
        let [low, high] = [low, high].map(|at| (at - start) / self.step);
        // Casts round towards zero, and are faster than functions that round.
        let whole = low.max(0.0) as u32;
        let from = whole as usize + usize::from(f64::from(whole) < low);
        let to = if high >= 0.0 { (high as u32 as usize + 1).min(count) } else { 0 };
        from..to
    }
}

impl HeightField {
    /// A height field from its nodes, row by row; `None` if their number does not match or the grid is invalid.
    pub fn new(
        origin: Vector2<f64>,
        step: f64,
        columns: usize,
        rows: usize,
        nodes: Vec<Node>,
    ) -> Option<Self> {
        let fits = columns.checked_mul(rows) == Some(nodes.len()) && columns > 1 && rows > 1;
        (fits && step > 0.0 && step.is_finite() && origin.iter().all(|value| value.is_finite()))
            .then_some(Self { grid: Grid { origin, step, columns, rows }, nodes, faces: Vec::new() })
    }

    /// The field with the face of the part on which each node is; a list whose length does not match is ignored.
    pub fn with_faces(self, faces: Vec<u32>) -> Self {
        let faces = if faces.len() == self.nodes.len() { faces } else { Vec::new() };
        Self { faces, ..self }
    }

    /// For each node, the face of the part that it is on; empty if no edge is between two faces.
    pub fn faces(&self) -> &[u32] {
        &self.faces
    }

    /// Whether no edge of the part is known to be between two nodes.
    pub(crate) fn are_on_one_face(&self, one: usize, other: usize) -> bool {
        let face = |node: usize| self.faces.get(node).copied().unwrap_or(NO_FACE);
        face(one) == face(other) || face(one) == NO_FACE || face(other) == NO_FACE
    }

    /// Changes the heights of the surface: `change` gets the index of a node and its height, mm, and returns the new one.
    pub fn adjust(&mut self, change: impl Fn(usize, f64) -> f64) {
        for (index, node) in self.nodes.iter_mut().enumerate() {
            if let Node::Surface(height) = node {
                *height = change(index, *height);
            }
        }
    }

    /// The grid.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The lower left node, mm.
    pub fn origin(&self) -> Vector2<f64> {
        self.grid.origin
    }

    /// Distance between nodes, mm.
    pub fn step(&self) -> f64 {
        self.grid.step
    }

    /// Number of columns and rows.
    pub fn size(&self) -> (usize, usize) {
        (self.grid.columns, self.grid.rows)
    }

    /// The nodes, row by row from the lower left.
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// The position of a node.
    pub fn position(&self, column: usize, row: usize) -> ViewPoint {
        self.grid.position(column, row)
    }

    /// For each node of the smooth surface, whether it is within `reach` steps of a wall along rows and
    /// columns; empty if there are no walls.
    pub(crate) fn near_walls(&self, reach: usize) -> Vec<bool> {
        let is_wall = |node: &Node| matches!(node, Node::Wall(_));
        let mut near: Vec<bool> = self.nodes.iter().map(is_wall).collect();
        if near.contains(&true) {
            near = grown(&near, self.grid.columns, reach);
        }
        near.iter_mut().zip(&self.nodes).for_each(|(near, node)| *near &= matches!(node, Node::Surface(_)));
        near
    }

    /// For each node of the smooth surface, whether it is within `reach` steps of another face along rows and
    /// columns.
    pub(crate) fn near_other_faces(&self, reach: usize) -> Vec<bool> {
        let mut near = vec![false; self.nodes.len()];
        if self.faces.is_empty() {
            return near;
        }
        let is_surface = |node: usize| matches!(self.nodes[node], Node::Surface(_));
        for_each_side(&self.grid, |one, other, _| {
            if is_surface(one) && is_surface(other) && !self.are_on_one_face(one, other) {
                (near[one], near[other]) = (true, true);
            }
        });
        let mut near = grown(&near, self.grid.columns, reach - 1);
        (0..near.len()).for_each(|node| near[node] &= is_surface(node));
        near
    }

    /// The slope at a node that follows from the heights of one or two nodes on one side of it along x, and of one side along y, on
    /// the same face; of several, those nearest to a slope. `None` where there are none.
    pub(crate) fn gradient_beside(&self, node: usize, near: Vector2<f64>) -> Option<Vector2<f64>> {
        let Grid { step, columns, rows, .. } = self.grid;
        let here = match self.nodes[node] {
            Node::Surface(height) => height,
            Node::Empty | Node::Wall(_) => return None,
        };
        let (column, row) = (node % columns, node / columns);
        let along = |at: usize, count: usize, apart: usize, near: f64| {
            let height = |steps: isize| {
                let place = at.checked_add_signed(steps).filter(|place| *place < count)?;
                let other = node + place * apart - at * apart;
                match self.nodes[other] {
                    Node::Surface(height) if self.are_on_one_face(node, other) => Some(height),
                    Node::Surface(_) | Node::Empty | Node::Wall(_) => None,
                }
            };
            let one_sided = [1, -1].into_iter().flat_map(|way: isize| {
                let first = height(way);
                let second = first.and(height(2 * way));
                let along = step * way as f64;
                [
                    first.map(|first| (first - here) / along),
                    first
                        .zip(second)
                        .map(|(first, second)| (4.0 * first - second - 3.0 * here) / (2.0 * along)),
                ]
            });
            let both = height(-1).zip(height(1)).map(|(low, high)| (high - low) / (2.0 * step));
            let found = one_sided.flatten().chain(both);
            found.min_by(|one, other| (one - near).abs().total_cmp(&(other - near).abs()))
        };
        Some(Vector2::new(along(column, columns, 1, near.x)?, along(row, rows, columns, near.y)?))
    }

    /// All nodes on the smooth surface: (column, row, height in mm).
    pub fn surface_nodes(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        self.nodes.iter().enumerate().filter_map(|(index, node)| match node {
            Node::Surface(height) => Some((index % self.grid.columns, index / self.grid.columns, *height)),
            _ => None,
        })
    }

    /// Those of [`Self::surface_nodes`] within a rectangle, mm, and some beside it, in the same order.
    pub(crate) fn surface_nodes_about(
        &self,
        within: &Extents,
    ) -> impl Iterator<Item = (usize, usize, f64)> + use<'_> {
        let Grid { origin, step, columns, rows } = self.grid;
        let between = |along: usize, count: usize| {
            // A cast saturates.
            let index = |place: f64| ((place - origin[along]) / step) as usize;
            index(within.min[along]).min(count)..index(within.max[along]).saturating_add(2).min(count)
        };
        let (across, up) = (between(0, columns), between(1, rows));
        up.flat_map(move |row| across.clone().map(move |column| (column, row))).filter_map(
            move |(column, row)| match self.nodes[row * columns + column] {
                Node::Surface(height) => Some((column, row, height)),
                _ => None,
            },
        )
    }

    /// The bounding rectangle of all nodes on the part, mm, with its walls; the part ends less than a step beyond it.
    pub fn extents(&self) -> Extents {
        let on_part = self.nodes.iter().enumerate().filter(|(_, node)| **node != Node::Empty);
        let columns = self.grid.columns;
        Extents::of(on_part.map(|(index, _)| self.position(index % columns, index / columns).coords()))
    }

    /// The column and row of the grid cell that contains a point, and the point's place in it, 0 to 1 along x and y.
    pub fn cell(&self, at: ViewPoint) -> Option<(usize, usize, Vector2<f64>)> {
        self.grid.cell(at)
    }

    /// The four nodes round a cell: lower left, lower right, upper left, upper right.
    pub fn cell_nodes(&self, column: usize, row: usize) -> [usize; 4] {
        self.grid.cell_nodes(column, row)
    }

    /// Whether a node within `distance` mm of a place of the view is on the smooth surface.
    pub fn has_surface_near(&self, place: ViewPoint, distance: f64) -> bool {
        self.surface_nodes().any(|(column, row, _)| self.position(column, row).distance(place) <= distance)
    }

    /// Whether the point is on the smooth surface: all four nodes round it are.
    pub fn is_surface(&self, at: ViewPoint) -> bool {
        self.cell(at).is_some_and(|(column, row, _)| {
            self.cell_nodes(column, row).iter().all(|&index| matches!(self.nodes[index], Node::Surface(_)))
        })
    }
}

/// The marked nodes and those within `reach` steps of them along rows and columns, in rows of `columns` nodes.
pub(crate) fn grown(marked: &[bool], columns: usize, reach: usize) -> Vec<bool> {
    let rows = marked.len() / columns;
    let along_rows = grown_along(marked, (rows, columns), (columns, 1), reach);
    grown_along(&along_rows, (columns, rows), (1, columns), reach)
}

/// The same along lines of nodes only: `lines` and the nodes of each, and the distances in the list from line to line and from node
/// to node.
fn grown_along(
    marked: &[bool],
    (lines, nodes): (usize, usize),
    (to_line, to_node): (usize, usize),
    reach: usize,
) -> Vec<bool> {
    let mut grown = vec![false; marked.len()];
    for line in 0..lines {
        let mut done = 0;
        for node in (0..nodes).filter(|node| marked[line * to_line + node * to_node]) {
            for near in node.saturating_sub(reach).max(done)..(node + reach + 1).min(nodes) {
                grown[line * to_line + near * to_node] = true;
                done = near + 1;
            }
        }
    }
    grown
}

/// Visits every pair of nodes that are neighbours along x or y, with the step from the first to the second, mm.
pub(super) fn for_each_side(grid: &Grid, mut visit: impl FnMut(usize, usize, Vector2<f64>)) {
    for row in 0..grid.rows {
        for column in 0..grid.columns {
            let here = row * grid.columns + column;
            if column + 1 < grid.columns {
                visit(here, here + 1, Vector2::new(grid.step, 0.0));
            }
            if row + 1 < grid.rows {
                visit(here, here + grid.columns, Vector2::new(0.0, grid.step));
            }
        }
    }
}
