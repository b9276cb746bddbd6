//! A part turned to the laser: what the laser meets at the nodes of a grid.

use std::collections::BTreeSet;
use std::ops::Range;

use nalgebra::{Point3, Vector2, Vector3};

use super::adjacency::{WELD_DISTANCE, facet_normal, turn_in_view};
use super::cone::Cone;
use super::curved_triangle::Hit;
use super::height_field::{Grid, HeightField, Node, STEEPEST_REFINED, STEEPEST_SURFACE, for_each_side};
use super::mesh::TriMesh;
use super::smooth_mesh::{NORMAL_TOLERANCE, SmoothMesh};
use super::solid::Solid;
use super::solid::frame::Placement;
use super::solid::rays::{FaceHit, HIDDEN, SeenSolid, Start, first_of};
use crate::geometry::fork::{Fork, InTurn, found, in_pieces, join, mapped, start};
use crate::geometry::space::{Extents, View, ViewPoint};

/// Two sides of the part whose meshes are not joined continue each other where the difference of their heights is as
/// their slopes predict, to within this share of the distance between nodes.
const OFFSET: f64 = 0.1;

/// Nodes round an edge of the part are within this many steps of its height, unless the edge is hidden.
const NEAR: f64 = 4.0;

/// An edge between normals 90° apart bulges by less than this share of its length.
const MOST_BULGE: f64 = 0.25;

/// A patch bulges by less than this share of its longest side.
const HIGHEST_BULGE: f64 = 0.4;

/// A patch covers points beside its triangle in the view that are off by its bulge and less than this share of the triangle's
/// extents: the tolerance at its border.
const BESIDE: f64 = 0.01;

/// A second side of the part that faces the laser closer than this behind the first, mm, is a second skin. Coincident
/// copies, closer than the second value, are one.
const SKINS: [f64; 2] = [0.05, 2e-3];
// A hidden face must not be a second skin.
const _: () = assert!(HIDDEN > SKINS[0]);

/// A mesh with more triangles is large.
const LARGE: usize = 300_000;

/// Rows of nodes at which exact faces are looked for at once, at least.
const LEAST_ROWS: usize = 4;

/// For every node, the triangle that the laser meets there, and where; `None` beside the part.
type NodeHits = Vec<Option<(u32, Hit)>>;

/// The nodes with a second skin, in ascending order, and its distance from the first, mm.
type SecondSkins = Vec<(usize, f64)>;

/// The nodes that the patch of a triangle may cover.
struct Covered {
    triangle: u32,
    is_facing: bool,
    columns: Range<u32>,
    rows: Range<u32>,
}

/// What is seen at the nodes of some rows.
struct SeenNodes<'a> {
    grid: &'a Grid,
    rows: Range<usize>,
    hits: &'a mut [Option<(u32, Hit)>],
    doubled: SecondSkins,
}

impl SeenNodes<'_> {
    /// The nodes of a row.
    fn line(&mut self, row: usize) -> &mut [Option<(u32, Hit)>] {
        &mut self.hits[(row - self.rows.start) * self.grid.columns..][..self.grid.columns]
    }
}

/// A part turned to the laser, ready to be sampled at any spacing.
#[derive(Debug, Clone)]
pub struct FacingPart<'f> {
    fork: &'f dyn Fork,
    mesh: SmoothMesh,
    is_facetted: bool,
    /// The exact faces, if they are known; the mesh is empty then.
    faces: Option<SeenSolid>,
    extents: Extents,
}

/// A sampled part.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct PartSamples {
    /// The heights.
    pub field: HeightField,
    /// For each node, whether an edge of the part is next to it: between two smooth sides, or at a cliff.
    pub is_at_edge: Vec<bool>,
    /// For each node, whether a step is next to it: from one side that may be marked to another one at another height.
    pub is_at_step: Vec<bool>,
    /// For each node, how far the part may be from its height, mm, where the part's normals contradict its facets;
    /// empty if they contradict nowhere.
    pub doubts: Vec<f64>,
    /// Where the part has two skins, one closely behind the other and both facing the laser.
    pub skins: Option<Skins>,
    /// For each node, how far the part may be from its samples because neighbouring curved facets lead to different
    /// slopes; empty if none do.
    pub uncertainties: Vec<Uncertainty>,
    /// For each node, the slope of the part; 0 beside the part.
    pub slopes: Vec<Slope>,
    /// For each node, the number of the side of the part: no edge is on it. `None` beside the part.
    pub(crate) sides: Vec<Option<u32>>,
    /// The sides that continue each other somewhere without an edge, the smaller number first.
    pub(crate) continuing: BTreeSet<[u32; 2]>,
}

