//! What a misplaced part does to the mark: changes of length, area and position on the part.
//!
//! The drawing stays where it is in the field, so the beams stay, and the part moves under them. If the part is displaced by
//! δ at a point with the unit normal n, and the beam there comes from the direction b, the mark moves on the part by
//! u = −δ + b·(n·δ)/(n·b), to first order. All results follow from the differences of u along the lines and over the inked
//! area.

use nalgebra::{Point3, Vector3};

use super::correction::{Contact, Projection};
use crate::geometry::ink::{Ink, Piece};
use crate::geometry::space::FlatPoint;

/// At most this many pieces of lines are examined, spread evenly over all.
const PIECES: usize = 512;
/// At most this many squares of the inked area are examined.
const SQUARES: usize = 256;
/// The displacement whose effects are reported, mm.
pub const SHIFT: f64 = 0.1;
/// The turn whose effects are reported, rad: 0.1 deg.
pub const TURN: f64 = 0.1 * std::f64::consts::PI / 180.0;
/// A beam that only grazes the surface moves without limit. Such places are skipped; they are rejected
/// anyway.
const GRAZING: f64 = 0.02;

/// A movement of the part in the laser's frame. Turns are about the middle of the ink on the part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Misplacement {
    /// Along x, y or z (0, 1, 2).
    Shift(usize),
    /// About the direction of x, y or z (0, 1, 2).
    Turn(usize),
}

/// All movements, in the order of the report.
pub const MISPLACEMENTS: [Misplacement; 6] = [
    Misplacement::Shift(0),
    Misplacement::Shift(1),
    Misplacement::Shift(2),
    Misplacement::Turn(0),
    Misplacement::Turn(1),
    Misplacement::Turn(2),
];

impl Misplacement {
    /// The displacement of a point of the laser's frame by a unit of this movement (1 mm or 1 rad).
    fn displacement(self, at: Point3<f64>, pivot: Point3<f64>) -> Vector3<f64> {
        let axis = |index: usize| Vector3::ith_axis(index).into_inner();
        match self {
            Self::Shift(along) => axis(along),
            Self::Turn(about) => axis(about).cross(&(at - pivot)),
        }
    }

    /// The amount whose effect is reported: [`SHIFT`] mm or [`TURN`] rad.
    pub fn amount(self) -> f64 {
        match self {
            Self::Shift(_) => SHIFT,
            Self::Turn(_) => TURN,
        }
    }
}

/// How well the position of the part is known: one standard deviation of each movement.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PoseUncertainty {
    /// Sideways, along x and along y, mm.
    pub sideways: f64,
    /// In height, mm.
    pub height: f64,
    /// Of a turn about each axis, rad.
    pub turn: f64,
}

impl PoseUncertainty {
    /// Whether anything is stated.
    pub fn is_stated(&self) -> bool {
        *self != Self::default()
    }

    fn of(&self, misplacement: Misplacement) -> f64 {
        match misplacement {
            Misplacement::Shift(2) => self.height,
            Misplacement::Shift(_) => self.sideways,
            Misplacement::Turn(_) => self.turn,
        }
    }
}

/// What a misplaced part does to the mark.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Effect {
    /// Sum over all lines of |change of length|, mm: comparable with e_l.
    pub length: f64,
    /// Sum over the inked area of |change of area|, mm²: comparable with e_a.
    pub area: f64,
    /// Largest movement of the mark on the part, mm.
    pub moved: f64,
}

/// What a misplaced part does to the mark, for each movement and for the uncertainty of the position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensitivity {
    /// The effect of each of [`MISPLACEMENTS`] by its [`amount`](Misplacement::amount).
    pub effects: [Effect; 6],
    /// The expected effect of all movements together (root of the sum of squares); `None` if nothing is stated.
    pub expected: Option<Effect>,
}

/// A point of the part under the beam, in the laser's frame.
struct Hit {
    at: Point3<f64>,
    /// The movement of the mark on the part by a unit of each of [`MISPLACEMENTS`].
    moved: [Vector3<f64>; 6],
}

/// Sums of a result over the samples: for each movement alone, and for all together.
#[derive(Default)]
struct Sums {
    single: [f64; 6],
    together: f64,
}

