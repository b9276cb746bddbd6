//! The fit of a NURBS surface to a height field, refined until it meets the requested tolerance.

mod on_regions;
mod windows;

pub use on_regions::Beyond;

use std::ops::Range;

use nalgebra::{Vector2, Vector3};

use super::knots::{DEGREE, UniformKnots};
use super::nurbs::{NurbsSurface, SurfaceJet};
use super::summed_area::SummedArea;
use crate::geometry::facing_part::{FacingPart, PartSamples, Skins, Slope, Uncertainty};
use crate::geometry::fork::{Fork, InTurn, found, join, start};
use crate::geometry::height_field::{Grid, HeightField, Node, STEEPEST_SURFACE, grown};
use crate::geometry::normal_equations::{
    CellRow, CellSum, EquationRows, GridSolver, NormalEquations, SolveError,
};
use crate::geometry::solid::round::RoundForm;
use crate::geometry::space::ViewPoint;

/// Nodes of the height field along one span of the surface: twice as many as unknowns along each direction, so that the
/// residual is visible.
const NODES_PER_SPAN: usize = 2;

/// Weight of the smoothness penalty relative to one node's weight of 1: so small that it matters only where there are
/// no nodes.
const SMOOTHNESS: f64 = 1e-6;

/// Nodes within this many steps of those at an edge of the part are excluded from the fit: the spline needs
/// one span to bend there.
const EDGE_REACH: usize = 1;

/// The same number of steps at the cliffs of measured height fields, where nodes next to a cliff mix heights
/// from both sides.
const CLIFF_REACH: usize = 2;

/// The spline may swing within this many steps of a wall, although nodes at edges are excluded.
const SWING_REACH: usize = 8;

/// Finer detail than the samples show is possible where the vertices are at most this many steps of the samples apart.
const RESOLVED: f64 = 1.0;

/// The spline may swing within this many steps of an edge between two faces.
const FACE_REACH: usize = 4;

/// Two skins on at least this share of the part are refused, because nothing shows which one is meant. On a
/// smaller share they are labels, inlays or overlapping facets.
const SKINS: f64 = 0.5;

/// On a level side, the slope between samples is known if it differs from that of the part by less than this,
/// rad. On steep sides, the heights bend more from sample to sample.
const NEGLIGIBLE_SLOPE: f64 = 1.5e-4;

/// The difference beside a node is at most this many times that at the node, because the jump may be anywhere
/// between two nodes.
const BETWEEN_NODES: f64 = 1.5;

/// This many nodes on either side of a node are compared with it. At a lone jump, the slope differs at fewer
/// than half of them. On detail that the samples do not show, it differs at most of them.
const ROUND: usize = 8;

/// A thin part has at least this many spans across it: fewer show little of its curvature.
const LEAST_ACROSS: f64 = 12.0;

/// A thin part has at most this many times as many spans along it as others have; this limits time and
/// memory.
const MOST_TIMES_ALONG: f64 = 64.0;

/// Minimum number of nodes.
const MIN_NODES: usize = 64;

/// How the surface is fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct FitOptions {
    /// The residual that 95 % of the nodes should stay below, mm. If it is exceeded, the number of spans is doubled,
    /// but only the control points near a larger residual are moved, which takes two to three times as long.
    pub tolerance: f64,
    /// Spans along the longer side at the start. A thin part, such as a rod, gets more, so that there are enough across it.
    pub first_spans: usize,
    /// Spans along the longer side from which on they are not doubled again; it limits time and memory. A thin part gets more along
    /// and fewer across.
    pub most_spans: usize,
}

impl FitOptions {
    /// All options: tolerance, first spans, most spans. A new option changes this type, so that whoever keeps fits by
    /// their options must decide about it.
    #[must_use]
    pub fn values(&self) -> (f64, usize, usize) {
        let Self { tolerance, first_spans, most_spans } = *self;
        (tolerance, first_spans, most_spans)
    }
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
    /// The residual of the fit, with that of its windows where they are.
    pub residual: Residual,
    /// Height of the sampled part minus height of the fit at each node, mm; 0 where there is no surface.
    differences: Vec<f64>,
    doubts: Vec<f64>,
    uncertainties: Vec<Uncertainty>,
    /// The nodes beside walls at which the surface has another slope than the heights on their side of the wall, in ascending order:
    /// it swings where it passes from one height to another.
    swings: Vec<(usize, Uncertainty)>,
    /// What is not known of the part at nodes near edges, in ascending order, if the surface is without what is beyond the edge.
    alone: Vec<(usize, Uncertainty)>,
    /// The cylinders and cones, in the frame of the view, that are faces of the part according to its file,
    /// or that the points of a scan are on.
    known: Vec<RoundForm>,
    /// Whether the part is known from points that scatter: then no form is known exactly.
    is_measured: bool,
    windows: Vec<Window>,
    /// For each node, whether the part was sampled there; empty if it was at all. Others are between samples of larger spans.
    sampled: Vec<bool>,
}

