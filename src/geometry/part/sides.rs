//! The sides of a part: how much of each a laser can mark, and where a drawing fits.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector2, Vector3};

use super::adjacency::turn_in_view;
use super::mesh::TriMesh;
use crate::geometry::fork::{Fork, in_pieces};
use crate::geometry::space::{Extents, Facing, MarkingFrame, View};

/// The sides along the axes of the part, in the order in which they are listed.
pub const SIDES: [(&str, Vector3<f64>); 6] = [
    ("+z", Vector3::new(0.0, 0.0, 1.0)),
    ("-z", Vector3::new(0.0, 0.0, -1.0)),
    ("+x", Vector3::new(1.0, 0.0, 0.0)),
    ("-x", Vector3::new(-1.0, 0.0, 0.0)),
    ("+y", Vector3::new(0.0, 1.0, 0.0)),
    ("-y", Vector3::new(0.0, -1.0, 0.0)),
];

/// The longer side of the view has at least this many cells.
const CELLS: f64 = 160.0;
/// The shorter side of the view has at least this many cells, unless the longer side would have more than
/// [`MAX_CELLS`].
const CELLS_ACROSS: f64 = 40.0;
/// The longer side of the view has at most this many cells.
const MAX_CELLS: f64 = 1600.0;
/// Neighbouring cells whose normals differ by more than this are at an edge of the part, rad. On a round bar with
/// [`CELLS_ACROSS`], they differ by less than a quarter of this.
const EDGE: f64 = 25.0 * std::f64::consts::PI / 180.0;
/// Number of cells between the fitted surface and the end of what can be marked: a fitted surface is not kept
/// up to the last edge of the part.
const MARGIN: f64 = 2.0;
/// A side is flat if this share of what can be marked has one direction, to within [`ONE_DIRECTION`].
const FLAT: f64 = 0.5;
/// Normals within this angle are of one direction, rad.
const ONE_DIRECTION: f64 = 2.0 * std::f64::consts::PI / 180.0;
/// A step between neighbouring cells is a cliff if it is steeper than this, rad.
const CLIFF: f64 = 75.0 * std::f64::consts::PI / 180.0;
/// A side with at least this share of the largest area is as likely to be meant.
const EQUAL: f64 = 0.9;
/// A curved side is meant if it has at least this share of the largest area.
const WORTH: f64 = 0.5;

/// A marking frame is on the surface if it is at most this far from it, mm.
pub const ON_SURFACE: f64 = 0.5;

/// How thick the part is behind the origin of a frame on its surface whose z axis points into it, mm. `None`
/// for a frame that points out of the part, or whose origin is not on the surface.
///
/// A line from inside a closed surface crosses it an odd number of times, whichever way its triangles run.
/// The line along z may meet an edge between triangles, which would be two crossings or none. So the median
/// of three lines decides.
pub fn thickness_behind(frame: &MarkingFrame, mesh: &TriMesh) -> Option<f64> {
    let view = View::new(frame.facing(), frame.roll());
    let origin = view.point(frame.origin());
    let beside = 1e-5 * mesh.size().norm();
    let lines =
        [[0.61, 0.79], [-0.98, 0.17], [0.34, -0.94]].map(|at| origin.xy() + beside * Vector2::from(at));
    let mut crossings: [Vec<f64>; 3] = std::array::from_fn(|_| Vec::new());
    for &triangle in mesh.triangles() {
        let corners = mesh.corners(triangle).map(|corner| view.point(corner));
        for (line, heights) in lines.iter().zip(&mut crossings) {
            heights.extend(
                shares_at(&line.coords, &corners).map(|shares| height_of(shares, &corners) - origin.z),
            );
        }
    }
    let mut behind = crossings.map(|heights| {
        let is_on_surface = heights.iter().any(|height| height.abs() <= ON_SURFACE);
        let above: Vec<f64> = heights.into_iter().filter(|height| *height > ON_SURFACE).collect();
        let next = above.iter().copied().fold(f64::INFINITY, f64::min);
        if is_on_surface && above.len() % 2 == 1 { next } else { f64::INFINITY }
    });
    behind.sort_unstable_by(f64::total_cmp);
    Some(behind[1]).filter(|thickness| thickness.is_finite())
}

