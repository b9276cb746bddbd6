//! The places where strain is measured, and how it depends on the map.

use nalgebra::Vector2;

use super::scales::Scales;
use crate::geometry::ink::{Ink, Piece};
use crate::geometry::surface::knots::{Basis, UniformKnots};
use crate::geometry::surface::nurbs::SurfaceJet;

/// The shear at which the resistance equals the shear itself, as a multiple of the cap. It is above the cap because the
/// opposing strains are as strong there.
const KNEE: f64 = 1.25;

/// Values and first derivatives of the four nonzero basis functions at a place: there are many, and second derivatives are not needed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Along {
    /// Index of the first of the four control points.
    pub(super) first: usize,
    pub(super) value: [f64; 4],
    /// 1/mm.
    pub(super) slope: [f64; 4],
}

impl From<Basis> for Along {
    fn from(Basis { first, value, slope, .. }: Basis) -> Self {
        Self { first, value, slope }
    }
}

/// A place of the drawing with the weights of the strains that are measured there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    pub(super) s: Along,
    pub(super) t: Along,
    /// Unit direction of the line at this place; zero without a line.
    direction: Vector2<f64>,
    pub(super) line: f64,
    pub(super) area: f64,
    pub(super) all_round: f64,
    /// Its share of the ink.
    ink: f64,
    /// The weight of its angle error; at first its share of the ink.
    pub(super) angle: f64,
}

/// The weights of the samples' strains. Each multiplies a mean square.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Weights {
    /// Of the strain along the drawing's own lines.
    pub(super) line: f64,
    /// Of the strain of inked areas.
    pub(super) area: f64,
    /// Of the strain in all directions equally at the ink: along the lines and over the inked area.
    pub(super) shape: f64,
    /// Of the strain in all directions equally over the whole box.
    pub(super) paper: f64,
}

impl Weights {
    /// Equal weight over the box.
    pub(super) const EVEN: Self = Self { line: 0.0, area: 0.0, shape: 0.0, paper: 1.0 };
    /// Sums of squares from which the rounds start.
    ///
    /// With much more weight on the lines, the inside of large filled shapes rotates relative to their outline.
    pub(super) const START: Self = Self { line: 1.0, area: 2.0, shape: 0.5, paper: 0.1 };
}

/// How finely the ink is sampled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fineness {
    /// If the lines have more pieces, they are gathered at about this number of places.
    pub(super) most_places: usize,
    /// The inked squares are gathered in this number of parts along the side of each cell.
    pub(super) parts: usize,
}

/// First-order behaviour of the map at a sample, lifted to the surface.
pub(super) struct Strain {
    pub(super) jet: SurfaceJet,
    /// ∂φ/∂s and ∂φ/∂t.
    pub(super) by_s: Vector2<f64>,
    pub(super) by_t: Vector2<f64>,
}

/// The products of the values of four basis functions in each direction, row by row.
pub(super) fn products(s: &[f64; 4], t: &[f64; 4]) -> [f64; 16] {
    std::array::from_fn(|local| s[local % 4] * t[local / 4])
}

/// Derivative of a residual by φ, ∂φ/∂s and ∂φ/∂t.
pub(super) type Derivative = [[f64; 2]; 3];

/// The directions at 0°, 45°, 90° and 135°.
const ALL_ROUND: [Vector2<f64>; 4] = {
    const DIAGONAL: f64 = std::f64::consts::FRAC_1_SQRT_2;
    [
        Vector2::new(1.0, 0.0),
        Vector2::new(DIAGONAL, DIAGONAL),
        Vector2::new(0.0, 1.0),
        Vector2::new(-DIAGONAL, DIAGONAL),
    ]
};

/// The components of ∂φ/∂s and ∂φ/∂t, as measured values.
const CHANGES: [Derivative; 4] = [
    [[0.0; 2], [1.0, 0.0], [0.0; 2]],
    [[0.0; 2], [0.0, 1.0], [0.0; 2]],
    [[0.0; 2], [0.0; 2], [1.0, 0.0]],
    [[0.0; 2], [0.0; 2], [0.0, 1.0]],
];

impl Sample {
    /// A place with all weights zero.
    pub(super) fn at(s: Basis, t: Basis) -> Self {
        let [s, t] = [s, t].map(Along::from);
        Self { s, t, direction: Vector2::zeros(), line: 0.0, area: 0.0, all_round: 0.0, ink: 0.0, angle: 0.0 }
    }

