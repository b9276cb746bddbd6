//! The polygons that the triangles of a mesh were cut from. Modelling programs keep polygons with four
//! corners and more. These need not be plane. The programs shade them with one normal, that of the polygon's
//! area vector (M. E. Newell), and not with the normals of the triangles.

use nalgebra::{Point3, Vector3};

use super::adjacency::{NONE, opposite_sides, weld};

/// The normals of a polygon are one that is written several times, to three decimals or more.
pub(super) const ROUNDED: f64 = 2e-3;

/// Marks further triangles as shaded flat, one flag for each: those of polygons that are not plane. Such a
/// polygon has no inner corners, and one normal at all corners, that of its area vector, whichever way round
/// it runs. `normals` returns the normals at the corners of a triangle, of length 1.
pub fn add_bent(
    is_flat: &mut [bool],
    positions: &[Point3<f64>],
    triangles: &[[u32; 3]],
    normals: impl Fn(usize) -> [Vector3<f64>; 3],
) {
    let is_of_one_normal = |triangle: usize| {
        let [first, second, third] = normals(triangle);
        first != Vector3::zeros() && is_same(&second, &first) && is_same(&third, &first)
    };
    if !(0..triangles.len()).any(|triangle| !is_flat[triangle] && is_of_one_normal(triangle)) {
        return;
    }
    let chosen: Vec<usize> = (0..triangles.len()).filter(|&triangle| is_of_one_normal(triangle)).collect();
    let welded = weld(positions);
    let places: Vec<[u32; 3]> =
        chosen.iter().map(|&triangle| triangles[triangle].map(|vertex| welded[vertex as usize])).collect();
    let opposite = opposite_sides(&places);
    let mut is_met = vec![false; chosen.len()];
    for seed in 0..chosen.len() {
        if is_flat[chosen[seed]] || std::mem::replace(&mut is_met[seed], true) {
            continue;
        }
        let normal = normals(chosen[seed])[0];
        let (mut polygon, mut at, mut border, mut across) = (vec![seed], 0, 0, Vector3::zeros());
        while at < polygon.len() {
            let here = polygon[at];
            at += 1;
            across += area_vector(positions, triangles[chosen[here]]);
            for side in 3 * here..3 * here + 3 {
                let beyond = opposite[side] as usize / 3;
                if opposite[side] == NONE || !is_same(&normals(chosen[beyond])[0], &normal) {
                    border += 1;
                } else if !std::mem::replace(&mut is_met[beyond], true) {
                    polygon.push(beyond);
                }
            }
        }
        let has_inner_corners = border != polygon.len() + 2;
        if !has_inner_corners && across.cross(&normal).norm() <= ROUNDED * across.norm() {
            polygon.iter().for_each(|&triangle| is_flat[chosen[triangle]] = true);
        }
    }
}

/// A polygon that a triangle was cut from, seen from one of its corners.
pub(super) struct Outline {
    /// Of the first of its triangles.
    pub(super) number: usize,
    /// Twice the area vector.
    pub(super) across: Vector3<f64>,
    /// The polygon's angle at the corner, rad.
    pub(super) angle: f64,
}

/// For each triangle, the other half of the quadrangle that it may have been cut from; [`NONE`] if there is
/// none. Programs write the halves of a quadrangle one after the other. `places` are the places of the
/// triangles' corners. `can_be` returns whether a triangle and the next one can be such halves.
pub(super) fn halves(places: &[[u32; 3]], can_be: impl Fn([usize; 2]) -> bool) -> Vec<u32> {
    let mut halves = vec![NONE; places.len()];
    for first in 1..places.len() {
        let [one, other] = [places[first - 1], places[first]];
        let shared = one.iter().filter(|place| other.contains(place)).count();
        if shared == 2 && halves[first - 1] == NONE && can_be([first - 1, first]) {
            halves[first - 1] = first as u32;
            halves[first] = first as u32 - 1;
        }
    }
    halves
}

