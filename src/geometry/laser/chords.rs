//! Chords as long on the part as the curves that they replace.
//!
//! A polyline with its vertices on a curve is shorter than the curve. With its vertices a little outside, it is as long, and
//! its greatest distance from the curve falls to two thirds: on a circle of radius R, with chords that turn by θ, vertices at
//! R (θ/2) / sin(θ/2) give the true perimeter, and half the error of area.

use nalgebra::Vector2;

use crate::geometry::mapping::quality::Shortening;
use crate::geometry::space::FlatPoint;

/// A share of a length that is only rounding.
const ROUNDING: f64 = 1e-9;
/// A chord that is shorter than its line by a smaller share replaces a straight line.
pub(super) const STRAIGHT: f64 = 1e-7;
/// The chords replace noise if a vertex would have to move by more than this share. On a smooth curve, a
/// vertex moves by the length of a chord times its turn, divided by 24. Between the only two chords of a
/// curve it moves by twice as much.
const SMOOTH: f64 = 0.125;
/// Vertices that would have to move too far are searched for in this many passes. The vertices that the
/// passes miss move back at the end.
const PASSES: usize = 8;
/// Each chord approaches the length of its piece of the curve in this many rounds; each round squares the
/// error.
const ROUNDS: usize = 3;

/// A polyline that replaces drawn curves.
pub(super) struct Chords {
    /// The vertices, mm; the first and the last of a closed polyline are the same point.
    pub(super) vertices: Vec<FlatPoint>,
    /// The length of the curve for each chord, mm.
    pub(super) drawn: Vec<f64>,
    /// The length that each chord needs to mark that of its curve, mm: less where the field bends it.
    pub(super) goals: Vec<f64>,
    /// The largest share of what each chord misses of its curve that the mark may miss, too, if no vertex moves: 0 where the line
    /// of the field is the image of the curve.
    pub(super) missed: Vec<f64>,
    /// By how much the mark of each chord is longer than the straight line that it is drawn for, mm; 0 for chords of curves.
    pub(super) longer: Vec<f64>,
    /// Whether the vertex may move.
    pub(super) is_free: Vec<bool>,
    /// Whether the first vertex follows the last chord.
    pub(super) is_closed: bool,
}

impl Chords {
    /// Moves free vertices to the outside of the curve, and slightly along it, such that each chord is as
    /// long as its piece of the curve. No vertex moves by more than `most` mm. Some vertices stay: those
    /// beside straight lines, those beside chords that their curve crosses, and those of chords that replace
    /// noise. Chords between two such vertices remain shorter than the curve.
    pub(super) fn lengthen(&mut self, most: f64) {
        let Some(last) = self.vertices.len().checked_sub(1).filter(|last| *last > 1) else {
            self.is_free.fill(false);
            return;
        };
        let turns: Vec<f64> = (0..=last).map(|vertex| self.turn(vertex)).collect();
        // The curve of a chord that turns to opposite sides at its ends crosses it: outside is on both sides.
        let bends = |chord: usize| {
            self.missing(chord) > STRAIGHT * self.drawn[chord] && turns[chord] * turns[chord + 1] >= 0.0
        };
        let bends: Vec<bool> = (0..last).map(bends).collect();
        for vertex in 0..=last {
            let is_inside = self.is_closed || (vertex > 0 && vertex < last);
            self.is_free[vertex] &= is_inside && self.chords_at(vertex).iter().all(|chord| bends[*chord]);
        }
        if self.is_closed {
            let is_free = self.is_free[0] && self.is_free[last];
            (self.is_free[0], self.is_free[last]) = (is_free, is_free);
        }
        // A vertex that stays leaves more to its neighbours.
        let mut limits = vec![0.0; last + 1];
        for _ in 0..PASSES {
            let mut is_settled = true;
            for vertex in 0..=last {
                limits[vertex] = self.farthest(vertex);
                let stays = self.is_free[vertex] && !(self.step(vertex).norm() <= limits[vertex].min(most));
                self.is_free[vertex] &= !stays;
                is_settled &= !stays;
            }
            if is_settled {
                break;
            }
        }
        let inscribed = self.vertices.clone();
        for _ in 0..ROUNDS {
            let steps: Vec<Vector2<f64>> = (0..=last).map(|vertex| self.step(vertex)).collect();
            self.vertices.iter_mut().zip(steps).for_each(|(vertex, step)| *vertex = *vertex + step);
        }
        for (vertex, inscribed) in inscribed.into_iter().enumerate() {
            // What is not a number is rejected, too.
            if !(self.vertices[vertex].distance(inscribed) <= most.min(1.5 * limits[vertex])) {
                self.vertices[vertex] = inscribed;
                self.is_free[vertex] = false;
            }
        }
    }

