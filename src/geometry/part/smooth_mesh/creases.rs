//! Edges of a part that are no sharper than the steps between facets of a curved face. The facets beside a
//! step show whether it is an edge.
//!
//! A step between two facets of a curved face comes with similar steps before and after it. An edge of the
//! part stands alone, for example a ridge between two flat sides or the mitre of two fillets. A section
//! through the facets at right angles to the step shows the difference: its corner at the step is compared
//! with the next corners on both sides. A corner that turns back what the step turns explains the step only
//! as far as two arcs would. The tessellation has no more than one chord of each arc.

use std::f64::consts::PI;

use nalgebra::{Point3, Vector3};

use super::sections::{Facets, turn};
use crate::geometry::adjacency::{NONE, facet_normal, width};
use crate::geometry::fork::{Fork, mapped};

/// A step stands out if it turns by more than this many times the turn that the steps beside it explain, plus
/// [`LEAST`].
const STANDS_OUT: f64 = 4.0;
pub(super) const LEAST: f64 = 2.0 * PI / 180.0;
/// The factor instead of [`STANDS_OUT`] for a step that continues a known edge, or that is at a flat side.
const STILL_STANDS_OUT: f64 = 2.0;
/// The factor instead of [`STANDS_OUT`] for an edge that is known because its facets meet at a large angle.
const SHARP_STANDS_OUT: f64 = 2.5;
/// An edge runs out in a step that turns by more than this share of the explained turn.
const RUNS_OUT: f64 = 0.4;
/// An edge goes on in a step that turns by at least the first of these shares of the step before it, and runs
/// out in one that turns by less than the second.
const FADES: [f64; 2] = [0.25, 0.6];
/// At each step, the mitre of two fillets loses as much of its turn as the facets beside it turn by: between
/// these two multiples of the explained turn.
const LOSES: [f64; 2] = [0.5, 1.5];
/// An edge bends by at most this from one step to the next, rad.
const STRAIGHT: f64 = 35.0 * PI / 180.0;
/// An edge that ends within a smooth side has at least this many steps. Single steps that stand out are
/// accidents of a coarse mesh.
const LEAST_STEPS: usize = 3;
/// An edge that ends within a smooth side is more than this many times as long as the facets beside it are
/// high.
const LEAST_LENGTH: f64 = 4.0;
/// A step is skipped if it would bend a smooth surface by less than this, mm.
const PLAIN: f64 = 2e-3;
/// Two lengths are not from one evenly cut curve if one is more than this many times the other.
const UNEVEN: f64 = 2.5;
/// Each piece of an evenly cut curve is at most this many times as long as the others.
const LONGER: f64 = 1.25;
/// Widths are equal if the largest is less than this many times the smallest.
const EQUAL: f64 = 1.05;
/// The flat of a shaft has edges of at least this share of its width. The facet at the pole of a dome has shorter ones.
const STRIP: f64 = 0.75;
/// The sides of a prism are at least this many times as wide as the chamfers of its edges.
const CHAMFERED: f64 = 1.25;
/// On a regular prism, all sides are equally wide, all chamfers are equally wide, and all edges turn by the
/// same angle. In a section across an edge, these values differ by less than this factor. On a pyramid, the
/// other edges are oblique to the section.
const REGULAR: f64 = 1.1;
/// A turn by less than this, rad, may be rounding in any file.
const LEAST_CORNER: f64 = 2e-3;
/// Facets of a smooth curve turn by less than this, rad. If a section through a vertex turns by more, its
/// facets do not continue each other there.
const MOST_OF_CURVE: f64 = 60.0 * PI / 180.0;
/// At the ends of a straight row of facets, a smooth curve turns one way and back by less than this, rad. Its
/// two arcs would have one chord each, which leans by half of the turn of the arc, 45° at most.
const MOST_OF_SWAY: f64 = 22.5 * PI / 180.0;
/// The same limit as [`MOST_OF_SWAY`], rad, where the row between the ends is not cut. It would be cut
/// between two arcs.
const MOST_OF_SINGLE_SWAY: f64 = 15.0 * PI / 180.0;
/// The height of the facets of one row is at least this share of the way to the next corner.
const OF_ROW: f64 = 0.9;
/// The width of a row changes along a step by less than this share.
const OF_WIDTH: f64 = 0.3;
/// A corner of the section is skipped if it turns by less than this share of the turn of the step.
const NO_CORNER: f64 = 0.25;
/// A corner beside a step continues its bend if it turns the same way by more than this share of it.
const BENDING: f64 = 0.5;
/// The other end of a slope turns back by at least this share of the turn at its first, and at most as many times more.
const BACK: f64 = 0.6;
/// Where sections run across a step besides the one in its middle, as shares of its length.
const CUTS: [f64; 2] = [0.3, 0.7];
/// At most this many steps are looked at round one place, because edges do not meet by the hundred.
const MOST_AT_PLACE: usize = 64;