/// A rectangle of a part with smaller spans.
#[derive(Debug, Clone, PartialEq)]
pub struct Window {
    /// How often the spans of the whole part are halved, at least once.
    pub level: usize,
    /// The span of this level, counted from the lower left of the whole part, with which its knots begin.
    pub first: [usize; 2],
    /// The spans of this level in which the window applies.
    pub core: [Range<usize>; 2],
    /// The surface there, with its samples.
    pub surface: FittedSurface,
}

/// The distance between fit and sampled part along the laser's axis, over the smooth surface.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Residual {
    /// Largest distance, mm.
    pub max: f64,
    /// Position of the largest distance.
    pub at: ViewPoint,
    /// Root mean square, mm.
    pub rms: f64,
    /// Distance that 95 % of the nodes stay below, mm.
    pub p95: f64,
    /// Number of nodes compared.
    pub nodes: usize,
}

impl Residual {
    /// Of the heights of a field above a surface, mm, at its nodes.
    fn of(field: &HeightField, differences: &[f64]) -> Self {
        let columns = field.size().0;
        let (mut largest, mut squares, mut at) = (0.0f64, 0.0, field.position(0, 0));
        let mut sizes = Vec::with_capacity(differences.len());
        for (column, row, _) in field.surface_nodes() {
            let difference = differences[row * columns + column];
            squares += difference * difference;
            sizes.push(difference.abs());
            if difference.abs() > largest {
                (largest, at) = (difference.abs(), field.position(column, row));
            }
        }
        let nodes = sizes.len();
        let rms = (squares / nodes.max(1) as f64).sqrt();
        Self { max: largest, at, rms, p95: p95(sizes), nodes }
    }
}

/// Why no surface could be fitted.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    /// Too little of the part faces the laser.
    #[error("only {nodes} of {all} sampled points of the part are tilted less than {} degrees to the laser",
        limit.to_degrees())]
    NoSurface {
        /// Nodes on the smooth surface.
        nodes: usize,
        /// Nodes of the grid.
        all: usize,
        /// The largest tilt of a surface, rad.
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
    /// The part has two skins, one closely behind the other and both facing the laser.
    #[error("two surfaces {} mm apart face the laser at ({}, {})", .0.gap, .0.at.x, .0.at.y)]
    TwoSkins(Skins),
    /// The equations could not be solved.
    #[error(transparent)]
    Solve(#[from] SolveError),
}

/// By how much the slope of samples differs from that of the part at a node.
struct Turn {
    node: usize,
    /// rad.
    off: f64,
    /// The squared slope of the part.
    steep: f64,
}

/// The nodes that a surface is fitted to.
struct Data<'a> {
    field: &'a HeightField,
    /// For each node, whether it is used.
    used: Vec<bool>,
    fork: &'a dyn Fork,
}

impl FittedSurface {
    /// Samples and fits a part. The spacing is halved and the surface is refined where needed, until 95 % of
    /// the residuals are within the tolerance. It also ends when the maximum number of spans is reached, or
    /// when halving no longer helps (facets do not become smoother).
    ///
    /// Nodes at an edge of the part are excluded, because no smooth surface passes through them; the residual
    /// includes them. A part that is exactly its flat facets is fitted with all nodes.
    ///
    /// # Errors
    /// When too little of the part faces the laser, when its width is less than 1/1000 of its length as the
    /// laser sees it, or when the equations cannot be solved; see [`FitError`].
    pub fn of_part(part: &FacingPart, options: &FitOptions) -> Result<Self, FitError> {
        start(part.fork(), || Self::fitted(part, options))
    }

