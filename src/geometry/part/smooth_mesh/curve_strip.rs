//! An extruded strip whose vertices are on one plane curve, with rows of vertices inside it.
//!
//! Some programs divide a face as a grid, and its rims at other places. They leave facets between the grid
//! and the rims that contain no ruling. Along the rulings, all vertices of such a strip are on one curve
//! nevertheless: the curve through the columns of the grid, through the vertices of the rims, or through
//! both, whichever shows the normals best. The facets between the grid and the rims have a vertex of a
//! column. They do not face the ends of the strip as the facets of a fillet do.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Point3, Vector3};

use super::SmoothMesh;
use super::ends::{Ruled, Surface};
use super::plane_curve::{LEAST_POINTS, OF_OFF, Place, Placed, PlaneCurve};
use crate::geometry::adjacency::{facet_normal, sliver_side};
use crate::geometry::disjoint_sets::DisjointSets;

/// The normals of facets on a strip leave the plane across its rulings by less than this, rad: those between rows that are cut
/// differently lean.
const LEAN: f64 = 0.2;
/// Points of vertices that do not face each other are one where they are nearer than this share of the mean chord.
const OF_MEAN_CHORD: f64 = 0.3;

/// A strip whose vertices are on one plane curve, with rows inside it.
pub(super) struct CurveStrip<'a> {
    mesh: &'a SmoothMesh,
    curve: PlaneCurve,
    /// In ascending order.
    triangles: Vec<usize>,
    places: BTreeMap<u32, Place>,
}