/// The shares of the corners in a place of the view that a triangle covers; `None` beside the triangle and for one that stands
/// upright.
fn shares_at(at: &Vector2<f64>, triangle: &[Point3<f64>; 3]) -> Option<[f64; 3]> {
    let [a, b, c] = triangle.map(|corner| corner.coords.xy());
    let across = |u: Vector2<f64>, v: Vector2<f64>| u.x * v.y - u.y * v.x;
    let whole = across(b - a, c - a);
    let shares =
        [across(b - at, c - at), across(c - at, a - at), across(a - at, b - at)].map(|share| share / whole);
    // A triangle without area gives shares that are not numbers.
    (whole != 0.0 && shares.iter().all(|share| *share >= -1e-9)).then_some(shares)
}

fn height_of(shares: [f64; 3], triangle: &[Point3<f64>; 3]) -> f64 {
    shares.iter().zip(triangle).map(|(share, corner)| share * corner.z).sum()
}

/// A side of a part, as the laser sees it.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Side {
    /// The bounding rectangle of the part in the view, mm.
    pub extents: Extents,
    /// Area of the surface that the laser sees below the limit of its incidence, mm².
    pub area: f64,
    /// Whether this surface is curved; false for one plane with small fillets.
    pub is_curved: bool,
    /// The largest rectangle along the axes of the view that has such a surface without holes, steps and edges in all of it
    /// and a little beyond, mm.
    pub rectangle: Option<Extents>,
    /// The heights that were compared.
    pub heights: SideHeights,
}

/// The heights of a side over a grid of its view.
#[derive(Debug, Clone, PartialEq)]
pub struct SideHeights {
    /// The middle of the first cell, lower left, mm.
    pub origin: Vector2<f64>,
    /// Side of a cell, mm.
    pub step: f64,
    /// Cells along x.
    pub columns: usize,
    /// Cells along y.
    pub rows: usize,
    /// Height of each cell towards the laser, mm, row by row; `None` beside the part.
    pub heights: Vec<Option<f64>>,
}

/// What the laser meets first in a cell: height and unit normal, in the view.
type Hit = Option<(f64, Vector3<f64>)>;

impl Side {
    /// The part in this view; `limit` is the largest angle between beam and normal, rad, that can be marked. The normals are
    /// those of the mesh if it has any, otherwise those of its facets, whichever way round they run.
    pub fn seen(mesh: &TriMesh, view: &View, limit: f64) -> Self {
        let points: Vec<Point3<f64>> = mesh.positions().iter().map(|&at| view.point(at)).collect();
        let corners = || mesh.triangles().iter().map(|triangle| triangle.map(|index| points[index as usize]));
        let extents = Extents::of(corners().flatten().map(|corner| corner.coords.xy()));
        let (longer, shorter) = (extents.size().max(), extents.size().min());
        let step =
            (longer / CELLS).min(shorter / CELLS_ACROSS).max(longer / MAX_CELLS).max(f64::MIN_POSITIVE);
        let [columns, rows] =
            [extents.size().x, extents.size().y].map(|side| ((side / step).ceil() as usize).max(1));
        let shown = Vector2::new(columns as f64, rows as f64) * step;
        let origin = extents.center() - shown / 2.0 + Vector2::repeat(step / 2.0);
        let grid = SideHeights { origin, step, columns, rows, heights: Vec::new() };
        let mut hits: Vec<Hit> = vec![None; columns * rows];
        let has_normals = !mesh.normals().is_empty() && !mesh.normals_only_shade();
        // What faces the laser comes first: most of it hides what faces away.
        let faces = |upwards: bool| {
            let all = mesh.triangles().iter().zip(corners());
            all.filter(move |(_, corners)| (turn_in_view(*corners) > 0.0) == upwards)
        };
        for (triangle, corners) in faces(true).chain(faces(false)) {
            let normal_at =
                |index: u32| mesh.normals().get(index as usize).map(|normal| view.vector(*normal));
            let normals = || if has_normals { triangle.map(normal_at) } else { [None; 3] };
            grid.hit(&mut hits, &corners, normals);
        }
        let least = limit.cos();
        let upright = |hit: &Hit| hit.filter(|(_, normal)| normal.z >= least);
        let area = |normal: &Vector3<f64>| step * step / normal.z;
        let marked: Vec<Vector3<f64>> = hits.iter().filter_map(|hit| upright(hit).map(|hit| hit.1)).collect();
        let rectangle = largest_rectangle(columns, rows, |column, row| {
            upright(&hits[row * columns + column]).is_some() && !grid.is_at_edge(&hits, column, row)
        });
        let middle = |column: usize, row: usize| origin + Vector2::new(column as f64, row as f64) * step;
        Self {
            extents,
            area: marked.iter().map(area).fold(0.0, |sum, cell| sum + cell),
            is_curved: is_curved(&marked),
            rectangle: rectangle.and_then(|[left, bottom, right, top]| {
                let margin = Vector2::repeat(MARGIN * step);
                let inside = Extents { min: middle(left, bottom) + margin, max: middle(right, top) - margin };
                (inside.size().min() > 0.0).then_some(inside)
            }),
            heights: SideHeights { heights: hits.iter().map(|hit| hit.map(|hit| hit.0)).collect(), ..grid },
        }
    }

