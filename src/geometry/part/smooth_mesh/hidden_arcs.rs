//! Edges that only the facets of the part show, and that may not be edges. An arc that is cut into two facets
//! has one corner, as a roof has, if the arcs beyond it turn the other way and leave no corner there.
//!
//! The two chords of such an arc have the same length. At both ends, each chord leaves the arc by half the
//! turn between the chords. The rest of the turn at their far ends is that of the chords beyond. A roof
//! between flat sides has no such turns.

use nalgebra::Vector3;

use super::chains::{EVENLY_CUT, NOT_FLAT, of_cubic};
use super::creases::{Facing, are_of_regular_prism};
use super::sections::{Facets, turn};
use crate::geometry::adjacency::{NONE, facet_normal};
use crate::geometry::flats::CHORD_OF_ROUND;

/// CAD programs cut arcs into facets that turn by at most this, rad.
const MOST_TURN: f64 = 0.5;
/// Two chords are of one arc, or of one smooth curve, where their lengths differ by at most this factor.
const OF_ONE_CURVE: f64 = 1.6;
/// Sides whose direction differs more than this from that of an edge, as a cosine, run across it.
const ACROSS: f64 = 0.3;
/// Pieces of a section that turn by less than this are in one plane, rad.
const COPLANAR: f64 = 0.25 * std::f64::consts::PI / 180.0;

/// The section on one side of an edge: the facet beside it, and those beyond.
#[derive(Default)]
struct Beside {
    length: f64,
    /// The signed angle between the two, rad, if there is a second one.
    turn: Option<f64>,
    /// The triangles of both.
    triangles: [Vec<usize>; 2],
    /// The lengths of the second and of the third, mm.
    lengths_beyond: [f64; 2],
    /// The signed angle between these, rad, if there is a third one.
    turn_beyond: Option<f64>,
}

impl Beside {
    /// Whether the facet is flat. The arc beyond, from which the next two facets are cut, begins where the
    /// facet ends. It leaves no turn there for an arc that leans from its chord by `lean`, rad.
    fn is_flat(&self, lean: f64) -> bool {
        let [second, third] = self.lengths_beyond;
        let is_evenly_cut = second <= EVENLY_CUT * third && third <= EVENLY_CUT * second;
        let left = self.turn.zip(self.turn_beyond).map(|(turn, beyond)| (turn - beyond / 2.0).abs());
        is_evenly_cut && left.is_some_and(|left| left <= NOT_FLAT * lean.abs())
    }
}

/// The slope of a triangle beside an edge that may be the corner of an arc, or beyond it.
pub(super) struct HiddenArc {
    pub(super) triangle: usize,
    /// The error of the slope if it is, rad, root mean square.
    pub(super) doubt: f64,
    /// The direction of the edge.
    pub(super) edge: Vector3<f64>,
    /// Whether it would be the arc of an S-shaped curve.
    pub(super) is_double_bend: bool,
}

