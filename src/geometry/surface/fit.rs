//! The fit of a NURBS surface to a height field, refined until it is as close as asked for.

use nalgebra::Vector2;

use super::knots::{DEGREE, UniformKnots};
use super::nurbs::{NurbsSurface, SurfaceJet};
use crate::geometry::height_field::{FacingPart, Grid, HeightField, Node, STEEPEST_SURFACE};
use crate::geometry::normal_equations::{CellRow, CellSum, GridSolver, NormalEquations, SolveError};
use crate::geometry::space::ViewPoint;

/// Nodes of the height field along one span of the surface: twice the freedom of the fit along each direction, so that
/// a residual can show.
const NODES_PER_SPAN: usize = 2;

/// Weight of the smoothness penalty against one node's weight of 1: so little that it decides only where there are no
/// nodes.
const SMOOTHNESS: f64 = 1e-6;

/// Nodes do not count within so many steps of those beside an edge of the part: the spline needs a span to turn there.
const EDGE_REACH: usize = 1;

/// The same for the cliffs of a field of measured heights, where the nodes beside a cliff mix heights from both its sides.
const CLIFF_REACH: usize = 2;

/// Nodes needed at least.
const LEAST_NODES: usize = 64;

/// How the surface is fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitOptions {
    /// The residual that 95 % of the nodes should stay below, mm. Missing it doubles the spans, but moves only those
    /// control points that are near a miss, which takes two to three times as long.
    pub tolerance: f64,
    /// Spans along the longer side at the start.
    pub first_spans: usize,
    /// Spans along the longer side at most; it bounds time and memory.
    pub most_spans: usize,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self { tolerance: 0.002, first_spans: 72, most_spans: 256 }
    }
}

/// The surface of a part as the laser sees it, with the samples it was fitted to.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedSurface {
    /// The fitted surface.
    pub nurbs: NurbsSurface,
    /// The sampled part.
    pub field: HeightField,
    /// What the fit leaves.
    pub residual: Residual,
    /// Height of the sampled part less height of the fit at each node, mm; 0 where there is no surface.
    differences: Vec<f64>,
    doubts: Vec<f64>,
}

/// The distance between fit and sampled part along the laser's axis, over the smooth surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// Largest distance, mm.
    pub max: f64,
    /// Where it is largest.
    pub at: ViewPoint,
    /// Root mean square, mm.
    pub rms: f64,
    /// Distance that 95 % of the nodes stay below, mm.
    pub p95: f64,
    /// Number of nodes compared.
    pub nodes: usize,
}

/// Why no surface could be fitted.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum FitError {
    /// Too little of the part faces the laser.
    #[error("only {nodes} of {all} sampled points of the part face the laser at less than {} degrees", limit.to_degrees())]
    NoSurface {
        /// Nodes on the smooth surface.
        nodes: usize,
        /// Nodes of the grid.
        all: usize,
        /// The steepest tilt that counts as surface, rad.
        limit: f64,
    },
    /// The part is too thin or too small to be sampled.
    #[error("the part measures {width} × {height} mm as the laser sees it")]
    TooSmall {
        /// Width of the view, mm.
        width: f64,
        /// Height of the view, mm.
        height: f64,
    },
    /// The equations could not be solved.
    #[error(transparent)]
    Solve(#[from] SolveError),
}

/// What a surface is fitted to: the nodes that count.
struct Data<'a> {
    field: &'a HeightField,
    counts: Vec<bool>,
}