    /// The six sides of [`SIDES`]; `fork` may look at halves of them at once.
    pub fn all(mesh: &TriMesh, limit: f64, fork: &dyn Fork) -> Vec<Self> {
        let view = |direction| View::new(Facing::towards(direction).unwrap_or(Facing::TOP), 0.0);
        in_pieces(fork, 0..SIDES.len(), 1, &|sides| {
            SIDES[sides].iter().map(|(_, direction)| Self::seen(mesh, &view(*direction), limit)).collect()
        })
    }

    /// For each side, whether it is probably the one to be marked: those with the largest area, of the curved sides if one
    /// of them is large enough.
    pub fn meant(sides: &[Self]) -> Vec<bool> {
        let largest = |curved_only: bool| {
            let asked = sides.iter().filter(|side| side.is_curved || !curved_only);
            asked.map(|side| side.area).fold(0.0, f64::max)
        };
        let (of_all, of_curved) = (largest(false), largest(true));
        let curved_only = of_curved >= WORTH * of_all;
        let needed = EQUAL * if curved_only { of_curved } else { of_all };
        let is_meant =
            |side: &Self| side.area > 0.0 && side.area >= needed && (side.is_curved || !curved_only);
        sides.iter().map(is_meant).collect()
    }
}

impl SideHeights {
    /// Puts a triangle of the view, with the normals of its corners if they are known, into the cells whose middle it
    /// covers, where it is the highest.
    fn hit(
        &self,
        hits: &mut [Hit],
        triangle: &[Point3<f64>; 3],
        normals: impl Fn() -> [Option<Vector3<f64>>; 3],
    ) {
        let [a, b, c] = triangle.map(|corner| corner.coords.xy());
        let [low, high] = [a.inf(&b).inf(&c), a.sup(&b).sup(&c)].map(|at| (at - self.origin) / self.step);
        let along = |low: f64, high: f64, count: usize| {
            (low.ceil().max(0.0) as usize)..((high.floor() + 1.0).clamp(0.0, count as f64) as usize)
        };
        let (rows, columns) = (along(low.y, high.y, self.rows), along(low.x, high.x, self.columns));
        if rows.is_empty() || columns.is_empty() {
            return;
        }
        let [first, second, third] = triangle;
        let Some(normal) = (second - first).cross(&(third - first)).try_normalize(0.0) else { return };
        let facet = if normal.z < 0.0 { -normal } else { normal };
        let top = first.z.max(second.z).max(third.z);
        let corner_normals = normals().map(|normal| normal.filter(|normal| *normal != Vector3::zeros()));
        for row in rows {
            for column in columns.clone() {
                let hit = &mut hits[row * self.columns + column];
                if hit.is_some_and(|(highest, _)| highest >= top) {
                    continue;
                }
                let at = self.origin + Vector2::new(column as f64, row as f64) * self.step;
                let Some(shares) = shares_at(&at, triangle) else { continue };
                let height = height_of(shares, triangle);
                if hit.is_none_or(|(highest, _)| height > highest) {
                    let between = match corner_normals {
                        [Some(a), Some(b), Some(c)] => {
                            (a * shares[0] + b * shares[1] + c * shares[2]).try_normalize(0.0)
                        }
                        _ => None,
                    };
                    // A normal that points away from the laser belongs to a triangle that runs the other way.
                    let towards =
                        between.map(|normal| if normal.dot(&facet) < 0.0 { -normal } else { normal });
                    *hit = Some((height, towards.unwrap_or(facet)));
                }
            }
        }
    }

