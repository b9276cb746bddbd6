//! The surface of some regions of a part, as if it had no others: across the mouth of a drilled hole, or under a boss, it
//! continues smoothly.
//!
//! A spline that follows a cliff swings beside it, and any map across the cliff folds. A drawing that is marked beside a hole
//! needs only the surface round the hole.

use std::collections::BTreeMap;

use nalgebra::{Matrix2, Vector2, Vector3};

use super::windows::covering;
use super::{Data, FACE_REACH, FitError, FitOptions, FittedSurface, Window};
use crate::geometry::facing_part::Uncertainty;
use crate::geometry::fork::Fork;
use crate::geometry::height_field::{HeightField, Node, STEEPEST_SURFACE, grown};
use crate::geometry::space::{Extents, ViewPoint};
use crate::geometry::surface::knots::DEGREE;
use crate::geometry::surface::nurbs::NurbsSurface;

/// Control points within this many spans of a region that is left out are determined again. A cubic spline
/// that follows a step swings beside it. In each span, the swing is 0.27 times that in the span before, so
/// that a step of 30 mm leaves less than 0.1 µm beyond these spans.
const SWING: usize = 16;

/// The same number of spans where there is no step but an edge. The spline misses an edge by less than half a
/// span, which is about 1 mm.
const SWING_AT_EDGE: usize = 8;

/// The squares that make up inked areas extend beyond their outline by less than this, mm.
const OVERHANG: f64 = 0.5;

/// At most this many nodes beyond an edge continue a face.
const MOST_LAYERS: f64 = 8.0;

/// Number of passes in which control points are determined again. They start on a plane. The smoothness
/// penalty applies to the change from the start of a pass. In the first pass it would pull them towards the
/// plane. In the last one it no longer does.
const PASSES: usize = 5;

/// What is between the surface and the places that it is without.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Beyond {
    /// Edges of the part, at which the slope changes.
    Edges,
    /// Steps, at which the height does.
    Steps,
}

impl FittedSurface {
    /// The surface of a whole part without the places of its smooth surface for which `is_left_out`: nodes there are walls. In a
    /// rectangle, mm, it continues the others smoothly, and it is the same surface far from there.
    ///
    /// # Errors
    /// When the equations cannot be solved.
    pub fn without(
        &self,
        is_left_out: impl Fn(ViewPoint) -> bool,
        within: &Extents,
        beyond: Beyond,
        fork: &dyn Fork,
    ) -> Result<Self, FitError> {
        let Some((field, left_out)) = self.field.with_walls(&is_left_out) else { return Ok(self.clone()) };
        let is_free = self.control_points_near(&left_out, within, beyond);
        let data = Data::of_all(&field, fork);
        let start = self.levelled(&data, &is_free).unwrap_or_else(|| self.nurbs.clone());
        let nurbs = data.move_towards(start, |point| is_free[point], PASSES)?;
        let mut whole = self.alike(nurbs, field, &left_out);
        let mut windows = Vec::with_capacity(self.windows.len());
        for window in &self.windows {
            whole.windows.clone_from(&windows);
            let without = match within.touches(&window.rectangle()) {
                true => whole.window_without(window, &is_left_out, fork)?,
                false => None,
            };
            windows.push(without.unwrap_or_else(|| window.clone()));
        }
        whole.windows.clear();
        Ok(whole.through(windows))
    }

    /// A window without some places, fitted again from what this surface has there with larger spans; `None` if it has none of these
    /// places.
    fn window_without(
        &self,
        window: &Window,
        is_left_out: &dyn Fn(ViewPoint) -> bool,
        fork: &dyn Fork,
    ) -> Result<Option<Window>, FitError> {
        let Window { level, first, core, surface } = window;
        let Some((field, left_out)) = surface.field.with_walls(is_left_out) else { return Ok(None) };
        let (x, y) = surface.nurbs.knots();
        let spans = [first[0]..first[0] + x.spans(), first[1]..first[1] + y.spans()];
        let Some(before) = self.over(level - 1, &covering(&spans, 1)) else { return Ok(None) };
        let nurbs = Data::of_all(&field, fork).correct(before.halved(), FitOptions::default().tolerance)?;
        let surface = surface.alike(nurbs, field, &left_out);
        Ok(Some(Window { level: *level, first: *first, core: core.clone(), surface }))
    }

