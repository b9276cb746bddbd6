//! Windows: rectangles of a part in which its surface is fitted with smaller spans, because the spans of the whole part do
//! not follow it there.
//!
//! A small boss or rod on a wide plate is lost among the nodes of the plate, and smaller spans all over the plate would be
//! wasted. So the surface is a hierarchy (Forsey & Bartels, Hierarchical B-spline refinement, Computer Graphics 22(4), SIGGRAPH
//! 1988): on each level the spans are half as long as on the one before, and only where that one misses the part.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use nalgebra::Vector2;

use super::{Data, FittedSurface, NODES_PER_SPAN, Residual, SWING_REACH, Window};
use crate::geometry::faces::joined;
use crate::geometry::facing_part::{FacingPart, PartSamples, Uncertainty};
use crate::geometry::fork::Fork;
use crate::geometry::height_field::{Grid, HeightField, NO_FACE, Node, STEEPEST_REFINED, grown};
use crate::geometry::space::{Extents, ViewPoint};
use crate::geometry::surface::nurbs::NurbsSurface;

/// At most this many levels: the smallest spans are 1/64 of those of the whole part.
const MOST_LEVELS: usize = 6;

/// Spans of a level along the sides of the squares that windows are made of.
const SQUARE: usize = 4;

/// A window is fitted with this many more spans on each side, so that what is beyond does not change it.
const MARGIN: usize = 6;

/// Nodes this close to one that is missed are in the window, too: the spline needs some spans to bend.
const BESIDE: usize = 2;

/// Nodes within this many steps of those at an edge of the part are excluded from the fit of a window: the sides of the edge have
/// no control point in common then, so that a cliff does not make the spline swing beside it.
const REACH: usize = 3;

/// The windows of a part have at most this many nodes; it limits time and memory.
const MOST_NODES: usize = 400_000;

/// At most this many windows per level: each one looks through all triangles of the part.
const MOST_WINDOWS: usize = 64;

/// The surface round a drawing has at most this many nodes.
const MOST_NODES_ROUND: usize = 1_000_000;

/// Spans that are shorter than this, mm, must follow the part more closely in proportion, because lengths
/// depend on its slope.
const SHORT: f64 = 1.0;

/// Spans are not halved to less than this, mm: the detail that shorter spans show is too small to be marked.
const SHORTEST: f64 = 0.25;

/// If the nodes of the whole part are closer than this, mm, sides of the part with most nodes beside edges
/// are skipped.
const CLOSE: f64 = 0.5;

/// Beside a step, the spans are halved until the nodes are closer than this, mm. Drawings are marked up to
/// this distance from the walls of a recess.
const CLOSE_TO_STEP: f64 = 0.2;

/// The spans miss the part by far if they miss it by more than this many times their tolerance.
const BY_FAR: f64 = 20.0;

/// Where the spans miss more than this share of the part, its detail is not in a few places.
const FEW: f64 = 0.2;

/// On a level side, the spans miss the part if the slope of the samples differs from that of the part by more
/// than this, rad. On a side that is tilted by 45 degrees, this makes lengths wrong by 0.1 %.
const TURN: f64 = 2e-3;

/// A side of the part with fewer nodes is not fitted for its own sake.
const LEAST_SIDE: usize = 3;

/// The rectangle round a drawing is larger on each side by this share of its longer side. If [`ROUND_SPANS`]
/// is more, that applies.
const ROUND_SHARE: f64 = 0.25;
/// The rectangle round a drawing is larger on each side by at least this many of the smallest spans.
const ROUND_SPANS: f64 = 8.0;

impl Window {
    /// The rectangle in which the window applies, mm.
    pub(super) fn rectangle(&self) -> Extents {
        let (x, y) = self.surface.nurbs.knots();
        let ends = |end: fn(&Range<usize>) -> usize| {
            let along = |axis: usize, start: f64, step: f64| {
                start + step * (end(&self.core[axis]) as f64 - self.first[axis] as f64)
            };
            Vector2::new(along(0, x.start(), x.step()), along(1, y.start(), y.step()))
        };
        Extents { min: ends(|range| range.start), max: ends(|range| range.end) }
    }
}

/// A window as it was fitted.
struct Fitted {
    window: Window,
    /// Whether it misses the part at each of its nodes.
    missed: Vec<bool>,
    /// Whether its spans are better than those twice as long.
    helps: bool,
    /// The sides of the part that continue each other there.
    continuing: BTreeSet<[u32; 2]>,
}

