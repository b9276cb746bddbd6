//! Decides whether a file's normals describe the surface or are only for shading.
//!
//! CAD programs write the normals of the modelled surface. Modelling programs with smooth shading write averages of
//! the facets round a vertex, so that an edge looks round in a picture. Beside a narrow bevel, such a normal leans
//! away from a large flat side by half the bevel's angle; a surface with these normals would bulge like a cushion.

use nalgebra::{Point3, Vector3};

use super::adjacency::{NONE, facet_normal, least_width, sliver_side, weld};
use super::chord_normals::{self, Chord};
use super::flats::{self, PlaneOf};
use super::mesh::TriMesh;
use super::polygons::{self, Outline};
use super::rounding;
use super::smooth_mesh::{CREASE_ANGLE, MOST_BEND, SmoothMesh};
use crate::geometry::space::View;

/// Maximum number of vertices examined; larger meshes are sampled evenly.
const SAMPLE: usize = 5_000;
/// Maximum number of vertices that vote, in meshes of more than [`SMALL`] triangles.
const MAX_VOTES: usize = 500;
/// Smallest bulge, mm, at which a wrong normal matters.
const MIN_BULGE: f64 = 0.002;
/// A normal equals an average when the angle between them is at most this, rad: files round normals to three or four
/// digits.
const SAME: f64 = 0.25 * std::f64::consts::PI / 180.0;
/// The same limit where only the rounding of the file may separate the two. Exact normals of arcs that are
/// not cut evenly differ by more.
const WRITTEN: f64 = 0.05 * std::f64::consts::PI / 180.0;
/// Rounding tilts a facet by at most this many times its standard deviation divided by the width of the
/// facet, rad.
const BY_CHANCE: f64 = 3.0;
/// Facets at a vertex whose normals differ by at most this, rad, are treated as one plane.
const COPLANAR: f64 = std::f64::consts::PI / 180.0;
/// In meshes of at most this many triangles, coplanar triangles are grouped into faces; in larger meshes every
/// triangle is a separate face.
const SMALL: usize = 6_000;
/// Two directions are distinguished when their angle is at least this share of the facets' bend at the vertex:
/// estimates on coarse meshes are wrong by a few per cent of it.
const MIN_SHARE_OF_BEND: f64 = 0.2;
/// The smallest distinguished angle, rad, where the estimate is the normal of one of the facets, as beside a flat side.
const MIN_ANGLE_TO_FACE: f64 = 0.05 * std::f64::consts::PI / 180.0;
/// The same share as [`MIN_SHARE_OF_BEND`] where the estimate is at right angles to a side that the file's
/// normal would make bulge: such estimates are better. See [`RIGHT_ANGLE`] and [`NOTABLE_BULGE`].
const MIN_SHARE_BESIDE_SIDE: f64 = 0.005;
/// An estimate is at right angles to a side if their angle differs from a right angle by less than this, as a
/// sine.
const RIGHT_ANGLE: f64 = 1e-3;
/// The file's normal makes a side bulge notably if it does so by more than this, mm.
const NOTABLE_BULGE: f64 = 0.02;
/// A vertex votes for one of two directions when the file's normal is within this share of their angle from it.
const VOTE_SHARE: f64 = 0.25;
/// The share of the angle between two directions by which they must fit the sides of the facets better or worse.
const LEAN_SHARE: f64 = VOTE_SHARE * std::f64::consts::FRAC_1_SQRT_2;
/// The share of the normals between bent facets that must be averages before the estimate is computed at all.
const MIN_SHARE_OF_AVERAGES: f64 = 0.5;

/// A normal only shades if it leans from a side by more than this, as a sine, and the side would bulge alone
/// ([`BULGES_ALONE`]). CAD programs cut arcs into facets that turn by at most 0.5 rad; this is half of that.
const STEEP_LEAN: f64 = 0.25;
/// A side bulges alone if it would bulge more than this many times as far as all others at its vertex. CAD
/// programs cut arcs into facets that are all about as far from the part.
const BULGES_ALONE: f64 = 3.0;
/// All normals are averages, except for a few, if at least this share of them is.
const ALL_AVERAGES: f64 = 0.95;
/// Sides nearer to the direction of a side than this, as a cosine, would bulge as far.
const ALONGSIDE: f64 = 0.5;