/// The slope of the part at a node.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Slope {
    /// Along x and y, no unit.
    pub gradient: Vector2<f64>,
    /// How far it may be off where the facet there is too narrow to show it, rad.
    pub off: f64,
}

/// How far the part may be from its samples: between the vertices of a mesh, where they and their normals do not define it,
/// or because the points of a scan scatter.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Uncertainty {
    /// Of the slope, rad.
    pub slope: f32,
    /// Of the height, mm.
    pub height: f32,
}

impl Uncertainty {
    /// The part is known.
    pub const NONE: Self = Self { slope: 0.0, height: 0.0 };

    /// The doubt about the slope is a mean over a facet. At some place, the doubt is this many times as
    /// large. Sums over many facets need the mean; largest values need the latter.
    pub const PEAK: f64 = 3.0;

    /// That of a `slope`, rad, that changes its sign over `reach`, mm: the height is the sagitta of an arc that leaves its chord at this
    /// angle.
    pub(crate) fn over(slope: f32, reach: f32) -> Self {
        Self { slope, height: slope * reach / 4.0 }
    }

    /// Over how much of the surface the slope is wrong to one side, mm: about a facet of a mesh, a wave of a scan.
    pub fn reach(self) -> f64 {
        if self.slope > 0.0 { 4.0 * f64::from(self.height / self.slope) } else { 0.0 }
    }

    /// The larger slope and the larger height of two.
    pub fn largest(self, other: Self) -> Self {
        Self { slope: self.slope.max(other.slope), height: self.height.max(other.height) }
    }
}

/// Two sides of the part, one closely behind the other and both facing the laser.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Skins {
    /// A node where both are.
    pub at: ViewPoint,
    /// The distance between them there along the laser's axis, mm.
    pub gap: f64,
    /// The share of the nodes on the part where there are two.
    pub share: f64,
}

impl FacingPart<'static> {
    /// The part as the `view` shows it. Normals of the file are used; for a mesh without normals they are estimated
    /// ([`SmoothMesh::new`]).
    pub fn new(mesh: &TriMesh, view: &View) -> Self {
        FacingPart::with_fork(mesh, view, &InTurn)
    }
}

impl<'f> FacingPart<'f> {
    /// [`FacingPart::new`]; `fork` may do halves of the work on this part at once.
    pub fn with_fork(mesh: &TriMesh, view: &View, fork: &'f dyn Fork) -> Self {
        // The table of continuing sides is large and no longer needed.
        let smooth = || SmoothMesh { continued: Vec::new(), ..SmoothMesh::of_single(mesh, view, fork) };
        // Threads do not share the memory that they free, and large meshes take much of it.
        let is_facetted = mesh.is_facetted();
        let mesh = if mesh.triangles().len() > LARGE { smooth() } else { start(fork, smooth) };
        // Each vertex is a corner of a triangle.
        let extents = Extents::of(mesh.positions.iter().map(|position| position.coords.xy()));
        Self { fork, mesh, is_facetted, faces: None, extents }
    }

    /// The exact faces of a solid as the `view` shows them; `mesh` is a tessellation of it, which gives its extents.
    pub fn of_solid(solid: &Solid, mesh: &TriMesh, view: &View, fork: &'f dyn Fork) -> Self {
        let corners = mesh.triangles().iter().flatten();
        let extents =
            Extents::of(corners.map(|&index| view.point(mesh.positions()[index as usize]).coords.xy()));
        let faces = SeenSolid::new(&solid.placed(&Placement::turned(view.rotation())));
        Self { fork, mesh: SmoothMesh::default(), is_facetted: false, faces: Some(faces), extents }
    }

