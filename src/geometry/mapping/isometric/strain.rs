//! The places where strain is measured, and how it depends on the map.

use nalgebra::Vector2;

use super::IsometricOptions;
use crate::geometry::ink::{Ink, Piece};
use crate::geometry::surface::knots::{Basis, UniformKnots};
use crate::geometry::surface::nurbs::SurfaceJet;

/// The shear at which the resistance equals the shear itself, as a multiple of the cap. It is above the cap because the
/// opposing strains are as strong there.
const KNEE: f64 = 1.25;

/// A place of the drawing with the weights of the strains that are measured there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    pub(super) s: Basis,
    pub(super) t: Basis,
    /// Unit direction of the line at this place; zero without a line.
    direction: Vector2<f64>,
    line: f64,
    area: f64,
    all_round: f64,
    /// Its share of the ink.
    pub(super) ink: f64,
}

/// First-order behaviour of the map at a sample, lifted to the surface.
pub(super) struct Strain {
    pub(super) jet: SurfaceJet,
    /// ∂φ/∂s and ∂φ/∂t.
    pub(super) by_s: Vector2<f64>,
    pub(super) by_t: Vector2<f64>,
    /// The contributions of 16 control points to φ, ∂φ/∂s and ∂φ/∂t.
    pub(super) basis: [[f64; 16]; 3],
}

/// Derivative of a residual by φ, ∂φ/∂s and ∂φ/∂t.
type Derivative = [[f64; 2]; 3];

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

impl Sample {
    /// A place with all weights zero.
    pub(super) fn at(s: Basis, t: Basis) -> Self {
        Self { s, t, direction: Vector2::zeros(), line: 0.0, area: 0.0, all_round: 0.0, ink: 0.0 }
    }

    /// Whether another sample is at the same place.
    pub(super) fn is_at(&self, other: &Self) -> bool {
        self.s == other.s && self.t == other.t
    }

    /// The cell's first control point.
    pub(super) fn cell(&self) -> (usize, usize) {
        (self.t.first, self.s.first)
    }
}

