//! Whether a contour crosses itself.

use std::collections::BTreeMap;

use crate::geometry::space::FlatPoint;

/// Cells that a side may be in; longer sides are compared by their ends only.
const MOST_CELLS: f64 = 1e4;

/// A place where a contour crosses itself, if there is one; sides that only touch do not cross.
pub(super) fn crossing(contour: &[FlatPoint]) -> Option<FlatPoint> {
    let count = contour.len();
    if count < 4 || !contour.iter().all(|point| point.is_finite()) {
        return None;
    }
    let side = |index: usize| (contour[index], contour[(index + 1) % count]);
    let length: f64 = (0..count).map(|index| side(index).0.distance(side(index).1)).sum();
    let cell = (length / count as f64 * 2.0).max(length / MOST_CELLS).max(1e-9);
    let mut cells: BTreeMap<[i64; 2], Vec<usize>> = BTreeMap::new();
    for index in 0..count {
        let (from, to) = side(index);
        let number = |value: f64| (value / cell).floor() as i64;
        for column in number(from.x.min(to.x))..=number(from.x.max(to.x)) {
            // The rows of the side within this column.
            let row_at = |x: f64| {
                let share = if to.x == from.x { 0.0 } else { (x - from.x) / (to.x - from.x) };
                from.y + (to.y - from.y) * share.clamp(0.0, 1.0)
            };
            let [mut a, mut b] = [row_at(column as f64 * cell), row_at((column + 1) as f64 * cell)];
            if to.x == from.x {
                (a, b) = (from.y, to.y);
            }
            for row in number(a.min(b))..=number(a.max(b)) {
                cells.entry([column, row]).or_default().push(index);
            }
        }
    }
    for sides in cells.values() {
        for (position, one) in sides.iter().enumerate() {
            for other in &sides[position + 1..] {
                let apart = one.abs_diff(*other);
                if apart > 1
                    && apart < count - 1
                    && let Some(at) = meeting(side(*one), side(*other))
                {
                    return Some(at);
                }
            }
        }
    }
    None
}

/// Where two sides cross.
fn meeting((a, b): (FlatPoint, FlatPoint), (c, d): (FlatPoint, FlatPoint)) -> Option<FlatPoint> {
    let turn = |p: FlatPoint, q: FlatPoint, r: FlatPoint| (q - p).perp(&(r - p));
    let (c_side, d_side) = (turn(a, b, c), turn(a, b, d));
    let crosses = c_side * d_side < 0.0 && turn(c, d, a) * turn(c, d, b) < 0.0;
    crosses.then(|| c.lerp(d, c_side / (c_side - d_side)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn contour(points: &[[f64; 2]]) -> Vec<FlatPoint> {
        points.iter().map(|[x, y]| FlatPoint::new(*x, *y)).collect()
    }

    #[test]
    fn a_bow_crosses_itself_in_its_middle_and_a_square_does_not() {
        let bow = contour(&[[0.0, 0.0], [4.0, 4.0], [4.0, 0.0], [0.0, 4.0]]);
        assert!(crossing(&bow).unwrap().distance(FlatPoint::new(2.0, 2.0)) < 1e-12);
        let square = contour(&[[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]]);
        assert_eq!(crossing(&square), None);
        // A corner that touches another side does not cross it.
        let touching = contour(&[[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 0.0], [0.0, 4.0]]);
        assert_eq!(crossing(&touching), None);
    }

    #[test]
    fn a_crossing_of_a_fine_contour_is_found() {
        // A figure of eight (Gerono's lemniscate) crosses itself at the origin.
        let eight = |step: i32| {
            let (sin, cos) = (std::f64::consts::TAU * (f64::from(step) + 0.5) / 4001.0).sin_cos();
            [20.0 * cos, 20.0 * sin * cos]
        };
        let points: Vec<[f64; 2]> = (0..4001).map(eight).collect();
        assert!(crossing(&contour(&points)).unwrap().coords().norm() < 0.05);
        let circle = |step: i32| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(step) / 4000.0).sin_cos();
            [20.0 * cos, 20.0 * sin]
        };
        let points: Vec<[f64; 2]> = (0..4000).map(circle).collect();
        assert_eq!(crossing(&contour(&points)), None);
    }
}