/// What is known at the nodes of a grid.
struct Known {
    columns: usize,
    nodes: Vec<KnownNode>,
}

#[derive(Clone, Copy)]
struct KnownNode {
    node: Node,
    difference: f64,
    doubt: f64,
    uncertainty: Uncertainty,
    /// Whether the part was sampled there.
    is_sampled: bool,
    face: u32,
}

impl KnownNode {
    fn of(surface: &FittedSurface, node: usize) -> Self {
        Self {
            node: surface.field.nodes()[node],
            difference: surface.differences[node],
            doubt: surface.doubts.get(node).copied().unwrap_or_default(),
            uncertainty: surface.uncertainty_of(node),
            is_sampled: surface.is_sampled(node),
            face: surface.field.faces().get(node).copied().unwrap_or(NO_FACE),
        }
    }

    /// What is known in the middle of nodes: of surface where all are.
    fn between(nodes: [Self; 4]) -> Self {
        let height = |node: Node| match node {
            Node::Empty => None,
            Node::Wall(height) | Node::Surface(height) => Some(height),
        };
        let known = nodes.iter().filter_map(|known| height(known.node));
        let (count, sum) = known.fold((0, 0.0), |(count, sum), height| (count + 1, sum + height));
        let is_surface = nodes.iter().all(|known| matches!(known.node, Node::Surface(_)));
        Self {
            node: match count {
                0 => Node::Empty,
                4 if is_surface => Node::Surface(sum / 4.0),
                _ => Node::Wall(sum / f64::from(count)),
            },
            difference: nodes.iter().map(|known| known.difference).sum::<f64>() / 4.0,
            doubt: nodes.iter().map(|known| known.doubt).fold(0.0, f64::max),
            uncertainty: nodes
                .iter()
                .map(|known| known.uncertainty)
                .fold(Uncertainty::NONE, Uncertainty::largest),
            is_sampled: false,
            face: if nodes.iter().all(|known| known.face == nodes[0].face) { nodes[0].face } else { NO_FACE },
        }
    }
}

impl Known {
    /// Of the nodes in a rectangle of a surface whose first node is the `first` of the part.
    fn of(surface: &FittedSurface, first: [usize; 2], nodes: &[Range<usize>; 2]) -> Self {
        let [columns, rows] = nodes.clone();
        let width = surface.field.size().0;
        let at =
            |column: usize, row: usize| KnownNode::of(surface, (row - first[1]) * width + column - first[0]);
        let nodes = rows.flat_map(|row| columns.clone().map(move |column| (column, row)));
        Self { columns: columns.len(), nodes: nodes.map(|(column, row)| at(column, row)).collect() }
    }

    /// With nodes in the middle of all neighbours.
    fn halved(&self) -> Self {
        let rows = self.nodes.len() / self.columns;
        let columns = 2 * self.columns - 1;
        let at = |column: usize, row: usize| {
            let [left, right, low, high] = [column / 2, column.div_ceil(2), row / 2, row.div_ceil(2)];
            let corners = [(left, low), (right, low), (left, high), (right, high)];
            let corners = corners.map(|(column, row)| self.nodes[row * self.columns + column]);
            if left == right && low == high { corners[0] } else { KnownNode::between(corners) }
        };
        let nodes = (0..2 * rows - 1).flat_map(|row| (0..columns).map(move |column| (column, row)));
        Self { columns, nodes: nodes.map(|(column, row)| at(column, row)).collect() }
    }

    /// Takes what is known in the core of a window; the nodes are those of `spans` of its level.
    fn replace(&mut self, spans: &[Range<usize>; 2], window: &Window) {
        let core = [0, 1].map(|axis| common(&window.core[axis], &spans[axis]));
        if core.iter().any(Range::is_empty) {
            return;
        }
        let core = core.map(nodes_of);
        let there = Self::of(&window.surface, window.first.map(|span| NODES_PER_SPAN * span), &core);
        let [from, low] = [0, 1].map(|axis| core[axis].start - NODES_PER_SPAN * spans[axis].start);
        for (row, line) in there.nodes.chunks_exact(there.columns).enumerate() {
            let start = (low + row) * self.columns + from;
            self.nodes[start..start + there.columns].copy_from_slice(line);
        }
    }