/// The samples of a drawing over a grid of cells, cell by cell. If its lines have more than `most_places` pieces, they are
/// gathered at about this number of places, at least two by two in each cell.
pub(super) fn samples(
    (knots_s, knots_t): (&UniformKnots, &UniformKnots),
    ink: &Ink,
    options: &IsometricOptions,
    most_places: usize,
) -> Vec<Sample> {
    let at = |place: Vector2<f64>| Sample::at(knots_s.basis(place.x), knots_t.basis(place.y));
    let (columns, rows) = (knots_s.spans(), knots_t.spans());
    let mut samples =
        Vec::with_capacity(8 * columns * rows + ink.pieces.len().min(most_places.saturating_mul(4)));
    // Two Gauss points per cell and direction integrate cubics exactly.
    let gauss = [0.5 - (1.0f64 / 12.0).sqrt(), 0.5 + (1.0f64 / 12.0).sqrt()];
    for cell in 0..columns * rows {
        for (u, v) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let s = knots_s.start() + ((cell % columns) as f64 + gauss[u]) * knots_s.step();
            let t = knots_t.start() + ((cell / columns) as f64 + gauss[v]) * knots_t.step();
            let all_round = options.box_weight / (4 * columns * rows) as f64;
            samples.push(Sample { all_round, ..at(Vector2::new(s, t)) });
        }
    }
    if !options.is_even() {
        let length = ink.length();
        // Lines and inked areas get half of the ink's weight each.
        let of_lines = if ink.squares.is_empty() { 1.0 } else { 0.5 };
        let of_piece = |at: Sample, direction: Vector2<f64>, share: f64| Sample {
            direction,
            line: options.line_weight * share,
            ..at
        };
        let around = |at: Sample, share: f64| Sample {
            all_round: options.shape_weight * share * of_lines,
            ink: share * of_lines,
            ..at
        };
        if ink.pieces.len() > most_places {
            let parts = ((most_places / (columns * rows)).isqrt()).clamp(2, MOST_PARTS);
            for bundle in bundles(ink, knots_s, knots_t, parts) {
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
        for (place, share) in gathered(ink, knots_s, knots_t) {
            samples.push(Sample {
                area: options.area_weight * share,
                all_round: options.shape_weight * share * of_squares,
                ink: share * of_squares,
                ..at(place)
            });
        }
    }
    // Samples are large, so that their indices are sorted.
    let mut order: Vec<u32> = (0..samples.len() as u32).collect();
    order.sort_by_key(|index| samples[*index as usize].cell());
    order.into_iter().map(|index| samples[index as usize]).collect()
}

/// Most divisions of a cell along a side at which lines are gathered.
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
        // Along the sides of a diamond instead of a circle: the sectors are not quite equal, which does not matter.
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

/// Places of the lines and inked areas at which the largest angle error is looked up; of many pieces, only some.
pub(super) fn places_of_ink(
    knots: (&UniformKnots, &UniformKnots),
    ink: &Ink,
    options: &IsometricOptions,
    most_places: usize,
) -> Vec<Sample> {
    let step = ink.pieces.len().div_ceil(most_places).max(1);
    let some = ink.pieces.iter().copied().step_by(step).collect();
    let ink =
        Ink { pieces: some, dots: Vec::new(), squares: ink.squares.clone(), blocks: Vec::new(), ..*ink };
    samples(knots, &ink, options, most_places).into_iter().filter(|sample| sample.ink > 0.0).collect()
}

/// The inked squares of each quarter of a cell as one point at their centre, with their share of all squares: strain
/// changes little over a quarter of a cell.
fn gathered(ink: &Ink, knots_s: &UniformKnots, knots_t: &UniformKnots) -> Vec<(Vector2<f64>, f64)> {
    let (columns, rows) = (2 * knots_s.spans(), 2 * knots_t.spans());
    let mut quarters = vec![(Vector2::zeros(), 0.0); columns * rows];
    for square in &ink.squares {
        let (column, row) = (part(knots_s, square.x, 2), part(knots_t, square.y, 2));
        let (sum, count) = &mut quarters[row * columns + column];
        *sum += square.coords();
        *count += 1.0;
    }
    let all = ink.squares.len() as f64;
    quarters
        .iter()
        .filter(|(_, count)| *count > 0.0)
        .map(|(sum, count)| (sum / *count, count / all))
        .collect()
}

impl Strain {
    /// Calls `take` with the weight, the residual and its derivative for everything that is measured at the sample.
    #[inline(always)]
    pub(super) fn observe(&self, sample: &Sample, cap: f64, mut take: impl FnMut(f64, f64, &Derivative)) {
        if sample.line > 0.0 {
            let (strain, derivative) = self.stretch(&sample.direction);
            take(sample.line, strain, &derivative);
        }
        if sample.area > 0.0 {
            let (strain, derivative) = self.area_strain();
            take(sample.area, strain, &derivative);
        }
        if sample.all_round > 0.0 {
            for direction in &ALL_ROUND {
                let (strain, derivative) = self.stretch(direction);
                take(sample.all_round / 4.0, strain, &derivative);
            }
        }
        if sample.ink > 0.0 && cap.is_finite() {
            for (resistance, derivative) in self.resistance(cap) {
                take(sample.ink, resistance, &derivative);
            }
        }
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

    /// The resistance to shear, q·|q|²/(KNEE·cap)² for both components of the shear q: almost zero far below the cap,
    /// and strong above it.
    #[inline(always)]
    fn resistance(&self, cap: f64) -> [(f64, Derivative); 2] {
        let SurfaceJet { gradient, hessian, .. } = &self.jet;
        let shear = self.shear();
        let per_square = 1.0 / (KNEE * cap).powi(2).max(f64::MIN_POSITIVE);
        let factor = shear.norm_squared() * per_square;
        let (climb_s, climb_t) = (gradient.dot(&self.by_s), gradient.dot(&self.by_t));
        let (metric_s, metric_t) = (self.by_s + gradient * climb_s, self.by_t + gradient * climb_t);
        let (bend_s, bend_t) = (hessian * self.by_s, hessian * self.by_t);
        [Vector2::x(), Vector2::y()].map(|unit| {
            let turn = unit * factor + shear * (2.0 * shear.dot(&unit) * per_square);
            let by_place = (bend_s * climb_s - bend_t * climb_t) * turn.x
                + (bend_t * climb_s + bend_s * climb_t) * turn.y;
            let by_s = metric_s * turn.x + metric_t * turn.y;
            let by_t = metric_s * turn.y - metric_t * turn.x;
            (shear.dot(&unit) * factor, [by_place.into(), by_s.into(), by_t.into()])
        })
    }
}
