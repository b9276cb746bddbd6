//! What the normals at both ends of a chord show of the curve that it cuts off.

use nalgebra::{Point3, Vector3};

use super::mesh::TriMesh;

/// Normals are turned if they lean towards one end by more than this share of the turn between the ends, root
/// mean square. Exact normals of the coarsest CAD exports reach 0.38. Normals that are turned at random by as
/// much as facets turn reach 0.5.
const TURNED: f64 = 0.45;
/// At most this many triangles are looked at; those of larger meshes are sampled evenly.
const SAMPLE: usize = 20_000;
/// The normals at the ends of a chord of a smooth curve lean from it by angles that differ by at most this
/// share of the turn between them. Where the curvature grows evenly from zero, one angle is a third of the
/// turn and the other is two thirds.
const MOST_UNEVEN: f64 = 1.0 / 3.0;

/// A side of a mesh with the normals at its ends.
#[derive(Debug, Clone, Copy)]
pub(super) struct Chord {
    /// mm.
    pub(super) ends: [Point3<f64>; 2],
    /// Unit normals.
    pub(super) normals: [Vector3<f64>; 2],
}

impl Chord {
    /// mm.
    pub(super) fn length(&self) -> f64 {
        (self.ends[1] - self.ends[0]).norm()
    }

    /// The angle between the normals, as the distance between their ends, no unit.
    pub(super) fn turn(&self) -> f64 {
        (self.normals[1] - self.normals[0]).norm()
    }

    /// By how much more the normals lean towards one end than towards the other, as a sine; 0 on an arc.
    fn unevenness(&self) -> f64 {
        let along = (self.ends[1] - self.ends[0]).try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        (self.normals[0] + self.normals[1]).dot(&along)
    }
}

/// Whether normals lean from weighted chords as on a smooth surface, in the root mean square. Single chords
/// along rulings have no turn between their ends, so rounded numbers would decide there.
pub(super) fn are_of_smooth_curves(chords: impl Iterator<Item = (Chord, f64)>) -> bool {
    let mut excess = 0.0;
    for (chord, weight) in chords.filter(|(chord, _)| chord.length() > 0.0) {
        excess += weight * (chord.unevenness().powi(2) - (MOST_UNEVEN * chord.turn()).powi(2));
    }
    excess <= 0.0
}

/// By how much the normals at the ends of chords lean towards the same end, as a sine, root mean square; 0 if there are none.
///
/// The normals at both ends of an arc lean from its chord by equal and opposite angles.
pub(super) fn unevenness(chords: &[Chord]) -> f64 {
    let squares: f64 = chords.iter().map(|chord| chord.unevenness().powi(2)).sum();
    (squares / chords.len().max(1) as f64).sqrt()
}

/// How far the normals of a mesh lean from the normals of a smooth surface through its vertices, rad, root
/// mean square over the sides of its triangles. Only a lean that the curvature does not explain has an
/// effect. `None` if the normals fit, or if there are none.
pub fn turned(mesh: &TriMesh) -> Option<f64> {
    if mesh.normals().is_empty() {
        return None;
    }
    let stride = mesh.triangles().len().div_ceil(SAMPLE).max(1);
    let chords_of = |corners: &[u32; 3]| {
        let (points, normals) =
            (mesh.corners(*corners), corners.map(|vertex| mesh.normals()[vertex as usize]));
        [[0, 1], [1, 2], [2, 0]]
            .map(|ends| Chord { ends: ends.map(|end| points[end]), normals: ends.map(|end| normals[end]) })
    };
    let are_known = |chord: &Chord| chord.length() > 0.0 && !chord.normals.contains(&Vector3::zeros());
    let chords: Vec<Chord> =
        mesh.triangles().iter().step_by(stride).flat_map(chords_of).filter(are_known).collect();
    let turns: f64 = chords.iter().map(|chord| chord.turn().powi(2)).sum();
    let turn = (turns / chords.len().max(1) as f64).sqrt();
    let unevenness = unevenness(&chords);
    // The leans at both ends are independent of each other, and add up.
    (unevenness > TURNED * turn).then(|| (unevenness / std::f64::consts::SQRT_2).min(1.0).asin())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chord of a torus, from angles round its tube and its axis to others, rad.
    fn chord_of_torus(radii: [f64; 2], from: [f64; 2], to: [f64; 2]) -> Chord {
        let normals = [from, to]
            .map(|[tube, axis]| Vector3::new(tube.cos() * axis.cos(), tube.cos() * axis.sin(), tube.sin()));
        let middle = |[_, axis]: [f64; 2]| Vector3::new(axis.cos(), axis.sin(), 0.0) * radii[0];
        let ends = [
            Point3::from(middle(from) + normals[0] * radii[1]),
            Point3::from(middle(to) + normals[1] * radii[1]),
        ];
        Chord { ends, normals }
    }

    #[test]
    fn normals_of_a_fillet_fit_its_oblique_chords_and_averages_beside_a_flat_side_do_not() {
        // As coarse as CAD programs cut a fillet of 0.5 mm on a can.
        for [tube, axis] in [[0.25, 0.16], [0.5, 0.16], [0.5, 0.5], [0.0, 0.5], [0.5, 0.0]] {
            for start in [0.0, 0.5, 1.0] {
                let chord = chord_of_torus([12.0, 0.5], [start, 0.0], [start + tube, axis]);
                assert!(are_of_smooth_curves([(chord, 1.0)].into_iter()), "{start} {tube} {axis}: {chord:?}");
            }
        }
        // A flat side, seen from its border: the normal leans by 15 deg at one end only.
        let leaning = Vector3::new(-f64::sin(0.26), 0.0, f64::cos(0.26));
        let chord =
            Chord { ends: [Point3::origin(), Point3::new(20.0, 0.0, 0.0)], normals: [leaning, Vector3::z()] };
        assert!(!are_of_smooth_curves([(chord, 1.0)].into_iter()));
    }
}