    /// Does halves of the work on this part at once.
    pub(crate) fn fork(&self) -> &'f dyn Fork {
        self.fork
    }

    /// The exact faces, if they are known.
    pub fn faces(&self) -> Option<&SeenSolid> {
        self.faces.as_ref()
    }

    /// Whether the part is exactly its flat facets ([`TriMesh::is_facetted`]).
    pub(crate) fn is_facetted(&self) -> bool {
        self.is_facetted
    }

    /// The bounding rectangle of the part in the view, mm.
    pub fn extents(&self) -> Extents {
        self.extents
    }

    /// The mean distance between neighbouring vertices of the side that faces the laser, mm in the view, as if equilateral
    /// triangles covered it; 0 for exact faces.
    pub fn spacing(&self) -> f64 {
        if self.faces.is_some() {
            return 0.0;
        }
        let (mut area, mut count) = (0.0, 0usize);
        for triangle in 0..self.mesh.triangles.len() {
            let doubled = self.turn(triangle);
            if doubled > 0.0 {
                (area, count) = (area + doubled / 2.0, count + 1);
            }
        }
        (area / count.max(1) as f64 * 4.0 / 3f64.sqrt()).sqrt()
    }

    /// Samples, for every node of the grid, the point of the curved triangles that is nearest to the laser.
    pub fn sample(&self, grid: &Grid) -> PartSamples {
        start(self.fork, || self.sampled_at(grid))
    }

    fn sampled_at(&self, grid: &Grid) -> PartSamples {
        let (hits, doubled) = match &self.faces {
            Some(faces) => exact_hits(faces, grid, self.fork),
            None => self.hits(grid),
        };
        let met = hits.iter().flatten().count();
        let skins = doubled.first().map(|&(node, gap)| Skins {
            at: grid.position(node % grid.columns, node / grid.columns),
            gap,
            share: doubled.len() as f64 / met.max(1) as f64,
        });
        let heights = || {
            let (field, mut is_at_edge) = HeightField::from_hits(grid, &hits);
            let mut is_at_step = steps_at(&is_at_edge, grid, &hits);
            let continuing = self.mark_edges(&field, &hits, &mut is_at_edge, &mut is_at_step);
            self.mark_creases(&field, &mut is_at_edge);
            (field, is_at_edge, is_at_step, continuing)
        };
        let others = || (self.doubts(&hits), self.uncertainties(&hits), self.slopes(&hits));
        let ((field, is_at_edge, is_at_step, continuing), (doubts, uncertainties, slopes)) =
            join(self.fork, heights, others);
        let sides = hits.iter().map(|hit| hit.map(|(triangle, _)| self.side(triangle))).collect();
        PartSamples { field, is_at_edge, is_at_step, doubts, uncertainties, slopes, sides, continuing, skins }
    }

    /// For every node, the triangle that is hit there, and where it is hit; and the nodes with a second skin.
    fn hits(&self, grid: &Grid) -> (NodeHits, SecondSkins) {
        let triangles = self.mesh.triangles.len();
        let covered = found(self.fork, triangles, |triangle| self.covered(grid, triangle));
        let mut hits: NodeHits = vec![None; grid.count()];
        let rows = grid.rows / 2;
        let (low, high) = hits.split_at_mut(rows * grid.columns);
        let meet_all = |rows: Range<usize>, hits: &mut [Option<(u32, Hit)>]| {
            let mut seen = SeenNodes { grid, rows, hits, doubled: Vec::new() };
            // What faces the laser comes first: most of it hides what faces away.
            for is_facing in [true, false] {
                let of_side = covered.iter().filter(|covered| covered.is_facing == is_facing);
                of_side.for_each(|covered| self.meet(covered, &mut seen));
            }
            seen.doubled
        };
        let (mut doubled, of_high) =
            join(self.fork, || meet_all(0..rows, low), || meet_all(rows..grid.rows, high));
        doubled.extend(of_high);
        doubled.sort_by_key(|&(node, _)| node);
        doubled.dedup_by_key(|&mut (node, _)| node);
        (hits, doubled)
    }

    /// The nodes that the patch of a triangle may cover; `None` if there are none.
    fn covered(&self, grid: &Grid, triangle: usize) -> Option<Covered> {
        let points = self.mesh.corners(triangle).0;
        let extents = Extents::of(points.map(|point| point.coords.xy()));
        let diagonal = extents.size().norm();
        let nodes_in = |extents: Extents| {
            let columns = grid.range(extents.min.x, extents.max.x, grid.origin.x, grid.columns);
            if columns.is_empty() {
                return None;
            }
            let rows = grid.range(extents.min.y, extents.max.y, grid.origin.y, grid.rows);
            (!rows.is_empty()).then_some((columns, rows))
        };
        nodes_in(extents.grown(diagonal * MOST_BULGE))?;
        let most_bulge = self.mesh.most_bulge(triangle);
        let (columns, rows) = nodes_in(extents.grown(most_bulge.min(diagonal * MOST_BULGE)))?;
        let outline = Outline::of(points, most_bulge + BESIDE * diagonal);
        let is_near = |column: usize, row: usize| outline.is_near(grid.position(column, row).coords());
        let is_any = rows.clone().any(|row| columns.clone().any(|column| is_near(column, row)));
        let [columns, rows] = [columns, rows].map(|range| range.start as u32..range.end as u32);
        let (is_facing, triangle) = (self.turn(triangle) > 0.0, triangle as u32);
        is_any.then_some(Covered { triangle, is_facing, columns, rows })
    }

    /// Meets the nodes that a triangle covers.
    fn meet(&self, covered: &Covered, seen: &mut SeenNodes) {
        let whole = |range: &Range<u32>| range.start as usize..range.end as usize;
        let (triangle, columns, rows) =
            (covered.triangle as usize, whole(&covered.columns), whole(&covered.rows));
        let rows = rows.start.max(seen.rows.start)..rows.end.min(seen.rows.end);
        if rows.is_empty() {
            return;
        }
        let is_hidden = |seen: &Option<(u32, Hit)>, top: f64| {
            seen.is_some_and(|(_, old)| old.on_patch && top + SKINS[0] < old.height)
        };
        let points = self.mesh.corners(triangle).0;
        let sides = [points[1] - points[0], points[2] - points[1], points[0] - points[2]];
        let longest = sides.iter().map(Vector3::norm_squared).fold(0.0, f64::max).sqrt();
        let highest = points.iter().map(|point| point.z).fold(f64::NEG_INFINITY, f64::max);
        let is_surely_hidden = |seen: &Option<(u32, Hit)>| is_hidden(seen, highest + longest * HIGHEST_BULGE);
        if rows.clone().all(|row| seen.line(row)[columns.clone()].iter().all(is_surely_hidden)) {
            return;
        }
        let patch = self.mesh.patch(triangle);
        let bulge = patch.largest_bulge();
        let Some(patch) = patch.seen() else { return };
        let cone = self.mesh.cone_of(triangle);
        let near = Extents::of(points.map(|point| point.coords.xy())).grown(bulge);
        let grid = seen.grid;
        for row in rows {
            for column in columns.clone() {
                let at = grid.position(column, row).coords();
                let known = &mut seen.line(row)[column];
                if !near.contains(at) || is_hidden(known, highest + bulge) {
                    continue;
                }
                let Some(hit) = patch.hit(at) else { continue };
                let hit = cone.and_then(|cone| hit_on_cone(cone, at, hit, bulge)).unwrap_or(hit);
                let old = *known;
                // A flat facet under a neighbour's bulge must not hide the true surface.
                let lead = if hit.on_patch { 0.0 } else { 2.0 * bulge };
                match known {
                    Some((_, old)) if old.on_patch && hit.height <= old.height + lead => {}
                    Some((other, old)) if self.bulges_through(triangle, *other as usize, at, old) => {}
                    Some((_, old)) if !old.on_patch && hit.height + 2.0 * bulge <= old.height => {}
                    Some((_, old)) if !old.on_patch && !hit.on_patch && hit.height <= old.height => {}
                    _ => *known = Some((covered.triangle, hit)),
                }
                if let Some((other, old)) = old {
                    let gap = (hit.height - old.height).abs();
                    if gap < SKINS[0] && gap > SKINS[1] && self.are_skins(triangle, other as usize) {
                        seen.doubled.push((row * grid.columns + column, gap));
                    }
                }
            }
        }
    }

    /// Whether a triangle that faces away from the laser is above a hit on another one only because of its
    /// bulge, as the underside of a thin wall with coarse facets may be. The laser meets the side that faces
    /// it.
    fn bulges_through(&self, triangle: usize, other: usize, at: Vector2<f64>, hit: &Hit) -> bool {
        let flat_height = || {
            let points = self.mesh.corners(triangle).0;
            let normal = facet_normal(points);
            points[0].z - normal.xy().dot(&(at - points[0].coords.xy())) / normal.z
        };
        let faces_away = self.turn(triangle) < 0.0 && self.turn(other) > 0.0;
        faces_away && flat_height() < hit.height && self.are_apart(triangle, other)
    }

    /// [`turn_in_view`] of a triangle.
    fn turn(&self, triangle: usize) -> f64 {
        turn_in_view(self.mesh.corners(triangle).0)
    }

    /// Whether two triangles that are hit at one node face the same way and have no corner in common.
    fn are_skins(&self, one: usize, other: usize) -> bool {
        self.turn(one) * self.turn(other) > 0.0 && self.are_apart(one, other)
    }

    /// Whether two triangles have no corner in common.
    fn are_apart(&self, one: usize, other: usize) -> bool {
        let [one_places, other_places] = [one, other].map(|triangle| self.mesh.corners(triangle).0);
        !one_places.iter().any(|place| other_places.contains(place))
    }

    fn slopes(&self, hits: &[Option<(u32, Hit)>]) -> Vec<Slope> {
        let shortest = self.mesh.shortest();
        let slope = |(triangle, hit): (u32, Hit)| Slope {
            gradient: hit.gradient,
            off: match self.faces {
                Some(_) => 0.0,
                None if self.mesh.cone_of(triangle as usize).is_some() => 0.0,
                None => self.mesh.steepness_of_sliver(triangle as usize, shortest),
            },
        };
        hits.iter().map(|hit| hit.map_or_else(Slope::default, slope)).collect()
    }

    fn uncertainties(&self, hits: &[Option<(u32, Hit)>]) -> Vec<Uncertainty> {
        if self.mesh.slope_doubts.is_empty() {
            return Vec::new();
        }
        let mut is_hit = vec![false; self.mesh.triangles.len()];
        hits.iter().flatten().for_each(|(triangle, _)| is_hit[*triangle as usize] = true);
        let of_triangles = mapped(self.fork, is_hit.len(), |triangle| {
            let slope = if is_hit[triangle] { self.mesh.slope_doubts[triangle] } else { 0.0 };
            let reach = if slope > 0.0 { self.mesh.reach_of_turn(triangle) } else { 0.0 };
            Uncertainty::over(slope, reach as f32)
        });
        let of_hit = |hit: &Option<(u32, Hit)>| {
            hit.map_or(Uncertainty::NONE, |(triangle, _)| of_triangles[triangle as usize])
        };
        hits.iter().map(of_hit).collect()
    }

    fn doubts(&self, hits: &[Option<(u32, Hit)>]) -> Vec<f64> {
        if self.mesh.doubts.is_empty() {
            return Vec::new();
        }
        hits.iter().map(|hit| hit.map_or(0.0, |(triangle, _)| self.mesh.doubts[triangle as usize])).collect()
    }

    /// Marks the nodes round sharp creases, which may be edges that only the facets of the part show: such an edge may end in the
    /// middle of a smooth side.
    fn mark_creases(&self, field: &HeightField, is_at_edge: &mut [bool]) {
        for crease in self.mesh.creases.iter().filter(|crease| crease.is_sharp) {
            let [from, to] = self.mesh.ends(crease.side as usize);
            let count = ((to - from).xy().norm() / field.grid.step * 2.0).ceil().max(1.0) as usize;
            for index in 0..=count {
                let at = from + (to - from) * (index as f64 / count as f64);
                let Some((column, row, _)) = field.grid.cell(ViewPoint::new(at.x, at.y)) else { continue };
                for node in field.grid.cell_nodes(column, row) {
                    // A node at another height hides the edge.
                    let is_near = |height: f64| (height - at.z).abs() < NEAR * field.grid.step;
                    is_at_edge[node] |= matches!(field.nodes[node], Node::Surface(height) if is_near(height));
                }
            }
        }
    }

    /// The number of the smooth side of the part on which a triangle is, or an exact face.
    fn side(&self, triangle: u32) -> u32 {
        self.mesh.regions.get(triangle as usize).copied().unwrap_or(triangle)
    }

    /// Marks neighbouring nodes on two smooth sides of the part that do not continue each other, and those of them between which
    /// there is a step; returns the sides that do.
    fn mark_edges(
        &self,
        field: &HeightField,
        hits: &[Option<(u32, Hit)>],
        is_at_edge: &mut [bool],
        is_at_step: &mut [bool],
    ) -> BTreeSet<[u32; 2]> {
        let mut continuing = BTreeSet::new();
        for_each_side(&field.grid, |first, second, step| {
            let (Some((one, a)), Some((other, b))) = (hits[first], hits[second]) else { return };
            let is_surface = |node: usize| matches!(field.nodes[node], Node::Surface(_));
            let (one, other) = (self.side(one), self.side(other));
            if one == other || !(is_surface(first) || is_surface(second)) {
                return;
            }
            let normal = |hit: &Hit| Vector3::new(-hit.gradient.x, -hit.gradient.y, 1.0).normalize();
            let climb = (a.gradient + b.gradient).dot(&step) / 2.0;
            let is_alike = normal(&a).dot(&normal(&b)) > NORMAL_TOLERANCE.cos();
            let is_off = (b.height - a.height - climb).abs() >= OFFSET * field.grid.step;
            if !is_alike || is_off {
                (is_at_edge[first], is_at_edge[second]) = (true, true);
            }
            if is_alike && is_off && a.gradient.norm_squared() <= STEEPEST_REFINED {
                (is_at_step[first], is_at_step[second]) = (true, true);
            }
            if is_alike && !is_off {
                continuing.insert([one.min(other), one.max(other)]);
            }
        });
        continuing
    }
}

