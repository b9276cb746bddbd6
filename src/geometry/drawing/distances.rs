//! Distances between what a drawing marks: across gaps, from letter to letter, from dot to dot.
//!
//! The length-true map keeps lines and areas, and the empty space between them gives way. A person who measures from one line
//! to the next sees that.

use std::collections::BTreeSet;

use nalgebra::Point3;
use spade::{DelaunayTriangulation, HasPosition, Triangulation};

use super::ink::stations;
use super::pattern::{Path, Pattern, Shape};
use crate::geometry::space::{Extents, FlatPoint, ViewPoint};

/// Number of places between which distances are measured.
const PLACES: usize = 400;
/// A distance is measured in steps of at most this, mm, if there are at most [`MOST_STEPS`] of them.
const STEP: f64 = 2.0;
/// A distance is measured in at most this number of steps.
const MOST_STEPS: f64 = 32.0;
/// A line is almost straight between two of its places if it is at most this many times as long as their distance.
const STRAIGHT: f64 = 1.3;
/// Shorter distances are not measured, mm.
const SHORTEST: f64 = 0.05;

/// How distances between neighbouring places of the ink change.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Distances {
    /// Number of distances that were measured.
    pub count: usize,
    /// Sum of |distance on the part − distance drawn| / sum of distances drawn.
    pub mean_change: f64,
    /// The distance with the largest relative change.
    pub worst: Change,
}

/// How one distance changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Change {
    /// In the drawing, mm.
    pub drawn: f64,
    /// On the part, along the image of the straight line between the two places, mm.
    pub marked: f64,
    /// The middle between the two places, in the drawing.
    pub at: FlatPoint,
}

impl Change {
    /// Distance on the part / distance drawn − 1.
    pub fn share(&self) -> f64 {
        self.marked / self.drawn - 1.0
    }
}

/// A place of the ink.
#[derive(Debug, Clone, Copy)]
struct Landmark {
    at: FlatPoint,
    path: usize,
    /// How far along the path it is, mm, and the length of the path if it is closed.
    along: f64,
    round: Option<f64>,
}

impl HasPosition for Landmark {
    type Scalar = f64;
    fn position(&self) -> spade::Point2<f64> {
        spade::Point2::new(self.at.x, self.at.y)
    }
}

impl Landmark {
    /// Whether a line of the drawing leads almost straight from one to the other: its own error is that of lines.
    fn is_along_with(&self, other: &Self) -> bool {
        let apart = (self.along - other.along).abs();
        let apart = self.round.map_or(apart, |round| apart.min(round - apart));
        self.path == other.path && apart <= STRAIGHT * self.at.distance(other.at)
    }
}

/// Measures the distances between neighbouring places of the paths on layers for which `is_marked` is true: dots, ends of lines
/// and places along them. Neighbours share an edge of the Delaunay triangulation of the places. `map` is the map to the view
/// and `height` the part's height there, mm; distances that leave the part are not measured. `None` without two places.
pub fn distances(
    pattern: &Pattern,
    is_marked: &dyn Fn(&str) -> bool,
    map: &dyn Fn(FlatPoint) -> ViewPoint,
    height: &dyn Fn(ViewPoint) -> Option<f64>,
) -> Option<Distances> {
    let lift = |flat: FlatPoint| {
        let view = map(flat);
        Some(Point3::new(view.x, view.y, height(view)?))
    };
    let marked = |from: FlatPoint, to: FlatPoint| {
        let steps = (from.distance(to) / STEP).ceil().clamp(1.0, MOST_STEPS) as usize;
        let (mut last, mut sum) = (lift(from)?, 0.0);
        for step in 1..=steps {
            let next = lift(from.lerp(to, step as f64 / steps as f64))?;
            sum += (next - last).norm();
            last = next;
        }
        Some(sum)
    };
    let landmarks = landmarks(pattern, is_marked);
    let triangles = DelaunayTriangulation::<Landmark>::bulk_load(landmarks).ok()?;
    let (mut count, mut changed, mut drawn_in_all) = (0, 0.0, 0.0);
    let mut worst: Option<Change> = None;
    for edge in triangles.undirected_edges() {
        let [one, other] = edge.vertices().map(|vertex| *vertex.data());
        let drawn = one.at.distance(other.at);
        if drawn < SHORTEST || one.is_along_with(&other) {
            continue;
        }
        let Some(marked) = marked(one.at, other.at) else { continue };
        count += 1;
        changed += (marked - drawn).abs();
        drawn_in_all += drawn;
        let change = Change { drawn, marked, at: one.at.lerp(other.at, 0.5) };
        if worst.is_none_or(|worst| change.share().abs() > worst.share().abs()) {
            worst = Some(change);
        }
    }
    Some(Distances { count, mean_change: changed / drawn_in_all, worst: worst? })
}