/// A normal whose angle to its facet has a smaller cosine than this (66°) is unrelated to it. The averages at the corners of a cube
/// lean by 55°.
const UNRELATED: f64 = 0.4;
/// Facets whose angle to the laser has a smaller cosine than this (78°) are skipped.
const GRAZED: f64 = 0.2;
/// If more than this share of the visible area has unrelated normals, none of the normals is used.
pub const WILD: f64 = 0.3;
/// A mesh with fewer triangles is not a part.
const LEAST_WILD: usize = 12;

/// The part's normals that are unrelated to its facets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WildNormals {
    /// Share of the visible area.
    pub share: f64,
    /// The first place, mm.
    pub at: Point3<f64>,
}

/// Whether the side of a mesh that faces a direction has normals that are unrelated to its facets; `None` if most of them
/// fit. The orientation of the triangles must follow the normals.
pub fn wild_normals(mesh: &TriMesh, facing: &Vector3<f64>) -> Option<WildNormals> {
    if mesh.normals().is_empty() || mesh.triangles().len() < LEAST_WILD {
        return None;
    }
    let (mut area, mut unrelated, mut first) = (0.0, 0.0, None);
    for &triangle in mesh.triangles() {
        let [a, b, c] = mesh.corners(triangle);
        let across = (b - a).cross(&(c - a));
        let size = across.norm();
        if across.dot(facing) < GRAZED * size {
            continue;
        }
        for vertex in triangle {
            let normal = mesh.normals()[vertex as usize];
            area += size;
            if normal != Vector3::zeros() && normal.dot(&across) < UNRELATED * size {
                unrelated += size;
                first.get_or_insert(mesh.positions()[vertex as usize]);
            }
        }
    }
    let share = unrelated / area;
    first.filter(|_| share > WILD).map(|at| WildNormals { share, at })
}

/// A facet, seen from one of its corners.
struct Facet {
    corner: usize,
    normal: Vector3<f64>,
    /// The corner's angle, rad.
    angle: f64,
    /// mm².
    area: f64,
    /// Of all facets in its plane, mm².
    plane_area: f64,
    /// Whether the facets in its plane can be one polygon of the model.
    is_of_polygon: bool,
    /// The longer of the sides that meet at the corner, mm.
    reach: f64,
    /// mm.
    least_width: f64,
    /// The polygon that it may have been cut from.
    outline: Outline,
}

/// What the normals of a file are.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Judgement {
    /// Whether they are only averages of the facets, for shading.
    pub only_shades: bool,
    /// Number of normals between bent facets that are averages of these.
    pub averages: usize,
    /// Number of normals between bent facets that were looked at.
    pub of: usize,
}

/// Whether the normals of the file are only averages of its facets, for shading. `false` for a mesh without normals.
pub fn only_shade(mesh: &TriMesh) -> bool {
    judged(mesh, false).only_shades
}