/// Those beside `edges`.
pub(super) fn found(facets: &Facets, edges: &[Facing]) -> Vec<HiddenArc> {
    let mut arcs = Vec::new();
    for edge in edges {
        let [from, to] = facets.ends(edge[0] as usize);
        let Some(along) = (to - from).try_normalize(0.0) else { continue };
        let middle = nalgebra::center(&from, &to);
        let mut first = [Vector3::zeros(); 2];
        let beside = [0, 1].map(|way| {
            let mut beside = Beside::default();
            let mut last: Option<Vector3<f64>> = None;
            facets.section_from(edge[way] as usize, middle, along, |triangle, piece| {
                let turned = last.map_or(0.0, |last| turn(last, piece, along));
                if last.is_none() {
                    first[way] = piece;
                }
                last = Some(piece);
                if turned.abs() >= COPLANAR {
                    match (beside.turn, beside.turn_beyond) {
                        (None, _) => beside.turn = Some(turned),
                        (Some(_), None) => beside.turn_beyond = Some(turned),
                        (Some(_), Some(_)) => return false,
                    }
                }
                match (beside.turn, beside.turn_beyond) {
                    (None, _) => {
                        beside.length += piece.norm();
                        beside.triangles[0].push(triangle);
                    }
                    (Some(_), None) => {
                        beside.lengths_beyond[0] += piece.norm();
                        beside.triangles[1].push(triangle);
                    }
                    (Some(_), Some(_)) => beside.lengths_beyond[1] += piece.norm(),
                }
                true
            });
            beside
        });
        let turned = turn(-first[0], first[1], along);
        let [one, other] = beside.each_ref().map(|beside| beside.length);
        let goes_on = beside.iter().any(|beside| beside.turn.is_some());
        let is_even = one <= OF_ONE_CURVE * other && other <= OF_ONE_CURVE * one;
        let is_of_polygon =
            |triangles: &[usize]| triangles.first().is_some_and(|&first| is_polygon(facets, first, along));
        let starts_flat = beside.iter().any(|beside| is_of_polygon(&beside.triangles[0]));
        let arc = |triangle: usize, doubt: f64, is_double_bend: bool| HiddenArc {
            triangle,
            doubt,
            edge: along,
            is_double_bend,
        };
        for (triangles, doubt) in of_round_prism(turned, &beside) {
            arcs.extend(triangles.iter().map(|&triangle| arc(triangle, doubt, false)));
        }
        for way in [0, 1] {
            if let Some(doubt) = of_double_bend(turned, &beside, way) {
                let flat = beside[way].triangles[0].iter();
                arcs.extend(flat.map(|&triangle| arc(triangle, doubt, true)));
            }
        }
        let is_flat = starts_flat || beside.iter().any(|beside| beside.is_flat(turned / 2.0));
        if !goes_on || !is_even || is_flat || turned.abs() > MOST_TURN {
            continue;
        }
        for (way, beside) in beside.iter().enumerate() {
            // The slope of an arc deviates from that of its chord by up to the lean, evenly along it.
            let mut add = |which: usize, lean: f64| {
                let doubt = lean.abs() / 3f64.sqrt();
                let beside = beside.triangles[which].iter();
                arcs.extend(beside.map(|&triangle| arc(triangle, doubt, false)));
            };
            let lean = turned / 2.0;
            add(0, lean);
            // Sections on the two sides of the edge run opposite ways.
            let ahead = if way == 0 { -1.0 } else { 1.0 };
            if let Some(turn) = beside.turn
                && !is_of_polygon(&beside.triangles[1])
            {
                add(1, (ahead * turn - lean).clamp(-MOST_TURN / 2.0, MOST_TURN / 2.0));
            }
        }
    }
    arcs
}

/// The triangles of some arcs, in ascending order, each with the direction of an edge beside it.
pub(super) fn directions(arcs: &[HiddenArc]) -> Vec<(u32, Vector3<f64>)> {
    let mut directions: Vec<_> = arcs.iter().map(|arc| (arc.triangle as u32, arc.edge)).collect();
    directions.sort_by_key(|&(triangle, _)| triangle);
    directions.dedup_by_key(|&mut (triangle, _)| triangle);
    directions
}