impl FittedSurface {
    /// Samples and fits a part. Where 95 % of the residuals are not within the tolerance, the spacing is halved and the
    /// surface made finer in the places that need it, until they are, the spans are used up, or halving no longer helps
    /// (facets do not get smoother).
    ///
    /// Nodes beside an edge of the part do not count, because no smooth surface runs through them; what the surface
    /// leaves there shows in the residual.
    ///
    /// # Errors
    /// When hardly anything of the part faces the laser, when it is thinner than 1/1000 of its length as the laser sees
    /// it, or when the equations cannot be solved; see [`FitError`].
    pub fn of_part(part: &FacingPart, options: &FitOptions) -> Result<Self, FitError> {
        let size = part.extents().size();
        let longer = size.x.max(size.y);
        if !(size.x.min(size.y) > longer * 1e-3 && longer > 1e-2) {
            return Err(FitError::TooSmall { width: size.x, height: size.y });
        }
        let mut spans = options.first_spans;
        let mut samples = part.sample(&Grid::over(&part.extents(), longer / (spans * NODES_PER_SPAN) as f64));
        let data = Data::beside(&samples.field, &samples.is_at_edge, EDGE_REACH)?;
        let mut nurbs = data.fit()?;
        let mut left = data.p95(&nurbs);
        while left > options.tolerance && spans * 2 <= options.most_spans {
            spans *= 2;
            samples = part.sample(&samples.field.grid().halved());
            let data = Data::beside(&samples.field, &samples.is_at_edge, EDGE_REACH)?;
            nurbs = data.correct(nurbs.halved(), options.tolerance)?;
            let before = std::mem::replace(&mut left, data.p95(&nurbs));
            if before < 2.0 * left {
                break;
            }
        }
        Ok(Self::compare(nurbs, samples.field).doubted(samples.doubts))
    }

    /// Fits a height field by least squares, one span for every two nodes. Nodes beside a cliff do not count, because a
    /// spline that follows them rings for centimetres; where there is no surface it is continued smoothly instead of by
    /// zeros, which would make it ring at the rim.
    ///
    /// # Errors
    /// When the field has fewer than 64 nodes on the surface, or when the equations cannot be solved.
    pub fn of_field(field: HeightField) -> Result<Self, FitError> {
        let is_wall: Vec<bool> = field.nodes().iter().map(|node| matches!(node, Node::Wall(_))).collect();
        let nurbs = Data::beside(&field, &is_wall, CLIFF_REACH)?.fit()?;
        Ok(Self::compare(nurbs, field))
    }

    /// A surface beside the samples it stands for: the residual is measured anew.
    pub fn compare(nurbs: NurbsSurface, field: HeightField) -> Self {
        let mut differences = vec![0.0; field.nodes().len()];
        let (mut largest, mut squares, mut at) = (0.0f64, 0.0, field.position(0, 0));
        let mut sizes = Vec::new();
        let (columns, _) = field.size();
        for (column, row, height) in field.surface_nodes() {
            let difference = height - nurbs.height(field.position(column, row));
            differences[row * columns + column] = difference;
            squares += difference * difference;
            sizes.push(difference.abs());
            if difference.abs() > largest {
                (largest, at) = (difference.abs(), field.position(column, row));
            }
        }
        let nodes = sizes.len();
        let rms = (squares / nodes.max(1) as f64).sqrt();
        let residual = Residual { max: largest, at, rms, p95: p95(sizes), nodes };
        Self { nurbs, field, residual, differences, doubts: Vec::new() }
    }

    /// The surface with a doubt for each node of its field, mm (see [`PartSamples::doubts`]); what does not fit the field is
    /// left away.
    ///
    /// [`PartSamples::doubts`]: crate::geometry::height_field::PartSamples::doubts
    pub fn doubted(self, doubts: Vec<f64>) -> Self {
        let doubts = if doubts.len() == self.field.nodes().len() { doubts } else { Vec::new() };
        Self { doubts, ..self }
    }

    /// The doubt of each node, mm; empty where there is none.
    pub fn doubts(&self) -> &[f64] {
        &self.doubts
    }

    /// How far the part may be from its sampled height, mm: the largest doubt of the nodes round the point; 0 off the surface.
    pub fn doubt(&self, at: ViewPoint) -> f64 {
        if self.doubts.is_empty() {
            return 0.0;
        }
        let Some((column, row, _)) = self.field.cell(at) else { return 0.0 };
        self.field.cell_nodes(column, row).map(|index| self.doubts[index]).into_iter().fold(0.0, f64::max)
    }

    /// Height of the sampled part less height of the fit at each node of the field, mm; 0 where there is no surface.
    pub fn differences(&self) -> &[f64] {
        &self.differences
    }

    /// Height, slope and curvature of the fit.
    pub fn jet(&self, at: ViewPoint) -> SurfaceJet {
        self.nurbs.jet(at)
    }

    /// Height of the sampled part, mm: the fit plus what it leaves at the nodes, interpolated linearly between them;
    /// `None` where there is no smooth surface.
    pub fn sampled_height(&self, at: ViewPoint) -> Option<f64> {
        if !self.field.is_surface(at) {
            return None;
        }
        Some(self.nurbs.height(at) + self.difference(at))
    }