    fn fitted(part: &FacingPart, options: &FitOptions) -> Result<Self, FitError> {
        let size = part.extents().size();
        let (longer, shorter) = (size.x.max(size.y), size.x.min(size.y));
        if !(shorter > longer * 1e-3 && longer > 1e-2) {
            return Err(FitError::TooSmall { width: size.x, height: size.y });
        }
        let across = shorter / longer * options.first_spans as f64;
        let times = (LEAST_ACROSS / across).ceil().clamp(1.0, MOST_TIMES_ALONG) as usize;
        let most_times = (longer / shorter).sqrt().min(times as f64);
        let (mut spans, most_spans) =
            (options.first_spans * times, (options.most_spans as f64 * most_times) as usize);
        let mut samples = part.sample(&Grid::over(&part.extents(), longer / (spans * NODES_PER_SPAN) as f64));
        if let Some(skins) = samples.skins.filter(|skins| skins.share >= SKINS) {
            return Err(FitError::TwoSkins(skins));
        }
        let (mut nurbs, mut residual) = Data::solved(part, &samples, EDGE_REACH, |data| data.fit())?;
        let is_fine = |step: f64| part.spacing() <= RESOLVED * step;
        while (residual > options.tolerance || samples.bends_between(part.fork()) > options.tolerance)
            && spans < most_spans
        {
            // The last doubling takes as long as all before it, and helps only parts with finer detail.
            if spans * 2 > most_spans && !is_fine(samples.field.step()) {
                break;
            }
            spans *= 2;
            samples = part.sample(&samples.field.grid().halved());
            let halved = nurbs.halved();
            let (finer, left) = Data::solved(part, &samples, EDGE_REACH, |data| {
                data.correct(halved.clone(), options.tolerance)
            })?;
            nurbs = finer;
            let before = std::mem::replace(&mut residual, left);
            // Facets do not get smoother. Detail that is finer than the samples shows only after they resolve it.
            if before < 2.0 * residual && !is_fine(samples.field.step()) {
                break;
            }
        }
        let whole = Self::sampled(part, nurbs, &samples);
        let missed = match part.is_facetted() {
            true => Vec::new(),
            false => whole.missed(&samples, part.fork(), options.tolerance),
        };
        let continuing = std::mem::take(&mut samples.continuing);
        Ok(whole.doubted_by(samples, part.fork()).in_windows(part, &missed, options.tolerance, continuing))
    }

    /// A surface with samples of a part.
    fn sampled(part: &FacingPart, nurbs: NurbsSurface, samples: &PartSamples) -> Self {
        let faces = if part.is_facetted() { Vec::new() } else { samples.faces() };
        Self::compare(nurbs, samples.field.clone().with_faces(faces))
    }

    /// The surface with the doubts about its samples.
    fn doubted_by(self, samples: PartSamples, fork: &dyn Fork) -> Self {
        let PartSamples { doubts, uncertainties, slopes, is_at_edge, .. } = samples;
        // Beside a wall the surface of one side alone is used where it matters, and has the slope of the heights there.
        let near_walls = self.field.near_walls(SWING_REACH);
        let near_faces = self.field.near_other_faces(FACE_REACH);
        let turns = self.turns_between_samples(&slopes, &near_walls, fork);
        let doubted = self.doubted(doubts, uncertainties);
        let uncertainties = doubted.doubts_between_samples(turns, &is_at_edge);
        if !near_faces.contains(&true) {
            return Self { uncertainties, ..doubted };
        }
        let is_one_sided: Vec<bool> =
            near_walls.iter().zip(&near_faces).map(|(wall, face)| *wall || *face).collect();
        let turns = doubted.turns_between_samples(&slopes, &is_one_sided, fork);
        let alone = doubted.doubts_between_samples(turns, &is_at_edge);
        let of =
            |uncertainties: &[Uncertainty], node: usize| uncertainties.get(node).copied().unwrap_or_default();
        let alone =
            (0..near_faces.len()).filter(|node| near_faces[*node]).map(|node| (node, of(&alone, node)));
        let alone = alone.filter(|(node, uncertainty)| *uncertainty != of(&uncertainties, *node)).collect();
        Self { alone, uncertainties, ..doubted }
    }

    /// By how much the slope of the samples differs from that of the part, at the nodes where both are known.
    /// At some of them, only the heights on one side are known.
    fn turns_between_samples(&self, slopes: &[Slope], is_one_sided: &[bool], fork: &dyn Fork) -> Vec<Turn> {
        let turn = |node: usize| {
            let known = slopes.get(node)?;
            let sampled = match is_one_sided[node] {
                true => self.field.gradient_beside(node, known.gradient)?,
                false => self.sampled_gradient(node)?,
            };
            let off = (tangent(sampled, known.gradient) - known.off).max(0.0);
            Some(Turn { node, off, steep: known.gradient.norm_squared() })
        };
        found(fork, slopes.len(), turn)
    }

