//! The surface of some regions of a part, as if it had no others: across the mouth of a drilled hole, or under a boss, it
//! continues smoothly.
//!
//! A spline that follows a cliff swings beside it, and any map across the cliff folds. A drawing that is marked beside a hole
//! needs only the surface round the hole.

use super::windows::covering;
use super::{Data, FitError, FitOptions, FittedSurface, Window};
use crate::geometry::fork::Fork;
use crate::geometry::height_field::{HeightField, Node, grown};
use crate::geometry::space::ViewPoint;
use crate::geometry::surface::knots::DEGREE;
use crate::geometry::surface::nurbs::NurbsSurface;

/// Control points within so many spans of a region that is left out are determined again. A cubic spline that follows a step
/// swings beside it by 0.27 times as much in each span, so that a step of 30 mm leaves less than 0.1 µm beyond them.
const SWING: usize = 16;

/// The control points that are determined again start at one height. Smoothness applies to the way from there, which would pull
/// them towards it; from where that way ends it no longer does.
const PASSES: usize = 2;

impl FittedSurface {
    /// The surface of a whole part without the places of its smooth surface for which `is_left_out`: nodes there are walls. It
    /// continues the others smoothly, and is the same surface far from them.
    ///
    /// # Errors
    /// When the equations cannot be solved.
    pub fn without(
        &self,
        is_left_out: impl Fn(ViewPoint) -> bool,
        fork: &dyn Fork,
    ) -> Result<Self, FitError> {
        let Some((field, left_out)) = self.field.with_walls(&is_left_out) else { return Ok(self.clone()) };
        let is_free = self.control_points_near(&left_out);
        let data = Data::of_all(&field, fork);
        let mut nurbs = self.levelled(&data, &is_free).unwrap_or_else(|| self.nurbs.clone());
        for _ in 0..PASSES {
            nurbs = data.move_towards(nurbs, |point| is_free[point])?;
        }
        let mut whole = self.alike(nurbs, field);
        let mut windows = Vec::with_capacity(self.windows.len());
        for window in &self.windows {
            whole.windows.clone_from(&windows);
            windows.push(whole.window_without(window, &is_left_out, fork)?.unwrap_or_else(|| window.clone()));
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
        let Some((field, _)) = surface.field.with_walls(is_left_out) else { return Ok(None) };
        let (x, y) = surface.nurbs.knots();
        let spans = [first[0]..first[0] + x.spans(), first[1]..first[1] + y.spans()];
        let Some(before) = self.over(level - 1, &covering(&spans, 1)) else { return Ok(None) };
        let nurbs = Data::of_all(&field, fork).correct(before.halved(), FitOptions::default().tolerance)?;
        let surface = surface.alike(nurbs, field);
        Ok(Some(Window { level: *level, first: *first, core: core.clone(), surface }))
    }

    /// Another surface and other nodes with what is known of the part.
    fn alike(&self, nurbs: NurbsSurface, field: HeightField) -> Self {
        Self::compare(nurbs, field)
            .doubted(self.doubts.clone(), self.uncertainties.clone())
            .with_known(self.known.clone())
    }

    /// Whether each control point is near one of the marked nodes.
    fn control_points_near(&self, marked: &[bool]) -> Vec<bool> {
        let (knots_x, knots_y) = self.nurbs.knots();
        let (columns, rows) = (knots_x.control_points(), knots_y.control_points());
        let mut near = vec![false; columns * rows];
        let nodes = self.field.size().0;
        for node in (0..marked.len()).filter(|node| marked[*node]) {
            let at = self.field.position(node % nodes, node / nodes);
            let (first_x, first_y) = (knots_x.span(at.x), knots_y.span(at.y));
            for row in first_y..=first_y + DEGREE {
                near[row * columns + first_x..=row * columns + first_x + DEGREE].fill(true);
            }
        }
        grown(&near, columns, SWING)
    }

    /// The surface with its free control points at the mean height of the data near them; `None` if there is none.
    fn levelled(&self, data: &Data<'_>, is_free: &[bool]) -> Option<NurbsSurface> {
        let (knots_x, knots_y) = self.nurbs.knots();
        let columns = knots_x.control_points();
        let (mut sum, mut count) = (0.0, 0usize);
        for (column, row, height) in data.field.surface_nodes() {
            let at = data.field.position(column, row);
            let point = knots_y.span(at.y) * columns + knots_x.span(at.x);
            if data.used[row * data.field.size().0 + column] && is_free[point] {
                (sum, count) = (sum + height, count + 1);
            }
        }
        let mean = (count > 0).then(|| sum / count as f64)?;
        let heights = self.nurbs.heights().iter().zip(is_free);
        let heights = heights.map(|(height, is_free)| if *is_free { mean } else { *height });
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
        marked.contains(&true).then_some((field, marked))
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
        for floor in [0.0, 24.0, 40.0] {
            let surface = drilled(floor);
            let is_in_hole = |at: ViewPoint| at.coords().norm() < 4.0;
            let round = surface.without(is_in_hole, &InTurn).unwrap();
            assert!(!round.field.is_surface(ViewPoint::new(0.1, 0.1)));
            for step in 0..400 {
                let (angle, radius) = (f64::from(step) * 2.4, 12.0 * f64::from(step) / 400.0);
                let at = ViewPoint::new(radius * angle.cos(), radius * angle.sin());
                let off = round.nurbs.height(at) - (625.0 - at.y * at.y).sqrt();
                let limit = if radius > 4.5 { 2e-5 } else { 5e-3 };
                assert!(off.abs() < limit, "{off} mm at {at:?}, floor at {floor}");
            }
            let flat = surface.without(|at| !is_in_hole(at), &InTurn).unwrap();
            let off = flat.nurbs.height(ViewPoint::new(2.0, 1.0)) - floor;
            assert!(off.abs() < 1e-6, "{off} mm");
        }
    }
}