/// The error of the slope of the side on this `way` of an edge that `turned`, rad, root mean square, if the
/// curves do not leave the side as a tangent. A side between two curves that bend opposite ways may be their
/// common tangent, or the long chord of an S-shaped curve: programs that measure how far the middle of a
/// chord is off find no distance there.
fn of_double_bend(turned: f64, beside: &[Beside; 2], way: usize) -> Option<f64> {
    let (side, curve) = (&beside[way], &beside[1 - way]);
    // Sections on the two sides of the edge run opposite ways.
    let ahead = if way == 0 { -1.0 } else { 1.0 };
    let near = -ahead * curve.turn?;
    let [far, after_far] = [ahead * side.turn?, ahead * side.turn_beyond?];
    let bends_on = |turn: f64, next: f64| turn * next > 0.0;
    // The normals of an arc lean as much at both of its ends.
    let leaves_tangent = |turn: f64, next: f64| (turn - next) * turn > NOT_FLAT * turn * turn;
    // What is beyond a longer side is another bend.
    if curve.length.max(side.lengths_beyond[0]) > side.length {
        return None;
    }
    let is_curve = curve.turn_beyond.is_some_and(|after| bends_on(near, -ahead * after))
        || leaves_tangent(turned, near) && leaves_tangent(far, after_far);
    let is_double = bends_on(turned, near) && bends_on(far, after_far) && far * turned < 0.0;
    if !is_curve || !is_double || turned.abs().max(far.abs()) > MOST_TURN {
        return None;
    }
    // What an arc beyond leaves of the turn, or the lean of a circle through the ends of both chords.
    let lean = |turn: f64, next: f64, [chord, beyond]: [f64; 2]| {
        let is_evenly_cut = chord <= EVENLY_CUT * beyond && beyond <= EVENLY_CUT * chord;
        let lean = if is_evenly_cut { turn - next / 2.0 } else { turn * side.length / (side.length + chord) };
        (lean * turn > NOT_FLAT * turn * turn).then_some(lean)
    };
    let first = lean(turned, near, [curve.length, curve.lengths_beyond[0]])?;
    let last = lean(far, after_far, side.lengths_beyond)?;
    Some(of_cubic(first, last))
}

/// The triangles beside an edge that `turned`, rad, on each side of it, with the error of their slopes, rad,
/// root mean square, if they are chords of one circle. The sides of a prism and the chamfers of its edges may
/// be such chords if none of them is wider than those of a round face.
fn of_round_prism(turned: f64, beside: &[Beside; 2]) -> impl Iterator<Item = (&[usize], f64)> {
    let [one, other] = beside.each_ref().map(|beside| beside.length);
    let turns_on = |way: usize| {
        let ahead = if way == 0 { -turned } else { turned };
        let goes_on = |turn: f64| turn * ahead > 0.0 && are_of_regular_prism(turn.abs(), turned.abs());
        beside[way].turn.is_some_and(goes_on) && !beside[way].is_flat(turned / 2.0)
    };
    // Each turns by its share.
    let arc = move |length: f64| 2.0 * turned.abs() * length / (one + other);
    let may_be_round = turns_on(0) && turns_on(1) && arc(one.max(other)) <= CHORD_OF_ROUND;
    let sides = beside.iter().filter(move |_| may_be_round);
    sides.map(move |beside| (beside.triangles[0].as_slice(), arc(beside.length) / 12f64.sqrt()))
}