impl<'a> CurveStrip<'a> {
    /// The strip that continues some triangles, with sides along an axis (`is_ruling`), to rims whose
    /// vertices follow each other differently. `None` if nothing continues them so, or if they have no rows.
    /// At most `visits` triangles are looked at. Vertices may be off by `near`, mm.
    pub(super) fn of(
        mesh: &'a SmoothMesh,
        axis: Vector3<f64>,
        triangles: &[usize],
        is_ruling: impl Fn(usize) -> bool,
        near: f64,
        visits: &mut usize,
    ) -> Option<Self> {
        let rows = Rows::of(mesh, axis, triangles, is_ruling, near)?;
        let along = triangles.iter().flat_map(|&triangle| mesh.corners(triangle).0);
        let heights = along
            .map(|at| at.coords.dot(&axis))
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], along| [low.min(along), high.max(along)]);
        let of_columns = PlaneCurve::through(rows.points, axis, rows.is_closed);
        let columns: BTreeMap<u32, Place> = rows
            .columns
            .iter()
            .map(|(&vertex, &column)| {
                let normal = of_columns.normals[column];
                (vertex, Place { at: column as f64, off: 0.0, beyond: 0.0, normal })
            })
            .collect();
        // Where single columns reach farther than the others, they reach the rims.
        let is_rim = heights.map(|height| {
            let at = columns.keys().map(|&vertex| mesh.positions[vertex as usize].coords.dot(&axis));
            2 * at.filter(|at| (at - height).abs() <= near).count() < of_columns.points.len()
        });
        let is_within = |at: &Point3<f64>| {
            let at = at.coords.dot(&axis);
            (!is_rim[0] || at >= heights[0] - near) && (!is_rim[1] || at <= heights[1] + near)
        };
        let (found, places) = of_columns.continued(mesh, &rows.triangles, &columns, is_within, near, visits);
        let is_new = |triangle: &usize| triangles.binary_search(triangle).is_err();
        let facing_ends = facing_ends(mesh, found.iter().copied().filter(is_new), axis, heights);
        if found.len() <= triangles.len() || facing_ends > near * of_columns.length() {
            return None;
        }
        let flat = |vertex: u32| {
            let at = mesh.positions[vertex as usize];
            at - axis * at.coords.dot(&axis)
        };
        let on = |vertices: &dyn Fn(&u32) -> bool| {
            let chosen = places.iter().filter(|(vertex, _)| vertices(vertex));
            let mut row: Vec<(f64, Point3<f64>)> =
                chosen.map(|(&vertex, place)| (place.at, flat(vertex))).collect();
            row.sort_by(|one, other| one.0.total_cmp(&other.0));
            let (curve, ats) = of_columns.through_row(&row)?;
            curve.with_places(&places, &ats, flat, near)
        };
        let of_rims = on(&|vertex| !columns.contains_key(vertex));
        let of_all = on(&|_| true);
        let of_columns = of_columns.doubted(places);
        let better = |one: Placed, other: Placed| {
            if one.0.doubt_of_all() <= other.0.doubt_of_all() { one } else { other }
        };
        let (curve, places) = of_rims.into_iter().chain(of_all).fold(of_columns, better);
        Some(Self { mesh, curve, triangles: found, places })
    }

    /// The strip of some triangles, in ascending order, with the curve through all their vertices, which are given in its order across
    /// an axis; `None` if there are too few.
    pub(super) fn of_all(
        mesh: &'a SmoothMesh,
        axis: Vector3<f64>,
        triangles: &[usize],
        vertices: &[u32],
    ) -> Option<Self> {
        let flat = |vertex: u32| {
            let at = mesh.positions[vertex as usize];
            at - axis * at.coords.dot(&axis)
        };
        let all: Vec<Point3<f64>> = vertices.iter().map(|&vertex| flat(vertex)).collect();
        let length: f64 = all.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
        let apart = OF_MEAN_CHORD * length / all.len().max(1) as f64;
        // Those that nearly coincide are one, in their middle.
        let mut points: Vec<Vec<Point3<f64>>> = Vec::new();
        let mut point_of = Vec::new();
        for point in all {
            match points.last_mut() {
                Some(same) if (point - same[0]).norm() < apart => same.push(point),
                _ => points.push(vec![point]),
            }
            point_of.push(points.len() - 1);
        }
        let middle = |same: Vec<Point3<f64>>| {
            let sum: Vector3<f64> = same.iter().map(|point| point.coords).sum();
            Point3::from(sum / same.len() as f64)
        };
        let points: Vec<Point3<f64>> = points.into_iter().map(middle).collect();
        if points.len() < LEAST_POINTS {
            return None;
        }
        let curve = PlaneCurve::through(points, axis, false);
        let place = |(&vertex, &point): (&u32, &usize)| {
            Some((vertex, curve.nearest([point as f64].into_iter(), &flat(vertex))?))
        };
        let places: Option<BTreeMap<u32, Place>> = vertices.iter().zip(&point_of).map(place).collect();
        let (curve, places) = curve.doubted(places?);
        Some(Self { mesh, curve, triangles: triangles.to_vec(), places })
    }

    /// The vertices, in ascending order, with their normals.
    pub(super) fn normals(&self) -> (Vec<u32>, Vec<Vector3<f64>>) {
        self.places.iter().map(|(vertex, place)| (*vertex, place.normal)).unzip()
    }

    /// For each triangle, how far the slope of the part may be from that of its patch, rad.
    pub(super) fn doubts(&self) -> Vec<f32> {
        let doubt = |&triangle: &usize| {
            let places = self.mesh.triangles[triangle].map(|vertex| self.places.get(&vertex).copied());
            match places {
                [Some(one), Some(two), Some(three)] => self.curve.doubt([one, two, three]),
                _ => 0.0,
            }
        };
        self.triangles.iter().map(doubt).collect()
    }

    fn places_of(&self, side: usize) -> impl Iterator<Item = Place> {
        let corners = self.mesh.triangles[side / 3];
        let ends = [corners[side % 3], corners[(side % 3 + 1) % 3]];
        ends.map(|end| self.places.get(&end).copied()).into_iter().flatten()
    }
}