/// Dots, ends of lines, and places evenly along all paths.
fn landmarks(pattern: &Pattern, is_marked: &dyn Fn(&str) -> bool) -> Vec<Landmark> {
    let is_ink: Vec<bool> = pattern.layers.iter().map(|layer| is_marked(&layer.name)).collect();
    let inked = pattern.paths.iter().enumerate();
    let inked: Vec<_> =
        inked.filter(|(_, path)| is_ink.get(path.layer).is_some_and(|is_ink| *is_ink)).collect();
    let chosen = chosen(inked);
    let total: f64 = chosen.iter().map(|(_, path)| length(&stations(&path.shape, f64::INFINITY))).sum();
    let apart = (total / (PLACES / 2) as f64).max(SHORTEST);
    let mut landmarks = Vec::new();
    for (path, shape) in chosen.into_iter().map(|(index, path)| (index, &path.shape)) {
        if let Shape::Dot(at) = shape {
            landmarks.push(Landmark { at: *at, path, along: 0.0, round: None });
            continue;
        }
        let fine = stations(shape, apart);
        let round = shape.is_closed().then(|| length(&fine));
        let (mut along, mut last) = (0.0, f64::NEG_INFINITY);
        for (index, at) in fine.iter().enumerate() {
            along += index.checked_sub(1).map_or(0.0, |before| fine[before].distance(*at));
            // The end of a contour is its start.
            let is_end = index + 1 == fine.len();
            if if is_end { round.is_none() } else { along - last >= 0.99 * apart } {
                landmarks.push(Landmark { at: *at, path, along, round });
                last = along;
            }
        }
    }
    landmarks
}

/// The paths between which distances are measured: all, or of many the longest, and of the others one in each cell of a grid.
/// They are the same in whatever order the paths are.
fn chosen(mut paths: Vec<(usize, &Path)>) -> Vec<(usize, &Path)> {
    /// This many of the longest paths are chosen; the others are chosen from about as many cells of a grid.
    const EACH: usize = PLACES / 4;
    if paths.len() <= 2 * EACH {
        return paths;
    }
    let box_of = |path: &Path| match path.shape {
        Shape::Dot(at) => Extents::of([at.coords()]),
        _ => Extents::of(path.shape.segments().iter().flat_map(|segment| {
            let of_segment = segment.extents();
            [of_segment.min, of_segment.max]
        })),
    };
    let boxes: Vec<Extents> = paths.iter().map(|(_, path)| box_of(path)).collect();
    let all = Extents::of(boxes.iter().flat_map(|path| [path.min, path.max]));
    let key = |index: usize| {
        let of_path: &Extents = &boxes[index];
        (of_path.size().norm(), of_path.min)
    };
    let mut order: Vec<usize> = (0..paths.len()).collect();
    order.sort_by(|&one, &other| {
        let ((size, min), (other_size, other_min)) = (key(one), key(other));
        let by_place = min.x.total_cmp(&other_min.x).then(min.y.total_cmp(&other_min.y));
        other_size.total_cmp(&size).then(by_place)
    });
    let side = (EACH as f64).sqrt().floor();
    let cell = |index: usize| {
        let at = boxes[index].center() - all.min;
        let share =
            |at: f64, size: f64| if size > 0.0 { (side * at / size).min(side - 1.0) as usize } else { 0 };
        [share(at.x, all.size().x), share(at.y, all.size().y)]
    };
    let mut is_taken = BTreeSet::new();
    let mut is_chosen = vec![false; paths.len()];
    for (rank, index) in order.into_iter().enumerate() {
        is_chosen[index] = rank < EACH || is_taken.insert(cell(index));
    }
    let mut is_chosen = is_chosen.into_iter();
    paths.retain(|_| is_chosen.next().unwrap_or_default());
    paths
}