    /// The heights of the part from those of a surface below it, mm.
    fn raise(&mut self, fitted: &[f64]) {
        for (known, fitted) in self.nodes.iter_mut().zip(fitted) {
            if let Node::Surface(height) = &mut known.node {
                *height = fitted + known.difference;
            }
        }
    }

    /// How far the part is above a surface with these heights, mm.
    fn compare(&mut self, fitted: &[f64]) {
        for (known, fitted) in self.nodes.iter_mut().zip(fitted) {
            if let Node::Surface(height) = known.node {
                known.difference = height - fitted;
            }
        }
    }
}

/// The nodes of some spans.
fn nodes_of(spans: Range<usize>) -> Range<usize> {
    NODES_PER_SPAN * spans.start..NODES_PER_SPAN * spans.end + 1
}

/// The same rectangle in spans of the next level.
fn doubled(spans: &[Range<usize>; 2]) -> [Range<usize>; 2] {
    spans.clone().map(|range| 2 * range.start..2 * range.end)
}

/// The nodes over all spans of a surface.
fn grid_of(nurbs: &NurbsSurface) -> Grid {
    let (x, y) = nurbs.knots();
    let [columns, rows] = [x, y].map(|knots| NODES_PER_SPAN * knots.spans() + 1);
    Grid { origin: nurbs.domain().min, step: x.step() / NODES_PER_SPAN as f64, columns, rows }
}

/// The heights of a surface at the nodes of a grid, mm.
fn heights_over(nurbs: &NurbsSurface, grid: &Grid) -> Vec<f64> {
    let (xs, ys) = grid.coordinates();
    nurbs.heights_over(&xs, &ys)
}

/// The common part of two ranges.
fn common(one: &Range<usize>, other: &Range<usize>) -> Range<usize> {
    one.start.max(other.start)..one.end.min(other.end)
}

/// The rectangle of spans of a level that covers `spans` of a `finer` one, that many halvings later.
pub(super) fn covering(spans: &[Range<usize>; 2], finer: usize) -> [Range<usize>; 2] {
    spans.clone().map(|range| range.start >> finer..range.end.div_ceil(1 << finer))
}

impl FittedSurface {
    /// The windows in which it has smaller spans.
    pub fn windows(&self) -> &[Window] {
        &self.windows
    }

    /// The surface with these windows; `None` unless each window has the spans in which it applies, and the
    /// part has these spans, too.
    pub fn with_windows(self, windows: Vec<Window>) -> Option<Self> {
        let fits = |window: &Window| {
            let (x, y) = window.surface.nurbs.knots();
            let own = [x.spans(), y.spans()];
            let nodes = own.map(|spans| NODES_PER_SPAN * spans + 1);
            let all = self.spans(window.level.min(MOST_LEVELS));
            let is_inside = |axis: usize| {
                let Range { start, end } = window.core[axis];
                let first = window.first[axis];
                first <= start && start < end && end <= all[axis] && end - first <= own[axis]
            };
            (1..=MOST_LEVELS).contains(&window.level)
                && (0..2).all(is_inside)
                && window.surface.field.size() == (nodes[0], nodes[1])
        };
        let (x, y) = self.nurbs.knots();
        let nodes = [x, y].map(|knots| NODES_PER_SPAN * knots.spans() + 1);
        let is_whole = self.field.size() == (nodes[0], nodes[1]);
        (windows.is_empty() || is_whole && windows.iter().all(fits)).then(|| self.through(windows))
    }

    /// The surface with windows, which change its residual.
    pub(super) fn through(mut self, windows: Vec<Window>) -> Self {
        self.windows = windows;
        if !self.windows.is_empty() {
            self.residual = Residual::of(&self.field, &self.finest_differences());
        }
        self
    }

    /// Height of the sampled part minus height of the fit at each node of the field, mm, in the smallest spans there; 0 where there
    /// is no surface.
    pub fn finest_differences(&self) -> Vec<f64> {
        let mut differences = self.differences.clone();
        let columns = self.field.size().0;
        // Those of smaller spans come last.
        for window in &self.windows {
            let apart = 1 << window.level;
            let width = window.surface.field.size().0;
            let [across, up] = [0, 1].map(|axis| {
                let nodes = window.core[axis].clone();
                (NODES_PER_SPAN * nodes.start).div_ceil(apart)..NODES_PER_SPAN * nodes.end / apart + 1
            });
            for row in up {
                for column in across.clone() {
                    let [x, y] = [column, row].map(|node| node * apart);
                    let [first_x, first_y] = window.first.map(|span| NODES_PER_SPAN * span);
                    differences[row * columns + column] =
                        window.surface.differences[(y - first_y) * width + x - first_x];
                }
            }
        }
        differences
    }