    /// What is not known of the part at each node, with a doubt about the slope of the surface where the samples round a jump of
    /// the slope or of the curvature, as beside a fillet: there the slope between them differs from that of the part at the nodes.
    fn doubts_between_samples(&self, turns: Vec<Turn>, is_at_edge: &[bool]) -> Vec<Uncertainty> {
        let (columns, rows) = self.field.size();
        let step = self.field.step();
        let is_notable = |turn: &Turn| is_notable(turn.off, turn.steep);
        if !turns.iter().any(is_notable) {
            return self.uncertainties.clone();
        }
        let values = turns
            .iter()
            .map(|turn| (turn.node, Vector3::new(turn.off * turn.off, f64::from(is_notable(turn)), 1.0)));
        let sums = SummedArea::of([columns, rows], values);
        let mut uncertainties = self.uncertainties.clone();
        uncertainties.resize(columns * rows, Uncertainty::NONE);
        for Turn { node, off, .. } in turns.into_iter().filter(is_notable) {
            // It is a largest value. At an edge of the part the slope jumps itself, so that no larger one is between the nodes.
            let times = if is_at_edge.get(node) == Some(&true) { 1.0 } else { BETWEEN_NODES };
            let of_jump = times * off / Uncertainty::PEAK;
            // Where it differs all round, as on ribs that the samples do not show, it is a mean.
            let [[squares, notable, all]] = sums.round(node, ROUND).data.0;
            let of_ribs = if 2.0 * notable > all { off.min((squares / all).max(0.0).sqrt()) } else { 0.0 };
            let slope = of_jump.max(of_ribs) as f32;
            let known = &mut uncertainties[node];
            *known = known.largest(Uncertainty { slope, height: (off * step / 4.0) as f32 });
        }
        uncertainties
    }

    /// Fits a height field by least squares, one span for every two nodes. Nodes at a cliff are excluded, because a
    /// spline that follows them oscillates over centimetres. Where there is no surface, the spline is continued
    /// smoothly; zeros there would make it oscillate at the rim.
    ///
    /// # Errors
    /// When the field has fewer than 64 nodes on the surface, or when the equations cannot be solved.
    pub fn of_field(field: HeightField) -> Result<Self, FitError> {
        let is_wall: Vec<bool> = field.nodes().iter().map(|node| matches!(node, Node::Wall(_))).collect();
        let nurbs = Data::beside(&field, &is_wall, CLIFF_REACH, &InTurn)?.fit()?;
        Ok(Self::compare(nurbs, field))
    }

    /// A surface with samples of the part; measures the residual between them.
    pub fn compare(nurbs: NurbsSurface, field: HeightField) -> Self {
        let mut differences = vec![0.0; field.nodes().len()];
        let (columns, _) = field.size();
        let (xs, ys) = field.grid().coordinates();
        nurbs.for_each_row(&xs, &ys, |row, fitted| {
            let nodes = row * columns..(row + 1) * columns;
            let rows = field.nodes()[nodes.clone()].iter().zip(&mut differences[nodes]).zip(fitted);
            for ((node, kept), fitted) in rows {
                if let Node::Surface(height) = node {
                    *kept = height - fitted;
                }
            }
        });
        let residual = Residual::of(&field, &differences);
        let (doubts, uncertainties, known) = (Vec::new(), Vec::new(), Vec::new());
        let (windows, sampled, swings, alone) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let surface = Self {
            nurbs,
            field,
            residual,
            differences,
            doubts,
            uncertainties,
            swings,
            alone,
            known,
            is_measured: false,
            windows,
            sampled,
        };
        Self { swings: surface.swings_beside_walls(), ..surface }
    }

    /// The nodes near walls at which the slope of the surface notably differs from that of the heights on their side of the wall.
    fn swings_beside_walls(&self) -> Vec<(usize, Uncertainty)> {
        let near = self.field.near_walls(SWING_REACH);
        let step = self.field.step();
        let swing = |node: usize| {
            let (column, row) = (node % self.field.size().0, node / self.field.size().0);
            let sampled = self.sampled_gradient(node)?;
            let off = tangent(sampled, self.field.gradient_beside(node, sampled)?);
            let steep = self.nurbs.gradient(self.field.position(column, row)).norm_squared();
            let slope = (BETWEEN_NODES * off / Uncertainty::PEAK) as f32;
            is_notable(off, steep).then(|| (node, Uncertainty { slope, height: (off * step / 4.0) as f32 }))
        };
        (0..near.len()).filter(|node| near[*node]).filter_map(swing).collect()
    }

    /// The slope between the nodes round one, as it follows from the surface and the heights that it misses; `None` at the border of the
    /// field and where there is no surface.
    fn sampled_gradient(&self, node: usize) -> Option<Vector2<f64>> {
        let (columns, rows) = self.field.size();
        let (column, row) = (node % columns, node / columns);
        let is_surface = |node: usize| matches!(self.field.nodes()[node], Node::Surface(_));
        if !is_surface(node) || column == 0 || row == 0 || column + 1 == columns || row + 1 == rows {
            return None;
        }
        // At the end of the surface, what is between the nodes on one side of it.
        let rise = |low: usize, high: usize| {
            let ends = [low, high].map(|beside| if is_surface(beside) { beside } else { node });
            let steps = ends.iter().filter(|end| **end != node).count();
            let [low, high] = ends.map(|end| self.differences[end]);
            (steps > 0).then(|| (high - low) / (steps as f64 * self.field.step()))
        };
        let between = Vector2::new(rise(node - 1, node + 1)?, rise(node - columns, node + columns)?);
        Some(self.nurbs.gradient(self.field.position(column, row)) + between)
    }