/// The length of a polyline, mm.
fn length(points: &[FlatPoint]) -> f64 {
    points.windows(2).map(|ends| ends[0].distance(ends[1])).sum()
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;
    use crate::geometry::pattern::{Color, Layer, Segment, Source};

    fn drawing(shapes: Vec<Shape>) -> Pattern {
        let path =
            |shape| Path { layer: 0, color: Color::ByLayer, shape, region: None, source: Source::default() };
        let layers = vec![Layer { name: "MARK".into(), color: Color::Aci(7) }];
        Pattern { layers, paths: shapes.into_iter().map(path).collect() }
    }

    fn measured(pattern: &Pattern, map: impl Fn(FlatPoint) -> FlatPoint) -> Option<Distances> {
        distances(pattern, &|_| true, &|at| map(at).coords().into(), &|_| Some(0.0))
    }

    fn dot(x: f64, y: f64) -> Shape {
        Shape::Dot(FlatPoint::new(x, y))
    }

    #[test]
    fn distances_of_dots_change_as_the_map_stretches() {
        let grid = (0..25).map(|index| dot(f64::from(index % 5) * 3.0, f64::from(index / 5) * 3.0));
        let pattern = drawing(grid.collect());
        let found = measured(&pattern, |at| FlatPoint::new(1.1 * at.x, at.y)).unwrap();
        assert!((found.worst.share() - 0.1).abs() < 1e-12, "{found:?}");
        assert!((found.worst.drawn - 3.0).abs() < 1e-12 && (found.worst.marked - 3.3).abs() < 1e-12);
        assert!(found.count > 40 && found.mean_change > 0.03 && found.mean_change < 0.1, "{found:?}");
        let same = measured(&pattern, |at| at).unwrap();
        assert!(same.worst.share().abs() < 1e-12 && same.mean_change < 1e-12, "{same:?}");
    }

    #[test]
    fn the_gap_of_an_open_ring_is_a_distance() {
        let (u, v) = (Vector2::new(10.0, 0.0), Vector2::new(0.0, 10.0));
        let center = FlatPoint::new(0.0, 0.0);
        let ring = Shape::Open(vec![Segment::Arc { center, u, v, start: 0.2, sweep: 5.883_185_307 }]);
        // The map closes half the gap, and changes nothing on the other side.
        let squeezed = |at: FlatPoint| {
            let near = if at.x > 0.0 { ((6.0 - at.y.abs()) / 4.0).clamp(0.0, 1.0) } else { 0.0 };
            FlatPoint::new(at.x, at.y * (1.0 - 0.5 * near))
        };
        let found = measured(&drawing(vec![ring]), squeezed).unwrap();
        assert!((found.worst.drawn - 20.0 * 0.2f64.sin()).abs() < 1e-3, "{found:?}");
        assert!(found.worst.at.distance(FlatPoint::new(9.8, 0.0)) < 0.01, "{found:?}");
        assert!((found.worst.share() + 0.5).abs() < 1e-6, "{found:?}");
    }

    #[test]
    fn of_many_paths_the_same_are_measured_in_any_order() {
        let line = |x: f64, length: f64| {
            Shape::Open(vec![Segment::Line {
                from: FlatPoint::new(x, -length),
                to: FlatPoint::new(x, length),
            }])
        };
        let grid = (0..8).map(|index| line(f64::from(index) * 5.0, 20.0));
        let small =
            (0..900).map(|index| line(f64::from(index % 30) * 1.1 + 0.3, 0.01 + 1e-6 * f64::from(index)));
        let shapes: Vec<Shape> = grid.chain(small).collect();
        let bent = |at: FlatPoint| FlatPoint::new(at.x + 0.02 * at.x * at.x, at.y);
        let forwards = measured(&drawing(shapes.clone()), bent).unwrap();
        let backwards = measured(&drawing(shapes.into_iter().rev().collect()), bent).unwrap();
        assert!(
            (forwards.worst.share() - backwards.worst.share()).abs() < 1e-6,
            "{forwards:?} {backwards:?}"
        );
        // Between the last two lines of the grid.
        assert!(forwards.worst.share() > 1.0, "{forwards:?}");
    }

    #[test]
    fn a_distance_on_a_part_is_along_its_surface() {
        let pattern = drawing(vec![dot(-6.0, 0.0), dot(6.0, 0.0), dot(0.0, 1.0)]);
        let sphere = |at: ViewPoint| Some((100.0 - at.x * at.x - at.y * at.y).sqrt());
        let found = distances(&pattern, &|_| true, &|at| at.coords().into(), &sphere).unwrap();
        // From -6 to 6 mm along a great circle of 10 mm.
        assert!((found.worst.marked - 20.0 * 0.6f64.asin()).abs() < 0.1, "{found:?}");
    }

    #[test]
    fn one_mark_and_marks_beside_the_part_have_no_distances() {
        assert_eq!(measured(&drawing(vec![dot(0.0, 0.0)]), |at| at), None);
        assert_eq!(measured(&drawing(Vec::new()), |at| at), None);
        let pattern = drawing(vec![dot(0.0, 0.0), dot(1.0, 0.0), dot(0.0, f64::NAN)]);
        assert_eq!(distances(&pattern, &|_| true, &|at| at.coords().into(), &|_| None), None);
    }
}