    /// [`sampled_height`](Self::sampled_height) in the smallest spans there.
    pub fn finest_height(&self, at: ViewPoint) -> Option<f64> {
        let is_there = |window: &&Window| window.rectangle().contains(at.coords());
        self.windows.iter().rfind(is_there).map_or(self, |window| &window.surface).sampled_height(at)
    }

    /// The length of a span on a level, mm.
    fn span_of(&self, level: usize) -> f64 {
        self.nurbs.knots().0.step() / (1u64 << level) as f64
    }

    /// Spans of the whole part along x and y on a level.
    fn spans(&self, level: usize) -> [usize; 2] {
        let (x, y) = self.nurbs.knots();
        [x.spans() << level, y.spans() << level]
    }

    /// The surface over spans of a level, with all windows up to it.
    pub(super) fn over(&self, level: usize, spans: &[Range<usize>; 2]) -> Option<NurbsSurface> {
        let mut covered = covering(spans, level);
        let mut nurbs = self.nurbs.cropped(&covered)?;
        for level in 1..=level {
            (covered, nurbs) = (doubled(&covered), nurbs.halved());
            for window in self.windows.iter().filter(|window| window.level == level) {
                nurbs.replace(&covered, &window.surface.nurbs, window.first, &window.core);
            }
        }
        let inside = [0, 1].map(|axis| {
            let first = covered[axis].start;
            spans[axis].start - first..spans[axis].end - first
        });
        nurbs.cropped(&inside)
    }

    /// The surface fitted again with smaller spans where it misses the part, until it follows the part or
    /// smaller spans no longer help. `continuing` are the sides of the part that continue each other at its
    /// own nodes.
    pub(super) fn in_windows(
        mut self,
        part: &FacingPart,
        missed: &[bool],
        tolerance: f64,
        mut continuing: BTreeSet<[u32; 2]>,
    ) -> Self {
        if !self.are_few(missed) {
            return self.with_joined_faces(&continuing);
        }
        let mut squares = BTreeSet::new();
        let columns = self.field.size().0;
        add_squares(&mut squares, missed, columns, [0, 0], &self.spans(1));
        let mut left = MOST_NODES;
        let mut doubtful = Vec::new();
        for level in 1..=MOST_LEVELS {
            if self.span_of(level) < SHORTEST {
                break;
            }
            let all = self.spans(level);
            let cores = rectangles(&std::mem::take(&mut squares), &all);
            let affordable = |core: &[Range<usize>; 2]| {
                let nodes = nodes_in(&with_margin(core, &all));
                let fits = nodes <= left;
                left -= if fits { nodes } else { 0 };
                fits
            };
            let cores: Vec<_> = cores.into_iter().filter(affordable).take(MOST_WINDOWS).collect();
            if cores.is_empty() {
                break;
            }
            let found: Vec<Fitted> =
                cores.into_iter().filter_map(|core| self.window(part, level, core, tolerance)).collect();
            for Fitted { window, missed, helps, continuing: there } in found {
                continuing.extend(there);
                match (helps, level) {
                    (true, _) => {}
                    (false, 1) => doubtful.push(self.windows.len()),
                    (false, _) => continue,
                }
                let columns = window.surface.field.size().0;
                let first = window.first.map(|span| NODES_PER_SPAN * span);
                add_squares(&mut squares, &missed, columns, first, &self.spans(level + 1));
                self.windows.push(window);
            }
        }
        // Detail that is finer than the samples shows only after they resolve it.
        let holds = |outer: &Window, inner: &Window| {
            let meets = |axis: usize| {
                let (outer, inner) = (&outer.core[axis], &inner.core[axis]);
                inner.start < 2 * outer.end && inner.end > 2 * outer.start
            };
            inner.level == outer.level + 1 && meets(0) && meets(1)
        };
        let vain: Vec<usize> = doubtful
            .into_iter()
            .filter(|window| !self.windows.iter().any(|inner| holds(&self.windows[*window], inner)))
            .collect();
        let mut windows = std::mem::take(&mut self.windows);
        for window in vain.into_iter().rev() {
            windows.remove(window);
        }
        self.through(windows).with_joined_faces(&continuing)
    }