    /// The surface with its smooth continuation beside the part held between the lowest and the highest node: control
    /// points that no node on the surface depends on may otherwise stand far off. Where the part was seen nothing changes.
    pub fn calmed(&self) -> NurbsSurface {
        let (knots_x, knots_y) = self.nurbs.knots();
        let columns = knots_x.control_points();
        let mut needed = vec![false; self.nurbs.heights().len()];
        let (mut lowest, mut highest) = (f64::INFINITY, f64::NEG_INFINITY);
        for (column, row, height) in self.field.surface_nodes() {
            let at = self.field.position(column, row);
            let (first_column, first_row) = (knots_x.span(at.x), knots_y.span(at.y));
            for row in first_row..=first_row + DEGREE {
                needed[row * columns + first_column..=row * columns + first_column + DEGREE].fill(true);
            }
            (lowest, highest) = (lowest.min(height), highest.max(height));
        }
        let heights = self.nurbs.heights().iter().zip(needed);
        let calm =
            heights.map(|(height, needed)| if needed { *height } else { height.max(lowest).min(highest) });
        NurbsSurface::new(knots_x, knots_y, calm.collect()).unwrap_or_else(|| self.nurbs.clone())
    }

    /// Height of the sampled part less height of the fit, mm; 0 off the surface.
    pub fn difference(&self, at: ViewPoint) -> f64 {
        let Some((column, row, place)) = self.field.cell(at) else { return 0.0 };
        let [a, b, c, d] = self.field.cell_nodes(column, row).map(|index| self.differences[index]);
        let (left, right) = (Vector2::new(1.0 - place.x, place.x), Vector2::new(1.0 - place.y, place.y));
        right.x * (left.x * a + left.y * b) + right.y * (left.x * c + left.y * d)
    }
}

impl<'a> Data<'a> {
    /// All nodes but those within `reach` steps of the `broken` ones, where no smooth surface runs through.
    fn beside(field: &'a HeightField, broken: &[bool], reach: usize) -> Result<Self, FitError> {
        let near = grown(broken, field.size().0, reach);
        let data = Self::new(field, |node| !near[node])?;
        if data.counts.iter().filter(|counts| **counts).count() < LEAST_NODES {
            // A part of nothing but edges is fitted as it is; the residual tells.
            return Self::new(field, |_| true);
        }
        Ok(data)
    }

    fn new(field: &'a HeightField, counts: impl Fn(usize) -> bool) -> Result<Self, FitError> {
        let is_surface = |node: &Node| matches!(node, Node::Surface(_));
        let nodes = field.nodes().iter().filter(|node| is_surface(node)).count();
        if nodes < LEAST_NODES {
            return Err(FitError::NoSurface { nodes, all: field.nodes().len(), limit: STEEPEST_SURFACE });
        }
        let counted = field.nodes().iter().enumerate().map(|(index, node)| is_surface(node) && counts(index));
        Ok(Self { field, counts: counted.collect() })
    }

    /// The nodes that count: place and height, mm.
    fn known(&self) -> impl Iterator<Item = (ViewPoint, f64)> {
        let columns = self.field.size().0;
        let counted = move |(column, row, _): &(usize, usize, f64)| self.counts[row * columns + column];
        let nodes = self.field.surface_nodes().filter(counted);
        nodes.map(|(column, row, height)| (self.field.position(column, row), height))
    }

    /// The distance that 95 % of the nodes that count stay below, mm.
    fn p95(&self, nurbs: &NurbsSurface) -> f64 {
        p95(self.known().map(|(at, height)| (height - nurbs.height(at)).abs()).collect())
    }