    /// Whether another sample is at the same place.
    pub(super) fn is_at(&self, other: &Self) -> bool {
        self.s == other.s && self.t == other.t
    }

    /// Whether lines or inked areas are at the place.
    pub(super) fn is_ink(&self) -> bool {
        self.ink > 0.0
    }

    /// The contributions of 16 control points to φ, ∂φ/∂s and ∂φ/∂t.
    pub(super) fn basis(&self) -> [[f64; 16]; 3] {
        let Self { s, t, .. } = self;
        [products(&s.value, &t.value), products(&s.slope, &t.value), products(&s.value, &t.slope)]
    }

    /// The cell's first control point.
    pub(super) fn cell(&self) -> (usize, usize) {
        (self.t.first, self.s.first)
    }
}

/// The samples of a drawing over a grid of cells, cell by cell. Lines that are gathered have at least two by two places in
/// each cell.
pub(super) fn samples(
    (knots_s, knots_t): (&UniformKnots, &UniformKnots),
    ink: &Ink,
    weights: &Weights,
    Fineness { most_places, parts }: Fineness,
) -> Vec<Sample> {
    let at = |place: Vector2<f64>| Sample::at(knots_s.basis(place.x), knots_t.basis(place.y));
    let (columns, rows) = (knots_s.spans(), knots_t.spans());
    let most = (4 + parts * parts) * columns * rows + ink.pieces.len().min(most_places.saturating_mul(4));
    let mut samples = Vec::with_capacity(most);
    // Two Gauss points per cell and direction integrate cubics exactly.
    let gauss = [0.5 - (1.0f64 / 12.0).sqrt(), 0.5 + (1.0f64 / 12.0).sqrt()];
    for cell in 0..columns * rows {
        for (u, v) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let s = knots_s.start() + ((cell % columns) as f64 + gauss[u]) * knots_s.step();
            let t = knots_t.start() + ((cell / columns) as f64 + gauss[v]) * knots_t.step();
            let all_round = weights.paper / (4 * columns * rows) as f64;
            samples.push(Sample { all_round, ..at(Vector2::new(s, t)) });
        }
    }
    if *weights != Weights::EVEN {
        let length = ink.length();
        // Lines and inked areas get half of the ink's weight each.
        let of_lines = if ink.squares.is_empty() { 1.0 } else { 0.5 };
        let of_piece = |at: Sample, direction: Vector2<f64>, share: f64| Sample {
            direction,
            line: weights.line * share,
            ..at
        };
        let around = |at: Sample, share: f64| Sample {
            all_round: weights.shape * share * of_lines,
            ink: share * of_lines,
            angle: share * of_lines,
            ..at
        };
        if ink.pieces.len() > most_places {
            let of_cell = ((most_places / (columns * rows)).isqrt()).clamp(2, MOST_PARTS);
            for bundle in bundles(ink, knots_s, knots_t, of_cell) {
                let place = at(bundle.place / bundle.length);
                let mut lines =
                    bundle.lines().map(|(direction, part)| of_piece(place, direction, part / length));
                samples.extend(lines.next().map(|first| around(first, bundle.length / length)));
                samples.extend(lines);
            }
        } else {
            for piece in ink.pieces.iter().filter(|piece| piece.length() > 0.0) {
                let share = piece.length() / length;
                let place = at(piece.from.lerp(piece.to, 0.5).coords());
                samples.push(around(of_piece(place, (piece.to - piece.from).normalize(), share), share));
            }
        }
        let of_squares = if length > 0.0 { 0.5 } else { 1.0 };
        for (place, share) in gathered(ink, knots_s, knots_t, parts) {
            samples.push(Sample {
                area: weights.area * share,
                all_round: weights.shape * share * of_squares,
                ink: share * of_squares,
                angle: share * of_squares,
                ..at(place)
            });
        }
    }
    // Samples are large, so that their indices are sorted, and no list of them is written twice.
    let mut order: Vec<u32> = (0..samples.len() as u32).collect();
    order.sort_by_key(|index| samples[*index as usize].cell());
    rearrange(&mut samples, &mut order);
    samples
}

/// Moves to each place the thing that `order` names for it, along the cycles of this permutation.
fn rearrange<T: Copy>(things: &mut [T], order: &mut [u32]) {
    for start in 0..things.len() {
        let first = things[start];
        let mut at = start;
        loop {
            // A place is done when it names itself.
            let from = std::mem::replace(&mut order[at], at as u32) as usize;
            if from == start {
                things[at] = first;
                break;
            }
            things[at] = things[from];
            at = from;
        }
    }
}