    /// Another surface without some nodes, with what is known of the part. An edge is between two nodes: as far as the next ones
    /// beyond it, the new surface continues the face on this side.
    fn alike(&self, nurbs: NurbsSurface, field: HeightField, left_out: &[bool]) -> Self {
        let beyond = self.field.beyond_edges(left_out);
        let (mut doubts, mut uncertainties) = (self.doubts.clone(), self.uncertainties.clone());
        let columns = field.size().0;
        let continued = beyond.iter().map(|(node, kept)| {
            let at = field.position(node % columns, node / columns);
            (*node, field.faces()[*kept], nurbs.height(at))
        });
        let continued: Vec<_> = continued.collect();
        if !self.alone.is_empty() && !beyond.is_empty() {
            let is_near = grown(left_out, columns, FACE_REACH);
            uncertainties.resize(left_out.len(), Uncertainty::NONE);
            for (node, alone) in self.alone.iter().filter(|(node, _)| is_near[*node]) {
                uncertainties[*node] = *alone;
            }
        }
        for (node, kept) in beyond {
            if !doubts.is_empty() {
                doubts[node] = doubts[kept];
            }
            if !uncertainties.is_empty() {
                uncertainties[node] = uncertainties[kept];
            }
        }
        Self::compare(nurbs, field.with_continued(&continued))
            .doubted(doubts, uncertainties)
            .with_known(self.known.clone())
            .measured(self.is_measured)
    }

    /// Whether each control point is near one of the marked nodes in a rectangle, mm.
    fn control_points_near(&self, marked: &[bool], within: &Extents, beyond: Beyond) -> Vec<bool> {
        let (knots_x, knots_y) = self.nurbs.knots();
        let (columns, rows) = (knots_x.control_points(), knots_y.control_points());
        let mut near = vec![false; columns * rows];
        let nodes = self.field.size().0;
        for node in (0..marked.len()).filter(|node| marked[*node]) {
            let at = self.field.position(node % nodes, node / nodes);
            if !within.contains(at.coords()) {
                continue;
            }
            let (first_x, first_y) = (knots_x.span(at.x), knots_y.span(at.y));
            for row in first_y..=first_y + DEGREE {
                near[row * columns + first_x..=row * columns + first_x + DEGREE].fill(true);
            }
        }
        let reach = match beyond {
            Beyond::Edges => SWING_AT_EDGE,
            Beyond::Steps => SWING,
        };
        grown(&near, columns, reach)
    }

    /// The surface with its free control points on the plane through the data near them; `None` if there is none.
    fn levelled(&self, data: &Data<'_>, is_free: &[bool]) -> Option<NurbsSurface> {
        let (knots_x, knots_y) = self.nurbs.knots();
        let columns = knots_x.control_points();
        let near = data.field.surface_nodes().filter_map(|(column, row, height)| {
            let at = data.field.position(column, row);
            let point = knots_y.span(at.y) * columns + knots_x.span(at.x);
            let is_near = data.used[row * data.field.size().0 + column] && is_free[point];
            is_near.then(|| Vector3::new(at.x, at.y, height))
        });
        let near: Vec<Vector3<f64>> = near.collect();
        let mean = (!near.is_empty()).then(|| near.iter().sum::<Vector3<f64>>() / near.len() as f64)?;
        let (mut matrix, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for place in &near {
            let from_mean = place - mean;
            matrix += from_mean.xy() * from_mean.xy().transpose();
            right += from_mean.xy() * from_mean.z;
        }
        // Data on one line do not determine a plane.
        let slope = matrix.cholesky().map(|matrix| matrix.solve(&right));
        let slope = slope.filter(|slope| slope.norm() <= STEEPEST_SURFACE.tan()).unwrap_or_default();
        let on_plane = |point: usize| {
            let at = Vector2::new(knots_x.greville(point % columns), knots_y.greville(point / columns));
            mean.z + slope.dot(&(at - mean.xy()))
        };
        let heights = self.nurbs.heights().iter().zip(is_free).enumerate();
        let heights =
            heights.map(|(point, (height, is_free))| if *is_free { on_plane(point) } else { *height });
        NurbsSurface::new(knots_x, knots_y, heights.collect())
    }
}

impl<'a> Data<'a> {
    /// All nodes of the smooth surface.
    fn of_all(field: &'a HeightField, fork: &'a dyn Fork) -> Self {
        let is_surface = |node: &Node| matches!(node, Node::Surface(_));
        Self { field, used: field.nodes().iter().map(is_surface).collect(), fork }
    }
}

impl HeightField {
    /// The field with walls at the places of its smooth surface for which `is_wall`, and these; `None` if there are none.
    fn with_walls(&self, is_wall: &dyn Fn(ViewPoint) -> bool) -> Option<(Self, Vec<bool>)> {
        let (columns, rows) = self.size();
        let mut marked = vec![false; self.nodes().len()];
        for (column, row, _) in self.surface_nodes() {
            marked[row * columns + column] = is_wall(self.position(column, row));
        }
        let nodes = self.nodes().iter().zip(&marked).map(|(node, is_wall)| match node {
            Node::Surface(height) if *is_wall => Node::Wall(*height),
            node => *node,
        });
        let field = Self::new(self.origin(), self.step(), columns, rows, nodes.collect())?;
        let field = field.with_faces(self.faces().to_vec());
        marked.contains(&true).then_some((field, marked))
    }