/// Whether a triangle beside an edge, along a unit vector, is of a facet that is divided more often than those of a curved face: a
/// flat side. Those of a curved face are divided once between two rulings, and in rows across these.
fn is_polygon(facets: &Facets, triangle: usize, along: Vector3<f64>) -> bool {
    let normal = facet_normal(facets.corners(triangle));
    let mut found = [triangle; 2];
    let mut count = 1;
    let mut next = 0;
    while next < count {
        for side in 3 * found[next]..3 * found[next] + 3 {
            let beyond = facets.continued[side] as usize / 3;
            let [from, to] = facets.ends(side);
            if facets.continued[side] == NONE
                || found[..count].contains(&beyond)
                || (to - from).dot(&along).abs() < ACROSS * (to - from).norm()
                || facet_normal(facets.corners(beyond)).dot(&normal) < COPLANAR.cos()
            {
                continue;
            }
            if count == 2 {
                return true;
            }
            found[count] = beyond;
            count += 1;
        }
        next += 1;
    }
    false
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::geometry::adjacency::opposite_sides;

    /// A roof of two narrow facets between two wide sides that turn the other way, each in so many strips, and all in rows: the widths
    /// of the strips whose triangles may be of arcs, mm.
    fn widths_of_arcs(strips: u32, rows: u32) -> Vec<f64> {
        let wide = f64::from(strips) * 5.0;
        let mut profile: Vec<(f64, f64)> = (0..strips).map(|strip| (f64::from(strip) * 5.0, 0.0)).collect();
        profile.extend([(wide, 0.0), (wide + 0.3, 0.03), (wide + 0.6, 0.0)]);
        profile.extend((1..=strips).map(|strip| (wide + 0.6 + f64::from(strip) * 5.0, 0.0)));
        let row = |&(x, z): &(f64, f64)| (0..=rows).map(move |row| Point3::new(x, 20.0 * f64::from(row), z));
        let positions: Vec<_> = profile.iter().flat_map(row).collect();
        let triangles: Vec<[u32; 3]> = (0..profile.len() as u32 - 1)
            .flat_map(|column| (0..rows).map(move |row| column * (rows + 1) + row))
            .flat_map(|at| [[at, at + rows + 1, at + rows + 2], [at, at + rows + 2, at + 1]])
            .collect();
        let continued = opposite_sides(&triangles);
        let facets = Facets { positions: &positions, triangles: &triangles, continued: &continued };
        let is_ridge = |side: &usize| {
            facets.ends(*side).iter().all(|end| end.z > 0.01) && *side < continued[*side] as usize
        };
        let ridge = (0..continued.len()).find(is_ridge).map(|side| [side as u32, continued[side]]).unwrap();
        let mut widths: Vec<f64> = found(&facets, &[ridge])
            .iter()
            .map(|arc| {
                let x = facets.corners(arc.triangle).map(|corner| corner.x);
                x.into_iter().fold(0.0, f64::max) - x.into_iter().fold(f64::INFINITY, f64::min)
            })
            .collect();
        widths.sort_by(f64::total_cmp);
        widths.dedup_by(|one, other| (*one - *other).abs() < 1e-9);
        widths
    }

    /// A ridge between two sides of 20 mm that turn on into fillets, whose arcs begin where the sides end.
    #[test]
    fn a_side_that_a_fillet_leaves_nothing_of_its_turn_is_flat() {
        for (kink, facets) in [(4f64, 7u32), (6.0, 7), (8.0, 4)] {
            let lean = (kink / 2.0).to_radians();
            let step = (std::f64::consts::FRAC_PI_2 - lean) / f64::from(facets);
            let (mut half, mut at) = (vec![(0.0f64, 0.0f64)], (20.0 * lean.cos(), -20.0 * lean.sin()));
            half.push(at);
            for facet in 0..facets {
                let (angle, chord) = (lean + step * (f64::from(facet) + 0.5), 6.0 * (step / 2.0).sin());
                at = (at.0 + chord * angle.cos(), at.1 - chord * angle.sin());
                half.push(at);
            }
            let mirrored = half.iter().skip(1).rev().map(|&(x, z)| (-x, z));
            let profile: Vec<(f64, f64)> = mirrored.chain(half.iter().copied()).collect();
            let row = |&(x, z): &(f64, f64)| [0.0, 40.0].map(|y| Point3::new(x, y, z));
            let positions: Vec<_> = profile.iter().flat_map(row).collect();
            let triangles: Vec<[u32; 3]> = (0..profile.len() as u32 - 1)
                .flat_map(|at| [[2 * at, 2 * at + 2, 2 * at + 3], [2 * at, 2 * at + 3, 2 * at + 1]])
                .collect();
            let continued = opposite_sides(&triangles);
            let section = Facets { positions: &positions, triangles: &triangles, continued: &continued };
            let is_ridge = |side: &usize| {
                section.ends(*side).iter().all(|end| end.x == 0.0) && *side < continued[*side] as usize
            };
            let ridge =
                (0..continued.len()).find(is_ridge).map(|side| [side as u32, continued[side]]).unwrap();
            assert_eq!(found(&section, &[ridge]).len(), 0, "{kink} degrees in {facets}");
        }
    }

    #[test]
    fn a_polygon_beyond_an_arc_is_flat() {
        for rows in [1, 3] {
            let [arc, beyond] = widths_of_arcs(1, rows)[..] else { panic!("the sides may be arcs, too") };
            assert!((arc - 0.3).abs() < 1e-9 && beyond == 5.0);
            let only_the_roof = widths_of_arcs(4, rows);
            assert!(only_the_roof.len() == 1 && (only_the_roof[0] - 0.3).abs() < 1e-9, "{only_the_roof:?}");
        }
    }
}
