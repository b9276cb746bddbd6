//! A path prepared for comparison: its centre and size, its quantised shape, and its distance from another path.

use super::{DiffKind, DiffPath, PathNote};

/// Fraction of a quantum that is added before rounding: round decimal coordinates are then never on the border between
/// two quanta, where the last bit would decide.
const OFF_BORDER: f64 = std::f64::consts::FRAC_1_PI;
/// Number of segments searched on each side of the last nearest one.
const WINDOW: usize = 8;
/// Maximum number of distances that one comparison computes in searches over the whole path.
const SEARCH_BUDGET: usize = 250_000;

/// A path with the properties needed for pairing.
pub(super) struct Outline<'a> {
    pub(super) path: &'a DiffPath,
    /// Centre of its extents, mm.
    pub(super) center: [f64; 2],
    /// Width and height, mm.
    pub(super) size: [f64; 2],
    /// Its points in quanta of the tolerance, independent of start and direction.
    pub(super) lines: Vec<[i64; 2]>,
    /// The same relative to the centre.
    pub(super) shape: Vec<[i64; 2]>,
}

impl<'a> Outline<'a> {
    pub(super) fn of(path: &'a DiffPath, tolerance: f64) -> Self {
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for point in &path.points {
            for axis in [0, 1] {
                low[axis] = low[axis].min(point[axis]);
                high[axis] = high[axis].max(point[axis]);
            }
        }
        let (low, high) = if path.points.is_empty() { ([0.0; 2], [0.0; 2]) } else { (low, high) };
        let center = [0, 1].map(|axis| (low[axis] + high[axis]) / 2.0);
        let size = [0, 1].map(|axis| high[axis] - low[axis]);
        let quantised = |origin: [f64; 2]| {
            let quanta = path.points.iter().map(|[x, y]| quantum([x - origin[0], y - origin[1]], tolerance));
            normalised(quanta.collect(), path.kind)
        };
        Self { path, center, size, lines: quantised([0.0; 2]), shape: quantised(center) }
    }

    pub(super) fn note(&self) -> PathNote {
        PathNote {
            layer: self.path.layer.clone(),
            kind: self.path.kind,
            vertices: self.path.points.len(),
            center: self.center,
            size: self.size,
        }
    }

    /// The ends of segment `index`; a dot has one segment without length.
    fn segment(&self, index: usize) -> [[f64; 2]; 2] {
        let points = &self.path.points;
        [points[index], points[(index + 1) % points.len()]]
    }

    fn segments(&self) -> usize {
        match self.path.kind {
            DiffKind::Closed => self.path.points.len(),
            DiffKind::Dot | DiffKind::Open => self.path.points.len().saturating_sub(1).max(1),
        }
    }
}

/// The cell of width `size` that contains a point or step.
pub(super) fn quantum(point: [f64; 2], size: f64) -> [i64; 2] {
    point.map(|coordinate| (coordinate / size + OFF_BORDER).floor() as i64)
}

/// The largest distance from a vertex of one path to the line of the other, mm, after `moving` the old one.
///
/// Both paths are followed in parallel; where that would increase the result, the whole path is searched. The result is
/// exact, except for paths with very many vertices that differ almost everywhere, where it may be too large.
pub(super) fn deviation(old: &Outline<'_>, new: &Outline<'_>, moving: impl Fn([f64; 2]) -> [f64; 2]) -> f64 {
    if old.path.points.is_empty() || new.path.points.is_empty() {
        return if old.path.points.len() == new.path.points.len() { 0.0 } else { f64::MAX };
    }
    let to_new = one_sided(&old.path.points, &moving, new, |segment| segment);
    let to_old = one_sided(&new.path.points, |point| point, old, |segment| segment.map(&moving));
    to_new.max(to_old)
}