    /// The least-squares surface, one span for every two nodes.
    fn fit(&self) -> Result<NurbsSurface, FitError> {
        let (columns, rows) = self.field.size();
        let along = |start: f64, nodes: usize| {
            let span = self.field.step() * NODES_PER_SPAN as f64;
            UniformKnots::new(start, span, (nodes - 1).div_ceil(NODES_PER_SPAN))
        };
        let origin = self.field.origin();
        let (knots_x, knots_y) = (along(origin.x, columns), along(origin.y, rows));
        // Heights are fitted from their mean, so that a part far from the origin loses no digits.
        let heights = || self.field.surface_nodes().map(|(_, _, height)| height);
        let mean = heights().sum::<f64>() / heights().count().max(1) as f64;
        let count = knots_x.control_points() * knots_y.control_points();
        let level = NurbsSurface::new(knots_x, knots_y, vec![mean; count])
            .ok_or(SolveError::NotPositiveDefinite { unknowns: count })?;
        self.move_towards(level, |_| true)
    }

    /// The surface corrected where it misses nodes that count by more than a quarter of `tolerance`, mm, and left alone
    /// elsewhere.
    fn correct(&self, nurbs: NurbsSurface, tolerance: f64) -> Result<NurbsSurface, FitError> {
        let (knots_x, knots_y) = nurbs.knots();
        let (columns, rows) = (knots_x.control_points(), knots_y.control_points());
        let mut wanted = vec![false; columns * rows];
        for (at, height) in self.known() {
            if (height - nurbs.height(at)).abs() > tolerance / 4.0 {
                // The 4 × 4 control points that shape the cell, and one more round it.
                let (first_x, first_y) = (knots_x.span(at.x), knots_y.span(at.y));
                for row in first_y.saturating_sub(1)..(first_y + 5).min(rows) {
                    wanted[row * columns + first_x.saturating_sub(1)
                        ..row * columns + (first_x + 5).min(columns)]
                        .fill(true);
                }
            }
        }
        self.move_towards(nurbs, |point| wanted[point])
    }

    /// The surface with the `wanted` control points moved by least squares.
    fn move_towards(
        &self,
        nurbs: NurbsSurface,
        wanted: impl Fn(usize) -> bool,
    ) -> Result<NurbsSurface, FitError> {
        let field = self.field;
        let (knots_x, knots_y) = nurbs.knots();
        let (columns, rows) = field.size();
        let width = knots_x.control_points();
        let basis_x: Vec<_> = (0..columns).map(|column| knots_x.basis(field.position(column, 0).x)).collect();
        let basis_y: Vec<_> = (0..rows).map(|row| knots_y.basis(field.position(0, row).y)).collect();
        let is_wanted = |column: usize, row: usize| {
            (0..16).any(|local| wanted((row + local / 4) * width + column + local % 4))
        };
        let mut equations = NormalEquations::<1>::new(width, knots_y.control_points());
        for (in_rows, row_span) in spans_of(&basis_y) {
            for (in_columns, column_span) in spans_of(&basis_x) {
                if !is_wanted(column_span, row_span) {
                    continue;
                }
                let mut sum = CellSum::default();
                for row in in_rows.clone() {
                    for column in in_columns.clone() {
                        let node = row * columns + column;
                        if let Node::Surface(height) = field.nodes()[node]
                            && self.counts[node]
                        {
                            let (x, y) = (&basis_x[column].value, &basis_y[row].value);
                            let shares: CellRow<1> =
                                std::array::from_fn(|local| [x[local % 4] * y[local / 4]]);
                            sum.add(&shares, height - nurbs.height(field.position(column, row)), 1.0);
                        }
                    }
                }
                equations.add_cell(column_span, row_span, &sum);
            }
        }
        equations.add_third_difference_penalty(SMOOTHNESS);
        let solver = GridSolver::for_some(width, knots_y.control_points(), wanted)?;
        let steps = equations.solve(&solver)?;
        Ok(nurbs.moved(steps.into_iter().map(|[step]| step)))
    }
}

/// The marked nodes and those within `reach` nodes of them, on rows of `columns` nodes.
fn grown(marked: &[bool], columns: usize, reach: usize) -> Vec<bool> {
    let mut marked = marked.to_vec();
    for _ in 0..reach {
        let seeds: Vec<usize> = (0..marked.len()).filter(|&node| marked[node]).collect();
        for node in seeds {
            let (column, row) = (node % columns, node / columns);
            for row in row.saturating_sub(1)..(row + 2).min(marked.len() / columns) {
                marked[row * columns + column.saturating_sub(1)..row * columns + (column + 2).min(columns)]
                    .fill(true);
            }
        }
    }
    marked
}