    /// The surface with the doubts about each node of its field (see [`PartSamples::doubts`] and
    /// [`PartSamples::uncertainties`]). Lists whose length does not match the field are ignored.
    ///
    /// [`PartSamples::doubts`]: crate::geometry::facing_part::PartSamples::doubts
    /// [`PartSamples::uncertainties`]: crate::geometry::facing_part::PartSamples::uncertainties
    pub fn doubted(self, doubts: Vec<f64>, uncertainties: Vec<Uncertainty>) -> Self {
        let nodes = self.field.nodes().len();
        let doubts = if doubts.len() == nodes { doubts } else { Vec::new() };
        let uncertainties = if uncertainties.len() == nodes { uncertainties } else { Vec::new() };
        Self { doubts, uncertainties, ..self }
    }

    /// What is not known of the part at nodes near edges, in ascending order, if the surface is without what is beyond the edge.
    pub fn alone(&self) -> &[(usize, Uncertainty)] {
        &self.alone
    }

    /// The surface with [`Self::alone`]; nodes that it does not have are ignored.
    pub fn with_alone(self, mut alone: Vec<(usize, Uncertainty)>) -> Self {
        alone.retain(|(node, _)| *node < self.field.nodes().len());
        Self { alone, ..self }
    }

    /// The surface of a part that is known from points that scatter, if it `is_measured`: what is unknown of it stays unknown on a cylinder
    /// or cone, too.
    pub fn measured(self, is_measured: bool) -> Self {
        Self { is_measured, ..self }
    }

    /// Whether the part is known from points that scatter.
    pub fn is_measured(&self) -> bool {
        self.is_measured
    }

    /// The surface of a part whose file states that it has faces on these cylinders and cones, or whose points are on them, in the frame of
    /// the view.
    pub fn with_known(self, known: Vec<RoundForm>) -> Self {
        Self { known, ..self }
    }

    /// The cylinders and cones, in the frame of the view, that are faces of the part according to its file,
    /// or that its points are on.
    pub fn known(&self) -> &[RoundForm] {
        &self.known
    }

    /// Whether the part was sampled at a node; otherwise its height is between samples of larger spans.
    pub(crate) fn is_sampled(&self, node: usize) -> bool {
        self.sampled.get(node).copied().unwrap_or(true)
    }

    /// The doubt of each node, mm; empty where there is none.
    pub fn doubts(&self) -> &[f64] {
        &self.doubts
    }

    /// What is not known of the part, for each node; empty if it is known. The surface may swing beside walls, too
    /// ([`uncertainty_of`](Self::uncertainty_of)).
    pub fn uncertainties(&self) -> &[Uncertainty] {
        &self.uncertainties
    }

    /// The uncertainty of the part at a node, with that of its surface beside walls.
    pub fn uncertainty_of(&self, node: usize) -> Uncertainty {
        let known = self.uncertainties.get(node).copied().unwrap_or(Uncertainty::NONE);
        match self.swings.binary_search_by_key(&node, |swing| swing.0) {
            Ok(index) => known.largest(self.swings[index].1),
            Err(_) => known,
        }
    }

    /// The uncertainty of the part: the largest values of the nodes round the point; none outside the field.
    pub fn uncertainty(&self, at: ViewPoint) -> Uncertainty {
        if self.uncertainties.is_empty() && self.swings.is_empty() {
            return Uncertainty::NONE;
        }
        let Some((column, row, _)) = self.field.cell(at) else { return Uncertainty::NONE };
        let nodes = self.field.cell_nodes(column, row);
        nodes
            .into_iter()
            .map(|index| self.uncertainty_of(index))
            .fold(Uncertainty::NONE, Uncertainty::largest)
    }

    /// How far the part may be from its sampled height, mm: the largest doubt of the nodes round the point; 0 outside
    /// the field.
    pub fn doubt(&self, at: ViewPoint) -> f64 {
        if self.doubts.is_empty() {
            return 0.0;
        }
        let Some((column, row, _)) = self.field.cell(at) else { return 0.0 };
        self.field.cell_nodes(column, row).map(|index| self.doubts[index]).into_iter().fold(0.0, f64::max)
    }

    /// Height of the sampled part minus height of the fit at each node of the field, mm; 0 where there is no surface.
    pub fn differences(&self) -> &[f64] {
        &self.differences
    }