    /// The nodes among those left out that are just beyond an edge, in ascending order, each with a node of the face on this side: those
    /// round one cell, and as far as inked squares may reach over the edge.
    fn beyond_edges(&self, left_out: &[bool]) -> BTreeMap<usize, usize> {
        let mut beyond = BTreeMap::new();
        if self.faces().is_empty() {
            return beyond;
        }
        let (columns, rows) = self.size();
        for row in 0..rows - 1 {
            for column in 0..columns - 1 {
                let nodes = self.cell_nodes(column, row);
                let kept = nodes.iter().find(|node| !left_out[**node]);
                let is_surface = |node: &usize| matches!(self.nodes()[*node], Node::Surface(_));
                let Some(kept) = kept.filter(|_| nodes.iter().all(is_surface)) else { continue };
                for node in nodes {
                    if left_out[node] && !self.are_on_one_face(node, *kept) {
                        beyond.entry(node).or_insert(*kept);
                    }
                }
            }
        }
        let layers = (OVERHANG / self.step()).ceil().min(MOST_LAYERS) as usize;
        for _ in 1..layers {
            let mut next = BTreeMap::new();
            for (&node, &kept) in &beyond {
                let is_free = |node: &usize| left_out[*node] && !beyond.contains_key(node);
                for other in self.grid().beside(node).filter(is_free) {
                    next.entry(other).or_insert(kept);
                }
            }
            beyond.append(&mut next);
        }
        beyond
    }

    /// The field with other nodes of its surface: their indices, faces and heights, mm.
    fn with_continued(self, others: &[(usize, u32, f64)]) -> Self {
        let (mut nodes, mut faces) = (self.nodes().to_vec(), self.faces().to_vec());
        for (node, face, height) in others {
            (nodes[*node], faces[*node]) = (Node::Surface(*height), *face);
        }
        let (columns, rows) = self.size();
        match Self::new(self.origin(), self.step(), columns, rows, nodes) {
            Some(field) if !others.is_empty() => field.with_faces(faces),
            _ => self,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::fork::InTurn;
    use crate::geometry::space::ViewPoint;
    use nalgebra::Vector2;

    /// A cylinder with a radius of 25 mm along x, with a hole of a radius of 4 mm down to a flat floor.
    fn drilled(floor: f64) -> FittedSurface {
        let node = |index: usize| {
            let [x, y] = [index % 121, index / 121].map(|at| at as f64 * 0.25 - 15.0);
            let (round, from_axis) = ((625.0 - y * y).sqrt(), x.hypot(y));
            match from_axis {
                ..=3.75 => Node::Surface(floor),
                ..=4.25 => Node::Wall(round),
                _ => Node::Surface(round),
            }
        };
        let nodes = (0..121 * 121).map(node).collect();
        let field = HeightField::new(Vector2::repeat(-15.0), 0.25, 121, 121, nodes).unwrap();
        FittedSurface::of_field(field).unwrap()
    }

    #[test]
    fn without_the_floor_of_a_hole_the_surface_is_that_of_the_part_without_the_hole() {
        let everywhere = Extents { min: Vector2::repeat(-20.0), max: Vector2::repeat(20.0) };
        for floor in [0.0, 24.0, 40.0] {
            let surface = drilled(floor);
            let is_in_hole = |at: ViewPoint| at.coords().norm() < 4.0;
            let round = surface.without(is_in_hole, &everywhere, Beyond::Steps, &InTurn).unwrap();
            assert!(!round.field.is_surface(ViewPoint::new(0.1, 0.1)));
            for step in 0..400 {
                let (angle, radius) = (f64::from(step) * 2.4, 12.0 * f64::from(step) / 400.0);
                let at = ViewPoint::new(radius * angle.cos(), radius * angle.sin());
                let off = round.nurbs.height(at) - (625.0 - at.y * at.y).sqrt();
                let limit = if radius > 4.5 { 2e-5 } else { 5e-3 };
                assert!(off.abs() < limit, "{off} mm at {at:?}, floor at {floor}");
            }
            let flat = surface.without(|at| !is_in_hole(at), &everywhere, Beyond::Steps, &InTurn).unwrap();
            let off = flat.nurbs.height(ViewPoint::new(2.0, 1.0)) - floor;
            assert!(off.abs() < 1e-6, "{off} mm");
        }
    }
}