/// The size that 95 % stay below.
fn p95(mut sizes: Vec<f64>) -> f64 {
    let nodes = sizes.len();
    if nodes == 0 { 0.0 } else { *sizes.select_nth_unstable_by(nodes * 95 / 100, f64::total_cmp).1 }
}

/// Runs of nodes that lie in the same span, with the span's first control point.
fn spans_of(basis: &[super::knots::Basis]) -> Vec<(std::ops::Range<usize>, usize)> {
    let mut runs: Vec<(std::ops::Range<usize>, usize)> = Vec::new();
    for (node, at_node) in basis.iter().enumerate() {
        match runs.last_mut() {
            Some((range, first)) if *first == at_node.first => range.end = node + 1,
            _ => runs.push((node..node + 1, at_node.first)),
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::shapes;
    use crate::geometry::space::View;

    fn worst(fitted: &FittedSurface, height: impl Fn(f64, f64) -> f64, radius: f64) -> f64 {
        let mut worst = 0.0f64;
        for step in 0..4000 {
            let (angle, r) = (f64::from(step) * 2.399_963, radius * (f64::from(step) / 4000.0).sqrt());
            let (x, y) = (r * angle.cos(), r * angle.sin());
            worst = worst.max((fitted.nurbs.height(ViewPoint::new(x, y)) - height(x, y)).abs());
        }
        worst
    }

    #[test]
    fn a_sphere_is_fitted_closely_up_to_its_steep_rim() {
        let mesh = shapes::graph(28.5, 0.75, shapes::sphere);
        let fitted =
            FittedSurface::of_part(&FacingPart::new(&mesh, &View::top()), &FitOptions::default()).unwrap();
        // 0.75 mm chords on R = 30 mm have a sagitta of 0.0023 mm; the curved triangles leave a tenth of it.
        let inner = worst(&fitted, shapes::sphere, 24.0);
        assert!(inner < 2.3e-4, "{inner} mm");
    }

    #[test]
    fn beyond_the_rim_the_surface_goes_on_smoothly() {
        let mesh = shapes::graph(10.0, 0.5, |x, y| 0.02 * x * x - 0.01 * y * y + 0.1 * x);
        let fitted =
            FittedSurface::of_part(&FacingPart::new(&mesh, &View::top()), &FitOptions::default()).unwrap();
        for at in [(7.8, 7.8), (-7.8, 7.8), (7.8, -7.8)] {
            let expected = 0.02 * at.0 * at.0 - 0.01 * at.1 * at.1 + 0.1 * at.0;
            let height = fitted.nurbs.height(ViewPoint::new(at.0, at.1));
            assert!((height - expected).abs() < 0.1, "{at:?}: {height} for {expected}");
        }
    }

    #[test]
    fn a_calmed_surface_differs_only_beside_the_part() {
        // A cap whose steep rim runs on downwards beside it.
        let mesh = shapes::graph(28.5, 0.75, shapes::sphere);
        let fitted =
            FittedSurface::of_part(&FacingPart::new(&mesh, &View::top()), &FitOptions::default()).unwrap();
        let calm = fitted.calmed();
        for (column, row, _) in fitted.field.surface_nodes() {
            let at = fitted.field.position(column, row);
            assert_eq!(calm.height(at), fitted.nurbs.height(at));
        }
        let lowest = |surface: &NurbsSurface| surface.heights().iter().copied().fold(f64::INFINITY, f64::min);
        assert!(lowest(&fitted.nurbs) < lowest(&calm), "there is something to calm");
        let corner = calm.height(ViewPoint::new(-28.4, -28.4));
        assert!((0.0..30.0).contains(&corner), "{corner} mm");
    }

    #[test]
    fn a_crease_shows_in_the_residual_instead_of_being_hidden() {
        let mesh = shapes::graph(10.0, 0.5, |x, _| if x > 0.0 { -x } else { 0.0 });
        let fitted =
            FittedSurface::of_part(&FacingPart::new(&mesh, &View::top()), &FitOptions::default()).unwrap();
        assert!(fitted.residual.max > 0.003 && fitted.residual.at.x.abs() < 0.5, "{:?}", fitted.residual);
        let near = ViewPoint::new(0.03, 1.0);
        assert!((fitted.sampled_height(near).unwrap() + 0.03).abs() < 0.01);
    }
}