/// Judges the normals of a file. In a mesh without normals, nothing is found.
///
/// A vertex votes where two directions differ: the average of the facets that share its normal, and the
/// normal that [`SmoothMesh`] estimates for a smooth surface with edges. It votes for the direction that is
/// close to the file's normal. On an arc that is cut evenly, averages are the normals of the surface. Near
/// the end of an arc, the estimate may therefore be wrong, and the vertex votes for a surface. A vertex at
/// the border of a curved face whose normal leaves the facets there votes for a surface, too. If nearly all
/// normals are averages to the last digit and none contradicts them, no vertex votes, because such normals
/// show only what the facets show: the averages round a flat top with a bevel are the normals of a sphere. A
/// program that `knows_faces` writes no averages; its arcs are cut evenly where its normals are the same.
pub fn judged(mesh: &TriMesh, knows_faces: bool) -> Judgement {
    if mesh.normals().is_empty() {
        return Judgement::default();
    }
    let estimate = |part: TriMesh| SmoothMesh::new(&part.with_shading_normals(), &View::top());
    let whole = (mesh.triangles().len() <= SMALL).then(|| estimate(mesh.clone()));
    let planes = whole.as_ref().map(flats::planes_of);
    let places = Places::sampled(mesh, planes.as_deref());
    let mut averages: Vec<Averages> =
        places.facets.iter().flat_map(|facets| Averages::at(mesh, facets)).collect();
    let matches = |averages: &[Averages], weighting: usize| {
        averages.iter().filter(|there| is_within(there.file, there.averages[weighting], SAME)).count()
    };
    let Some((averaged, weighting)) = (0..WEIGHTINGS)
        .map(|weighting| (matches(&averages, weighting), weighting))
        .max_by_key(|(count, _)| *count)
    else {
        return Judgement::default();
    };
    let all = averages.len();
    let judgement = |only_shades: bool| Judgement { only_shades, averages: averaged, of: all };
    if averages.is_empty() || (averaged as f64) < MIN_SHARE_OF_AVERAGES * all as f64 {
        return judgement(false);
    }
    let leaving: usize = places.facets.iter().map(|facets| count_leaving(mesh, facets)).sum();
    let are_nearly_all = |count: usize| count as f64 > ALL_AVERAGES * all as f64;
    let steep = averages.iter().filter(|there| there.bend > MOST_BEND).count();
    if are_nearly_all(averaged) && 2 * steep > all {
        return judgement(true);
    }
    // Programs weight the corners of polygons in ways that triangles do not always show.
    let off = |there: &Averages| {
        there.averages.iter().map(|average| angle(there.file, *average)).fold(f64::INFINITY, f64::min)
    };
    let by_chance = BY_CHANCE * rounding::deviation(mesh.positions());
    let is_written = |there: &Averages| off(there) <= (by_chance / there.narrowest).clamp(WRITTEN, SAME);
    let written = averages.iter().filter(|there| is_written(there)).count();
    let contradicts = |there: &Averages| off(there) > SAME;
    if !knows_faces && leaving == 0 && are_nearly_all(written) && !averages.iter().any(contradicts) {
        return Judgement { only_shades: true, averages: averaged.max(written), of: all };
    }
    let estimate = match whole {
        Some(smooth) => Estimate { smooth, part: None },
        None => {
            let every = averages.len().div_ceil(MAX_VOTES).max(1);
            averages = averages.into_iter().step_by(every).collect();
            let near = averages.iter().map(|there| there.corner / 3);
            let Some((part, triangles)) = neighbourhood(mesh, near) else {
                return judgement(false);
            };
            Estimate { smooth: estimate(part), part: Some(triangles) }
        }
    };
    let mut shading = 0usize;
    let mut surface = leaving;
    for there in &averages {
        let Some(estimated) = estimate.normal(there.corner) else { continue };
        let average = there.averages[weighting];
        let apart = angle(average, estimated);
        let least = if there.is_normal_of_a_face(estimated) {
            MIN_ANGLE_TO_FACE
        } else if there.holds_a_side(mesh, estimated) {
            MIN_ANGLE_TO_FACE.max(there.bend * MIN_SHARE_BESIDE_SIDE)
        } else {
            SAME.max(there.bend * MIN_SHARE_OF_BEND)
        };
        if apart < least {
            continue;
        }
        if angle(there.file, average) < apart * VOTE_SHARE {
            // In the root mean square over all directions, two normals lean differently by this share of their angle.
            let limit = apart * LEAN_SHARE;
            let [of_file, of_estimate] = chords_of_both(mesh, there, &estimate);
            let is_smoother =
                || chord_normals::unevenness(&of_estimate) > chord_normals::unevenness(&of_file) + limit;
            let is_smooth = are_of_smooth_curves(&of_file);
            // Between facets as narrow as those of a small chamfer or fillet, the estimate may take each turn round the part for
            // an edge; as normals of flat facets, its normals lean evenly then, too.
            let splits = there.shared.iter().any(|&corner| {
                estimate.normal(corner).is_some_and(|normal| !is_within(normal, estimated, SAME))
            });
            if splits && is_smooth && of_file.iter().all(|chord| chord.turn() < MOST_BEND) {
                continue;
            }
            if is_smooth && is_smoother() && !bulges_alone(mesh, there) {
                surface += 1;
            } else {
                shading += 1;
            }
        } else if angle(there.file, estimated) < apart * VOTE_SHARE {
            surface += 1;
        }
    }
    // Where as many speak for either, averages everywhere are no accident.
    judgement(shading > surface || (are_nearly_all(averaged) && shading > 0 && shading == surface))
}