/// The outline of a triangle in the view.
struct Outline {
    /// For each side a point on it, the way across it, out of the triangle and as long as the side, mm, and the product of its
    /// length with what is near, mm².
    sides: [(Vector2<f64>, Vector2<f64>, f64); 3],
}

impl Outline {
    fn of(corners: [Point3<f64>; 3], reach: f64) -> Self {
        let out = -turn_in_view(corners).signum();
        let sides = [0, 1, 2].map(|side| {
            let [from, to] = [side, (side + 1) % 3].map(|corner| corners[corner].coords.xy());
            let along = to - from;
            let across = Vector2::new(-along.y, along.x) * out;
            (from, across, reach * across.norm())
        });
        Self { sides }
    }

    /// Whether a point may be within the reach of the triangle; nothing else is.
    fn is_near(&self, at: Vector2<f64>) -> bool {
        !self.sides.iter().any(|(from, across, reach)| across.dot(&(at - from)) > *reach)
    }
}

impl HeightField {
    /// The heights, and for each node whether a cliff is next to it.
    fn from_hits(grid: &Grid, hits: &[Option<(u32, Hit)>]) -> (Self, Vec<bool>) {
        let steepest = STEEPEST_SURFACE.tan();
        let mut nodes: Vec<Node> = hits
            .iter()
            .map(|hit| match hit {
                None => Node::Empty,
                Some((_, hit)) if hit.steepness() <= steepest => Node::Surface(hit.height),
                Some((_, hit)) => Node::Wall(hit.height),
            })
            .collect();
        let steepness = |index: usize| hits[index].map_or(0.0, |(_, hit)| hit.steepness().min(steepest));
        let mut is_at_cliff = vec![false; nodes.len()];
        for_each_side(grid, |first, second, _| {
            let (Some((_, a)), Some((_, b))) = (hits[first], hits[second]) else { return };
            // Between two nodes a smooth surface climbs no faster than its slopes there, plus a margin for curvature.
            let climb = 2.0 * steepness(first).max(steepness(second)) + 1.0;
            if (a.height - b.height).abs() > climb * grid.step {
                nodes[first] = Node::Wall(a.height);
                nodes[second] = Node::Wall(b.height);
                (is_at_cliff[first], is_at_cliff[second]) = (true, true);
            }
        });
        (Self { grid: *grid, nodes, faces: Vec::new() }, is_at_cliff)
    }
}