/// A cell is divided into at most this many parts along a side, in which lines are gathered.
const MOST_PARTS: usize = 8;
/// Directions of gathered lines are distinguished in this number of sectors of half a turn.
const SECTORS: usize = 16;

/// The lines in a part of a cell.
#[derive(Clone, Default)]
struct Bundle {
    length: f64,
    /// The sum of the middles of the pieces, times their lengths.
    place: Vector2<f64>,
    /// The sums of the pieces in each sector, and of their lengths.
    sectors: [(Vector2<f64>, f64); SECTORS],
}

impl Bundle {
    fn add(&mut self, piece: &Piece) {
        let (along, length) = (piece.to - piece.from, piece.length());
        // A line has no sense.
        let along = if along.y < 0.0 { -along } else { along };
        // Along the sides of a diamond instead of a circle: the sectors are slightly unequal, which has no
        // effect.
        let turn = along.y / (along.x.abs() + along.y);
        let turn = if along.x < 0.0 { 2.0 - turn } else { turn };
        // A line along −x is one along x.
        let sector = (turn / 2.0 * SECTORS as f64) as usize % SECTORS;
        let (sum, part) = &mut self.sectors[sector];
        *sum += if sum.dot(&along) < 0.0 { -along } else { along };
        *part += length;
        self.place += piece.from.lerp(piece.to, 0.5).coords() * length;
        self.length += length;
    }

    /// Unit directions with the lengths of their lines.
    fn lines(&self) -> impl Iterator<Item = (Vector2<f64>, f64)> {
        let used = self.sectors.iter().filter(|(_, length)| *length > 0.0);
        used.map(|(sum, length)| (sum.normalize(), *length))
    }
}

/// The lines of each cell in `parts` × `parts` bundles.
fn bundles(ink: &Ink, knots_s: &UniformKnots, knots_t: &UniformKnots, parts: usize) -> Vec<Bundle> {
    let (columns, rows) = (parts * knots_s.spans(), parts * knots_t.spans());
    let mut found = vec![u32::MAX; columns * rows];
    let mut bundles: Vec<Bundle> = Vec::new();
    for piece in ink.pieces.iter().filter(|piece| piece.length() > 0.0) {
        let middle = piece.from.lerp(piece.to, 0.5);
        let place = part(knots_t, middle.y, parts) * columns + part(knots_s, middle.x, parts);
        if found[place] == u32::MAX {
            found[place] = bundles.len() as u32;
            bundles.push(Bundle::default());
        }
        bundles[found[place] as usize].add(piece);
    }
    bundles
}

/// The part of a span, each divided into `parts`, that contains a place.
fn part(knots: &UniformKnots, place: f64, parts: usize) -> usize {
    ((parts as f64 * (place - knots.start()) / knots.step()) as usize).min(parts * knots.spans() - 1)
}

/// The inked squares of each of `parts` × `parts` parts of a cell as one point at their centre, with their share of all
/// squares: strain changes little over a part.
fn gathered(
    ink: &Ink,
    knots_s: &UniformKnots,
    knots_t: &UniformKnots,
    parts: usize,
) -> Vec<(Vector2<f64>, f64)> {
    let (columns, rows) = (parts * knots_s.spans(), parts * knots_t.spans());
    let mut gathered = vec![(Vector2::zeros(), 0.0); columns * rows];
    for square in &ink.squares {
        let (column, row) = (part(knots_s, square.x, parts), part(knots_t, square.y, parts));
        let (sum, count) = &mut gathered[row * columns + column];
        *sum += square.coords();
        *count += 1.0;
    }
    let all = ink.squares.len() as f64;
    gathered
        .iter()
        .filter(|(_, count)| *count > 0.0)
        .map(|(sum, count)| (sum / *count, count / all))
        .collect()
}

/// Paper resists if it keeps less than this share of its area.
const SQUEEZED: f64 = 0.5;
/// The resistance of paper is largest if it keeps at most this share of its area.
const FOLDED: f64 = 0.05;

/// How what is measured at a sample is weighted.
pub(super) trait Weighting {
    /// Calls `take` with the weight, the residual and its derivative for everything that is measured at the sample.
    fn observe(&self, strain: &Strain, sample: &Sample, take: impl FnMut(f64, f64, &Derivative));
}