    /// By how much the chords differ from their curves, before any vertex moves.
    pub(super) fn inscribed(&self) -> Shortening {
        self.differing(|chord| self.drawn[chord] - self.length(chord))
    }

    /// The same after [`lengthen`](Self::lengthen). Chords whose ends stayed miss as much as their curves show where the field does
    /// not bend them.
    pub(super) fn shortening(&self) -> Shortening {
        self.differing(|chord| {
            let missing = match self.is_free[chord] || self.is_free[chord + 1] {
                true => self.missing(chord),
                false => (self.drawn[chord] - self.length(chord)) * self.missed[chord],
            };
            missing.abs() + self.longer[chord]
        })
    }

    fn differing(&self, missing: impl Fn(usize) -> f64) -> Shortening {
        let mut shortening = Shortening::default();
        for (chord, drawn) in self.drawn.iter().enumerate() {
            let missing = missing(chord).abs();
            if missing > ROUNDING * drawn {
                shortening.lost += missing;
                shortening.largest_share = shortening.largest_share.max(missing / drawn);
            }
        }
        shortening
    }

    fn length(&self, chord: usize) -> f64 {
        self.vertices[chord].distance(self.vertices[chord + 1])
    }

    /// By how much a chord is shorter than its goal, mm.
    fn missing(&self, chord: usize) -> f64 {
        self.goals[chord] - self.length(chord)
    }

    /// The chords before and after a vertex.
    fn chords_at(&self, vertex: usize) -> [usize; 2] {
        let last = self.vertices.len() - 1;
        [if vertex == 0 { last - 1 } else { vertex - 1 }, if vertex == last { 0 } else { vertex }]
    }

    /// The turn at a vertex, as a sine: positive to the left; 0 at the ends of an open polyline.
    fn turn(&self, vertex: usize) -> f64 {
        let is_end = vertex == 0 || vertex + 1 == self.vertices.len();
        if is_end && !self.is_closed {
            return 0.0;
        }
        let ([before, after], _) = self.directions(vertex);
        before.perp(&after)
    }

    /// The directions of the chords before and after a vertex, and their mean length, mm.
    fn directions(&self, vertex: usize) -> ([Vector2<f64>; 2], f64) {
        let chords = self.chords_at(vertex).map(|chord| self.vertices[chord + 1] - self.vertices[chord]);
        (chords.map(|chord| chord.normalize()), 0.5 * (chords[0].norm() + chords[1].norm()))
    }

    /// How far a vertex of a smooth curve may move, mm.
    fn farthest(&self, vertex: usize) -> f64 {
        let ([before, after], length) = self.directions(vertex);
        SMOOTH * length * (after - before).norm()
    }

