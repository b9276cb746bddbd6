//! Triangles divided until their sides follow a surface, without gaps between neighbours.

use std::collections::BTreeMap;

use nalgebra::Point3;

/// Sides whose chord is farther than this from the surface, mm, are divided. The first of these values is
/// used for which there are not too many vertices, because the samples of a rough part have steps everywhere.
/// The middle of a triangle is within about twice the value.
pub(super) const SAGS: [f64; 4] = [0.004, 0.008, 0.016, 0.032];
/// Sides shorter than this, mm, are not divided: there is no more detail between samples of the part.
const SHORTEST: f64 = 0.4;
/// Sides longer than this are divided, mm: a surface may have waves between the probes.
const LONGEST: f64 = 8.0;

/// The triangles, divided at the middles of their sides as long as `divide` gives a new vertex for a side. A side is divided
/// for all its triangles alike; it is asked for once, with its lower vertex first.
pub(super) fn divided(
    triangles: Vec<[u32; 3]>,
    mut divide: impl FnMut([u32; 2]) -> Option<u32>,
) -> Vec<[u32; 3]> {
    let mut known: BTreeMap<[u32; 2], Option<u32>> = BTreeMap::new();
    let mut middle = |a: u32, b: u32| {
        let ends = [a.min(b), a.max(b)];
        *known.entry(ends).or_insert_with(|| divide(ends))
    };
    let mut done = Vec::with_capacity(triangles.len());
    let mut open = triangles;
    open.reverse();
    while let Some([a, b, c]) = open.pop() {
        match [middle(a, b), middle(b, c), middle(c, a)] {
            [None, None, None] => done.push([a, b, c]),
            [Some(ab), None, None] => open.extend([[a, ab, c], [ab, b, c]]),
            [None, Some(bc), None] => open.extend([[a, b, bc], [a, bc, c]]),
            [None, None, Some(ca)] => open.extend([[a, b, ca], [ca, b, c]]),
            [Some(ab), Some(bc), None] => open.extend([[a, ab, c], [ab, bc, c], [ab, b, bc]]),
            [None, Some(bc), Some(ca)] => open.extend([[b, bc, a], [bc, ca, a], [bc, c, ca]]),
            [Some(ab), None, Some(ca)] => open.extend([[c, ca, b], [ca, ab, b], [ca, a, ab]]),
            [Some(ab), Some(bc), Some(ca)] => {
                open.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
            }
        }
    }
    done
}

/// Whether a side from `start` to `end`, `length` mm long before it was bent, must be divided to follow a surface to within
/// `sag` mm; `image` gives the point of the surface at a share of the side, and `None` where there is no surface.
pub(super) fn must_divide(
    sag: f64,
    length: f64,
    [start, end]: [Point3<f64>; 2],
    image: impl Fn(f64) -> Option<Point3<f64>>,
) -> bool {
    let chord = end - start;
    let is_off = |t: f64| image(t).is_some_and(|at| chord.cross(&(at - start)).norm() > sag * chord.norm());
    length >= SHORTEST && (length > LONGEST || [0.5, 0.25, 0.75].into_iter().any(is_off))
}