/// Sums of squares, with a limit for the angle error of the ink, rad.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cap(pub(super) f64);

impl Cap {
    pub(super) const NONE: Self = Self(f64::INFINITY);
}

impl Weighting for Cap {
    #[inline(always)]
    fn observe(&self, strain: &Strain, sample: &Sample, mut take: impl FnMut(f64, f64, &Derivative)) {
        if sample.line > 0.0 {
            let (change, derivative) = strain.stretch(&sample.direction);
            take(sample.line, change, &derivative);
        }
        if sample.area > 0.0 {
            let (change, derivative) = strain.area_strain();
            take(sample.area, change, &derivative);
        }
        if sample.all_round > 0.0 {
            for direction in &ALL_ROUND {
                let (change, derivative) = strain.stretch(direction);
                take(sample.all_round / 4.0, change, &derivative);
            }
        }
        if sample.ink > 0.0 && self.0.is_finite() {
            for (resistance, derivative) in strain.resistance(self.0) {
                take(sample.ink, resistance, &derivative);
            }
        }
    }
}

/// A weighting with which a step also resists any change of the map's derivatives. This keeps the step short
/// where the strains hardly determine it (Levenberg, A method for the solution of certain non-linear problems
/// in least squares, 1944).
#[derive(Debug, Clone, Copy)]
pub(super) struct Damped<'w, W> {
    pub(super) weighting: &'w W,
    /// The resistance, as a multiple of the weight of the strain in all directions at the same place.
    pub(super) damping: f64,
}

impl<W: Weighting> Weighting for Damped<'_, W> {
    #[inline(always)]
    fn observe(&self, strain: &Strain, sample: &Sample, mut take: impl FnMut(f64, f64, &Derivative)) {
        self.weighting.observe(strain, sample, &mut take);
        if self.damping > 0.0 && sample.all_round > 0.0 {
            for derivative in &CHANGES {
                take(self.damping * sample.all_round, 0.0, derivative);
            }
        }
    }
}

/// In a round of weighting, weights fall with the strains, and angles have their own.
impl Weighting for Scales {
    #[inline(always)]
    fn observe(&self, strain: &Strain, sample: &Sample, mut take: impl FnMut(f64, f64, &Derivative)) {
        if sample.line > 0.0 {
            let (change, derivative) = strain.stretch(&sample.direction);
            take(sample.line * self.of_line(change), change, &derivative);
        }
        if sample.area > 0.0 {
            let (change, derivative) = strain.area_strain();
            take(sample.area * self.of_area(change), change, &derivative);
        }
        if sample.all_round > 0.0 {
            let stiffness = self.of_paper(strain.largest_stretch());
            for direction in &ALL_ROUND {
                let (change, derivative) = strain.stretch(direction);
                take(sample.all_round / 4.0 * stiffness, change, &derivative);
            }
            let squeezed = strain.resistance_to_folds();
            if squeezed > 0.0 {
                let (change, derivative) = strain.area_strain();
                take(sample.all_round * squeezed, change, &derivative);
            }
        }
        if sample.angle > 0.0 {
            let shear = strain.shear();
            for (axis, derivative) in strain.shear_derivatives().into_iter().enumerate() {
                take(sample.angle, shear[axis], &derivative);
            }
        }
    }
}

impl Strain {
    /// The strain along the line at a sample.
    pub(super) fn along(&self, sample: &Sample) -> f64 {
        self.stretch(&sample.direction).0
    }

    /// The strain along a unit direction of the drawing.
    pub(super) fn along_direction(&self, direction: &Vector2<f64>) -> f64 {
        self.stretch(direction).0
    }

    /// The largest absolute strain in four directions.
    pub(super) fn largest_stretch(&self) -> f64 {
        ALL_ROUND.iter().map(|direction| self.stretch(direction).0.abs()).fold(0.0, f64::max)
    }

    /// How many times the weight of other strains the change of its area has where the map squeezes the paper
    /// to less than half of its area or folds it; 0 elsewhere. Lengths alone do not resist a fold: behind it
    /// they are as drawn.
    pub(super) fn resistance_to_folds(&self) -> f64 {
        let area = self.area();
        if area < SQUEEZED { (SQUEEZED / area.max(FOLDED)).powi(2) } else { 0.0 }
    }

