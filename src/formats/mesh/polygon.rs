//! Triangulation of faces with any number of corners, including concave ones.

use nalgebra::{Point3, Vector2, Vector3};

use super::{MeshReadError, at_most, check_pace};
use crate::formats::Pace;

/// Largest number of corner comparisons for all faces of a part: about half a minute.
const MAX_WORK: usize = 4_000_000_000;
/// Largest number of corner comparisons at a quick pace.
const QUICK_COMPARISONS: usize = 20_000_000;

/// Cuts all faces of one part into triangles.
pub(super) struct Cutter {
    pace: Pace,
    /// Upper bound of the comparisons so far.
    work: usize,
}

impl Cutter {
    pub(super) fn new(pace: Pace) -> Self {
        Self { pace, work: 0 }
    }

    /// Cuts one face, as [`triangulate`] does.
    ///
    /// # Errors
    /// When that is more work than the pace or [`MAX_WORK`] allows.
    pub(super) fn cut(
        &mut self,
        corners: &[Point3<f64>],
        emit: impl FnMut([usize; 3]),
    ) -> Result<(), MeshReadError> {
        // Triangles and quadrangles take constant time.
        let work = if corners.len() > 4 { corners.len().saturating_mul(corners.len()) } else { 0 };
        self.work = self.work.saturating_add(work);
        at_most("face corners to compare", self.work, MAX_WORK)?;
        check_pace(self.pace, self.work, QUICK_COMPARISONS)?;
        triangulate(corners, emit);
        Ok(())
    }
}

/// Cuts the polygon into `corners.len() - 2` triangles with the polygon's orientation, given as indices of its corners.
///
/// Ear clipping (G. H. Meisters, Polygons have ears, Amer. Math. Monthly 82, 1975) in the plane of the polygon's
/// vector area; a convex polygon is cut into a fan. If there is no ear, because the polygon crosses itself or has no
/// area, the next corner is cut off anyway, so that every corner is used. Takes O(n²), because whether a corner is an
/// ear changes only when one of its neighbours is cut off.
fn triangulate(corners: &[Point3<f64>], mut emit: impl FnMut([usize; 3])) {
    if corners.len() < 3 {
        return;
    }
    let flat = projected(corners);
    let is_left_turn = |a: usize, b: usize, c: usize| turn(flat[a], flat[b], flat[c]) >= 0.0;
    let count = corners.len();
    let is_convex = (0..count).all(|at| is_left_turn(at, (at + 1) % count, (at + 2) % count));
    if corners.len() == 3 || is_convex {
        (1..count - 1).for_each(|at| emit([0, at, at + 1]));
        return;
    }
    let mut left: Vec<usize> = (0..count).collect();
    let mut is_known: Vec<Option<bool>> = vec![None; count];
    let mut at = 0;
    let mut refused = 0;
    while left.len() > 3 {
        let here = [left[(at + left.len() - 1) % left.len()], left[at], left[(at + 1) % left.len()]];
        let [before, tip, after] = here;
        if refused >= left.len() || *is_known[tip].get_or_insert_with(|| is_ear(&flat, &left, here)) {
            emit(here);
            left.remove(at);
            (is_known[before], is_known[after]) = (None, None);
            refused = 0;
            // Stepping back would cut a fan of slivers; stepping forward spreads the cuts.
            at %= left.len();
        } else {
            refused += 1;
            at = (at + 1) % left.len();
        }
    }
    emit([left[0], left[1], left[2]]);
}

fn is_ear(flat: &[Vector2<f64>], left: &[usize], [before, tip, after]: [usize; 3]) -> bool {
    let [a, b, c] = [flat[before], flat[tip], flat[after]];
    if turn(a, b, c) <= 0.0 {
        return false;
    }
    !left.iter().any(|&other| {
        let point = flat[other];
        other != before
            && other != tip
            && other != after
            && point != a
            && point != b
            && point != c
            && turn(a, b, point) >= 0.0
            && turn(b, c, point) >= 0.0
            && turn(c, a, point) >= 0.0
    })
}

/// The corners in the plane perpendicular to Newell's normal, counter-clockwise.
fn projected(corners: &[Point3<f64>]) -> Vec<Vector2<f64>> {
    let origin = corners[0];
    let pairs = corners.iter().zip(corners.iter().cycle().skip(1));
    let normal: Vector3<f64> = pairs.map(|(a, b)| (a - origin).cross(&(b - origin))).sum();
    let normal = normal.try_normalize(0.0).unwrap_or_else(Vector3::z);
    let helper = if normal.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let u = helper.cross(&normal).normalize();
    let v = normal.cross(&u);
    corners.iter().map(|corner| corner - origin).map(|arm| Vector2::new(arm.dot(&u), arm.dot(&v))).collect()
}