/// The normals that [`SmoothMesh`] estimates for a mesh.
struct Estimate {
    smooth: SmoothMesh,
    /// The triangles of the mesh that it has, in ascending order; all if not given.
    part: Option<Vec<usize>>,
}

impl Estimate {
    /// The normals of a triangle of the mesh, if they were estimated.
    fn normals(&self, triangle: usize) -> Option<[Vector3<f64>; 3]> {
        let own = self.part.as_ref().map_or(Some(triangle), |part| part.binary_search(&triangle).ok());
        own.map(|own| self.smooth.corners(own).1)
    }

    /// The normal at a corner, 3·triangle + 0, 1 or 2.
    fn normal(&self, corner: usize) -> Option<Vector3<f64>> {
        self.normals(corner / 3).map(|normals| normals[corner % 3])
    }
}

/// Whether normals lean from chords as on a smooth surface.
fn are_of_smooth_curves(chords: &[Chord]) -> bool {
    chord_normals::are_of_smooth_curves(chords.iter().map(|chord| (*chord, 1.0)))
}

/// The sides that meet at a vertex with the normals of the file, and with the estimated ones.
fn chords_of_both(mesh: &TriMesh, there: &Averages, estimate: &Estimate) -> [Vec<Chord>; 2] {
    let of_file = chords_at(mesh, &there.shared, |corner| {
        Some(mesh.triangles()[corner / 3].map(|index| mesh.normals()[index as usize]))
    });
    [of_file, chords_at(mesh, &there.shared, |corner| estimate.normals(corner / 3))]
}

/// The sides that meet at a vertex, which is a corner of several facets, each for each of its facets. `normals` returns those of
/// the facet of a corner.
fn chords_at(
    mesh: &TriMesh,
    corners: &[usize],
    normals: impl Fn(usize) -> Option<[Vector3<f64>; 3]>,
) -> Vec<Chord> {
    let of_facet = |&corner: &usize| {
        let (points, here) = (mesh.corners(mesh.triangles()[corner / 3]), corner % 3);
        normals(corner).into_iter().flat_map(move |normals| {
            [1, 2].map(|turn| [here, (here + turn) % 3]).map(|ends| Chord {
                ends: ends.map(|end| points[end]),
                normals: ends.map(|end| normals[end]),
            })
        })
    };
    corners.iter().flat_map(of_facet).collect()
}

/// The sides of facets that start at these corners of theirs, mm.
fn sides_at<'a>(mesh: &'a TriMesh, corners: &'a [usize]) -> impl Iterator<Item = Vector3<f64>> + 'a {
    corners.iter().flat_map(|&corner| {
        let (points, here) = (mesh.corners(mesh.triangles()[corner / 3]), corner % 3);
        [1, 2].map(|turn| points[(here + turn) % 3] - points[here])
    })
}

/// Whether the normal of the file would make a side at its vertex bulge as no tessellation of a part does.
fn bulges_alone(mesh: &TriMesh, there: &Averages) -> bool {
    let sides = || sides_at(mesh, &there.shared);
    let off = |side: &Vector3<f64>| there.file.dot(side).abs();
    let Some(farthest) = sides().max_by(|one, other| off(one).total_cmp(&off(other))) else { return false };
    let aside = |other: &Vector3<f64>| other.dot(&farthest) <= ALONGSIDE * other.norm() * farthest.norm();
    let others = sides().filter(aside).map(|other| off(&other)).fold(0.0, f64::max);
    off(&farthest) > STEEP_LEAN * farthest.norm() && off(&farthest) > BULGES_ALONE * others
}