    /// The surface and its windows, with faces that continue each other as one face; without faces if all are
    /// one.
    fn with_joined_faces(mut self, continuing: &BTreeSet<[u32; 2]>) -> Self {
        let surfaces = || std::iter::once(&self).chain(self.windows.iter().map(|window| &window.surface));
        let mut faces: Vec<Vec<u32>> =
            surfaces().map(|surface| joined(surface.field.faces(), continuing)).collect();
        let are_several = surfaces().zip(&faces).any(|(surface, faces)| {
            let columns = surface.field.size().0;
            let mut on_surface = surface.field.surface_nodes();
            !faces.is_empty() && on_surface.any(|(column, row, _)| faces[row * columns + column] != faces[0])
        });
        if !are_several {
            faces.iter_mut().for_each(Vec::clear);
        }
        let mut faces = faces.into_iter();
        let mut joined = |surface: Self| {
            let faces = faces.next().unwrap_or_default();
            if surface.field.faces() == faces {
                return surface;
            }
            let field = surface.field.with_faces(faces);
            Self { field, ..surface }
        };
        let windows = std::mem::take(&mut self.windows);
        let whole = joined(self);
        let windows =
            windows.into_iter().map(|window| Window { surface: joined(window.surface), ..window }).collect();
        Self { windows, ..whole }
    }

    /// Fits a window; `None` if no part of the surface can be fitted there.
    fn window(
        &self,
        part: &FacingPart,
        level: usize,
        core: [Range<usize>; 2],
        tolerance: f64,
    ) -> Option<Fitted> {
        let coarse = covering(&with_margin(&core, &self.spans(level)), 1);
        let covered = doubled(&coarse);
        let before = self.over(level - 1, &coarse)?.halved();
        let grid = grid_of(&before);
        let columns = grid.columns;
        let samples = part.sample(&grid);
        let tolerance = tolerance * (self.span_of(level) / SHORT).min(1.0);
        let (nurbs, _) =
            Data::solved(part, &samples, REACH, |data| data.correct(before.clone(), tolerance)).ok()?;
        let in_core = |node: usize| {
            let at = [node % columns, node / columns];
            (0..2).all(|axis| {
                let nodes = [core[axis].start, core[axis].end]
                    .map(|end| NODES_PER_SPAN * (end - covered[axis].start));
                (nodes[0]..=nodes[1]).contains(&at[axis])
            })
        };
        let near = grown(&samples.is_at_edge, columns, REACH);
        let of_before = heights_over(&before, &grid);
        let surface = Self::sampled(part, nurbs, &samples);
        let mut missed = surface.missed_by(1.0, &samples, part.fork(), tolerance);
        missed.iter_mut().enumerate().for_each(|(node, missed)| *missed &= in_core(node));
        let PartSamples { field, slopes, .. } = &samples;
        let (mut squares_before, mut squares_after, mut count) = (0.0, 0.0, 0usize);
        for (column, row, height) in field.surface_nodes() {
            let node = row * columns + column;
            if in_core(node) && !near[node] && slopes[node].gradient.norm_squared() <= STEEPEST_REFINED {
                squares_before += (height - of_before[node]).powi(2);
                squares_after += surface.differences[node].powi(2);
                count += 1;
            }
        }
        if count == 0 {
            return None;
        }
        let helps =
            4.0 * squares_after <= squares_before || squares_after <= count as f64 * tolerance.powi(2) / 4.0;
        let first = [covered[0].start, covered[1].start];
        let mut samples = samples;
        let continuing = std::mem::take(&mut samples.continuing);
        let surface = surface.doubted_by(samples, part.fork());
        Some(Fitted { window: Window { level, first, core, surface }, missed, helps, continuing })
    }

    /// The surface round a drawing with these extents, with the smallest spans of the windows under it; `None` if no window is
    /// under it.
    pub fn round(&self, drawing: &Extents) -> Option<Self> {
        let touches = |window: &&Window| drawing.touches(&window.rectangle());
        let finest = self.windows.iter().filter(touches).map(|window| window.level).max()?;
        let (knots_x, knots_y) = self.nurbs.knots();
        (1..=finest).rev().find_map(|level| {
            let step = self.span_of(level);
            let round = drawing.grown((ROUND_SHARE * drawing.size().max()).max(ROUND_SPANS * step));
            let along = |axis: usize, start: f64, count: usize| {
                // Casts saturate.
                let first = (((round.min[axis] - start) / step).floor() as usize).min(count - 1);
                first..(((round.max[axis] - start) / step).ceil() as usize).clamp(first + 1, count)
            };
            let [all_x, all_y] = self.spans(level);
            let spans = [along(0, knots_x.start(), all_x), along(1, knots_y.start(), all_y)];
            // Whole spans of the part, so that all levels begin and end with the same.
            let spans = covering(&spans, level).map(|range| range.start << level..range.end << level);
            (nodes_in(&spans) <= MOST_NODES_ROUND).then(|| self.assembled(level, &spans)).flatten()
        })
    }