/// The quadrangle of a triangle and the other half, or the triangle alone, seen from one of its corners. Triangles are given by their
/// number, and their corners' places and positions.
pub(super) fn outline(
    (number, places, points): (usize, [u32; 3], [Point3<f64>; 3]),
    half: Option<(usize, [u32; 3], [Point3<f64>; 3])>,
    corner: usize,
) -> Outline {
    let turned = |by: usize| (corner + by) % 3;
    let [here, next, last] = [0, 1, 2].map(|by| points[turned(by)]);
    let across = (next - here).cross(&(last - here));
    let own = Outline { number, across, angle: (next - here).angle(&(last - here)) };
    let Some((other, of_half, points_of_half)) = half else { return own };
    let [a, b, c] = points_of_half;
    let whole = Outline { number: number.min(other), across: across + (b - a).cross(&(c - a)), ..own };
    let far = (0..3).find(|&at| !places.contains(&of_half[at]));
    let (Some(far), true) = (far, of_half.contains(&places[corner])) else { return whole };
    let beside = if of_half.contains(&places[turned(1)]) { last } else { next };
    Outline { angle: (beside - here).angle(&(points_of_half[far] - here)), ..whole }
}

fn is_same(one: &Vector3<f64>, other: &Vector3<f64>) -> bool {
    (one - other).norm() < ROUNDED
}

/// At right angles to a triangle, twice as long as its area.
fn area_vector(positions: &[Point3<f64>], corners: [u32; 3]) -> Vector3<f64> {
    let [a, b, c] = corners.map(|index| positions[index as usize]);
    (b - a).cross(&(c - a))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;

    /// Which triangles are flat if all corners have the same normal.
    fn flat(points: &[[f64; 3]], triangles: &[[u32; 3]], normal: Vector3<f64>) -> Vec<bool> {
        let positions: Vec<Point3<f64>> = points.iter().copied().map(Point3::from).collect();
        let mut is_flat = vec![false; triangles.len()];
        add_bent(&mut is_flat, &positions, triangles, |_| [normal.normalize(); 3]);
        is_flat
    }

    /// The area vector of a quadrangle is half the cross product of its diagonals.
    #[test]
    fn a_twisted_quadrangle_with_the_normal_of_its_area_vector_is_flat() {
        let points = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.7], [0.0, 1.0, 0.0]];
        let newell = Vector3::new(2.0, 1.0, 0.7).cross(&Vector3::new(-2.0, 1.0, 0.0));
        for triangles in [[[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]] {
            assert_eq!(flat(&points, &triangles, newell), [true, true]);
            let reversed = triangles.map(|[a, b, c]| [a, c, b]);
            assert_eq!(flat(&points, &reversed, -newell), [true, true]);
            assert_eq!(flat(&points, &triangles, Vector3::z()), [false, false]);
        }
    }

    #[test]
    fn a_bent_pentagon_is_flat_and_a_peak_is_not() {
        let points = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.3], [3.0, 1.0, 0.0], [1.0, 2.0, 0.5], [-1.0, 1.0, 0.0]];
        let newell: Vector3<f64> =
            (0..5).map(|at| Vector3::from(points[at]).cross(&Vector3::from(points[(at + 1) % 5]))).sum();
        assert_eq!(flat(&points, &[[0, 1, 2], [0, 2, 3], [0, 3, 4]], newell), [true; 3]);
        // The area vector of a square pyramid without its base is vertical.
        let peak = [[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 0.0, 0.5]];
        let sides = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]];
        assert_eq!(flat(&peak, &sides, Vector3::z()), [false; 4]);
    }

    #[test]
    fn the_halves_of_a_quadrangle_have_its_angles_and_its_area() {
        let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.4], [0.0, 1.0, 0.0]].map(Point3::from);
        // A triangle beside the quadrangle, which shares no side with its first half.
        let triangles = [[0, 1, 2], [0, 2, 3], [3, 2, 4]];
        assert_eq!(halves(&triangles, |_| true), [1, 0, NONE]);
        let seen =
            |number: usize| (number, triangles[number], triangles[number].map(|at| points[at as usize]));
        let across = (points[2] - points[0]).cross(&(points[3] - points[1]));
        let beside = (points[1] - points[2]).angle(&(points[3] - points[2]));
        for (number, corner, angle) in
            [(0, 0, FRAC_PI_2), (1, 0, FRAC_PI_2), (0, 2, beside), (1, 1, beside), (0, 1, FRAC_PI_2)]
        {
            let found = outline(seen(number), Some(seen(1 - number)), corner);
            // The triangle at an outer corner spans the angle of the quadrangle there.
            let own = (points[0] - points[1]).angle(&(points[2] - points[1]));
            let angle = if (number, corner) == (0, 1) { own } else { angle };
            assert!((found.angle - angle).abs() < 1e-12, "{number} {corner}: {} for {angle}", found.angle);
            assert!((found.across - across).norm() < 1e-12 && found.number == 0);
        }
        assert!((outline(seen(0), None, 0).across - Vector3::new(0.0, -0.4, 1.0)).norm() < 1e-12);
    }
}