    /// Whether the surface ends, steps or has an edge between a cell and one of its four neighbours.
    fn is_at_edge(&self, hits: &[Hit], column: usize, row: usize) -> bool {
        let at = |column: usize, row: usize| {
            let is_inside = column < self.columns && row < self.rows;
            is_inside.then(|| hits[row * self.columns + column])
        };
        let Some(Some((here, normal))) = at(column, row) else { return true };
        // With fewer cells, the normals of a round part differ as much.
        let shows_edges = self.columns.min(self.rows) as f64 >= CELLS_ACROSS;
        let around = [
            at(column.wrapping_sub(1), row),
            at(column + 1, row),
            at(column, row.wrapping_sub(1)),
            at(column, row + 1),
        ];
        around.into_iter().flatten().any(|beside| match beside {
            // Beside the rim of the part there is nothing to fall from.
            None => false,
            Some((beside, other)) => {
                let is_edge = shows_edges && normal.dot(&other) < EDGE.cos();
                is_edge || (beside - here).abs() > self.step * CLIFF.tan()
            }
        })
    }
}

/// Whether surface with these unit normals, one for each cell of the view, is curved.
fn is_curved(normals: &[Vector3<f64>]) -> bool {
    let key =
        |normal: &Vector3<f64>| [normal.x, normal.y].map(|share| (share / ONE_DIRECTION).round() as i64);
    let mut bins: BTreeMap<[i64; 2], Vector3<f64>> = BTreeMap::new();
    for normal in normals {
        *bins.entry(key(normal)).or_insert_with(Vector3::zeros) += normal / normal.z;
    }
    let heaviest = bins.values().max_by(|one, other| one.norm().total_cmp(&other.norm()));
    let Some(main) = heaviest.and_then(|sum| sum.try_normalize(0.0)) else { return false };
    let weight = |normals: &mut dyn Iterator<Item = &Vector3<f64>>| -> f64 {
        normals.map(|normal| 1.0 / normal.z).sum()
    };
    let alike = weight(&mut normals.iter().filter(|normal| normal.dot(&main) >= ONE_DIRECTION.cos()));
    alike < FLAT * weight(&mut normals.iter())
}

/// The largest rectangle of whole cells that are all good, as left, bottom, right and top cell; `None` if none is good.
///
/// For every row, the runs of good cells downwards form a histogram, whose largest rectangle is found with a stack, in time
/// proportional to the number of cells.
fn largest_rectangle(
    columns: usize,
    rows: usize,
    is_good: impl Fn(usize, usize) -> bool,
) -> Option<[usize; 4]> {
    let mut best: Option<(usize, [usize; 4])> = None;
    let mut depths = vec![0usize; columns + 1];
    for row in 0..rows {
        for (column, depth) in depths.iter_mut().take(columns).enumerate() {
            *depth = if is_good(column, row) { *depth + 1 } else { 0 };
        }
        // Each entry: the first column and the depth of a rectangle that is still open; the last depth of 0 closes all.
        let mut open: Vec<(usize, usize)> = Vec::new();
        for (column, &depth) in depths.iter().enumerate() {
            let mut start = column;
            while let Some(&(first, height)) = open.last().filter(|(_, height)| *height > depth) {
                open.pop();
                start = first;
                let size = height * (column - first);
                if best.is_none_or(|(largest, _)| size > largest) {
                    best = Some((size, [first, row + 1 - height, column - 1, row]));
                }
            }
            if depth > 0 && open.last().is_none_or(|(_, height)| *height < depth) {
                open.push((start, depth));
            }
        }
    }
    best.map(|(_, cells)| cells)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_rectangle_is_that_of_trying_all() {
        let mut state = 7u64;
        for _ in 0..200 {
            let (columns, rows) = (6, 5);
            let cells: Vec<bool> = (0..columns * rows)
                .map(|_| {
                    state =
                        state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    state >> 33 & 3 != 0
                })
                .collect();
            let is_good = |column: usize, row: usize| cells[row * columns + column];
            let mut largest = 0;
            for left in 0..columns {
                for right in left..columns {
                    for bottom in 0..rows {
                        for top in bottom..rows {
                            if (bottom..=top).all(|row| (left..=right).all(|column| is_good(column, row))) {
                                largest = largest.max((right - left + 1) * (top - bottom + 1));
                            }
                        }
                    }
                }
            }
            let found = largest_rectangle(columns, rows, is_good);
            let size = found.map_or(0, |[left, bottom, right, top]| {
                assert!((bottom..=top).all(|row| (left..=right).all(|column| is_good(column, row))));
                (right - left + 1) * (top - bottom + 1)
            });
            assert_eq!(size, largest, "{cells:?}");
        }
    }
}