    /// Height, slope and curvature of the fit.
    pub fn jet(&self, at: ViewPoint) -> SurfaceJet {
        self.nurbs.jet(at)
    }

    /// Height of the sampled part, mm: the fit plus its residual at the nodes, interpolated bilinearly; `None` where
    /// there is no smooth surface.
    pub fn sampled_height(&self, at: ViewPoint) -> Option<f64> {
        let (column, row, place) = self.field.cell(at)?;
        let nodes = self.field.cell_nodes(column, row);
        let is_surface = |&node: &usize| matches!(self.field.nodes()[node], Node::Surface(_));
        nodes.iter().all(is_surface).then(|| self.nurbs.height(at) + self.between(nodes, place))
    }

    /// The surface with its smooth continuation outside the part limited to the heights between the lowest and the
    /// highest node. Control points that no node on the surface depends on may otherwise be far away. The surface at
    /// the nodes does not change.
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

    /// Height of the sampled part minus height of the fit, mm; 0 outside the field.
    pub fn difference(&self, at: ViewPoint) -> f64 {
        let cell = self.field.cell(at);
        cell.map_or(0.0, |(column, row, place)| self.between(self.field.cell_nodes(column, row), place))
    }

    /// The differences at the nodes of a cell, interpolated bilinearly at a place in it, mm.
    fn between(&self, nodes: [usize; 4], place: Vector2<f64>) -> f64 {
        let [a, b, c, d] = nodes.map(|index| self.differences[index]);
        let (left, right) = (Vector2::new(1.0 - place.x, place.x), Vector2::new(1.0 - place.y, place.y));
        right.x * (left.x * a + left.y * b) + right.y * (left.x * c + left.y * d)
    }
}

impl PartSamples {
    /// How far the part may be from its samples between them, mm. The value is the distance that 95 % of the
    /// nodes stay below at which the slope of the part differs from that of the heights round them. Only this
    /// shows detail that is as fine as the samples: heights that are taken once in each rib are even.
    fn bends_between(&self, fork: &dyn Fork) -> f64 {
        let (step, nodes) = (self.field.step(), self.field.nodes());
        p95(found(fork, nodes.len(), |node| Some(self.slope_off(node)? * step / 4.0)))
    }

    /// By how much the slope of the part at a node differs from that of the heights round it, rad; `None` at the end of the
    /// surface and at edges of the part.
    fn slope_off(&self, node: usize) -> Option<f64> {
        let (columns, rows) = self.field.size();
        let (column, row) = (node % columns, node / columns);
        let is_surface = matches!(self.field.nodes()[node], Node::Surface(_));
        if !is_surface
            || column == 0
            || row == 0
            || column + 1 == columns
            || row + 1 == rows
            || self.is_at_edge[node]
        {
            return None;
        }
        let height = |node: usize| match self.field.nodes()[node] {
            Node::Surface(height) => Some(height),
            Node::Empty | Node::Wall(_) => None,
        };
        let rise = |low: usize, high: usize| Some((height(high)? - height(low)?) / (2.0 * self.field.step()));
        let sampled = Vector2::new(rise(node - 1, node + 1)?, rise(node - columns, node + columns)?);
        Some(tangent(sampled, self.slopes[node].gradient))
    }
}

impl<'a> Data<'a> {
    /// The result of `solve` for the nodes farther than `reach` steps from the edges of the part, and its
    /// residual at them, mm. If these nodes do not determine a surface, the result for all nodes.
    fn solved(
        part: &'a FacingPart,
        samples: &'a PartSamples,
        reach: usize,
        solve: impl Fn(&Self) -> Result<NurbsSurface, FitError>,
    ) -> Result<(NurbsSurface, f64), FitError> {
        let fork = part.fork();
        // Where every side of a facet is an edge, few or no nodes are left round a corner, and the surface would have a pit there.
        let data = match part.is_facetted() {
            true => Self::new(&samples.field, |_| true, fork)?,
            false => Self::beside(&samples.field, &samples.is_at_edge, reach, fork)?,
        };
        let (data, nurbs) = match solve(&data) {
            Err(FitError::Solve(_)) if data.used.iter().any(|used| !used) => {
                let all = Self::new(&samples.field, |_| true, fork)?;
                let nurbs = solve(&all)?;
                (all, nurbs)
            }
            found => (data, found?),
        };
        let residual = data.p95(&nurbs);
        Ok((nurbs, residual))
    }

    /// All nodes except those within `reach` steps of the `broken` nodes, through which no smooth surface passes.
    fn beside(
        field: &'a HeightField,
        broken: &[bool],
        reach: usize,
        fork: &'a dyn Fork,
    ) -> Result<Self, FitError> {
        let near = grown(broken, field.size().0, reach);
        let data = Self::new(field, |node| !near[node], fork)?;
        if data.used.iter().filter(|used| **used).count() < MIN_NODES {
            // A part with edges everywhere is fitted with all its nodes; the residual shows the quality.
            return Self::new(field, |_| true, fork);
        }
        Ok(data)
    }