/// Twice the signed area of the triangle, positive counter-clockwise.
fn turn(a: Vector2<f64>, b: Vector2<f64>, c: Vector2<f64>) -> f64 {
    (b - a).perp(&(c - a))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The signed and the absolute sum of the triangles' areas along +Z, which are equal only if no triangle is outside
    /// or flipped, and the number of triangles.
    fn areas(points: &[[f64; 2]]) -> (f64, f64, usize) {
        let corners: Vec<Point3<f64>> = points.iter().map(|&[x, y]| Point3::new(x, y, 3.0)).collect();
        let (mut signed, mut total, mut count) = (0.0, 0.0, 0);
        triangulate(&corners, |[a, b, c]| {
            let area = (corners[b] - corners[a]).cross(&(corners[c] - corners[a])).z / 2.0;
            signed += area;
            total += area.abs();
            count += 1;
        });
        (signed, total, count)
    }

    #[test]
    fn concave_faces_keep_their_area_and_orientation() {
        let arrow = [[0.0, 0.0], [4.0, -2.0], [1.0, 0.0], [4.0, 2.0]];
        assert_eq!(areas(&arrow), (2.0, 2.0, 2));
        let mut turned = arrow;
        turned.rotate_left(1);
        assert_eq!(areas(&turned), (2.0, 2.0, 2));
        let comb = [
            [0.0, 0.0],
            [7.0, 0.0],
            [7.0, 3.0],
            [6.0, 3.0],
            [6.0, 1.0],
            [5.0, 1.0],
            [5.0, 3.0],
            [4.0, 3.0],
            [4.0, 1.0],
            [3.0, 1.0],
            [3.0, 3.0],
            [0.0, 3.0],
        ];
        let (signed, total, count) = areas(&comb);
        assert!((signed - 17.0).abs() < 1e-12 && (total - 17.0).abs() < 1e-12, "{signed} {total}");
        assert_eq!(count, 10);
        let clockwise: Vec<[f64; 2]> = comb.iter().rev().copied().collect();
        assert!((areas(&clockwise).0 + 17.0).abs() < 1e-12);
    }

    #[test]
    fn a_face_with_a_bridged_hole_keeps_the_hole_open() {
        let ring = [
            [0.0, 0.0],
            [4.0, 0.0],
            [4.0, 4.0],
            [0.0, 4.0],
            [0.0, 0.0],
            [1.0, 1.0],
            [1.0, 3.0],
            [3.0, 3.0],
            [3.0, 1.0],
            [1.0, 1.0],
        ];
        let (signed, total, _) = areas(&ring);
        assert!((signed - 12.0).abs() < 1e-12 && (total - 12.0).abs() < 1e-12, "{signed} {total}");
    }

    /// Teeth that reach into the gaps of other teeth: almost no corner is an ear.
    #[test]
    fn a_face_with_thousands_of_concave_corners_is_triangulated() {
        let count = 2500;
        let x = |tooth: usize| tooth as f64 * 0.01;
        let upper = (0..count)
            .map(|tooth| [x(tooth), if tooth % 2 == 1 { 40.0 } else { 1.0 + 0.001 * tooth as f64 }]);
        let lower = (0..count).rev().map(|tooth| [x(tooth), if tooth % 2 == 1 { 39.0 } else { 0.0 }]);
        let points: Vec<[f64; 2]> = upper.chain(lower).collect();
        let pairs = points.iter().zip(points.iter().cycle().skip(1));
        let area = pairs.map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>() / 2.0;
        let (signed, total, triangles) = areas(&points);
        assert_eq!(triangles, 2 * count - 2);
        assert!((signed - area).abs() < 1e-6 && (total - area.abs()).abs() < 1e-6, "{signed} {total} {area}");
    }

    #[test]
    fn more_work_than_the_pace_allows_is_refused() {
        let ring = vec![Point3::origin(); 1000];
        let mut quick = Cutter::new(Pace::Quick);
        let cut = (0..100).take_while(|_| quick.cut(&ring, |_| {}).is_ok()).count();
        assert_eq!(cut, 20);
        assert_eq!(quick.cut(&ring, |_| {}), Err(MeshReadError::TakesLong));
    }

    #[test]
    fn faces_without_area_or_with_crossings_are_triangulated() {
        assert_eq!(areas(&[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [1.0, 0.0]]).2, 2);
        assert_eq!(areas(&[[0.0, 0.0]; 5]).2, 3);
        assert_eq!(areas(&[[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]]).2, 2);
        assert_eq!(areas(&[[0.0, 0.0], [1.0, 1.0]]).2, 0);
    }
}