    /// Ratio of area on the surface to area in the drawing; negative where the map folds the drawing over.
    pub(super) fn area(&self) -> f64 {
        (1.0 + self.jet.gradient.norm_squared()).sqrt() * self.by_s.perp(&self.by_t)
    }

    /// The largest change of an angle, rad, for small strains.
    pub(super) fn angle_error(&self) -> f64 {
        self.shear().norm() / self.area().max(f64::MIN_POSITIVE)
    }

    /// Change of length along a unit direction of the drawing.
    #[inline(always)]
    fn stretch(&self, direction: &Vector2<f64>) -> (f64, Derivative) {
        let SurfaceJet { gradient, hessian, .. } = &self.jet;
        let image = self.by_s * direction.x + self.by_t * direction.y;
        let climb = gradient.dot(&image);
        let stretch = (image.norm_squared() + climb * climb).sqrt();
        let by_image = (image + gradient * climb) / stretch;
        let by_place = hessian * image * (climb / stretch);
        (stretch - 1.0, [by_place.into(), (by_image * direction.x).into(), (by_image * direction.y).into()])
    }

    #[inline(always)]
    fn area_strain(&self) -> (f64, Derivative) {
        let SurfaceJet { gradient, hessian, .. } = &self.jet;
        let lift = (1.0 + gradient.norm_squared()).sqrt();
        let flat_area = self.by_s.perp(&self.by_t);
        let by_place = hessian * gradient * (flat_area / lift);
        let by_s = [lift * self.by_t.y, -lift * self.by_t.x];
        let by_t = [-lift * self.by_s.y, lift * self.by_s.x];
        (lift * flat_area - 1.0, [by_place.into(), by_s, by_t])
    }

    /// ((E − G)/2, F): half the difference of the squared principal stretches, rotated by twice their angle.
    #[inline(always)]
    fn shear(&self) -> Vector2<f64> {
        let (climb_s, climb_t) = (self.jet.gradient.dot(&self.by_s), self.jet.gradient.dot(&self.by_t));
        let e = self.by_s.norm_squared() + climb_s * climb_s;
        let g = self.by_t.norm_squared() + climb_t * climb_t;
        Vector2::new((e - g) / 2.0, self.by_s.dot(&self.by_t) + climb_s * climb_t)
    }

    /// The derivatives of the two components of the shear.
    #[inline(always)]
    fn shear_derivatives(&self) -> [Derivative; 2] {
        let SurfaceJet { gradient, hessian, .. } = &self.jet;
        let (climb_s, climb_t) = (gradient.dot(&self.by_s), gradient.dot(&self.by_t));
        let (metric_s, metric_t) = (self.by_s + gradient * climb_s, self.by_t + gradient * climb_t);
        let (bend_s, bend_t) = (hessian * self.by_s, hessian * self.by_t);
        let by_place = [bend_s * climb_s - bend_t * climb_t, bend_t * climb_s + bend_s * climb_t];
        [
            [by_place[0].into(), metric_s.into(), (-metric_t).into()],
            [by_place[1].into(), metric_t.into(), metric_s.into()],
        ]
    }

    /// The resistance to shear, q·|q|²/(KNEE·cap)² for both components of the shear q: almost zero far below the cap,
    /// and strong above it.
    #[inline(always)]
    fn resistance(&self, cap: f64) -> [(f64, Derivative); 2] {
        let shear = self.shear();
        let per_square = 1.0 / (KNEE * cap).powi(2).max(f64::MIN_POSITIVE);
        let factor = shear.norm_squared() * per_square;
        let [by_first, by_second] = self.shear_derivatives();
        [Vector2::x(), Vector2::y()].map(|unit| {
            let turn = unit * factor + shear * (2.0 * shear.dot(&unit) * per_square);
            let part =
                |part: usize, axis: usize| by_first[part][axis] * turn.x + by_second[part][axis] * turn.y;
            let derivative = std::array::from_fn(|quantity| std::array::from_fn(|axis| part(quantity, axis)));
            (shear.dot(&unit) * factor, derivative)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn things_are_rearranged_as_their_order_says() {
        let things = [10, 11, 12, 13, 14, 15];
        for order in [[0, 1, 2, 3, 4, 5], [5, 4, 3, 2, 1, 0], [1, 2, 0, 3, 5, 4], [3, 0, 5, 1, 2, 4]] {
            let mut rearranged = things;
            rearrange(&mut rearranged, &mut order.clone());
            assert_eq!(rearranged, order.map(|index: u32| things[index as usize]));
        }
    }
}
