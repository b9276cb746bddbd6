//! Edges of the part that only its facets show, and that may be none: an arc that is cut into two facets has one corner, as a roof
//! has, where the arcs beyond it turn the other way and leave no corner there.
//!
//! The two chords of such an arc have one length. Each leaves the arc by half the turn between them at both ends, and what the
//! curve turns at their far ends besides is that of the chords beyond. A roof between flat sides has no such turns.

use nalgebra::Vector3;

use super::creases::Facing;
use super::sections::{Facets, turn};

/// CAD programs cut arcs into facets that turn by at most this, rad.
const MOST_TURN: f64 = 0.5;
/// Two chords are of one arc, or of one smooth curve, where their lengths differ by at most this factor.
const OF_ONE_CURVE: f64 = 1.6;
/// Pieces of a section that turn by less than this are in one plane, rad.
const COPLANAR: f64 = 0.25 * std::f64::consts::PI / 180.0;

/// The section on one side of an edge: the facet beside it, and the one beyond.
#[derive(Default)]
struct Beside {
    length: f64,
    /// The signed angle between the two, rad, if there is a second one.
    turn: Option<f64>,
    /// The triangles of both.
    triangles: [Vec<usize>; 2],
}

/// The slope of a triangle beside an edge that may be the corner of an arc, or beyond it.
pub(super) struct HiddenArc {
    pub(super) triangle: usize,
    /// The error of the slope if it is, rad, root mean square.
    pub(super) doubt: f64,
    /// The direction of the edge.
    pub(super) edge: Vector3<f64>,
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
                match (turned.abs() < COPLANAR, beside.turn) {
                    (true, None) => {
                        beside.length += piece.norm();
                        beside.triangles[0].push(triangle);
                    }
                    (false, None) => {
                        beside.turn = Some(turned);
                        beside.triangles[1].push(triangle);
                    }
                    (true, Some(_)) => beside.triangles[1].push(triangle),
                    (false, Some(_)) => return false,
                }
                true
            });
            beside
        });
        let turned = turn(-first[0], first[1], along);
        let [one, other] = beside.each_ref().map(|beside| beside.length);
        let goes_on = beside.iter().any(|beside| beside.turn.is_some());
        let is_even = one <= OF_ONE_CURVE * other && other <= OF_ONE_CURVE * one;
        if !goes_on || !is_even || turned.abs() > MOST_TURN {
            continue;
        }
        for (way, beside) in beside.iter().enumerate() {
            // The slope of an arc deviates from that of its chord by up to the lean, evenly along it.
            let mut add = |which: usize, lean: f64| {
                let doubt = lean.abs() / 3f64.sqrt();
                let beside = beside.triangles[which].iter();
                arcs.extend(beside.map(|&triangle| HiddenArc { triangle, doubt, edge: along }));
            };
            let lean = turned / 2.0;
            add(0, lean);
            // Sections on the two sides of the edge run opposite ways.
            let ahead = if way == 0 { -1.0 } else { 1.0 };
            if let Some(turn) = beside.turn {
                add(1, (ahead * turn - lean).clamp(-MOST_TURN / 2.0, MOST_TURN / 2.0));
            }
        }
    }
    arcs
}