/// Number of ways in which modelling programs weight the facets round a vertex.
const WEIGHTINGS: usize = 14;

/// The triangles within three vertices of the given ones, on which their estimates depend: as a mesh, and their
/// indices in ascending order.
fn neighbourhood(mesh: &TriMesh, triangles: impl Iterator<Item = usize>) -> Option<(TriMesh, Vec<usize>)> {
    let places = weld(mesh.positions());
    let mut chosen = vec![false; mesh.triangles().len()];
    triangles.for_each(|triangle| chosen[triangle] = true);
    for _ in 0..3 {
        let mut is_near = vec![false; places.len()];
        for (corners, _) in mesh.triangles().iter().zip(&chosen).filter(|(_, chosen)| **chosen) {
            corners.iter().for_each(|&vertex| is_near[places[vertex as usize] as usize] = true);
        }
        for (corners, chosen) in mesh.triangles().iter().zip(&mut chosen) {
            *chosen |= corners.iter().any(|&vertex| is_near[places[vertex as usize] as usize]);
        }
    }
    let numbers: Vec<usize> = (0..chosen.len()).filter(|&triangle| chosen[triangle]).collect();
    let mut used: Vec<u32> = numbers.iter().flat_map(|&triangle| mesh.triangles()[triangle]).collect();
    used.sort_unstable();
    used.dedup();
    let renamed = |vertex: u32| used.binary_search(&vertex).map_or(0, |index| index as u32);
    let positions = used.iter().map(|&vertex| mesh.positions()[vertex as usize]).collect();
    let normals = used.iter().map(|&vertex| mesh.normals()[vertex as usize]).collect();
    let triangles = numbers.iter().map(|&triangle| mesh.triangles()[triangle].map(renamed)).collect();
    Some((TriMesh::new(positions, normals, triangles).ok()?, numbers))
}

/// The different normals at a place, each with the facets that share it.
fn normals_at<'a>(mesh: &TriMesh, facets: &'a [Facet]) -> Vec<(Vector3<f64>, Vec<&'a Facet>)> {
    let normal =
        |facet: &Facet| mesh.normals()[mesh.triangles()[facet.corner / 3][facet.corner % 3] as usize];
    let mut found: Vec<(Vector3<f64>, Vec<&Facet>)> = Vec::new();
    for facet in facets {
        let file = normal(facet);
        if file != Vector3::zeros() && !found.iter().any(|(other, _)| is_within(*other, file, SAME)) {
            let shared = facets.iter().filter(|other| is_within(normal(other), file, SAME));
            found.push((file, shared.collect()));
        }
    }
    found
}

/// Number of normals at a place that are further from all facets that share them than these are from one another, as at the end
/// of a curved face: no average of these facets is.
fn count_leaving(mesh: &TriMesh, facets: &[Facet]) -> usize {
    let leaves = |(file, shared): &(Vector3<f64>, Vec<&Facet>)| {
        let [first, others @ ..] = shared.as_slice() else { return false };
        let spread = others.iter().map(|facet| angle(facet.normal, first.normal)).fold(0.0, f64::max);
        let off = shared.iter().map(|facet| angle(facet.normal, *file)).fold(f64::INFINITY, f64::min);
        let reach = shared.iter().map(|facet| facet.reach).fold(0.0, f64::max);
        off > COPLANAR.max(2.0 * spread) && off * reach / 4.0 > MIN_BULGE
    };
    normals_at(mesh, facets).iter().filter(|there| leaves(there)).count()
}

/// A normal of the file, and the averages that it could be.
struct Averages {
    /// A corner that has the normal: 3·triangle + 0, 1 or 2.
    corner: usize,
    /// All corners that have it.
    shared: Vec<usize>,
    file: Vector3<f64>,
    /// The largest angle between two of the facets, rad.
    bend: f64,
    /// The width of the narrowest facet, mm.
    narrowest: f64,
    /// One for each way of weighting.
    averages: [Vector3<f64>; WEIGHTINGS],
    /// The normals of the facets.
    faces: Vec<Vector3<f64>>,
}