    /// The movement of a vertex that makes up for what its two chords miss, to first order. A chord asks its free ends alike.
    fn step(&self, vertex: usize) -> Vector2<f64> {
        if !self.is_free[vertex] {
            return Vector2::zeros();
        }
        let [share_before, share_after] = self.chords_at(vertex).map(|chord| {
            let ends = [chord, chord + 1].into_iter().filter(|end| self.is_free[*end]).count();
            self.missing(chord) / ends.max(1) as f64
        });
        // Along the chord before and against the one after, the movement is as long as their shares.
        let ([before, after], _) = self.directions(vertex);
        let across = |direction: Vector2<f64>| Vector2::new(direction.y, -direction.x);
        (across(after) * share_before + across(before) * share_after) / before.perp(&after)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// Vertices on a curve at equal steps of its parameter from 0 to 1.
    fn on_curve(curve: impl Fn(f64) -> [f64; 2], count: usize, is_closed: bool) -> Chords {
        let at = |share: f64| curve(share).into_point();
        let fine = |chord: usize, step: usize| at((chord as f64 + step as f64 / 1000.0) / count as f64);
        let length =
            |chord: usize| (0..1000).map(|step| fine(chord, step).distance(fine(chord, step + 1))).sum();
        let mut vertices: Vec<FlatPoint> = (0..=count).map(|step| at(step as f64 / count as f64)).collect();
        if is_closed {
            vertices[count] = vertices[0];
        }
        let drawn: Vec<f64> = (0..count).map(length).collect();
        let (goals, missed, longer) = (drawn.clone(), vec![1.0; count], vec![0.0; count]);
        Chords { vertices, goals, missed, longer, drawn, is_free: vec![true; count + 1], is_closed }
    }

    trait IntoPoint {
        fn into_point(self) -> FlatPoint;
    }

    impl IntoPoint for [f64; 2] {
        fn into_point(self) -> FlatPoint {
            FlatPoint::new(self[0], self[1])
        }
    }

    fn length(chords: &Chords) -> f64 {
        chords.vertices.windows(2).map(|ends| ends[0].distance(ends[1])).sum()
    }

    fn circle(radius: f64, turn: f64) -> impl Fn(f64) -> [f64; 2] {
        move |share| [radius * (turn * share).cos(), radius * (turn * share).sin()]
    }

    #[test]
    fn a_ring_of_chords_has_the_circumference_of_its_circle() {
        for count in [6, 18, 71] {
            let mut chords = on_curve(circle(10.0, TAU), count, true);
            let inscribed = chords.inscribed().lost;
            chords.lengthen(1.0);
            assert!((length(&chords) - 10.0 * TAU).abs() < 1e-3 * inscribed + 1e-5, "{count}");
            assert!(chords.shortening().lost < 1e-3 * inscribed + 1e-4, "{count}");
            let half = TAU / 2.0 / count as f64;
            let radius = 10.0 * half / half.sin();
            assert!(chords.vertices.iter().all(|at| (at.coords().norm() - radius).abs() < 1e-6));
            assert_eq!(chords.vertices[0], chords.vertices[count]);
        }
    }

    #[test]
    fn an_arc_keeps_its_ends_and_gets_its_length() {
        for count in [2, 3, 5, 20] {
            let mut chords = on_curve(circle(4.0, 1.5), count, false);
            let ends = [chords.vertices[0], chords.vertices[count]];
            let before = chords.inscribed();
            let sagitta = 4.0 * (1.0 - (0.75 / count as f64).cos());
            chords.lengthen(sagitta);
            assert_eq!(ends, [chords.vertices[0], chords.vertices[count]]);
            assert!(
                (length(&chords) - 6.0).abs() < 1e-9 + 1e-3 * before.lost,
                "{count}: {}",
                length(&chords)
            );
            let outside = chords.vertices.iter().map(|at| at.coords().norm() - 4.0);
            assert!(outside.fold(0.0, f64::max) < 0.7 * sagitta, "{count}");
            assert!(chords.shortening().lost < 1e-3 * before.lost + 1e-9, "{count}");
        }
    }

    #[test]
    fn ellipses_and_waves_get_their_lengths() {
        let ellipse = |share: f64| [8.0 * (TAU * share).cos(), 3.0 * (TAU * share).sin()];
        let wave = |share: f64| [20.0 * share, (2.0 * TAU * share).sin()];
        for (mut chords, limit) in [(on_curve(ellipse, 40, true), 0.02), (on_curve(wave, 61, false), 0.2)] {
            let (drawn, inscribed) = (chords.drawn.iter().sum::<f64>(), length(&chords));
            chords.lengthen(1.0);
            let left = (drawn - length(&chords)).abs() / (drawn - inscribed);
            assert!(left < limit, "{left} of the shortening is left");
        }
    }

    #[test]
    fn fixed_vertices_lines_and_noise_stay() {
        // 10 mm of a straight line that leads into an arc of radius 2 mm.
        let mut chords = on_curve(circle(2.0, 1.0), 4, false);
        chords.vertices.insert(0, FlatPoint::new(2.0, -10.0));
        chords.drawn.insert(0, 10.0);
        chords.goals.insert(0, 10.0);
        chords.missed.insert(0, 1.0);
        chords.is_free.push(true);
        let before = chords.vertices.clone();
        chords.is_free[3] = false;
        chords.lengthen(1.0);
        let moved: Vec<bool> = chords.vertices.iter().zip(&before).map(|(now, then)| now != then).collect();
        assert_eq!(moved, [false, false, true, false, true, false]);
        // A zigzag of 0.5 % that two chords replace, which turn by next to nothing.
        let [from, middle, to] = [[0.0, 0.0], [1.0, 0.001], [2.0, 0.0]].map(IntoPoint::into_point);
        let vertices = vec![from, middle, to];
        let mut noisy = Chords {
            vertices: vertices.clone(),
            drawn: vec![1.005; 2],
            goals: vec![1.005; 2],
            missed: vec![1.0; 2],
            longer: vec![0.0; 2],
            is_free: vec![true; 3],
            is_closed: false,
        };
        noisy.lengthen(1.0);
        assert_eq!(noisy.vertices, vertices);
        let same = FlatPoint::new(1.0, 1.0);
        let mut none = Chords {
            vertices: vec![same; 4],
            drawn: vec![0.0; 3],
            goals: vec![0.0; 3],
            missed: vec![1.0; 3],
            longer: vec![0.0; 3],
            is_free: vec![true; 4],
            is_closed: true,
        };
        none.lengthen(1.0);
        assert_eq!(none.vertices, [same; 4]);
    }
}