fn one_sided(
    points: &[[f64; 2]],
    moved: impl Fn([f64; 2]) -> [f64; 2],
    line: &Outline<'_>,
    placed: impl Fn([[f64; 2]; 2]) -> [[f64; 2]; 2],
) -> f64 {
    let count = line.segments();
    let distance = |point: [f64; 2], index: usize| to_segment(point, placed(line.segment(index)));
    let nearest = |point: [f64; 2], indices: &mut dyn Iterator<Item = usize>| {
        let all = indices.map(|index| (distance(point, index), index));
        all.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f64::MAX, 0))
    };
    let mut searches = (SEARCH_BUDGET / count).max(1);
    let mut worst = 0.0;
    let mut near: Option<usize> = None;
    for point in points {
        let point = moved(*point);
        let in_window = near.filter(|_| count > 2 * WINDOW).map(|near| {
            nearest(point, &mut (0..=2 * WINDOW).map(|step| (near + count + step - WINDOW) % count))
        });
        let (found, index) = match in_window {
            Some(found) if found.0 <= worst || searches == 0 => found,
            _ => {
                searches = searches.saturating_sub(1);
                nearest(point, &mut (0..count))
            }
        };
        near = Some(index);
        worst = f64::max(worst, found);
    }
    worst
}

fn to_segment(point: [f64; 2], [a, b]: [[f64; 2]; 2]) -> f64 {
    let along = [b[0] - a[0], b[1] - a[1]];
    let step = [point[0] - a[0], point[1] - a[1]];
    let squared = along[0] * along[0] + along[1] * along[1];
    let t = if squared > 0.0 {
        ((step[0] * along[0] + step[1] * along[1]) / squared).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (step[0] - along[0] * t).hypot(step[1] - along[1] * t)
}

/// The same points in a normal form: a contour starts at its smallest point, and the direction is the one that compares
/// less.
fn normalised(mut points: Vec<[i64; 2]>, kind: DiffKind) -> Vec<[i64; 2]> {
    let from_smallest = |points: &mut Vec<[i64; 2]>| {
        let smallest =
            points.iter().enumerate().min_by_key(|(_, point)| **point).map_or(0, |(index, _)| index);
        points.rotate_left(smallest);
    };
    let mut reversed: Vec<_> = points.iter().rev().copied().collect();
    if kind == DiffKind::Closed {
        from_smallest(&mut points);
        from_smallest(&mut reversed);
    }
    points.min(reversed)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(kind: DiffKind, points: Vec<[f64; 2]>) -> DiffPath {
        DiffPath { layer: "0".into(), color: "7".into(), kind, points }
    }

    #[test]
    fn start_and_direction_are_ignored() {
        let there = path(DiffKind::Closed, vec![[0.0, 0.0], [3.0, 0.0], [3.0, 2.0], [0.0, 1.0]]);
        let back = path(DiffKind::Closed, vec![[3.0, 2.0], [3.0, 0.0], [0.0, 0.0], [0.0, 1.0]]);
        assert_eq!(Outline::of(&there, 1e-3).lines, Outline::of(&back, 1e-3).lines);
    }

    #[test]
    fn a_moved_shape_has_the_same_quanta() {
        let shape = |x: f64, y: f64| {
            let points = [[0.0, 0.0], [2.025, 0.0], [1.0005, 0.125]].map(|[a, b]| [a + x, b + y]);
            Outline::of(&path(DiffKind::Open, points.into()), 1e-3).shape
        };
        for (x, y) in [(0.1, 0.2), (-17.3, 1e3), (0.0005, 123.4567)] {
            assert_eq!(shape(0.0, 0.0), shape(x, y), "{x}, {y}");
        }
    }

    #[test]
    fn the_deviation_of_long_paths_includes_a_single_bump() {
        let wave = |bump: f64| {
            let point = |index: i32| {
                let x = f64::from(index) * 0.01;
                [x, x.sin() + if index == 3_333 { bump } else { 0.0 }]
            };
            path(DiffKind::Open, (0..20_000).map(point).collect())
        };
        let (flat, bumped) = (wave(0.0), wave(0.25));
        let between = deviation(&Outline::of(&flat, 1e-3), &Outline::of(&bumped, 1e-3), |point| point);
        assert!((0.1..=0.25).contains(&between), "{between}");
    }
}