impl Averages {
    /// For each different normal at a place, if the facets that share it are not coplanar.
    fn at(mesh: &TriMesh, facets: &[Facet]) -> Vec<Self> {
        let mut found: Vec<Self> = Vec::new();
        for (file, shared) in normals_at(mesh, facets) {
            let polygons = Polygon::of(&shared, |_| true);
            // A cap that is a fan round its middle is not one polygon.
            let pieces = Polygon::of(&shared, |facet| facet.is_of_polygon);
            let bends = polygons
                .iter()
                .flat_map(|one| polygons.iter().map(move |other| angle(one.normal, other.normal)));
            let bend = bends.fold(0.0, f64::max);
            let reach = shared.iter().map(|facet| facet.reach).fold(0.0, f64::max);
            if bend * reach / 8.0 < MIN_BULGE {
                continue;
            }
            let sum = |weight: &dyn Fn(&Facet) -> f64| {
                direction(shared.iter().map(|facet| facet.normal * weight(facet)).sum())
            };
            let over = |polygons: &[Polygon], weight: &dyn Fn(&Polygon) -> f64| {
                direction(polygons.iter().map(|polygon| polygon.normal * weight(polygon)).sum())
            };
            let mut outlines: Vec<&Outline> = shared.iter().map(|facet| &facet.outline).collect();
            outlines.sort_by_key(|outline| outline.number);
            outlines.dedup_by_key(|outline| outline.number);
            let of_outlines = |weight: &dyn Fn(&Outline) -> f64| {
                direction(outlines.iter().map(|outline| direction(outline.across) * weight(outline)).sum())
            };
            let averages = [
                of_outlines(&|outline| outline.angle),
                of_outlines(&|outline| outline.across.norm()),
                of_outlines(&|_| 1.0),
                of_outlines(&|outline| outline.across.norm() * outline.angle),
                sum(&|facet| facet.angle),
                sum(&|facet| facet.area),
                sum(&|_| 1.0),
                sum(&|facet| facet.area * facet.angle),
                over(&polygons, &|_| 1.0),
                over(&polygons, &|polygon| polygon.area),
                over(&polygons, &|polygon| polygon.area * polygon.angle),
                over(&pieces, &|_| 1.0),
                over(&pieces, &|polygon| polygon.area),
                over(&pieces, &|polygon| polygon.area * polygon.angle),
            ];
            let corner = shared[0].corner;
            let narrowest = shared.iter().map(|facet| facet.least_width).fold(f64::INFINITY, f64::min);
            let faces = polygons.iter().map(|polygon| polygon.normal).collect();
            let shared = shared.iter().map(|facet| facet.corner).collect();
            found.push(Self { corner, shared, file, bend, narrowest, averages, faces });
        }
        found
    }

    /// Whether a normal is at right angles to a side that the file's normal bends.
    fn holds_a_side(&self, mesh: &TriMesh, normal: Vector3<f64>) -> bool {
        sides_at(mesh, &self.shared).any(|side| {
            normal.dot(&side).abs() < RIGHT_ANGLE * side.norm()
                && self.file.dot(&side).abs() / 4.0 > NOTABLE_BULGE
        })
    }

    /// Whether a normal is that of one of the facets.
    fn is_normal_of_a_face(&self, normal: Vector3<f64>) -> bool {
        self.faces.iter().any(|face| is_within(*face, normal, MIN_ANGLE_TO_FACE / 2.0))
    }
}

/// Facets at a vertex that are in one plane: a face of the model that was divided into triangles on export.
struct Polygon {
    normal: Vector3<f64>,
    /// Of the whole face, mm², if that is known.
    area: f64,
    angle: f64,
    is_divided: bool,
}