/// Two facing sides, the smaller number first.
pub(super) type Facing = [u32; 2];

/// The facets of a mesh and the steps between them that may be edges.
pub(super) struct Steps<'a> {
    /// Continued across all that is not known to be an edge.
    pub(super) facets: Facets<'a>,
    /// For each triangle the numbers of the places of its corners: the same for all vertices at one place.
    pub(super) places: &'a [[u32; 3]],
    /// What may be an edge, in rising order.
    pub(super) steps: &'a [Facing],
    /// Known edges.
    pub(super) edges: &'a [Facing],
    /// By how much the facets of two widths that take turns turn at least, rad, if they are of a prism.
    pub(super) turn_of_prism: f64,
    /// Standard deviation of the positions by the rounding of the file's numbers, mm.
    pub(super) rounding: f64,
}

/// What the section through a step shows.
#[derive(Clone)]
struct Measured {
    /// The angle between the facets, rad.
    turn: f64,
    /// What the corners beside it explain of that, rad.
    explained: f64,
    /// Mean height of the facets over the step, mm.
    height: f64,
    /// Whether there is nothing beside it that could explain anything: the part ends on both sides.
    is_alone: bool,
    /// Whether the section turns back on one side by about as much, and goes on the same way on neither: one end of a slope.
    ends_slope: bool,
    /// Whether it is between a flat and a curved side.
    is_at_flat: bool,
    /// Whether this flat may be one of a row of equal facets round a ball or a barrel.
    may_be_in_row: bool,
}

/// A flat beside a step.
struct AtFlat {
    /// How much of the step the curved side explains, rad, or half of what both sides explain.
    ///
    /// A tessellation limits the turn of its chords, or their distance from the curve. In both cases, its
    /// wide chords turn by no more than its narrow ones: a far wider one explains as much as a narrow one.
    /// Other facets that are equally wide may belong to one arc that is cut unevenly. They explain more, in
    /// proportion to their widths.
    explained: f64,
    /// Whether it may be one of a row of equal facets round a ball or a barrel.
    may_be_in_row: bool,
}

/// The section on one side of a step up to its third corner: lengths between the corners, mm, and by what angles they turn, rad.
struct Beside {
    lengths: [f64; 3],
    turns: [f64; 2],
    /// How many of the lengths are known.
    count: usize,
    goes_on: bool,
    /// The height of the facet over the step, mm.
    height: f64,
    /// Whether the pieces before the first two corners are those of rows of facets: about equally wide all along them.
    are_rows: [bool; 2],
}

/// Whether a step between facets of a curved surface, whose normals meet at a `cosine`, would matter; `side` is that of the
/// first facet.
pub(super) fn matters(cosine: f64, facets: impl Fn() -> [[Point3<f64>; 3]; 2], side: usize) -> bool {
    let squared_turn = 2.0 - 2.0 * cosine;
    let limit = (8.0 * PLAIN).powi(2);
    let beside = {
        let [one, _] = facets();
        (one[(side + 2) % 3] - one[side]).norm_squared()
    };
    if squared_turn * beside <= limit {
        return false;
    }
    let [one, other] = facets();
    let length = (one[(side + 1) % 3] - one[side]).norm_squared();
    let doubled_area = |[a, b, c]: [Point3<f64>; 3]| (b - a).cross(&(c - a)).norm_squared();
    squared_turn * doubled_area(one).min(doubled_area(other)) > limit * length
}

impl Measured {
    fn stands_out(&self, times: f64) -> bool {
        self.turn > times * self.explained + LEAST
    }

    /// Whether it stands out without a known edge that it continues. Beside a flat, nothing else explains it.
    fn stands_out_alone(&self) -> bool {
        self.stands_out(if self.is_at_flat { STILL_STANDS_OUT } else { STANDS_OUT })
    }
}