impl Sums {
    /// Adds the changes of a sample by the units of all movements.
    fn add(&mut self, changes: [f64; 6], uncertainty: &PoseUncertainty) {
        let mut square = 0.0;
        for ((sum, change), by) in self.single.iter_mut().zip(changes).zip(MISPLACEMENTS) {
            *sum += change.abs() * by.amount();
            square += (change * uncertainty.of(by)).powi(2);
        }
        self.together += square.sqrt();
    }
}

impl Projection<'_> {
    /// What a misplaced part does to the mark of this ink. Without ink, every effect is zero.
    pub fn sensitivity(&self, ink: &Ink, uncertainty: &PoseUncertainty) -> Sensitivity {
        let pivot = self.landing(ink.extents.center().into()).1;
        let (mut farthest, mut farthest_together) = ([0.0f64; 6], 0.0f64);
        let mut include = |hit: &Hit| {
            let mut square = 0.0;
            for ((farthest, by), moved) in farthest.iter_mut().zip(MISPLACEMENTS).zip(&hit.moved) {
                let distance = moved.norm();
                *farthest = f64::max(*farthest, distance * by.amount());
                square += (distance * uncertainty.of(by)).powi(2);
            }
            farthest_together = farthest_together.max(square.sqrt());
        };
        let hit = |flat: FlatPoint| self.hit(flat, pivot);
        let (mut lengths, mut examined) = (Sums::default(), 0.0);
        for Piece { from, to } in spread(&ink.pieces, PIECES) {
            let (Some(start), Some(end)) = (hit(*from), hit(*to)) else { continue };
            let along = (end.at - start.at).normalize();
            let change = std::array::from_fn(|by| along.dot(&(end.moved[by] - start.moved[by])));
            lengths.add(change, uncertainty);
            examined += from.distance(*to);
            include(&start);
            include(&end);
        }
        let whole = if examined > 0.0 { ink.length() / examined } else { 0.0 };
        let (mut areas, mut squares) = (Sums::default(), 0usize);
        for center in spread(&ink.squares, SQUARES) {
            let half = ink.side / 2.0;
            let beside = |x: f64, y: f64| hit(FlatPoint::new(center.x + x, center.y + y));
            let hits = [beside(-half, 0.0), beside(half, 0.0), beside(0.0, -half), beside(0.0, half)];
            let [Some(left), Some(right), Some(below), Some(above)] = hits else { continue };
            let (across, up) = (right.at - left.at, above.at - below.at);
            let area = across.cross(&up);
            let change = std::array::from_fn(|by| {
                let wider = right.moved[by] - left.moved[by];
                let higher = above.moved[by] - below.moved[by];
                area.dot(&(wider.cross(&up) + across.cross(&higher))) / area.norm_squared()
            });
            areas.add(change, uncertainty);
            squares += 1;
            include(&left);
        }
        let each = if squares > 0 { ink.area() / squares as f64 } else { 0.0 };
        for dot in spread(&ink.dots, SQUARES) {
            hit(*dot).iter().for_each(&mut include);
        }
        let effect = |index: usize| Effect {
            length: lengths.single[index] * whole,
            area: areas.single[index] * each,
            moved: farthest[index],
        };
        Sensitivity {
            effects: std::array::from_fn(effect),
            expected: uncertainty.is_stated().then_some(Effect {
                length: lengths.together * whole,
                area: areas.together * each,
                moved: farthest_together,
            }),
        }
    }

    /// Where the beam for a point of the drawing meets the part; `None` where it only grazes the part, or cannot reach it. Turns are about `pivot`.
    fn hit(&self, flat: FlatPoint, pivot: Point3<f64>) -> Option<Hit> {
        let Contact { at, normal, .. } = self.contact(flat, self.map.point(flat));
        self.head.aim(at)?;
        let towards = self.head.towards(at);
        let facing = normal.dot(&towards);
        let moved = |by: Misplacement| {
            let displacement = by.displacement(at, pivot);
            towards * (normal.dot(&displacement) / facing) - displacement
        };
        (facing > GRAZING).then(|| Hit { at, moved: MISPLACEMENTS.map(moved) })
    }
}

/// At most `count` of the items, spread evenly. The steps are multiples of the golden section, to prevent
/// them from matching a regular pattern among the items, such as the sides of many squares.
fn spread<T>(items: &[T], count: usize) -> impl Iterator<Item = &T> {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let all = items.len() <= count;
    let index = move |step: usize| {
        if all { step } else { ((step as f64 * GOLDEN).fract() * items.len() as f64) as usize }
    };
    (0..items.len().min(count)).filter_map(move |step| items.get(index(step)))
}