impl PlaneCurve {
    /// The triangles, in ascending order, that continue some of which all vertices have places, and the places of all. Each has a
    /// vertex on a ruling, or only vertices with places.
    fn continued(
        &self,
        mesh: &SmoothMesh,
        triangles: &[usize],
        columns: &BTreeMap<u32, Place>,
        is_within: impl Fn(&Point3<f64>) -> bool,
        near: f64,
        visits: &mut usize,
    ) -> (Vec<usize>, BTreeMap<u32, Place>) {
        let flat = |vertex: u32| {
            let at = mesh.positions[vertex as usize];
            at - self.axis * at.coords.dot(&self.axis)
        };
        let mut found: BTreeSet<usize> = triangles.iter().copied().collect();
        let mut front = triangles.to_vec();
        let mut places = columns.clone();
        while let Some(here) = front.pop() {
            for side in 3 * here..3 * here + 3 {
                let Some(there) = mesh.continuing(side).map(|other| other / 3) else { continue };
                if *visits == 0 || found.contains(&there) {
                    continue;
                }
                *visits -= 1;
                let corners = mesh.triangles[there];
                let is_placed = corners.iter().all(|vertex| places.contains_key(vertex));
                let has_ruling = corners.iter().any(|vertex| {
                    places.get(vertex).is_some_and(|place| self.is_at_point(place, 4.0 * near))
                });
                if !(is_placed || has_ruling && mesh.corners(there).0.iter().all(&is_within)) {
                    continue;
                }
                let normal = facet_normal(mesh.corners(there).0);
                let is_sliver = sliver_side(mesh.corners(there).0).is_some();
                if !is_sliver && normal.dot(&self.axis).abs() >= LEAN {
                    continue;
                }
                let known: Vec<f64> =
                    corners.iter().filter_map(|vertex| places.get(vertex).map(|place| place.at)).collect();
                let new: Option<Vec<(u32, Place)>> = corners
                    .iter()
                    .filter(|vertex| !places.contains_key(vertex))
                    .map(|&vertex| Some((vertex, self.place(known.iter().copied(), &flat(vertex), near)?)))
                    .collect();
                let Some(new) = new else { continue };
                places.extend(new);
                found.insert(there);
                front.push(there);
            }
        }
        (found.into_iter().collect(), places)
    }
}

impl Surface for CurveStrip<'_> {
    fn triangles(&self) -> &[usize] {
        &self.triangles
    }

    fn outward(&self, side: usize) -> Vector3<f64> {
        let sum: Vector3<f64> = self.places_of(side).map(|place| place.normal).sum();
        sum.try_normalize(0.0).unwrap_or(sum)
    }

    fn largest_bulge(&self) -> f64 {
        self.curve.largest_bulge
    }
}

impl Ruled for CurveStrip<'_> {
    fn ruling(&self, _: &Point3<f64>) -> Vector3<f64> {
        self.curve.axis
    }

    fn distance(&self, side: usize, at: &Point3<f64>) -> f64 {
        let flat = at - self.curve.axis * at.coords.dot(&self.curve.axis);
        let nearest = self.curve.nearest(self.places_of(side).map(|place| place.at), &flat);
        nearest.map_or(0.0, |place| place.off)
    }

    fn doubt(&self, side: usize) -> f64 {
        let of_place = |place: Place| {
            let chord = (place.at as usize).min(self.curve.chords() - 1);
            f64::from(self.curve.doubts[chord]) * self.curve.chord(chord).norm() / OF_OFF
        };
        self.places_of(side).map(of_place).fold(0.0, f64::max)
    }
}

/// The columns of vertices along the rulings of a strip, in the order of its curve.
struct Rows {
    /// Across the rulings.
    points: Vec<Point3<f64>>,
    /// Of each vertex.
    columns: BTreeMap<u32, usize>,
    /// Those between columns.
    triangles: Vec<usize>,
    is_closed: bool,
}