impl Steps<'_> {
    /// Those of the steps that are edges of the part, in rising order.
    pub(super) fn creases(&self, fork: &dyn Fork) -> Vec<Facing> {
        if self.steps.is_empty() {
            return Vec::new();
        }
        let ends = self.by_place(self.steps);
        let measured = mapped(fork, self.steps.len(), |number| {
            let step = self.measure(self.steps[number])?;
            let stays =
                step.stands_out_alone() || !step.ends_slope || !self.exceeds_limits(number, step.turn, &ends);
            Some(if stays { step } else { Measured { explained: 0.0, may_be_in_row: false, ..step } })
        });
        let mut is_crease = self.chains(&measured, &ends);
        let found = self.steps.iter().zip(&is_crease).filter(|(_, is_crease)| **is_crease);
        let sharp = self.edges.iter().filter(|&&edge| {
            let place = |end: usize| at_place(&ends, self.end_places(edge[0])[end]).next().is_some();
            let stands_out = |measured: Measured| measured.stands_out(SHARP_STANDS_OUT);
            (place(0) || place(1)) && self.measure(edge).is_some_and(stands_out)
        });
        let mut front: Vec<Facing> = found.map(|(step, _)| *step).chain(sharp.copied()).collect();
        while let Some(known) = front.pop() {
            let before = self.angle(known);
            for place in self.end_places(known[0]) {
                for number in at_place(&ends, place) {
                    let Some(step) = &measured[number] else { continue };
                    let loses = |times: f64| before - step.turn > times * step.explained;
                    let goes_on = step.turn > STILL_STANDS_OUT * step.explained
                        || (step.turn > step.explained && loses(LOSES[0]) && !loses(LOSES[1]));
                    let runs_out = step.turn > RUNS_OUT * step.explained && step.turn < FADES[1] * before;
                    if is_crease[number]
                        || step.turn < FADES[0] * before
                        || !(goes_on || runs_out)
                        || !self.runs_on(place, known[0], self.steps[number][0])
                    {
                        continue;
                    }
                    is_crease[number] = true;
                    if goes_on {
                        front.push(self.steps[number]);
                    }
                }
            }
        }
        self.steps.iter().zip(is_crease).filter(|(_, is_crease)| *is_crease).map(|(step, _)| *step).collect()
    }

    /// For each step whether it stands out together with others that continue it: from edge to edge of the part, from a known
    /// edge straight on, or over a long way.
    fn chains(&self, measured: &[Option<Measured>], ends: &[(u32, u32)]) -> Vec<bool> {
        let stands_out = |number: usize, is_alone: bool| {
            measured[number].as_ref().is_some_and(|step| {
                step.stands_out_alone()
                    && step.is_alone == is_alone
                    && !(step.may_be_in_row && self.is_bent(number, measured, ends))
            })
        };
        let numbers = || 0..self.steps.len();
        let in_company: Vec<bool> = numbers().map(|number| stands_out(number, false)).collect();
        // At the tip of a cone, the sections through some steps of a rim end, and those through others go round the tip.
        let is_between = |number: usize| {
            let side = self.steps[number][0];
            self.end_places(side).into_iter().all(|place| {
                let mut others = at_place(ends, place).filter(|&other| other != number && in_company[other]);
                others.any(|other| self.runs_on(place, side, self.steps[other][0]))
            })
        };
        let alone = |number: usize| {
            stands_out(number, true) && (!self.is_crossed(number, measured, ends) || is_between(number))
        };
        let stands_out: Vec<bool> = numbers().map(|number| in_company[number] || alone(number)).collect();
        let mut is_crease = vec![false; self.steps.len()];
        if !stands_out.contains(&true) {
            return is_crease;
        }
        let continued = self.facets.continued;
        let borders = (0..continued.len() as u32).filter(|&side| continued[side as usize] == NONE);
        let mut at_border: Vec<u32> = borders.flat_map(|side| self.end_places(side)).collect();
        at_border.sort_unstable();
        at_border.dedup();
        let edges = self.by_place(self.edges);
        let mut is_met = vec![false; self.steps.len()];
        let mut chain = Vec::new();
        for first in (0..self.steps.len()).filter(|&number| stands_out[number]) {
            if std::mem::replace(&mut is_met[first], true) {
                continue;
            }
            chain.clear();
            chain.push(first);
            let (mut at, mut length, mut height) = (0, 0.0, 0.0);
            let (mut is_closed, mut continues_edge) = (true, false);
            while at < chain.len() {
                let number = chain[at];
                at += 1;
                let side = self.steps[number][0];
                let [from, to] = self.facets.ends(side as usize);
                length += (to - from).norm();
                height += measured[number].as_ref().map_or(0.0, |step| step.height);
                for place in self.end_places(side) {
                    let mut goes_on = false;
                    for next in at_place(ends, place).filter(|&next| next != number && stands_out[next]) {
                        if self.runs_on(place, side, self.steps[next][0]) {
                            goes_on = true;
                            if !std::mem::replace(&mut is_met[next], true) {
                                chain.push(next);
                            }
                        }
                    }
                    let mut known = at_place(&edges, place).map(|edge| self.edges[edge][0]);
                    continues_edge |= known.any(|edge| self.runs_on(place, side, edge));
                    is_closed &= goes_on || at_border.binary_search(&place).is_ok();
                }
            }
            let count = chain.len();
            let is_long = count >= LEAST_STEPS && length * count as f64 > LEAST_LENGTH * height;
            if is_closed || continues_edge || is_long {
                chain.iter().for_each(|&number| is_crease[number] = true);
            }
        }
        is_crease
    }

    /// Whether another step meets one at an end and does not continue it, as on a small cap: one that turns by a notable share of its
    /// angle, and by which a smooth surface would bulge by a notable share.
    fn is_crossed(&self, number: usize, measured: &[Option<Measured>], ends: &[(u32, u32)]) -> bool {
        let side = self.steps[number][0];
        let of = |number: usize| {
            measured[number].as_ref().map_or([0.0; 2], |step| [step.turn, step.turn * step.height])
        };
        let [turn, bulge] = of(number);
        self.end_places(side).into_iter().any(|place| {
            at_place(ends, place).any(|other| {
                let [other_turn, other_bulge] = of(other);
                other != number
                    && STANDS_OUT * other_turn > turn
                    && STANDS_OUT * other_bulge > bulge
                    && !self.runs_on(place, side, self.steps[other][0])
            })
        })
    }

    /// Whether a step at a flat goes on in another direction along the next flat: a row of equal facets round a ball or a barrel.
    fn is_bent(&self, number: usize, measured: &[Option<Measured>], ends: &[(u32, u32)]) -> bool {
        let side = self.steps[number][0];
        self.end_places(side).into_iter().any(|place| {
            at_place(ends, place).any(|other| {
                let bend = self.bend(place, side, self.steps[other][0]);
                let is_at_flat = measured[other].as_ref().is_some_and(|step| step.is_at_flat);
                other != number && is_at_flat && (LEAST..STRAIGHT).contains(&bend)
            })
        })
    }

    /// The places at the ends of each of the `sides`, with its index, in order of the places.
    fn by_place(&self, sides: &[Facing]) -> Vec<(u32, u32)> {
        let ends = sides.iter().zip(0..).flat_map(|(side, index)| {
            let [one, other] = self.end_places(side[0]);
            [(one, index), (other, index)]
        });
        let mut ends: Vec<(u32, u32)> = ends.collect();
        ends.sort_unstable();
        ends
    }

    pub(super) fn end_places(&self, side: u32) -> [u32; 2] {
        let (places, first) = (self.places[side as usize / 3], side as usize % 3);
        [places[first], places[(first + 1) % 3]]
    }

    /// Whether two sides that meet at a place nearly continue each other there.
    pub(super) fn runs_on(&self, place: u32, one: u32, other: u32) -> bool {
        self.bend(place, one, other) < STRAIGHT
    }

    /// The angle between the directions of two sides that meet at a place, rad; 0 if one continues the other straight.
    pub(super) fn bend(&self, place: u32, one: u32, other: u32) -> f64 {
        (-self.away(place, one)).angle(&self.away(place, other))
    }

    /// The way from a place at an end of a side to its other end, mm.
    pub(super) fn away(&self, place: u32, side: u32) -> Vector3<f64> {
        let [from, to] = self.facets.ends(side as usize);
        if self.end_places(side)[0] == place { to - from } else { from - to }
    }

    /// The angle between the facets at two facing sides, rad.
    fn angle(&self, facing: Facing) -> f64 {
        let [one, other] = facing.map(|side| facet_normal(self.facets.corners(side as usize / 3)));
        one.angle(&other)
    }

    /// What the sections show of a step.
    fn measure(&self, step: Facing) -> Option<Measured> {
        let measured = self.measure_curved(step)?;
        if measured.stands_out(STANDS_OUT) {
            return Some(measured);
        }
        match self.beside_flat(step, measured.turn) {
            Some(AtFlat { explained, may_be_in_row }) => {
                Some(Measured { explained, is_at_flat: true, may_be_in_row, ..measured })
            }
            None => Some(measured),
        }
    }

    /// The flat side beside a step of a curve, if there is one. It is equally wide all along the step, as on
    /// a shaft, or far wider than the pieces of the curve, as the floor of a bowl is.
    fn beside_flat(&self, step: Facing, turned: f64) -> Option<AtFlat> {
        let [from, to] = self.facets.ends(step[0] as usize);
        let along = (to - from).try_normalize(0.0)?;
        let (mut of_curve, mut by_curvature, mut widths) = (0.0_f64, 0.0_f64, [f64::INFINITY, 0.0]);
        let (mut is_far_wider, mut are_rows) = (true, true);
        for share in [0.5].iter().chain(&CUTS) {
            let start = from + (to - from) * *share;
            // Fine steps of the curved side are no corners beside a much larger one.
            let found = [turned * NO_CORNER, LEAST_CORNER].into_iter().find_map(|least| {
                let beside = step.map(|side| self.beside(side, start, along, least));
                let flat = [0, 1].into_iter().find(|&side| beside[side].starts_flat(&beside[1 - side]))?;
                let [flat, curve] = [&beside[flat], &beside[1 - flat]];
                Some((
                    flat.lengths[0],
                    flat.times_as_long(curve),
                    curve.explains_at_flat()?,
                    curve.are_rows[0],
                ))
            });
            let (width, times, explained, is_row) = found?;
            of_curve = of_curve.max(explained);
            by_curvature = by_curvature.max(explained * (1.0 + times) / 2.0);
            widths = [widths[0].min(width), widths[1].max(width)];
            is_far_wider &= times > UNEVEN;
            are_rows &= is_row;
        }
        let is_even = widths[1] < EQUAL * widths[0];
        let is_strip = is_even && (to - from).norm() > STRIP * widths[1];
        let explained = match is_strip || is_far_wider && are_rows {
            true => of_curve,
            false if is_even && are_rows => by_curvature,
            false => return None,
        };
        let is_known = are_rows && (is_far_wider || turned > STILL_STANDS_OUT * by_curvature + LEAST);
        Some(AtFlat { explained, may_be_in_row: !is_known })
    }

    /// What the sections show of a step of a curve: the one in its middle, or, where the step stands out there, of several the one
    /// that explains most.
    fn measure_curved(&self, step: Facing) -> Option<Measured> {
        let middle = self.measure_at(step, 0.5);
        if middle.as_ref().is_some_and(|middle| !middle.stands_out(STILL_STANDS_OUT)) {
            return middle;
        }
        let left = |step: &Measured| step.turn - STANDS_OUT * step.explained;
        let others = CUTS.iter().filter_map(|&share| self.measure_at(step, share));
        others.chain(middle).min_by(|one, other| left(one).total_cmp(&left(other)))
    }

    fn measure_at(&self, step: Facing, share: f64) -> Option<Measured> {
        let [from, to] = self.facets.ends(step[0] as usize);
        let along = (to - from).try_normalize(0.0)?;
        let start = from + (to - from) * share;
        let [one, other] = step.map(|side| self.first_piece(side, start, along));
        let (one, other) = (one?, other?);
        let turned = turn(-one, other, along);
        let beside = step.map(|side| self.beside(side, start, along, turned.abs() * NO_CORNER));
        // The section runs away from the step on both sides.
        let ahead = |side: usize| if side == 0 { -turned } else { turned };
        let known = [0, 1].map(|side| {
            if beside[side].turns_back(ahead(side)) { Some(0.0) } else { beside[side].explains() }
        });
        // A side of which nothing is known is like the other side.
        let like = |side: usize| {
            let lengths = [side, 1 - side].map(|side| beside[side].lengths[0]);
            known[1 - side].map_or(0.0, |explained| explained * (lengths[0] / lengths[1]).min(1.0))
        };
        let is_of_prism = turned.abs() > self.turn_of_prism && is_of_chamfered_prism(turned, &beside);
        let explained =
            [0, 1].map(|side| if is_of_prism { 0.0 } else { known[side].unwrap_or_else(|| like(side)) });
        let height = (one.norm() + other.norm()) / 2.0;
        Some(Measured {
            turn: turned.abs(),
            explained: explained[0] + explained[1],
            height,
            is_alone: known == [None; 2],
            ends_slope: ends_slope([0, 1].map(|side| beside[side].turns.map(|turn| turn / ahead(side)))),
            is_at_flat: false,
            may_be_in_row: false,
        })
    }

    fn first_piece(&self, side: u32, start: Point3<f64>, across: Vector3<f64>) -> Option<Vector3<f64>> {
        let mut first = None;
        self.facets.section_from(side as usize, start, across, |_, piece| {
            first = Some(piece);
            false
        });
        first
    }

    /// The section from a step on; what turns by less than `least` is no corner, rad.
    fn beside(&self, side: u32, start: Point3<f64>, across: Vector3<f64>, least: f64) -> Beside {
        let (mut lengths, mut turns, mut count) = ([0.0; 3], [0.0; 2], 0);
        let [from, to] = self.facets.ends(side as usize);
        let (mut edge, mut are_rows) = (to - from, [false; 2]);
        let mut last: Option<(usize, Vector3<f64>)> = None;
        let mut ends = false;
        let goes_on = self.facets.section_from(side as usize, start, across, |triangle, piece| {
            let before = last.replace((triangle, piece));
            let turned = before.map_or(f64::INFINITY, |(_, last)| turn(last, piece, across));
            // Across the tip of a cone, the section is that of another side.
            ends = before.is_some() && turned.abs() > MOST_OF_CURVE;
            if ends {
                return false;
            }
            if !(turned.abs() <= least) {
                if count == lengths.len() {
                    return false;
                }
                if let Some((before, _)) = before
                    && let Some(is_row) = are_rows.get_mut(count - 1)
                {
                    let next = self.edge_between(before, triangle).unwrap_or_else(Vector3::zeros);
                    let change = edge.cross(&next).norm() / next.norm();
                    *is_row = change < OF_WIDTH * lengths[count - 1];
                    edge = next;
                }
                if count > 0 {
                    turns[count - 1] = turned;
                }
                count += 1;
            }
            lengths[count - 1] += piece.norm();
            true
        });
        let height = width(self.facets.corners(side as usize / 3), side as usize % 3);
        Beside { lengths, turns, count, goes_on: goes_on && !ends, height, are_rows }
    }

    /// The side of one triangle that another one continues, mm.
    fn edge_between(&self, one: usize, other: usize) -> Option<Vector3<f64>> {
        let continues = |side: &usize| self.facets.continued[*side] as usize / 3 == other;
        let [from, to] = self.facets.ends((3 * one..3 * one + 3).find(continues)?);
        Some(to - from)
    }
}