    /// The surface over spans of a level that are whole spans of the part, with all windows up to it.
    fn assembled(&self, level: usize, spans: &[Range<usize>; 2]) -> Option<Self> {
        let mut covered = covering(spans, level);
        let mut nurbs = self.nurbs.cropped(&covered)?;
        let mut known = Known::of(self, [0, 0], &covered.clone().map(nodes_of));
        for level in 1..=level {
            (covered, nurbs, known) = (doubled(&covered), nurbs.halved(), known.halved());
            // Beside a window the surface changes, but not the part.
            known.raise(&heights_over(&nurbs, &grid_of(&nurbs)));
            for window in self.windows.iter().filter(|window| window.level == level) {
                nurbs.replace(&covered, &window.surface.nurbs, window.first, &window.core);
                known.replace(&covered, window);
            }
            known.compare(&heights_over(&nurbs, &grid_of(&nurbs)));
        }
        let Grid { origin, step, columns, rows } = grid_of(&nurbs);
        let heights = known.nodes.iter().map(|known| known.node).collect();
        let faces = match self.field.faces() {
            [] => Vec::new(),
            _ => known.nodes.iter().map(|known| known.face).collect(),
        };
        let field = HeightField::new(origin, step, columns, rows, heights)?.with_faces(faces);
        let doubts = match known.nodes.iter().any(|known| known.doubt > 0.0) {
            true => known.nodes.iter().map(|known| known.doubt).collect(),
            false => Vec::new(),
        };
        let uncertainties = known.nodes.iter().map(|known| known.uncertainty).collect();
        let surface = Self::compare(nurbs, field)
            .doubted(doubts, uncertainties)
            .with_known(self.known.clone())
            .measured(self.is_measured);
        let sampled = known.nodes.iter().map(|known| known.is_sampled).collect();
        Some(Self { sampled, ..surface })
    }
}

impl FittedSurface {
    /// The nodes at which the surface of a whole part misses it by far ([`Self::missed_by`]).
    pub(super) fn missed(&self, samples: &PartSamples, fork: &dyn Fork, tolerance: f64) -> Vec<bool> {
        self.missed_by(BY_FAR, samples, fork, tolerance)
    }

    /// Whether few of the nodes on the part are marked.
    fn are_few(&self, marked: &[bool]) -> bool {
        let count = marked.iter().filter(|marked| **marked).count();
        count as f64 <= FEW * self.field.surface_nodes().count() as f64
    }

    /// The nodes at which the surface misses the part where it may be marked; and those of sides that are so narrow that most of
    /// their nodes are beside edges. The tolerance is in mm.
    fn missed_by(&self, times: f64, samples: &PartSamples, fork: &dyn Fork, tolerance: f64) -> Vec<bool> {
        let turns = self.turns_between_samples(&samples.slopes, &self.field.near_walls(SWING_REACH), fork);
        let columns = self.field.size().0;
        let near = grown(&samples.is_at_edge, columns, REACH);
        let narrow = match times > 1.0 && self.field.step() < CLOSE {
            true => BTreeSet::new(),
            false => samples.narrow_sides(&near),
        };
        let beside_step = match self.field.step() > CLOSE_TO_STEP {
            true => grown(&samples.is_at_step, columns, 1),
            false => vec![false; near.len()],
        };
        let mut missed = vec![false; near.len()];
        for turn in turns.iter().filter(|turn| turn.off > times * TURN * (1.0 + turn.steep).powf(1.5)) {
            missed[turn.node] = !near[turn.node];
        }
        for (node, missed) in missed.iter_mut().enumerate() {
            let steep = samples.slopes[node].gradient.norm_squared();
            *missed |= match near[node] {
                true if beside_step[node] => true,
                true => samples.sides[node].is_some_and(|side| narrow.contains(&side)),
                false => self.differences[node].abs() > times * tolerance * (1.0 + steep).sqrt(),
            };
            *missed &= steep <= STEEPEST_REFINED && matches!(self.field.nodes()[node], Node::Surface(_));
        }
        missed
    }
}