    fn new(
        field: &'a HeightField,
        is_used: impl Fn(usize) -> bool,
        fork: &'a dyn Fork,
    ) -> Result<Self, FitError> {
        let is_surface = |node: &Node| matches!(node, Node::Surface(_));
        let nodes = field.nodes().iter().filter(|node| is_surface(node)).count();
        if nodes < MIN_NODES {
            return Err(FitError::NoSurface { nodes, all: field.nodes().len(), limit: STEEPEST_SURFACE });
        }
        let used = field.nodes().iter().enumerate().map(|(index, node)| is_surface(node) && is_used(index));
        Ok(Self { field, used: used.collect(), fork })
    }

    /// The used nodes: column, row, and how far the part is above a surface there, mm.
    fn misses(&self, nurbs: &NurbsSurface) -> impl Iterator<Item = (usize, usize, f64)> {
        let fitted = heights_at_nodes(nurbs, self.field);
        let columns = self.field.size().0;
        self.field.surface_nodes().filter_map(move |(column, row, height)| {
            let node = row * columns + column;
            self.used[node].then(|| (column, row, height - fitted[node]))
        })
    }

    /// The distance that 95 % of the used nodes stay below, mm.
    fn p95(&self, nurbs: &NurbsSurface) -> f64 {
        p95(self.misses(nurbs).map(|(_, _, miss)| miss.abs()).collect())
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
        // Heights are fitted relative to their mean, so that a part far from the origin loses no precision.
        let heights = || self.field.surface_nodes().map(|(_, _, height)| height);
        let mean = heights().sum::<f64>() / heights().count().max(1) as f64;
        let count = knots_x.control_points() * knots_y.control_points();
        let plane = NurbsSurface::new(knots_x, knots_y, vec![mean; count])
            .ok_or(SolveError::NotPositiveDefinite { unknowns: count })?;
        self.move_towards(plane, |_| true, 1)
    }

    /// The surface corrected where its residual at used nodes is more than a quarter of `tolerance`, mm; unchanged
    /// elsewhere.
    fn correct(&self, nurbs: NurbsSurface, tolerance: f64) -> Result<NurbsSurface, FitError> {
        let (knots_x, knots_y) = nurbs.knots();
        let (columns, rows) = (knots_x.control_points(), knots_y.control_points());
        let mut is_free = vec![false; columns * rows];
        for (column, row, miss) in self.misses(&nurbs) {
            if miss.abs() > tolerance / 4.0 {
                let at = self.field.position(column, row);
                // The 4 × 4 control points that determine the cell, and one more on each side.
                let (first_x, first_y) = (knots_x.span(at.x), knots_y.span(at.y));
                for row in first_y.saturating_sub(1)..(first_y + 5).min(rows) {
                    is_free[row * columns + first_x.saturating_sub(1)
                        ..row * columns + (first_x + 5).min(columns)]
                        .fill(true);
                }
            }
        }
        self.move_towards(nurbs, |point| is_free[point], 1)
    }

    /// The surface with the free control points moved by least squares, in `passes` passes.
    fn move_towards(
        &self,
        nurbs: NurbsSurface,
        is_free: impl Fn(usize) -> bool + Sync,
        passes: usize,
    ) -> Result<NurbsSurface, FitError> {
        let field = self.field;
        let (knots_x, knots_y) = nurbs.knots();
        let (columns, rows) = field.size();
        let width = knots_x.control_points();
        let basis_x: Vec<_> = (0..columns).map(|column| knots_x.basis(field.position(column, 0).x)).collect();
        let basis_y: Vec<_> = (0..rows).map(|row| knots_y.basis(field.position(0, row).y)).collect();
        let has_free_points = |column: usize, row: usize| {
            (0..16).any(|local| is_free((row + local / 4) * width + column + local % 4))
        };
        let fitted = heights_at_nodes(&nurbs, field);
        let mut equations = NormalEquations::<1>::new(width, knots_y.control_points());
        let spans_x = spans_of(&basis_x);
        let fill = |equations: &mut EquationRows<1>| {
            for (in_rows, row_span) in spans_of(&basis_y) {
                if !equations.touch(row_span) {
                    continue;
                }
                for &(ref in_columns, column_span) in &spans_x {
                    if !has_free_points(column_span, row_span) {
                        continue;
                    }
                    let mut sum = CellSum::default();
                    for row in in_rows.clone() {
                        for column in in_columns.clone() {
                            let node = row * columns + column;
                            if let Node::Surface(height) = field.nodes()[node]
                                && self.used[node]
                            {
                                let (x, y) = (&basis_x[column].value, &basis_y[row].value);
                                let shares: CellRow<1> =
                                    std::array::from_fn(|local| [x[local % 4] * y[local / 4]]);
                                sum.add(&shares, height - fitted[node], 1.0);
                            }
                        }
                    }
                    equations.add_cell(column_span, row_span, &sum);
                }
            }
        };
        let (solver, ()) = join(
            self.fork,
            || GridSolver::for_some(width, knots_y.control_points(), &is_free),
            || equations.fill(self.fork, &fill),
        );
        equations.add_third_difference_penalty(SMOOTHNESS);
        let steps = equations.solve_in_passes(&solver?.with_fork(self.fork), SMOOTHNESS, passes)?;
        Ok(nurbs.moved(steps.into_iter().map(|[step]| step)))
    }
}