/// Whether a step ends a slope: by the turns at the next two corners on both sides, as shares of that of the step, which are positive
/// where they go on the same way.
fn ends_slope(shares: [[f64; 2]; 2]) -> bool {
    let turns_back = |[near, far]: [f64; 2]| {
        let is_back = |share: f64| (BACK..1.0 / BACK).contains(&-share);
        is_back(near) || near.abs() < BENDING && is_back(far)
    };
    shares.iter().all(|[near, _]| *near <= BENDING) && shares.into_iter().any(turns_back)
}

/// Whether two turns, or two widths, may be the same on a regular prism or pyramid.
pub(super) fn are_of_regular_prism(one: f64, other: f64) -> bool {
    one < REGULAR * other && other < REGULAR * one
}

/// Whether a step that `turned`, rad, is an edge of a regular prism or pyramid with few sides and chamfered edges: wide and narrow facets
/// take turns `beside` it.
fn is_of_chamfered_prism(turned: f64, beside: &[Beside; 2]) -> bool {
    let [one, other] = beside;
    let lengths = [one.lengths, other.lengths];
    let wider = (lengths[0][0] / lengths[1][0]).max(lengths[1][0] / lengths[0][0]);
    let turns_on = |side: usize| {
        let Beside { turns, count, .. } = &beside[side];
        // The section runs away from the step on both sides.
        let ahead = if side == 0 { -turned } else { turned };
        let is_next = |turn: f64| turn * ahead > 0.0 && are_of_regular_prism(turn.abs(), turned.abs());
        *count > 1 && is_next(turns[0]) && are_of_regular_prism(lengths[side][1], lengths[1 - side][0])
    };
    let goes_on = |side: usize| {
        let Beside { turns, count, .. } = &beside[side];
        *count > 2
            && are_of_regular_prism(turns[1].abs(), turned.abs())
            && are_of_regular_prism(lengths[side][2], lengths[side][0])
    };
    wider >= CHAMFERED && turns_on(0) && turns_on(1) && (goes_on(0) || goes_on(1))
}