impl PartSamples {
    /// The sides of the part with more than half of their nodes `near` an edge.
    fn narrow_sides(&self, near: &[bool]) -> BTreeSet<u32> {
        let mut nodes: BTreeMap<u32, [usize; 2]> = BTreeMap::new();
        for (node, side) in self.sides.iter().enumerate() {
            if let (Some(side), Node::Surface(_)) = (side, self.field.nodes()[node]) {
                nodes.entry(*side).or_default()[usize::from(near[node])] += 1;
            }
        }
        let is_narrow = |[free, near]: [usize; 2]| free < near && free + near >= LEAST_SIDE;
        nodes.into_iter().filter(|(_, count)| is_narrow(*count)).map(|(side, _)| side).collect()
    }
}

/// Nodes in a rectangle of spans.
fn nodes_in(spans: &[Range<usize>; 2]) -> usize {
    spans.iter().map(|range| NODES_PER_SPAN * range.len() + 1).product()
}

fn with_margin(core: &[Range<usize>; 2], all: &[usize; 2]) -> [Range<usize>; 2] {
    [0, 1].map(|axis| {
        let range = &core[axis];
        range.start.saturating_sub(MARGIN)..(range.end + MARGIN).min(all[axis])
    })
}

/// Adds the squares of a level, by row and column, with the marked nodes of the level before and the nodes
/// beside them. `first` is the number of the first node, and `spans` are those of the whole part on the level
/// of the squares.
///
/// The nodes of a level are as far apart as the ends of the spans of the next one.
fn add_squares(
    squares: &mut BTreeSet<[usize; 2]>,
    marked: &[bool],
    columns: usize,
    first: [usize; 2],
    spans: &[usize; 2],
) {
    for node in (0..marked.len()).filter(|node| marked[*node]) {
        let at = [first[0] + node % columns, first[1] + node / columns];
        let [across, up] = [0, 1].map(|axis| {
            let last = spans[axis] - 1;
            (at[axis].saturating_sub(BESIDE)).min(last) / SQUARE..=(at[axis] + BESIDE).min(last) / SQUARE
        });
        for row in up {
            squares.extend(across.clone().map(|column| [row, column]));
        }
    }
}