/// Where the laser's axis meets a cone if a triangle is a facet of the cone and its patch is hit; the patch
/// leaves the facet by at most `bulge`, mm. `None` at the apex, which has no slope. Also `None` if that point
/// is farther from the hit than from a surface that may be marked.
fn hit_on_cone(cone: &Cone, at: Vector2<f64>, hit: Hit, bulge: f64) -> Option<Hit> {
    let point = cone.on_sight(at.into(), hit.height)?;
    let most = (bulge + WELD_DISTANCE) / STEEPEST_SURFACE.cos();
    if (point.z - hit.height).abs() > most || cone.split(&point).1 == Vector3::zeros() {
        return None;
    }
    let normal = cone.outward(&point);
    Some(Hit { height: point.z, gradient: -normal.xy() / normal.z, on_patch: hit.on_patch })
}

/// For every node, the face that is hit there, and where it is hit; and the nodes with a second skin.
fn exact_hits(solid: &SeenSolid, grid: &Grid, fork: &dyn Fork) -> (NodeHits, SecondSkins) {
    let ranges = |face: usize| {
        let [low, high] = solid.faces()[face].bounds();
        [(0, grid.columns), (1, grid.rows)]
            .map(|(axis, count)| grid.range(low[axis], high[axis], grid.origin[axis], count))
    };
    let faces: Vec<_> = solid.from_top().into_iter().map(|face| (face, ranges(face))).collect();
    // What is seen at each node, and the distance of a second skin behind it.
    let seen = in_pieces(fork, 0..grid.rows, LEAST_ROWS, &|rows| {
        let mut faces_hit: Vec<Vec<FaceHit>> = vec![Vec::new(); grid.columns];
        let mut seen = Vec::with_capacity(rows.len() * grid.columns);
        for row in rows {
            faces_hit.iter_mut().for_each(Vec::clear);
            for (face, [in_columns, in_rows]) in &faces {
                if in_rows.contains(&row) {
                    let mut start = Start::default();
                    for column in in_columns.clone() {
                        let at = grid.position(column, row).coords();
                        solid.faces()[*face].hits(*face as u32, at, &mut start, &mut faces_hit[column]);
                    }
                }
            }
            seen.extend(faces_hit.iter().map(|hits| exact_hit(hits)));
        }
        seen
    });
    let (mut hits, mut doubled) = (Vec::with_capacity(seen.len()), Vec::new());
    for (node, (hit, gap)) in seen.into_iter().enumerate() {
        hits.push(hit);
        doubled.extend(gap.map(|gap| (node, gap)));
    }
    (hits, doubled)
}