/// The indices that belong to a place.
pub(super) fn at_place(ends: &[(u32, u32)], place: u32) -> impl Iterator<Item = usize> {
    let first = ends.partition_point(|end| end.0 < place);
    let here = ends[first..].iter().take_while(move |end| end.0 == place);
    here.take(MOST_AT_PLACE).map(|end| end.1 as usize)
}

impl Beside {
    /// Whether the first piece is longer than the next ones on both sides of it. It must be longer by more if
    /// these are less equal: a curve is cut evenly, or finer where something is cut out of it. The flat of a
    /// shaft has its edges on the cylinder, and its angles show no more than a chord. If the section ends
    /// beyond the piece, nothing shows how equal the next ones are.
    fn starts_flat(&self, other: &Self) -> bool {
        let [shortest, longest] = self.beside_flat(other);
        other.count > 1 && self.lengths[0] > longest * (LONGER * longest / shortest).min(UNEVEN)
    }

    /// How many times the first piece is as long as the longest of the next ones on both sides of it.
    fn times_as_long(&self, other: &Self) -> f64 {
        let [_, longest] = self.beside_flat(other);
        self.lengths[0] / longest
    }

    /// The shortest and the longest of the next pieces on both sides of the first one, mm; 0 where there is none.
    fn beside_flat(&self, other: &Self) -> [f64; 2] {
        let [_, next @ ..] = self.lengths;
        let beside = next.into_iter().chain(other.lengths.into_iter().take(2));
        beside.fold([f64::INFINITY, 0.0], |[low, high], length| [low.min(length), high.max(length)])
    }