/// Rectangles of spans that cover squares, and few others.
fn rectangles(squares: &BTreeSet<[usize; 2]>, all: &[usize; 2]) -> Vec<[Range<usize>; 2]> {
    let mut left = squares.clone();
    let mut found: Vec<[Range<usize>; 2]> = Vec::new();
    while let Some(&[row, column]) = left.first() {
        let mut across = column..column + 1;
        while left.contains(&[row, across.end]) {
            across.end += 1;
        }
        let mut up = row..row + 1;
        while across.clone().all(|column| left.contains(&[up.end, column])) {
            up.end += 1;
        }
        for row in up.clone() {
            across.clone().for_each(|column| {
                left.remove(&[row, column]);
            });
        }
        let spans = |range: Range<usize>, all: usize| SQUARE * range.start..(SQUARE * range.end).min(all);
        found.push([spans(across, all[0]), spans(up, all[1])]);
    }
    // Two are one where that has no more nodes; far too many are not compared with each other.
    if found.len() > 4 * MOST_WINDOWS {
        return found;
    }
    let work = |core: &[Range<usize>; 2]| nodes_in(&with_margin(core, all));
    let mut one = 0;
    while one < found.len() {
        let joined = (one + 1..found.len()).find_map(|other| {
            let both = [0, 1].map(|axis| {
                let [a, b] = [&found[one][axis], &found[other][axis]];
                a.start.min(b.start)..a.end.max(b.end)
            });
            (work(&both) <= work(&found[one]) + work(&found[other])).then_some((other, both))
        });
        match joined {
            Some((other, both)) => {
                found.remove(other);
                found[one] = both;
                one = 0;
            }
            None => one += 1,
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::mesh::TriMesh;
    use crate::geometry::shapes;
    use crate::geometry::space::{View, ViewPoint};
    use crate::geometry::surface::fit::FitOptions;
    use proptest::prelude::*;

    /// A bump 2 mm high on a sheet of 150 mm.
    fn bump(x: f64, y: f64) -> f64 {
        2.0 * (-((x - 11.0).powi(2) + (y + 7.0).powi(2)) / 8.0).exp()
    }

    fn sheet() -> TriMesh {
        shapes::graph(75.0, 0.5, bump)
    }

    fn fitted(mesh: &TriMesh) -> FittedSurface {
        FittedSurface::of_part(&FacingPart::new(mesh, &View::top()), &FitOptions::default()).unwrap()
    }

    #[test]
    fn a_bump_is_followed_where_it_is() {
        let surface = fitted(&sheet());
        assert_eq!(surface.nurbs.knots().0.spans(), 72);
        let drawing = Extents { min: Vector2::new(8.0, -10.0), max: Vector2::new(14.0, -4.0) };
        let round = surface.round(&drawing).unwrap();
        let worst = |of: &FittedSurface| {
            let places =
                (0..900).map(|at| (8.0 + 0.2 * f64::from(at % 30), -10.0 + 0.2 * f64::from(at / 30)));
            let misses = places.map(|(x, y)| (of.nurbs.height(ViewPoint::new(x, y)) - bump(x, y)).abs());
            misses.fold(0.0, f64::max)
        };
        let [before, after] = [&surface, &round].map(worst);
        assert!(before > 0.02 && after < 2e-3, "{before} and {after} mm");
    }

    /// The nodes of the surface round a drawing are those of the part and of its windows.
    #[test]
    fn the_surface_round_a_drawing_has_the_samples_of_the_part() {
        let surface = fitted(&sheet());
        let drawing = Extents { min: Vector2::new(4.0, -14.0), max: Vector2::new(20.0, 2.0) };
        let round = surface.round(&drawing).unwrap();
        let domain = round.nurbs.domain();
        assert!(domain.contains(drawing.min) && domain.contains(drawing.max));
        for (column, row, height) in round.field.surface_nodes() {
            let at = round.field.position(column, row);
            // Beside the windows, the part may be missed, but not by far.
            let limit = BY_FAR * FitOptions::default().tolerance;
            assert!((height - bump(at.x, at.y)).abs() < limit, "{height} at {at:?}");
        }
        for window in surface.windows().iter().filter(|window| window.level == 1) {
            let there = window.rectangle();
            assert!(surface.nurbs.domain().contains(there.min) && surface.nurbs.domain().contains(there.max));
        }
    }

    /// A cliff crosses the border of the windows: their surface differs there from that of the whole part, and the part does not.
    #[test]
    fn the_part_is_the_same_on_both_sides_of_the_border_of_a_window() {
        let narrow = |x: f64, y: f64| 2.0 * (-((x - 11.0).powi(2) + (y + 7.0).powi(2)) / 2.0).exp();
        let height = |x: f64, y: f64| narrow(x, y) + if x > 15.0 { 6.0 } else { 0.0 };
        let surface = fitted(&shapes::graph(75.0, 0.25, height));
        let drawing = Extents { min: Vector2::new(4.0, -14.0), max: Vector2::new(20.0, 2.0) };
        let round = surface.round(&drawing).unwrap();
        let mut checked = 0;
        for (column, row, sampled) in surface.field.surface_nodes() {
            let at = surface.field.position(column, row);
            if let Some((column, row, _)) = round.field.cell(ViewPoint::new(at.x + 1e-6, at.y + 1e-6)) {
                let node = round.field.cell_nodes(column, row)[0];
                if let Node::Surface(height) = round.field.nodes()[node] {
                    assert!((height - sampled).abs() < 1e-9, "{height} for {sampled} at {at:?}");
                    checked += 1;
                }
            }
        }
        assert!(checked > 500, "{checked}");
    }

    proptest! {
        #[test]
        fn rectangles_cover_their_squares(squares in prop::collection::btree_set([0..20usize, 0..20usize], 0..60)) {
            let all = [78, 80];
            let found = rectangles(&squares, &all);
            for [row, column] in squares {
                let inside = |core: &[Range<usize>; 2]| {
                    let end = (SQUARE * (column + 1)).min(all[0]);
                    core[0].start <= SQUARE * column
                        && end <= core[0].end
                        && core[1].start <= SQUARE * row
                        && SQUARE * (row + 1) <= core[1].end
                };
                prop_assert!(found.iter().any(inside));
            }
            prop_assert!(found.iter().all(|core| (0..2).all(|axis| core[axis].end <= all[axis] && !core[axis].is_empty())));
        }
    }
}