/// The heights of a surface at the nodes of a field, mm.
fn heights_at_nodes(nurbs: &NurbsSurface, field: &HeightField) -> Vec<f64> {
    let (xs, ys) = field.grid().coordinates();
    nurbs.heights_over(&xs, &ys)
}

/// The tangent of the angle between the normals of two slopes, at most that of the steepest surface.
fn tangent(one: Vector2<f64>, other: Vector2<f64>) -> f64 {
    let [one, other] = [one, other].map(|slope| Vector3::new(-slope.x, -slope.y, 1.0));
    let lengths = (one.norm_squared() * other.norm_squared()).sqrt();
    one.cross(&other).norm() / one.dot(&other).max(STEEPEST_SURFACE.cos() * lengths)
}

/// Whether a difference of two slopes, rad, matters where the squared slope is `steep`.
fn is_notable(off: f64, steep: f64) -> bool {
    off > NEGLIGIBLE_SLOPE * (1.0 + steep).powi(3)
}

/// The 95th percentile.
fn p95(mut sizes: Vec<f64>) -> f64 {
    let nodes = sizes.len();
    if nodes == 0 { 0.0 } else { *sizes.select_nth_unstable_by(nodes * 95 / 100, f64::total_cmp).1 }
}

/// Runs of nodes in the same span, with the span's first control point.
fn spans_of(basis: &[super::knots::Basis]) -> Vec<(Range<usize>, usize)> {
    let mut runs: Vec<(Range<usize>, usize)> = Vec::new();
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
    fn a_sphere_is_fitted_closely_almost_to_its_steep_rim() {
        let mesh = shapes::graph(28.5, 0.75, shapes::sphere);
        let fitted =
            FittedSurface::of_part(&FacingPart::new(&mesh, &View::top()), &FitOptions::default()).unwrap();
        // Chords of 0.75 mm on R = 30 mm have a sagitta of 0.0023 mm; curved triangles reduce it to a tenth.
        let inner = worst(&fitted, shapes::sphere, 24.0);
        assert!(inner < 2.3e-4, "{inner} mm");
    }

    #[test]
    fn beyond_the_rim_the_surface_continues_smoothly() {
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
    fn a_calmed_surface_differs_only_outside_the_part() {
        // A cap whose surface continues steeply downwards beyond the rim.
        let mesh = shapes::graph(28.5, 0.75, shapes::sphere);
        let fitted =
            FittedSurface::of_part(&FacingPart::new(&mesh, &View::top()), &FitOptions::default()).unwrap();
        let calm = fitted.calmed();
        for (column, row, _) in fitted.field.surface_nodes() {
            let at = fitted.field.position(column, row);
            assert_eq!(calm.height(at), fitted.nurbs.height(at));
        }
        let lowest = |surface: &NurbsSurface| surface.heights().iter().copied().fold(f64::INFINITY, f64::min);
        assert!(lowest(&fitted.nurbs) < lowest(&calm), "the fit needs no calming");
        let corner = calm.height(ViewPoint::new(-28.4, -28.4));
        assert!((0.0..30.0).contains(&corner), "{corner} mm");
    }

    #[test]
    fn a_crease_is_visible_in_the_residual() {
        let mesh = shapes::graph(10.0, 0.5, |x, _| if x > 0.0 { -x } else { 0.0 });
        let fitted =
            FittedSurface::of_part(&FacingPart::new(&mesh, &View::top()), &FitOptions::default()).unwrap();
        assert!(fitted.residual.max > 0.003 && fitted.residual.at.x.abs() < 0.5, "{:?}", fitted.residual);
        let near = ViewPoint::new(0.03, 1.0);
        assert!((fitted.sampled_height(near).unwrap() + 0.03).abs() < 0.01);
    }
}