    /// Whether the section turns back by the angle of the step `turned`, rad, after one row of facets, and
    /// then continues straight: the two edges of a sloping side between flatter ones.
    fn turns_back(&self, turned: f64) -> bool {
        let [back, far] = [-self.turns[0] * turned.signum(), self.turns[1].abs()];
        let is_single = self.height > OF_ROW * self.lengths[0];
        let most = if is_single { MOST_OF_SINGLE_SWAY } else { MOST_OF_SWAY };
        let goes_straight_on = self.lengths[1] > UNEVEN * self.lengths[0] || back > STANDS_OUT * far;
        self.are_rows[0] && goes_straight_on && back > 0.0 && back.max(turned.abs()) > most
    }

    /// What the corners explain of the step at the section's start, rad. `None` where the section ends before a corner.
    fn explains(&self) -> Option<f64> {
        Some(self.explains_by_near()?.max(self.explains_by_far()))
    }

    /// The same beside a flat, where a far corner that is an edge explains nothing.
    fn explains_at_flat(&self) -> Option<f64> {
        let [near, far] = self.turns.map(f64::abs);
        let is_edge = far > STILL_STANDS_OUT * near + LEAST;
        if is_edge { self.explains_by_near() } else { self.explains() }
    }

    /// What the next corner explains of the step at the section's start, rad: on a curve that is cut evenly half of it, and
    /// where lengths differ much the shorter piece is the curved one.
    fn explains_by_near(&self) -> Option<f64> {
        let is_even = |one: f64, other: f64| one < UNEVEN * other && other < UNEVEN * one;
        let ([first, second, third], [near, far]) = (self.lengths, self.turns.map(f64::abs));
        let is_swaying =
            self.turns[0] * self.turns[1] < 0.0 && near.max(far) > MOST_OF_SWAY && self.are_rows[1];
        if self.count < 2 {
            return self.goes_on.then_some(0.0);
        }
        let has_far = self.count > 2;
        // What the far corner shows of the second piece's own curvature.
        let of_second = match has_far {
            true if is_even(second, third) => Some(far * second / (second + third)),
            true if third > second => Some(far),
            _ => None,
        };
        let explained = match of_second {
            _ if is_even(first, second) => near * (first / (first + second)).max(0.5),
            // Both corners are of the second piece, to and fro.
            Some(_) if first > second && is_swaying => 0.0,
            Some(of_second) => (near - of_second).max(0.0),
            None if first > second => 0.0,
            None => near,
        };
        Some(explained)
    }