impl Polygon {
    /// The facets, those in one plane together if they can be divided ones of one polygon.
    fn of(facets: &[&Facet], is_divided: impl Fn(&Facet) -> bool) -> Vec<Self> {
        let mut polygons: Vec<Self> = Vec::new();
        for facet in facets {
            let (normal, angle) = (facet.normal, facet.angle);
            let is_divided = is_divided(facet);
            let same = polygons.iter_mut().find(|polygon| {
                is_divided && polygon.is_divided && is_within(polygon.normal, normal, COPLANAR)
            });
            match same {
                Some(polygon) => polygon.angle += angle,
                None => {
                    let area = if is_divided { facet.plane_area } else { facet.area };
                    polygons.push(Self { normal, area, angle, is_divided });
                }
            }
        }
        polygons
    }
}

/// Facets round the sampled places of a mesh.
struct Places {
    facets: Vec<Vec<Facet>>,
}

impl Places {
    fn sampled(mesh: &TriMesh, planes: Option<&[PlaneOf]>) -> Self {
        let welded = weld(mesh.positions());
        let stride = welded.len().div_ceil(SAMPLE).max(1);
        let mut of_place = vec![NONE; welded.len()];
        let mut count = 0;
        for &place in welded.iter().step_by(stride) {
            let sampled = &mut of_place[place as usize];
            if *sampled == NONE {
                *sampled = count;
                count += 1;
            }
        }
        let mut facets: Vec<Vec<Facet>> = (0..count).map(|_| Vec::new()).collect();
        // A sliver has no normal of its own, and the average that its corners share has that of the polygon it was cut from: such
        // places show nothing.
        let mut has_sliver = vec![false; facets.len()];
        let places_of = |corners: &[u32; 3]| corners.map(|vertex| welded[vertex as usize]);
        let places: Vec<[u32; 3]> = mesh.triangles().iter().map(places_of).collect();
        // A quadrangle that is bent by more would have an edge; a fan is no polygon.
        let normal = |triangle: usize| facet_normal(mesh.corners(mesh.triangles()[triangle]));
        let halves = polygons::halves(&places, |both| {
            both.iter().all(|&triangle| planes.is_none_or(|planes| !planes[triangle].is_fan))
                && normal(both[0]).dot(&normal(both[1])) >= CREASE_ANGLE.cos()
        });
        let whole = |triangle: usize| (triangle, places[triangle], mesh.corners(mesh.triangles()[triangle]));
        for (triangle, &corners) in mesh.triangles().iter().enumerate() {
            let points = mesh.corners(corners);
            let is_sliver = sliver_side(points).is_some();
            for corner in 0..3 {
                let place = of_place[welded[corners[corner] as usize] as usize];
                if place == NONE {
                    continue;
                }
                if is_sliver {
                    has_sliver[place as usize] = true;
                    continue;
                }
                let [here, one, two] = [0, 1, 2].map(|turn| points[(corner + turn) % 3]);
                let (first, second) = (one - here, two - here);
                let across = first.cross(&second);
                let Some(normal) = across.try_normalize(0.0) else { continue };
                let area = across.norm() / 2.0;
                facets[place as usize].push(Facet {
                    corner: triangle * 3 + corner,
                    normal,
                    angle: first.angle(&second),
                    area,
                    plane_area: planes.map_or(area, |planes| planes[triangle].area),
                    is_of_polygon: planes.is_none_or(|planes| planes[triangle].is_polygon),
                    reach: first.norm().max(second.norm()),
                    least_width: least_width(points),
                    outline: polygons::outline(
                        whole(triangle),
                        (halves[triangle] != NONE).then(|| whole(halves[triangle] as usize)),
                        corner,
                    ),
                });
            }
        }
        for (facets, _) in facets.iter_mut().zip(has_sliver).filter(|(_, has_sliver)| *has_sliver) {
            facets.clear();
        }
        Self { facets }
    }
}

fn direction(sum: Vector3<f64>) -> Vector3<f64> {
    sum.try_normalize(0.0).unwrap_or(sum)
}

fn angle(a: Vector3<f64>, b: Vector3<f64>) -> f64 {
    a.cross(&b).norm().atan2(a.dot(&b))
}

fn is_within(a: Vector3<f64>, b: Vector3<f64>, limit: f64) -> bool {
    angle(a, b) <= limit
}