/// Of the faces that are hit at a node, the first one, with the distance of a second skin behind it, mm.
fn exact_hit(found: &[FaceHit]) -> (Option<(u32, Hit)>, Option<f64>) {
    let Some(first) = first_of(found) else { return (None, None) };
    let is_skin = |hit: &&FaceHit| {
        hit.is_inside
            && first.is_inside
            && hit.face != first.face
            && hit.normal.z > 0.0
            && first.normal.z > 0.0
    };
    let gaps = found.iter().filter(is_skin).map(|hit| first.height - hit.height);
    let gap = gaps.filter(|gap| *gap < SKINS[0] && *gap > SKINS[1]).reduce(f64::min);
    // A normal along the view, of a wall, gives an infinite slope, whichever way it points.
    let gradient = -first.normal.xy() / first.normal.z;
    (Some((first.face, Hit { height: first.height, gradient, on_patch: true })), gap)
}

/// The nodes at a step, of those at a cliff: both sides of a step may be marked. Below an outline, another
/// part of the surface is visible; only one side can be marked there.
fn steps_at(is_at_cliff: &[bool], grid: &Grid, hits: &[Option<(u32, Hit)>]) -> Vec<bool> {
    let mut is_at_step = vec![false; is_at_cliff.len()];
    if !is_at_cliff.contains(&true) {
        return is_at_step;
    }
    let is_level =
        |node: usize| hits[node].is_some_and(|(_, hit)| hit.gradient.norm_squared() <= STEEPEST_REFINED);
    for_each_side(grid, |first, second, _| {
        if is_at_cliff[first] && is_at_cliff[second] && is_level(first) && is_level(second) {
            (is_at_step[first], is_at_step[second]) = (true, true);
        }
    });
    is_at_step
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::space::Facing;
    use nalgebra::Point3;

    impl FacingPart<'_> {
        fn sampled(&self, step: f64) -> HeightField {
            self.sample(&Grid::over(&self.extents, step)).field
        }
    }

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
    fn surface_is_near_from_its_border_on() {
        let field = FacingPart::new(&two_floors(), &View::top()).sampled(0.5);
        for (place, near, far) in [([9.0, 0.0], 4.6, 3.4), ([0.0, -35.0], 30.6, 29.4), ([8.0, 9.0], 5.7, 4.3)]
        {
            let place = ViewPoint::from(Vector2::from(place));
            assert!(field.has_surface_near(place, near) && !field.has_surface_near(place, far), "{place:?}");
        }
        assert!(field.has_surface_near(ViewPoint::new(1.0, 1.0), 0.5));
        assert!(!field.has_surface_near(ViewPoint::new(f64::NAN, 0.0), 1e9));
    }

    #[test]
    fn the_side_nearest_to_the_laser_is_sampled_and_cliffs_are_walls() {
        let field = FacingPart::new(&two_floors(), &View::top()).sampled(0.5);
        let node = |x: f64, y: f64| {
            let (column, row, _) = field.cell(ViewPoint::new(x, y)).unwrap();
            field.nodes()[field.cell_nodes(column, row)[0]]
        };
        assert_eq!(node(0.0, 0.0), Node::Surface(3.0));
        assert_eq!(node(4.0, 4.0), Node::Surface(0.0));
        assert_eq!(node(2.0, 0.0), Node::Wall(3.0));
        assert_eq!(node(2.5, 0.0), Node::Wall(0.0));
        // The part measures 10 x 10 mm; its outermost nodes are less than a step inside.
        let size = field.extents().size();
        assert!(size.min() > 9.0 - 1e-9 && size.max() < 10.0 + 1e-9, "{size}");
        assert!(!field.is_surface(ViewPoint::new(2.2, 0.0)) && field.is_surface(ViewPoint::new(3.2, 0.0)));
    }

    #[test]
    fn an_underside_does_not_bulge_through_a_thin_wall() {
        // The underside of a plate of 0.2 mm has the normals of an arch of 10 mm.
        let angle = 0.2f64;
        let sagitta = 5.0 * (angle / 2.0).tan();
        let square = |z: f64| [[-5.0, -5.0, z], [5.0, -5.0, z], [5.0, 5.0, z], [-5.0, 5.0, z]];
        let arch = |at: Point3<f64>| Vector3::new(-angle.sin() * at.x.signum(), 0.0, -angle.cos());
        let below = square(-0.2).map(Point3::from);
        let underside = (below.to_vec(), below.map(arch).to_vec(), vec![[0, 2, 1], [0, 3, 2]]);
        let mut plate = underside.clone();
        plate.0.extend(square(0.0).map(Point3::from));
        plate.1.extend([Vector3::z(); 4]);
        plate.2.extend([[4, 5, 6], [4, 6, 7]]);
        for ((positions, normals, triangles), expected) in [(underside, sagitta - 0.2), (plate, 0.0)] {
            let part = TriMesh::new(positions, normals, triangles).unwrap();
            let field = FacingPart::new(&part, &View::top()).sampled(0.5);
            let highest = field.surface_nodes().map(|(_, _, height)| height).fold(f64::MIN, f64::max);
            assert!((highest - expected).abs() < 1e-3, "{highest} mm for {expected} mm");
        }
    }

    #[test]
    fn a_view_from_below_samples_the_other_side() {
        let below = View::new(Facing::towards(-Vector3::z()).unwrap(), 0.0);
        let field = FacingPart::new(&two_floors(), &below).sampled(1.0);
        assert!(field.surface_nodes().all(|(_, _, height)| height.abs() < 1e-12));
        assert_eq!(field.surface_nodes().count(), 121);
        for half in [0.4, 3.0, 1e9] {
            let within = Extents { min: Vector2::new(-half, -0.7), max: Vector2::new(1.9, half) };
            let is_within = |&(column, row, _): &(usize, usize, f64)| {
                within.contains(field.position(column, row).coords())
            };
            let found: Vec<_> = field.surface_nodes_about(&within).filter(is_within).collect();
            assert_eq!(found, field.surface_nodes().filter(is_within).collect::<Vec<_>>());
        }
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
        let field = FacingPart::new(&ring, &View::top()).sampled(0.5);
        assert!(!field.is_surface(ViewPoint::new(0.1, 0.1)) && field.is_surface(ViewPoint::new(2.1, 2.1)));
    }
}