impl Rows {
    /// `None` where the columns are not in one order.
    fn of(
        mesh: &SmoothMesh,
        axis: Vector3<f64>,
        triangles: &[usize],
        is_ruling: impl Fn(usize) -> bool,
        near: f64,
    ) -> Option<Self> {
        let mut vertices: Vec<u32> =
            triangles.iter().flat_map(|&triangle| mesh.triangles[triangle]).collect();
        vertices.sort_unstable();
        vertices.dedup();
        let index = |vertex: u32| vertices.binary_search(&vertex).unwrap_or_default();
        let ends = |side: usize| {
            let corners = mesh.triangles[side / 3];
            [corners[side % 3], corners[(side % 3 + 1) % 3]].map(index)
        };
        let sides = || triangles.iter().flat_map(|&triangle| 3 * triangle..3 * triangle + 3);
        let mut sets = DisjointSets::new(vertices.len());
        for side in sides().filter(|&side| is_ruling(side)) {
            let [one, other] = ends(side);
            sets.join(one, other);
        }
        let (set_of, sets) = sets.numbered();
        let mut sizes = vec![0usize; sets];
        set_of.iter().for_each(|&set| sizes[set as usize] += 1);
        // A vertex by itself is one of a rim.
        let mut count = 0;
        let numbers: Vec<Option<usize>> = sizes
            .into_iter()
            .map(|size| {
                count += usize::from(size > 1);
                (size > 1).then(|| count - 1)
            })
            .collect();
        if count < LEAST_POINTS {
            return None;
        }
        let column = |vertex: usize| numbers[set_of[vertex] as usize];
        let mut points: Vec<Option<Point3<f64>>> = vec![None; count];
        for (vertex, &at) in vertices.iter().enumerate() {
            let Some(column) = column(vertex) else { continue };
            let at = mesh.positions[at as usize];
            let flat = at - axis * at.coords.dot(&axis);
            let first = points[column].get_or_insert(flat);
            if (flat - *first).norm() > 4.0 * near {
                return None;
            }
        }
        let triangles: Vec<usize> = triangles
            .iter()
            .copied()
            .filter(|&triangle| {
                mesh.triangles[triangle].iter().all(|&vertex| column(index(vertex)).is_some())
            })
            .collect();
        let of_side = |side: usize| {
            let [one, other] = ends(side).map(column);
            Some([one?, other?])
        };
        let mut beside: Vec<[usize; 2]> = triangles
            .iter()
            .flat_map(|&triangle| 3 * triangle..3 * triangle + 3)
            .filter_map(of_side)
            .filter(|[one, other]| one != other)
            .flat_map(|[one, other]| [[one, other], [other, one]])
            .collect();
        beside.sort_unstable();
        beside.dedup();
        let neighbours = |column: usize| {
            let first = beside.partition_point(|pair| pair[0] < column);
            beside[first..].iter().take_while(move |pair| pair[0] == column).map(|pair| pair[1])
        };
        if (0..count).any(|column| neighbours(column).count() > 2) {
            return None;
        }
        let end = (0..count).find(|&column| neighbours(column).count() < 2);
        let mut order = vec![end.unwrap_or(0)];
        let mut is_in = vec![false; count];
        is_in[order[0]] = true;
        while let Some(next) = neighbours(order[order.len() - 1]).find(|&next| !is_in[next]) {
            is_in[next] = true;
            order.push(next);
        }
        if order.len() < count {
            return None;
        }
        // The facets show the outside.
        let mut rank = vec![0; count];
        order.iter().enumerate().for_each(|(place, &column)| rank[column] = place);
        let ahead: f64 = triangles
            .iter()
            .map(|&triangle| {
                let corners = mesh.corners(triangle).0;
                let ranks =
                    mesh.triangles[triangle].map(|vertex| column(index(vertex)).map(|column| rank[column]));
                let normal = facet_normal(corners);
                [[0, 1], [1, 2], [2, 0]]
                    .into_iter()
                    .filter(|&[one, other]| ranks[one].map(|rank| rank + 1) == ranks[other])
                    .map(|[one, other]| (corners[other] - corners[one]).cross(&axis).dot(&normal))
                    .sum::<f64>()
            })
            .sum();
        if ahead < 0.0 {
            order.reverse();
            order.iter().enumerate().for_each(|(place, &column)| rank[column] = place);
        }
        let columns = vertices
            .iter()
            .enumerate()
            .filter_map(|(index, &vertex)| Some((vertex, rank[column(index)?])))
            .collect();
        let points = order.iter().map(|&column| points[column].unwrap_or(Point3::origin())).collect();
        Some(Self { points, columns, triangles, is_closed: end.is_none() })
    }
}

/// The area of some facets as seen along an axis, from that end of a strip which shows more of them, mm². Those between the chords of
/// a row and more chords of a rim face the middle, and those of a fillet an end.
fn facing_ends(
    mesh: &SmoothMesh,
    triangles: impl Iterator<Item = usize>,
    axis: Vector3<f64>,
    [low, high]: [f64; 2],
) -> f64 {
    let mut areas = [0.0; 2];
    for triangle in triangles {
        let [a, b, c] = mesh.corners(triangle).0;
        let facing = (b - a).cross(&(c - a)).dot(&axis) / 2.0;
        let along = (a.coords + b.coords + c.coords).dot(&axis) / 3.0;
        if along > (low + high) / 2.0 { areas[1] += facing } else { areas[0] -= facing }
    }
    areas[0].max(areas[1])
}