    /// What the far corner explains of the step on a curve that is cut evenly, rad.
    fn explains_by_far(&self) -> f64 {
        let [first, second, third] = self.lengths;
        let is_even = |one: f64, other: f64| one < UNEVEN * other && other < UNEVEN * one;
        let is_evenly_cut = self.count > 2 && is_even(first, second) && is_even(second, third);
        if is_evenly_cut { self.turns[1].abs() * first / (second + third) } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::super::SmoothMesh;
    use super::*;
    use crate::geometry::mesh::TriMesh;
    use crate::geometry::space::View;

    /// A curve that begins at a distance from the axis with a slope, deg, and goes on in arcs: each of a radius, mm, and so many chords
    /// that turn by so much, deg. Places across and along the axis, mm.
    fn profile(start: f64, slope: f64, arcs: &[(f64, u32, f64)]) -> Vec<[f64; 2]> {
        let (mut at, mut slope) = ([start, 0.0], slope.to_radians());
        let mut places = vec![at];
        for &(radius, chords, step) in arcs {
            let step = step.to_radians();
            for _ in 0..chords {
                let next = slope + step;
                at[0] += radius * (next.sin() - slope.sin());
                at[1] += radius * (slope.cos() - next.cos());
                slope = next;
                places.push(at);
            }
        }
        places
    }

    /// The part that a profile gives about the z axis, without normals; its first place is the rim of a polygon.
    fn turned(profile: &[[f64; 2]], sectors: u32) -> SmoothMesh {
        let place = |&[across, along]: &[f64; 2]| {
            (0..sectors).map(move |sector| {
                let angle = f64::from(sector) / f64::from(sectors) * TAU;
                Point3::new(across * angle.cos(), across * angle.sin(), along)
            })
        };
        let positions: Vec<_> = profile.iter().flat_map(place).collect();
        let rows = (1..profile.len() as u32).map(|row| row * sectors);
        let cells = rows.flat_map(|outer| {
            (0..sectors).map(move |sector| [sector, (sector + 1) % sectors].map(|sector| outer + sector))
        });
        let mut triangles: Vec<[u32; 3]> = cells
            .flat_map(|[a, b]| [[a - sectors, a, b], [a - sectors, b, b - sectors]])
            .chain((2..sectors).map(|sector| [0, sector - 1, sector]))
            .collect();
        // The profile runs outwards, so that this is the upper side.
        triangles.sort_unstable();
        SmoothMesh::new(&TriMesh::new(positions, Vec::new(), triangles).unwrap(), &View::top())
    }

    /// The same profile about the x axis, mirrored at its first place, which is half of a straight side, and without ends.
    fn band(half: f64, profile: &[[f64; 2]], sectors: u32) -> SmoothMesh {
        let [radius, _] = profile[0];
        // Across and along change places: the profile begins along the axis.
        let right = profile.iter().map(|[along, across]| [half + along - radius, radius - across]);
        let left: Vec<[f64; 2]> = right.clone().map(|[along, across]| [-along, across]).collect();
        let places: Vec<[f64; 2]> = left.into_iter().rev().chain(right).collect();
        let place = |&[along, across]: &[f64; 2]| {
            (0..sectors).map(move |sector| {
                let angle = f64::from(sector) / f64::from(sectors) * TAU;
                Point3::new(along, across * angle.cos(), across * angle.sin())
            })
        };
        let positions: Vec<_> = places.iter().flat_map(place).collect();
        let triangles: Vec<[u32; 3]> = (1..places.len() as u32)
            .flat_map(|row| (0..sectors).map(move |sector| (row * sectors, sector, (sector + 1) % sectors)))
            .flat_map(|(row, one, next)| {
                let [a, b, c, d] = [row - sectors + one, row + one, row + next, row - sectors + next];
                [[a, c, b], [a, d, c]]
            })
            .collect();
        SmoothMesh::new(&TriMesh::new(positions, Vec::new(), triangles).unwrap(), &View::top())
    }

    fn corners_of(mesh: &SmoothMesh, is_chosen: impl Fn(&Point3<f64>) -> bool) -> Vec<usize> {
        let is_chosen = |&triangle: &usize| mesh.corners(triangle).0.iter().all(&is_chosen);
        (0..mesh.triangles.len()).filter(is_chosen).collect()
    }

    #[test]
    fn a_flat_floor_ends_at_an_edge_that_turns_by_more_than_the_wall_does() {
        // Slope at the edge and turn of a chord, deg; radius of the floor and of the wall, mm; chords.
        for (slope, step, floor, wall, chords) in [
            (28.4, 12.4, 9.0, 22.0, 4),
            (21.3, 9.8, 4.3, 8.6, 2),
            (29.0, 17.2, 6.7, 7.7, 2),
            (9.5, 11.4, 34.9, 56.6, 4),
            (8.9, 11.7, 7.6, 11.0, 2),
        ] {
            for sign in [1.0, -1.0] {
                let arc = profile(floor, slope, &[(wall, chords, step)]);
                let arc: Vec<_> = arc.into_iter().map(|[across, along]| [across, sign * along]).collect();
                for sectors in [19, 24] {
                    let dish = turned(&arc, sectors);
                    let flat = corners_of(&dish, |corner| corner.z.abs() < 1e-9);
                    assert_eq!(flat.len(), sectors as usize - 2);
                    for triangle in flat {
                        assert!(dish.corners(triangle).1.iter().all(|normal| (normal.z - 1.0).abs() < 1e-12));
                        assert_eq!(dish.slope_doubts.get(triangle).copied().unwrap_or(0.0), 0.0);
                    }
                    assert_eq!(
                        dish.regions.iter().max(),
                        Some(&1),
                        "{slope} {step} {floor} {wall} {sectors}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_straight_side_ends_at_an_edge_that_turns_by_more_than_the_shoulder_does() {
        // Half of the side, its radius, the slope at the edge and the turn of a chord, deg, the radius of the shoulder, chords.
        for (half, radius, slope, step, shoulder, chords) in [
            (12.1, 23.8, 12.7, 5.6, 40.0, 2),
            (6.9, 20.3, 18.3, 10.3, 15.0, 4),
            (6.9, 19.8, 16.4, 8.7, 39.0, 3),
        ] {
            let arc = profile(radius, slope, &[(shoulder, chords, step)]);
            let can = band(half, &arc, 24);
            for triangle in corners_of(&can, |corner| corner.x.abs() < half + 1e-9) {
                assert!(can.corners(triangle).1.iter().all(|normal| normal.x.abs() < 1e-9));
            }
            assert_eq!(can.regions.iter().max(), Some(&2), "{half} {radius} {slope} {step}");
        }
    }

    #[test]
    fn a_curve_goes_on_in_chords_of_other_lengths() {
        let is_one = |mesh: &SmoothMesh| mesh.regions.iter().max() == Some(&0);
        for sectors in [19, 24] {
            // Flat, and round with the same turn as the far narrower chords beside it.
            assert!(is_one(&turned(&profile(9.0, 0.0, &[(6.0, 4, 12.4)]), sectors)));
            assert!(is_one(&turned(&profile(9.0, 6.2, &[(6.0, 4, 12.4)]), sectors)));
            assert!(is_one(&band(12.0, &profile(20.0, 0.0, &[(8.0, 4, 9.0)]), sectors)));
            assert!(is_one(&band(12.0, &profile(20.0, 4.5, &[(8.0, 4, 9.0)]), sectors)));
            // One arc in chords of which the middle one is 2.2 times as long.
            let half = 40.0 * 6.6f64.to_radians().sin();
            assert!(is_one(&band(half, &profile(20.0, 6.6, &[(40.0, 3, 6.0)]), sectors)));
        }
    }
}
